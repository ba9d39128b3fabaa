//! The engine turns a scene, options and a back end into pictures and a report. It keeps all intermediate results, so
//! that after an edit only those are made again that depend on it.
//!
//! ```text
//! device ─► scene ─► light ─► samples, tree, visibility ─► camera rays ─► light on surfaces ─► shading ─► display
//! ```
//!
//! Every stage compares the inputs that it was made from with the current ones. Nothing has to be invalidated by hand:
//! change the scene or the options in any way, and render. The picture equals that of a new engine.

mod caustic;
mod direct;
mod edges;
mod ends;
mod escapes;
mod every_other;
mod film;
mod frame;
mod gloss;
mod glossy;
mod inspection;
mod interpolation;
mod lost_light;
mod overlay;
mod paths;
mod preview;
mod ray_batches;
mod report;
mod reprojection;
mod scattering;
mod shading;
mod shadows;

pub use crate::pinhole::cpu::TakenCell;
pub use film::Rendered;
pub use inspection::{Inspection, MAX_FOOTPRINTS, MapFootprint, ReceiverInspection};
pub use overlay::{LineKind, Mark};
#[cfg(feature = "gpu")]
pub use preview::PassTime;
#[cfg(all(test, feature = "gpu"))]
pub use preview::on_gpu::layout as preview_layout;
pub use preview::{Budget, Detail, Preview};
pub use report::Report;

use crate::boxed::BoxFuture;
use crate::error::check_wanted;
use std::sync::Arc;

use glam::{UVec2, Vec2};

use self::film::Film;
use self::frame::{BandStages, FrameInputs, rows_per_band};
use self::lost_light::LostLight;
use self::overlay::Marker;
use self::preview::{LightAtRest, PreviewStages};
#[cfg(feature = "gpu")]
use self::ray_batches::{RayBatches, on_gpu::RaysOnGpu};
use crate::backend::Backend;
use crate::image::Aov;
use crate::options::{Exposure, Exposures, Options, Overlay};
use crate::progress::Progress;
#[cfg(feature = "gpu")]
use crate::scene::Visibility;
use crate::scene::{Chain, Chains, Scene};
use crate::stages::{LightStages, PreparedLight, PreparedScene, SceneStages, StageCounts};
use crate::technique::{Inputs, Sum, Technique, TechniqueStages};
use crate::{Error, OptionError};
#[cfg(feature = "gpu")]
use crate::{gpu::GpuError, pinhole::gpu::Geometry};

/// Renders pictures of a scene, and keeps intermediate results for the next one.
///
/// ```
/// use pinspot::{Backend, Engine, NoProgress, Stage, blocking};
///
/// let (scene, options) = pinspot::load("mirror-sphere")?;
/// let backend = Backend::cpu();
/// let mut engine = Engine::new(scene, options.with_size([32, 32]).with_samples(50), backend.clone());
/// let first = blocking::wait(backend.device(), engine.render(&NoProgress))?;
/// assert_eq!(first.layers[0].1.pixels.len(), 32 * 32);
///
/// // Only the display is made again.
/// let before = engine.stage_counts();
/// engine.options_mut().display.exposure = pinspot::Exposure::Stops(1.0);
/// blocking::wait(backend.device(), engine.render(&NoProgress))?;
/// assert_eq!(engine.stage_counts().made_since(&before), [Stage::Display]);
/// # Ok::<(), pinspot::Error>(())
/// ```
#[derive(Debug)]
pub struct Engine {
    scene: Scene,
    options: Options,
    backend: Backend,
    scene_stages: SceneStages,
    light_stages: LightStages,
    /// Stages of the technique that was used last.
    technique: (Technique, Box<dyn TechniqueStages>),
    /// Stages of the chains whose light is shown alone.
    of_chains: Vec<(Chain, Box<dyn TechniqueStages>)>,
    /// Stages of the picture, if it is small enough to be kept.
    band: BandStages,
    /// The light of the last whole picture, for previews.
    at_rest: Option<LightAtRest>,
    /// Stages of previews.
    preview: PreviewStages,
    /// Those of what is inspected.
    inspection: PreviewStages,
    /// Counts of stages that were dropped.
    counted_before: StageCounts,
    /// Set once the CPU has taken over from a GPU.
    fell_back: Option<FellBack>,
}

