//! Points → tree.
//!
//! Each root's subtree has a fixed place of its own, so that roots are built side by side; what lies above them is built
//! last, from their moments.

use glam::Vec3;
use rayon::prelude::*;

use super::moments::Moments;
use super::point::CellPoint;
use super::split::{halves, in_order, is_mixed, largest_patch, longest_axes};
use super::tiling::Tiling;
use super::{CellNode, CellTree};
use crate::sampling::{PointSet, Surface, SurfacePoint};

/// How finely a tree divides its roots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreeOptions {
    /// Leaves that a root is split into at most; the power of four below counts.
    pub leaves: u32,
    /// The same seed gives the same bits.
    pub seed: u64,
}

/// The most leaves per root that can be asked for.
pub const MAX_LEAVES: u32 = 4096;
/// Children of a node.
pub(crate) const FAN: u32 = 4;

/// Points that a leaf is made of: fewer where the memory for them would be gigabytes.
fn points_per_leaf(leaves: f64) -> f64 {
    (1e7 / leaves).clamp(8.0, 24.0)
}

/// Where a level of a root's subtree starts; the root is level 0 and not in it.
fn level_start(level: u32) -> u32 {
    (FAN.pow(level) - FAN) / (FAN - 1)
}

/// Nodes of a root's subtree, the root apart.
fn nodes_below(leaves: u32) -> usize {
    level_start(leaves.ilog(FAN) + 1) as usize
}

/// A root and its moments, before it has a place.
struct Root {
    node: CellNode,
    /// A patch of the surface that it lies on, at least in part.
    patch: u32,
    moments: Moments,
}

impl CellTree {
    /// Splits the cells of a strategy's samples. Samples whose cells are empty stand for nothing and are left out.
    pub fn new(surface: &Surface, set: &PointSet, options: &TreeOptions) -> Self {
        let leaves = FAN.pow(options.leaves.clamp(1, MAX_LEAVES).ilog(FAN));
        let count = set.points.len() as f64 * f64::from(leaves);
        let stride = (surface.area() / (count * points_per_leaf(count))) as f32;
        let reach = half_diagonal(&set.candidates);
        let tiling = Tiling::new(surface, set, stride, options.seed);
        let samples = tiling.samples();

        let objects = samples.iter().map(|sample| set.points[*sample as usize].object).collect();
        let below = nodes_below(leaves);
        let nodes = vec![CellNode::default(); samples.len() * below];
        let first_above = nodes.len() as u32;
        let mut tree = Self { nodes, objects, first_above, leaves_per_root: leaves, ..Self::default() };
        let mut subtrees: Vec<Subtree> = Vec::with_capacity(samples.len());
        let mut rest = tree.nodes.as_mut_slice();
        for root in 0..samples.len() {
            let (nodes, others) = rest.split_at_mut(below);
            subtrees.push(Subtree { nodes, start: (root * below) as u32, root: root as u32, reach });
            rest = others;
        }
        let build = |points: &mut Vec<CellPoint>, (sample, mut subtree): (&u32, Subtree)| {
            tiling.collect(*sample, points);
            let mixed = is_mixed(points);
            let (node, moments) = subtree.cell(points, mixed, leaves, 0, 0);
            Root { node, patch: points[0].patch, moments }
        };
        let roots: Vec<Root> = samples.par_iter().zip(subtrees).map_init(Vec::new, build).collect();
        tree.gather(&roots, reach);
        tree
    }

    /// Puts the roots, and cells that are several of them, above the subtrees.
    fn gather(&mut self, roots: &[Root], reach: f32) {
        self.roots = vec![0; roots.len()];
        let mut order: Vec<u32> = (0..roots.len() as u32).collect();
        let objects = self.objects.clone();
        order.sort_by_key(|&root| objects[root as usize]);
        for group in order.chunk_by_mut(|&a, &b| objects[a as usize] == objects[b as usize]) {
            let top = self.nodes.len() as u32;
            self.nodes.push(CellNode::default());
            self.tops.push(top);
            self.gather_group(roots, group, top, reach);
        }
    }

