//! Scenes whose irradiance is known.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::pinhole::{Epsilon, Filter, Footprint, Params, Receivers};
use pinspot::low_level::sampling::Strategy;

use crate::support::{BACK_ENDS, floor, median, on_cpu, pinholes_of, scene};

const SPHERE: &str = "[[object]]\nshape = { sphere = { radius = 0.5 } }\ntranslate = [0.0, 1.0, 0.0]\nreflector = {}\n";

/// A convex mirror sphere of radius R under constant radiance L, its centre at distance d and angle θ from the receiver's
/// normal, wholly above the horizon, is seen under the same radiance L everywhere. So it gives what a glowing sphere gives:
/// E = π L sin²(σ) cos θ with sin σ = R/d.
#[test]
fn mirror_sphere_under_constant_light() {
    let pinholes = pinholes_of(&scene(SPHERE), 1000, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(64, None, |_| Vec3::new(1.0, 2.0, 0.5));
    let points: Vec<Vec3> = vec![Vec3::ZERO, Vec3::X * 0.3, Vec3::new(0.6, 0.0, 0.5), Vec3::new(0.0, 0.0, -1.0)];
    let receivers = Receivers::from_points(&points.iter().map(|p| (*p, Vec3::Y, 1)).collect::<Vec<_>>(), 4);
    for (name, gather) in BACK_ENDS {
        for filter in [Filter::None, Filter::Isotropic, Filter::Anisotropic] {
            let got = gather(&receivers, &pinholes, &cube, &Params { filter, ..Default::default() });
            for (point, got) in points.iter().zip(&got) {
                let to_centre = DVec3::Y - point.as_dvec3();
                let d = to_centre.length();
                let expected = PI * (0.5 / d).powi(2) * (to_centre.y / d);
                for (channel, radiance) in [1.0, 2.0, 0.5].into_iter().enumerate() {
                    let ratio = f64::from(got[channel]) / (radiance * expected);
                    assert!((ratio - 1.0).abs() < 0.01, "{name} {filter:?} at {point}: {ratio}");
                }
            }
        }
    }
}

/// A radiance that differs in every direction.
fn uneven(d: Vec3) -> Vec3 {
    Vec3::new(1.0 + 0.8 * d.x, 1.0 + 0.7 * d.y * d.z, 1.2 + (2.0 * d.x + d.z).sin())
}

/// A plane mirror shows the environment's virtual image: E = ∫ L(d mirrored) cos θ dω over the directions d in which the mirror
/// is seen. Here by a fine quadrature over directions, which shares nothing with the sum over the mirror's area.
#[test]
fn plane_mirror_shows_the_virtual_image() {
    // A vertical mirror, 2 × 1, in the plane z = −1, facing +z.
    let mirror = "[[object]]\nshape = { plane = { size = [2.0, 1.0] } }\nrotate_deg = [90.0, 0.0, 0.0]\n\
                  translate = [0.0, 0.6, -1.0]\nreflector = {}\n";
    let pinholes = pinholes_of(&scene(mirror), 1000, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(256, None, uneven);
    let points = [Vec3::ZERO, Vec3::new(0.7, 0.0, 0.4), Vec3::new(-1.0, 0.0, -0.4)];
    let receivers = Receivers::from_points(&points.map(|p| (p, Vec3::Y, 1)), 3);
    for (name, gather) in BACK_ENDS {
        let got = gather(&receivers, &pinholes, &cube, &Params::default());
        for (point, got) in points.iter().zip(&got) {
            let expected = virtual_image(point.as_dvec3());
            for channel in 0..3 {
                let ratio = f64::from(got[channel]) / expected[channel];
                assert!((ratio - 1.0).abs() < 0.01, "{name} at {point}, channel {channel}: {ratio}");
            }
        }
    }
}

fn virtual_image(point: DVec3) -> DVec3 {
    let n = 1500;
    let mut sum = DVec3::ZERO;
    for i in 0..n {
        // Uniform in sin²θ and in azimuth: cos θ dω is the same for all.
        let sin2 = (f64::from(i) + 0.5) / f64::from(n);
        for j in 0..2 * n {
            let azimuth = PI * (f64::from(j) + 0.5) / f64::from(n);
            let d = DVec3::new(sin2.sqrt() * azimuth.cos(), (1.0 - sin2).sqrt(), sin2.sqrt() * azimuth.sin());
            let t = (-1.0 - point.z) / d.z;
            let at = point + t * d;
            if t > 0.0 && at.x.abs() < 1.0 && (at.y - 0.6).abs() < 0.5 {
                sum += uneven(Vec3::new(d.x as f32, d.y as f32, -d.z as f32)).as_dvec3();
            }
        }
    }
    sum * PI / f64::from(n) / f64::from(2 * n)
}

/// The sum converges to one irradiance whatever places the samples: with the cells' own areas for every strategy, with A/N
/// for those that are area-uniform.
#[test]
fn strategies_agree_on_the_energy() {
    let ring = scene(
        "[[object]]\nshape = { ring = { radius = 1.0, height = 0.5 } }\ntranslate = [0.0, 0.2, 0.0]\nreflector = {}\n",
    );
    let cube = CubeMap::from_radiance(64, None, uneven);
    let receivers = floor(1.6, 12);
    let total = |strategy, footprint, seed| -> f64 {
        let pinholes = pinholes_of(&ring, 2000, strategy, footprint, seed);
        on_cpu(&receivers, &pinholes, &cube, &Params::default()).iter().map(|e| f64::from(e[0] + e[1] + e[2])).sum()
    };
    let expected = total(Strategy::Neighbourhood, Footprint::Cells, 7);
    use Strategy::{Grid, Neighbourhood, QuantisedGrid, Random};
    for (strategy, footprint, tolerance) in [
        (Random, Footprint::Cells, 0.01),
        (Grid, Footprint::Cells, 0.01),
        (QuantisedGrid, Footprint::Cells, 0.01),
        (Neighbourhood, Footprint::Curvature, 0.01),
        // Independent points: 2 000 of them leave a few percent.
        (Random, Footprint::Curvature, 0.03),
    ] {
        let ratio = median((1..=3).map(|seed| total(strategy, footprint, seed)).collect()) / expected;
        assert!((ratio - 1.0).abs() < tolerance, "{strategy:?} {footprint:?}: {ratio}");
    }
}

/// Seen from everywhere, a mirror under constant light shows that light: on its own surface, too. ε must not change it much.
#[test]
fn epsilon_keeps_the_energy_between_objects() {
    let pinholes = pinholes_of(&scene(SPHERE), 1000, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    let receivers = floor(1.0, 8);
    let total = |epsilon| -> f64 {
        let params = Params { epsilon, ..Default::default() };
        on_cpu(&receivers, &pinholes, &cube, &params).iter().map(|e| f64::from(e[0])).sum()
    };
    let none = total(Epsilon::Value(0.0));
    assert_eq!(total(Epsilon::Auto), none, "auto changes nothing between different objects");
    let paper = total(Epsilon::Paper) / none;
    assert!(paper < 1.0 && paper > 0.95, "{paper}");
}

/// A sample on its own object, closer than its radius, is held back; on another object it is not.
#[test]
fn epsilon_auto_holds_on_the_samples_own_object_only() {
    let pinholes = pinholes_of(&scene(SPHERE), 100, Strategy::Neighbourhood, Footprint::Cells, 1);
    let sample = pinholes.samples[0];
    let normal = sample.normal();
    let point = sample.position() + 0.1 * sample.area().sqrt() * normal;
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    for (name, gather) in BACK_ENDS {
        let at = |object| {
            let receivers = Receivers::from_points(&[(point, -normal, object)], 1);
            f64::from(gather(&receivers, &vec![sample].into(), &cube, &Params::default())[0][0])
        };
        let l2 = f64::from((point - sample.position()).length_squared());
        let (own, other) = (at(0), at(1));
        assert!((other / (f64::from(sample.area()) / l2) - 1.0).abs() < 1e-3, "{name}: {other}");
        assert!((own / PI - 1.0).abs() < 1e-3, "{name}: {own}");
    }
}

/// Without attenuation only the cosines are left.
#[test]
fn attenuation_can_be_dropped() {
    let pinholes = pinholes_of(&scene(SPHERE), 200, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    let point = Vec3::new(0.4, 0.0, 0.1);
    let receivers = Receivers::from_points(&[(point, Vec3::Y, 1)], 1);
    let expected: f64 = pinholes
        .samples
        .iter()
        .map(|s| {
            let d = (s.position() - point).normalize();
            f64::from(s.area() * (-d.dot(s.normal())).max(0.0) * d.y)
        })
        .sum();
    for (name, gather) in BACK_ENDS {
        let got = gather(&receivers, &pinholes, &cube, &Params { attenuation: false, ..Default::default() });
        assert!((f64::from(got[0][0]) / expected - 1.0).abs() < 1e-4, "{name}");
    }
}
