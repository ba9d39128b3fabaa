//! Paths that leave the scene by way of smooth mirrors, and how much of the environment each of them stands for: as much as the
//! directions of neighbouring points of its pixel differ (Igehy, *Tracing Ray Differentials*, SIGGRAPH 1999, by differences). Of two
//! neighbours the one that differs less counts: the other may be beyond a fold or an edge of the mirror.

use glam::Vec3;

/// Footprints of strongly curved mirrors are no longer than this, radians: beyond it directions may be those of different parts.
const MAX_SIDE: f32 = 0.5;

/// A path that reached the environment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Escape {
    /// Index of its term among those of its pixel.
    pub term: usize,
    /// Hash of the mirrors and interfaces that it met, and of what they did to it.
    pub key: u64,
    /// Unit direction in the world.
    pub direction: Vec3,
}

/// The sides of the footprints of what left the scene by way of a pixel's points, which are given row by row, `columns` a row; with the
/// indices of their terms.
pub(super) fn footprints(points: &[Vec<Escape>], columns: usize) -> impl Iterator<Item = (usize, [Vec3; 2])> {
    let rows = points.len() / columns.max(1);
    let side = move |own: &Escape, at: usize, count: usize, step: usize, index: usize| {
        let same = |index: usize| points[index].iter().find(|other| other.key == own.key);
        let neighbour = |index: usize| same(index).map(|other| other.direction);
        let next = (at + 1 < count).then(|| neighbour(index + step)).flatten().map(|next| next - own.direction);
        let previous = (at > 0).then(|| neighbour(index - step)).flatten().map(|previous| own.direction - previous);
        let changes = [next, previous].into_iter().flatten();
        let least = changes.min_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let change = least.unwrap_or(Vec3::ZERO).clamp_length_max(MAX_SIDE);
        change - change.dot(own.direction) * own.direction
    };
    points.iter().enumerate().flat_map(move |(index, escapes)| {
        let (x, y) = (index % columns, index / columns);
        let sides = move |own: &Escape| [side(own, x, columns, 1, index), side(own, y, rows, columns, index)];
        escapes.iter().map(move |own| (own.term, sides(own)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_the_differences_of_neighbours_that_met_the_same_mirrors() {
        let direction = |x: usize, y: usize| Vec3::new(0.1 * x as f32, 0.02 * y as f32, 1.0).normalize();
        let mut points: Vec<Vec<Escape>> =
            (0..6).map(|k| vec![Escape { term: 10 + k, key: 7, direction: direction(k % 3, k / 3) }]).collect();
        points[5].clear();
        let found: Vec<_> = footprints(&points, 3).collect();
        assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), [10, 11, 12, 13, 14]);
        for (term, [horizontal, vertical]) in &found {
            let own = points[term - 10][0].direction;
            assert!(horizontal.dot(own).abs() < 1e-6 && vertical.dot(own).abs() < 1e-6);
            assert!((horizontal.length() - 0.1).abs() < 0.01, "{horizontal}");
            // The last point of the first row has no neighbour below.
            let expected = if *term == 12 { 0.0 } else { 0.02 };
            assert!((vertical.length() - expected).abs() < 0.003, "{vertical}");
        }
    }

    #[test]
    fn points_on_a_strongly_curved_mirror_show_a_wide_footprint() {
        let points = [0.0, 1.0, 2.0]
            .map(|angle: f32| vec![Escape { term: 0, key: 1, direction: Vec3::new(angle.cos(), angle.sin(), 0.0) }]);
        let sides: Vec<_> = footprints(&points, 3).map(|(_, [horizontal, _])| horizontal.length()).collect();
        assert!(sides.iter().all(|side| (0.4..0.501).contains(side)), "{sides:?}");
    }

    #[test]
    fn a_lone_point_has_no_sides() {
        let lone = [vec![Escape { term: 0, key: 1, direction: Vec3::X }]];
        assert_eq!(footprints(&lone, 1).collect::<Vec<_>>(), [(0, [Vec3::ZERO; 2])]);
        assert_eq!(footprints(&[const { Vec::new() }; 4], 2).count(), 0);
    }
}