/// The CPU renders where a GPU could not.
#[derive(Debug)]
struct FellBack {
    /// One sentence.
    reason: String,
    /// What was asked for. Fingerprints stay those of it, so that the frames of a sequence are found again.
    from: Backend,
}

/// The inputs of a picture.
struct Prepared {
    scene: PreparedScene,
    light: PreparedLight,
    /// The sum of all chains, or of the only one that is shown; `None` if no caustics are.
    sum: Option<Arc<dyn Sum>>,
    /// The sums of the chains that are shown alone, as far as anything casts such a caustic.
    of_chains: Vec<(Chain, Arc<dyn Sum>)>,
}

impl Engine {
    /// A new engine. Nothing is prepared until the first picture.
    pub fn new(scene: Scene, options: Options, backend: Backend) -> Self {
        let technique = (options.technique, options.technique.stages());
        Self {
            scene,
            options,
            backend,
            scene_stages: SceneStages::new(),
            light_stages: LightStages::new(),
            technique,
            of_chains: Vec::new(),
            band: BandStages::new(),
            at_rest: None,
            preview: PreviewStages::new(Technique::default()),
            inspection: PreviewStages::new(Technique::default()),
            counted_before: StageCounts::default(),
            fell_back: None,
        }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The scene, for editing: move the camera or an object, replace a mesh, rotate, scale or replace the light.
    pub fn scene_mut(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The options, for editing. [`Self::render`] checks them.
    pub fn options_mut(&mut self) -> &mut Options {
        &mut self.options
    }

    /// The back end that computes the sums.
    pub fn backend(&self) -> &Backend {
        &self.backend
    }

    /// A hash of everything that the picture depends on but the code: scene, options and back end. Together with a name of the code it
    /// identifies pictures in files.
    pub fn fingerprint(&self) -> String {
        let backend = self.fell_back.as_ref().map_or(&self.backend, |fell_back| &fell_back.from);
        self.scene.fingerprint(&format!("{:?} {:?}", self.options, backend.report()))
    }

    /// How often each stage was made, except for those of previews alone.
    pub fn stage_counts(&self) -> StageCounts {
        let mut counts = self.counted_before.clone();
        self.scene_stages.count(&mut counts);
        self.light_stages.count(&mut counts);
        self.technique.1.count(&mut counts);
        self.of_chains.iter().for_each(|(_, stages)| stages.count(&mut counts));
        self.band.count(&mut counts);
        counts
    }

    /// Renders all pictures that the options ask for. On the CPU the future is ready when it is first polled; on a GPU
    /// the device has to be polled until it completes, by an event loop or by `blocking::wait`.
    ///
    /// ```
    /// use pinspot::{Backend, Engine, NoProgress, blocking, image};
    ///
    /// # fn main() -> Result<(), pinspot::Error> {
    /// # let folder = tempfile::tempdir().unwrap();
    /// # let folder = folder.path();
    /// let (scene, options) = pinspot::load("ring")?;
    /// let mut engine = Engine::new(scene, options.with_size([32, 32]).with_samples(50), Backend::cpu());
    /// let rendered = blocking::wait(None, engine.render(&NoProgress))?;
    /// image::write_png(&folder.join("ring.png"), &rendered.displayed(&engine.options().display))?;
    ///
    /// // Only what depends on the camera is made again.
    /// engine.scene_mut().camera.position.y += 0.1;
    /// blocking::wait(None, engine.render(&NoProgress))?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Options out of range or in conflict, a light that cannot be prepared, a scene without reflectors, a device that is lost or
    /// too small, or [`Error::Cancelled`]. The engine stays usable: correct the cause and render again. Where a device has too little memory,
    /// the CPU renders this picture and those after it, and their reports say so.
    pub fn render<'a>(&'a mut self, progress: &'a dyn Progress) -> BoxFuture<'a, Result<Rendered, Error>> {
        Box::pin(async move {
            let picture = self.picture(progress).await;
            #[cfg(feature = "gpu")]
            if let Err(Error::Gpu(GpuError::OutOfMemory { adapter })) = &picture {
                self.fall_back(adapter);
                return self.picture(progress).await;
            }
            picture
        })
    }

    /// Renders on the CPU from now on.
    #[cfg(feature = "gpu")]
    fn fall_back(&mut self, adapter: &str) {
        let reason = format!("adapter '{adapter}' has too little memory for this scene, which the CPU renders instead");
        let counted_before = self.stage_counts();
        let (scene, options) = (self.scene.clone(), self.options.clone());
        let fell_back = Some(FellBack { reason, from: self.backend.clone() });
        *self = Self { counted_before, fell_back, ..Self::new(scene, options, Backend::cpu()) };
    }

    /// [`Self::render`] on the current back end.
    fn picture<'a>(&'a mut self, progress: &'a dyn Progress) -> BoxFuture<'a, Result<Rendered, Error>> {
        Box::pin(async move {
            let prepared = self.prepare(progress).await?;
            #[cfg(feature = "gpu")]
            let shared = self.backend.shared_gpu().cloned();
            #[cfg(feature = "gpu")]
            let on_gpu = shared.as_deref().and_then(|shared| RaysOnGpu::new(shared, &prepared.scene, progress));
            let mut inputs = FrameInputs {
                scene: &self.scene,
                prepared: &prepared.scene,
                light: &prepared.light,
                options: &self.options,
                display: self.options.display,
                sum: prepared.sum.as_ref(),
                of_chains: &prepared.of_chains,
                #[cfg(feature = "gpu")]
                batches: on_gpu.as_ref().map(|rays| rays as &dyn RayBatches),
                #[cfg(not(feature = "gpu"))]
                batches: None,
                progress,
            };
            let mut film = Film::new(&self.options);
            let (mut fetches, mut exposures) = (0.0, None);
            let (height, rows_per_band) = (self.options.size[1], rows_per_band(&self.options));
            if rows_per_band < height && inputs.display.exposure == Exposure::Auto {
                let metered = meter(&inputs, &mut self.light_stages, &mut self.counted_before).await?;
                inputs.display.exposure = metered.map_or(Exposure::Auto, |e| Exposure::Stops(e.exposure_ev));
            }
            for first_row in (0..height).step_by(rows_per_band as usize) {
                let rows = rows_per_band.min(height - first_row);
                let band = self.band.render(&inputs, &mut self.light_stages, (first_row, rows)).await?;
                fetches += band.fetches;
                exposures = band.beauty.as_ref().map(|beauty| beauty.displayed.exposures);
                film.add(&inputs, &band);
                if let Some(beauty) = band.beauty.as_ref().filter(|_| rows == height) {
                    let is_known =
                        |object| [Aov::Direct, Aov::Caustic].iter().all(|aov| inputs.shows_irradiance(*aov, object));
                    let is_known = inputs.objects().map(is_known).collect();
                    let picture = (&self.scene, &self.options);
                    self.at_rest = Some(LightAtRest::new(picture, (&band.rays, &band.light), &beauty.paths, is_known));
                }
                if rows < height {
                    // Too large a picture to be kept.
                    self.band.count(&mut self.counted_before);
                    self.band = BandStages::new();
                }
            }
            let marks = self.marks_of(&prepared, progress)?;
            let pixels = f64::from(self.options.size[0]) * f64::from(height);
            let lost = self.lost_light(&prepared);
            let report = Report::new(self, &prepared, fetches / pixels, (exposures, lost));
            Ok(film.finish(&self.options.aovs, &marks, report))
        })
    }

    /// What pinholes leave out; photons keep an account of their own.
    fn lost_light(&self, prepared: &Prepared) -> LostLight {
        match self.options.technique {
            Technique::Pinhole if prepared.sum.is_some() => {
                LostLight::new(&self.scene, &prepared.scene, &prepared.light)
            }
            _ => LostLight::default(),
        }
    }

    /// The positions of the samples that the camera sees, in pixels from the picture's top left corner; empty if no
    /// caustics are requested.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn visible_samples<'a>(&'a mut self, progress: &'a dyn Progress) -> BoxFuture<'a, Result<Vec<Vec2>, Error>> {
        Box::pin(async move {
            let prepared = self.prepare(progress).await?;
            let Some(sum) = &prepared.sum else { return Ok(Vec::new()) };
            Ok(self.marker(&prepared).dots(&sum.statistics().positions))
        })
    }

    /// The marks of the overlay that the options ask for; none if no caustics are requested.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn marks<'a>(&'a mut self, progress: &'a dyn Progress) -> BoxFuture<'a, Result<Vec<Mark>, Error>> {
        Box::pin(async move {
            if self.options.overlay == Overlay::None {
                return Ok(Vec::new());
            }
            let prepared = self.prepare(progress).await?;
            self.marks_of(&prepared, progress)
        })
    }

