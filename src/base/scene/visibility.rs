//! Which occlusion is taken into account. Part of the problem's definition, so that techniques and ground truth share
//! it.

use std::fmt;

/// Which occlusion is taken into account.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Visibility {
    /// Only back-face culling: the paper's integral.
    None,
    /// All objects occlude the light from the environment to the mirror, from the mirror to the receiver, and from the
    /// environment directly to the receiver.
    #[default]
    Full,
}

impl fmt::Display for Visibility {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Visibility {
    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Full => "full",
        }
    }
}
