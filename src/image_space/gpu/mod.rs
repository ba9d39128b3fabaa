//! Photons on the GPU: they are emitted, traced and added to maps by compute passes, whose sums are fixed-point numbers in two words, so that
//! they are the same in any order. CPU twin: the rest of [`crate::image_space`], which also smoothes points and chooses between resolutions
//! once the sums are there. Shaders: `shaders/photon_*.wgsl`. Knows neither techniques nor how results are looked up.

mod images;
mod layout;
mod map;
mod passes;
mod pipelines;

pub(crate) use self::layout::Strip;
#[cfg(test)]
pub(crate) use self::layout::{
    DrawUniforms, GpuPhoton, GpuPlace, GpuSurface, GpuWay, ImagePlaneUniforms, MapUniforms, PlaneUniforms, ViewUniforms,
};
pub(crate) use self::pipelines::PhotonPipelines;
#[cfg(test)]
pub(crate) use super::caustic_map::Texel;

use self::map::MapOnGpu;
use self::passes::Passes;
use super::caustic_map::IrradianceMap;
use super::ledger::Ledger;
use super::lights::LightView;
use super::maps::{FewPhotons, MapInputs, Maps};
use super::options::MapView;
use super::projection::Projection;
use crate::Error;
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::gpu::Geometry;
use crate::progress::Progress;
use crate::scene::Chain;

/// Photons that are in the buffers together, about: 128 MiB with their ways and places.
const PHOTONS_OF_STRIP: u32 = 1 << 20;

/// Rows of neighbours before and after those of a strip.
const NEIGHBOURS: u32 = 2;

/// What the device has to work with.
#[derive(Clone, Copy)]
pub(crate) struct Device<'a> {
    pub gpu: &'a Gpu,
    pub pipelines: &'a PhotonPipelines,
    /// What photons meet.
    pub geometry: &'a Geometry,
}

/// Maps of all photons of a scene, whose traversal is dense.
///
/// # Errors
/// A map does not fit in the adapter's buffers, the device is lost, or its rays are ended early.
pub(crate) async fn maps(device: Device<'_>, inputs: &MapInputs<'_>, progress: &dyn Progress) -> Result<Maps, Error> {
    let passes = Passes::new(device, inputs);
    let few = inputs.few_photons(progress);
    let (shared, finished) = (Vec::new(), Vec::new());
    let mut maps = MapsOnGpu { device, inputs, passes, few, eye: None, shared, finished, photons: 0 };
    maps.begin()?;
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
    few: Vec<FewPhotons>,
    eye: Option<MapOnGpu>,
    /// With the camera's map, one for each chain.
    shared: Vec<(Chain, MapOnGpu)>,
    finished: Vec<(IrradianceMap, Ledger)>,
    photons: u64,
}