    /// The object that the camera sees at a place in the picture, as fractions of its width and height.
    pub fn object_at(&mut self, place: Vec2) -> Option<usize> {
        let scene = self.scene_stages.prepare_for_frame(&self.scene, &crate::NoProgress).ok()?;
        let size = UVec2::from_array(self.options.size).as_vec2();
        let hit = scene.camera.hit(self.scene.camera.ray(place * size, size))?;
        Some(hit.object as usize)
    }

    async fn prepare(&mut self, progress: &dyn Progress) -> Result<Prepared, Error> {
        self.options.check()?;
        self.check_medium()?;
        self.check_chains()?;
        #[cfg(feature = "gpu")]
        self.backend.check()?;
        #[cfg_attr(not(feature = "gpu"), expect(unused_mut, reason = "only a GPU has copies"))]
        let mut scene = self.scene_stages.prepare(&self.scene, progress)?;
        #[cfg(feature = "gpu")]
        if let Some(shared) = self.backend.shared_gpu() {
            let uploaded = self.scene_stages.upload(&self.scene, &shared.gpu, false, progress);
            scene.on_gpu = on_gpu_if_needed(uploaded, self.options.visibility)?;
        }
        let light = {
            let geometry = scene.drawn_geometry();
            let light = self.light_stages.prepare(&self.scene, geometry.as_ref(), self.options.cube_size, progress)?;
            light.with_near(scene.near_emitters.as_ref())
        };
        if self.technique.0 != self.options.technique {
            self.technique.1.count(&mut self.counted_before);
            self.technique = (self.options.technique, self.options.technique.stages());
            self.of_chains.drain(..).for_each(|(_, stages)| stages.count(&mut self.counted_before));
        }
        check_wanted(progress)?;
        let inputs = Inputs {
            scene: &self.scene,
            prepared: &scene,
            light: &light,
            options: &self.options,
            backend: &self.backend,
            chains: Chains::ALL,
            is_preview: false,
            progress,
        };
        let chains = || self.options.aovs.iter().filter_map(|aov| aov.chain());
        let is_cast = |chain: &Chain| self.scene.objects.iter().any(|object| object.casts(*chain));
        let cast: Vec<Chain> = chains().filter(is_cast).collect();
        let shows_all = self.options.shows_caustic() || self.options.aovs.contains(&Aov::Scattered);
        // A report needs one sum: that of the only chain that is shown, or of all of them.
        let is_all_needed = shows_all || chains().next().is_some() && cast.len() != 1;
        let mut sum = None;
        if is_all_needed {
            sum = Some(self.technique.1.prepare(inputs, &mut self.light_stages).await?);
        }
        let mut of_chains = Vec::new();
        for chain in cast {
            let stages = stages_of(&mut self.of_chains, chain, self.technique.0);
            let inputs = Inputs { chains: chain.into(), ..inputs };
            let own = stages.prepare(inputs, &mut self.light_stages).await?;
            sum.get_or_insert_with(|| own.clone());
            of_chains.push((chain, own));
        }
        check_wanted(progress)?;
        Ok(Prepared { scene, light, sum, of_chains })
    }

