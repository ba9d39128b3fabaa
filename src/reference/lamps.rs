//! Lamps as the ground truth sees them, in f64: spheres of even radiance, with bounds of what arrives from them.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use super::cone::{Cone, angle};
use super::medium::transmittance;
use crate::scene::{Beam, Lamp, Scene, Slide};

/// All lamps of a scene.
#[derive(Debug, Default)]
pub(super) struct Lamps(Vec<Source>);

/// A lamp.
#[derive(Clone, Debug)]
pub(super) struct Source {
    pub position: DVec3,
    pub radius: f64,
    /// Radiance where its beam is brightest, W/(m²·sr), and its largest sum of channels.
    radiance: DVec3,
    brightest: f64,
    beam: Option<Beam>,
    /// Of what its light passes through, 1/m.
    extinction: DVec3,
    /// Nothing leaves it farther from its beam's axis, radians.
    reach: f64,
}

/// A direction towards a lamp, with what stands behind it.
pub(super) struct Sample {
    /// Unit vector.
    pub direction: DVec3,
    /// The solid angle of the whole lamp, sr.
    pub solid_angle: f64,
    pub radiance: DVec3,
    /// A place in the lamp in that direction.
    pub position: DVec3,
}

impl Lamps {
    /// In a medium of this extinction, 1/m.
    pub fn of_scene(scene: &Scene, extinction: DVec3) -> Self {
        Self(scene.lamps.iter().map(|lamp| Source::new(lamp, extinction)).collect())
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Those of these numbers.
    pub fn only(&self, numbers: &[usize]) -> Self {
        Self(numbers.iter().map(|number| self.0[*number].clone()).collect())
    }

    /// All but those.
    pub fn without(&self, numbers: &[usize]) -> Self {
        let kept: Vec<usize> = (0..self.0.len()).filter(|number| !numbers.contains(number)).collect();
        self.only(&kept)
    }

    pub fn sources(&self) -> &[Source] {
        &self.0
    }

    /// The lamps that a ray from a point meets: where, about, and their radiances.
    pub fn met(&self, from: DVec3, direction: DVec3) -> impl Iterator<Item = (DVec3, DVec3)> {
        let lamp = move |lamp: &Source| {
            let to = lamp.position - from;
            let sine = lamp.radius / to.length();
            (sine < 1.0 && angle(direction, to.normalize()) <= sine.asin())
                .then(|| (from + to.length() * direction, lamp.radiance_at(from)))
        };
        self.0.iter().filter_map(lamp)
    }

    /// A direction towards each lamp from a point, uniform in its solid angle if the two numbers are in [0, 1).
    pub fn samples(&self, from: DVec3, [u, v]: [f64; 2]) -> impl Iterator<Item = Sample> {
        self.0.iter().filter_map(move |lamp| {
            let to = lamp.position - from;
            let sine = lamp.radius / to.length();
            if sine >= 1.0 {
                return None;
            }
            let axis = to.normalize();
            // 1 − cos, without cancellation.
            let depth = sine * sine / (1.0 + (1.0 - sine * sine).sqrt());
            let (across, around) = axis.any_orthonormal_pair();
            let drop = u * depth;
            let from_axis = (drop * (2.0 - drop)).sqrt();
            let turn = TAU * v;
            let direction = (1.0 - drop) * axis + from_axis * (turn.cos() * across + turn.sin() * around);
            let radiance = lamp.radiance_at(from);
            let position = from + to.length() * direction;
            Some(Sample { direction, solid_angle: TAU * depth, radiance, position })
        })
    }

    /// At least the largest sum of the channels' radiances that arrive in a cone of directions at any point of a sphere.
    pub fn bound(&self, (centre, radius): (DVec3, f64), cone: &Cone) -> f64 {
        let is_met = |lamp: &&Source| {
            let seen = lamp.seen_from((centre, radius));
            angle(cone.axis, seen.axis) <= cone.half_angle + seen.half_angle
        };
        self.0.iter().filter(is_met).map(|lamp| lamp.brightest_at((centre, radius))).sum()
    }

    /// At least the largest sum of radiance × solid angle over the lamps that are in a cone of directions.
    pub fn bound_of_irradiance(&self, (centre, radius): (DVec3, f64), cone: &Cone) -> f64 {
        let of_lamp = |lamp: &Source| {
            let seen = lamp.seen_from((centre, radius));
            if angle(cone.axis, seen.axis) > cone.half_angle + seen.half_angle {
                return 0.0;
            }
            let nearest = (lamp.position.distance(centre) - radius).max(lamp.radius);
            lamp.brightest_at((centre, radius)) * TAU.min(2.0 * PI * (lamp.radius / nearest).powi(2))
        };
        self.0.iter().map(of_lamp).sum()
    }
}

impl Source {
    fn new(lamp: &Lamp, extinction: DVec3) -> Self {
        let radius = f64::from(lamp.radius);
        let radiance = lamp.intensity.as_dvec3() / (PI * radius * radius);
        let beam = lamp.beam.clone();
        let (reach, brightest) = match &beam {
            None => (PI, 1.0),
            Some(Beam { slide: Some(Slide(image)), half_angle_rad, .. }) => {
                let aspect = image.width as f64 / image.height as f64;
                let corner = (f64::from(*half_angle_rad).tan() * aspect.hypot(1.0)).atan();
                let most = image.pixels.as_flattened().iter().copied().fold(0.0, f32::max);
                (corner, f64::from(most))
            }
            Some(beam) => (f64::from(beam.half_angle_rad), 1.0),
        };
        let brightest = radiance.element_sum() * brightest;
        Self { position: lamp.position.as_dvec3(), radius, radiance, brightest, beam, extinction, reach }
    }

