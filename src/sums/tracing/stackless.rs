//! Bounding volume hierarchies as GPUs traverse them: in depth-first order, where each node knows the one after those below it, so that
//! traversals need no stack. There are two levels: the bottom level of each mesh, over its triangles in the mesh's own space, and the top
//! level over the objects in the world, which can move while their meshes stay. Read by `shaders/shared/rays.wgsl`.

use glam::{Mat3, Vec3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};

use super::construction::offset;
use super::{SeenBy, Tracer};
use crate::scene::{Mesh, Transform};

/// Texels of a triangle.
const TRIANGLE_TEXELS: usize = 4;

/// The hierarchy over a mesh's triangles.
#[derive(Debug)]
pub struct BottomLevel {
    /// Knows no other mesh. Its units are those of the texels, far from the limits of floats.
    tracer: Tracer,
    /// Number of nodes.
    pub node_count: u32,
    /// Low and high corner, units.
    bounds: [Vec3; 2],
}

/// An object: a mesh in the world.
#[derive(Clone, Copy, Debug)]
pub struct Instance<'a> {
    /// The hierarchy over its triangles.
    pub mesh: &'a BottomLevel,
    /// Where the mesh's texels begin.
    pub first_texel: u32,
    /// From its own space to the world.
    pub placement: Transform,
    /// The rays that meet it.
    pub seen_by: SeenBy,
}

/// The hierarchy over all objects: nodes of two texels each like those of meshes, but in metres and with objects in their leaves; then objects of four.
#[derive(Clone, Debug)]
pub struct TopLevel {
    /// An object: three rows of the matrix from metres to its mesh's units; then the mesh's first texel, the number of its nodes, the
    /// object's number above the bits of [`SeenBy`], and units per metre.
    pub texels: Vec<[u32; 4]>,
    /// Number of nodes.
    pub node_count: u32,
    /// The number of each, in the order of the texels.
    pub order: Vec<u32>,
    /// Rays start this far off a surface, metres.
    pub offset: f32,
}

/// The largest number of triangles of a mesh: their indices have 24 bits.
const MAX_TRIANGLES: usize = 1 << 24;

impl BottomLevel {
    /// `None` if there are more than 16,777,216 triangles.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        let tracer = || Tracer::of_meshes(std::iter::once((mesh, SeenBy::ALL)));
        (mesh.triangles().len() <= MAX_TRIANGLES).then(|| Self::of_tracer(tracer()))
    }

    /// The same for a mesh that is there for one frame: refitted from that of another mesh, if it is one of the same triangles in
    /// another shape, or, unless it is there in the first frame, built faster, and slower to trace.
    pub fn for_frame(mesh: &Mesh, before: Option<&Self>, is_first: bool) -> Option<Self> {
        let before = before.map(|before| &before.tracer);
        let tracer = || Tracer::for_frame(before, is_first, std::iter::once((mesh, SeenBy::ALL)));
        (mesh.triangles().len() <= MAX_TRIANGLES).then(|| Self::of_tracer(tracer()))
    }

    fn of_tracer(tracer: Tracer) -> Self {
        let node_count = if tracer.corners.is_empty() { 0 } else { tracer.bvh.nodes.len() as u32 };
        let bounds = bounds(tracer.corners.as_flattened());
        Self { tracer, node_count, bounds }
    }

    /// Nodes of two texels each, then triangles of four. A node: the low corner of its box, and the number of the node after those below
    /// it; the high corner, and of a leaf eight bits for the number of its triangles below the index of the first. A triangle: its corners,
    /// each with its normal, see `packed_normal`; the sum of the normals. Numbers of 32 bits, as integers or as floats.
    pub fn texels(&self) -> Vec<[u32; 4]> {
        let mut texels = Vec::with_capacity(self.texel_count());
        if self.node_count > 0 {
            add_nodes(&self.tracer.bvh, &mut texels);
        }
        for (corners, surface) in self.tracer.corners.iter().zip(&self.tracer.surfaces) {
            texels.extend([0, 1, 2].map(|k| texel(corners[k], packed_normal(surface.normals[k]))));
            texels.push(texel(surface.normals.iter().sum(), 0));
        }
        texels
    }

    /// The triangles in the order of their texels, units.
    pub fn corners(&self) -> &[[Vec3; 3]] {
        if self.node_count > 0 { &self.tracer.corners } else { &[] }
    }

    /// Number of texels that the nodes take.
    pub fn texel_count(&self) -> usize {
        2 * self.node_count as usize + TRIANGLE_TEXELS * self.tracer.corners.len()
    }
}

