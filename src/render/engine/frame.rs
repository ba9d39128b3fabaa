//! The stages of a band of the picture: camera rays → light where they hit → paths via mirrors → radiance → display. A
//! picture of up to [`KEPT_POINTS`] points is one band, which is kept; larger ones are rendered band by band.

use std::sync::Arc;

use glam::Vec3;

use super::caustic::CausticAtHits;
use super::edges::{Caustic, Direct};
use super::ends::{EndLight, caustic_at, direct_light};
use super::paths::{PathTracer, Paths};
use super::ray_batches::RayBatches;
use super::scattering::{Scattered, ScatteringStages, contains};
use super::shading::{Displayed, Shaded, Shader, SurfaceLight};
use crate::Error;
use crate::environment::Environment;
use crate::error::check_wanted;
use crate::image::Aov;
use crate::options::{DisplaySettings, Options};
use crate::parallel;
use crate::progress::{Progress, Stage};
use crate::scene::{Chain, Emitter, Lamp, Medium, Ray, Refractor, Scene, Sides, Visibility};
use crate::stages::{
    CameraRays, Id, LightStages, Memo, NearEmitters, PreparedLight, PreparedScene, StageCounts, SurfaceMaterials, View,
};
use crate::technique::Sum;
use crate::tracing::{CameraTracer, Hit, Tracer};

/// The largest number of points of a picture whose stages are kept: enough for 3840×2160 pixels.
pub(super) const KEPT_POINTS: u64 = 1 << 23;
/// Approximate number of points in a band of a larger picture.
const BAND_POINTS: u64 = 1 << 22;

/// Where caustic and direct light are seen together, the tolerance also holds relative to this many times the light there. Errors are
/// several times smaller than what is allowed: at the default of .01 pixels change by a third of a level of 255, root mean square.
const HIDDEN_SHARE: f32 = 2.0;

/// Rows of pixels in each band of a picture.
pub(super) fn rows_per_band(options: &Options) -> u32 {
    let per_row = u64::from(options.size[0]) * u64::from(options.pixel_samples).pow(2);
    let height = options.size[1];
    if per_row * u64::from(height) <= KEPT_POINTS {
        return height;
    }
    (BAND_POINTS / per_row).clamp(1, u64::from(height)) as u32
}

/// The inputs of direct light on surfaces.
#[derive(Clone, PartialEq)]
pub(super) struct LightKey {
    tracer: Id<Tracer>,
    environment: Id<Environment>,
    rotation_rad: f32,
    visibility: Visibility,
    lamps: Arc<[Lamp]>,
    near_emitters: Option<(Id<NearEmitters>, f32)>,
    medium: Option<Medium>,
}

#[derive(PartialEq)]
struct CausticKey {
    rays: Id<CameraRays>,
    sum: Id<dyn Sum>,
    /// By object.
    wanted: Vec<bool>,
    /// Light that hides errors, and the tolerance relative to it.
    beside: Option<(Id<Direct>, f32)>,
}

#[derive(PartialEq)]
struct DirectKey {
    rays: Id<CameraRays>,
    light: LightKey,
    wanted: Vec<bool>,
}

#[derive(PartialEq)]
struct PathsKey {
    rays: Id<CameraRays>,
    tracer: Id<Tracer>,
    materials: Id<SurfaceMaterials>,
    sides: Vec<Option<Sides>>,
    refractors: Vec<Option<Refractor>>,
    emitters: Vec<Option<Emitter>>,
    lamps: Arc<[Lamp]>,
    medium: Option<Medium>,
    is_plain: bool,
}

/// The inputs of the light at the ends of paths.
#[derive(PartialEq)]
struct EndsKey<T> {
    paths: Id<Paths>,
    source: T,
    /// The light where camera rays hit.
    own: LightId,
}

#[derive(PartialEq)]
struct ShadingKey {
    paths: Id<Paths>,
    own: LightId,
    ends: LightId,
    environment: Id<Environment>,
    rotation_rad: f32,
    intensity: f32,
    caustic_gain: f32,
    scattered: [Option<Id<Vec<[f32; 4]>>>; 2],
}

/// The sum, and the direct light at the ends of paths.
type EndsSource = (Id<dyn Sum>, Id<Direct>);

