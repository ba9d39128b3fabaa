//! Light between sixteen places of a grid, four by four, where it is smooth.

use glam::{Vec2, Vec3};

/// A point may lie this far from where four places around it lead one to expect it, in distances between them.
pub(super) const MAX_DEVIATION: f32 = 0.3;
/// Linear interpolation may be wrong by this part of all light, halfway between two places: more, and there is something between the
/// places that they do not show.
const MAX_CURVATURE: f32 = 0.02;

/// Whether linear interpolation is good enough between the inner four places: along the inner rows and columns the light hardly bends
/// on either side, in proportion to itself and other light `beside` it; `leniency` times as much as on surfaces. Where one of the outer
/// places of a row or column is unknown, light is taken to bend there as far as on its other side.
pub(super) fn is_smooth(light: &[[Option<Vec3>; 4]; 4], beside: Vec3, leniency: f32) -> bool {
    let inner = [light[1][1], light[1][2], light[2][1], light[2][2]];
    let linear = 0.25 * inner.into_iter().flatten().sum::<Vec3>();
    let most = leniency * 16.0 * MAX_CURVATURE * (linear + beside).max_element();
    // Cubic interpolation differs from linear by a sixteenth of the sum of the second differences. At a step halfway between places these
    // cancel, so their magnitudes are summed.
    let is_straight = |[a, b, c, d]: [Option<Vec3>; 4]| {
        let (Some(b), Some(c)) = (b, c) else { return false };
        let before = a.map(|a| (a - 2.0 * b + c).abs());
        let after = d.map(|d| (b - 2.0 * c + d).abs());
        let sum = |known: Vec3| before.unwrap_or(known) + after.unwrap_or(known);
        before.or(after).is_some_and(|known| sum(known).max_element() <= most)
    };
    (1..3).all(|k| is_straight(light[k]) && is_straight(light.map(|row| row[k])))
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
            std::array::from_fn(|j| std::array::from_fn(|i| Some(Vec3::splat(light(place(i), place(j))))))
        };
        assert!(is_smooth(&grid(|_, _| 0.0), Vec3::ZERO, 1.0));
        assert!(is_smooth(&grid(|x, y| 5.0 + x - 2.0 * y), Vec3::ZERO, 1.0));
        assert!(!is_smooth(&grid(|x, _| 5.0 - x * x), Vec3::ZERO, 1.0));
        assert!(!is_smooth(&grid(|_, y| if y > 1.0 { 2.0 } else { 1.0 }), Vec3::ZERO, 1.0));
        assert!(!is_smooth(&grid(|x, _| if x > 0.0 { 2.0 } else { 1.0 }), Vec3::ZERO, 1.0));
        assert!(is_smooth(&grid(|x, _| 5.0 - x * x), Vec3::splat(100.0), 1.0), "not seen beside more light");
        let without = |column: usize, light: [[Option<Vec3>; 4]; 4]| {
            light.map(|mut row| {
                row[column] = None;
                row
            })
        };
        let [_, rows @ ..] = grid(|x, y| 5.0 + x - 2.0 * y);
        let corner = without(0, [[None; 4], rows[0], rows[1], rows[2]]);
        assert!(is_smooth(&corner, Vec3::ZERO, 1.0), "at the edge of a surface");
        assert!(!is_smooth(&without(0, grid(|x, _| 5.0 - x * x)), Vec3::ZERO, 1.0));
        let narrow = without(0, without(3, grid(|_, _| 1.0)));
        assert!(!is_smooth(&narrow, Vec3::ZERO, 1.0), "nothing tells how light bends");
        let corners = [0.0, 1.0, 2.0, 5.0].map(Vec3::splat);
        assert_eq!(bilinear(corners, Vec2::new(0.5, 0.25)), Vec3::splat(0.75 * 0.5 + 0.25 * 3.5));
    }
}
