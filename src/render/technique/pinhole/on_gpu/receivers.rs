//! Receivers as an adapter takes them: in strips, in tiles and in textures.

use std::borrow::Cow;

use crate::gpu::{Gpu, GpuError};
use crate::pinhole::gpu::FrameViewers;
use crate::pinhole::{NO_RECEIVER, ReceiverLayout, Receivers, ViewDirections};
use crate::progress::Progress;

/// Sums over receivers, strip by strip: see [`strips`]. What is cancelled stays dark.
pub(super) async fn in_strips(
    receivers: &Receivers,
    (max_texture, most): (u32, usize),
    progress: &dyn Progress,
    sum: impl AsyncFn(&Receivers) -> Result<Vec<[f32; 4]>, GpuError>,
) -> Result<Vec<[f32; 4]>, GpuError> {
    let mut sums = Vec::with_capacity(receivers.positions.len());
    for strip in strips(receivers, max_texture, most) {
        sums.extend(sum(&strip).await?);
        if progress.is_cancelled() {
            break;
        }
    }
    sums.resize(receivers.positions.len(), [0.0; 4]);
    Ok(sums)
}

/// Divides receivers into strips of whole rows that fit into the adapter's textures and, except for single rows, have
/// at most `most` points, so that the submission of one batch of samples has a bounded duration.
fn strips(receivers: &Receivers, max_texture: u32, most: usize) -> Vec<Receivers> {
    let width = receivers.width;
    if width > max_texture {
        // Too wide for a texture: the points become an unordered list.
        let folded = Receivers { width: max_texture, layout: ReceiverLayout::Unordered, ..receivers.clone() };
        return strips(&pad_rows(folded), max_texture, most);
    }
    let rows = (most / width as usize).clamp(1, max_texture as usize);
    let per_strip = width as usize * rows;
    let count = receivers.positions.len();
    let strip = |start: usize| {
        let part = start..(start + per_strip).min(count);
        let view_directions = receivers.view_directions.as_ref().map(|viewers| ViewDirections {
            directions: viewers.directions[part.clone()].to_vec(),
            materials: viewers.materials.clone(),
        });
        Receivers {
            width,
            layout: receivers.layout,
            height: (part.len() as u32).div_ceil(width),
            positions: receivers.positions[part.clone()].to_vec(),
            lengths: receivers.lengths.as_ref().map(|lengths| lengths[part.clone()].to_vec()),
            normals: receivers.normals[part].to_vec(),
            view_directions,
        }
    };
    (0..count).step_by(per_strip).map(strip).collect()
}

fn pad_rows(mut receivers: Receivers) -> Receivers {
    let rows = (receivers.positions.len() as u32).div_ceil(receivers.width);
    let count = (rows * receivers.width) as usize;
    receivers.height = rows;
    receivers.positions.resize(count, [0.0, 0.0, 0.0, NO_RECEIVER]);
    receivers.normals.resize(count, [0.0; 4]);
    if let Some(viewers) = &mut receivers.view_directions {
        viewers.directions.resize(count, [0.0; 4]);
    }
    if let Some(lengths) = &mut receivers.lengths {
        lengths.resize(count, 0.0);
    }
    receivers
}

/// Receivers, uploaded to the GPU.
pub(super) struct Uploaded<'a> {
    pub positions: wgpu::TextureView,
    pub normals: wgpu::TextureView,
    directions: Option<wgpu::TextureView>,
    pub receivers: &'a Receivers,
}

impl<'a> Uploaded<'a> {
    pub fn new(gpu: &Gpu, receivers: &'a Receivers) -> Self {
        let size = [receivers.width, receivers.height];
        Self {
            positions: gpu.upload_texture(size, &receivers.positions),
            normals: gpu.upload_texture(size, &normals(receivers)),
            directions: receivers.view_directions.as_ref().map(|viewers| gpu.upload_texture(size, &viewers.directions)),
            receivers,
        }
    }

    pub fn size(&self) -> [u32; 2] {
        [self.receivers.width, self.receivers.height]
    }

    pub fn viewers(&self) -> Option<FrameViewers<'_>> {
        let viewers = self.directions.as_ref().zip(self.receivers.view_directions.as_ref());
        viewers.map(|(directions, viewers)| FrameViewers { directions, materials: &viewers.materials })
    }
}

/// Normals or, of parts of rays, the ways from one end to the other.
fn normals(receivers: &Receivers) -> Cow<'_, [[f32; 4]]> {
    let Some(lengths) = &receivers.lengths else { return Cow::Borrowed(&receivers.normals) };
    let along = |(&[x, y, z, w], length): (&[f32; 4], &f32)| [length * x, length * y, length * z, w];
    receivers.normals.iter().zip(lengths).map(along).collect()
}

/// Receivers arranged in tiles for a hierarchical gather: an unordered list becomes a grid whose tiles are consecutive
/// parts of it.
pub(super) struct Tiled<'a> {
    pub receivers: Cow<'a, Receivers>,
    /// The place of each of the list's points in the grid.
    places: Option<Vec<usize>>,
}

impl<'a> Tiled<'a> {
    pub fn new(receivers: &'a Receivers) -> Self {
        match receivers.layout {
            ReceiverLayout::Grid => Self { receivers: Cow::Borrowed(receivers), places: None },
            ReceiverLayout::Unordered => {
                let (tiled, places) = receivers.in_tiles();
                Self { receivers: Cow::Owned(tiled), places: Some(places) }
            }
        }
    }

    pub fn in_order(&self, sums: Vec<[f32; 4]>) -> Vec<[f32; 4]> {
        match &self.places {
            None => sums,
            Some(places) => places.iter().map(|&place| sums[place]).collect(),
        }
    }
}