    /// The largest sum of the channels' irradiances at a distance or beyond, W/m².
    pub fn most_irradiance(&self, distance: f64) -> f64 {
        self.brightest * PI * (self.radius / distance.max(self.radius)).powi(2)
    }

    /// Its radiance, seen from a point, W/(m²·sr); the medium dims it by the distance of its centre.
    pub fn radiance_at(&self, point: DVec3) -> DVec3 {
        self.radiance_towards(point) * transmittance(self.extinction, point.distance(self.position))
    }

    /// Its radiant intensity in the direction of a point, W/sr; the medium dims it by the point's distance.
    pub fn intensity_at(&self, point: DVec3) -> DVec3 {
        PI * self.radius * self.radius * self.radiance_at(point)
    }

    /// The largest sum of the channels of its radiant intensity, W/sr.
    pub fn most_intensity(&self) -> f64 {
        PI * self.radius * self.radius * self.brightest
    }

    /// Whether it shines unevenly.
    pub fn has_beam(&self) -> bool {
        self.beam.is_some()
    }

    fn radiance_towards(&self, point: DVec3) -> DVec3 {
        let Some(beam) = &self.beam else { return self.radiance };
        let axis = beam.direction.as_dvec3();
        let away = (point - self.position).normalize_or_zero();
        let off_axis = angle(axis, away);
        if off_axis >= FRAC_PI_2 {
            return DVec3::ZERO;
        }
        let half_angle = f64::from(beam.half_angle_rad);
        let passed = match &beam.slide {
            None => {
                let fade = (f64::from(beam.softness) * half_angle).max(1e-6);
                let t = ((half_angle - off_axis) / fade).clamp(0.0, 1.0);
                DVec3::splat(t * t * (3.0 - 2.0 * t))
            }
            Some(Slide(image)) => {
                let up = beam.up.as_dvec3();
                let on_slide = away / (away.dot(axis) * half_angle.tan());
                let (width, height) = (image.width as f64, image.height as f64);
                let x = 0.5 * width + 0.5 * height * on_slide.dot(axis.cross(up));
                let y = 0.5 * height * (1.0 - on_slide.dot(up));
                if !(0.0..=width).contains(&x) || !(0.0..=height).contains(&y) {
                    return DVec3::ZERO;
                }
                let along = |at: f64, count: usize| {
                    let at = (at - 0.5).clamp(0.0, (count - 1) as f64);
                    let low = (at as usize).min(count.saturating_sub(2));
                    [(low, 1.0 - (at - low as f64)), ((low + 1).min(count - 1), at - low as f64)]
                };
                let mut mean = DVec3::ZERO;
                for (row, of_row) in along(y, image.height) {
                    for (column, of_column) in along(x, image.width) {
                        let pixel = image.pixels[row * image.width + column].map(f64::from);
                        mean += of_row * of_column * DVec3::from_array(pixel);
                    }
                }
                mean
            }
        };
        self.radiance * passed
    }

