//! A comparison from request to files.

use std::path::{Path, PathBuf};

use super::ReportError;
use super::cells::{Cell, Clock, Folder, Timed, render_or_reuse};
use super::comparison::{Comparison, Picture, ReferenceSummary, TestSurfaceResult, Unavailable};
use super::findings::findings;
use super::page;
use super::plan::Plan;
use super::rows::measure;
use crate::boxed::BoxFuture;
use crate::image::{Aov, Image, ImageError, metered_ev, read_mask, write_atomically};
use crate::options::{FilterChoice, Options};
use crate::progress::Progress;
use crate::progress::Stage;
use crate::reference::{self, EstimateFile, Estimator, Reference, StoppingCriterion};
use crate::sampling::{Surface, TestSurface, strategy_statistics};
use crate::scene::{Chains, Light, Scene};
use crate::technique::Technique;
use crate::{Backend, Engine, Error};

/// What to compare.
#[derive(Clone, Debug)]
pub struct Request {
    /// The scene.
    pub scene: Scene,
    /// What all combinations share; their AOV is the caustic, whatever is set.
    pub options: Options,
    /// Where they run; one device serves all combinations.
    pub backend: Backend,
    /// The combinations.
    pub plan: Plan,
    /// How the reference is computed. Beams have the means over whole pixels, so that `options.pixel_samples` should be more than 1 where
    /// there are any, which a warning says.
    pub estimator: Estimator,
    /// Only pixels that are not black in this picture count.
    pub mask: Option<PathBuf>,
    /// The folder that everything is written to, and that finished cells are taken from.
    pub folder: PathBuf,
    /// Names the code that renders, see `pinspot::code_id`: cells and references of other code are left alone.
    pub code: String,
    /// Render all cells, those that are finished, too. The reference, which gets better from run to run, goes on all the same.
    pub force: bool,
    /// The command that asked, for the report.
    pub command: String,
}

/// Directions in lights with an extent, of references by beams: in small spots, and in those of a larger standard deviation than this, radians.
const BEAM_DIRECTIONS: [u32; 2] = [64, 256];
const SMALL_SPOT_RAD: f32 = 0.02;

/// Points and sets of the strategies' spectra.
const STUDY_POINTS: u32 = 1024;
const SETS_PER_STRATEGY: u32 = 10;

/// Computes the reference as well as `criterion` asks, renders every combination that is not there yet, and measures.
/// `clock`: seconds since any moment.
///
/// ```
/// use std::time::Instant;
///
/// use pinspot::reference::{Estimator, StoppingCriterion};
/// use pinspot::report::{Plan, Request, compare};
/// use pinspot::{Backend, NoProgress, Strategy, blocking};
///
/// # fn main() -> Result<(), pinspot::Error> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let folder = folder.path();
/// let (scene, options) = pinspot::load("mirror-sphere")?;
/// let request = Request {
///     scene,
///     options: options.with_size([8, 8]),
///     backend: Backend::cpu(),
///     plan: Plan {
///         strategies: vec![Strategy::Random, Strategy::Neighbourhood],
///         samples: vec![50],
///         seeds: 1,
///         ..Plan::default()
///     },
///     estimator: Estimator::Auto,
///     mask: None,
///     folder: folder.into(),
///     code: pinspot::code_id().into(),
///     force: false,
///     command: "an example".into(),
/// };
/// let start = Instant::now();
/// let clock = || start.elapsed().as_secs_f64();
/// let comparison = blocking::wait(None, compare(&request, &StoppingCriterion::new(0.1), &clock, &NoProgress))?;
/// comparison.write(folder)?; // report.html, results.csv, …
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Combinations that cannot be rendered, a folder that cannot be written to, and all that the reference and the engine report.
pub fn compare<'a>(
    request: &'a Request,
    criterion: &'a StoppingCriterion<'a>,
    clock: Clock<'a>,
    progress: &'a dyn Progress,
) -> BoxFuture<'a, Result<Comparison, Error>> {
    Box::pin(async move {
        let (options, combinations, unavailable) = combinations(request)?;
        let mask = request.mask.as_deref().map(|path| mask(path, options.size)).transpose()?;
        let cells_folder = request.folder.join("cells");
        std::fs::create_dir_all(&cells_folder)
            .map_err(|e| ReportError::Folder { path: cells_folder.clone(), reason: e.to_string() })?;
        let reference = reference(request, &options)?;
        let (summary, truth) = solve(&reference, request, criterion, clock, progress)?;
        let mut comparison = Comparison::new(request, &options, summary, truth.clone());
        comparison.unavailable = unavailable;
        comparison.warnings = doubts(&reference, &comparison.reference);
        let mut engine = Engine::new(request.scene.clone(), options.clone(), request.backend.clone());
        let folder = Folder { path: &cells_folder, code: &request.code, is_ignored: request.force };
        for combination in &combinations {
            let timed = Timed::new(clock, progress);
            let cell = render_or_reuse(&mut engine, combination, folder, &timed).await?;
            comparison.add(cell, &truth, mask.as_deref(), combination.seed == options.seed);
        }
        comparison.assess_strategies(request, progress)?;
        if let Some(figure) = request.plan.figure {
            comparison.findings = findings(figure, &comparison.rows, &comparison.reflectors);
        }
        comparison.made_with.push(("Command".into(), request.command.clone()));
        Ok(comparison)
    })
}

