//! A hierarchy of differential samples whose cells tile the reflectors.
//!
//! Every node is a sample like those of [`differential`](crate::differential): area, centroid, mean normal, the moments of
//! its cell, the change of its normal; beside them a radius and a cone of normals that bound the cell. Roots are the cells of
//! sample nodes are those that a strategy placed. Below them each cell is split into four, down to leaves that tile it; above
//! them, cluster nodes join up to four, object by object. An evaluation may stop at any node.
//!
//! Data flows points with their candidates → cells → moments, from the leaves up → nodes. This module must not know environments
//! or receivers.

mod build;
mod moments;
mod node;
mod point;
mod split;
mod tiling;

pub use build::FAN as MAX_CHILDREN;
pub use build::{MAX_LEAVES, TreeOptions};
pub use node::{CellNode, NodeGeometry};

/// The hierarchy.
#[derive(Clone, Debug, Default)]
pub struct CellTree {
    /// All nodes; those that are children of one node lie together.
    nodes: Vec<CellNode>,
    /// The nodes above all others, one for each object that reflects.
    roots: Vec<u32>,
    /// The sample nodes, by sample.
    sample_nodes: Vec<u32>,
    /// The object of each sample.
    objects: Vec<u32>,
    /// From here on, nodes are sample nodes or clusters.
    first_cluster: u32,
    /// Leaves that a sample has at most.
    leaves_per_sample: u32,
    /// See [`CellTree::reach`].
    reach: f32,
}

impl CellTree {
    /// All nodes.
    pub fn nodes(&self) -> &[CellNode] {
        &self.nodes
    }

    /// A node.
    pub fn node(&self, index: u32) -> &CellNode {
        &self.nodes[index as usize]
    }

    /// The nodes above all others, one for each object that reflects.
    pub fn roots(&self) -> &[u32] {
        &self.roots
    }

    /// Area of all cells together, m².
    pub fn area(&self) -> f32 {
        self.roots.iter().map(|&root| self.node(root).area()).sum()
    }

    /// Cells are about as wide as long in the directions that receivers at this distance see in them, metres.
    pub fn reach(&self) -> f32 {
        self.reach
    }

    /// The node of each sample.
    pub fn sample_nodes(&self) -> &[u32] {
        &self.sample_nodes
    }

    /// The scene's object that a node is a part of.
    pub fn object(&self, node: &CellNode) -> u32 {
        self.objects[node.sample() as usize]
    }

    /// From here on, nodes are sample nodes or clusters.
    pub fn first_cluster(&self) -> u32 {
        self.first_cluster
    }

    /// Whether a node is a cluster of several samples.
    #[inline]
    pub fn is_cluster(&self, index: u32) -> bool {
        // Sample nodes and clusters come last.
        index >= self.first_cluster && self.sample_nodes[self.node(index).sample() as usize] != index
    }

    /// Leaves that a sample has at most.
    pub fn leaves_per_sample(&self) -> u32 {
        self.leaves_per_sample
    }

    /// All leaves, in the order of their samples.
    pub fn leaves(&self) -> impl Iterator<Item = &CellNode> {
        self.sample_nodes.iter().flat_map(|&sample| self.leaves_below(sample))
    }

