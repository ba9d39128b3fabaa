//! The frames of an animation, rendered into numbered files or one animated picture. Frames that are complete in their files are not
//! rendered again, so that an interrupted sequence goes on.

use std::io::BufWriter;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::boxed::BoxFuture;
use crate::image::{
    AnimatedPng, AtomicFile, ImageError, numbered, read_exr_text, read_png_text, write_exr_with_text,
    write_png_with_text,
};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::{Backend, Engine, Error, Exposure, Options, Rendered};

/// The names of texts in the files.
const FINGERPRINT: &str = "pinspot-fingerprint";
const EXPOSURE: &str = "pinspot-exposure-ev";

/// Frames, and the files that they go to.
///
/// ```
/// use pinspot::{Backend, NoProgress, Sequence, blocking};
///
/// # fn main() -> Result<(), pinspot::Error> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let folder = folder.path();
/// let outputs = vec![folder.join("ring-####.png"), folder.join("ring.apng")];
/// let sequence = Sequence::new(0..3, 12, outputs)?;
/// let (scene, options) = pinspot::load("ring")?;
/// let options = options.with_size([16, 16]).with_samples(20);
/// let backend = Backend::cpu();
/// let mut ignore = |_: &_| ();
/// let rendering = sequence.render(scene, options, &backend, pinspot::code_id(), &NoProgress, &mut ignore);
/// let report = blocking::wait(None, rendering)?;
/// assert_eq!((report.rendered, report.kept), (3, 0));
/// assert!(folder.join("ring-0002.png").exists());
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Sequence {
    frames: Range<u32>,
    frames_per_second: u16,
    outputs: Vec<PathBuf>,
}

/// What was rendered.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SequenceReport {
    /// The scene's name.
    pub scene: String,
    /// The first frame.
    pub first_frame: u32,
    /// The frame after the last one.
    pub end_frame: u32,
    /// Frames per second of the animation.
    pub frames_per_second: u16,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Frames that were rendered.
    pub rendered: u32,
    /// Frames that were complete in their files.
    pub kept: u32,
    /// One sentence each.
    pub warnings: Vec<String>,
}

fn is_animated(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("apng"))
}

fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
}

fn is_png(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
}

impl Sequence {
    /// Frame f shows the scene at f / `frames_per_second` seconds. Outputs are numbered .png and .exr files, such as
    /// `frame-####.png`, and one .apng at most, which holds all frames.
    ///
    /// # Errors
    /// Names that do not fit.
    pub fn new(frames: Range<u32>, frames_per_second: u16, outputs: Vec<PathBuf>) -> Result<Self, ImageError> {
        let refuse = |path: &Path, reason: &str| Err(ImageError::Name { path: path.into(), reason: reason.to_owned() });
        if frames.is_empty() {
            let path = outputs.first().map_or(Path::new(""), PathBuf::as_path);
            return refuse(path, "would have no frames: give a range such as 0..120");
        }
        for path in &outputs {
            if !(is_animated(path) || is_png(path) || is_exr(path)) {
                return refuse(path, "is of no format for frames: give a name that ends in .png, .exr or .apng");
            }
            match numbered(path, 0) {
                Some(_) if is_animated(path) => {
                    return refuse(path, "is one file for all frames: give a name without '#'");
                }
                None if !is_animated(path) => {
                    return refuse(
                        path,
                        "is one file for many frames: give a name such as frame-####.png, or an .apng",
                    );
                }
                _ => {}
            }
        }
        if let Some(second) = outputs.iter().filter(|path| is_animated(path)).nth(1) {
            return refuse(second, "would be the copy of another .apng; give one");
        }
        Ok(Self { frames, frames_per_second: frames_per_second.max(1), outputs })
    }

    /// The frames.
    pub fn frames(&self) -> Range<u32> {
        self.frames.clone()
    }

    /// The files of a frame.
    pub fn files(&self, frame: u32) -> Vec<PathBuf> {
        self.outputs.iter().filter_map(|path| numbered(path, frame)).collect()
    }

    /// The file of all frames, if there is one.
    pub fn animated_file(&self) -> Option<&Path> {
        self.outputs.iter().map(PathBuf::as_path).find(|path| is_animated(path))
    }

    /// Renders the frames that are not in their files yet; for an .apng, all of them. `code` names the code that renders: frames of
    /// other code are rendered again. An exposure that is automatic is metered on the first frame and kept. `report` is called after each
    /// frame.
    ///
    /// # Errors
    /// As [`Engine::render`], and files that cannot be written. Frames that are complete stay; an .apng is written whole or not at all.
    pub fn render<'a>(
        &'a self,
        scene: Scene,
        options: Options,
        backend: &'a Backend,
        code: &'a str,
        progress: &'a dyn Progress,
        report: &'a mut dyn FnMut(&SequenceReport),
    ) -> BoxFuture<'a, Result<SequenceReport, Error>> {
        Box::pin(async move {
            let still = || format!("nothing moves in scene '{}'; all frames are alike", scene.name);
            let first = SequenceReport {
                scene: scene.name.clone(),
                first_frame: self.frames.start,
                end_frame: self.frames.end,
                frames_per_second: self.frames_per_second,
                size: options.size,
                rendered: 0,
                kept: 0,
                warnings: if scene.animations.is_empty() { vec![still()] } else { Vec::new() },
            };
            let requested = options.display.exposure;
            let engine = Engine::new(scene, options, backend.clone());
            let mut renderer = FrameRenderer { sequence: self, engine, code, requested, report: first };
            renderer.render(progress, report).await?;
            Ok(renderer.report)
        })
    }
}

