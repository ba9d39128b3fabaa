//! What is summed, made ready: samples with what they see, or a hierarchy of them and how right it is to be.

use super::gather::Samples;
use super::gbuffer::visible_receivers;
use super::options::{Evaluation, Options};
use super::{Seconds, timed};
use crate::cell_tree::{CellTree, TreeOptions};
use crate::differential::DifferentialSample;
use crate::environment::{Environment, LightBounds};
use crate::pinhole::cpu::{Accuracy, Light, typical_irradiance};
use crate::pinhole::{PinholeTree, Pinholes, pinholes};
use crate::sampling::{PointSet, Surface};
use crate::scene::{Scene, Visibility};
use crate::tracing::Tracer;

/// What samples are made for.
pub(super) struct Stage<'a> {
    pub scene: &'a Scene,
    pub surface: &'a Surface,
    pub environment: &'a Environment,
    pub tracer: &'a Tracer,
}

/// The longer side of the picture from whose receivers it is known how bright the whole one is, pixels.
const SCOUTS: u32 = 64;

impl Stage<'_> {
    /// Makes what an evaluation sums.
    pub fn samples(
        &self,
        set: &PointSet,
        differentials: &[DifferentialSample],
        evaluation: Evaluation,
        options: &Options,
        seconds: &mut Seconds,
    ) -> Samples {
        match evaluation {
            Evaluation::Flat { leaves: 1 } => {
                let mut samples = pinholes(self.scene, differentials, options.footprint);
                self.look_around(&mut samples, options, seconds);
                Samples::Flat(samples)
            }
            Evaluation::Flat { leaves } => {
                let mut samples = self.tree(set, leaves, options, seconds).leaves();
                self.look_around(&mut samples, options, seconds);
                Samples::Flat(samples)
            }
            Evaluation::Hierarchical { leaves, tolerance } => {
                let mut tree = self.tree(set, leaves, options, seconds);
                self.look_around(tree.roots_mut(), options, seconds);
                let bounds = timed(&mut seconds.environment, || LightBounds::new(&self.environment.cube));
                let typical = timed(&mut seconds.gather, || self.typical_irradiance(&tree, &bounds, options));
                let accuracy = Accuracy { error: tolerance * typical, split_near: true };
                Samples::Hierarchical { tree: Box::new(tree), bounds, accuracy }
            }
        }
    }

    fn tree(&self, set: &PointSet, leaves: u32, options: &Options, seconds: &mut Seconds) -> PinholeTree {
        let tree = TreeOptions { leaves, seed: options.seed };
        timed(&mut seconds.tree, || PinholeTree::new(self.scene, CellTree::new(self.surface, set, &tree)))
    }

    fn look_around(&self, samples: &mut Pinholes, options: &Options, seconds: &mut Seconds) {
        if options.visibility == Visibility::Full {
            timed(&mut seconds.visibility, || samples.look_around(self.scene, self.tracer));
        }
    }

    /// How bright the picture's caustics are: what errors are relative to.
    fn typical_irradiance(&self, tree: &PinholeTree, bounds: &LightBounds, options: &Options) -> f32 {
        let longest = options.size[0].max(options.size[1]);
        let size = options.size.map(|edge| (edge * SCOUTS.min(longest) / longest).max(1));
        let receivers = visible_receivers(self.scene, self.tracer, size);
        let light = Light { cube: &self.environment.cube, bounds };
        typical_irradiance(&receivers, tree, light, &options.params)
    }
}