impl Instance<'_> {
    /// Rows of the matrix from metres to the mesh's units, and units per metre.
    fn units_from_world(&self) -> ([(Vec3, f32); 3], f32) {
        let Transform { scale, translate, .. } = self.placement;
        let units_per_metre = self.mesh.tracer.scale / scale.abs();
        let linear =
            self.placement.rotation().transpose() * Mat3::from_diagonal(Vec3::splat(self.mesh.tracer.scale / scale));
        let moved = -(linear * translate);
        let rows = linear.transpose();
        ([(rows.x_axis, moved.x), (rows.y_axis, moved.y), (rows.z_axis, moved.z)], units_per_metre)
    }

    /// Rows of the matrix from the mesh's units to metres, each with its part of the translation.
    pub fn world_from_units(&self) -> [f32; 12] {
        let Transform { scale, translate, .. } = self.placement;
        let rows = (self.placement.rotation() * (scale / self.mesh.tracer.scale)).transpose();
        let [x, y, z] = [rows.x_axis, rows.y_axis, rows.z_axis];
        [x.x, x.y, x.z, translate.x, y.x, y.y, y.z, translate.y, z.x, z.y, z.z, translate.z]
    }

    /// Low and high corner in the world, metres.
    fn bounds(&self) -> [Vec3; 2] {
        let [low, high] = self.mesh.bounds.map(|corner| corner / self.mesh.tracer.scale);
        let corner = |k: usize| Vec3::select(glam::BVec3::new(k & 1 != 0, k & 2 != 0, k & 4 != 0), high, low);
        let corners: [Vec3; 8] = std::array::from_fn(|k| self.placement.point_in_world(corner(k)));
        bounds(&corners)
    }

    fn texels(&self, object: u32) -> [[u32; 4]; 4] {
        let (rows, units_per_metre) = self.units_from_world();
        let [a, b, c] = rows.map(|(row, moved)| texel(row, moved.to_bits()));
        [
            a,
            b,
            c,
            [
                self.first_texel,
                self.mesh.node_count,
                object << SeenBy::BITS | self.seen_by.bits(),
                units_per_metre.to_bits(),
            ],
        ]
    }
}

impl TopLevel {
    /// The scene's objects in the order of their numbers.
    pub fn new(objects: &[Instance]) -> Self {
        let present: Vec<(u32, &Instance)> =
            (0..).zip(objects).filter(|(_, object)| object.mesh.node_count > 0).collect();
        let boxes: Vec<[Vec3; 2]> = present.iter().map(|(_, object)| object.bounds()).collect();
        // Boxes are larger than meshes by what is lost by rounding: rays must not slip between them.
        let padded = |[low, high]: &[Vec3; 2]| {
            let padding = 16.0 * f32::EPSILON * low.abs().max(high.abs()).max_element();
            Aabb { min: (*low - padding).into(), max: (*high + padding).into() }
        };
        let padded: Vec<Aabb> = boxes.iter().map(padded).collect();
        let mut texels = Vec::new();
        if present.is_empty() {
            return Self { texels, node_count: 0, order: Vec::new(), offset: 0.0 };
        }
        let bvh = build_bvh2(&padded, BvhBuildParams::fast_build(), &mut Default::default());
        let node_count = add_nodes(&bvh, &mut texels);
        let order = bvh.primitive_indices.iter().map(|&index| present[index as usize].0).collect();
        for &index in &bvh.primitive_indices {
            let (object, instance) = present[index as usize];
            texels.extend(instance.texels(object));
        }
        // Rays leave what light meets; emitters may be far away.
        let is_solid = |((_, object), _): &(&(u32, &Instance), &[Vec3; 2])| object.seen_by.light;
        let solid: Vec<[Vec3; 2]> = present.iter().zip(&boxes).filter(is_solid).map(|(_, corners)| *corners).collect();
        let [low, high] = bounds(if solid.is_empty() { &boxes } else { &solid }.as_flattened());
        Self { texels, node_count, order, offset: offset(low, high) }
    }
}

fn bounds(points: &[Vec3]) -> [Vec3; 2] {
    points.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(*p), high.max(*p)])
}

fn texel(vector: Vec3, number: u32) -> [u32; 4] {
    let [x, y, z] = vector.to_array().map(f32::to_bits);
    [x, y, z, number]
}

