//! Which combinations a comparison renders.

use super::ReportError;
use crate::image_space::Mode;
use crate::options::{EvaluationChoice, FilterChoice, Options};
use crate::pinhole::Footprint;
use crate::sampling::{Density, Strategy};
use crate::scene::Visibility;
use crate::technique::Technique;

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
    /// The techniques. What follows of samples is for pinholes, what follows of photons for image-space techniques.
    pub techniques: Vec<Technique>,
    /// How photons become irradiance.
    pub modes: Vec<Mode>,
    /// Photons along each edge of a light's view.
    pub photons: Vec<u32>,
    /// Directional lights that environment maps are divided into.
    pub lights: Vec<u32>,
    /// How samples are placed.
    pub strategies: Vec<Strategy>,
    /// Where they are denser.
    pub densities: Vec<Density>,
    /// How footprints are found.
    pub footprints: Vec<Footprint>,
    /// How the environment is looked up.
    pub filters: Vec<FilterChoice>,
    /// How samples are summed; the hierarchy knows the anisotropic filter of cells only.
    pub evaluations: Vec<EvaluationChoice>,
    /// Numbers of samples.
    pub samples: Vec<u32>,
    /// Consecutive seeds, from the options' own.
    pub seeds: u32,
    /// The figure that this reproduces.
    pub figure: Option<Figure>,
}

impl Default for Plan {
    /// One combination of samples with the defaults of [`Options`], and three seeds.
    fn default() -> Self {
        let Options { technique, image_space, strategy, density, footprint, filter, samples, .. } = Options::default();
        Self {
            techniques: vec![technique],
            modes: vec![image_space.mode],
            photons: vec![image_space.photons],
            lights: vec![image_space.lights],
            strategies: vec![strategy],
            densities: vec![density],
            footprints: vec![footprint],
            filters: vec![filter],
            evaluations: vec![EvaluationChoice::Auto],
            samples: vec![samples],
            seeds: 3,
            figure: None,
        }
    }
}

impl Plan {
    /// A figure's own plan, and what it asks of the options.
    pub fn of_figure(figure: Figure, options: &mut Options, seeds: u32) -> Self {
        use Footprint::{Cells, Curvature};
        // As in the paper.
        options.visibility = Visibility::None;
        let plan = Self {
            footprints: vec![Curvature],
            filters: vec![FilterChoice::None],
            evaluations: vec![EvaluationChoice::Flat],
            samples: vec![2000],
            seeds,
            figure: Some(figure),
            ..Self::default()
        };
        match figure {
            Figure::Samples => Self {
                footprints: vec![Curvature, Cells],
                filters: vec![FilterChoice::None, FilterChoice::Anisotropic],
                samples: vec![100, 1000, 10_000],
                ..plan
            },
            Figure::Strategies => {
                options.attenuation = false;
                let strategies =
                    vec![Strategy::Random, Strategy::Grid, Strategy::QuantisedGrid, Strategy::Neighbourhood];
                Self { strategies, ..plan }
            }
        }
    }

    /// The options of every combination; the seeds of one stand together. An error if an evaluation has none.
    pub fn combinations(&self, base: &Options) -> Result<Vec<Options>, ReportError> {
        let mut all = Vec::new();
        for technique in &self.techniques {
            let base = base.clone().with_technique(*technique);
            all.extend(match technique {
                Technique::Pinhole => self.of_samples(&base)?,
                Technique::ImageSpace => self.of_photons(&base),
            });
        }
        let seeds: Vec<u64> = (0..u64::from(self.seeds)).map(|k| base.seed.wrapping_add(k)).collect();
        Ok(all.iter().flat_map(|o| varied(o, &seeds, |o, &seed| o.seed = seed)).collect())
    }

    fn of_samples(&self, base: &Options) -> Result<Vec<Options>, ReportError> {
        let mut all = vec![base.clone()];
        let mut each = |choices: &dyn Fn(&Options) -> Vec<Options>| all = all.iter().flat_map(choices).collect();
        each(&|o| varied(o, &self.strategies, |o, &strategy| o.strategy = strategy));
        each(&|o| varied(o, &self.densities, |o, &density| o.density = density));
        each(&|o| varied(o, &self.footprints, |o, &footprint| o.footprint = footprint));
        each(&|o| varied(o, &self.filters, |o, &filter| o.filter = filter));
        each(&|o| varied(o, &self.evaluations, |o, &evaluation| o.evaluation = evaluation));
        all.retain(|o| {
            o.evaluation != EvaluationChoice::Hierarchical
                || o.footprint == Footprint::Cells && matches!(o.filter, FilterChoice::Auto | FilterChoice::Anisotropic)
        });
        if let Some(&evaluation) = self.evaluations.iter().find(|e| all.iter().all(|o| o.evaluation != **e)) {
            return Err(ReportError::NoCombination { evaluation });
        }
        Ok(all.iter().flat_map(|o| varied(o, &self.samples, |o, &samples| o.samples = samples)).collect())
    }

    fn of_photons(&self, base: &Options) -> Vec<Options> {
        let mut all = varied(base, &self.modes, |o, &mode| o.image_space.mode = mode);
        let mut each = |choices: &dyn Fn(&Options) -> Vec<Options>| all = all.iter().flat_map(choices).collect();
        each(&|o| varied(o, &self.photons, |o, &photons| o.image_space.photons = photons));
        each(&|o| varied(o, &self.lights, |o, &lights| o.image_space.lights = lights));
        all
    }
}

/// Options with each of these put in.
fn varied<T>(options: &Options, choices: &[T], put: impl Fn(&mut Options, &T)) -> Vec<Options> {
    let with = |choice: &T| {
        let mut options = options.clone();
        put(&mut options, choice);
        options
    };
    choices.iter().map(with).collect()
}
