//! The headless renderer: scene and options in, pictures and a report out. One user of the library among others.
//!
//! Data flows scene → environment, samples, tracer → receivers → gather → pictures. The camera's and the mirrors' rays
//! are traced on the CPU for both back ends, so that they see the same receivers.

mod beauty;
mod direct;
mod gather;
mod gbuffer;
mod gloss;
mod importance;
mod on_gpu;
mod options;
mod overlay;
mod report;
mod stage;

pub use gather::{Backend, BackendChoice, BackendReport};
pub use gbuffer::visible_receivers;
pub use importance::place_samples;
pub use options::{Evaluation, EvaluationChoice, FilterChoice, Look, Options, Overlay, Settings};
pub use report::{Report, Seconds};

use std::sync::Arc;
use std::time::Instant;

use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;

use self::beauty::{ExtraPoint, Irradiances};
use self::direct::DirectLight;
use self::gather::Summed;
use self::gbuffer::GBuffer;
use self::stage::Stage;
use crate::brdf::Materials;
use crate::differential::{DifferentialSample, differentials};
use crate::environment::Environment;
use crate::image::{Aov, Image, display, exposed};
use crate::pinhole::CURVE_POINTS;
use crate::reflectance::Curve;
use crate::sampling::Surface;
use crate::scene::{Object, Scene};
use crate::tracing::{Hit, Tracer};
use crate::{Error, Progress};

/// A scene, prepared for rendering.
#[derive(Debug)]
pub struct Renderer {
    scene: Scene,
    options: Options,
    environment: Environment,
    direct: DirectLight,
    materials: Arc<Materials>,
    differentials: Vec<DifferentialSample>,
    summed: Summed,
    evaluation: Evaluation,
    /// How each object mirrors.
    curves: Vec<Option<Curve>>,
    tracer: Tracer,
    backend: Backend,
    seconds: Seconds,
}

/// What a render gives.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The pictures asked for, in that order.
    pub layers: Vec<(Aov, Image)>,
    /// The beauty as it is shown: exposed, tone-mapped, anti-aliased after both; display-linear.
    shown: Option<Image>,
    /// What was done and how long it took.
    pub report: Report,
}

impl Rendered {
    /// A picture by name.
    pub fn layer(&self, aov: Aov) -> Option<&Image> {
        self.layers.iter().find(|(a, _)| *a == aov).map(|(_, image)| image)
    }

    /// What a PNG shows, display-linear: the beauty if it was asked for, else the first picture.
    pub fn shown(&self, look: &Look) -> Image {
        match &self.shown {
            Some(beauty) => beauty.clone(),
            None => self.layers[0].1.map(|p| display(exposed(p, look.exposure_ev))),
        }
    }
}

impl Renderer {
    /// Loads the light, samples the reflectors and opens the back end.
    pub fn new(
        scene: Scene,
        mut options: Options,
        backend: &BackendChoice,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        options.check()?;
        let mut seconds = Seconds::default();
        progress.begin("preparing the light", 1);
        let environment = timed(&mut seconds.environment, || Environment::load(&scene.environment, options.cube_size))?;
        progress.advance(1);
        progress.begin("sampling the reflectors", 1);
        let surface = Surface::of_scene(&scene);
        let tracer = timed(&mut seconds.tracing, || Tracer::new(&scene));
        let set =
            timed(&mut seconds.sampling, || importance::place(&scene, &surface, &environment, &tracer, &options))?;
        let differentials = timed(&mut seconds.differentials, || differentials(&set));
        progress.advance(1);
        let curve = |o: &Object| o.reflector.map(|r| Curve::new(&r.finish, CURVE_POINTS));
        let curves = scene.objects.iter().map(curve).collect();
        let direct = timed(&mut seconds.environment, || DirectLight::new(&environment, options.visibility));
        let (backend, filter) = timed(&mut seconds.backend, || Backend::open(backend, &environment, &options))?;
        options.params.filter = filter;
        let evaluation = options.settled_evaluation(matches!(backend, Backend::Gpu { .. }))?;
        let stage = Stage { scene: &scene, surface: &surface, environment: &environment, tracer: &tracer };
        let samples = stage.samples(&set, &differentials, evaluation, &options, &mut seconds);
        let summed = timed(&mut seconds.backend, || backend.ready(samples, &options))?;
        let materials = Arc::new(scene.materials());
        Ok(Self {
            scene,
            options,
            environment,
            direct,
            materials,
            differentials,
            summed,
            evaluation,
            curves,
            tracer,
            backend,
            seconds,
        })
    }