    fn leaves_below(&self, index: u32) -> Vec<&CellNode> {
        let node = self.node(index);
        if node.children().is_empty() {
            return vec![node];
        }
        node.children().flat_map(|child| self.leaves_below(child)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Options, Strategy, Surface, sample};
    use crate::scene::shapes::{Cup, DiscoBall, Plane, Ring, Shape, SolidRing, Sphere, Spoon};

    fn tree_of(shape: Shape, samples: u32, strategy: Strategy, leaves: u32) -> (Surface, CellTree) {
        let mut surface = Surface::default();
        surface.append(&shape.mesh().unwrap(), 0, false);
        let set = sample(&surface, &Options { samples, strategy, seed: 1 }).unwrap();
        let tree = CellTree::new(&surface, &set, &TreeOptions { leaves, seed: 1 });
        (surface, tree)
    }

    fn shapes() -> [Shape; 6] {
        [
            Shape::Ring(Ring::default()),
            Shape::Cup(Cup::default()),
            Shape::Sphere(Sphere::of_radius(0.7)),
            Shape::DiscoBall(DiscoBall { radius: 1.0, rows: 8, joint: 0.0 }),
            Shape::Spoon(Spoon { thickness: 0.004, ..Default::default() }),
            Shape::SolidRing(SolidRing { thickness: 0.01, ..Default::default() }),
        ]
    }

    #[test]
    fn children_tile_their_parents() {
        for shape in shapes() {
            let (surface, tree) = tree_of(shape, 60, Strategy::Neighbourhood, 16);
            let mut pending = tree.roots().to_vec();
            let mut area = 0.0;
            while let Some(index) = pending.pop() {
                let node = tree.node(index);
                assert!(node.area() > 0.0);
                if node.children().is_empty() {
                    area += f64::from(node.area());
                    continue;
                }
                let of_children: f32 = node.children().map(|c| tree.node(c).area()).sum();
                assert!((of_children / node.area() - 1.0).abs() < 1e-3, "{}", shape.name());
                assert!(tree.is_cluster(index) || node.children().all(|c| tree.node(c).sample() == node.sample()));
                pending.extend(node.children());
            }
            assert!((area / surface.area() - 1.0).abs() < 1e-3, "{}: {area}", shape.name());
        }
    }

    #[test]
    fn bounds_hold_all_the_way_down() {
        for shape in shapes() {
            let (_, tree) = tree_of(shape, 60, Strategy::Neighbourhood, 16);
            for node in tree.nodes().iter().filter(|n| !n.children().is_empty()) {
                let own = node.geometry();
                for leaf in node.children().flat_map(|c| tree.leaves_below(c)) {
                    let leaf = leaf.geometry();
                    // Lifting moves centroids off the points' mean by little.
                    let far = leaf.centroid.distance(own.centroid);
                    assert!(far <= 1.02 * own.radius, "{}: {far} {}", shape.name(), own.radius);
                    assert!(leaf.normal.distance(own.normal) <= own.normal_radius + 1e-3, "{}", shape.name());
                }
            }
        }
    }

    #[test]
    fn leaves_count_as_asked_for_any_strategy() {
        for strategy in [Strategy::Random, Strategy::Grid, Strategy::QuantisedGrid, Strategy::Elimination] {
            let (_, tree) = tree_of(Shape::Ring(Ring::default()), 100, strategy, 64);
            let leaves = tree.leaves().count();
            assert!(
                leaves > tree.sample_nodes().len() * 60 && leaves <= tree.sample_nodes().len() * 64,
                "{strategy:?}: {leaves}"
            );
        }
        let (_, tree) = tree_of(Shape::Ring(Ring::default()), 100, Strategy::Neighbourhood, 63);
        assert_eq!(tree.leaves_per_sample(), 16);
        let (_, tree) = tree_of(Shape::Plane(Plane { size: [1.0, 1.0] }), 1, Strategy::Random, 1);
        assert_eq!((tree.leaves().count(), tree.roots(), tree.sample_nodes()), (1, &[0][..], &[0][..]));
    }

    #[test]
    fn every_level_knows_the_curvature() {
        // The ring's normals point inwards: it is concave around, flat along.
        let (_, tree) = tree_of(Shape::Ring(Ring { radius: 2.0, height: 1.0 }), 200, Strategy::Neighbourhood, 16);
        let samples = tree.sample_nodes().iter().map(|&sample| tree.node(sample));
        for node in samples.chain(tree.leaves()) {
            let g = node.geometry();
            assert!((g.centroid.with_y(0.0).length() - 2.0).abs() < 2e-3, "{}", g.centroid);
            for (side, change) in g.sides.iter().zip(g.changes) {
                let exact = -0.5 * side.with_y(0.0);
                assert!(change.distance(exact) < 0.03 * g.sides[0].length(), "{change} {exact}");
            }
            let parallelogram = g.sides[0].cross(g.sides[1]).length();
            assert!(parallelogram > 0.8 * g.area && parallelogram < 2.0 * g.area, "{parallelogram} {}", g.area);
        }
    }

    #[test]
    fn leaves_end_at_creases() {
        // 60 samples for more tiles than that: samples mix them, leaves must not, as far as there are enough of them.
        let (_, tree) =
            tree_of(Shape::DiscoBall(DiscoBall { radius: 1.0, rows: 8, joint: 0.0 }), 60, Strategy::Neighbourhood, 64);
        let bent = tree.leaves().filter(|leaf| leaf.geometry().normal_radius > 0.01).count();
        assert!(bent * 100 <= tree.leaves().count(), "{bent}");
    }
}