/// The identity of the light on surfaces.
pub(super) type LightId = (Option<Id<Direct>>, Option<Id<Caustic>>);

pub(super) fn id_of(light: &SurfaceLight) -> LightId {
    (light.direct.as_ref().map(Id::of), light.caustic.as_ref().map(Id::of))
}

/// The inputs of a frame.
pub(super) struct FrameInputs<'a> {
    pub scene: &'a Scene,
    pub prepared: &'a PreparedScene,
    pub light: &'a PreparedLight,
    pub options: &'a Options,
    pub display: DisplaySettings,
    /// `None` if no caustics are shown.
    pub sum: Option<&'a Arc<dyn Sum>>,
    /// The sums of the chains that are shown alone.
    pub of_chains: &'a [(Chain, Arc<dyn Sum>)],
    /// Where rays are traced in batches.
    pub batches: Option<&'a dyn RayBatches>,
    pub progress: &'a dyn Progress,
}

impl<'a> FrameInputs<'a> {
    /// What traces the rays that leave surfaces.
    pub(super) fn ray_source(&self) -> (&'a Tracer, Option<&'a dyn RayBatches>) {
        (&self.prepared.tracer, self.batches)
    }

    /// Ends what nobody waits for: the stages that are left would take incomplete ones for complete.
    pub(super) fn check_wanted(&self) -> Result<(), Error> {
        check_wanted(self.progress)
    }

    /// The first things that the camera sees along rays.
    pub(super) async fn camera_hits(&self, rays: &[Ray]) -> Result<Vec<Option<Hit>>, Error> {
        match self.batches {
            Some(batches) => batches.camera_hits(rays).await,
            None => Ok(parallel::map(rays, &|ray| self.prepared.camera.hit(*ray))),
        }
    }

    /// Whether any picture shows the irradiance on an object. For glossy objects the beauty picture shows reflected
    /// radiance instead.
    pub(super) fn shows_irradiance(&self, aov: Aov, object: u32) -> bool {
        let options = self.options;
        options.aovs.contains(&aov) || options.plain_diffuse || !self.prepared.materials.receivers.is_glossy(object)
    }

    /// Whether the caustic on an object is computed where camera rays hit it.
    pub(super) fn knows_caustic(&self, object: u32) -> bool {
        self.scene.objects[object as usize].receiver.is_some() && self.shows_irradiance(Aov::Caustic, object)
    }

    /// Whether the caustic is a picture of its own.
    fn shows_caustic(&self) -> bool {
        self.options.aovs.contains(&Aov::Caustic)
    }

    /// The error of the caustic's irradiance that cannot be seen in this light, W/m².
    pub(super) fn hidden_error(&self, light: Vec3) -> f32 {
        HIDDEN_SHARE * self.options.tolerance * light.element_sum() / 3.0
    }

    pub(super) fn path_tracer<'r>(&'r self, rays: &'r CameraRays) -> PathTracer<'r> {
        let FrameInputs { scene, prepared, options, .. } = self;
        let starts_in_medium = scene.medium.is_some() && contains(scene, &prepared.tracer, scene.camera.position);
        PathTracer { inputs: self, rays, starts_in_medium, is_plain: options.plain_diffuse }
    }

    pub(super) fn objects(&self) -> std::ops::Range<u32> {
        0..self.scene.objects.len() as u32
    }

    pub(super) fn light_key(&self) -> LightKey {
        LightKey {
            tracer: Id::of(&self.prepared.tracer),
            environment: Id::of(&self.light.environment),
            rotation_rad: self.light.rotation_rad,
            visibility: self.options.visibility,
            lamps: self.light.lamps.clone(),
            near_emitters: self.light.near_key(),
            medium: self.light.medium,
        }
    }
}

/// The results for a band.
pub(super) struct Band {
    pub rays: Arc<CameraRays>,
    /// Light on the surfaces that camera rays hit first.
    pub light: SurfaceLight,
    /// The irradiance by way of chains that are shown alone, where camera rays hit.
    pub of_chains: Vec<(Chain, Arc<Caustic>)>,
    /// What a medium scatters towards the camera.
    pub scattered: Scattered,
    pub beauty: Option<Beauty>,
    /// Number of fetches of the environment.
    pub fetches: f64,
}

