//! Finished caustic maps: the irradiance on the receivers that a view shows, and how it is looked up. Knows no photons.

use std::sync::Arc;

use glam::{DVec2, Vec3};

use super::receiver_layers::ReceiverLayers;

/// Irradiance on the receivers that a map shows.
#[derive(Clone, Debug)]
pub struct IrradianceMap {
    /// What its texels show.
    pub(super) shown: Arc<ReceiverLayers>,
    /// Of each texel, W/m².
    pub(super) irradiance: Vec<Vec3>,
    /// Of each texel.
    pub(super) gloss: GlossOfTexels,
}

/// What glossy receivers know of their light.
#[derive(Clone, Debug)]
pub(super) enum GlossOfTexels {
    /// There are none.
    Unknown,
    /// The mean directions in which it travels, unit length; zero where there is none.
    Directions(Vec<Vec3>),
    /// What they reflect of it to the viewer of the map, W/(m²·sr).
    Reflected(Vec<Vec3>),
}

/// Light on a receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Incident {
    /// W/m².
    pub irradiance: Vec3,
    /// The mean direction in which it travels, unit length; zero where maps have none.
    pub direction: Vec3,
    /// What a glossy receiver reflects of it to the viewer, W/(m²·sr), where maps know that.
    pub reflected: Option<Vec3>,
}

/// A picture of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct MapPicture {
    /// Columns and rows.
    pub size: [u32; 2],
    /// The brightest of the layers in each texel, as a mean over texels of the map; W/m².
    pub irradiance: Vec<Vec3>,
}

impl IrradianceMap {
    /// Mixes it with another map of the same receivers, which is so much of the mean.
    pub fn mix(&mut self, other: &Self, part: f32) {
        match (&mut self.gloss, &other.gloss) {
            (GlossOfTexels::Directions(own), GlossOfTexels::Directions(others)) => {
                let of_flux = |light: Vec3, part: f32| part * light.element_sum();
                let weights = self.irradiance.iter().zip(&other.irradiance);
                for ((own, other), (light, others)) in own.iter_mut().zip(others).zip(weights) {
                    let sum = of_flux(*light, 1.0 - part) * *own + of_flux(*others, part) * *other;
                    *own = sum.normalize_or_zero();
                }
            }
            (GlossOfTexels::Reflected(own), GlossOfTexels::Reflected(others)) => {
                own.iter_mut().zip(others).for_each(|(own, other)| *own = own.lerp(*other, part));
            }
            _ => (),
        }
        self.irradiance.iter_mut().zip(&other.irradiance).for_each(|(own, other)| *own = own.lerp(*other, part));
    }

    /// A picture with at most so many texels along an edge.
    pub fn picture(&self, most: u32) -> MapPicture {
        let [width, height] = self.shown.projection().size;
        let step = width.max(height).div_ceil(most).max(1);
        let count = self.shown.projection().texel_count();
        let brightest = |x: u32, y: u32| {
            let layers = ((y * width + x) as usize..self.irradiance.len()).step_by(count);
            layers.fold(Vec3::ZERO, |most, index| most.max(self.irradiance[index]))
        };
        let size = [width, height].map(|edge| edge.div_ceil(step));
        let mean = |k: u32| {
            let [x, y] = [k % size[0] * step, k / size[0] * step];
            let texels = (y..(y + step).min(height)).flat_map(|y| (x..(x + step).min(width)).map(move |x| (x, y)));
            let (sum, count) = texels.fold((Vec3::ZERO, 0.0), |(sum, n), (x, y)| (sum + brightest(x, y), n + 1.0));
            sum / count
        };
        MapPicture { size, irradiance: (0..size[0] * size[1]).map(mean).collect() }
    }

    /// The light at a point of an object on the side of a normal, as the mean over the texel that shows it, and the part of the texel that does;
    /// `None` where none does.
    pub fn nearest(&self, point: Vec3, normal: Vec3, object: u32) -> Option<(Incident, f32)> {
        let place = self.shown.projection().project(point)?;
        let index = self.shown.point_near(place, point, (normal, object))?;
        let light = Incident {
            irradiance: self.irradiance[index],
            direction: self.direction(index),
            reflected: self.reflected(index),
        };
        Some((light, self.shown.texel(index).part))
    }

    /// The same, interpolated between those of the four texels around that show it or, if none does, from the nearest one.
    pub fn bilinear(&self, point: Vec3, normal: Vec3, object: u32) -> Option<Incident> {
        let view = self.shown.projection();
        let place = view.project(point)?;
        // What lies beyond the edge of a cube's face belongs to another one.
        view.index(place)?;
        let place = place - 0.5;
        let (low, part) = (place.floor(), (place - place.floor()).as_vec2());
        let (mut light, mut weights) = (Incident::default(), 0.0);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let place = low + DVec2::new(dx, dy) + 0.5;
            let Some(index) = self.shown.point_at(place, point, (normal, object)) else { continue };
            let along = |step: f64, part: f32| if step == 0.0 { 1.0 - part } else { part };
            let weight = along(dx, part.x) * along(dy, part.y);
            light.irradiance += weight * self.irradiance[index];
            light.direction += weight * self.irradiance[index].element_sum() * self.direction(index);
            weights += weight;
        }
        let (irradiance, direction) = (light.irradiance / weights, light.direction.normalize_or_zero());
        let mean = (weights > 1e-3).then_some(Incident { irradiance, direction, reflected: None });
        mean.or_else(|| self.nearest(point, normal, object).map(|(light, _)| light))
    }

    fn direction(&self, index: usize) -> Vec3 {
        if let GlossOfTexels::Directions(directions) = &self.gloss { directions[index] } else { Vec3::ZERO }
    }

    fn reflected(&self, index: usize) -> Option<Vec3> {
        if let GlossOfTexels::Reflected(reflected) = &self.gloss { Some(reflected[index]) } else { None }
    }
}
