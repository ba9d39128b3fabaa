//! Light through closed objects (chain TT) in the ground truth, against closed forms.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use glam::{DVec2, Vec3};
use pinspot::NoProgress;
use pinspot::reference::{Density, Options, Reference, StoppingCriterion};
use pinspot::scene::{Chain, Interfaces, Mesh, Object, Refractor, Scene, Visibility, parse};

const INDEX: f64 = 1.5;

/// A small receiver at the origin that faces up and is all that the camera sees.
fn at_origin(light: &str, objects: &str) -> Scene {
    let text = format!(
        "{light}\n[camera]\nposition = [0.0, 0.1, 0.0]\ntarget = [0.0, 0.0, 0.0]\nup = [0.0, 0.0, -1.0]\n\
         orthographic = {{ height = 0.002 }}\n[[object]]\nshape = {{ plane = {{ size = [0.01, 0.01] }} }}\nreceiver = {{}}\n{objects}"
    );
    parse::<toml::Table>("test.toml", &text, Path::new(".")).unwrap().scene
}

fn ball(radius: f64, [x, y]: [f64; 2], keys: &str) -> String {
    format!(
        "[[object]]\nshape = {{ sphere = {{ radius = {radius:?}, divisions = 128 }} }}\ntranslate = [{x:?}, {y:?}, 0.0]\n\
         refractor = {{ eta = {INDEX}, interfaces = 2, {keys} }}\n"
    )
}

/// The irradiance of one pixel and its standard error, W/m².
fn irradiance(scene: &Scene, chains: &[Chain], density: Density, rel_error: f64) -> (f64, f64) {
    let options = Options {
        size: [1, 1],
        chains: chains.iter().copied().collect(),
        visibility: Visibility::Full,
        density,
        ..Options::default()
    };
    let reference = Reference::new(scene.clone(), options).unwrap();
    let criterion = StoppingCriterion::new(rel_error);
    let estimate = reference.solve(&criterion, None, &NoProgress, &mut |_| Ok(())).unwrap();
    (estimate.irradiance.pixels[0].y.into(), estimate.standard_error.pixels[0].y.into())
}

fn assert_close(what: &str, (found, error): (f64, f64), expected: f64, tolerance: f64) {
    println!("{what}: {found} ± {error}, by the closed form {expected}");
    assert!((found - expected).abs() < 5.0 * error + tolerance * expected, "{what}: {found} ± {error}, not {expected}");
}

/// Glass that reflects nothing changes no radiance on the whole: under an even sky a ball of it is as bright as the sky.
#[test]
fn an_even_sky_through_a_ball() {
    let sky = "[environment]\nconstant = [1.0, 1.0, 1.0]";
    let scene = at_origin(sky, &ball(0.4, [0.0, 1.0], "fresnel = false"));
    let found = irradiance(&scene, &[Chain::TT], Density::Bounded, 1e-3);
    assert_close("ball", found, PI * 0.16, 1e-3);
    assert_eq!(irradiance(&scene, &[Chain::TT, Chain::R], Density::Bounded, 1e-3), found, "nothing is reflected");
}

