//! Receivers right beside mirrors and glass, such as a table along the foot of a wall. Of the wall's cells only the nearest counts there, so
//! that a hierarchical sum depends on how near its middle is. The light is continuous: it is taken from a little off the wall.

use std::borrow::Cow;
use std::f32::consts::TAU;
use std::sync::Arc;

use glam::Vec3;

use crate::lanes::LANES;
use crate::parallel;
use crate::pinhole::Receivers;
use crate::scene::{Ray, Scene};
use crate::stages::Id;
use crate::tracing::{Hit, Tracer};

/// How far off walls receivers are kept, in cells' sizes. Measured at a wall in the light of a forest, as the deviation among points at
/// the same distance: 3.4 % at .14 cells, 1.3 % at .21, .5 % at .29, where it is that of the filter.
const OFF: f32 = 0.25;
/// The same where lamps shine, each of which a wall reflects from one place. Measured in `candle`: 28 % at .1 cells, 16 % at .6, 11 % at 1,
/// 8 % at 2.
const OFF_WITH_LAMPS: f32 = 1.0;

/// How far above its surface a receiver looks for walls, in the distance that it is kept from them.
const RAISED: f32 = 0.5;

/// Keeps receivers off what casts caustics.
#[derive(Clone)]
pub(super) struct MirrorClearance {
    tracer: Arc<Tracer>,
    /// By object.
    casts: Vec<bool>,
    /// Metres.
    distance: f32,
}

impl std::fmt::Debug for MirrorClearance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "MirrorClearance({} m)", self.distance)
    }
}

impl PartialEq for MirrorClearance {
    fn eq(&self, other: &Self) -> bool {
        let Self { tracer, casts, distance } = self;
        Id::of(tracer) == Id::of(&other.tracer) && (casts, distance) == (&other.casts, &other.distance)
    }
}

impl MirrorClearance {
    /// For cells of this area, m².
    pub fn new(scene: &Scene, tracer: &Arc<Tracer>, cell_area: f32, has_lamps: bool) -> Self {
        let casts = scene.objects.iter().map(|object| object.specular().is_some()).collect();
        let sizes = if has_lamps { OFF_WITH_LAMPS } else { OFF };
        Self { tracer: tracer.clone(), casts, distance: sizes * cell_area.max(0.0).sqrt() }
    }

    /// The receivers, those beside what casts caustics moved along their surfaces.
    pub fn receivers<'a>(&self, receivers: &'a Receivers) -> Cow<'a, Receivers> {
        if receivers.lengths.is_some() || self.distance <= 0.0 {
            return Cow::Borrowed(receivers);
        }
        let step = |index: usize| {
            let [position, normal] = [&receivers.positions, &receivers.normals].map(|of| Vec3::from_slice(&of[index]));
            self.step(position, normal, receivers.object(index)?)
        };
        let steps = parallel::collect(receivers.positions.len(), &step);
        if steps.iter().all(Option::is_none) {
            return Cow::Borrowed(receivers);
        }
        let mut moved = receivers.clone();
        for (position, step) in moved.positions.iter_mut().zip(&steps) {
            let Some(step) = step else { continue };
            position.iter_mut().zip(step.to_array()).for_each(|(x, more)| *x += more);
        }
        Cow::Owned(moved)
    }

    /// Where a receiver's light is taken from: where it is, unless it is beside a mirror.
    pub fn place(&self, position: Vec3, normal: Vec3, object: u32) -> Vec3 {
        position + self.step(position, normal, object).unwrap_or(Vec3::ZERO)
    }

    /// How a receiver on an object is moved.
    fn step(&self, position: Vec3, normal: Vec3, object: u32) -> Option<Vec3> {
        if self.casts[object as usize] {
            // What reflects and receives is its own wall.
            return None;
        }
        // What stands on a table may be a little above it.
        let from = position + RAISED * self.distance * normal;
        let (x, y) = normal.any_orthonormal_pair();
        let around: [Vec3; LANES] = std::array::from_fn(|k| {
            let (sine, cosine) = (TAU * k as f32 / LANES as f32).sin_cos();
            cosine * x + sine * y
        });
        let hidden = self.tracer.hidden_lanes(from, &around, self.distance);
        if hidden == 0 {
            return None;
        }
        let hit = |direction: Vec3| self.tracer.secondary_hit(Ray { origin: from, direction });
        let walls = around.iter().enumerate().filter(|(k, _)| hidden >> k & 1 == 1).filter_map(|(_, direction)| {
            hit(*direction).filter(|hit| self.casts[hit.object as usize] && hit.distance < self.distance)
        });
        let nearest: Hit = walls.min_by(|a, b| a.distance.total_cmp(&b.distance))?;
        let away = nearest.face_normal.reject_from(normal).try_normalize()?;
        let lacking = self.distance - (from - nearest.position).dot(away);
        // Not into what is opposite.
        let free = hit(away).map_or(f32::INFINITY, |hit| 0.5 * hit.distance);
        (lacking > 0.0).then(|| lacking.min(free) * away)
    }
}
