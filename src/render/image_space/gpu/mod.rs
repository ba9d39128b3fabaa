//! Photons on the GPU: they are emitted, traced and added to maps by compute passes, whose sums are fixed-point numbers in two words, so that
//! they are the same in any order. CPU twin: the rest of [`crate::image_space`], which also smoothes points and chooses between resolutions
//! once the sums are there. Shaders: `shaders/photon_*.wgsl`. Knows neither techniques nor how results are looked up.

mod clusters;
mod hierarchical;
mod images;
mod layout;
mod map;
mod passes;
mod pipelines;

#[cfg(test)]
pub(crate) use self::layout::{
    ClusterUniforms, DrawUniforms, GpuPhoton, GpuPlace, GpuSurface, GpuTexel, GpuWay, ImagePlaneUniforms, MapUniforms,
    PlaneUniforms, ViewUniforms,
};
pub(crate) use self::pipelines::PhotonPipelines;
#[cfg(test)]
pub(crate) use super::strips::Strip;

use std::borrow::Cow;

use self::clusters::{CoverageOnGpu, Traverser};
use self::hierarchical::Hierarchy;
use self::layout::Block;
use self::map::MapOnGpu;
use self::passes::{Passes, Source};
use super::coverage::Coverage;
use super::irradiance_map::IrradianceMap;
use super::ledger::Ledger;
use super::lights::LightView;
use super::maps::{FewPhotons, MapInputs, Maps};
use super::options::{MapView, Traversal};
use super::projection::Projection;
use super::strips::strips;
use crate::Error;
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::gpu::Geometry;
use crate::progress::Progress;
use crate::scene::Chain;

/// What the device has to work with.
#[derive(Clone, Copy)]
pub struct Device<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) pipelines: &'a PhotonPipelines,
    /// What photons meet.
    pub geometry: &'a Geometry,
}

/// Maps of the photons of a scene.
///
/// # Errors
/// A map does not fit in the adapter's buffers, the device is lost, or its rays are ended early.
pub async fn maps(device: Device<'_>, inputs: &MapInputs<'_>, progress: &dyn Progress) -> Result<Maps, Error> {
    let passes = Passes::new(device, inputs);
    let few = inputs.few_photons(progress);
    let (shared, finished) = (Vec::new(), Vec::new());
    let mut maps = MapsOnGpu { device, inputs, passes, few, eye: None, shared, finished, photons: 0 };
    maps.begin().await?;
    for index in 0..inputs.lights.len() {
        maps.add_light(index, progress).await?;
    }
    maps.finish().await
}

/// Maps on their way.
struct MapsOnGpu<'a> {
    device: Device<'a>,
    inputs: &'a MapInputs<'a>,
    passes: Passes<'a>,
    few: Cow<'a, [FewPhotons]>,
    eye: Option<MapOnGpu<'a>>,
    /// With the camera's map, one for each chain.
    shared: Vec<(Chain, MapOnGpu<'a>)>,
    finished: Vec<(IrradianceMap, Ledger)>,
    photons: u64,
}

impl<'a> MapsOnGpu<'a> {
    async fn begin(&mut self) -> Result<(), Error> {
        if self.inputs.options.caustic_map == MapView::Light {
            return Ok(());
        }
        let (camera, size) = &self.inputs.view;
        self.eye = Some(self.map(Projection::of_camera(camera, *size), None)?);
        for (chain, projection) in self.inputs.projections_of_chains(&self.few) {
            let map = self.map_of_receivers(projection).await?;
            self.shared.push((chain, map));
        }
        Ok(())
    }

