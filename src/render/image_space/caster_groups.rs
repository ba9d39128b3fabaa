//! Groups of what casts caustics: small mirrors far apart are each seen by a few photons, where a grid around all of them might miss them.

use glam::Vec3;

/// A group is split if its surface is less than this part of the square of its size: a grid of 64² photons around such a group has about a dozen
/// rows across each mirror.
const LEAST_FILL: f32 = 0.02;

/// No more groups than this.
const MOST_GROUPS: usize = 32;

struct Group {
    triangles: Vec<[Vec3; 3]>,
    fill: f32,
}

impl Group {
    fn new(triangles: Vec<[Vec3; 3]>) -> Self {
        let area: f32 = triangles.iter().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum();
        let [low, high] = bounds(triangles.iter().flatten().copied());
        Self { triangles, fill: area / (high - low).length_squared().max(f32::MIN_POSITIVE) }
    }

    /// Both halves along the longest axis; `None` if all triangles have the same middle.
    fn halves(&self) -> Option<[Self; 2]> {
        let middle = |[a, b, c]: &[Vec3; 3]| (a + b + c) / 3.0;
        let [low, high] = bounds(self.triangles.iter().map(middle));
        let axis = (high - low).max_position();
        let half = 0.5 * low[axis] + 0.5 * high[axis];
        let (below, above): (Vec<_>, Vec<_>) = self.triangles.iter().partition(|corners| middle(corners)[axis] < half);
        (!below.is_empty() && !above.is_empty()).then(|| [below, above].map(Self::new))
    }
}

/// The corners of the triangles of each group.
pub fn caster_groups(triangles: &[[Vec3; 3]]) -> Vec<Vec<Vec3>> {
    let mut sparse = vec![Group::new(triangles.to_vec())];
    let mut finished = Vec::new();
    while let Some(place) = (0..sparse.len()).min_by(|a, b| sparse[*a].fill.total_cmp(&sparse[*b].fill)) {
        let group = sparse.swap_remove(place);
        let may_be_split = group.fill < LEAST_FILL && sparse.len() + finished.len() + 2 <= MOST_GROUPS;
        match may_be_split.then(|| group.halves()).flatten() {
            Some(halves) => sparse.extend(halves),
            None => finished.push(group),
        }
    }
    finished.into_iter().map(|group| group.triangles.into_flattened()).collect()
}

fn bounds(points: impl Iterator<Item = Vec3>) -> [Vec3; 2] {
    points.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(at: f32) -> [[Vec3; 3]; 2] {
        let corner = |x, z| Vec3::new(at + x, 0.0, z);
        [[corner(0.0, 0.0), corner(0.2, 0.0), corner(0.2, 0.2)], [corner(0.0, 0.0), corner(0.2, 0.2), corner(0.0, 0.2)]]
    }

    #[test]
    fn mirrors_far_apart_are_groups_of_their_own() {
        let triangles: Vec<_> = (0..5).flat_map(|k| square(2.5 * k as f32)).collect();
        let groups = caster_groups(&triangles);
        let size = |group: &Vec<Vec3>| bounds(group.iter().copied()).into_iter().reduce(|low, high| high - low);
        assert!(groups.iter().all(|group| size(group).unwrap().max_element() < 0.21));
        assert_eq!(groups.iter().map(Vec::len).sum::<usize>(), 30);
    }

    #[test]
    fn others_are_one_group() {
        assert_eq!(caster_groups(&[square(0.0), square(0.4)].concat()).len(), 1);
        assert_eq!(caster_groups(&[[Vec3::ONE; 3]]).len(), 1);
        assert_eq!(caster_groups(&[]), vec![Vec::<Vec3>::new()]);
    }

    #[test]
    fn there_are_not_too_many() {
        let triangles: Vec<_> = (0..1000).flat_map(|k| square(50.0 * k as f32)).collect();
        assert!((16..=MOST_GROUPS).contains(&caster_groups(&triangles).len()));
    }
}
