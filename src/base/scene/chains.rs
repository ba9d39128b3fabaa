//! Which of the ways from the light to a receiver count, named after what happens on them. Part of the problem's definition, so that
//! techniques and ground truth share it.

use std::fmt;

/// A way from the light to a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
pub enum Chain {
    /// One reflection, by a mirror or by an interface between two media.
    R,
    /// One refraction, by an interface between two media.
    T,
    /// Two refractions: into a closed object and out of it.
    TT,
    /// Four refractions: through two closed objects, one after the other.
    TTTT,
}

impl Chain {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::R, Self::T, Self::TT, Self::TTTT];

    /// Its name on the command line and in layers.
    pub fn name(self) -> &'static str {
        match self {
            Self::R => "R",
            Self::T => "T",
            Self::TT => "TT",
            Self::TTTT => "TTTT",
        }
    }
}

/// A set of chains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(into = "Vec<Chain>")]
#[expect(clippy::struct_excessive_bools, reason = "a set, with a name for each chain")]
pub struct Chains {
    /// Whether [`Chain::R`] counts.
    pub reflected: bool,
    /// Whether [`Chain::T`] counts.
    pub refracted: bool,
    /// Whether [`Chain::TT`] counts.
    pub refracted_twice: bool,
    /// Whether [`Chain::TTTT`] counts.
    pub refracted_four_times: bool,
}

impl Chains {
    /// All chains.
    pub const ALL: Self = Self { reflected: true, refracted: true, refracted_twice: true, refracted_four_times: true };
    /// Those of one reflection or refraction.
    pub const SINGLE: Self = Self { refracted_twice: false, refracted_four_times: false, ..Self::ALL };

    /// Whether a chain counts.
    pub fn contains(self, chain: Chain) -> bool {
        match chain {
            Chain::R => self.reflected,
            Chain::T => self.refracted,
            Chain::TT => self.refracted_twice,
            Chain::TTTT => self.refracted_four_times,
        }
    }

    /// Whether it holds every chain.
    pub fn is_all(&self) -> bool {
        *self == Self::ALL
    }
}

impl Default for Chains {
    fn default() -> Self {
        Self::ALL
    }
}

impl FromIterator<Chain> for Chains {
    fn from_iter<I: IntoIterator<Item = Chain>>(chains: I) -> Self {
        let chains: Vec<Chain> = chains.into_iter().collect();
        let [reflected, refracted, refracted_twice, refracted_four_times] =
            Chain::ALL.map(|chain| chains.contains(&chain));
        Self { reflected, refracted, refracted_twice, refracted_four_times }
    }
}

impl From<Chain> for Chains {
    fn from(chain: Chain) -> Self {
        [chain].into_iter().collect()
    }
}

impl From<Chains> for Vec<Chain> {
    fn from(chains: Chains) -> Self {
        Chain::ALL.into_iter().filter(|chain| chains.contains(*chain)).collect()
    }
}

impl fmt::Display for Chains {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = Vec::from(*self).into_iter().map(Chain::name).collect();
        f.write_str(&names.join(","))
    }
}