    /// The largest sum of its radiances, seen from any point of a sphere.
    pub fn brightest_at(&self, (centre, radius): (DVec3, f64)) -> f64 {
        let nearest = (centre.distance(self.position) - radius).max(0.0);
        let brightest = self.brightest * (-self.extinction.min_element() * nearest).exp();
        let Some(beam) = &self.beam else { return brightest };
        let away = centre - self.position;
        let spread = (radius / away.length()).min(1.0).asin();
        let off_axis = angle(beam.direction.as_dvec3(), away.normalize_or_zero());
        if radius < away.length() && off_axis > self.reach + spread { 0.0 } else { brightest }
    }

    /// The directions in which any part of it lies from any point of a sphere.
    pub fn seen_from(&self, (centre, radius): (DVec3, f64)) -> Cone {
        let to = self.position - centre;
        let distance = to.length();
        if distance <= radius + self.radius {
            return Cone::everything();
        }
        let half_angle = (radius / distance).asin() + (self.radius / (distance - radius)).min(1.0).asin();
        Cone { axis: to / distance, half_angle: half_angle + 1e-12 }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::image::RgbImage;
    use glam::Vec3;
    use rand::{RngExt, SeedableRng};

    fn beam(slide: bool) -> Beam {
        let pixels = (0..12).map(|k| [k as f32 / 11.0, 1.0, 0.5]).collect();
        let slide = slide.then(|| Slide(Arc::new(RgbImage { width: 4, height: 3, pixels })));
        Beam { direction: Vec3::new(0.6, 0.0, 0.8), up: Vec3::Y, half_angle_rad: 0.4, softness: 0.3, slide }
    }

    fn lamps() -> [Lamp; 3] {
        let lamp = Lamp {
            name: String::new(),
            position: Vec3::new(0.2, 0.3, -0.1),
            radius: 0.05,
            intensity: Vec3::new(1.0, 2.0, 0.5),
            beam: None,
            is_distant: false,
        };
        [lamp.clone(), Lamp { beam: Some(beam(false)), ..lamp.clone() }, Lamp { beam: Some(beam(true)), ..lamp }]
    }

    fn in_ball(rng: &mut impl rand::Rng) -> DVec3 {
        loop {
            let p = DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
            if p.length() < 1.0 && p.length() > 1e-3 {
                return p;
            }
        }
    }

    #[test]
    fn radiance_is_that_of_the_scenes_description() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(2);
        for lamp in lamps() {
            let source = Source::new(&lamp, DVec3::ZERO);
            let mut lit = 0;
            for _ in 0..2000 {
                let point = source.position + in_ball(&mut rng);
                let (own, described) = (source.radiance_at(point), lamp.radiance_at(point.as_vec3()).as_dvec3());
                assert!(own.abs_diff_eq(described, 1e-3 * source.brightest), "{lamp:?}: {own} {described}");
                lit += u32::from(own != DVec3::ZERO);
            }
            assert!(lit > 40, "{lit}");
        }
    }

    /// Points of spheres, directions in cones: nothing is brighter than the bound, and directions that samples take meet the lamp.
    #[test]
    fn bounds_hold_and_samples_meet() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(3);
        for lamp in lamps() {
            let lamps = Lamps(vec![Source::new(&lamp, DVec3::ZERO)]);
            let mut met = 0;
            for _ in 0..20_000 {
                let sphere = (2.0 * in_ball(&mut rng), 10f64.powf(rng.random_range(-3.0..0.0)));
                let point = sphere.0 + sphere.1 * in_ball(&mut rng);
                for sample in lamps.samples(point, [rng.random(), rng.random()]) {
                    let arrives: DVec3 = lamps.met(point, sample.direction).map(|(_, radiance)| radiance).sum();
                    assert!(arrives.abs_diff_eq(sample.radiance, 1e-9 * arrives.length()), "{sphere:?}");
                    let half_angle = 10f64.powf(rng.random_range(-3.0..0.0));
                    let axis = (sample.direction + 0.99 * half_angle * in_ball(&mut rng)).normalize();
                    let cone = Cone { axis, half_angle: half_angle.max(angle(axis, sample.direction)) };
                    let sum = arrives.element_sum();
                    assert!(sum <= lamps.bound(sphere, &cone) * (1.0 + 1e-9), "{sphere:?} {cone:?}");
                    let irradiance = lamps.bound_of_irradiance(sphere, &cone);
                    assert!(sum * sample.solid_angle <= irradiance * (1.0 + 1e-9), "{sphere:?} {cone:?}");
                    met += u32::from(sum > 0.0);
                }
            }
            assert!(met > 200, "{met}");
        }
    }
}
