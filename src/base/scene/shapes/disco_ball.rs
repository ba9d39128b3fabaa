//! The disco ball: rows of flat, nearly square tiles whose corners lie on a sphere (Wand and Straßer
//! 2003, Section 3).
//!
//! A tile between two parallels and two meridians is a planar trapezium, so that each is exactly flat. Tiles share no
//! vertices: all edges are creases.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::{DiscoBall, Parts};

pub(super) fn disco_ball(ball: &DiscoBall) -> Parts {
    let mut parts = Parts::default();
    for row in 0..ball.rows {
        let (upper, lower) = (PI * (row as f32 / ball.rows as f32), PI * ((row + 1) as f32 / ball.rows as f32));
        // As many tiles as make them square at the row's middle, but at least three.
        let tiles = ((0.5 * (upper + lower)).sin() * 2.0 * ball.rows as f32).round().max(3.0) as u32;
        let on_sphere = |polar: f32, tile: u32| {
            let azimuth = TAU * (tile % tiles) as f32 / tiles as f32;
            // The sine of a rounded π is not zero, but a pole is one point.
            let sin = if polar < PI { polar.sin() } else { 0.0 };
            ball.radius * Vec3::new(sin * azimuth.sin(), polar.cos(), sin * azimuth.cos())
        };
        for tile in 0..tiles {
            let corners = [(lower, tile), (lower, tile + 1), (upper, tile + 1), (upper, tile)];
            push_tile(&mut parts, corners.map(|(polar, tile)| on_sphere(polar, tile)), ball.joint);
        }
    }
    parts
}

fn push_tile(parts: &mut Parts, corners: [Vec3; 4], joint: f32) {
    // The diagonals also span a triangular tile at a pole, where two corners coincide.
    let normal = (corners[2] - corners[0]).cross(corners[3] - corners[1]).normalize();
    let middle = 0.25 * corners.iter().sum::<Vec3>();
    let vertices = corners.map(|corner| parts.vertex(corner + joint * (middle - corner), normal));
    parts.quad(vertices);
}
