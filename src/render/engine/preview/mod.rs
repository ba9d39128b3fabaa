//! The preview: one picture a frame while things move. It takes the shared stages of the engine (scene, light) and a sum of few
//! samples, and computes light only at some pixels; between them it is interpolated along surfaces, so that edges stay sharp.
//!
//! ```text
//! scene, light, few samples ─► views (one ray a pixel, via mirrors) ─► light at nodes ─► light at all pixels ─► display
//!                          └─► light that a medium scatters, along a ray for every few pixels ─────────────────────┘
//! ```

mod at_rest;
mod budget;
mod edges;
mod gloss;
mod nodes;
#[cfg(feature = "gpu")]
pub(crate) mod on_gpu;
mod scattering;
mod shading;
mod views;

#[cfg(feature = "gpu")]
use std::sync::Arc;

use glam::{UVec2, Vec3, Vec4};
use rayon::prelude::*;

pub(super) use self::at_rest::LightAtRest;
pub use self::budget::{Budget, Detail};
use self::edges::smooth_edges;
use self::gloss::GlossyReceivers;
use self::nodes::NodeGrid;
#[cfg(feature = "gpu")]
pub use self::on_gpu::PassTime;
use self::scattering::{ScatteredGrid, ScatteredLight, SeenMedium, UnoccludedStage};
use self::views::{Layer, SurfacePoint, Views};
use super::Engine;
use super::direct::DirectLight;
use super::ends::POINTS_IN_A_ROW;
#[cfg(feature = "gpu")]
use super::on_gpu_if_needed;
use super::overlay::{Mark, Marker};
use crate::Error;
#[cfg(feature = "gpu")]
use crate::backend::Backend;
use crate::boxed::BoxFuture;
use crate::error::check_wanted;
use crate::image::{Aov, Image};
use crate::options::{Evaluation, EvaluationChoice, Exposures, Options, Overlay};
use crate::parallel;
use crate::pinhole::Receivers;
use crate::progress::{Progress, Stage};
use crate::scene::{Chains, Scene, Visibility};
use crate::stages::{LightStages, Memo, PreparedLight, PreparedScene};
use crate::technique::{Inputs, Sum, Technique, TechniqueStages};

/// Edge of the blocks of nodes whose shadows are found together, nodes.
const SHADOW_BLOCK: usize = 16;

/// A picture of the scene as it is at the moment: an [`Image`] or, on a GPU, a texture.
#[derive(Clone, Debug)]
pub struct Preview<T = Image> {
    /// An image is display-linear: exposed and tone-mapped. A texture is encoded as sRGB (`Rgba8Unorm`), and the next preview is drawn
    /// into it, too. The size is that of the [`Detail`].
    pub image: T,
    /// The exposures in use.
    pub exposures: Exposures,
    /// Samples in use.
    pub samples: usize,
    /// The overlay's marks, in pixels of a picture of the size of the options.
    pub marks: Vec<Mark>,
    /// How they are summed; `None` if no caustic is shown.
    pub evaluation: Option<Evaluation>,
    /// How long the passes took on the GPU, without those that trace visibility maps and draw emitters; empty on the CPU, and where the
    /// device has no timestamps.
    #[cfg(feature = "gpu")]
    pub passes: Vec<PassTime>,
}

impl<T> Preview<T> {
    /// The same with the picture as something else.
    pub fn map<U>(self, picture: impl FnOnce(T) -> U) -> Preview<U> {
        Preview {
            image: picture(self.image),
            exposures: self.exposures,
            samples: self.samples,
            marks: self.marks,
            evaluation: self.evaluation,
            #[cfg(feature = "gpu")]
            passes: self.passes,
        }
    }
}

/// Where a preview is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wanted {
    InMemory,
    #[cfg(feature = "gpu")]
    OnDevice,
}

/// A rendered preview.
enum Rendered {
    Image(Image),
    #[cfg(feature = "gpu")]
    Texture(wgpu::TextureView),
}

