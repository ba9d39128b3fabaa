//! The built-in scenes, as scene files embedded in the library.

/// A built-in scene.
#[derive(Clone, Copy, Debug)]
pub struct BuiltIn {
    /// Its name.
    pub name: &'static str,
    /// A one-line description.
    pub about: &'static str,
    /// The scene file.
    pub toml: &'static str,
}

macro_rules! built_in {
    ($($name:literal: $about:literal,)*) => {
        &[$(BuiltIn { name: $name, about: $about, toml: include_str!(concat!("builtin/", $name, ".toml")) }),*]
    };
}

/// All built-in scenes.
pub static BUILT_IN: &[BuiltIn] = built_in! {
    "still-life": "rings of gold and copper, a silver spoon and painted balls in low sun",
    "ring": "a mirror ring on a table under a tiny sun (Wand & Straßer, Figures 4 and 5)",
    "ring-above": "the same ring and light from straight above, orthographic: the scene to measure with",
    "ring-natural": "the ring in forest light, its inner side a mirror (Figure 6d)",
    "ring-solid": "a solid ring that mirrors on all sides and receives its own caustics (Figure 6e)",
    "spoon": "a spoon in forest light (Figure 6b)",
    "spoon-in-sun": "a golden spoon in the sun, on a slate table",
    "spoon-above": "the spoon from above (Figure 6c)",
    "cup": "a mirror cup that receives its own caustics in natural light (Figure 6f)",
    "cup-point-light": "the cup under a small light from above (Figure 7b)",
    "sheet": "a waving sheet of copper throws bands of sunlight on a wall",
    "pool": "waves on a tiled pool throw caustics through the water and up the wall",
    "dynamic": "bright balls, a gold ring and a floor, all of which move (Figure 7c)",
    "columns": "balls and columns between the light, a brass ring and the table shadow each other",
    "gloss": "rings of silver, polished, brushed and blasted",
    "metals": "rings of silver, gold, copper, aluminium, chromium and brass in forest light",
    "varnish": "a gilded ring on a glossy table",
    "mirror-sphere": "a mirror sphere above a table in a studio",
    "disco-ball": "a ball of flat mirror tiles throws images of the sun around a room (Section 3)",
    "dance-floor": "a mirror ball scatters the light of moving coloured lamps over a room where balls dance",
    "candle": "a candle flickers inside a silver ring: light from near",
    "colours": "a mirror ball throws the colours of lit walls into its own shadow",
    "haze": "a mirror ball throws shafts of a spotlight's light through a smoky room",
    "underwater": "the sun's shafts and bright lines below the waves of a lagoon",
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_scene_loads() {
        for scene in BUILT_IN {
            let loaded = crate::scene::load::<toml::Table>(scene.name).unwrap();
            assert!(loaded.scene.objects.iter().any(|o| o.specular().is_some()), "{}", scene.name);
            assert!(loaded.scene.objects.iter().any(|o| o.receiver.is_some()), "{}", scene.name);
        }
    }
}