    /// A map of all receivers along its rays.
    async fn map_of_receivers(&self, projection: Projection) -> Result<MapOnGpu<'a>, GpuError> {
        let layers = self.passes.count_layers(projection).await?;
        self.map(projection, Some(layers))
    }

    fn map(&self, projection: Projection, receivers: Option<u32>) -> Result<MapOnGpu<'a>, GpuError> {
        let map = MapOnGpu::new(self.device.gpu, self.inputs, projection, receivers)?;
        self.passes.find_receivers(&map);
        Ok(map)
    }

    async fn add_light(&mut self, index: usize, progress: &dyn Progress) -> Result<(), Error> {
        let (inputs, light) = (self.inputs, &self.inputs.lights[index]);
        let mut own = Vec::new();
        if self.eye.is_none() {
            for projection in inputs.projections_of_light(light, &self.few[index]) {
                own.push(self.map_of_receivers(projection).await?);
            }
        }
        for part in inputs.parts_of(index) {
            for view in part.views(inputs.casters, &inputs.bounds, inputs.photons_of(index)) {
                match inputs.options.traversal {
                    Traversal::Dense => {
                        self.photons += view.projection.texel_count() as u64;
                        self.add_view(&view, &own, progress).await?;
                    }
                    traversal => self.photons += self.add_clusters(&view, &own, traversal, progress).await?,
                }
            }
        }
        for map in own {
            self.finished.push(map.finish(self.device.gpu, inputs.options).await?);
        }
        Ok(())
    }

    /// Emits all photons of a view, strip by strip, and adds them to maps.
    async fn add_view(&self, view: &LightView, own: &[MapOnGpu<'_>], progress: &dyn Progress) -> Result<(), Error> {
        let light = &self.passes.light(&view.light)?;
        let images = &self.passes.images(view)?;
        for strip in strips(view.projection.size) {
            for kind in self.inputs.kinds {
                if progress.is_cancelled() {
                    return Err(Error::Cancelled);
                }
                let mut encoder = self.device.gpu.device.create_command_encoder(&Default::default());
                self.passes.emit(&mut encoder, Source { view, light, images }, *kind, strip);
                let block = Block::of_rows(view.projection.size[0], strip);
                self.deposit(&mut encoder, (view, kind.chain), own, block);
                self.device.gpu.queue.submit([encoder.finish()]);
            }
            // Strips wait for each other, so that a cancelled picture ends soon.
            self.device.gpu.submitted_work_done().await?;
            progress.advance(u64::from(strip.own_rows));
        }
        Ok(())
    }

    /// Follows clusters of photons as far as the first map needs them, or puts them together there. Returns how many photons were followed.
    async fn add_clusters(
        &self,
        view: &LightView,
        own: &[MapOnGpu<'_>],
        traversal: Traversal,
        progress: &dyn Progress,
    ) -> Result<u64, Error> {
        let light = &self.passes.light(&view.light)?;
        let images = &self.passes.images(view)?;
        let Some(map) = self.eye.as_ref().or_else(|| own.first()) else { return Ok(0) };
        // The hierarchical traversal follows all photons, whatever the casters cover.
        let coverage = (traversal != Traversal::Hierarchical).then(|| {
            let coverage = Coverage::new(&view.projection, view.spread, self.inputs.triangles.iter().copied());
            CoverageOnGpu::new(&self.device.gpu.device, coverage)
        });
        let mut followed = 0;
        for kind in self.inputs.kinds {
            if progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let from = Source { view, light, images };
            let (passes, kind, finest) = (&self.passes, *kind, self.inputs.options.photons);
            let add = &mut |encoder: &mut wgpu::CommandEncoder, block| {
                self.deposit(encoder, (view, kind.chain), own, block);
            };
            followed += match &coverage {
                None => Hierarchy { passes, from, kind, map, photons: finest }.run(add),
                Some(coverage) => Traverser { passes, from, kind, map, traversal, finest }.run(coverage, add).await?,
            };
        }
        Ok(followed)
    }

    /// Adds what is in the buffers to all maps.
    fn deposit(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (view, chain): (&LightView, Chain),
        own: &[MapOnGpu<'_>],
        block: Block,
    ) {
        if let Some(eye) = &self.eye {
            self.passes.deposit(encoder, (eye, view), block, false);
        }
        for map in own {
            self.passes.deposit(encoder, (map, view), block, own.len() > 1);
        }
        for (_, map) in self.shared.iter().filter(|(of, _)| *of == chain) {
            self.passes.deposit_unaccounted(encoder, (map, view), block);
        }
    }

    async fn finish(self) -> Result<Maps, Error> {
        let Self { device, inputs, passes, few, eye, shared, finished, photons } = self;
        let (mut ledger, photons_used) = passes.ledger().await?;
        let mut lights = Vec::new();
        let eye = match eye {
            Some(map) => {
                let (map, rest) = map.finish(device.gpu, inputs.options).await?;
                ledger += rest;
                Some(map)
            }
            None => None,
        };
        for (_, map) in shared {
            lights.push(map.finish(device.gpu, inputs.options).await?.0);
        }
        for (map, rest) in finished {
            ledger += rest;
            lights.push(map);
        }
        device.gpu.check()?;
        Ok(Maps::of_parts(eye, lights, (ledger, photons, photons_used), &few))
    }
}
