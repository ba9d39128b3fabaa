//! Which combinations a comparison renders.

use crate::pinhole::{Filter, Footprint};
use crate::render::Options;
use crate::sampling::Strategy;
use crate::scene::Visibility;

/// The figures of Wand & Straßer (2003) that can be reproduced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// Figure 4: 100, 1,000 and 10,000 samples, unfiltered and filtered.
    Samples,
    /// Figure 5: the strategies with 2,000 samples, no filter, no attenuation.
    Strategies,
}

/// Every combination of these.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// How samples are placed.
    pub strategies: Vec<Strategy>,
    /// How footprints are found.
    pub footprints: Vec<Footprint>,
    /// How the environment is looked up.
    pub filters: Vec<Filter>,
    /// Numbers of samples.
    pub samples: Vec<u32>,
    /// Consecutive seeds, from the options' own.
    pub seeds: u32,
    /// The figure that this reproduces.
    pub figure: Option<Figure>,
}

impl Plan {
    /// A figure's own plan, and what it asks of the options.
    pub fn of_figure(figure: Figure, options: &mut Options, seeds: u32) -> Self {
        use Footprint::{Cells, Curvature};
        // As in the paper.
        options.visibility = Visibility::None;
        let plan = Self {
            strategies: vec![Strategy::Neighbourhood],
            footprints: vec![Curvature],
            filters: vec![Filter::None],
            samples: vec![2000],
            seeds,
            figure: Some(figure),
        };
        match figure {
            Figure::Samples => Self {
                footprints: vec![Curvature, Cells],
                filters: vec![Filter::None, Filter::Anisotropic],
                samples: vec![100, 1000, 10_000],
                ..plan
            },
            Figure::Strategies => {
                options.params.attenuation = false;
                let strategies =
                    vec![Strategy::Random, Strategy::Grid, Strategy::QuantisedGrid, Strategy::Neighbourhood];
                Self { strategies, ..plan }
            }
        }
    }

    /// The options of every combination; the seeds of one stand together.
    pub fn combinations(&self, base: &Options) -> Vec<Options> {
        let mut all = Vec::new();
        for &strategy in &self.strategies {
            for &footprint in &self.footprints {
                for &filter in &self.filters {
                    for &samples in &self.samples {
                        for k in 0..u64::from(self.seeds) {
                            let mut options = base.clone();
                            options.strategy = strategy;
                            options.footprint = footprint;
                            options.params.filter = filter;
                            options.automatic_filter = false;
                            options.samples = samples;
                            options.seed = base.seed.wrapping_add(k);
                            all.push(options);
                        }
                    }
                }
            }
        }
        all
    }
}
