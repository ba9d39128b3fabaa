//! What mirrors see of lit surfaces: reflection probes, which store the radiance and the planes of the scene around several viewpoints.
//!
//! A cell looks up the view from the nearest viewpoint; directions are corrected for the parallax between the two.

use glam::Vec3;

use super::constants::OTHER_SIDE;
use crate::environment::{CubeMap, LightBounds};

/// The views from all viewpoints.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// At least one.
    pub views: Vec<SurroundingView>,
}

/// A point from where the scene is seen.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    /// World position, metres.
    pub position: Vec3,
    /// The unit normal of the surface that it lies on; zero where its side does not matter.
    pub normal: Vec3,
}

impl Viewpoint {
    /// The square of the distance to a place on a surface with this normal, m²; viewpoints on the other side of a thin surface count as far away.
    pub fn distance_squared(&self, position: Vec3, normal: Vec3) -> f32 {
        let is_behind = self.normal.dot(normal) < 0.0;
        self.position.distance_squared(position) * if is_behind { OTHER_SIDE * OTHER_SIDE } else { 1.0 }
    }
}

/// The scene around a point.
#[derive(Clone, Debug)]
pub struct SurroundingView {
    /// The point.
    pub viewpoint: Viewpoint,
    /// Radiance of what is seen, W/(m²·sr); black where nothing is.
    pub radiance: CubeMap,
    /// Bounds of that.
    pub bounds: LightBounds,
    /// The planes of what is seen, 1/m: the unit normal, away from the viewpoint, over the plane's distance; zero where nothing is. Points of
    /// a plane, relative to the viewpoint, have a product of 1 with it.
    pub planes: CubeMap,
    /// One over the distance of the nearest surface, 1/m.
    pub max_nearness: f32,
}

impl SurroundingView {
    /// From both, in world directions.
    pub fn new(viewpoint: Viewpoint, radiance: CubeMap, planes: CubeMap, max_nearness: f32) -> Self {
        let bounds = LightBounds::new(&radiance);
        Self { viewpoint, radiance, bounds, planes, max_nearness }
    }

    /// How far the direction of anything that is seen may turn from the viewpoint to the points of a cell, radians.
    pub fn spread(&self, position: Vec3, radius: f32) -> f32 {
        let sine = (position.distance(self.viewpoint.position) + radius) * self.max_nearness;
        // An arc is at most π/2 times its sine.
        if sine < 1.0 { sine * std::f32::consts::FRAC_PI_2 } else { std::f32::consts::PI }
    }
}

impl Surroundings {
    /// Width of the views' texels at a face's centre, radians.
    pub fn texel_rad(&self) -> f32 {
        2.0 / self.views.first().map_or(1, |view| view.radiance.size()) as f32
    }

    /// The view for a cell of this position and normal.
    pub fn nearest(&self, position: Vec3, normal: Vec3) -> &SurroundingView {
        let distance = |view: &&SurroundingView| view.viewpoint.distance_squared(position, normal);
        self.views.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("there is a view")
    }
}
