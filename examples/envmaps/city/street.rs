//! The wet road: asphalt, kerbs and markings, with puddles that mirror.

use glam::Vec3;

use super::lamps::{Lamp, on_road};
use crate::noise::{fbm, gradient, smoothstep};

/// Half the width between the kerbs, metres.
const KERB: f32 = 7.0;

pub struct Road {
    pub radiance: Vec3,
    /// Tilt of the water's surface towards x and z.
    tilt: Vec3,
    wet: f32,
}

impl Road {
    pub fn at(place: Vec3, lamps: &[Lamp]) -> Self {
        let flat = Vec3::new(place.x, 0.0, place.z);
        let distance = flat.length();
        let puddle = smoothstep(-0.25, 0.35, fbm(flat * 0.33, 4, 71));
        let near = smoothstep(30.0, 3.0, distance);
        let grain = near * gradient(flat * 7.0, 72);
        let albedo = (0.065 + 0.55 * marking(flat)) * (1.0 - 0.45 * puddle) * (1.0 + 0.3 * grain);
        let light = on_road(lamps, place) + Vec3::new(0.05, 0.055, 0.08);
        let ripple = |seed| 0.012 * near * gradient(flat * 2.3, seed);
        Self {
            radiance: light * albedo / std::f32::consts::PI,
            tilt: Vec3::new(ripple(73), 0.0, ripple(74)),
            wet: 0.35 + 0.65 * puddle,
        }
    }

    /// The direction that the road mirrors.
    pub fn mirrored(&self, direction: Vec3) -> Vec3 {
        let normal = (Vec3::Y + self.tilt).normalize();
        let ray = direction - 2.0 * direction.dot(normal) * normal;
        Vec3::new(ray.x, ray.y.max(0.002), ray.z).normalize()
    }

    /// Share of light that the water's film mirrors (Schlick's formula), raised
    /// a little, as wet asphalt looks to the eye at night.
    pub fn mirror_share(&self, direction: Vec3) -> f32 {
        let slant = (1.0 + direction.y).clamp(0.0, 1.0).powi(5);
        self.wet * (0.045 + 0.80 * slant)
    }
}

/// How much paint or pale kerb there is at a place, 0 to 0.35.
fn marking(flat: Vec3) -> f32 {
    let (x, z) = (flat.x.abs(), flat.z.abs());
    let (across, along) = (x.min(z), x.max(z));
    if across > KERB {
        let slab = (flat.x / 1.2).fract().abs() < 0.04 || (flat.z / 1.2).fract().abs() < 0.04;
        return if across < KERB + 0.3 {
            0.22
        } else if slab {
            0.04
        } else {
            0.10
        };
    }
    let worn = 0.75 + 0.25 * gradient(flat * 1.9, 75);
    let crossing = (8.2..11.4).contains(&along) && (across / 1.1).fract() < 0.5;
    let dash = along > 14.0 && across < 0.09 && (along / 6.0).fract() < 0.5;
    let stop = (12.2..12.6).contains(&along);
    if crossing || dash || stop { 0.35 * worn } else { 0.0 }
}
