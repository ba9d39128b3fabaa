//! Repeatable noise: every value is a hash of whole-number cell coordinates
//! and a seed, so the result depends on no state, no order and no thread.

use glam::{IVec3, Vec3};

/// Mixes cell coordinates and a seed to 32 well-spread bits.
pub fn hash(cell: IVec3, seed: u32) -> u32 {
    let mut h = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    for part in cell.to_array() {
        h ^= (part as u32).wrapping_mul(0xcc9e_2d51);
        h = h.rotate_left(13).wrapping_mul(0x1b87_3593);
    }
    h ^= h >> 16;
    h = h.wrapping_mul(0x7feb_352d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

/// A number in [0, 1) that belongs to the cell.
pub fn random(cell: IVec3, seed: u32) -> f32 {
    (hash(cell, seed) >> 8) as f32 / (1u32 << 24) as f32
}

/// Three numbers in [0, 1) that belong to the cell, from one hash.
pub fn random3(cell: IVec3, seed: u32) -> Vec3 {
    let h = hash(cell, seed);
    let part = |shift: u32| ((h >> shift) & 0x3ff) as f32 / 1024.0;
    Vec3::new(part(0), part(10), part(20))
}

/// Hermite step from 0 at `low` to 1 at `high`; `low` may exceed `high`.
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Gradient noise, about -1 to 1, mean 0, features of about unit size.
pub fn gradient(p: Vec3, seed: u32) -> f32 {
    let base = p.floor();
    let f = p - base;
    let cell = base.as_ivec3();
    let fade = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let corner = |x: i32, y: i32, z: i32| {
        let offset = IVec3::new(x, y, z);
        let slope = random3(cell + offset, seed) * 2.0 - 1.0;
        slope.dot(f - offset.as_vec3())
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let edge = |y: i32, z: i32| mix(corner(0, y, z), corner(1, y, z), fade.x);
    let face = |z: i32| mix(edge(0, z), edge(1, z), fade.y);
    1.4 * mix(face(0), face(1), fade.z)
}

/// Sum of octaves of gradient noise, about -1 to 1. Each octave is turned, so
/// that the lattices of two octaves never line up.
pub fn fbm(p: Vec3, octaves: u32, seed: u32) -> f32 {
    let mut point = p;
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for octave in 0..octaves {
        sum += weight * gradient(point, seed.wrapping_add(octave * 101));
        total += weight;
        weight *= 0.5;
        point = turned(point) * 2.03;
    }
    sum / total * 1.5
}

/// A fixed rotation about a skew axis.
fn turned(p: Vec3) -> Vec3 {
    Vec3::new(0.8 * p.y + 0.6 * p.z, -0.8 * p.x + 0.36 * p.y - 0.48 * p.z, -0.6 * p.x - 0.48 * p.y + 0.64 * p.z)
}
