//! Traces packets of sixteen rays through the hierarchy. A node is visited if any of the rays meets its box, so coherent packets are
//! the fastest. Knows triangles and boxes, in the tracer's units, but neither objects nor scenes.

use std::ops::Range;

use glam::Vec3;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

use super::SLACK;
use crate::lanes::{F, LANES, Mask, Select, Simd, SimdBase, SimdMask, V3, bits, lanes, set_bits, splat, splat3};

/// Sixteen rays, component by component.
#[derive(Clone, Copy, Debug)]
pub struct RayPacket {
    /// Where rays start, metres.
    pub origins: [[f32; LANES]; 3],
    /// Directions.
    pub directions: [[f32; LANES]; 3],
    /// Distances at which rays end, in lengths of their directions.
    pub ends: [f32; LANES],
    /// The lanes that hold rays, as bits.
    pub lanes: u32,
}

/// The nearest hits of a packet.
pub struct PacketHits {
    /// The lanes that hit anything, as bits.
    pub lanes: u32,
    pub distances: [f32; LANES],
    pub triangles: [u32; LANES],
    /// Barycentric weights of the second and the third corner.
    pub weights: [[f32; LANES]; 2],
}

/// Rays that are being traced.
struct Rays<S: Simd> {
    origin: V3<S>,
    direction: V3<S>,
    /// 1 over each component of the direction; finite.
    inverse: V3<S>,
    /// They start this far from their origins.
    start: F<S>,
}

/// What all sixteen rays have to do with a triangle.
struct TriangleHit<S: Simd> {
    distance: F<S>,
    weights: [F<S>; 2],
    lanes: u32,
}

/// Tells which hits do not count.
pub trait HitFilter {
    /// The lanes, of those that hit a triangle at these distances, whose hits do not count.
    fn ignored<S: Simd>(&self, simd: S, triangle: usize, direction: V3<S>, distance: F<S>, hit: u32) -> u32;
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    fn new(simd: S, packet: &RayPacket, start: f32) -> Self {
        let direction = V3::load(simd, &packet.directions);
        let V3([x, y, z]) = direction;
        let inverse = V3([finite_inverse(simd, x), finite_inverse(simd, y), finite_inverse(simd, z)]);
        Self { origin: V3::load(simd, &packet.origins), direction, inverse, start: splat(simd, start) }
    }

    /// The lanes that meet a box before their ends, and where.
    #[inline(always)]
    fn meet(&self, simd: S, node: &Bvh2Node, end: F<S>) -> (u32, F<S>) {
        let (low, high) = (Vec3::from(node.aabb().min), Vec3::from(node.aabb().max));
        let [ox, oy, oz] = self.origin.0;
        let [ix, iy, iz] = self.inverse.0;
        let x = slab(simd, (low.x, high.x), ox, ix);
        let y = slab(simd, (low.y, high.y), oy, iy);
        let z = slab(simd, (low.z, high.z), oz, iz);
        let near = x.0.max(y.0).max(z.0.max(self.start));
        let far = x.1.min(y.1).min(z.1.min(end));
        // More than what is lost by rounding.
        (bits(near.simd_le(far * 1.000_001)), near)
    }

    /// Where the first of some lanes meets a node's box, if any does.
    #[inline(always)]
    fn nearest(&self, simd: S, bvh: &Bvh2, (node, lanes): (u32, u32), end: F<S>) -> Option<f32> {
        let (met, near) = self.meet(simd, &bvh.nodes[node as usize], end);
        let met = met & lanes;
        if met == 0 {
            return None;
        }
        let met = Mask::from_bitmask(simd, u64::from(met));
        Some(met.select(near, splat(simd, f32::INFINITY)).reduce_min())
    }

    /// Möller–Trumbore, as in [`super::intersect`].
    #[inline(always)]
    fn hit(&self, simd: S, [a, b, c]: &[Vec3; 3], end: F<S>) -> TriangleHit<S> {
        let (ab, ac) = (splat3(simd, *b - *a), splat3(simd, *c - *a));
        let p = self.direction.cross(ac);
        let inverse = 1.0 / ab.dot(p);
        let s = self.origin - splat3(simd, *a);
        let u = s.dot(p) * inverse;
        let q = s.cross(ab);
        let v = self.direction.dot(q) * inverse;
        let distance = ac.dot(q) * inverse;
        // Conditions are combined as bits of one integer: masks of vectors are compiled to calls.
        let is_inside = bits(u.simd_ge(-SLACK)) & bits(v.simd_ge(-SLACK)) & bits((u + v).simd_le(1.0 + SLACK));
        let lanes = is_inside & bits(distance.simd_gt(self.start)) & bits(distance.simd_lt(end));
        TriangleHit { distance, weights: [u, v], lanes }
    }
}

