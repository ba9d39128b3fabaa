//! Smooth patches: sets of triangles that meet without a crease.
//!
//! Two triangles belong to one patch if they share a vertex at the same position with the same normal. A disco ball
//! has a patch per tile, a cylinder one in all.

use std::hash::BuildHasher;

use hashbrown::HashTable;
use hashbrown::hash_table::Entry;
use rustc_hash::FxBuildHasher;

use super::{Surface, SurfacePoint};
use crate::DisjointSets;
use crate::parallel;
use crate::scene::Mesh;

/// Each triangle's patch, and the number of patches.
pub(super) fn smooth_patches(mesh: &Mesh) -> (Vec<u32>, usize) {
    let mut sets = DisjointSets::new(mesh.positions().len());
    for [vertex, other] in repeated_vertices(mesh) {
        sets.merge(vertex, other);
    }
    for [a, b, c] in mesh.triangles() {
        sets.merge(*a, *b);
        sets.merge(*a, *c);
    }
    let mut number = vec![u32::MAX; mesh.positions().len()];
    let mut count = 0;
    let patches = mesh.triangles().iter().map(|t| {
        let number = &mut number[sets.find(t[0]) as usize];
        if *number == u32::MAX {
            (*number, count) = (count, count + 1);
        }
        *number
    });
    let patches: Vec<u32> = patches.collect();
    (patches, count as usize)
}

/// Vertices that an earlier one equals in position and normal, and that one.
fn repeated_vertices(mesh: &Mesh) -> Vec<[u32; 2]> {
    let key = |v: u32| {
        let (position, normal) = (mesh.positions()[v as usize], mesh.normals()[v as usize]);
        // Normals of one vertex may differ in rounding when a file repeats them.
        (position.to_array().map(f32::to_bits), (normal * 1024.0).round().as_i16vec3().to_array())
    };
    let count = mesh.positions().len() as u32;
    let hashes: Vec<u64> = parallel::collect(count as usize, &|v| FxBuildHasher.hash_one(key(v as u32)));
    let mut first = HashTable::with_capacity(hashes.len());
    let mut repeated = Vec::new();
    for (v, &hash) in (0..count).zip(&hashes) {
        match first.entry(hash, |&other| key(other) == key(v), |&other| hashes[other as usize]) {
            Entry::Occupied(other) => repeated.push([v, *other.get()]),
            Entry::Vacant(place) => drop(place.insert(v)),
        }
    }
    repeated
}

/// Puts the patches of an object that are too small for a sample of their own into one group.
pub(super) fn group_small(surface: &Surface, area_per_sample: f32, points: &mut [SurfacePoint]) {
    for point in points {
        point.group = if surface.patch_area(point.patch) >= area_per_sample {
            point.patch
        } else {
            surface.patch_count() + point.object
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shapes::{Cup, DiscoBall, Ring, Shape};

    #[test]
    fn a_disco_ball_has_a_patch_per_tile_and_a_cylinder_one() {
        let ball = Shape::DiscoBall(DiscoBall { radius: 1.0, rows: 4, joint: 0.0 }).mesh().unwrap();
        let (patches, count) = smooth_patches(&ball);
        // Triangular tiles at the poles, two triangles each elsewhere.
        assert!(count > 4 && patches.len() <= 2 * count);
        assert_eq!(smooth_patches(&Shape::Ring(Ring::default()).mesh().unwrap()).1, 1);
        // Foot and wall meet smoothly: the cup is one piece.
        assert_eq!(smooth_patches(&Shape::Cup(Cup::default()).mesh().unwrap()).1, 1);
    }
}
