//! Cones of directions: the bounds of the ground truth are made of them.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

/// All unit directions within an angle of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cone {
    /// Unit axis.
    pub axis: DVec3,
    /// Radians, from 0 to π.
    pub half_angle: f64,
}

impl Cone {
    pub fn everything() -> Self {
        Self { axis: DVec3::Y, half_angle: PI }
    }

    /// The narrowest cone about the mean of the directions that holds them, and so every direction between them.
    pub fn around(directions: &[DVec3]) -> Self {
        let Some(axis) = directions.iter().sum::<DVec3>().try_normalize() else {
            return Self::everything();
        };
        let half_angle = directions.iter().map(|d| angle(axis, *d)).fold(0.0, f64::max);
        // A cone wider than a half space need not hold what lies between its directions.
        if half_angle < 0.5 * PI { Self { axis, half_angle } } else { Self::everything() }
    }

    /// A cone that holds two.
    pub fn union(self, other: Self) -> Self {
        let (wide, narrow) = if self.half_angle >= other.half_angle { (self, other) } else { (other, self) };
        let apart = angle(wide.axis, narrow.axis);
        if apart + narrow.half_angle <= wide.half_angle {
            return wide;
        }
        let half_angle = 0.5 * (wide.half_angle + apart + narrow.half_angle);
        let across = (narrow.axis - wide.axis * wide.axis.dot(narrow.axis)).try_normalize();
        match across {
            Some(across) if half_angle < PI => {
                let turn = half_angle - wide.half_angle;
                // Slightly wider than exact, so that rounding leaves nothing out.
                let axis = wide.axis * turn.cos() + across * turn.sin();
                Self { axis, half_angle: half_angle + 1e-12 }
            }
            _ => Self::everything(),
        }
    }

    /// The largest cosine between a unit direction and any of the cone widened by an angle; 0 where all are negative.
    pub fn largest_cosine(&self, direction: DVec3, widened_by: f64) -> f64 {
        let nearest = angle(self.axis, direction) - self.half_angle - widened_by;
        nearest.max(0.0).cos().max(0.0)
    }
}

/// The angle between unit directions, exact for small ones, too.
pub(super) fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// The box of (azimuth, polar angle) that holds a cone: centre and half width in azimuth about +Y, from −Z towards +X, and
/// the range of angles from +Y, all in radians.
pub(super) struct AngleBox {
    pub azimuth: f64,
    pub half_azimuth: f64,
    pub polar: [f64; 2],
}

impl AngleBox {
    pub fn around(axis: DVec3, half_angle: f64) -> Self {
        let polar = axis.x.hypot(axis.z).atan2(axis.y);
        let azimuth = axis.x.atan2(-axis.z);
        let (low, high) = (polar - half_angle, polar + half_angle);
        // Napier: the widest azimuth of a cap that holds no pole.
        let half_azimuth = if low <= 0.0 || high >= PI || half_angle >= FRAC_PI_2 {
            PI
        } else {
            (half_angle.sin() / polar.sin()).min(1.0).asin()
        };
        Self { azimuth, half_azimuth, polar: [low.max(0.0), high.min(PI)] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_union_holds_both() {
        let a = Cone { axis: DVec3::X, half_angle: 0.2 };
        let b = Cone { axis: DVec3::new(0.6, 0.8, 0.0), half_angle: 0.4 };
        let both = a.union(b);
        for cone in [a, b] {
            assert!(angle(both.axis, cone.axis) + cone.half_angle <= both.half_angle + 1e-9);
        }
        assert!((both.half_angle - 0.5 * (0.2 + angle(a.axis, b.axis) + 0.4)).abs() < 1e-9, "no wider than needed");
        assert_eq!(a.union(Cone { axis: -DVec3::X, half_angle: 3.0 }).half_angle, PI);
    }

    #[test]
    fn the_largest_cosine_is_that_of_the_nearest_edge() {
        let cone = Cone { axis: DVec3::X, half_angle: 0.3 };
        assert_eq!(cone.largest_cosine(DVec3::X, 0.0), 1.0);
        assert!((cone.largest_cosine(DVec3::Y, 0.0) - 0.3f64.sin()).abs() < 1e-12);
        assert_eq!(cone.largest_cosine(-DVec3::X, 0.0), 0.0);
    }
}
