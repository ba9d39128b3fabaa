//! A cell tree with what its mirrors are made of: what a hierarchical gather reads.

use super::{Mirror, Mirrors, PinholeSample, Pinholes, Region};
use crate::cell_tree::{CellNode, CellTree, NodeGeometry};
use crate::scene::Scene;

/// The hierarchy of samples.
#[derive(Clone, Debug)]
pub struct PinholeTree {
    pub(super) tree: CellTree,
    mirrors: Mirrors,
    /// The roots as samples, with the maps of what they see; all cells below share those.
    pub(super) roots: Pinholes,
}

impl PinholeTree {
    /// Gives a tree's cells the finishes of their objects. `scene` is the one that the tree was made of.
    pub fn new(scene: &Scene, tree: CellTree) -> Self {
        let mirrors = Mirrors::of_scene(scene);
        let mut new = Self { tree, mirrors, roots: Pinholes::default() };
        let samples =
            new.tree.roots().iter().map(|&root| new.sample(new.tree.node(root), &new.tree.node(root).geometry()));
        new.roots = Pinholes { samples: samples.collect(), curves: new.mirrors.curves.clone(), visibility: None };
        new
    }

    /// The roots as samples, to look around; their maps hold for all cells below them.
    pub fn roots_mut(&mut self) -> &mut Pinholes {
        &mut self.roots
    }

    /// The cells.
    pub fn tree(&self) -> &CellTree {
        &self.tree
    }

    /// The roots as samples.
    pub fn roots(&self) -> &Pinholes {
        &self.roots
    }

    /// The leaves as samples, for a gather that knows no hierarchy.
    pub fn leaves(&self) -> Pinholes {
        let samples = self.tree.leaves().map(|leaf| self.sample(leaf, &leaf.geometry())).collect();
        Pinholes { samples, curves: self.mirrors.curves.clone(), visibility: None }
    }

    /// A cell as a sample.
    #[inline]
    pub(super) fn sample(&self, node: &CellNode, geometry: &NodeGeometry) -> PinholeSample {
        let NodeGeometry { centroid, normal, area, sides, changes, .. } = *geometry;
        let object = self.tree.object(node);
        let region = Region { position: centroid, normal, area, sides, changes, object, bends: true };
        self.mirror(object).sample(&region)
    }

    /// How an object of the tree mirrors.
    #[inline]
    pub(super) fn mirror(&self, object: u32) -> &Mirror {
        self.mirrors.of_object[object as usize].as_ref().expect("objects in the tree are reflectors")
    }
}
