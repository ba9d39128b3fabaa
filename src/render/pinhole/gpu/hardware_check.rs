//! Does this adapter's anisotropic filter honour explicit gradients on cube maps? Several do not, and none says so.
//!
//! A striped cube is sampled with footprints that are long across the stripes or along them. Averaging across makes
//! grey; an adapter that ignores the gradients returns a stripe's own colour.

use glam::Vec3;

use super::probe::probe;
use crate::boxed::BoxFuture;
use crate::environment::CubeMap;
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::{Filter, Probe};

/// What the check found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardwareVerdict {
    /// Root mean square difference from the exact means; the pattern's own deviation is 1.
    pub rms_error: f32,
}

impl HardwareVerdict {
    /// Whether `--filter hardware` can be trusted here.
    pub fn is_right(&self) -> bool {
        self.rms_error < 0.07
    }
}

/// What `--filter auto` means on a device: its own filter where that is right, as it costs least; else Pinspot's.
pub fn automatic_filter(gpu: &Gpu) -> BoxFuture<'_, Result<Filter, GpuError>> {
    Box::pin(async move {
        Ok(if check_hardware_filter(gpu).await?.is_right() { Filter::Hardware } else { Filter::Anisotropic })
    })
}

/// Stripes that vary with height on the four upright faces: 0 or 2, so that their mean and their deviation are 1.
fn stripes(direction: Vec3) -> Vec3 {
    let height = direction.y / direction.x.abs().max(direction.z.abs());
    Vec3::splat(if (height * 32.0).rem_euclid(2.0) < 1.0 { 0.0 } else { 2.0 })
}

/// Footprints of aspect 8 at the centres of stripes: across, where the mean is 1, and along, where it is the stripe's own.
fn probes() -> Vec<(Probe, f32)> {
    let mut probes = Vec::new();
    for (axis, side) in [(Vec3::X, Vec3::Z), (Vec3::Z, Vec3::X), (Vec3::NEG_X, Vec3::Z), (Vec3::NEG_Z, Vec3::X)] {
        for stripe in [0, 1, 5, 8] {
            let direction = axis + side * 0.1 + Vec3::Y * ((stripe as f32 + 0.5) / 32.0);
            let own = if stripe % 2 == 0 { 0.0 } else { 2.0 };
            for (long, short, mean) in [(Vec3::Y, side, 1.0), (side, Vec3::Y, own)] {
                probes.push((Probe { direction, sides: [long * 0.25, short * 0.01] }, mean));
            }
        }
    }
    probes
}

/// Runs the check; a few milliseconds.
pub fn check_hardware_filter(gpu: &Gpu) -> BoxFuture<'_, Result<HardwareVerdict, GpuError>> {
    Box::pin(async move {
        let pattern = CubeMap::from_radiance(256, Some(0.01), stripes);
        let (probes, means): (Vec<Probe>, Vec<f32>) = probes().into_iter().unzip();
        let answers = probe(gpu, &pattern, Filter::Hardware, 16, &probes).await?;
        let squared = answers.iter().zip(means).map(|(got, mean)| (got[0] - mean).powi(2));
        Ok(HardwareVerdict { rms_error: (squared.sum::<f32>() / probes.len() as f32).sqrt() })
    })
}