    /// Renders all pictures asked for.
    pub fn render(&self, progress: &dyn Progress) -> Result<Rendered, Error> {
        let started = Instant::now();
        let mut seconds = self.seconds;
        let mut film = Film::new(&self.options);
        let mut fetches = 0.0;
        let [_, height] = self.options.size;
        let rows_per_band = self.rows_per_band();
        for first_row in (0..height).step_by(rows_per_band as usize) {
            let rows = rows_per_band.min(height - first_row);
            let mut gbuffer = timed(&mut seconds.tracing, || {
                GBuffer::trace(&self.tracer, &self.scene, &self.options, first_row, rows)
            });
            gbuffer.keep_receivers(|object| self.shows_irradiance(Aov::Caustic, object));
            let caustic = if self.options.needs_gather() {
                timed(&mut seconds.gather, || {
                    self.backend.gather(
                        &gbuffer.receivers,
                        &self.summed,
                        &self.environment.cube,
                        &self.options.params,
                        progress,
                    )
                })?
            } else {
                vec![[0.0; 4]; gbuffer.receivers.positions.len()]
            };
            fetches += sum_of_fetches(&caustic);
            let direct = timed(&mut seconds.direct, || self.direct_of_band(&gbuffer));
            let light = Irradiances { direct, caustic };
            self.fill_layers(&mut film, &gbuffer, &light);
            if let Some((radiance, shown)) = film.beauty.as_mut() {
                let (band, extra_fetches) = beauty::shade(self, &gbuffer, &light, &mut seconds, progress)?;
                fetches += extra_fetches;
                let start = first_row as usize * self.options.size[0] as usize;
                for (k, (r, s)) in band.into_iter().enumerate() {
                    radiance.pixels[start + k] = r;
                    shown.pixels[start + k] = s;
                }
            }
        }
        if let (Some((_, shown)), Overlay::Samples) = (film.beauty.as_mut(), self.options.overlay) {
            overlay::draw_samples(self, shown);
        }
        seconds.render = started.elapsed().as_secs_f64();
        let pixels = f64::from(self.options.size[0]) * f64::from(height);
        let report = Report::new(self, fetches / pixels, seconds);
        let (layers, shown) = film.finish(&self.options.aovs);
        Ok(Rendered { layers, shown, report })
    }

    /// Where the samples that the camera sees appear, in pixels from the picture's top left corner.
    pub fn visible_samples(&self) -> Vec<Vec2> {
        overlay::visible_samples(self, UVec2::from_array(self.options.size).as_vec2()).collect()
    }

    /// Bands keep memory bounded: about four million receivers, whole rows of pixels.
    fn rows_per_band(&self) -> u32 {
        let per_row = self.options.size[0] * self.options.pixel_samples.pow(2);
        ((1u32 << 22) / per_row).clamp(1, self.options.size[1])
    }

    /// The environment's irradiance at every point of a band, if any picture shows it.
    fn direct_of_band(&self, gbuffer: &GBuffer) -> Vec<Vec3> {
        if !self.options.aovs.iter().any(|aov| matches!(aov, Aov::Direct | Aov::Beauty)) {
            return vec![Vec3::ZERO; gbuffer.hits.len()];
        }
        let shown = |hit: &&Hit| self.shows_irradiance(Aov::Direct, hit.object);
        let at = |hit: &Option<Hit>| hit.as_ref().filter(shown).map_or(Vec3::ZERO, |hit| self.direct_irradiance(hit));
        gbuffer.hits.par_iter().map(at).collect()
    }

