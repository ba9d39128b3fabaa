//! Mirrors that no built-in shape is, as OBJ files with smooth normals.

use std::f32::consts::TAU;
use std::fmt::Write;

use glam::Vec3;

/// A surface: position and normal by two parameters from 0 to 1.
pub fn surface(point: impl Fn(f32, f32) -> (Vec3, Vec3), [columns, rows]: [usize; 2]) -> Vec<u8> {
    let mut text = String::new();
    for k in 0..(columns + 1) * (rows + 1) {
        let (p, n) = point((k % (columns + 1)) as f32 / columns as f32, (k / (columns + 1)) as f32 / rows as f32);
        writeln!(text, "v {} {} {}\nvn {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z).unwrap();
    }
    for k in 0..columns * rows {
        let first = k / columns * (columns + 1) + k % columns + 1;
        let [a, b, c, d] = [first, first + 1, first + columns + 2, first + columns + 1];
        writeln!(text, "f {a}//{a} {b}//{b} {c}//{c} {d}//{d}").unwrap();
    }
    text.into_bytes()
}

/// A paraboloid of this focal length about +Z, its focus in the origin, from one radius to another.
pub fn paraboloid(focal_length: f32, [inner, outer]: [f32; 2]) -> Vec<u8> {
    let point = |u: f32, v: f32| {
        let (radius, (sine, cosine)) = (inner + (outer - inner) * v, (TAU * u).sin_cos());
        let position = Vec3::new(radius * cosine, radius * sine, radius * radius / (4.0 * focal_length) - focal_length);
        let slope = radius / (2.0 * focal_length);
        (position, Vec3::new(-slope * cosine, -slope * sine, 1.0).normalize())
    };
    surface(point, [180, 40])
}

/// A parabolic trough along Z that opens upwards, its vertex in the origin.
pub fn trough(focal_length: f32, width: f32, length: f32) -> Vec<u8> {
    let point = |u: f32, v: f32| {
        let (x, z) = (width * (u - 0.5), length * (0.5 - v));
        let slope = x / (2.0 * focal_length);
        (Vec3::new(x, x * x / (4.0 * focal_length), z), Vec3::new(-slope, 1.0, 0.0).normalize())
    };
    surface(point, [160, 4])
}

/// A cone about +Z that opens upwards, from one radius to another, with this slope.
pub fn cone(slope: f32, [inner, outer]: [f32; 2]) -> Vec<u8> {
    let point = |u: f32, v: f32| {
        let (radius, (sine, cosine)) = (inner + (outer - inner) * v, (TAU * u).sin_cos());
        let position = Vec3::new(radius * cosine, radius * sine, slope * radius);
        (position, Vec3::new(-slope * cosine, -slope * sine, 1.0).normalize())
    };
    surface(point, [120, 20])
}
