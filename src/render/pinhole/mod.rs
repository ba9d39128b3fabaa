//! The sums over pinholes: those on CPUs, and their twins on devices.

#[cfg(feature = "gpu")]
pub mod gpu;

pub use pinspot_sums::pinhole::*;
