//! The maps of `envmaps/`, embedded.

/// A built-in map.
#[derive(Clone, Copy, Debug)]
pub struct BuiltInMap {
    /// What scene files call it.
    pub name: &'static str,
    /// What it shows.
    pub about: &'static str,
    /// The EXR file.
    pub exr: &'static [u8],
}

macro_rules! maps {
    ($($name:literal: $about:literal,)*) => {
        &[$(BuiltInMap { name: $name, about: $about, exr: include_bytes!(concat!("../../envmaps/", $name, ".exr")) }),*]
    };
}

/// All built-in maps.
pub const BUILT_IN_MAPS: &[BuiltInMap] = maps! {
    "clear-sky": "a clear sky with a true sun",
    "overcast": "an overcast sky",
    "forest": "light through leaves",
    "studio": "a dark studio with soft boxes",
    "city": "a city at night",
};

pub(super) fn names() -> String {
    BUILT_IN_MAPS.iter().map(|m| m.name).collect::<Vec<_>>().join(", ")
}
