//! The hierarchy in depth-first order, where each node knows the one after those below it: traversals need no stack. Read by
//! `shaders/shared/rays.wgsl`.

use glam::Vec3;
use obvhs::bvh2::Bvh2;

use super::Tracer;

/// Nodes of two texels each, then triangles of four.
#[derive(Clone, Debug)]
pub(crate) struct SkipList {
    /// A node: the low corner of its box, and the number of the node after those below it; the high corner, and of a leaf eight bits for
    /// the number of its triangles below the index of the first. A triangle: three corners; the sum of its corners' normals, and the
    /// number of its object. Numbers of 32 bits, as integers or as floats. Positions are in units.
    pub texels: Vec<[u32; 4]>,
    /// The number of nodes.
    pub node_count: u32,
    /// Units per metre.
    pub scale: f32,
    /// Rays start this far off a surface, units.
    pub offset: f32,
}

/// The largest number of triangles: their indices have 24 bits.
const MAX_TRIANGLES: usize = 1 << 24;

impl Tracer {
    /// The scene's triangles and their hierarchy; `None` if there are more than 16,777,216 of them.
    pub(crate) fn skip_list(&self) -> Option<SkipList> {
        if self.corners.len() > MAX_TRIANGLES {
            return None;
        }
        let order = if self.corners.is_empty() { Vec::new() } else { depth_first(&self.bvh) };
        let sizes = sizes(&self.bvh, &order);
        let mut texels = Vec::with_capacity(2 * order.len() + 4 * self.corners.len());
        for (number, (&index, size)) in order.iter().zip(sizes).enumerate() {
            let node = &self.bvh.nodes[index];
            let triangles = if node.is_leaf() { node.first_index << 8 | node.prim_count } else { 0 };
            texels.push(texel(node.aabb().min.into(), number as u32 + size));
            texels.push(texel(node.aabb().max.into(), triangles));
        }
        for (corners, surface) in self.corners.iter().zip(&self.surfaces) {
            texels.extend(corners.map(|corner| texel(corner, 0)));
            texels.push(texel(surface.normals.iter().sum(), surface.object));
        }
        Some(SkipList { texels, node_count: order.len() as u32, scale: self.scale, offset: self.offset })
    }
}

fn texel(vector: Vec3, number: u32) -> [u32; 4] {
    let [x, y, z] = vector.to_array().map(f32::to_bits);
    [x, y, z, number]
}

/// The nodes, each before those below it.
fn depth_first(bvh: &Bvh2) -> Vec<usize> {
    let (mut order, mut stack) = (Vec::with_capacity(bvh.nodes.len()), vec![0]);
    while let Some(index) = stack.pop() {
        order.push(index);
        let node = &bvh.nodes[index];
        if !node.is_leaf() {
            let first = node.first_index as usize;
            stack.extend([first + 1, first]);
        }
    }
    order
}

/// For each node in that order: how many there are of it and those below it.
fn sizes(bvh: &Bvh2, order: &[usize]) -> Vec<u32> {
    let mut of_nodes = vec![0; bvh.nodes.len()];
    for &index in order.iter().rev() {
        let node = &bvh.nodes[index];
        let first = node.first_index as usize;
        of_nodes[index] = 1 + if node.is_leaf() { 0 } else { of_nodes[first] + of_nodes[first + 1] };
    }
    order.iter().map(|&index| of_nodes[index]).collect()
}

#[cfg(test)]
mod tests {
    use super::super::SeenBy;
    use super::*;
    use crate::scene::shapes::{Shape, Sphere};

    /// Every triangle belongs to one leaf, boxes hold what is below them, and skipping from the first node on ends behind the last.
    #[test]
    fn nodes_hold_those_below_them() {
        let mesh = Shape::Sphere(Sphere { radius: 1.0 }).mesh().unwrap();
        let tracer = Tracer::of_meshes([(&mesh, SeenBy::ALL)].into_iter());
        let list = tracer.skip_list().unwrap();
        let count = list.node_count as usize;
        let vector =
            |texel: [u32; 4]| Vec3::from_slice(&texel[..3].iter().map(|&x| f32::from_bits(x)).collect::<Vec<_>>());
        let bounds = |node: usize| (vector(list.texels[2 * node]), vector(list.texels[2 * node + 1]));
        let mut seen = vec![0; tracer.corners.len()];
        for node in 0..count {
            let (low, high) = bounds(node);
            let after = list.texels[2 * node][3] as usize;
            assert!(after > node && after <= count);
            for below in node + 1..after {
                let (inner_low, inner_high) = bounds(below);
                assert!(low.cmple(inner_low).all() && inner_high.cmple(high).all());
            }
            let triangles = list.texels[2 * node + 1][3];
            let first = (triangles >> 8) as usize;
            let own = first..first + (triangles & 255) as usize;
            for (triangle, times) in own.clone().zip(&mut seen[own]) {
                *times += 1;
                let corner = vector(list.texels[2 * count + 4 * triangle]);
                assert!(low.cmple(corner).all() && corner.cmple(high).all());
            }
        }
        assert!(seen.iter().all(|&times| times == 1));
        assert_eq!(list.texels[0][3] as usize, count);
    }

    #[test]
    fn nothing_has_no_nodes() {
        let list = Tracer::of_meshes(std::iter::empty()).skip_list().unwrap();
        assert!(list.node_count == 0 && list.texels.is_empty());
    }
}
