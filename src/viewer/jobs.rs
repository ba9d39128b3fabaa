//! Long work that ends in files: a whole picture, or the frames of the animation. Knows the engine, but not the window.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use super::stopwatch::Stopwatch;
use crate::blocking::wait_sharing as wait;
use crate::image::{write_exr, write_png};
use crate::scene::Scene;
use crate::{Backend, Engine, Error, Sequence, SequenceReport};
use pinspot_render::options::Options;

/// What to write.
#[derive(Clone, Debug)]
pub enum Job {
    /// One picture: .png or .exr.
    Picture { scene: Box<Scene>, options: Box<Options>, path: PathBuf },
    /// The frames of the animation.
    Frames { scene: Box<Scene>, options: Box<Options>, sequence: Sequence },
}

/// How far a job is.
#[derive(Clone, Debug, PartialEq)]
pub enum JobProgress {
    /// The part that is done, from 0 to 1.
    Running(f32),
    /// What was written, in words.
    Done(String),
    /// It was stopped.
    Stopped,
    /// Why it failed.
    Failed(String),
}

/// Does a job with an engine of its own.
pub fn run_job(job: Job, backend: &Backend, is_aborted: &AtomicBool, tell: &dyn Fn(JobProgress)) {
    tell(JobProgress::Running(0.0));
    let watch = Stopwatch::new(Some(is_aborted));
    let result = match job {
        Job::Picture { scene, options, path } => picture(backend, *scene, *options, &path, &watch),
        Job::Frames { scene, options, sequence } => frames(backend, *scene, *options, &sequence, (&watch, tell)),
    };
    tell(match result {
        Ok(written) => JobProgress::Done(written),
        Err(Error::Cancelled) => JobProgress::Stopped,
        Err(error) => JobProgress::Failed(error.to_string()),
    });
}

fn picture(
    backend: &Backend,
    scene: Scene,
    options: Options,
    path: &std::path::Path,
    watch: &Stopwatch,
) -> Result<String, Error> {
    let mut engine = Engine::new(scene, options, backend.clone());
    let rendered = wait(backend.device(), engine.render(watch))?;
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
        let layers: Vec<_> = rendered.layers.iter().map(|(aov, image)| (aov.name(), image)).collect();
        write_exr(path, &layers)?;
    } else {
        write_png(path, &rendered.displayed(&engine.options().display))?;
    }
    Ok(format!("wrote {}", path.display()))
}

fn frames(
    backend: &Backend,
    scene: Scene,
    options: Options,
    sequence: &Sequence,
    (watch, tell): (&Stopwatch, &dyn Fn(JobProgress)),
) -> Result<String, Error> {
    let count = sequence.frames().len().max(1) as f32;
    let mut report = |done: &SequenceReport| tell(JobProgress::Running((done.rendered + done.kept) as f32 / count));
    let report =
        wait(backend.device(), sequence.render(scene, options, backend, crate::code_id(), watch, &mut report))?;
    Ok(format!("wrote {} frames; {} were there already", report.rendered, report.kept))
}
