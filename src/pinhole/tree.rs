//! A cell tree with the materials of its mirrors: the input of a hierarchical gather.

use std::sync::Arc;

use glam::Vec3;

use super::cell::Cell;
use super::constants::LOBE_BLUR;
use super::visibility::Edges;
use super::{Mirror, Mirrors, PinholeParts, PinholeSample, Pinholes, VisibilityMaps, reflectance_curves};
use crate::cell_tree::{CellNode, CellTree, NodeGeometry};
use crate::lanes::LANES;
use crate::progress::Progress;
use crate::reflectance::Curve;
use crate::scene::Scene;
use crate::tracing::{Piece, Tracer};

/// The hierarchy of samples.
#[derive(Clone, Debug)]
pub struct PinholeTree {
    pub(super) tree: CellTree,
    mirrors: Mirrors,
    /// The sample nodes, with their visibility maps, which all cells below them share.
    pub(super) sample_nodes: Pinholes,
    /// What may occlude, if the doubts of the visibility maps are traced.
    pub(super) occluders: Option<Occluders>,
}

/// The scene as cells see it.
#[derive(Clone, Debug)]
pub(super) struct Occluders {
    tracer: Arc<Tracer>,
    /// By object: whether its reflecting side, or that of both which is the front's, is the one that the mesh's normals point to.
    faces_front: Vec<bool>,
}

impl Occluders {
    /// The lanes, of those asked for, in which the middle of a cell sees nothing in a unit direction up to a distance in metres.
    /// `behind` are the lanes that concern its back.
    pub fn unoccluded_lanes(
        &self,
        cell: &PinholeParts,
        behind: u32,
        (directions, distances): (&[Vec3; LANES], &[f32; LANES]),
        lanes: u32,
    ) -> u32 {
        let extent = cell.sides[0].length().max(cell.sides[1].length());
        let faces_front = self.faces_front[cell.object as usize];
        let open = |front: bool, lanes: u32| {
            let piece = Piece { position: cell.position, object: cell.object, front, extent };
            if lanes == 0 { 0 } else { self.tracer.unoccluded_lanes(&piece, directions, distances, lanes) }
        };
        open(faces_front, lanes & !behind) | open(!faces_front, lanes & behind)
    }
}

impl PinholeTree {
    /// Combines a tree's cells with the materials of their objects. `scene` is the one that the tree was made of.
    pub fn new(scene: &Scene, tree: CellTree) -> Self {
        Self::with_curves(scene, &reflectance_curves(scene), tree)
    }

    /// The same with the [`reflectance_curves`] of the scene, which take long for rough mirrors.
    pub(crate) fn with_curves(scene: &Scene, curves: &[Option<Curve>], tree: CellTree) -> Self {
        let mirrors = Mirrors::new(scene, curves);
        let mut new = Self { tree, mirrors, sample_nodes: Pinholes::default(), occluders: None };
        let samples = new.tree.sample_nodes().iter().map(|&index| new.packed(new.tree.node(index))).collect();
        new.sample_nodes = Pinholes { samples, curves: new.mirrors.curves.clone(), visibility: None };
        new
    }

    /// Traces the visibility maps of the samples, which all cells below them share. `scene` is the one that the tree and the tracer
    /// were made of.
    pub fn trace_visibility(&mut self, scene: &Scene, tracer: &Tracer, progress: &dyn Progress) {
        self.sample_nodes.trace_visibility(scene, tracer, progress);
    }

    /// The same for gathers on the CPU, which then trace rays where the maps are in doubt. Once it is cancelled, there are neither.
    pub fn trace_visibility_and_doubts(&mut self, scene: &Scene, tracer: Arc<Tracer>, progress: &dyn Progress) {
        let nodes = &mut self.sample_nodes;
        nodes.visibility = VisibilityMaps::trace(scene, &tracer, &mut nodes.samples, Edges::Traced, progress);
        if nodes.visibility.is_none() {
            return;
        }
        let faces_front = |mirror: &Option<Mirror>| mirror.as_ref().is_none_or(|mirror| mirror.faces_front);
        let faces_front = self.mirrors.of_object.iter().map(faces_front).collect();
        self.occluders = Some(Occluders { tracer, faces_front });
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
