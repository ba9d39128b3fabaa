//! The sample overlay: a dot for every sample that the camera sees (WS-25).

use glam::{UVec2, Vec2, Vec3};

use super::Renderer;
use crate::image::Image;
use crate::scene::Ray;

/// Dot radius, in pixels of a picture 512 pixels high.
const RADIUS: f32 = 1.4;

pub(super) fn draw_samples(renderer: &Renderer, shown: &mut Image) {
    let size = UVec2::new(shown.width, shown.height).as_vec2();
    let radius = RADIUS * (size.y / 512.0).max(0.75);
    for pixel in visible_samples(renderer, size) {
        draw_dot(shown, pixel, radius);
    }
}

/// Where the samples that the camera sees appear, in pixels of a picture of `size`.
pub(super) fn visible_samples(renderer: &Renderer, size: Vec2) -> impl Iterator<Item = Vec2> {
    let positions = renderer.differentials.iter().map(|s| s.position);
    positions.filter_map(move |position| {
        let (pixel, depth) = renderer.scene.camera.project(position, size);
        (depth > 0.0 && is_visible(renderer, pixel, size, position)).then_some(pixel)
    })
}

/// Whether nothing lies before a point; quantised samples hover a little off their surface.
fn is_visible(renderer: &Renderer, pixel: Vec2, size: Vec2, point: Vec3) -> bool {
    let Ray { origin, direction } = renderer.scene.camera.ray(pixel, size);
    match renderer.tracer.camera_hit(Ray { origin, direction }) {
        Some(hit) => {
            (hit.position - origin).dot(direction) > (point - origin).dot(direction) - 0.02 * (point - origin).length()
        }
        None => true,
    }
}

/// A black dot with a soft rim.
fn draw_dot(image: &mut Image, centre: Vec2, radius: f32) {
    let low = (centre - radius - 1.0).floor().max(Vec2::ZERO).as_uvec2();
    let high = (centre + radius + 1.0).ceil().max(Vec2::ZERO).as_uvec2().min(UVec2::new(image.width, image.height));
    for y in low.y..high.y {
        for x in low.x..high.x {
            let distance = (UVec2::new(x, y).as_vec2() + 0.5 - centre).length();
            let coverage = (radius + 0.5 - distance).clamp(0.0, 1.0);
            image.pixels[(y * image.width + x) as usize] *= 1.0 - coverage;
        }
    }
}
