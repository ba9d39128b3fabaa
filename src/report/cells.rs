//! One combination, rendered, and kept in a file so that a long comparison survives an interruption.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::image::{Aov, Image, read_exr, read_exr_text, write_exr_with_text};
use crate::render::{BackendChoice, EvaluationChoice, Options, Renderer, Seconds};
use crate::sampling::Density;
use crate::scene::Scene;
use crate::{Error, Progress};

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
    pub samples_used: usize,
    /// Cells that each sample was split into at most.
    pub leaves: u32,
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

/// Reads a combination from its file in `folder`, or renders it and writes that file.
pub(super) fn render_or_reuse(
    scene: &Scene,
    options: &Options,
    backend: &BackendChoice,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Cell, Error> {
    let fingerprint = scene.fingerprint(&format!("{options:?} {backend:?}"))?;
    let file = folder.join(format!("{}.exr", name(options)));
    if let Some((image, metadata)) = read(&file, &fingerprint) {
        return Ok(Cell { options: options.clone(), image, metadata, file });
    }
    let renderer = Renderer::new(scene.clone(), options.clone(), backend, progress)?;
    let rendered = renderer.render(progress)?;
    let report = rendered.report;
    let seconds = {
        let Seconds { sampling, differentials, tree, visibility, gather, .. } = report.seconds;
        sampling + differentials + tree + visibility + gather
    };
    let metadata = Metadata {
        samples_used: report.samples,
        leaves: report.evaluation.leaves(),
        seconds,
        lookups: report.lookups,
        backend: report.backend.to_string(),
        adapter: report.backend.adapter().map(ToString::to_string),
        dots: renderer.visible_samples().into_iter().map(Into::into).collect(),
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
    let Options { strategy, density, footprint, samples, seed, .. } = options;
    let filter = options.params.filter.name();
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