    /// Makes the node of a group of roots of one object, in its place.
    fn gather_group(&mut self, roots: &[Root], group: &mut [u32], place: u32, reach: f32) -> Moments {
        if let [root] = *group {
            self.nodes[place as usize] = roots[root as usize].node;
            self.roots[root as usize] = place;
            return roots[root as usize].moments;
        }
        let (a, b) = halves_of_roots(roots, group, reach);
        let ((a1, a2), (b1, b2)) = (halves_of_roots(roots, a, reach), halves_of_roots(roots, b, reach));
        let quarters = [a1, a2, b1, b2];
        let (first, count) = (self.nodes.len() as u32, quarters.iter().filter(|q| !q.is_empty()).count() as u32);
        self.nodes.resize((first + count) as usize, CellNode::default());
        let quarters = quarters.into_iter().filter(|q| !q.is_empty());
        let moments = quarters.zip(first..).map(|(quarter, child)| self.gather_group(roots, quarter, child, reach));
        let moments = moments.reduce(Moments::join).expect("a group has roots");

        let fit = moments.fit();
        let (mut radius, mut normal_radius, mut creased) = (0.0f32, 0.0f32, false);
        for &root in &*group {
            creased |= roots[root as usize].node.is_creased();
            creased |= roots[root as usize].patch != roots[group[0] as usize].patch;
            let of_root = roots[root as usize].node.geometry();
            radius = radius.max(of_root.centroid.distance(fit.centroid) + of_root.radius);
            normal_radius = normal_radius.max(of_root.normal.distance(fit.normal) + of_root.normal_radius);
        }
        let mut node = CellNode::new(&fit, radius, normal_radius, group[0], creased);
        node.set_children(first, count);
        self.nodes[place as usize] = node;
        moments
    }
}

/// Half the diagonal of the points' bounds: receivers are taken to be about so far away.
fn half_diagonal(points: &[SurfacePoint]) -> f32 {
    let low = points.iter().fold(Vec3::INFINITY, |low, p| low.min(p.position));
    let high = points.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(p.position));
    0.5 * low.distance(high).max(f32::MIN_POSITIVE)
}

/// Halves roots as cells are.
fn halves_of_roots<'a>(roots: &[Root], group: &'a mut [u32], reach: f32) -> (&'a mut [u32], &'a mut [u32]) {
    let at = |root: u32| {
        let node = roots[root as usize].node.geometry();
        let ([a, b, c], [x, y, z]) = (node.centroid.to_array(), node.normal.to_array());
        [a, b, c, x, y, z]
    };
    let middle = group.len() / 2;
    if middle > 0 {
        let axes = longest_axes(group.iter().map(|&root| at(root)), reach);
        group.select_nth_unstable_by(middle, |&a, &b| in_order(&at(a), &at(b), axes));
    }
    group.split_at_mut(middle)
}

/// The nodes below one root; the root apart.
struct Subtree<'a> {
    nodes: &'a mut [CellNode],
    /// Where they begin in the tree.
    start: u32,
    root: u32,
    /// See [`longest_axes`].
    reach: f32,
}

impl Subtree<'_> {
    /// Makes a cell, which is number `place` of its level, and all below it. Its own node is for the caller to put there.
    /// A cell of several patches is `mixed`.
    fn cell(
        &mut self,
        points: &mut [CellPoint],
        mixed: bool,
        leaves: u32,
        level: u32,
        place: u32,
    ) -> (CellNode, Moments) {
        let first = level_start(level + 1) + place * FAN;
        let mut count = 0;
        let mut joined: Option<Moments> = None;
        if leaves > 1 && points.len() > 1 {
            let (a, b) = halves(points, mixed, self.reach);
            let (a_mixed, b_mixed) = (mixed && is_mixed(a), mixed && is_mixed(b));
            let ((a1, a2), (b1, b2)) = (halves(a, a_mixed, self.reach), halves(b, b_mixed, self.reach));
            for quarter in [a1, a2, b1, b2].into_iter().filter(|q| !q.is_empty()) {
                let mixed = mixed && is_mixed(quarter);
                let (node, moments) = self.cell(quarter, mixed, leaves / FAN, level + 1, place * FAN + count);
                self.nodes[(first + count) as usize] = node;
                joined = Some(joined.map_or(moments, |m| m.join(moments)));
                count += 1;
            }
        }
        let moments = joined.unwrap_or_else(|| {
            let area = points.iter().map(|p| p.area).sum();
            // What lies across a crease lends its area.
            let points = if mixed { largest_patch(points) } else { &*points };
            Moments::of(points.iter()).with_area(area)
        });
        let fit = moments.fit();
        let (radius, normal_radius) = bounds(points, fit.centroid, fit.normal);
        let mut node = CellNode::new(&fit, radius, normal_radius, self.root, mixed);
        if count > 0 {
            node.set_children(self.start + first, count);
        }
        (node, moments)
    }
}

/// The greatest distances of points, and of their normals, from given ones.
fn bounds(points: &[CellPoint], centroid: Vec3, normal: Vec3) -> (f32, f32) {
    let (mut distance2, mut turn2, mut area) = (0.0f32, 0.0f32, 0.0f32);
    for p in points {
        distance2 = distance2.max(p.position().distance_squared(centroid));
        turn2 = turn2.max(p.normal().distance_squared(normal));
        area = area.max(p.area);
    }
    // A piece is at most as far across as a square's diagonal, or nearly.
    (distance2.sqrt() + (0.5 * area).sqrt(), turn2.sqrt())
}
