//! The account of a caustic's flux: what came from the lights, what arrived in maps, and where the rest went.

use std::ops::{AddAssign, Index, IndexMut, Range};

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::parallel;

/// Why flux that was reflected or refracted is in no caustic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// It meets nothing more.
    Missed,
    /// It meets a mirror, an interface or anything else that receives nothing.
    NoReceiver,
    /// It stays in a closed object: it is reflected where it should have left it.
    TotalReflection,
    /// It meets a receiver that the map does not show, because another one hides it, or on the other side.
    Hidden,
    /// It meets a receiver outside of the map.
    OffMap,
    /// It is spread by a polygon that was left out.
    Culled,
}

impl Loss {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Missed, Self::NoReceiver, Self::TotalReflection, Self::Hidden, Self::OffMap, Self::Culled];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Missed => "missed",
            Self::NoReceiver => "no-receiver",
            Self::TotalReflection => "total-reflection",
            Self::Hidden => "hidden",
            Self::OffMap => "off-map",
            Self::Culled => "culled",
        }
    }
}

/// Flux of photons, W, the sum of the three channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Ledger {
    /// What mirrors and interfaces reflect or refract.
    pub cast: f64,
    /// What is in the maps.
    pub deposited: f64,
    /// [`Loss::Missed`].
    pub missed: f64,
    /// [`Loss::NoReceiver`].
    pub no_receiver: f64,
    /// [`Loss::TotalReflection`].
    pub total_reflection: f64,
    /// [`Loss::Hidden`].
    pub hidden: f64,
    /// [`Loss::OffMap`].
    pub off_map: f64,
    /// [`Loss::Culled`].
    pub culled: f64,
}

impl Ledger {
    /// Flux, as the ledger counts it.
    pub fn sum(flux: Vec3) -> f64 {
        flux.as_dvec3().element_sum()
    }

    /// What all losses together are.
    pub fn lost(&self) -> f64 {
        Loss::ALL.iter().map(|loss| self[*loss]).sum()
    }

    /// This account and another one, which is so much of the mean.
    #[must_use]
    pub fn mixed(&self, other: &Self, part: f64) -> Self {
        let mean = |one: f64, other: f64| (1.0 - part) * one + part * other;
        let mut mixed = Self {
            cast: mean(self.cast, other.cast),
            deposited: mean(self.deposited, other.deposited),
            ..Self::default()
        };
        for loss in Loss::ALL {
            mixed[loss] = mean(self[loss], other[loss]);
        }
        mixed
    }

    /// What is neither deposited nor lost, relative to what was cast; 0 without light.
    pub fn error(&self) -> f64 {
        if self.cast == 0.0 { 0.0 } else { (self.cast - self.deposited - self.lost()) / self.cast }
    }
}

impl Index<Loss> for Ledger {
    type Output = f64;

    fn index(&self, loss: Loss) -> &f64 {
        match loss {
            Loss::Missed => &self.missed,
            Loss::NoReceiver => &self.no_receiver,
            Loss::TotalReflection => &self.total_reflection,
            Loss::Hidden => &self.hidden,
            Loss::OffMap => &self.off_map,
            Loss::Culled => &self.culled,
        }
    }
}

impl IndexMut<Loss> for Ledger {
    fn index_mut(&mut self, loss: Loss) -> &mut f64 {
        match loss {
            Loss::Missed => &mut self.missed,
            Loss::NoReceiver => &mut self.no_receiver,
            Loss::TotalReflection => &mut self.total_reflection,
            Loss::Hidden => &mut self.hidden,
            Loss::OffMap => &mut self.off_map,
            Loss::Culled => &mut self.culled,
        }
    }
}

impl AddAssign for Ledger {
    fn add_assign(&mut self, other: Self) {
        self.cast += other.cast;
        self.deposited += other.deposited;
        for loss in Loss::ALL {
            self[loss] += other[loss];
        }
    }
}

/// The sum of accounts, given each by its number, in their order, so that it is the same every time.
pub(super) fn total(numbers: Range<usize>, account: &(dyn Fn(usize) -> Ledger + Sync)) -> Ledger {
    // Parts of a fixed size, each in its own order.
    const PART: usize = 4096;
    let add = |mut sum: Ledger, one: Ledger| {
        sum += one;
        sum
    };
    let part = |part: usize| {
        let first = numbers.start + PART * part;
        (first..numbers.end.min(first + PART)).map(account).fold(Ledger::default(), add)
    };
    parallel::collect(numbers.len().div_ceil(PART), &part).into_iter().fold(Ledger::default(), add)
}
