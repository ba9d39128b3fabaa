//! Arrows along the world's axes by which the selected object is dragged, and rings around them by which it is turned.

use eframe::egui;
use egui::{Color32, Pos2, Rect, Stroke, Vec2 as UiVec2};
use glam::{Vec2, Vec3};

use crate::scene::Camera;

/// Length of the arrows, as a fraction of the window's height.
const LENGTH: f32 = 0.16;
/// An arrow is taken hold of within this distance, points.
const REACH: f32 = 9.0;
/// Radius of the rings, in lengths of the arrows.
const RING_RADIUS: f32 = 0.75;
/// Corners of a ring.
const RING_CORNERS: usize = 48;
/// Edges on either side of the nearest one that tell the direction in which a ring turns.
const CHORD: usize = 2;
/// The largest turn by one move of the pointer.
const MAX_TURN_RAD: f32 = 0.5;
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

/// A ring around an axis, counter-clockwise; its first point comes again at the end.
#[derive(Clone, Debug)]
pub struct Ring {
    axis: Axis,
    points: Vec<Pos2>,
}

/// What the selected object is taken hold of by.
#[derive(Clone, Debug, Default)]
pub struct Gizmo {
    pub arrows: Vec<Arrow>,
    pub rings: Vec<Ring>,
}

/// A part of the gizmo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    Arrow(Axis),
    Ring(Axis),
}

impl Axis {
    /// Its unit vector.
    pub fn direction(self) -> Vec3 {
        Vec3::AXES[self.0]
    }
}

impl Arrow {
    /// Where it begins and where it ends.
    #[cfg(test)]
    pub fn ends(&self) -> (Pos2, Pos2) {
        (self.start, self.end)
    }
}

impl Ring {
    /// Corners of it.
    #[cfg(test)]
    pub fn points(&self) -> &[Pos2] {
        &self.points
    }

    /// The distance of a place in the window, and the edge that is nearest to it.
    fn nearest(&self, at: Pos2) -> (f32, usize) {
        let distance = |k: usize| distance_to(at, [self.points[k], self.points[k + 1]]);
        let nearest = (0..RING_CORNERS).map(|k| (distance(k), k)).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.unwrap_or((f32::INFINITY, 0))
    }

    /// How far a drag at a place turns the object, radians.
    pub fn turn(&self, at: Pos2, drag: UiVec2) -> f32 {
        let (_, edge) = self.nearest(at);
        // Over some edges: single ones are very short where the ring is seen from its side.
        let corner = |k: usize| self.points[k % RING_CORNERS];
        let along = corner(edge + 1 + CHORD) - corner(edge + RING_CORNERS - CHORD);
        if along.length() < LEAST_LENGTH {
            return 0.0;
        }
        let angle = std::f32::consts::TAU * (2 * CHORD + 1) as f32 / RING_CORNERS as f32;
        (angle * drag.dot(along) / along.length_sq()).clamp(-MAX_TURN_RAD, MAX_TURN_RAD)
    }
}

/// The distance of a place from the line between two others.
fn distance_to(at: Pos2, [start, end]: [Pos2; 2]) -> f32 {
    let along = end - start;
    let part = ((at - start).dot(along) / along.length_sq().max(1e-12)).clamp(0.0, 1.0);
    (at - (start + part * along)).length()
}

impl Gizmo {
    /// That of an object at a place in the world; empty if it is behind the camera.
    pub fn new(camera: &Camera, middle: Vec3, area: Rect) -> Self {
        Self { arrows: axes(camera, middle, area), rings: rings(camera, middle, area) }
    }

    /// The part at a place in the window.
    pub fn at(&self, at: Pos2) -> Option<Handle> {
        if let Some(axis) = axis_at(&self.arrows, at) {
            return Some(Handle::Arrow(axis));
        }
        let distance = |ring: &&Ring| ring.nearest(at).0;
        let nearest = self.rings.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        (distance(&nearest) < REACH).then_some(Handle::Ring(nearest.axis))
    }

    /// The ring around an axis.
    pub fn ring(&self, axis: Axis) -> Option<&Ring> {
        self.rings.iter().find(|ring| ring.axis == axis)
    }
}

/// Lengths of arrows, metres, for a place in the world; `None` behind the camera.
fn length_at(camera: &Camera, middle: Vec3, area: Rect) -> Option<f32> {
    let size = Vec2::new(area.width(), area.height());
    // A metre across the picture at the object's depth, in points.
    let [(start, depth), (beside, _)] = [middle, middle + camera.right].map(|point| camera.project(point, size));
    (depth > 0.0).then(|| LENGTH * area.height() / (beside - start).length().max(1e-6))
}

