//! The sample overlay: a dot for every sample that the camera sees (Wand and Straßer, Figures 5 and 7).

use glam::{UVec2, Vec2, Vec3};

use crate::image::Image;
use crate::scene::{Ray, Scene};
use crate::tracing::Tracer;

/// Dot radius, in pixels of a picture 512 pixels high.
const RADIUS: f32 = 1.4;

/// Draws a dot at each of these positions, in pixels from the top left corner.
pub(super) fn draw_dots(image: &mut Image, dots: &[Vec2]) {
    let radius = RADIUS * (image.height as f32 / 512.0).max(0.75);
    for dot in dots {
        draw_dot(image, *dot, radius);
    }
}

/// The positions of the samples that the camera sees, in pixels of a picture of `size`.
pub(super) fn visible_samples(scene: &Scene, tracer: &Tracer, positions: &[Vec3], size: Vec2) -> Vec<Vec2> {
    let visible = |position: &Vec3| {
        let (pixel, depth) = scene.camera.project(*position, size);
        (depth > 0.0 && is_visible(tracer, scene.camera.ray(pixel, size), *position)).then_some(pixel)
    };
    positions.iter().filter_map(visible).collect()
}

/// Whether a point on a ray is unoccluded, with some slack: quantised samples lie a little off their surface.
fn is_visible(tracer: &Tracer, ray: Ray, point: Vec3) -> bool {
    let along = |p: Vec3| (p - ray.origin).dot(ray.direction);
    let slack = 0.02 * (point - ray.origin).length();
    tracer.camera_hit(ray).is_none_or(|hit| along(hit.position) > along(point) - slack)
}

/// Draws a black, anti-aliased dot.
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
