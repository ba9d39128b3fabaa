//! Quality and spectrum of a strategy, averaged over several independent sets, on surfaces that have an isometric
//! parameterization.

use super::{Options, Parameterization, PointSet, Quality, SamplingError, Spectrum, Surface, quality, sample};
use crate::scene::shapes::{Plane, Ring, Shape, Torus};

/// A surface on which strategies are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TestSurface {
    /// A square along the axes.
    Plane,
    /// A cylinder as high as it is long around.
    Cylinder,
    /// A thin torus. It has no edges, but its parameterization is only nearly isometric.
    Torus,
}

impl TestSurface {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Plane, Self::Cylinder, Self::Torus];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Cylinder => "cylinder",
            Self::Torus => "torus",
        }
    }

    /// The surface and its parameterization.
    pub fn surface(self) -> (Surface, Parameterization) {
        let shape = match self {
            Self::Plane => Shape::Plane(Plane { size: [1.0, 1.0] }),
            Self::Cylinder => Shape::Ring(Ring { radius: 0.25, height: std::f32::consts::FRAC_PI_2 }),
            Self::Torus => Shape::Torus(Torus { radius: 1.0, tube: 0.125 }),
        };
        let mut surface = Surface::default();
        surface.append(&shape.mesh().expect("the measures are in range"), 0, false);
        let parameterization = match self {
            Self::Torus => Parameterization::Torus { radius: 1.0, tube: 0.125 },
            _ => Parameterization::of(&surface).expect("planes and cylinders are developable"),
        };
        (surface, parameterization)
    }
}

/// Averages over several sets of one strategy.
#[derive(Clone, Debug, serde::Serialize)]
pub struct StrategyStatistics {
    /// Figures, averaged over the sets.
    pub quality: Quality,
    /// Their spectrum.
    pub spectrum: Option<Spectrum>,
    /// How many sets.
    pub sets: u32,
    /// The first set.
    #[serde(skip)]
    pub first: PointSet,
}

/// Makes `sets` point sets with consecutive seeds and averages their quality and, where there is a parameterization, their
/// spectrum.
pub fn strategy_statistics(
    surface: &Surface,
    parameterization: Option<&Parameterization>,
    options: &Options,
    sets: u32,
) -> Result<StrategyStatistics, SamplingError> {
    let seeds = (0..u64::from(sets.max(1))).map(|k| options.seed.wrapping_add(k));
    let made: Vec<PointSet> =
        seeds.map(|seed| sample(surface, &Options { seed, ..*options })).collect::<Result<_, _>>()?;
    let figures: Vec<Quality> = made.iter().map(|set| quality(set, surface.area())).collect();
    let spectrum = parameterization.map(|parameterization| {
        let points: Vec<_> = made.iter().map(|set| set.points.clone()).collect();
        Spectrum::of(&points, parameterization)
    });
    let first = made.into_iter().next().expect("at least one set");
    Ok(StrategyStatistics { quality: mean(&figures), spectrum, sets, first })
}

fn mean(figures: &[Quality]) -> Quality {
    let count = figures.len() as f64;
    let of = |f: fn(&Quality) -> f64| figures.iter().map(f).sum::<f64>() / count;
    Quality {
        count: of(|q| q.count as f64).round() as usize,
        area: of(|q| q.area),
        relative_radius: of(|q| q.relative_radius),
        nearest_mean: of(|q| q.nearest_mean),
        nearest_spread: of(|q| q.nearest_spread),
        coverage_radius: of(|q| q.coverage_radius),
        displacement: of(|q| q.displacement),
        orientation_bias: figures.iter().map(|q| q.orientation_bias).sum::<Option<f64>>().map(|sum| sum / count),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Strategy;

    /// An independent run of the same strategies on a periodic unit square, 1,024 points, ten sets (measured with other
    /// code): ρ, mean and spread of the nearest distance, power below half the peak. The torus has no edges either.
    #[test]
    fn figures_are_those_of_an_independent_run() {
        let (surface, parameterization) = TestSurface::Torus.surface();
        for (strategy, [rho, nearest, spread, low]) in [
            (Strategy::Random, [0.023, 0.469, 0.514, 0.941]),
            (Strategy::Neighbourhood, [0.739, 0.797, 0.070, 0.076]),
            (Strategy::Elimination, [0.694, 0.789, 0.077, 0.097]),
        ] {
            let options = Options { samples: 1024, strategy, seed: 1 };
            let StrategyStatistics { quality, spectrum, .. } =
                strategy_statistics(&surface, Some(&parameterization), &options, 10).unwrap();
            let spectrum = spectrum.unwrap();
            println!(
                "{strategy:?}: rho {:.3} nearest {:.3} spread {:.3} low {:.3} anisotropy {:.1} dB",
                quality.relative_radius,
                quality.nearest_mean,
                quality.nearest_spread,
                spectrum.low_power,
                spectrum.anisotropy_db
            );
            assert!((quality.relative_radius - rho).abs() < 0.03, "{strategy:?}: {quality:?}");
            assert!((quality.nearest_mean - nearest).abs() < 0.02, "{strategy:?}: {quality:?}");
            assert!((quality.nearest_spread - spread).abs() < 0.02, "{strategy:?}: {quality:?}");
            assert!((spectrum.low_power - low).abs() < 0.07, "{strategy:?}: {}", spectrum.low_power);
            assert!((spectrum.anisotropy_db + 10.0).abs() < 1.0, "{strategy:?}: {} dB", spectrum.anisotropy_db);
        }
    }

    #[test]
    fn a_snapped_grid_shows_in_every_figure() {
        let (surface, parameterization) = TestSurface::Plane.surface();
        let options = Options { samples: 1024, strategy: Strategy::QuantisedGrid, seed: 1 };
        let StrategyStatistics { quality, spectrum, .. } =
            strategy_statistics(&surface, Some(&parameterization), &options, 10).unwrap();
        // A square lattice: spacing over that of the hexagonal one is √(√3/2), a little more as cells overlap the edges.
        assert!((quality.relative_radius - 0.931).abs() < 0.04, "{quality:?}");
        let anisotropy_db = spectrum.unwrap().anisotropy_db;
        assert!(quality.nearest_spread < 0.01 && anisotropy_db > 5.0, "{quality:?} {anisotropy_db} dB");
    }

    /// A grid keeps a point per cell that the surface crosses: more where it is diagonal to the axes, up to √3.
    #[test]
    fn a_grid_favours_diagonal_surfaces() {
        let mut surface = Surface::default();
        let sphere = Shape::Sphere(crate::scene::shapes::Sphere::of_radius(1.0));
        surface.append(&sphere.mesh().unwrap(), 0, false);
        let bias = |strategy| {
            let options = Options { samples: 4000, strategy, seed: 1 };
            strategy_statistics(&surface, None, &options, 4).unwrap().quality.orientation_bias.unwrap()
        };
        let (grid, even) = (bias(Strategy::Grid), bias(Strategy::Neighbourhood));
        assert!((1.4..=1.75).contains(&grid), "{grid}");
        assert!((even - 1.0).abs() < 0.06, "{even}");
    }
}
