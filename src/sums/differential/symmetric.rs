//! Symmetric 2×2 matrices.

use glam::Vec2;

/// [[xx, xy], [xy, yy]].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Symmetric2 {
    pub xx: f32,
    pub xy: f32,
    pub yy: f32,
}

impl Symmetric2 {
    /// Eigenvalues, the larger first, and the unit eigenvector of the larger; the other one is perpendicular.
    pub fn eigen(self) -> ([f32; 2], Vec2) {
        let mean = 0.5 * (self.xx + self.yy);
        let half_difference = 0.5 * (self.xx - self.yy);
        let radius = half_difference.hypot(self.xy);
        let direction = Vec2::from_angle(0.5 * self.xy.atan2(half_difference));
        ([mean + radius, mean - radius], direction)
    }

    pub fn determinant(self) -> f32 {
        self.xx * self.yy - self.xy * self.xy
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenpairs_satisfy_their_equation() {
        for (xx, xy, yy) in [(3.0, 1.0, 2.0), (-1.0, 0.0, 4.0), (2.0, 0.0, 2.0), (0.0, -5.0, 0.0)] {
            let ([large, small], d) = Symmetric2 { xx, xy, yy }.eigen();
            assert!(large >= small);
            let apply = |v: Vec2| Vec2::new(xx * v.x + xy * v.y, xy * v.x + yy * v.y);
            assert!(apply(d).abs_diff_eq(large * d, 1e-5));
            assert!(apply(d.perp()).abs_diff_eq(small * d.perp(), 1e-5));
        }
    }
}