    /// Whether any picture shows the irradiance on an object; the beauty shows what glossy ones reflect instead.
    fn shows_irradiance(&self, aov: Aov, object: u32) -> bool {
        self.options.aovs.contains(&aov) || self.options.look.plain_diffuse || !self.materials.is_glossy(object)
    }

    fn direct_irradiance(&self, hit: &Hit) -> Vec3 {
        self.direct.irradiance(&self.environment, &self.tracer, hit.position, hit.normal)
    }

    /// The environment's irradiance at a point, or the radiance that it reflects to its viewer.
    fn direct_at(&self, point: &ExtraPoint) -> Vec3 {
        if point.receives && self.materials.is_glossy(point.hit.object) {
            self.direct.reflected(&self.environment, &self.tracer, &self.materials, &point.hit, point.view)
        } else {
            self.direct_irradiance(&point.hit)
        }
    }

    /// Averages a band's receivers into the pictures that are plain data.
    fn fill_layers(&self, film: &mut Film, gbuffer: &GBuffer, light: &Irradiances) {
        let n = self.options.pixel_samples;
        let weight = 1.0 / (n * n) as f32;
        let width = self.options.size[0];
        for row in 0..gbuffer.rows {
            for x in 0..width {
                let pixel = ((gbuffer.first_row + row) * width + x) as usize;
                for sub in 0..n * n {
                    let index = gbuffer.index(x, row, sub % n, sub / n);
                    for (aov, image) in &mut film.data {
                        image.pixels[pixel] += weight * self.value(*aov, gbuffer, index, light);
                    }
                }
            }
        }
    }

    fn value(&self, aov: Aov, gbuffer: &GBuffer, index: usize, light: &Irradiances) -> Vec3 {
        let Some(hit) = &gbuffer.hits[index] else {
            return if aov == Aov::Depth { Vec3::NEG_ONE } else { Vec3::ZERO };
        };
        let receiver = self.scene.objects[hit.object as usize].receiver.as_ref();
        match aov {
            Aov::Caustic => Vec3::from_slice(&light.caustic[index]),
            Aov::Direct => receiver.map_or(Vec3::ZERO, |_| light.direct[index]),
            Aov::Albedo => receiver.map_or(Vec3::ZERO, |r| r.albedo),
            Aov::Normal => hit.normal,
            Aov::Position => hit.position,
            Aov::Depth => Vec3::splat((hit.position - self.scene.camera.position).dot(self.scene.camera.forward)),
            Aov::Beauty => unreachable!("the beauty is shaded, not copied"),
        }
    }
}

/// The pictures while they fill up.
struct Film {
    data: Vec<(Aov, Image)>,
    /// Radiance, and what is shown of it.
    beauty: Option<(Image, Image)>,
}

impl Film {
    fn new(options: &Options) -> Self {
        let blank = || Image::new(options.size[0], options.size[1]);
        let data = options.aovs.iter().filter(|a| **a != Aov::Beauty).map(|a| (*a, blank())).collect();
        Self { data, beauty: options.aovs.contains(&Aov::Beauty).then(|| (blank(), blank())) }
    }

    fn finish(mut self, aovs: &[Aov]) -> (Vec<(Aov, Image)>, Option<Image>) {
        let (beauty, shown) = self.beauty.unzip();
        self.data.extend(beauty.map(|b| (Aov::Beauty, b)));
        self.data.sort_by_key(|(aov, _)| aovs.iter().position(|a| a == aov));
        (self.data, shown)
    }
}

/// The fourth component of gathered sums counts fetches.
fn sum_of_fetches(gathered: &[[f32; 4]]) -> f64 {
    gathered.iter().map(|g| f64::from(g[3])).sum()
}

fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let result = work();
    *seconds += started.elapsed().as_secs_f64();
    result
}