/// A unit vector as a place on an octahedron, sixteen bits a coordinate (Cigolle et al. 2014, *A Survey of Efficient Representations for
/// Independent Unit Vectors*); read by `unpacked_unit` in `unit_vectors.wgsl`.
pub(crate) fn packed_normal(normal: Vec3) -> u32 {
    let n = normal / normal.abs().element_sum().max(f32::MIN_POSITIVE);
    let sign = |x: f32| if x < 0.0 { -1.0 } else { 1.0 };
    let (x, y) = if n.z < 0.0 { ((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y)) } else { (n.x, n.y) };
    let [x, y] = [x, y].map(|c| u32::from((c.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16));
    y << 16 | x
}

/// The unit vector that `packed_normal` has packed.
pub fn unpacked_normal(packed: u32) -> Vec3 {
    let [x, y] = [packed as u16, (packed >> 16) as u16].map(|c| f32::from(c as i16) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

/// Adds the nodes of a hierarchy. Returns their number.
fn add_nodes(bvh: &Bvh2, texels: &mut Vec<[u32; 4]>) -> u32 {
    let order = depth_first(bvh);
    for (number, (&index, size)) in order.iter().zip(sizes(bvh, &order)).enumerate() {
        let node = &bvh.nodes[index];
        let below = if node.is_leaf() { node.first_index << 8 | node.prim_count } else { 0 };
        texels.push(texel(node.aabb().min.into(), number as u32 + size));
        texels.push(texel(node.aabb().max.into(), below));
    }
    order.len() as u32
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
    use super::*;
    use crate::scene::shapes::{Shape, Sphere};

    fn sphere() -> BottomLevel {
        BottomLevel::new(&Shape::Sphere(Sphere::of_radius(1.0)).mesh().unwrap()).unwrap()
    }

    fn vector(texel: [u32; 4]) -> Vec3 {
        Vec3::from_slice(&texel[..3].iter().map(|&x| f32::from_bits(x)).collect::<Vec<_>>())
    }

    /// Every triangle belongs to one leaf, boxes hold what is below them, and skipping from the first node on ends behind the last.
    #[test]
    fn nodes_hold_those_below_them() {
        let list = sphere();
        let (count, texels) = (list.node_count as usize, list.texels());
        assert_eq!(texels.len(), list.texel_count());
        let triangles = (texels.len() - 2 * count) / TRIANGLE_TEXELS;
        let bounds = |node: usize| (vector(texels[2 * node]), vector(texels[2 * node + 1]));
        let mut seen = vec![0; triangles];
        for node in 0..count {
            let (low, high) = bounds(node);
            let after = texels[2 * node][3] as usize;
            assert!(after > node && after <= count);
            for below in node + 1..after {
                let (inner_low, inner_high) = bounds(below);
                assert!(low.cmple(inner_low).all() && inner_high.cmple(high).all());
            }
            let below = texels[2 * node + 1][3];
            let first = (below >> 8) as usize;
            let own = first..first + (below & 255) as usize;
            for (triangle, times) in own.clone().zip(&mut seen[own]) {
                *times += 1;
                let corner = vector(texels[2 * count + TRIANGLE_TEXELS * triangle]);
                assert!(low.cmple(corner).all() && corner.cmple(high).all());
            }
        }
        assert!(seen.iter().all(|&times| times == 1));
        assert_eq!(texels[0][3] as usize, count);
    }

    /// The matrix of an object takes the corners of its mesh from the world to where its texels say, in the box of the object's leaf.
    #[test]
    fn objects_lie_in_their_boxes() {
        let list = sphere();
        let rotate_rad = Vec3::new(0.4, -1.1, 2.0);
        let placements = [
            Transform { scale: 2.0, rotate_rad, translate: Vec3::new(3.0, 0.0, -1.0) },
            Transform { scale: -0.5, rotate_rad, translate: Vec3::new(-2.0, 5.0, 0.0) },
            Transform::default(),
        ];
        let objects =
            placements.map(|placement| Instance { mesh: &list, first_texel: 7, placement, seen_by: SeenBy::ALL });
        let top = TopLevel::new(&objects);
        let first_object = 2 * top.node_count as usize;
        for (instance, texels) in top.texels[first_object..].chunks_exact(4).enumerate() {
            assert_eq!(
                (texels[3][0], texels[3][1], texels[3][2] & SeenBy::ALL.bits()),
                (7, list.node_count, SeenBy::ALL.bits())
            );
            let placement = placements[(texels[3][2] >> SeenBy::BITS) as usize];
            let in_units = list.bounds[1];
            let in_world = placement.point_in_world(in_units / list.tracer.scale);
            let back = [0, 1, 2].map(|row| vector(texels[row]).dot(in_world) + f32::from_bits(texels[row][3]));
            assert!(Vec3::from_array(back).abs_diff_eq(in_units, 1e-3 * in_units.length()), "{back:?} {in_units}");
            let holds = |node: &[[u32; 4]]| {
                let (first, count) = ((node[1][3] >> 8) as usize, (node[1][3] & 255) as usize);
                (first..first + count).contains(&instance)
                    && vector(node[0]).cmple(in_world).all()
                    && in_world.cmple(vector(node[1])).all()
            };
            assert!(top.texels[..first_object].chunks_exact(2).any(holds));
        }
    }

    #[test]
    fn normals_are_packed_finely() {
        for k in 0..1000 {
            let (sin, cos) = (2.4 * k as f32).sin_cos();
            let z = 1.0 - 0.002 * k as f32;
            let radius = (1.0 - z * z).max(0.0).sqrt();
            let normal = Vec3::new(radius * cos, radius * sin, z);
            assert!(unpacked_normal(packed_normal(normal)).distance(normal) < 1e-4);
        }
    }

    #[test]
    fn nothing_has_no_nodes() {
        let list = BottomLevel::new(&Mesh::default()).unwrap();
        assert!(list.node_count == 0 && list.texels().is_empty());
        let object = Instance { mesh: &list, first_texel: 0, placement: Transform::default(), seen_by: SeenBy::ALL };
        let top = TopLevel::new(&[object]);
        assert!(top.node_count == 0 && top.texels.is_empty());
    }
}
