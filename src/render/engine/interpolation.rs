//! Light between sixteen places of a grid, four by four, where it is smooth.

use glam::{Vec2, Vec3};

/// A point may lie this far from where four places around it lead one to expect it, in distances between them.
pub(super) const MAX_DEVIATION: f32 = 0.3;
/// Linear interpolation may be wrong by this part of all light, halfway between two places: more, and there is something between the
/// places that they do not show.
const MAX_CURVATURE: f32 = 0.01;

/// Whether linear interpolation is good enough between the inner four places: along the inner rows and columns the light hardly bends
/// on either side, in proportion to itself and other light `beside` it; `leniency` times as much as on surfaces.
pub(super) fn is_smooth(light: &[[Vec3; 4]; 4], beside: Vec3, leniency: f32) -> bool {
    let linear = 0.25 * (light[1][1] + light[1][2] + light[2][1] + light[2][2]);
    let most = leniency * 16.0 * MAX_CURVATURE * (linear + beside).max_element();
    // Cubic interpolation differs from linear by a sixteenth of the sum of the second differences. At a step halfway between places these
    // cancel, so their magnitudes are summed.
    let bends =
        |a: Vec3, b: Vec3, c: Vec3, d: Vec3| ((a - 2.0 * b + c).abs() + (b - 2.0 * c + d).abs()).max_element() > most;
    let [r0, r1, r2, r3] = light;
    (1..3).all(|k| !bends(light[k][0], light[k][1], light[k][2], light[k][3]) && !bends(r0[k], r1[k], r2[k], r3[k]))
}

/// Interpolates between four values, the upper ones first.
pub(super) fn bilinear([a, b, c, d]: [Vec3; 4], part: Vec2) -> Vec3 {
    a.lerp(b, part.x).lerp(c.lerp(d, part.x), part.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_smooth_and_ridges_are_not() {
        let grid = |light: fn(f32, f32) -> f32| {
            let place = |k: usize| k as f32 - 1.5;
            std::array::from_fn(|j| std::array::from_fn(|i| Vec3::splat(light(place(i), place(j)))))
        };
        assert!(is_smooth(&grid(|_, _| 0.0), Vec3::ZERO, 1.0));
        assert!(is_smooth(&grid(|x, y| 5.0 + x - 2.0 * y), Vec3::ZERO, 1.0));
        assert!(!is_smooth(&grid(|x, _| 5.0 - x * x), Vec3::ZERO, 1.0));
        assert!(!is_smooth(&grid(|_, y| if y > 1.0 { 2.0 } else { 1.0 }), Vec3::ZERO, 1.0));
        assert!(!is_smooth(&grid(|x, _| if x > 0.0 { 2.0 } else { 1.0 }), Vec3::ZERO, 1.0));
        assert!(is_smooth(&grid(|x, _| 5.0 - x * x), Vec3::splat(100.0), 1.0), "not seen beside more light");
        let corners = [0.0, 1.0, 2.0, 5.0].map(Vec3::splat);
        assert_eq!(bilinear(corners, Vec2::new(0.5, 0.25)), Vec3::splat(0.75 * 0.5 + 0.25 * 3.5));
    }
}
