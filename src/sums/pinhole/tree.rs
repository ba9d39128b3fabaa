//! A cell tree with the materials of its mirrors and interfaces: the input of a hierarchical gather.

use std::sync::Arc;

use glam::Vec3;

use super::cell::Cell;
use super::constants::LOBE_BLUR;
use super::visibility::Edges;
use super::{
    Caster, Casters, CellShapes, Channels, PinholeParts, PinholeSample, Pinholes, VisibilityMaps, reflectance_curves,
};
use crate::cell_tree::{CellNode, CellTree, NodeGeometry};
use crate::lanes::LANES;
use crate::progress::Progress;
use crate::reflectance::Curve;
use crate::scene::{Chains, Scene, Sides};
use crate::tracing::{Piece, Tracer};

/// The hierarchy of samples.
#[derive(Clone, Debug)]
pub struct PinholeTree {
    /// The cells.
    pub tree: CellTree,
    casters: Casters,
    roots: Vec<u32>,
    /// The sample nodes, with their visibility maps, which all cells below them share.
    pub sample_nodes: Pinholes,
    /// What may occlude, if the doubts of the visibility maps are traced.
    pub occluders: Option<Occluders>,
}

/// The scene as cells see it.
#[derive(Clone, Debug)]
pub struct Occluders {
    tracer: Arc<Tracer>,
    /// By object: whether its reflecting side, or that of both which is the front's, is the one that the mesh's normals point to.
    faces_front: Vec<bool>,
}

impl Occluders {
    /// The lanes, of those asked for, in which the middle of a cell sees nothing in a unit direction up to a distance in metres. The cell may
    /// be a piece of a leaf, which is as far off its triangles as the leaf is curved. `behind` are the lanes that concern its back.
    pub fn unoccluded_lanes(
        &self,
        (cell, leaf): (&PinholeParts, &PinholeParts),
        behind: u32,
        (directions, distances): (&[Vec3; LANES], &[f32; LANES]),
        lanes: u32,
    ) -> u32 {
        let extent = leaf.sides[0].length().max(leaf.sides[1].length());
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
        Self::with_curves(scene, &reflectance_curves(scene), tree, Chains::ALL)
    }

    /// The same for some chains, with the [`reflectance_curves`] of the scene, which take long for rough mirrors.
    pub fn with_curves(scene: &Scene, curves: &[Option<Curve>], tree: CellTree, chains: Chains) -> Self {
        let casters = Casters::new(scene, curves, chains);
        let mut new = Self { tree, casters, roots: Vec::new(), sample_nodes: Pinholes::default(), occluders: None };
        let pack = |&index: &u32| new.cell(index).sample.into();
        let samples: Vec<PinholeSample> = new.tree.sample_nodes().iter().map(pack).collect();
        let roots_of = |&root: &u32| {
            let caster = new.casters.of_object[new.tree.object(new.tree.node(root)) as usize].as_ref();
            caster.into_iter().flat_map(Caster::channels).map(move |channels| root | item_bits(*channels))
        };
        new.roots = new.tree.roots().iter().flat_map(roots_of).collect();
        let areas = samples.iter().map(PinholeSample::area).collect();
        let shapes = CellShapes::new(areas, new.tree.leaves_per_sample(), new.tree.reach());
        new.sample_nodes = Pinholes { samples, curves: new.casters.curves.clone(), visibility: None, shapes };
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
        let faces_front = |caster: &Option<Caster>| caster.as_ref().is_none_or(|caster| caster.faces_front);
        let faces_front = self.casters.of_object.iter().map(faces_front).collect();
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

    /// The items of a traversal that begins with all cells: indices of nodes without a parent, once for each colour that they refract
    /// differently (see `Self::cell`).
    pub fn roots(&self) -> &[u32] {
        &self.roots
    }

    /// Whether any cell is on an interface between two media.
    pub fn refracts(&self) -> bool {
        self.casters.of_object.iter().flatten().any(|caster| caster.interface.is_some())
    }

    /// The leaves as samples, for a flat gather.
    pub fn leaves(&self) -> Pinholes {
        let pack = |leaf: &CellNode| {
            let caster = self.casters.of_object[self.tree.object(leaf) as usize].as_ref();
            let channels = caster.into_iter().flat_map(Caster::channels);
            let pack = |channels: &Channels| self.cell_of(leaf, *channels).sample.into();
            channels.map(pack).collect::<Vec<PinholeSample>>()
        };
        let samples = self.tree.leaves().flat_map(pack).collect();
        Pinholes { samples, curves: self.casters.curves.clone(), visibility: None, shapes: self.sample_nodes.shapes }
    }

    /// Unpacks the cell of an item: the index of a node with the bits of its channels.
    #[inline(always)]
    pub(super) fn cell(&self, item: u32) -> Cell {
        let channels = match item >> CHANNEL_SHIFT & CHANNEL_MASK {
            0 => Channels::All,
            number => Channels::One(number as usize - 1),
        };
        self.cell_of(self.tree.node(item & NODE_MASK), channels)
    }

    #[inline(always)]
    fn cell_of(&self, node: &CellNode, channels: Channels) -> Cell {
        let NodeGeometry { centroid, normal, area, sides, changes, creased, radius, normal_radius } = node.geometry();
        let object = self.tree.object(node);
        let caster = self.caster(object);
        let Caster { curve, lights, max_reflectance, .. } = *caster;
        let (reflectance, interface) = caster.for_channels(channels);
        let lobe = caster.lobe_with_bend(changes);
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
                lights,
                interface,
            },
            max_reflectance,
            blur: LOBE_BLUR * caster.lobe,
            radius,
            normal_radius,
            is_creased: creased,
            children: node.children(),
            sample_node: node.sample(),
        }
    }

    /// The material of an object of the tree.
    #[inline]
    pub fn caster(&self, object: u32) -> &Caster {
        self.casters.of_object[object as usize].as_ref().unwrap_or(&UNLIT)
    }
}

/// Where an item of a traversal has the number of its channel, 0 for all of them.
pub const CHANNEL_SHIFT: u32 = 29;
const CHANNEL_MASK: u32 = 3;
/// The bits of that number.
pub const CHANNEL_BITS: u32 = CHANNEL_MASK << CHANNEL_SHIFT;
/// The bits of an item that are the index of its node.
pub const NODE_MASK: u32 = (1 << CHANNEL_SHIFT) - 1;

fn item_bits(channels: Channels) -> u32 {
    match channels {
        Channels::All => 0,
        Channels::One(channel) => (channel as u32 + 1) << CHANNEL_SHIFT,
    }
}

/// The material of cells that light nothing by the chains in question, and are visited by no traversal.
const UNLIT: Caster = Caster {
    reflectance: Vec3::ZERO,
    curve: None,
    max_reflectance: 0.0,
    lobe: 0.0,
    lights: Sides::Front,
    faces_front: true,
    interface: None,
};