/// A box with faces across all axes.
fn solid_box(low: Vec3, high: Vec3) -> Mesh {
    let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for axis in 0..3 {
        for side in [low, high] {
            let corner = |u: f32, v: f32| {
                let mut corner = side;
                corner[(axis + 1) % 3] = if u > 0.0 { high } else { low }[(axis + 1) % 3];
                corner[(axis + 2) % 3] = if v > 0.0 { high } else { low }[(axis + 2) % 3];
                corner
            };
            let first = positions.len() as u32;
            positions.extend([corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]);
            let outward = if side == high { 1.0 } else { -1.0 };
            normals.extend([outward * Vec3::AXES[axis]; 4]);
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    Mesh::new("box", positions, normals, triangles).unwrap().0
}

/// A lamp seen perpendicularly through a slab looks nearer by the part t (1 − 1/n) of its thickness.
#[test]
fn a_lamp_behind_a_slab() {
    let (height, thickness) = (1.5, 0.4);
    let light = "[environment]\nconstant = [0.0, 0.0, 0.0]\n[[light]]\nposition = [0.0, 1.5, 0.0]\nradius = 0.01\nintensity = [1.0, 1.0, 1.0]";
    let lost = ((INDEX - 1.0) / (INDEX + 1.0)).powi(2);
    for (fresnel, passed) in [(false, 1.0), (true, (1.0 - lost) * (1.0 - lost))] {
        let mut scene = at_origin(light, "");
        let mesh = solid_box(Vec3::new(-0.5, 0.3, -0.5), Vec3::new(0.5, 0.7, 0.5));
        let glass = Refractor { eta: glam::DVec3::splat(INDEX), fresnel, interfaces: Interfaces::Two };
        scene.objects.push(Object { refractor: Some(glass), ..Object::new("slab", mesh) });
        let expected = passed / (height - thickness * (1.0 - 1.0 / INDEX)).powi(2);
        let found = irradiance(&scene, &[Chain::TT], Density::Bounded, 1e-3);
        assert_close("slab", found, expected, 5e-4);
    }
}

/// Where parallel light from above falls on a plane behind a ball: by the angle of incidence the distance from the axis, and the irradiance
/// for 1 W/m² of it.
fn behind_ball(radius: f64, below_centre: f64) -> Vec<(f64, f64)> {
    let place = |i: f64| {
        let r = (i.sin() / INDEX).asin();
        let turned = 2.0 * (i - r);
        radius * (2.0 * r - i).sin() - (below_centre - radius * (2.0 * r - i).cos()) * turned.tan()
    };
    let of_angle = |i: f64| {
        let r = (i.sin() / INDEX).asin();
        let (s, p) = (((i - r).sin() / (i + r).sin()).powi(2), ((i - r).tan() / (i + r).tan()).powi(2));
        let passed = (1.0 - 0.5 * (s + p)).powi(2);
        let step = 1e-5;
        let slope = (place(i + step) - place(i - step)) / (2.0 * step);
        let distance = place(i).abs();
        (distance, passed * radius * i.sin() * radius * i.cos() / (distance * slope.abs()))
    };
    (1..4000).map(|k| of_angle(FRAC_PI_2 * 0.7 * f64::from(k) / 4000.0)).collect()
}

/// The sun behind a ball: as the ball looks alike from everywhere, a wide sun blurs the irradiance by its own shape.
#[test]
fn the_sun_through_a_ball() {
    let (radius, height, sigma) = (0.3, 0.9, 0.03);
    let sun = format!(
        "[environment]\nspot = {{ direction = [0.0, 1.0, 0.0], sigma_rad = {sigma}, radiance = [1.0, 1.0, 1.0] }}"
    );
    let profile = behind_ball(radius, height);
    let at = |distance: f64| {
        let next = profile.partition_point(|(known, _)| *known < distance).clamp(1, profile.len() - 1);
        let ((a, from), (b, to)) = (profile[next - 1], profile[next]);
        from + (to - from) * ((distance - a) / (b - a)).clamp(0.0, 1.0)
    };
    for distance in [0.1, 0.2] {
        let blur = height * sigma;
        let steps = -40..=40;
        let offsets =
            steps.clone().flat_map(|j| steps.clone().map(move |i| DVec2::new(f64::from(i), f64::from(j)) / 10.0));
        let (mut sum, mut weights) = (0.0, 0.0);
        for offset in offsets {
            let weight = (-0.5 * offset.length_squared()).exp();
            sum += weight * at((DVec2::new(distance, 0.0) + blur * offset).length());
            weights += weight;
        }
        let expected = 2.0 * PI * sigma * sigma * sum / weights;
        let scene = at_origin(&sun, &ball(radius, [distance, height], "fresnel = true"));
        let found = irradiance(&scene, &[Chain::TT], Density::Bounded, 2e-3);
        assert_close(&format!("{distance} m from the axis"), found, expected, 0.015);
    }
}

/// Importance sampling by rays that are followed for corners of triangles finds the same light as none.
#[test]
fn importance_sampling_agrees_with_brute_force() {
    let sun = "[environment]\nspot = { direction = [0.3, 1.0, 0.1], sigma_rad = 0.2, radiance = [1.0, 1.0, 1.0] }";
    let scene = at_origin(sun, &ball(0.3, [0.1, 0.7], "fresnel = true"));
    let [fine, brute] = [(Density::Bounded, 1e-3), (Density::Uniform, 4e-3)]
        .map(|(density, error)| irradiance(&scene, &[Chain::TT, Chain::R], density, error));
    println!("{fine:?}, {brute:?}");
    assert!((fine.0 - brute.0).abs() < 5.0 * fine.1.hypot(brute.1), "{fine:?}, {brute:?}");
}
