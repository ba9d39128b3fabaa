//! What the numbers say of the paper's findings (Wand & Straßer 2003, Section 4.1, Figures 4 and 5).

use serde::Serialize;

use super::plan::Figure;
use super::rows::Row;
use crate::pinhole::{Filter, Footprint};
use crate::sampling::{Quality, Strategy};

/// A claim and whether the numbers bear it out.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// The claim.
    pub text: String,
    /// Whether it holds here.
    pub holds: bool,
    /// The numbers that say so.
    pub figures: String,
}

/// Judges a figure's findings from its rows and from the strategies' figures on the scene's own reflectors; finds nothing
/// where an error is not defined.
pub(super) fn findings(figure: Figure, rows: &[Row], qualities: &[(Strategy, Quality)]) -> Vec<Finding> {
    if rows.iter().any(|row| row.rel_l2.is_none()) {
        return Vec::new();
    }
    match figure {
        Figure::Samples => of_samples(rows),
        Figure::Strategies => of_strategies(rows, qualities),
    }
}

/// Geometric mean of the errors of the rows that are chosen.
fn error(rows: &[Row], chosen: impl Fn(&Row) -> bool) -> f64 {
    let errors: Vec<f64> = rows.iter().filter(|r| chosen(r)).filter_map(|r| r.rel_l2).map(f64::ln).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64).exp()
}

fn of_samples(rows: &[Row]) -> Vec<Finding> {
    let of = |footprint: Footprint, filter: Filter, samples: u32| {
        error(rows, |r| (r.footprint, r.filter, r.samples) == (Some(footprint), Some(filter), Some(samples)))
    };
    let (curvature, cells) = (Footprint::Curvature, Footprint::Cells);
    let counts = [100, 1000, 10_000];
    let list = |footprint, filter| counts.map(|n| format!("{:.3}", of(footprint, filter, n))).join(" / ");
    let at = |n| (of(curvature, Filter::None, n), of(curvature, Filter::Anisotropic, n));
    let falls =
        counts.windows(2).all(|w| of(curvature, Filter::Anisotropic, w[1]) < of(curvature, Filter::Anisotropic, w[0]));
    vec![
        Finding {
            text: "Filtering lowers the error at every number of samples".into(),
            holds: counts.iter().all(|n| at(*n).1 < at(*n).0),
            figures: format!(
                "rel_l2 at 100 / 1,000 / 10,000: unfiltered {}, filtered {}",
                list(curvature, Filter::None),
                list(curvature, Filter::Anisotropic)
            ),
        },
        Finding {
            text: "Filtering still helps at 10,000 samples".into(),
            holds: at(10_000).1 < at(10_000).0,
            figures: format!("rel_l2 {:.3} filtered, {:.3} unfiltered", at(10_000).1, at(10_000).0),
        },
        Finding {
            text: "The filtered error falls with the number of samples".into(),
            holds: falls,
            figures: format!("rel_l2 {}", list(curvature, Filter::Anisotropic)),
        },
        Finding {
            text: "Not in the paper: footprints fitted to cells have less error than its square ones".into(),
            holds: counts.iter().all(|n| of(cells, Filter::Anisotropic, *n) < of(curvature, Filter::Anisotropic, *n)),
            figures: format!(
                "rel_l2 {} against {}",
                list(cells, Filter::Anisotropic),
                list(curvature, Filter::Anisotropic)
            ),
        },
    ]
}

fn of_strategies(rows: &[Row], qualities: &[(Strategy, Quality)]) -> Vec<Finding> {
    let of = |strategy: Strategy| error(rows, |r| r.strategy == Some(strategy));
    let quality = |strategy: Strategy| qualities.iter().find(|(s, _)| *s == strategy).map(|(_, q)| *q);
    let listed = [Strategy::Random, Strategy::Grid, Strategy::QuantisedGrid, Strategy::Neighbourhood];
    let errors = listed.map(|s| format!("{} {:.3}", s.name(), of(s))).join(", ");
    let neighbourhood = of(Strategy::Neighbourhood);
    let mut found = vec![
        Finding {
            text: "Neighbourhood pruning has the least error".into(),
            holds: listed.iter().all(|s| neighbourhood <= of(*s)),
            figures: format!("rel_l2: {errors}"),
        },
        Finding {
            text: "The quantised grid's regular pattern shows (rings) and costs more error than the grid".into(),
            holds: of(Strategy::QuantisedGrid) > of(Strategy::Grid),
            figures: format!("rel_l2 {:.3} against {:.3}", of(Strategy::QuantisedGrid), of(Strategy::Grid)),
        },
    ];
    if let (Some(snapped), Some(grid)) = (quality(Strategy::QuantisedGrid), quality(Strategy::Grid)) {
        found.push(Finding {
            text: "The quantised grid displaces samples from the surface, the others do not".into(),
            holds: snapped.displacement > 0.02 && grid.displacement < 0.02,
            figures: format!(
                "mean height over the surface {:.3} against {:.3} of the densest packing's distance",
                snapped.displacement, grid.displacement
            ),
        });
    }
    let biases = (
        quality(Strategy::Grid).and_then(|q| q.orientation_bias),
        quality(Strategy::Neighbourhood).and_then(|q| q.orientation_bias),
    );
    if let (Some(grid), Some(even)) = biases {
        found.push(Finding {
            text: "The grid is biased: it puts more samples where the surface is diagonal to its axes".into(),
            holds: grid > 1.1 && (even - 1.0).abs() < 0.1,
            figures: format!(
                "density at the body diagonal over that along an axis: grid {grid:.2}, neighbourhood {even:.2}"
            ),
        });
    }
    found
}