    /// Pictures of a chain need a technique that computes it.
    fn check_chains(&self) -> Result<(), OptionError> {
        let technique = self.options.technique;
        let chains = technique.chains(&self.scene);
        let is_unknown = |aov: &&Aov| aov.chain().is_some_and(|chain| !chains.contains(chain));
        let Some(aov) = self.options.aovs.iter().find(is_unknown) else { return Ok(()) };
        let message = format!(
            "is {}, but the technique {technique} computes {chains} only; choose image-space, which follows light through closed objects",
            aov.name()
        );
        Err(OptionError::invalid("aov", message))
    }

    /// Pictures of scattered light need a medium.
    fn check_medium(&self) -> Result<(), OptionError> {
        self.scene.check_medium()?;
        let is_shown = |aov: &&Aov| matches!(aov, Aov::Scattered | Aov::ScatteredDirect);
        let Some(aov) = self.options.aovs.iter().find(is_shown) else { return Ok(()) };
        if self.scene.medium.is_some_and(|medium| medium.scatters()) {
            return Ok(());
        }
        let message =
            format!("is {}, but nothing in the scene scatters light: give it a [medium] with sigma_s", aov.name());
        Err(OptionError::invalid("aov", message))
    }

    fn marks_of(&mut self, prepared: &Prepared, progress: &dyn Progress) -> Result<Vec<Mark>, Error> {
        let Some(sum) = prepared.sum.as_ref().filter(|_| self.options.overlay != Overlay::None) else {
            return Ok(Vec::new());
        };
        if matches!(self.options.overlay, Overlay::Samples | Overlay::Photons) {
            let dots = self.marker(prepared).dots(&sum.statistics().positions);
            return Ok(dots.into_iter().map(Mark::Dot).collect());
        }
        if self.options.overlay == Overlay::CausticMap {
            return Ok(sum.caustic_map().map_or_else(Vec::new, |map| self.marker(prepared).corner(&map)));
        }
        let samples = self.technique.1.surface_samples(&Inputs {
            scene: &self.scene,
            prepared: &prepared.scene,
            light: &prepared.light,
            options: &self.options,
            backend: &self.backend,
            chains: Chains::ALL,
            is_preview: false,
            progress,
        })?;
        Ok(self.marker(prepared).marks(self.options.overlay, &samples))
    }

