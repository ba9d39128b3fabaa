//! A hierarchy of differential samples whose cells tile the reflectors.
//!
//! Every node is a sample like those of [`differential`](crate::differential): area, centroid, mean normal, the moments of
//! its cell, the change of its normal; beside them a radius and a cone of normals that bound the cell. Roots are the cells of
//! the samples that a strategy placed. Each is split into leaves that tile it, four at a time; above, roots are gathered by fours
//! into ever larger cells, object by object. Whoever evaluates the tree may stop anywhere.
//!
//! Data flows points with their candidates → cells → moments, from the leaves up → nodes. This module must not know environments
//! or receivers.

mod build;
mod moments;
mod node;
mod point;
mod split;
mod tiling;

#[cfg(feature = "gpu")]
pub(crate) use build::FAN as MAX_CHILDREN;
pub use build::{MAX_LEAVES, TreeOptions};
pub use node::{CellNode, NodeGeometry};

/// The hierarchy.
#[derive(Clone, Debug, Default)]
pub struct CellTree {
    /// All nodes; those that are children of one node lie together.
    nodes: Vec<CellNode>,
    /// The nodes above all others, one for each object that reflects.
    tops: Vec<u32>,
    /// The roots' nodes.
    roots: Vec<u32>,
    /// The object of each root.
    objects: Vec<u32>,
    /// Nodes from here on are roots or lie above them.
    first_above: u32,
    /// Leaves that a root has at most.
    leaves_per_root: u32,
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
    pub fn tops(&self) -> &[u32] {
        &self.tops
    }

    /// Area of all cells together, m².
    pub fn area(&self) -> f32 {
        self.tops.iter().map(|&top| self.node(top).area()).sum()
    }

    /// The node of each root.
    pub fn roots(&self) -> &[u32] {
        &self.roots
    }

    /// The scene's object that a node is a part of.
    pub fn object(&self, node: &CellNode) -> u32 {
        self.objects[node.root() as usize]
    }

    #[cfg(feature = "gpu")]
    /// Nodes from here on are roots or lie above them.
    pub(crate) fn first_above(&self) -> u32 {
        self.first_above
    }

    /// Whether a node lies above the roots: it is several of them together.
    #[inline]
    pub fn is_above_roots(&self, index: u32) -> bool {
        // Roots, and what lies above them, come last.
        index >= self.first_above && self.roots[self.node(index).root() as usize] != index
    }

    /// Leaves that a root has at most.
    pub fn leaves_per_root(&self) -> u32 {
        self.leaves_per_root
    }

    /// All leaves, in the order of their roots.
    pub fn leaves(&self) -> impl Iterator<Item = &CellNode> {
        self.roots.iter().flat_map(|&root| self.leaves_below(root))
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
            Shape::Sphere(Sphere { radius: 0.7 }),
            Shape::DiscoBall(DiscoBall { radius: 1.0, rows: 8 }),
            Shape::Spoon(Spoon { thickness: 0.004, ..Default::default() }),
            Shape::SolidRing(SolidRing { thickness: 0.01, ..Default::default() }),
        ]
    }

    #[test]
    fn children_tile_their_parents() {
        for shape in shapes() {
            let (surface, tree) = tree_of(shape, 60, Strategy::Neighbourhood, 16);
            let mut pending = tree.tops().to_vec();
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
                assert!(tree.is_above_roots(index) || node.children().all(|c| tree.node(c).root() == node.root()));
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
            assert!(leaves > tree.roots().len() * 60 && leaves <= tree.roots().len() * 64, "{strategy:?}: {leaves}");
        }
        let (_, tree) = tree_of(Shape::Ring(Ring::default()), 100, Strategy::Neighbourhood, 63);
        assert_eq!(tree.leaves_per_root(), 16);
        let (_, tree) = tree_of(Shape::Plane(Plane { size: [1.0, 1.0] }), 1, Strategy::Random, 1);
        assert_eq!((tree.leaves().count(), tree.tops(), tree.roots()), (1, &[0][..], &[0][..]));
    }

    #[test]
    fn every_level_knows_the_curvature() {
        // The ring's normals point inwards: it is concave around, flat along.
        let (_, tree) = tree_of(Shape::Ring(Ring { radius: 2.0, height: 1.0 }), 200, Strategy::Neighbourhood, 16);
        let roots = tree.roots().iter().map(|&root| tree.node(root));
        for node in roots.chain(tree.leaves()) {
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
        // 60 samples for more tiles than that: roots mix them, leaves must not, as far as there are enough of them.
        let (_, tree) = tree_of(Shape::DiscoBall(DiscoBall { radius: 1.0, rows: 8 }), 60, Strategy::Neighbourhood, 64);
        let bent = tree.leaves().filter(|leaf| leaf.geometry().normal_radius > 0.01).count();
        assert!(bent * 100 <= tree.leaves().count(), "{bent}");
    }
}
