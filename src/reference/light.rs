//! The environment as the ground truth sees it: radiance by direction from the original image or the analytic spot, in f64, and
//! upper bounds of it over cones of directions. Its own look-ups: of `environment` it uses the file readers alone.

use glam::{DMat3, DVec3};

use super::cone::{Cone, angle};
use super::map::Map;
use crate::maps::{EnvironmentError, built_in_map};
use crate::scene::{EnvironmentSource, Light as Source};

/// The environment.
#[derive(Debug)]
pub(super) struct Light {
    kind: Kind,
    local_from_world: DMat3,
    intensity: f64,
}

#[derive(Debug)]
enum Kind {
    Map(Box<Map>),
    Spot { direction: DVec3, sigma_rad: f64, radiance: DVec3 },
    Constant(DVec3),
}

impl Light {
    /// The one that a scene describes.
    pub fn new(source: &EnvironmentSource) -> Result<Self, EnvironmentError> {
        let kind = match &source.light {
            Source::Constant(radiance) => Kind::Constant(radiance.as_dvec3()),
            Source::Spot { direction, sigma_rad, radiance } => Kind::Spot {
                direction: direction.as_dvec3().normalize(),
                sigma_rad: f64::from(*sigma_rad),
                radiance: radiance.as_dvec3(),
            },
            Source::BuiltInMap(name) => Kind::Map(Box::new(Map::new(&built_in_map(name)?))),
            Source::Map(map) => Kind::Map(Box::new(Map::new(map))),
        };
        let local_from_world = DMat3::from_rotation_y(-f64::from(source.rotation_rad));
        Ok(Self { kind, local_from_world, intensity: f64::from(source.intensity) })
    }

    /// None.
    pub fn dark() -> Self {
        Self { kind: Kind::Constant(DVec3::ZERO), local_from_world: DMat3::IDENTITY, intensity: 0.0 }
    }

    /// Whether there is none.
    pub fn is_dark(&self) -> bool {
        self.bound(&Cone::everything()) == 0.0
    }

    /// Radiance that arrives from a unit direction, W/(m²·sr).
    pub fn radiance(&self, direction_in_world: DVec3) -> DVec3 {
        let d = self.local_from_world * direction_in_world;
        self.intensity
            * match &self.kind {
                Kind::Map(map) => map.radiance(d),
                Kind::Constant(radiance) => *radiance,
                Kind::Spot { direction, sigma_rad, radiance } => *radiance * gaussian(angle(d, *direction), *sigma_rad),
            }
    }

    /// At least the largest sum of the three channels over a cone of directions.
    pub fn bound(&self, cone: &Cone) -> f64 {
        let Cone { axis, half_angle } = *cone;
        let axis = self.local_from_world * axis;
        self.intensity
            * match &self.kind {
                Kind::Map(map) => map.bound(axis, half_angle),
                Kind::Constant(radiance) => radiance.element_sum(),
                Kind::Spot { direction, sigma_rad, radiance } => {
                    let nearest = (angle(axis, *direction) - half_angle).max(0.0);
                    radiance.element_sum() * gaussian(nearest, *sigma_rad)
                }
            }
    }
}

fn gaussian(angle: f64, sigma: f64) -> f64 {
    (-0.5 * (angle / sigma).powi(2)).exp()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::sync::Arc;

    use super::*;
    use crate::image::RgbImage;
    use crate::scene::{EnvironmentMap, MapLayout};
    use glam::Vec3;
    use rand::{RngExt, SeedableRng};

    fn random_direction(rng: &mut impl rand::Rng) -> DVec3 {
        loop {
            let d = DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
            if d.length() < 1.0
                && let Some(d) = d.try_normalize()
            {
                return d;
            }
        }
    }

    /// Nothing within a cone is brighter than the cone's bound: random cones of all sizes, random directions in them.
    #[test]
    fn bounds_hold() {
        let lights = [
            Source::Spot { direction: Vec3::new(0.6, 0.8, 0.0), sigma_rad: 0.05, radiance: Vec3::ONE },
            Source::BuiltInMap("forest".into()),
            Source::Constant(Vec3::ONE),
        ];
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(3);
        let of_source = |light| Light::new(&EnvironmentSource { light, rotation_rad: 0.7, intensity: 2.0 });
        for light in lights.into_iter().map(of_source) {
            let light = light.expect("it loads");
            for _ in 0..20_000 {
                let cone =
                    Cone { axis: random_direction(&mut rng), half_angle: PI * 10f64.powf(rng.random_range(-5.0..0.0)) };
                let (u, _) = cone.axis.any_orthonormal_pair();
                let towards = DMat3::from_axis_angle(cone.axis, rng.random_range(0.0..6.3)) * u;
                let off: f64 = cone.half_angle * rng.random_range(0.0f64..1.0).sqrt();
                let inside = cone.axis * off.cos() + towards * off.sin();
                let (radiance, bound) = (light.radiance(inside).element_sum(), light.bound(&cone));
                assert!(radiance <= bound * (1.0 + 1e-9), "{light:?}: {radiance} > {bound} in {cone:?}");
            }
        }
    }

    /// The same directions as the engine's own look-up, which a test of six colours pins, for every layout.
    #[test]
    fn look_ups_agree_with_the_engines() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(5);
        for (layout, width, height) in [
            (MapLayout::Latlong, 64, 32),
            (MapLayout::Angular, 64, 64),
            (MapLayout::VerticalCross, 48, 64),
            (MapLayout::HorizontalCross, 64, 48),
        ] {
            let pixel = |k: usize| [(k % width) as f32, (k / width) as f32, 1.0];
            let image = RgbImage { width, height, pixels: (0..width * height).map(pixel).collect() };
            let map = EnvironmentMap::new(vec![("map".into(), Arc::new(image))], layout).unwrap();
            let source = EnvironmentSource { light: Source::Map(map), rotation_rad: 0.3, intensity: 1.5 };
            let light = Light::new(&source).unwrap();
            let engines_light = pinspot_sums::environment::EnvironmentRadiance::new(&source.light).unwrap();
            let light_from_world = glam::Mat3::from_rotation_y(-source.rotation_rad);
            let mut differing = 0;
            for _ in 0..2000 {
                let d = random_direction(&mut rng);
                let engines = source.intensity * engines_light.radiance(light_from_world * d.as_vec3());
                let (own, engines) = (light.radiance(d), engines.as_dvec3());
                differing += u32::from(!own.abs_diff_eq(engines, 0.02));
            }
            // A direction within rounding of a face's edge may fall on either side.
            assert!(differing <= 2, "{layout:?}: {differing} of 2000 look-ups differ");
        }
    }
}