    fn marker<'a>(&'a self, prepared: &'a Prepared) -> Marker<'a> {
        let size = UVec2::from_array(self.options.size).as_vec2();
        Marker { scene: &self.scene, tracer: &prepared.scene.camera, size }
    }
}

/// The stages of a chain that is shown alone.
fn stages_of(
    all: &mut Vec<(Chain, Box<dyn TechniqueStages>)>,
    chain: Chain,
    technique: Technique,
) -> &mut dyn TechniqueStages {
    let index = all.iter().position(|(known, _)| *known == chain).unwrap_or_else(|| {
        all.push((chain, technique.stages()));
        all.len() - 1
    });
    &mut *all[index].1
}

/// A scene's triangles on a GPU. If there are too many of them, the CPU traces all rays, as long as it need not do that for the sums.
#[cfg(feature = "gpu")]
fn on_gpu_if_needed(
    uploaded: Result<Arc<Geometry>, GpuError>,
    visibility: Visibility,
) -> Result<Option<Arc<Geometry>>, GpuError> {
    match uploaded {
        Err(GpuError::TooManyTriangles { .. }) if visibility == Visibility::None => Ok(None),
        uploaded => uploaded.map(Some),
    }
}

/// The longest edge of the picture that is metered in place of one that is rendered band by band, pixels.
const METERED_SIZE: u32 = 512;

/// The exposures of a small picture of the same scene; `None` if there is no beauty picture to display.
async fn meter(
    inputs: &FrameInputs<'_>,
    light: &mut LightStages,
    counts: &mut StageCounts,
) -> Result<Option<Exposures>, Error> {
    if !inputs.options.aovs.contains(&Aov::Beauty) {
        return Ok(None);
    }
    let size = inputs.options.size_within(METERED_SIZE);
    let options = inputs.options.clone().with_size(size).with_pixel_samples(1).with_aovs(vec![Aov::Beauty]);
    let mut stages = BandStages::new();
    let band = stages.render(&FrameInputs { options: &options, ..*inputs }, light, (0, size[1])).await?;
    stages.count(counts);
    Ok(band.beauty.map(|beauty| beauty.displayed.exposures))
}