/// What all combinations share, and each of them; refused here where one cannot be rendered. Last come the techniques that do not know
/// what there is in the scene.
fn combinations(request: &Request) -> Result<(Options, Vec<Options>, Vec<Unavailable>), Error> {
    let mut options = request.options.clone();
    options.aovs = vec![Aov::Caustic];
    options.check()?;
    let mut plan = request.plan.clone();
    let chains = compared_chains(request);
    let unavailable: Vec<Unavailable> =
        plan.techniques.iter().filter_map(|t| unavailable(*t, request, chains)).collect();
    plan.techniques.retain(|technique| unavailable.iter().all(|other| other.technique != *technique));
    if plan.techniques.is_empty() {
        return Err(ReportError::NoTechnique {
            reason: unavailable.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
        }
        .into());
    }
    let combinations = plan.combinations(&options)?;
    combinations.iter().try_for_each(Options::check)?;
    let hardware = combinations.iter().any(|o| o.filter == FilterChoice::Hardware);
    if hardware && !request.backend.is_gpu() {
        return Err(ReportError::NoHardwareFilter.into());
    }
    Ok((options, combinations, unavailable))
}

/// The chains that all techniques are compared by: what the most able one computes.
fn compared_chains(request: &Request) -> Chains {
    let all = request.plan.techniques.iter().map(|technique| technique.chains(&request.scene));
    all.max_by_key(|chains| Vec::from(*chains).len()).unwrap_or_default()
}

fn unavailable(technique: Technique, request: &Request, chains: Chains) -> Option<Unavailable> {
    let lacks_chains = technique.chains(&request.scene) != chains;
    let through_solids = lacks_chains.then_some("light that passes through closed objects");
    let reason = technique.unsupported(&request.scene).or(through_solids)?;
    Some(Unavailable { technique, reason: format!("does not know {reason}") })
}

fn beam_directions(scene: &Scene) -> u32 {
    let is_wide = matches!(scene.environment.light, Light::Spot { sigma_rad, .. } if sigma_rad > SMALL_SPOT_RAD);
    BEAM_DIRECTIONS[usize::from(is_wide)]
}

fn reference(request: &Request, options: &Options) -> Result<Reference, Error> {
    let defaults = reference::Options::default();
    let wanted = reference::Options {
        size: options.size,
        chains: compared_chains(request),
        pixel_samples: options.pixel_samples,
        visibility: options.visibility,
        attenuation: options.attenuation,
        estimator: request.estimator,
        replicates: match request.estimator {
            Estimator::Beams => beam_directions(&request.scene),
            Estimator::Auto | Estimator::Points => defaults.replicates,
        },
        ..defaults
    };
    Ok(Reference::new(request.scene.clone(), wanted)?)
}

/// A reference with a larger relative standard error than this is no truth, and one with more than that part of it is a doubtful one.
const MOST_REFERENCE_ERROR: f64 = 0.5;
const DOUBTFUL: f64 = 0.1;

/// What is wrong with a reference that others are compared with.
fn doubts(reference: &Reference, summary: &ReferenceSummary) -> Vec<String> {
    let rel_error = summary.rel_error;
    let is_noisy = (rel_error > DOUBTFUL * MOST_REFERENCE_ERROR).then(|| {
        format!("the reference's own relative standard error is {rel_error:.3}: smaller errors beside it mean nothing")
    });
    let is_other = reference.uses_beams() && reference.options().pixel_samples == 1;
    let is_other = is_other.then(|| {
        "the reference has means over whole pixels, as its lights are too small for points, but renderings have points at their centres: give --pixel-samples 4".to_owned()
    });
    is_noisy.into_iter().chain(is_other).collect()
}

