//! Which occlusion counts. A matter of what is computed, so that techniques and ground truth share the word.

use std::fmt;

/// Which occlusion is taken into account.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Visibility {
    /// None but back-face culling: the paper's integral.
    None,
    /// Both legs, from the environment to the mirror and from the mirror to the receiver, are occluded by everything; so is
    /// the environment's direct light.
    #[default]
    Full,
}

impl fmt::Display for Visibility {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "none",
            Self::Full => "full",
        })
    }
}
