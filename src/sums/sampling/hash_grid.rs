//! Points by the cells of a 3-D grid, in a table of as many buckets as pay: what lies within a distance of a place that does not
//! much exceed a cell's edge is found several times as fast as in a tree.

use glam::{IVec3, Vec3};

use super::SurfacePoint;
use crate::parallel;

/// Which side of a surface a point lies on.
#[derive(Clone, Copy, Default)]
struct Side {
    normal: Vec3,
    group: u32,
}

/// The table. Different cells may share a bucket.
pub(super) struct HashGrid {
    /// The least coordinates of all points, metres: cells are counted from there.
    low: Vec3,
    per_metre: f32,
    /// Where each bucket starts in the slots; one more than there are buckets.
    starts: Vec<u32>,
    /// Of the slots. What is asked of all that are near lies close together.
    positions: Vec<Vec3>,
    sides: Vec<Side>,
    /// The slot of each point.
    slot_of: Vec<u32>,
}

/// Points that one thread takes in a row.
const RUN: usize = 4096;

/// Points in a bucket, if all are filled evenly.
const PER_BUCKET: usize = 4;

impl HashGrid {
    /// Sorts points into cells with this edge, metres.
    pub fn new(points: &[SurfacePoint], edge: f32) -> Self {
        let low = points.iter().fold(Vec3::INFINITY, |low, p| low.min(p.position));
        let per_metre = edge.recip();
        let buckets = (points.len() / PER_BUCKET).next_power_of_two();
        let bucket_of = |p: &SurfacePoint| bucket(cell(p.position - low, per_metre), buckets);
        let mut of_points = vec![0u32; points.len()];
        parallel::for_each_chunk(&mut of_points, RUN, &|run, buckets| {
            buckets.iter_mut().zip(&points[run * RUN..]).for_each(|(bucket, point)| *bucket = bucket_of(point));
        });
        let mut starts = vec![0u32; buckets + 1];
        for &b in &of_points {
            starts[b as usize + 1] += 1;
        }
        for b in 0..buckets {
            starts[b + 1] += starts[b];
        }
        let mut next = starts.clone();
        let mut positions = vec![Vec3::ZERO; points.len()];
        let mut sides = vec![Side::default(); points.len()];
        let mut slot_of = of_points;
        for (point, slot) in points.iter().zip(&mut slot_of) {
            let free = &mut next[*slot as usize];
            positions[*free as usize] = point.position;
            sides[*free as usize] = Side { normal: point.normal, group: point.group };
            *slot = *free;
            *free += 1;
        }
        Self { low, per_metre, starts, positions, sides, slot_of }
    }

    /// Whether few cells lie within a radius, and few points beyond it in those.
    pub fn suits(&self, radius: f32) -> bool {
        (0.25..2.0).contains(&(radius * self.per_metre))
    }

    /// The slot of a point: those that are near each other have slots that are.
    pub fn slot_of(&self, point: usize) -> usize {
        self.slot_of[point] as usize
    }

    /// See [`SurfacePoint::same_side`].
    pub fn is_on_same_side(&self, slot: usize, point: &SurfacePoint) -> bool {
        let Side { normal, group } = self.sides[slot];
        group == point.group && normal.dot(point.normal) > 0.0
    }

    /// Calls `visit` with the slot of every point within `radius` of `centre`, and its squared distance, in no particular
    /// order; with some more than once.
    pub fn within(&self, centre: Vec3, radius: f32, mut visit: impl FnMut(usize, f32)) {
        let place = centre - self.low;
        let (low, high) = (cell(place - radius, self.per_metre), cell(place + radius, self.per_metre));
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let b = bucket(IVec3::new(x, y, z), self.starts.len() - 1) as usize;
                    let slots = self.starts[b] as usize..self.starts[b + 1] as usize;
                    for (position, slot) in self.positions[slots.clone()].iter().zip(slots) {
                        let d2 = position.distance_squared(centre);
                        if d2 <= radius * radius {
                            visit(slot, d2);
                        }
                    }
                }
            }
        }
    }
}

fn cell(place: Vec3, per_metre: f32) -> IVec3 {
    (place * per_metre).floor().as_ivec3()
}

/// The bucket of a cell; their number is a power of two (Teschner et al. 2003, Section 3.1).
fn bucket(cell: IVec3, buckets: usize) -> u32 {
    let [x, y, z] = cell.to_array().map(|c| c as u32);
    let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
    // The low bits alone would not mix the coordinates' high ones.
    (hash ^ hash >> 15) & (buckets as u32 - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Options, Strategy, Surface, sample};
    use crate::scene::shapes::{Cup, Shape};

    #[test]
    fn it_finds_what_is_near() {
        let mut surface = Surface::default();
        surface.append(&Shape::Cup(Cup::default()).mesh().unwrap(), 0, false);
        let set = sample(&surface, &Options { samples: 100, strategy: Strategy::Random, seed: 1 }).unwrap();
        let grid = HashGrid::new(&set.candidates, 0.02);
        for centre in set.points.iter().map(|p| p.position) {
            for radius in [0.0, 0.004, 0.02, 0.05] {
                let mut found = vec![false; set.candidates.len()];
                grid.within(centre, radius, |slot, d2| {
                    assert!((d2.sqrt() - grid.positions[slot].distance(centre)).abs() < 1e-6);
                    found[slot] = true;
                });
                for (k, candidate) in set.candidates.iter().enumerate() {
                    let is_near = candidate.position.distance_squared(centre) <= radius * radius;
                    assert_eq!(found[grid.slot_of(k)], is_near);
                }
            }
        }
    }
}