/// Each reference has a file of its own, so that a comparison with other options or by other code never overwrites hours of work.
fn solve(
    reference: &Reference,
    request: &Request,
    criterion: &StoppingCriterion,
    clock: Clock<'_>,
    progress: &dyn Progress,
) -> Result<(ReferenceSummary, Image), Error> {
    let name = blake3::hash(format!("{}-{}", request.code, reference.fingerprint()).as_bytes()).to_hex();
    let file = format!("reference-{}.exr", &name[..8]);
    let path = request.folder.join(&file);
    let place = EstimateFile { path: &path, code: &request.code };
    let known = reference.read(&place)?;
    let stored = reference.solve_in_file(&place, known, criterion, clock, progress)?;
    stored.estimate.check()?;
    let rel_error = stored.estimate.rel_error();
    if rel_error > MOST_REFERENCE_ERROR {
        return Err(ReportError::NoReference { rel_error }.into());
    }
    let summary = ReferenceSummary {
        file,
        aov: "caustic",
        visibility: reference.options().visibility,
        rel_error: stored.estimate.rel_error(),
        statistics: stored.estimate.statistics,
        seconds: stored.seconds,
    };
    Ok((summary, stored.estimate.irradiance))
}

fn mask(path: &Path, [expected_width, expected_height]: [u32; 2]) -> Result<Vec<bool>, Error> {
    let (width, height, mask) = read_mask(path)?;
    if (width, height) != (expected_width, expected_height) {
        return Err(ReportError::MaskSize { path: path.into(), width, height, expected_width, expected_height }.into());
    }
    if !mask.contains(&true) {
        return Err(ReportError::MaskEmpty { path: path.into() }.into());
    }
    Ok(mask)
}

impl Comparison {
    fn new(request: &Request, options: &Options, reference: ReferenceSummary, truth: Image) -> Self {
        Self {
            scene: request.scene.name.clone(),
            adapter: String::new(),
            made_with: Vec::new(),
            reference,
            rows: Vec::new(),
            unavailable: Vec::new(),
            findings: Vec::new(),
            reflectors: Vec::new(),
            sampling: Vec::new(),
            warnings: Vec::new(),
            exposure_ev: options.display.exposures(|| metered_ev(truth.pixels.iter().copied())).exposure_ev,
            pictures: vec![Picture { label: "reference".into(), image: truth, flip: None, dots: None, row: None }],
            size: options.size,
        }
    }

    fn add(&mut self, cell: Cell, truth: &Image, mask: Option<&[bool]>, shown: bool) {
        let (row, map) = measure(&cell, truth, mask, self.exposure_ev);
        if shown {
            self.pictures.push(Picture {
                label: row.label(),
                image: cell.image,
                flip: Some(map.values),
                dots: Some(cell.metadata.dots.clone()),
                row: Some(self.rows.len()),
            });
        }
        if self.rows.is_empty() {
            self.adapter = cell.metadata.adapter.clone().unwrap_or_else(|| cell.metadata.backend.clone());
            self.made_with = page::made_with(&cell.metadata);
        }
        for warning in cell.metadata.warnings {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
        self.rows.push(row);
    }

    fn assess_strategies(&mut self, request: &Request, progress: &dyn Progress) -> Result<(), Error> {
        let has_samples = request.plan.techniques.contains(&Technique::Pinhole);
        let strategies = if has_samples { &request.plan.strategies[..] } else { &[] };
        progress.begin(Stage::Quality, (strategies.len() * (TestSurface::ALL.len() + 1)) as u64);
        let seed = request.options.seed;
        let reflectors = Surface::of_scene(&request.scene);
        let samples = request.plan.samples.iter().copied().max().unwrap_or(1000).min(4000);
        for &strategy in strategies {
            let options = crate::sampling::Options { samples, strategy, seed };
            self.reflectors
                .push((strategy, strategy_statistics(&reflectors, None, &options, request.plan.seeds)?.quality));
            progress.advance(1);
            let options = crate::sampling::Options { samples: STUDY_POINTS, ..options };
            for surface in TestSurface::ALL {
                let (mesh, parameterization) = surface.surface();
                let statistics = strategy_statistics(&mesh, Some(&parameterization), &options, SETS_PER_STRATEGY)?;
                self.sampling.push(TestSurfaceResult { surface, strategy, statistics });
                progress.advance(1);
            }
        }
        progress.end(Stage::Quality);
        Ok(())
    }

    /// Writes report.json, report.csv and report.html.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        let json = serde_json::to_string_pretty(self).expect("a report is plain data");
        write_text(&folder.join("report.json"), &json)?;
        write_text(&folder.join("report.csv"), &self.csv())?;
        write_text(&folder.join("report.html"), &page::html(self))
    }

    fn csv(&self) -> String {
        let mut writer = csv::Writer::from_writer(Vec::new());
        self.rows.iter().for_each(|row| writer.serialize(row).expect("rows are flat"));
        String::from_utf8(writer.into_inner().expect("memory can be written to")).expect("rows are text")
    }
}

fn write_text(path: &Path, text: &str) -> Result<(), Error> {
    use std::io::Write;
    let written: Result<(), ImageError> =
        write_atomically(path, |out| out.write_all(text.as_bytes()).map_err(|e| e.to_string()));
    Ok(written?)
}
