//! Light followed forwards, from where it comes from, by a mirror or an interface, to the receivers of the picture: as [`beams`] that fill
//! pixels, and as a [`count`] of random rays that the flux of every estimate is held against in its [`ledger`].
//!
//! It must not know how the estimate by points looks for light: what both agree on is then no common mistake.

mod beams;
mod by_beams;
mod count;
mod environment;
mod ledger;
mod origins;
mod rays;
mod solids;

pub use self::ledger::Ledger;

pub(super) use self::by_beams::{ByBeams, Shares, check_beams};
pub(super) use self::count::{Count, Flux, Window};
pub(super) use self::environment::Directions;
pub(super) use self::rays::Rays;
