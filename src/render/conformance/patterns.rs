//! Test cubes, texel by texel.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use glam::Vec3;
use serde::Serialize;

use crate::environment::{CubeMap, FACES};

/// Texels along the edge of a test cube's faces.
pub(super) const SIZE: usize = 256;

/// What is on a test cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// Squares of four texels.
    Checker,
    /// Stripes along the rows, two texels wide.
    Rows,
    /// Stripes along the columns.
    Columns,
    /// Rings around each face's centre, ever narrower.
    ZonePlate,
    /// Independent texels.
    Noise,
    /// One bright texel in every 32².
    BrightTexel,
    /// A sun of a few texels on each face, ten thousand times as bright as the sky.
    Sun,
}

/// All patterns.
pub const PATTERNS: [Pattern; 7] = [
    Pattern::Checker,
    Pattern::Rows,
    Pattern::Columns,
    Pattern::ZonePlate,
    Pattern::Noise,
    Pattern::BrightTexel,
    Pattern::Sun,
];

impl Pattern {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Checker => "checker",
            Self::Rows => "rows",
            Self::Columns => "columns",
            Self::ZonePlate => "zone plate",
            Self::Noise => "noise",
            Self::BrightTexel => "bright texel",
            Self::Sun => "sun",
        }
    }

    /// The pattern as a cube map with mips.
    pub(super) fn cube(self) -> &'static CubeMap {
        static CUBES: [OnceLock<CubeMap>; PATTERNS.len()] = [const { OnceLock::new() }; PATTERNS.len()];
        CUBES[self as usize].get_or_init(|| CubeMap::from_texels(SIZE as u32, &self.texels(), true))
    }

    /// Standard deviation of the texels.
    pub(super) fn deviation(self) -> f64 {
        let texels = self.texels();
        let count = texels.len() as f64;
        let mean = texels.iter().map(|t| f64::from(t.x)).sum::<f64>() / count;
        (texels.iter().map(|t| (f64::from(t.x) - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    fn texels(self) -> Vec<Vec3> {
        let places = (0..FACES).flat_map(|f| (0..SIZE).flat_map(move |j| (0..SIZE).map(move |i| (f, i, j))));
        places.map(|(face, i, j)| Vec3::splat(self.texel(face, i, j) as f32)).collect()
    }

    fn texel(self, face: usize, i: usize, j: usize) -> f64 {
        let half = 0.5 * SIZE as f64;
        let off = (i as f64 + 0.5 - half).hypot(j as f64 + 0.5 - half);
        let either = |odd: bool| if odd { 1.0 } else { 0.0 };
        match self {
            Self::Checker => either((i / 4 + j / 4) % 2 == 1),
            Self::Rows => either(j / 2 % 2 == 1),
            Self::Columns => either(i / 2 % 2 == 1),
            // The frequency grows with the distance to a quarter of a cycle per texel at the edge.
            Self::ZonePlate => 0.5 + 0.5 * (TAU * off * off / (8.0 * half)).cos(),
            Self::Noise => hashed(face, i, j),
            Self::BrightTexel => 100.0 * either(i % 32 == 16 && j % 32 == 16),
            Self::Sun => 1.0 + 1e4 * (-0.5 * (off / 3.0).powi(2)).exp(),
        }
    }
}

/// A number in [0, 1) that has nothing to do with its neighbours.
fn hashed(face: usize, i: usize, j: usize) -> f64 {
    let mut x = ((face * SIZE + j) * SIZE + i) as u64;
    x = (x ^ (x >> 30)).wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
