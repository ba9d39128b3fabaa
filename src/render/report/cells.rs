//! One combination, rendered, and kept in a file so that a long comparison survives an interruption.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde::{Deserialize, Serialize};

use crate::image::{Aov, Image, read_exr, read_exr_text, write_exr_with_text};
use crate::image_space::ImageSpaceOptions;
use crate::options::{Evaluation, EvaluationChoice, Options};
use crate::pinhole::Filter;
use crate::progress::Progress;
use crate::progress::Stage;
use crate::sampling::Density;
use crate::technique::{PhotonStatistics, Technique};
use crate::{Engine, Error};

const FINGERPRINT: &str = "pinspot.fingerprint";
const METADATA: &str = "pinspot.metadata";

/// A rendered combination.
pub(super) struct Cell {
    pub options: Options,
    /// The caustic, W/m².
    pub image: Image,
    pub metadata: Metadata,
    pub file: PathBuf,
}

/// What is known of a cell beside its picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Metadata {
    /// How the samples were summed, `flat` or `hierarchical`, or how photons became irradiance.
    pub mode: String,
    /// How the environment was looked up.
    pub filter: Option<Filter>,
    pub samples_used: usize,
    /// Cells that each sample was split into at most.
    pub leaves: Option<u32>,
    /// What became of photons.
    pub photons: Option<PhotonStatistics>,
    /// Placing the samples, their differentials or their tree, what they see, and the gather.
    pub seconds: f64,
    /// Mean fetches per pixel.
    pub lookups: f64,
    /// The back end, in words.
    pub backend: String,
    /// The adapter, in words; `None` on the CPU.
    pub adapter: Option<String>,
    /// Where the samples appear, pixels.
    pub dots: Vec<[f32; 2]>,
    pub warnings: Vec<String>,
}

/// Where finished combinations are kept, and which of them count.
#[derive(Clone, Copy)]
pub(super) struct Folder<'a> {
    pub path: &'a Path,
    /// Names the code that renders; what other code rendered does not count.
    pub code: &'a str,
    /// Nothing counts that is there already.
    pub is_ignored: bool,
}

/// Reads a combination from its file in `folder`, or renders it and writes that file.
pub(super) async fn render_or_reuse(
    engine: &mut Engine,
    options: &Options,
    folder: Folder<'_>,
    timed: &Timed<'_>,
) -> Result<Cell, Error> {
    engine.options_mut().clone_from(options);
    let fingerprint = format!("{}-{}", folder.code, engine.fingerprint());
    let file = folder.path.join(format!("{}.exr", name(options)));
    let known = if folder.is_ignored { None } else { read(&file, &fingerprint) };
    if let Some((image, metadata)) = known {
        return Ok(Cell { options: options.clone(), image, metadata, file });
    }
    let rendered = engine.render(timed).await?;
    let seconds = timed.seconds();
    let dots = engine.visible_samples(timed).await?;
    let report = rendered.report;
    let of_photons = report.photons.map(|photons| photons.mode.name());
    let mode = report.evaluation.map(Evaluation::mode).or(of_photons).expect("the caustic was asked for");
    let metadata = Metadata {
        mode: mode.to_owned(),
        filter: report.filter,
        samples_used: report.samples,
        leaves: report.evaluation.map(Evaluation::leaves),
        photons: report.photons,
        seconds,
        lookups: report.lookups,
        backend: report.backend.to_string(),
        adapter: report.backend.adapter(),
        dots: dots.into_iter().map(Into::into).collect(),
        warnings: report.warnings,
    };
    let (_, image) = rendered.layers.into_iter().find(|(aov, _)| *aov == Aov::Caustic).expect("it was asked for");
    let text = serde_json::to_string(&metadata).expect("metadata are plain data");
    let texts = [(FINGERPRINT, fingerprint), (METADATA, text)];
    write_exr_with_text(&file, &[("", &image)], &texts)?;
    Ok(Cell { options: options.clone(), image, metadata, file })
}

/// Anything that is not exactly this cell is rendered again.
fn read(file: &Path, fingerprint: &str) -> Option<(Image, Metadata)> {
    let text = |name| read_exr_text(file, name).ok().flatten();
    if !file.exists() || text(FINGERPRINT)? != fingerprint {
        return None;
    }
    Some((read_exr(file, "").ok()?, serde_json::from_str(&text(METADATA)?).ok()?))
}

fn name(options: &Options) -> String {
    if options.technique == Technique::ImageSpace {
        let ImageSpaceOptions { mode, photons, lights, .. } = options.image_space;
        return format!("image-space-{}-{photons}-lights{lights}-seed{}", mode.name(), options.seed);
    }
    let Options { strategy, density, footprint, samples, seed, .. } = options;
    let filter = options.filter.name();
    let strategy = match density {
        Density::Uniform => strategy.name().to_owned(),
        density => format!("{}-by-{}", strategy.name(), density.name()),
    };
    let evaluation = match options.evaluation {
        EvaluationChoice::Flat => "",
        other => &format!("-{}", other.name()),
    };
    format!("{strategy}-{}-{filter}{evaluation}-{samples}-seed{seed}", footprint.name())
}

/// Seconds since some moment; the library itself reads no clock.
pub type Clock<'a> = &'a (dyn Fn() -> f64 + Sync);

/// Passes progress on, and adds up the seconds of a technique's own stages: placing the samples, their differentials or their
/// tree, what they see, and the sum.
pub(super) struct Timed<'a> {
    clock: Clock<'a>,
    progress: &'a dyn Progress,
    state: Mutex<TimedState>,
}

#[derive(Default)]
struct TimedState {
    began: f64,
    seconds: f64,
}

impl<'a> Timed<'a> {
    pub fn new(clock: Clock<'a>, progress: &'a dyn Progress) -> Self {
        Self { clock, progress, state: Mutex::default() }
    }

    fn seconds(&self) -> f64 {
        self.state.lock().expect("no panic holds the lock").seconds
    }
}

impl Progress for Timed<'_> {
    fn begin(&self, stage: Stage, total: u64) {
        self.state.lock().expect("no panic holds the lock").began = (self.clock)();
        self.progress.begin(stage, total);
    }

    fn advance(&self, steps: u64) {
        self.progress.advance(steps);
    }

    fn end(&self, stage: Stage) {
        use Stage::{Caustic, Differentials, Photons, Points, Tree, Visibility};
        if matches!(stage, Points | Differentials | Tree | Visibility | Photons | Caustic) {
            let mut state = self.state.lock().expect("no panic holds the lock");
            state.seconds += (self.clock)() - state.began;
        }
        self.progress.end(stage);
    }
}