fn rings(camera: &Camera, middle: Vec3, area: Rect) -> Vec<Ring> {
    let Some(length) = length_at(camera, middle, area) else { return Vec::new() };
    let size = Vec2::new(area.width(), area.height());
    let ring = |index: usize| {
        let (u, v) = (Vec3::AXES[(index + 1) % 3], Vec3::AXES[(index + 2) % 3]);
        let point = |k: usize| {
            let (sin, cos) = (std::f32::consts::TAU * k as f32 / RING_CORNERS as f32).sin_cos();
            let (pixel, depth) = camera.project(middle + RING_RADIUS * length * (cos * u + sin * v), size);
            (depth > 0.0).then(|| area.min + UiVec2::new(pixel.x, pixel.y))
        };
        Some(Ring { axis: Axis(index), points: (0..=RING_CORNERS).map(point).collect::<Option<_>>()? })
    };
    (0..3).filter_map(ring).collect()
}

/// The arrows of an object at a place in the world; none if it is behind the camera.
fn axes(camera: &Camera, middle: Vec3, area: Rect) -> Vec<Arrow> {
    let size = Vec2::new(area.width(), area.height());
    let place = |point: Vec3| {
        let (pixel, depth) = camera.project(point, size);
        (depth > 0.0).then(|| area.min + UiVec2::new(pixel.x, pixel.y))
    };
    let Some(start) = place(middle) else { return Vec::new() };
    let Some(length) = length_at(camera, middle, area) else { return Vec::new() };
    let arrow = |index: usize| {
        let end = place(middle + length * Vec3::AXES[index])?;
        Some(Arrow { axis: Axis(index), start, end, length })
    };
    (0..3).filter_map(arrow).filter(|arrow| (arrow.end - arrow.start).length() > LEAST_LENGTH).collect()
}

/// The arrow at a place in the window.
fn axis_at(arrows: &[Arrow], at: Pos2) -> Option<Axis> {
    let distance = |arrow: &Arrow| distance_to(at, [arrow.start, arrow.end]);
    let nearest = arrows.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) < REACH).then_some(nearest.axis)
}

/// How far an object moves by a drag along one of its arrows, metres.
pub fn step(arrows: &[Arrow], axis: Axis, drag: UiVec2) -> Vec3 {
    let Some(arrow) = arrows.iter().find(|arrow| arrow.axis == axis) else { return Vec3::ZERO };
    let along = arrow.end - arrow.start;
    arrow.length * drag.dot(along) / along.length_sq() * Vec3::AXES[axis.0]
}

/// Draws arrows and rings, and the object's name.
pub fn paint(painter: &egui::Painter, Gizmo { arrows, rings }: &Gizmo, name: &str, held: Option<Handle>) {
    for ring in rings {
        let width = if held == Some(Handle::Ring(ring.axis)) { 3.5 } else { 1.5 };
        painter.line(ring.points.clone(), Stroke::new(width + 1.5, Color32::from_black_alpha(90)));
        painter.line(ring.points.clone(), Stroke::new(width, COLOURS[ring.axis.0]));
    }
    for arrow in arrows {
        let width = if held == Some(Handle::Arrow(arrow.axis)) { 5.0 } else { 3.0 };
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

    fn view() -> (Camera, Rect) {
        let projection = Projection::Perspective { fov_y_rad: 0.7 };
        let camera = Camera::look_at(Vec3::new(1.0, 2.0, 4.0), Vec3::ZERO, Vec3::Y, projection).unwrap();
        (camera, Rect::from_min_size(Pos2::new(30.0, 40.0), UiVec2::new(640.0, 480.0)))
    }

    /// A point of the ring goes where the pointer drags it.
    #[test]
    fn an_object_turns_with_the_pointer_along_the_ring() {
        let (camera, area) = view();
        let gizmo = Gizmo::new(&camera, Vec3::ZERO, area);
        assert_eq!(gizmo.rings.len(), 3);
        for ring in &gizmo.rings {
            let (from, to) = (ring.points[5], ring.points[6]);
            let turn = ring.turn(from + 0.5 * (to - from), to - from);
            assert!((turn * RING_CORNERS as f32 / std::f32::consts::TAU - 1.0).abs() < 0.1, "{turn}");
            let on_ring = (0..RING_CORNERS).filter(|&k| gizmo.at(ring.points[k]) == Some(Handle::Ring(ring.axis)));
            assert!(on_ring.count() > RING_CORNERS / 3, "rings and arrows cross, but not everywhere");
        }
    }

    #[test]
    fn an_object_follows_the_pointer_along_the_arrow() {
        let (camera, area) = view();
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