/// The stages of previews that are not shared with whole pictures, as these have more samples.
#[derive(Debug)]
pub(super) struct PreviewStages {
    pub technique: (Technique, Box<dyn TechniqueStages>),
    /// For scenes with emitters, which are drawn less finely; others share the light.
    pub light: LightStages,
    unoccluded: UnoccludedStage,
    /// The passes, once there was a preview on a GPU.
    #[cfg(feature = "gpu")]
    on_gpu: Option<on_gpu::PreviewOnGpu>,
    #[cfg(feature = "gpu")]
    lit: on_gpu::LitStages,
}

impl PreviewStages {
    pub fn new(technique: Technique) -> Self {
        Self {
            technique: (technique, technique.stages()),
            light: LightStages::for_frames(),
            unoccluded: Memo::new(Stage::Scattering),
            #[cfg(feature = "gpu")]
            on_gpu: None,
            #[cfg(feature = "gpu")]
            lit: on_gpu::LitStages::new(),
        }
    }
}

impl Engine {
    /// Renders a preview of the scene as it is now, within what a frame may spend.
    ///
    /// ```
    /// use pinspot::{Backend, Detail, Engine, NoProgress, blocking};
    ///
    /// let (scene, options) = pinspot::load("mirror-sphere")?;
    /// let mut engine = Engine::new(scene, options, Backend::cpu());
    /// let detail = Detail { size: [64, 64], samples: 40, taps: 8, spacing: 4, shadow_directions: 32, reuses_light: false };
    /// for seconds in [0.0, 0.1, 0.2] {
    ///     engine.scene_mut().pose(seconds);
    ///     let preview = blocking::wait(None, engine.preview(&detail, &NoProgress))?;
    ///     assert_eq!(preview.image.pixels.len(), 64 * 64);
    /// }
    /// # Ok::<(), pinspot::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn preview<'a>(
        &'a mut self,
        detail: &'a Detail,
        progress: &'a dyn Progress,
    ) -> BoxFuture<'a, Result<Preview, Error>> {
        Box::pin(async move {
            let preview = self.preview_as(Wanted::InMemory, detail, progress).await?;
            Ok(preview.map(|rendered| match rendered {
                Rendered::Image(image) => image,
                #[cfg(feature = "gpu")]
                Rendered::Texture(_) => unreachable!("an image was wanted"),
            }))
        })
    }

    /// Like [`Self::preview`], but the picture stays on the device of the engine's back end: nothing is read back. Returns when it is
    /// finished there. `None` where the CPU renders previews: if that is the back end, or if the device has no room for the picture.
    ///
    /// # Errors
    /// As [`Self::render`].
    #[cfg(feature = "gpu")]
    pub fn preview_on_device<'a>(
        &'a mut self,
        detail: &'a Detail,
        progress: &'a dyn Progress,
    ) -> BoxFuture<'a, Result<Option<Preview<wgpu::TextureView>>, Error>> {
        Box::pin(async move {
            if self.backend.device().is_none_or(|device| !on_gpu::fits(device, detail.size)) {
                return Ok(None);
            }
            let preview = self.preview_as(Wanted::OnDevice, detail, progress).await?;
            let Rendered::Texture(texture) = &preview.image else { return Ok(None) };
            let texture = texture.clone();
            Ok(Some(preview.map(|_| texture)))
        })
    }

    async fn preview_as(
        &mut self,
        wanted: Wanted,
        detail: &Detail,
        progress: &dyn Progress,
    ) -> Result<Preview<Rendered>, Error> {
        let options = self.preview_options(detail);
        options.check()?;
        #[cfg(feature = "gpu")]
        self.backend.check()?;
        let backend = self.backend.clone();
        #[cfg_attr(not(feature = "gpu"), expect(unused_mut, reason = "only a GPU has copies"))]
        let mut scene = self.scene_stages.prepare_for_frame(&self.scene, progress)?;
        #[cfg(feature = "gpu")]
        if let Some(shared) = backend.shared_gpu() {
            let uploaded = self.scene_stages.upload(&self.scene, &shared.gpu, true, progress);
            scene.on_gpu = on_gpu_if_needed(uploaded, options.visibility)?;
        }
        if self.preview.technique.0 != options.technique {
            self.preview = PreviewStages::new(options.technique);
        }
        let geometry = scene.geometry_drawn_for_frame(backend.is_gpu());
        let light_stages = if geometry.is_some() { &mut self.preview.light } else { &mut self.light_stages };
        #[cfg_attr(not(feature = "gpu"), expect(unused_mut, reason = "only a GPU has copies"))]
        let mut light = light_stages
            .prepare(&self.scene, geometry.as_ref(), options.cube_size, progress)?
            .with_near(scene.near_emitters.as_ref());
        #[cfg(feature = "gpu")]
        if let Some(shared) = backend.shared_gpu() {
            light.on_gpu = self.preview.lit.prepare(shared, (&self.scene, &scene), &light, progress)?;
        }
        let inputs = Inputs {
            scene: &self.scene,
            prepared: &scene,
            light: &light,
            options: &options,
            backend: &backend,
            chains: Chains::ALL,
            is_preview: true,
            progress,
        };
        let sum = if options.shows_caustic() {
            Some(self.preview.technique.1.prepare(inputs, light_stages).await?)
        } else {
            None
        };
        let is_shadowed = options.visibility == Visibility::Full;
        let directions = is_shadowed.then_some(detail.shadow_directions as usize);
        let direct = DirectLight::of_few(&light, light_stages, &scene.tracer, directions, progress);
        let medium = SeenMedium::new(&self.scene, &scene, options.plain_diffuse);
        let scattered_light = medium.filter(|seen| seen.medium.scatters()).map(|seen| {
            let sampler = light_stages.sampler(&light, progress);
            ScatteredLight::new(&mut self.preview.unoccluded, &light, seen.medium, sampler, progress)
        });
        let frame = Frame {
            scene: &self.scene,
            prepared: &scene,
            options: &options,
            light: &light,
            detail,
            direct,
            medium,
            scattered_light,
            at_rest: self
                .at_rest
                .as_ref()
                .filter(|known| detail.reuses_light && known.is_that_of(&self.scene, &self.options)),
            progress,
        };
        let scattered = frame.scattered(sum.as_deref()).await?;
        #[cfg(feature = "gpu")]
        let passes = (&mut self.preview.on_gpu, &mut self.preview.lit);
        #[cfg(feature = "gpu")]
        let is_sum_on_cpu = sum.as_ref().is_some_and(|sum| sum.on_gpu().is_none());
        #[cfg(feature = "gpu")]
        let (image, exposures, passes) = if !is_sum_on_cpu
            && let Some(on_gpu) = frame.on_gpu(wanted, &backend, passes, (sum.as_ref(), scattered.as_ref())).await?
        {
            (on_gpu.rendered, on_gpu.exposures, on_gpu.passes)
        } else {
            if let Some(shared) = backend.shared_gpu() {
                self.preview.lit.submit(shared);
            }
            let (image, exposures) = frame.on_cpu(sum.as_deref(), scattered.as_ref()).await?;
            (image, exposures, Vec::new())
        };
        #[cfg(not(feature = "gpu"))]
        let (Wanted::InMemory, (image, exposures)) = (wanted, frame.on_cpu(sum.as_deref(), scattered.as_ref()).await?);
        check_wanted(progress)?;
        let statistics = sum.as_ref().map(|sum| sum.statistics());
        let marks = if sum.is_some() && options.overlay != Overlay::None {
            let size = UVec2::from_array(self.options.size).as_vec2();
            let samples = self.preview.technique.1.surface_samples(&inputs)?;
            let marker = Marker { scene: &self.scene, tracer: &scene.camera, size };
            match (statistics, options.overlay) {
                (Some(statistics), Overlay::Photons) => {
                    marker.dots(&statistics.positions).into_iter().map(Mark::Dot).collect()
                }
                (_, Overlay::CausticMap) => {
                    let map = sum.as_ref().and_then(|sum| sum.caustic_map());
                    map.map_or_else(Vec::new, |map| marker.corner(&map))
                }
                _ => marker.marks(options.overlay, &samples),
            }
        } else {
            Vec::new()
        };
        Ok(Preview {
            image,
            exposures,
            samples: statistics.map_or(0, |statistics| statistics.samples),
            marks,
            evaluation: statistics.and_then(|statistics| statistics.evaluation),
            #[cfg(feature = "gpu")]
            passes,
        })
    }

    /// The engine's options, with the size, the samples and the taps of a preview, which are summed one by one.
    fn preview_options(&self, detail: &Detail) -> Options {
        let options = self.options.clone();
        let samples = detail.samples.min(options.samples);
        let taps = detail.taps.min(options.taps);
        options
            .with_size(detail.size)
            .with_samples(samples)
            .with_taps(taps)
            .with_leaves(None)
            .with_evaluation(EvaluationChoice::Flat)
            .with_pixel_samples(1)
            .with_aovs(vec![Aov::Beauty])
    }
}