impl MapsOnGpu<'_> {
    fn begin(&mut self) -> Result<(), Error> {
        if self.inputs.options.caustic_map == MapView::Light {
            return Ok(());
        }
        let (camera, size) = &self.inputs.view;
        self.eye = Some(self.map(Projection::of_camera(camera, *size), true)?);
        for (chain, projection) in self.inputs.projections_of_chains(&self.few) {
            let map = self.map(projection, false)?;
            self.shared.push((chain, map));
        }
        Ok(())
    }

    fn map(&self, projection: Projection, is_camera: bool) -> Result<MapOnGpu, GpuError> {
        let map = MapOnGpu::new(self.device.gpu, self.inputs, projection, is_camera)?;
        self.passes.find_receivers(&map);
        Ok(map)
    }

    async fn add_light(&mut self, index: usize, progress: &dyn Progress) -> Result<(), Error> {
        let (inputs, light) = (self.inputs, &self.inputs.lights[index]);
        let mut own = Vec::new();
        if self.eye.is_none() {
            for projection in inputs.projections_of_light(light, &self.few[index]) {
                own.push(self.map(projection, false)?);
            }
        }
        for part in inputs.parts_of(light) {
            for view in part.views(inputs.casters, &inputs.bounds, inputs.options.photons) {
                self.photons += view.projection.texel_count() as u64;
                self.add_view(&view, &own, progress).await?;
            }
        }
        for map in own {
            self.finished.push(map.finish(self.device.gpu, inputs.options.mode).await?);
        }
        Ok(())
    }

    /// Emits all photons of a view, strip by strip, and adds them to maps.
    async fn add_view(&self, view: &LightView, own: &[MapOnGpu], progress: &dyn Progress) -> Result<(), Error> {
        let light = self.passes.light(&view.light)?;
        let images = self.passes.images(view)?;
        for strip in strips(view.projection.size) {
            for kind in self.inputs.kinds {
                if progress.is_cancelled() {
                    return Err(Error::Cancelled);
                }
                let mut encoder = self.device.gpu.device.create_command_encoder(&Default::default());
                self.passes.emit(&mut encoder, (view, &light, &images), *kind, strip);
                if let Some(eye) = &self.eye {
                    self.passes.deposit(&mut encoder, (eye, view), strip, false);
                }
                for map in own {
                    self.passes.deposit(&mut encoder, (map, view), strip, own.len() > 1);
                }
                for (_, map) in self.shared.iter().filter(|(chain, _)| *chain == kind.chain) {
                    self.passes.deposit_unaccounted(&mut encoder, (map, view), strip);
                }
                self.device.gpu.queue.submit([encoder.finish()]);
            }
            // Strips wait for each other, so that a cancelled picture ends soon.
            self.device.gpu.submitted_work_done().await?;
            progress.advance(u64::from(strip.own_rows));
        }
        Ok(())
    }

    async fn finish(self) -> Result<Maps, Error> {
        let Self { device, inputs, passes, few, eye, shared, finished, photons } = self;
        let (mut ledger, photons_used) = passes.ledger().await?;
        let mode = inputs.options.mode;
        let mut lights = Vec::new();
        let eye = match eye {
            Some(map) => {
                let (map, rest) = map.finish(device.gpu, mode).await?;
                ledger += rest;
                Some(map)
            }
            None => None,
        };
        for (_, map) in shared {
            lights.push(map.finish(device.gpu, mode).await?.0);
        }
        for (map, rest) in finished {
            ledger += rest;
            lights.push(map);
        }
        device.gpu.check()?;
        Ok(Maps::of_parts(eye, lights, (ledger, photons, photons_used), &few))
    }
}

/// The rows of a view in strips that fit in the buffers.
fn strips([columns, rows]: [u32; 2]) -> impl Iterator<Item = Strip> {
    let own = (PHOTONS_OF_STRIP / columns.max(1)).max(1);
    (0..rows).step_by(own as usize).map(move |first_own| {
        let first_row = first_own.saturating_sub(NEIGHBOURS);
        let own_rows = own.min(rows - first_own);
        let end = (first_own + own_rows + NEIGHBOURS).min(rows);
        Strip { first_row, rows: end - first_row, first_own_row: first_own - first_row, own_rows }
    })
}

/// The most photons of a strip of a view of so many columns.
fn photons_of_strip([columns, rows]: [u32; 2]) -> u64 {
    strips([columns, rows]).map(|strip| u64::from(strip.rows) * u64::from(columns)).max().unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_are_all_rows_once() {
        for size in [[16, 16], [1024, 1024], [2048, 2048], [8192, 8192], [8192, 5]] {
            let mut next = 0;
            for strip in strips(size) {
                assert_eq!(strip.first_row + strip.first_own_row, next, "{size:?}");
                next += strip.own_rows;
                let after = strip.first_row + strip.rows - next;
                assert!(strip.first_own_row == NEIGHBOURS || strip.first_row == 0);
                assert!(after == NEIGHBOURS || strip.first_row + strip.rows == size[1]);
            }
            assert_eq!(next, size[1]);
            assert!(photons_of_strip(size) <= u64::from(PHOTONS_OF_STRIP + 4 * size[0]));
        }
    }
}
