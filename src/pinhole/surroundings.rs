//! What mirrors see of lit surfaces: the radiance and the planes of the scene around the middles of several groups of cells.
//!
//! A cell looks up the view from the nearest middle; directions are corrected for the way from there to the cell (parallax).

use glam::Vec3;

use crate::environment::{CubeMap, LightBounds};

/// The views from all middles.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// At least one.
    pub views: Vec<SurroundingView>,
}

/// The scene around a point.
#[derive(Clone, Debug)]
pub struct SurroundingView {
    /// The point, metres.
    pub middle: Vec3,
    /// Radiance of what is seen, W/(m²·sr); black where nothing is.
    pub radiance: CubeMap,
    /// Bounds of that.
    pub bounds: LightBounds,
    /// The planes of what is seen, 1/m: the unit normal, away from the middle, over the plane's distance; zero where nothing is. Points of
    /// a plane, relative to the middle, have a product of 1 with it.
    pub planes: CubeMap,
    /// One over the distance of the nearest surface, 1/m.
    pub max_nearness: f32,
}

impl SurroundingView {
    /// From both, in world directions.
    pub fn new(middle: Vec3, radiance: CubeMap, planes: CubeMap, max_nearness: f32) -> Self {
        let bounds = LightBounds::new(&radiance);
        Self { middle, radiance, bounds, planes, max_nearness }
    }

    /// How far the direction of anything that is seen may turn from the middle to the points of a cell, radians.
    pub fn spread(&self, position: Vec3, radius: f32) -> f32 {
        let sine = (position.distance(self.middle) + radius) * self.max_nearness;
        // An arc is at most this much longer than its sine.
        if sine < 1.0 { sine * std::f32::consts::FRAC_PI_2 } else { std::f32::consts::PI }
    }
}

impl Surroundings {
    /// Width of the views' texels at a face's centre, radians.
    pub fn texel_rad(&self) -> f32 {
        2.0 / self.views.first().map_or(1, |view| view.radiance.size()) as f32
    }

    /// The view for a cell.
    pub fn nearest(&self, position: Vec3) -> &SurroundingView {
        let distance = |view: &&SurroundingView| view.middle.distance_squared(position);
        self.views.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("there is a view")
    }
}