/// The inputs of a frame.
struct Frame<'a> {
    scene: &'a Scene,
    prepared: &'a PreparedScene,
    options: &'a Options,
    light: &'a PreparedLight,
    detail: &'a Detail,
    direct: DirectLight<'a>,
    medium: Option<SeenMedium>,
    /// If the medium scatters.
    scattered_light: Option<ScatteredLight>,
    /// If only the camera has moved since the last whole picture.
    at_rest: Option<&'a LightAtRest>,
    progress: &'a dyn Progress,
}

impl Frame<'_> {
    /// The picture and its exposures by passes on the GPU; `None` if that is not the back end, or has no room for the picture.
    #[cfg(feature = "gpu")]
    async fn on_gpu(
        &self,
        wanted: Wanted,
        backend: &Backend,
        (passes, lit): (&mut Option<on_gpu::PreviewOnGpu>, &mut on_gpu::LitStages),
        (sum, scattered): (Option<&Arc<dyn Sum>>, Option<&ScatteredGrid>),
    ) -> Result<Option<on_gpu::OnGpu>, Error> {
        let (Some(shared), Some(geometry)) = (backend.shared_gpu(), self.prepared.on_gpu.as_deref()) else {
            return Ok(None);
        };
        if !on_gpu::fits(&shared.gpu.device, self.options.size) {
            return Ok(None);
        }
        let passes = passes.get_or_insert_with(|| on_gpu::PreviewOnGpu::new(shared));
        let inputs = on_gpu::PreviewInputs {
            scene: self.scene,
            prepared: self.prepared,
            geometry,
            options: self.options,
            light: self.light,
            direct: &self.direct,
            sum,
            medium: self.medium,
            scattered,
            spacing: self.detail.spacing(),
            progress: self.progress,
        };
        let cubes = passes.cubes(&inputs)?;
        self.progress.begin(Stage::Shading, 1);
        let rendered = passes.render(&inputs, &cubes, lit, wanted).await;
        self.progress.end(Stage::Shading);
        Ok(rendered?)
    }

    /// The picture and its exposures.
    async fn on_cpu(
        &self,
        sum: Option<&dyn Sum>,
        scattered: Option<&ScatteredGrid>,
    ) -> Result<(Rendered, Exposures), Error> {
        let (options, progress, camera) = (self.options, self.progress, &self.scene.camera);
        progress.begin(Stage::Rays, 1);
        let views =
            Views::trace((self.scene, self.light, self.medium), self.prepared, options.size, options.plain_diffuse);
        progress.end(Stage::Rays);
        let at_rest = self.at_rest.map(|known| known.seen(options.caustic_gain));
        let known = |point: &SurfacePoint| at_rest.as_ref().filter(|_| !point.is_glossy)?(&point.hit);
        let own = self.light(&views.surfaces, sum, known).await?;
        let pixel_of = views.pixels_of(camera);
        let seen = |point: &SurfacePoint| {
            pixel_of(&point.hit)
                .map(|pixel| own[pixel])
                .or_else(|| known(point).or_else(|| self.at_rest?.seen_on_paths(&point.hit, options.caustic_gain)))
        };
        let mirrored = self.light(&views.mirrored, sum, seen).await?;
        progress.begin(Stage::Shading, 1);
        let (mut image, exposures) = self.shade(&views, &own, &mirrored, scattered);
        smooth_edges(&mut image, camera, &self.prepared.camera, &views.first);
        progress.end(Stage::Shading);
        Ok((Rendered::Image(image), exposures))
    }

    /// All light on points, one or none in each pixel: as far as it is not known, at nodes that are some pixels apart, then where it
    /// cannot be interpolated between them. W/m², of glossy points W/(m²·sr), at an intensity of 1.
    async fn light(
        &self,
        points: &Layer<SurfacePoint>,
        sum: Option<&dyn Sum>,
        known: impl Fn(&SurfacePoint) -> Option<Vec3> + Sync,
    ) -> Result<Vec<Vec3>, Error> {
        if points.is_empty() {
            return Ok(vec![Vec3::ZERO; points.pixels()]);
        }
        let mut grid =
            NodeGrid::new(points, self.options.size[0] as usize, self.detail.spacing() as usize).with_known(known);
        let glossy = GlossyReceivers {
            camera: &self.scene.camera,
            prepared: self.prepared,
            light: self.light,
            near_light: self.direct.near_light(),
            is_shadowed: self.options.visibility == Visibility::Full,
        };
        let mut open = grid.nodes();
        let mut is_first = true;
        while is_first || !open.is_empty() {
            is_first = false;
            let direct = self.direct_at(&grid, &open);
            let caustic = self.caustic_at(&grid, &open, sum).await?;
            let light: Vec<Vec3> = parallel::collect(open.len(), &|k| {
                let irradiance = direct[k] + caustic[k];
                match grid.point(open[k]) {
                    Some(point) if point.is_glossy => glossy.radiance(point, irradiance),
                    _ => irradiance,
                }
            });
            open = grid.set(&open, light);
        }
        Ok(grid.finish())
    }

    fn direct_at(&self, grid: &NodeGrid, which: &[usize]) -> Vec<Vec3> {
        self.progress.begin(Stage::Direct, 1);
        let groups = grid.groups(which, SHADOW_BLOCK);
        let of_group = |group: &Vec<usize>| {
            let hits: Vec<_> = group.iter().filter_map(|&place| grid.hit(which[place])).collect();
            self.direct.irradiance(&hits)
        };
        let found: Vec<Vec<Vec3>> = parallel::map(&groups, &of_group);
        let mut direct = vec![Vec3::ZERO; which.len()];
        for (group, values) in groups.iter().zip(found) {
            group.iter().zip(values).for_each(|(&place, value)| direct[place] = value);
        }
        self.progress.end(Stage::Direct);
        direct
    }

    async fn caustic_at(
        &self,
        grid: &NodeGrid<'_>,
        which: &[usize],
        sum: Option<&dyn Sum>,
    ) -> Result<Vec<Vec3>, Error> {
        let mut caustic = vec![Vec3::ZERO; which.len()];
        let receives = |place: &usize| grid.point(which[*place]).is_some_and(|point| point.receives);
        let places: Vec<usize> = (0..which.len()).filter(receives).collect();
        let Some(sum) = sum.filter(|_| !places.is_empty()) else { return Ok(caustic) };
        self.progress.begin(Stage::Caustic, 1);
        let hits = places.iter().filter_map(|&place| grid.hit(which[place]));
        let points: Vec<_> = hits.map(|hit| (hit.position, hit.normal, hit.object)).collect();
        let sums = sum.irradiance(&Receivers::from_points(&points, POINTS_IN_A_ROW), self.progress).await;
        self.progress.end(Stage::Caustic);
        for (place, sum) in places.into_iter().zip(sums?) {
            caustic[place] = self.options.caustic_gain * Vec4::from_array(sum).truncate();
        }
        Ok(caustic)
    }
}

/// A vector that all threads fill: most of the time goes into the first touch of its pages.
fn filled<T: Copy + Send + Sync>(value: T, count: usize) -> Vec<T> {
    (0..count).into_par_iter().map(|_| value).collect()
}
