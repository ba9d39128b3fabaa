//! A cell tree with the materials of its mirrors: the input of a hierarchical gather.

use super::cell::Cell;
use super::constants::LOBE_BLUR;
use super::{Mirror, Mirrors, PinholeParts, PinholeSample, Pinholes};
use crate::cell_tree::{CellNode, CellTree, NodeGeometry};
use crate::scene::Scene;
use crate::tracing::Tracer;

/// The hierarchy of samples.
#[derive(Clone, Debug)]
pub struct PinholeTree {
    pub(super) tree: CellTree,
    mirrors: Mirrors,
    /// The sample nodes, with their visibility maps, which all cells below them share.
    pub(super) sample_nodes: Pinholes,
}

impl PinholeTree {
    /// Combines a tree's cells with the materials of their objects. `scene` is the one that the tree was made of.
    pub fn new(scene: &Scene, tree: CellTree) -> Self {
        let mut new = Self { tree, mirrors: Mirrors::of_scene(scene), sample_nodes: Pinholes::default() };
        let samples = new.tree.sample_nodes().iter().map(|&index| new.packed(new.tree.node(index))).collect();
        new.sample_nodes = Pinholes { samples, curves: new.mirrors.curves.clone(), visibility: None };
        new
    }

    /// Traces the visibility maps of the samples, which all cells below them share. `scene` is the one that the tree and the tracer
    /// were made of.
    pub fn trace_visibility(&mut self, scene: &Scene, tracer: &Tracer) {
        self.sample_nodes.trace_visibility(scene, tracer);
    }

    /// The cells.
    pub fn tree(&self) -> &CellTree {
        &self.tree
    }

    /// The sample nodes as samples.
    pub fn sample_nodes(&self) -> &Pinholes {
        &self.sample_nodes
    }

    /// The leaves as samples, for a flat gather.
    pub fn leaves(&self) -> Pinholes {
        let samples = self.tree.leaves().map(|leaf| self.packed(leaf)).collect();
        Pinholes { samples, curves: self.mirrors.curves.clone(), visibility: None }
    }

    fn packed(&self, node: &CellNode) -> PinholeSample {
        self.cell(node).sample.into()
    }

    /// Unpacks a node.
    #[inline(always)]
    pub(super) fn cell(&self, node: &CellNode) -> Cell {
        let NodeGeometry { centroid, normal, area, sides, changes, creased, radius, normal_radius } = node.geometry();
        let object = self.tree.object(node);
        let mirror = self.mirror(object);
        let Mirror { reflectance, curve, two_sided, max_reflectance, .. } = *mirror;
        let lobe = mirror.lobe_with_bend(changes);
        let position = centroid;
        Cell {
            sample: PinholeParts {
                position,
                normal,
                area,
                sides,
                changes,
                reflectance,
                curve,
                lobe,
                object,
                two_sided,
            },
            max_reflectance,
            blur: LOBE_BLUR * mirror.lobe,
            radius,
            normal_radius,
            is_creased: creased,
            children: node.children(),
            sample_node: node.sample(),
        }
    }

    /// The mirror material of an object of the tree.
    #[inline]
    pub(super) fn mirror(&self, object: u32) -> &Mirror {
        self.mirrors.of_object[object as usize].as_ref().expect("objects in the tree are reflectors")
    }
}
