//! Lamps and near emitters in one buffer, as `shaders/shared/preview_lamps.wgsl` and `preview_near_light.wgsl` read it.

use glam::{Vec2, Vec3};

use crate::pinhole::constants::{BEAM_CONE, BEAM_NONE, BEAM_SLIDE, LAMP_TEXELS, PART_TEXELS};
use crate::scene::{Lamp, Slide};
use crate::stages::PreparedLight;

/// Slides have no more texels along an edge; finer ones are looked up at so many places.
const MAX_SLIDE_SIZE: usize = 256;

/// All near light of a scene.
#[derive(Debug)]
pub(super) struct PackedNearLight {
    pub lamp_count: u32,
    pub part_count: u32,
    /// The lamps, then the parts of emitters, then slides.
    pub texels: Vec<[f32; 4]>,
}

impl PackedNearLight {
    pub fn new(light: &PreparedLight) -> Self {
        let mut parts = Vec::new();
        if let Some((near, factor)) = &light.near_emitters {
            for emitter in &near.emitters {
                let is_closed = f32::from(u8::from(emitter.is_closed));
                let radiance = (*factor * emitter.radiance).extend(0.0).to_array();
                let of_part = |(position, area): (Vec3, Vec3)| {
                    [position.extend(is_closed).to_array(), area.extend(0.0).to_array(), radiance]
                };
                parts.extend(emitter.parts().flat_map(of_part));
            }
        }
        let lamp_count = light.lamps.len() as u32;
        let first_of_slides = LAMP_TEXELS as usize * light.lamps.len() + parts.len();
        let (mut texels, mut slides) = (Vec::new(), Vec::new());
        for lamp in light.lamps.iter() {
            let slide = lamp.beam.as_ref().and_then(|beam| beam.slide.as_ref());
            let (size, of_slide) = slide.map_or(([0; 2], Vec::new()), slide_texels);
            texels.extend(lamp_texels(lamp, (first_of_slides + slides.len(), size)));
            slides.extend(of_slide);
        }
        let part_count = parts.len() as u32 / PART_TEXELS;
        texels.extend(parts);
        texels.extend(slides);
        Self { lamp_count, part_count, texels }
    }
}

fn lamp_texels(lamp: &Lamp, (first, [width, height]): (usize, [usize; 2])) -> [[f32; 4]; LAMP_TEXELS as usize] {
    let (beam, direction, up) = match &lamp.beam {
        None => (BEAM_NONE, [0.0; 4], [0.0; 4]),
        Some(beam) => (
            if beam.slide.is_some() { BEAM_SLIDE } else { BEAM_CONE },
            beam.direction.extend(beam.half_angle_rad).to_array(),
            beam.up.extend(beam.softness).to_array(),
        ),
    };
    let slide = [first as u32, width as u32, height as u32, 0].map(f32::from_bits);
    let intensity = lamp.intensity.extend(f32::from_bits(beam)).to_array();
    [lamp.position.extend(lamp.radius).to_array(), intensity, direction, up, slide]
}

/// The width and the height of a slide and its texels, row by row.
fn slide_texels(slide: &Slide) -> ([usize; 2], Vec<[f32; 4]>) {
    let (width, height) = (slide.0.width, slide.0.height);
    let finest = width.max(height);
    let size = [width, height].map(|edge| (edge * MAX_SLIDE_SIZE).div_ceil(finest.max(MAX_SLIDE_SIZE)));
    let texel = |x: usize, y: usize| {
        let [u, v] = [(x, size[0]), (y, size[1])].map(|(place, edge)| (2 * place + 1) as f32 / edge as f32 - 1.0);
        slide.at(Vec2::new(u * width as f32 / height as f32, -v)).extend(1.0).to_array()
    };
    (size, (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::image::RgbImage;

    fn slide(width: usize, height: usize) -> Slide {
        let pixels = (0..width * height).map(|k| [(k % width) as f32, (k / width) as f32, 1.0]).collect();
        Slide(Arc::new(RgbImage { width, height, pixels }))
    }

    #[test]
    fn small_slides_keep_their_pixels() {
        let slide = slide(3, 2);
        let (size, texels) = slide_texels(&slide);
        assert_eq!(size, [3, 2]);
        for (texel, pixel) in texels.iter().zip(&slide.0.pixels) {
            assert!(Vec3::from_slice(texel).abs_diff_eq(Vec3::from_array(*pixel), 1e-5), "{texel:?} for {pixel:?}");
        }
    }

    #[test]
    fn large_slides_keep_their_shape() {
        let (size, texels) = slide_texels(&slide(1024, 300));
        assert_eq!(size, [256, 75]);
        assert_eq!(texels.len(), 256 * 75);
    }
}
