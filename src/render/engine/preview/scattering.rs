//! What the medium scatters towards the camera in previews: along one ray for every few pixels, and between them interpolated from rays whose
//! ways through the medium are about as long. What mirrors cast of the light of surfaces is left to whole pictures. GPU twin of the
//! interpolation: `shaders/preview_shading.wgsl`.

use std::sync::Arc;

use glam::{UVec2, Vec2, Vec3, Vec4};

use super::Frame;
use crate::Error;
use crate::engine::scattering::{DirectScattering, MediumRays, contains, scattered_along, unoccluded};
use crate::environment::{CubeMap, Environment, LightSampler};
use crate::parallel;
use crate::pinhole::constants::{MAX_LENGTH_RATIO, MIN_RAY_WEIGHT};
use crate::progress::{Progress, Stage};
use crate::scene::{Medium, Ray, Scene, Visibility};
use crate::stages::{Id, Memo, PreparedLight, PreparedScene};
use crate::technique::Sum;
use crate::tracing::Hit;

/// Parts of a ray, at most: a quarter of those in whole pictures; and shadow rays from each.
const MOST_PARTS: usize = 8;
const RAYS_PER_PART: usize = 4;

/// The medium as camera rays find it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenMedium {
    pub medium: Medium,
    /// Whether the camera is in it.
    pub starts_within: bool,
    /// Whether it fills all space: then what mirrors show of the environment is as bright as what they cast of it.
    pub is_everywhere: bool,
}

impl SeenMedium {
    /// `None` if nothing is seen of any.
    pub fn new(scene: &Scene, prepared: &PreparedScene, is_plain: bool) -> Option<Self> {
        let medium = scene.medium.filter(|_| !is_plain)?;
        let starts_within = contains(scene, &prepared.tracer, scene.camera.position);
        Some(Self { medium, starts_within, is_everywhere: scene.has_medium_everywhere() })
    }
}

/// The light of an environment that a medium scatters, see [`unoccluded`].
pub(super) type UnoccludedStage = Memo<(Id<Environment>, Medium), CubeMap>;

/// What direct light that is scattered is made from.
#[derive(Clone, Debug)]
pub(super) struct ScatteredLight {
    unoccluded: Arc<CubeMap>,
    sampler: Arc<LightSampler>,
}

impl ScatteredLight {
    pub fn new(
        stage: &mut UnoccludedStage,
        light: &PreparedLight,
        medium: Medium,
        sampler: Arc<LightSampler>,
        progress: &dyn Progress,
    ) -> Self {
        let make = || unoccluded(&light.environment.cube, &medium);
        Self { unoccluded: stage.get((Id::of(&light.environment), medium), progress, make), sampler }
    }
}

/// Scattered light along a grid of rays.
#[derive(Debug, Default)]
pub(super) struct ScatteredGrid {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Pixels from ray to ray; the first ones go through the middles of the first pixels.
    pub spacing: u32,
    /// W/(m²·sr), and the length of the way through the medium, metres; row by row.
    pub light: Vec<Vec4>,
}

impl ScatteredGrid {
    /// The light in a pixel whose way through the medium is so long.
    pub fn at(&self, pixel: [usize; 2], length: f32) -> Vec3 {
        let spacing = self.spacing as usize;
        let [columns, rows] = self.size.map(|edge| edge as usize);
        let [left, top] = pixel.map(|place| place / spacing);
        let [u, v] = pixel.map(|place| (place % spacing) as f32 / spacing as f32);
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for (dx, dy, weight) in
            [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)]
        {
            let (column, row) = ((left + dx).min(columns - 1), (top + dy).min(rows - 1));
            let ray = self.light[row * columns + column];
            let ratio = length.max(ray.w) / length.min(ray.w).max(f32::MIN_POSITIVE);
            let likeness = ((MAX_LENGTH_RATIO - ratio) / (MAX_LENGTH_RATIO - 1.0)).max(MIN_RAY_WEIGHT);
            sum += weight * likeness * ray.truncate();
            weights += weight * likeness;
        }
        sum / weights
    }
}

impl Frame<'_> {
    /// Scattered light; `None` where none is seen.
    pub(super) async fn scattered(&self, sum: Option<&dyn Sum>) -> Result<Option<ScatteredGrid>, Error> {
        let (Some(seen), Some(direct)) = (self.medium, &self.scattered_light) else { return Ok(None) };
        if !seen.starts_within {
            return Ok(None);
        }
        self.progress.begin(Stage::Scattering, 1);
        let grid = self.scattered_grid(seen.medium, direct, sum).await;
        self.progress.end(Stage::Scattering);
        grid.map(Some)
    }

    async fn scattered_grid(
        &self,
        medium: Medium,
        direct: &ScatteredLight,
        sum: Option<&dyn Sum>,
    ) -> Result<ScatteredGrid, Error> {
        let (spacing, parts) = (self.detail.spacing(), MOST_PARTS.min(self.options.medium_steps as usize));
        let size = self.options.size.map(|edge| edge.div_ceil(spacing));
        let ray = self.scene.camera.rays(UVec2::from_array(self.options.size).as_vec2());
        let ray = |k: u32| {
            let Ray { origin, direction } =
                ray(Vec2::new((k % size[0]) as f32, (k / size[0]) as f32) * spacing as f32 + 0.5);
            Ray { origin, direction: direction.normalize() }
        };
        let rays: Vec<Ray> = parallel::collect((size[0] * size[1]) as usize, &|k| ray(k as u32));
        let hits: Vec<Option<Hit>> = parallel::map(&rays, &|ray| self.prepared.camera.hit(*ray));
        let rays = MediumRays::new((self.scene, medium), true, rays, &hits, parts);
        let tracer = (self.options.visibility == Visibility::Full).then_some(&*self.prepared.tracer);
        let of_light = (medium, direct.unoccluded.clone());
        let direct = DirectScattering::new(self.light, of_light, &direct.sampler, tracer, [parts, RAYS_PER_PART]);
        let [caustic, direct] = scattered_along(&rays, sum, &direct, self.progress).await?;
        let light = caustic.into_iter().zip(direct).zip(rays.lengths());
        let light =
            light.map(|((caustic, direct), length)| (self.options.caustic_gain * caustic + direct).extend(length));
        Ok(ScatteredGrid { size, spacing, light: light.collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_interpolated_between_rays_of_equal_length() {
        let light = |length| [0.0, 8.0, 16.0].map(|x: f32| Vec3::splat(x).extend(length)).to_vec();
        let even = ScatteredGrid { size: [3, 1], spacing: 4, light: light(2.0) };
        for x in 0..9 {
            assert!((even.at([x, 0], 2.0).x - 2.0 * x as f32).abs() < 1e-5);
        }
        // Beyond an edge, the other side counts for next to nothing.
        let mut edge = even;
        edge.light[1].w = 9.0;
        assert!(edge.at([3, 0], 2.0).x < 0.5 && edge.at([1, 0], 9.0).x > 7.0, "{}", edge.at([3, 0], 2.0));
    }
}
