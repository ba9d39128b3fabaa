//! Arrows along the world's axes by which the selected object is dragged.

use eframe::egui;
use egui::{Color32, Pos2, Rect, Stroke, Vec2 as UiVec2};
use glam::{Vec2, Vec3};

use crate::scene::Camera;

/// Length of the arrows, as a fraction of the window's height.
const LENGTH: f32 = 0.16;
/// An arrow is taken hold of within this distance, points.
const REACH: f32 = 9.0;
/// Arrows that are shorter than this in the picture point at the camera and cannot be dragged, points.
const LEAST_LENGTH: f32 = 12.0;
/// Colours of the axes, as most programs have them.
const COLOURS: [Color32; 3] =
    [Color32::from_rgb(235, 80, 80), Color32::from_rgb(110, 205, 90), Color32::from_rgb(90, 140, 250)];

/// An axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis(usize);

/// An arrow in the window.
#[derive(Clone, Copy, Debug)]
pub struct Arrow {
    axis: Axis,
    start: Pos2,
    end: Pos2,
    /// Metres.
    length: f32,
}

impl Arrow {
    /// Where it begins and where it ends.
    #[cfg(test)]
    pub fn ends(&self) -> (Pos2, Pos2) {
        (self.start, self.end)
    }
}

/// The arrows of an object at a place in the world; none if it is behind the camera.
pub fn axes(camera: &Camera, middle: Vec3, area: Rect) -> Vec<Arrow> {
    let size = Vec2::new(area.width(), area.height());
    let place = |point: Vec3| {
        let (pixel, depth) = camera.project(point, size);
        (depth > 0.0).then(|| area.min + UiVec2::new(pixel.x, pixel.y))
    };
    let Some(start) = place(middle) else { return Vec::new() };
    // A metre across the picture at the object's depth, in points.
    let Some(beside) = place(middle + camera.right) else { return Vec::new() };
    let length = LENGTH * area.height() / (beside - start).length().max(1e-6);
    let arrow = |index: usize| {
        let end = place(middle + length * Vec3::AXES[index])?;
        Some(Arrow { axis: Axis(index), start, end, length })
    };
    (0..3).filter_map(arrow).filter(|arrow| (arrow.end - arrow.start).length() > LEAST_LENGTH).collect()
}

/// The arrow at a place in the window.
pub fn axis_at(arrows: &[Arrow], at: Pos2) -> Option<Axis> {
    let distance = |arrow: &Arrow| {
        let along = arrow.end - arrow.start;
        let part = ((at - arrow.start).dot(along) / along.length_sq()).clamp(0.0, 1.0);
        (at - (arrow.start + part * along)).length()
    };
    let nearest = arrows.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) < REACH).then_some(nearest.axis)
}

/// How far an object moves by a drag along one of its arrows, metres.
pub fn step(arrows: &[Arrow], axis: Axis, drag: UiVec2) -> Vec3 {
    let Some(arrow) = arrows.iter().find(|arrow| arrow.axis == axis) else { return Vec3::ZERO };
    let along = arrow.end - arrow.start;
    arrow.length * drag.dot(along) / along.length_sq() * Vec3::AXES[axis.0]
}

/// Draws the arrows and the object's name.
pub fn paint(painter: &egui::Painter, arrows: &[Arrow], name: &str, held: Option<Axis>) {
    for arrow in arrows {
        let width = if held == Some(arrow.axis) { 5.0 } else { 3.0 };
        let along = arrow.end - arrow.start;
        painter.arrow(arrow.start, along, Stroke::new(width + 2.0, Color32::from_black_alpha(120)));
        painter.arrow(arrow.start, along, Stroke::new(width, COLOURS[arrow.axis.0]));
    }
    if let Some(arrow) = arrows.first() {
        let at = arrow.start + UiVec2::new(8.0, 8.0);
        painter.text(at, egui::Align2::LEFT_TOP, name, egui::FontId::proportional(14.0), Color32::WHITE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Projection;

    #[test]
    fn an_object_follows_the_pointer_along_the_arrow() {
        let projection = Projection::Perspective { fov_y_rad: 0.7 };
        let camera = Camera::look_at(Vec3::new(1.0, 2.0, 4.0), Vec3::ZERO, Vec3::Y, projection).unwrap();
        let area = Rect::from_min_size(Pos2::new(30.0, 40.0), UiVec2::new(640.0, 480.0));
        let arrows = axes(&camera, Vec3::ZERO, area);
        assert_eq!(arrows.len(), 3);
        for (index, arrow) in arrows.iter().enumerate() {
            let middle = arrow.start + 0.6 * (arrow.end - arrow.start);
            assert_eq!(axis_at(&arrows, middle), Some(Axis(index)));
            let moved = step(&arrows, arrow.axis, 0.01 * (arrow.end - arrow.start));
            assert!((moved - 0.01 * arrow.length * Vec3::AXES[index]).length() < 1e-6);
        }
        assert_eq!(axis_at(&arrows, area.min), None);
        assert!(axes(&camera, Vec3::new(2.0, 4.0, 8.0), area).is_empty(), "behind the camera");
    }
}