struct FrameRenderer<'a> {
    sequence: &'a Sequence,
    engine: Engine,
    /// Names the code that renders.
    code: &'a str,
    /// The exposure before it was metered.
    requested: Exposure,
    report: SequenceReport,
}

impl FrameRenderer<'_> {
    async fn render(&mut self, progress: &dyn Progress, report: &mut dyn FnMut(&SequenceReport)) -> Result<(), Error> {
        let Some(path) = self.sequence.animated_file() else {
            for frame in self.sequence.frames() {
                let files = self.sequence.files(frame);
                let fingerprint = self.pose(frame);
                if self.is_known(&files, &fingerprint) {
                    self.report.kept += 1;
                } else {
                    self.frame(&files, &fingerprint, progress).await?;
                }
                report(&self.report);
            }
            return Ok(());
        };
        let file = AtomicFile::create(path)?;
        let fail = |reason: String| ImageError::Write { path: path.into(), reason };
        let count = self.report.end_frame - self.report.first_frame;
        let out = BufWriter::new(file.file());
        let mut animation =
            AnimatedPng::new(out, self.report.size, count, self.report.frames_per_second).map_err(fail)?;
        for frame in self.sequence.frames() {
            let fingerprint = self.pose(frame);
            let rendered = self.frame(&self.sequence.files(frame), &fingerprint, progress).await?;
            animation.add(&rendered.displayed(&self.engine.options().display)).map_err(fail)?;
            report(&self.report);
        }
        animation.finish().map_err(fail)?;
        Ok(file.commit()?)
    }

    /// Moves the scene to where it is in a frame. Returns the frame's fingerprint, which also names the code, with the exposure as it was
    /// asked for: a metered one follows from the first frame.
    fn pose(&mut self, frame: u32) -> String {
        self.engine.scene_mut().pose(frame as f32 / f32::from(self.report.frames_per_second));
        let metered = std::mem::replace(&mut self.engine.options_mut().display.exposure, self.requested);
        let fingerprint = format!("{}-{}", self.code, self.engine.fingerprint());
        self.engine.options_mut().display.exposure = metered;
        match self.requested {
            Exposure::Auto => format!("{fingerprint}-{}", self.report.first_frame),
            Exposure::Stops(_) => fingerprint,
        }
    }

    /// Renders a frame and writes it.
    async fn frame(
        &mut self,
        files: &[PathBuf],
        fingerprint: &str,
        progress: &dyn Progress,
    ) -> Result<Rendered, Error> {
        let rendered = self.engine.render(progress).await?;
        self.keep_exposure(rendered.report.exposures.map(|used| used.exposure_ev));
        files.iter().try_for_each(|file| self.write(file, &rendered, fingerprint))?;
        for warning in &rendered.report.warnings {
            if !self.report.warnings.contains(warning) {
                self.report.warnings.push(warning.clone());
            }
        }
        self.report.rendered += 1;
        Ok(rendered)
    }

    /// Whether all files hold this frame. An exposure that was metered for it is taken over.
    fn is_known(&mut self, files: &[PathBuf], fingerprint: &str) -> bool {
        let text = |file: &PathBuf, name| {
            let text = if is_png(file) { read_png_text(file, name) } else { read_exr_text(file, name) };
            text.ok().flatten()
        };
        let is_known = |file: &PathBuf| file.is_file() && text(file, FINGERPRINT).as_deref() == Some(fingerprint);
        if files.is_empty() || !files.iter().all(is_known) {
            return false;
        }
        self.keep_exposure(text(&files[0], EXPOSURE).and_then(|stops| stops.parse().ok()));
        true
    }

    fn keep_exposure(&mut self, stops: Option<f32>) {
        let exposure = &mut self.engine.options_mut().display.exposure;
        if let (Exposure::Auto, Some(stops)) = (*exposure, stops) {
            *exposure = Exposure::Stops(stops);
        }
    }

    fn write(&self, path: &Path, rendered: &Rendered, fingerprint: &str) -> Result<(), ImageError> {
        let mut texts = vec![(FINGERPRINT, fingerprint.to_owned())];
        texts.extend(rendered.report.exposures.map(|used| (EXPOSURE, used.exposure_ev.to_string())));
        if is_png(path) {
            return write_png_with_text(path, &rendered.displayed(&self.engine.options().display), &texts);
        }
        let layers: Vec<_> = rendered.layers.iter().map(|(aov, image)| (aov.name(), image)).collect();
        write_exr_with_text(path, &layers, &texts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_do_not_fit_are_refused() {
        let message =
            |names: &[&str]| Sequence::new(0..2, 24, names.iter().map(Into::into).collect()).unwrap_err().to_string();
        assert!(message(&["a.png"]).contains("'a.png' is one file for many frames"));
        assert!(message(&["a-#.apng"]).contains("without '#'"));
        assert!(message(&["a-#.jpg"]).contains("ends in .png, .exr or .apng"));
        let nothing = Sequence::new(3..3, 24, vec!["a-#.png".into()]).unwrap_err();
        assert!(nothing.to_string().contains("no frames"));
        assert!(message(&["a.apng", "b.apng"]).contains("'b.apng' would be the copy"));
    }
}
