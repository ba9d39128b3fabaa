//! Points → tree.
//!
//! Each sample's subtree has a place of its own, so that subtrees are built in parallel; the nodes above them are built last,
//! from the samples' moments.

use glam::Vec3;

use super::moments::Moments;
use super::point::CellPoint;
use super::split::{halves, in_order, is_mixed, largest_patch, longest_axes};
use super::tiling::Tiling;
use super::{CellNode, CellTree};
use crate::parallel;
use crate::sampling::{PointSet, Surface, SurfacePoint};

/// How finely a tree divides its samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreeOptions {
    /// Leaves that a sample is split into at most; the power of four below counts.
    pub leaves: u32,
    /// The same seed gives the same bits.
    pub seed: u64,
}

/// The most leaves per sample that can be asked for.
pub const MAX_LEAVES: u32 = 4096;
/// Children of a node.
pub const FAN: u32 = 4;

/// Points that a leaf is made of: fewer where the memory for them would be gigabytes.
fn points_per_leaf(leaves: f64) -> f64 {
    (1e7 / leaves).clamp(8.0, 24.0)
}

/// Where a level of a sample's subtree starts; the sample's own node is level 0 and not in it.
fn level_start(level: u32) -> u32 {
    (FAN.pow(level) - FAN) / (FAN - 1)
}

/// Nodes of a sample's subtree, its own apart.
fn nodes_below(leaves: u32) -> usize {
    level_start(leaves.ilog(FAN) + 1) as usize
}

/// Samples whose subtrees a thread makes in a row.
const SUBTREES_PER_TASK: usize = 16;

/// A sample's own node and its moments, before it has a place.
struct SampleCell {
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
        let first_cluster = nodes.len() as u32;
        let mut tree = Self { nodes, objects, first_cluster, leaves_per_sample: leaves, reach, ..Self::default() };
        let mut subtrees: Vec<Subtree> = Vec::with_capacity(samples.len());
        let mut rest = tree.nodes.as_mut_slice();
        for sample in 0..samples.len() {
            let (nodes, others) = rest.split_at_mut(below);
            subtrees.push(Subtree { nodes, start: (sample * below) as u32, sample: sample as u32, reach });
            rest = others;
        }
        let build = |task: usize, subtrees: &mut [Subtree]| {
            let mut points = Vec::new();
            let mut build = |(sample, subtree): (&u32, &mut Subtree)| {
                tiling.collect(*sample, &mut points);
                let mixed = is_mixed(&points);
                let (node, moments) = subtree.cell(&mut points, mixed, leaves, 0, 0);
                SampleCell { node, patch: points[0].patch, moments }
            };
            samples[SUBTREES_PER_TASK * task..].iter().zip(subtrees).map(&mut build).collect::<Vec<_>>()
        };
        let cells = parallel::map_chunks_mut(&mut subtrees, SUBTREES_PER_TASK, &build);
        let cells: Vec<SampleCell> = cells.into_iter().flatten().collect();
        tree.add_upper_nodes(&cells, reach);
        tree
    }

    /// Adds the sample nodes, and the cluster nodes above them, behind the subtrees.
    fn add_upper_nodes(&mut self, cells: &[SampleCell], reach: f32) {
        self.sample_nodes = vec![0; cells.len()];
        let mut order: Vec<u32> = (0..cells.len() as u32).collect();
        let objects = self.objects.clone();
        order.sort_by_key(|&sample| objects[sample as usize]);
        for group in order.chunk_by_mut(|&a, &b| objects[a as usize] == objects[b as usize]) {
            let root = self.nodes.len() as u32;
            self.nodes.push(CellNode::default());
            self.roots.push(root);
            self.add_cluster(cells, group, root, reach);
        }
    }

    /// Makes the node of a group of samples of one object, in its place, and all between it and the samples' own.
    fn add_cluster(&mut self, cells: &[SampleCell], group: &mut [u32], place: u32, reach: f32) -> Moments {
        if let [sample] = *group {
            self.nodes[place as usize] = cells[sample as usize].node;
            self.sample_nodes[sample as usize] = place;
            return cells[sample as usize].moments;
        }
        let (a, b) = halves_of_samples(cells, group, reach);
        let ((a1, a2), (b1, b2)) = (halves_of_samples(cells, a, reach), halves_of_samples(cells, b, reach));
        let quarters = [a1, a2, b1, b2];
        let (first, count) = (self.nodes.len() as u32, quarters.iter().filter(|q| !q.is_empty()).count() as u32);
        self.nodes.resize((first + count) as usize, CellNode::default());
        let quarters = quarters.into_iter().filter(|q| !q.is_empty());
        let moments = quarters.zip(first..).map(|(quarter, child)| self.add_cluster(cells, quarter, child, reach));
        let moments = moments.reduce(Moments::join).expect("a group has samples");

        let fit = moments.fit();
        let (mut radius, mut normal_radius, mut creased) = (0.0f32, 0.0f32, false);
        let (mut central, mut least) = (group[0], f32::INFINITY);
        for &sample in &*group {
            creased |= cells[sample as usize].node.is_creased();
            creased |= cells[sample as usize].patch != cells[group[0] as usize].patch;
            let of_sample = cells[sample as usize].node.geometry();
            let distance = of_sample.centroid.distance_squared(fit.centroid);
            if distance < least {
                (central, least) = (sample, distance);
            }
            radius = radius.max(of_sample.centroid.distance(fit.centroid) + of_sample.radius);
            normal_radius = normal_radius.max(of_sample.normal.distance(fit.normal) + of_sample.normal_radius);
        }
        let mut node = CellNode::new(&fit, radius, normal_radius, central, creased);
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

/// Splits a group of samples in two.
fn halves_of_samples<'a>(cells: &[SampleCell], group: &'a mut [u32], reach: f32) -> (&'a mut [u32], &'a mut [u32]) {
    let at = |sample: u32| {
        let node = cells[sample as usize].node.geometry();
        let ([a, b, c], [x, y, z]) = (node.centroid.to_array(), node.normal.to_array());
        [a, b, c, x, y, z]
    };
    let middle = group.len() / 2;
    if middle > 0 {
        let axes = longest_axes(group.iter().map(|&sample| at(sample)), reach);
        group.select_nth_unstable_by(middle, |&a, &b| in_order(&at(a), &at(b), axes));
    }
    group.split_at_mut(middle)
}

/// The nodes below a sample node.
struct Subtree<'a> {
    nodes: &'a mut [CellNode],
    /// Where they begin in the tree.
    start: u32,
    sample: u32,
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
        let mut node = CellNode::new(&fit, radius, normal_radius, self.sample, mixed);
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