/// 1/x, clamped to a finite value, so that 0 · ∞ cannot occur in the test of a box.
#[inline(always)]
fn finite_inverse<S: Simd>(simd: S, x: F<S>) -> F<S> {
    1.0 / x.abs().simd_lt(1e-12).select(splat(simd, 1e-12), x)
}

/// Where rays enter and leave what lies between two planes.
#[inline(always)]
fn slab<S: Simd>(simd: S, (low, high): (f32, f32), origin: F<S>, inverse: F<S>) -> (F<S>, F<S>) {
    let (a, b) = ((splat(simd, low) - origin) * inverse, (splat(simd, high) - origin) * inverse);
    (a.min(b), a.max(b))
}

/// The triangles of a leaf.
fn triangles(leaf: &Bvh2Node) -> Range<usize> {
    leaf.first_index as usize..(leaf.first_index + leaf.prim_count) as usize
}

/// The lanes that hit any triangle, as far as the filter lets hits count.
#[inline(always)]
pub fn any_hit<S: Simd>(
    simd: S,
    (bvh, corners): (&Bvh2, &[[Vec3; 3]]),
    packet: &RayPacket,
    start: f32,
    filter: &impl HitFilter,
) -> u32 {
    let rays = Rays::new(simd, packet, start);
    let end = lanes(simd, packet.ends);
    let (mut open, mut stack) = (packet.lanes, Vec::with_capacity(bvh.max_depth));
    stack.push(0);
    while let Some(index) = stack.pop() {
        let node = &bvh.nodes[index as usize];
        if rays.meet(simd, node, end).0 & open == 0 {
            continue;
        }
        if !node.is_leaf() {
            stack.extend([node.first_index, node.first_index + 1]);
            continue;
        }
        for triangle in triangles(node) {
            let hit = rays.hit(simd, &corners[triangle], end);
            let lanes = hit.lanes & open;
            if lanes != 0 {
                open &= !(lanes & !filter.ignored(simd, triangle, rays.direction, hit.distance, lanes));
            }
        }
        if open == 0 {
            break;
        }
    }
    packet.lanes & !open
}

/// The nearest hits that count.
#[inline(always)]
pub fn nearest_hits<S: Simd>(
    simd: S,
    (bvh, corners): (&Bvh2, &[[Vec3; 3]]),
    packet: &RayPacket,
    start: f32,
    filter: &impl HitFilter,
) -> PacketHits {
    let rays = Rays::new(simd, packet, start);
    let mut end = lanes(simd, packet.ends);
    let mut hits = PacketHits { lanes: 0, distances: packet.ends, triangles: [0; LANES], weights: [[0.0; LANES]; 2] };
    let mut stack = Vec::with_capacity(bvh.max_depth);
    stack.push(0);
    while let Some(index) = stack.pop() {
        let node = &bvh.nodes[index as usize];
        if node.is_leaf() {
            for triangle in triangles(node) {
                let hit = rays.hit(simd, &corners[triangle], end);
                let lanes = hit.lanes & packet.lanes;
                if lanes == 0 {
                    continue;
                }
                let lanes = lanes & !filter.ignored(simd, triangle, rays.direction, hit.distance, lanes);
                end = Mask::from_bitmask(simd, u64::from(lanes)).select(hit.distance, end);
                hits.keep(&hit, lanes, triangle);
            }
            continue;
        }
        let (a, b) = (node.first_index, node.first_index + 1);
        let (first, second) =
            (rays.nearest(simd, bvh, (a, packet.lanes), end), rays.nearest(simd, bvh, (b, packet.lanes), end));
        match (first, second) {
            // What is on top comes first.
            (Some(near), Some(far)) => stack.extend(if near <= far { [b, a] } else { [a, b] }),
            (Some(_), None) => stack.push(a),
            (None, Some(_)) => stack.push(b),
            (None, None) => {}
        }
    }
    hits
}

impl PacketHits {
    #[inline(always)]
    fn keep<S: Simd>(&mut self, hit: &TriangleHit<S>, lanes: u32, triangle: usize) {
        self.lanes |= lanes;
        let [u, v] = hit.weights;
        let (distances, u, v) = (hit.distance.to_array(), u.to_array(), v.to_array());
        for lane in set_bits(lanes) {
            self.distances[lane] = distances[lane];
            self.triangles[lane] = triangle as u32;
            (self.weights[0][lane], self.weights[1][lane]) = (u[lane], v[lane]);
        }
    }
}