/// The beauty picture of a band, pixel by pixel.
pub(super) struct Beauty {
    /// Radiance, W/(m²·sr).
    pub radiance: Vec<Vec3>,
    pub shaded: Arc<Shaded>,
    pub displayed: Arc<Displayed>,
    /// Paths via mirrors and interfaces, and the light at their ends.
    pub paths: (Arc<Paths>, SurfaceLight),
}

/// The stages of a band.
#[derive(Debug)]
pub(super) struct BandStages {
    rays: Memo<(Id<CameraTracer>, View), CameraRays>,
    caustic: Memo<CausticKey, Caustic>,
    of_chains: Vec<(Chain, Memo<CausticKey, Caustic>)>,
    direct: Memo<DirectKey, Direct>,
    scattering: ScatteringStages,
    paths: Memo<PathsKey, Paths>,
    ends_caustic: Memo<EndsKey<EndsSource>, Caustic>,
    ends_direct: Memo<EndsKey<LightKey>, Direct>,
    shading: Memo<ShadingKey, Shaded>,
    display: Memo<(Id<Shaded>, DisplaySettings), Displayed>,
}

impl BandStages {
    pub fn new() -> Self {
        Self {
            rays: Memo::new(Stage::Rays),
            caustic: Memo::new(Stage::Caustic),
            of_chains: Chain::ALL.map(|chain| (chain, Memo::new(Stage::Caustic))).into(),
            direct: Memo::new(Stage::Direct),
            scattering: ScatteringStages::new(),
            paths: Memo::new(Stage::Paths),
            ends_caustic: Memo::new(Stage::PathEnds),
            ends_direct: Memo::new(Stage::PathEnds),
            shading: Memo::new(Stage::Shading),
            display: Memo::new(Stage::Display),
        }
    }

    /// Renders a band, making again only the stages whose inputs changed.
    pub async fn render(
        &mut self,
        inputs: &FrameInputs<'_>,
        light: &mut LightStages,
        (first_row, rows): (u32, u32),
    ) -> Result<Band, Error> {
        let Options { size, pixel_samples, ref aovs, .. } = *inputs.options;
        let view = View { camera: inputs.scene.camera, size, pixel_samples, first_row, rows };
        let trace = async || camera_rays(inputs, view).await;
        let key = (Id::of(&inputs.prepared.camera), view);
        let rays = self.rays.wait_for(key, (1, inputs.progress), trace).await?;
        let is_lit = aovs.iter().any(|aov| matches!(aov, Aov::Direct | Aov::Beauty));
        let direct = if is_lit { Some(self.direct(inputs, light, &rays).await?) } else { None };
        inputs.check_wanted()?;
        let caustic = self.caustic(inputs, &rays, direct.as_ref()).await?;
        inputs.check_wanted()?;
        let of_chains = self.caustics_of_chains(inputs, &rays).await?;
        let mut fetches = fetches_of(caustic.as_deref());
        fetches += of_chains.iter().map(|(_, caustic)| fetches_of(Some(caustic))).sum::<f64>();
        let surfaces = SurfaceLight { direct, caustic };
        let scattered = self.scattering.make(inputs, light, &rays, &surfaces).await?;
        fetches += scattered.fetches();
        inputs.check_wanted()?;
        let mut beauty = None;
        if aovs.contains(&Aov::Beauty) {
            let paths = self.paths(inputs, &rays).await?;
            inputs.check_wanted()?;
            let ends = self.ends(inputs, light, &paths, &rays, &surfaces).await?;
            inputs.check_wanted()?;
            fetches += fetches_of(ends.caustic.as_deref());
            let nothing = Scattered::default();
            let seen = if inputs.options.plain_diffuse { &nothing } else { &scattered };
            beauty = Some(self.beauty(inputs, paths, (&surfaces, ends), seen));
        }
        inputs.check_wanted()?;
        Ok(Band { rays, light: surfaces, of_chains, scattered, beauty, fetches })
    }

