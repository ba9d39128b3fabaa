//! Light between sixteen places of a grid, four by four, where it is smooth.

use glam::{Vec2, Vec3};

/// A point may lie this far from where four places around it lead one to expect it, in distances between them.
pub(super) const MAX_DEVIATION: f32 = 0.3;
/// Linear and cubic interpolation may differ by this part of the light: more, and there is something between the places that they do
/// not show.
const MAX_CURVATURE: f32 = 0.01;
/// Weights of cubic interpolation halfway between the second and the third of four values.
const CUBIC: [f32; 4] = [-0.0625, 0.5625, 0.5625, -0.0625];

/// Whether linear interpolation between the inner four places is as good as cubic interpolation among all; row by row.
pub(super) fn is_smooth(light: &[[Vec3; 4]; 4]) -> bool {
    let row = |row: &[Vec3; 4]| row.iter().zip(CUBIC).map(|(value, weight)| weight * *value).sum::<Vec3>();
    let cubic: Vec3 = light.iter().zip(CUBIC).map(|(values, weight)| weight * row(values)).sum();
    let linear = 0.25 * (light[1][1] + light[1][2] + light[2][1] + light[2][2]);
    (cubic - linear).abs().max_element() <= MAX_CURVATURE * linear.max_element()
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
        assert!(is_smooth(&grid(|_, _| 0.0)));
        assert!(is_smooth(&grid(|x, y| 5.0 + x - 2.0 * y)));
        assert!(!is_smooth(&grid(|x, _| 5.0 - x * x)));
        assert!(!is_smooth(&grid(|_, y| if y > 1.0 { 2.0 } else { 1.0 })));
        let corners = [0.0, 1.0, 2.0, 5.0].map(Vec3::splat);
        assert_eq!(bilinear(corners, Vec2::new(0.5, 0.25)), Vec3::splat(0.75 * 0.5 + 0.25 * 3.5));
    }
}