    /// The caustic's irradiance where camera rays hit receivers.
    async fn caustic(
        &mut self,
        inputs: &FrameInputs<'_>,
        rays: &Arc<CameraRays>,
        direct: Option<&Arc<Direct>>,
    ) -> Result<Option<Arc<Caustic>>, Error> {
        let Some(sum) = inputs.sum.filter(|_| inputs.options.shows_caustic()) else { return Ok(None) };
        let wanted: Vec<bool> = inputs.objects().map(|o| inputs.knows_caustic(o)).collect();
        let beside = direct.filter(|_| !inputs.shows_caustic());
        let key = CausticKey {
            rays: Id::of(rays),
            sum: Id::of(sum),
            wanted: wanted.clone(),
            beside: beside.map(|light| (Id::of(light), inputs.options.tolerance)),
        };
        let steps = (rays.hits.len() as u64, inputs.progress);
        let at_hits = CausticAtHits { inputs, sum, rays, wanted: &wanted };
        let make = async || match beside {
            Some(direct) => at_hits.beside(&direct.light).await,
            None => at_hits.everywhere().await.map(Caustic::from),
        };
        self.caustic.wait_for(key, steps, make).await.map(Some)
    }

    /// The irradiance of each chain that is shown alone, where camera rays hit receivers.
    async fn caustics_of_chains(
        &mut self,
        inputs: &FrameInputs<'_>,
        rays: &Arc<CameraRays>,
    ) -> Result<Vec<(Chain, Arc<Caustic>)>, Error> {
        let wanted: Vec<bool> = inputs.scene.objects.iter().map(|o| o.receiver.is_some()).collect();
        let mut caustics = Vec::new();
        for (chain, memo) in &mut self.of_chains {
            let Some((_, sum)) = inputs.of_chains.iter().find(|(of_sum, _)| of_sum == chain) else { continue };
            let key = CausticKey { rays: Id::of(rays), sum: Id::of(sum), wanted: wanted.clone(), beside: None };
            let at_hits = CausticAtHits { inputs, sum, rays, wanted: &wanted };
            let make = async || at_hits.everywhere().await.map(Caustic::from);
            caustics.push((*chain, memo.wait_for(key, (rays.hits.len() as u64, inputs.progress), make).await?));
        }
        Ok(caustics)
    }

    /// Direct irradiance where camera rays hit surfaces.
    async fn direct(
        &mut self,
        inputs: &FrameInputs<'_>,
        light: &mut LightStages,
        rays: &Arc<CameraRays>,
    ) -> Result<Arc<Direct>, Error> {
        let wanted: Vec<bool> = inputs.objects().map(|o| inputs.shows_irradiance(Aov::Direct, o)).collect();
        let key = DirectKey { rays: Id::of(rays), light: inputs.light_key(), wanted: wanted.clone() };
        let make = async || -> Result<Direct, Error> {
            let direct = direct_light(inputs, light, rays).await?;
            Ok(direct.at_hits(rays, |object| wanted[object as usize]).await?.into())
        };
        self.direct.wait_for(key, (1, inputs.progress), make).await
    }

    async fn paths(&mut self, inputs: &FrameInputs<'_>, rays: &Arc<CameraRays>) -> Result<Arc<Paths>, Error> {
        let FrameInputs { scene, prepared, options, progress, .. } = *inputs;
        let key = PathsKey {
            rays: Id::of(rays),
            tracer: Id::of(&prepared.tracer),
            materials: Id::of(&prepared.materials),
            sides: scene.objects.iter().map(|o| o.reflector.map(|r| r.sides)).collect(),
            refractors: scene.objects.iter().map(|o| o.refractor).collect(),
            emitters: scene.objects.iter().map(|o| o.emitter).collect(),
            lamps: inputs.light.lamps.clone(),
            medium: scene.medium,
            is_plain: options.plain_diffuse,
        };
        self.paths.wait_for(key, (1, progress), async || inputs.path_tracer(rays).trace().await).await
    }

    /// The light at the end points of paths.
    async fn ends(
        &mut self,
        inputs: &FrameInputs<'_>,
        light: &mut LightStages,
        paths: &Arc<Paths>,
        rays: &CameraRays,
        own: &SurfaceLight,
    ) -> Result<SurfaceLight, Error> {
        if paths.ends.is_empty() {
            return Ok(SurfaceLight { direct: None, caustic: None });
        }
        let key = EndsKey { paths: Id::of(paths), source: inputs.light_key(), own: (id_of(own).0, None) };
        let make = async || {
            let source = EndLight::new(inputs, light, &paths.ends, rays).await?;
            source.at(inputs, &paths.ends, rays, own.direct.as_deref()).await
        };
        let direct = self.ends_direct.wait_for(key, (1, inputs.progress), make).await?;
        inputs.check_wanted()?;
        let mut caustic = None;
        if let Some(sum) = inputs.sum.filter(|_| inputs.options.shows_caustic()) {
            let steps = (paths.ends.len() as u64, inputs.progress);
            let source = (Id::of(sum), Id::of(&direct));
            let key = EndsKey { paths: Id::of(paths), source, own: id_of(own) };
            let make = async || {
                let known = SurfaceLight { direct: Some(direct.clone()), caustic: None };
                let nothing = Scattered::default();
                let beside = shader(inputs, [own, &known], &nothing, 1.0).seen_beside(paths);
                let beside: Vec<Vec3> = beside.into_iter().map(Vec3::splat).collect();
                caustic_at(inputs, sum, (&paths.ends, &beside), rays, own.caustic.as_deref()).await
            };
            caustic = Some(self.ends_caustic.wait_for(key, steps, make).await?);
        }
        Ok(SurfaceLight { direct: Some(direct), caustic })
    }

    fn beauty(
        &mut self,
        inputs: &FrameInputs,
        paths: Arc<Paths>,
        (own, ends): (&SurfaceLight, SurfaceLight),
        scattered: &Scattered,
    ) -> Beauty {
        let FrameInputs { light, options, display, progress, .. } = *inputs;
        let key = ShadingKey {
            paths: Id::of(&paths),
            own: id_of(own),
            ends: id_of(&ends),
            environment: Id::of(&light.environment),
            rotation_rad: light.rotation_rad,
            intensity: light.intensity,
            caustic_gain: options.caustic_gain,
            scattered: [&scattered.direct, &scattered.caustic].map(|light| light.as_ref().map(Id::of)),
        };
        let shader = shader(inputs, [own, &ends], scattered, options.caustic_gain);
        let shaded = self.shading.get(key, progress, || shader.shade(&paths));
        let displayed = self.display.get((Id::of(&shaded), display), progress, || shaded.displayed(&display));
        Beauty { radiance: shaded.radiance(), shaded, displayed, paths: (paths, ends) }
    }

    pub fn count(&self, counts: &mut StageCounts) {
        counts.add_memo(&self.rays);
        counts.add_memo(&self.caustic);
        self.of_chains.iter().for_each(|(_, memo)| counts.add_memo(memo));
        counts.add_memo(&self.direct);
        self.scattering.count(counts);
        counts.add_memo(&self.paths);
        counts.add_memo(&self.ends_caustic);
        counts.add_memo(&self.ends_direct);
        counts.add_memo(&self.shading);
        counts.add_memo(&self.display);
    }
}

async fn camera_rays(inputs: &FrameInputs<'_>, view: View) -> Result<CameraRays, Error> {
    match inputs.batches {
        Some(batches) => Ok(CameraRays::of_hits(view, batches.camera_hits(&view.rays()).await?)),
        None => Ok(CameraRays::trace(|ray| inputs.prepared.camera.hit(ray), view)),
    }
}

/// Shades with the light where camera rays hit and at the ends of paths.
fn shader<'a>(
    inputs: &FrameInputs<'a>,
    [own, ends]: [&'a SurfaceLight; 2],
    scattered: &'a Scattered,
    caustic_gain: f32,
) -> Shader<'a> {
    let Options { size, pixel_samples, .. } = *inputs.options;
    Shader { light: inputs.light, own, ends, scattered, width: (size[0] * pixel_samples) as usize, caustic_gain }
}

/// The number of fetches, which is the fourth component of the sums.
fn fetches_of(caustic: Option<&Caustic>) -> f64 {
    caustic.map_or(0.0, |caustic| caustic.sums.iter().map(|s| f64::from(s[3])).sum())
}
