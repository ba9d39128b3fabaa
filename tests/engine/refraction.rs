//! Interfaces between two media against closed forms, the ground truth and direct light.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::pinhole::{Footprint, Params, Receivers};
use pinspot::low_level::sampling::Strategy;
use pinspot::reference::{self, Reference, StoppingCriterion};
use pinspot::scene::{Scene, Visibility, parse};
use pinspot::{BackendChoice, CubeSize, NoProgress, Options};

use crate::support::{BACK_ENDS, above_floor, pinholes_of, render, scene, transmittance};

/// Light like a sun: radiance 1 at its centre, L(θ) = exp(−θ²/2σ²).
fn sun(towards: Vec3, sigma: f32) -> CubeMap {
    CubeMap::from_radiance(256, None, move |d| Vec3::splat((-0.5 * (d.angle_between(towards) / sigma).powi(2)).exp()))
}

/// Irradiance of that sun on a surface that faces it: ∫ L cos θ dω.
fn sun_irradiance(sigma: f64) -> f64 {
    let steps = 20_000;
    let width = 8.0 * sigma / f64::from(steps);
    let ring = |k: u32| {
        let angle = (f64::from(k) + 0.5) * width;
        2.0 * PI * angle.sin() * angle.cos() * (-0.5 * (angle / sigma).powi(2)).exp() * width
    };
    (0..steps).map(ring).sum()
}

/// The sun through flat water: E = E₀ cosθ T for each colour, wherever it is.
#[test]
fn flat_water_in_the_sun() {
    let (towards, sigma) = (Vec3::new(0.48, 0.8, 0.36), 0.04);
    let cube = sun(towards, sigma);
    for indices in [[1.333; 3], [0.8; 3], [1.3, 1.4, 1.5]] {
        let water = scene(&format!(
            "[[object]]\nshape = {{ plane = {{ size = [2.0, 2.0] }} }}\ntranslate = [0.6, 1.0, 0.45]\n\
             refractor = {{ eta = {indices:?} }}\n"
        ));
        let pinholes = pinholes_of(&water, 20_000, Strategy::Neighbourhood, Footprint::Cells, 1);
        let points = [Vec3::ZERO, Vec3::new(0.1, 0.2, 0.1), Vec3::new(-0.4, 0.1, 0.2)];
        let receivers = Receivers::from_points(&points.map(|p| (p, Vec3::Y, 1)), 3);
        for (name, gather) in BACK_ENDS {
            for got in gather(&receivers, &pinholes, &cube, &Params::default()).iter().take(3) {
                for (channel, eta) in indices.into_iter().enumerate() {
                    let expected = sun_irradiance(sigma.into()) * 0.8 * transmittance(0.8, eta);
                    let ratio = f64::from(got[channel]) / expected;
                    assert!((ratio - 1.0).abs() < 0.005, "{name} {eta}: {ratio}");
                }
            }
        }
    }
}

/// The sun above a glass ball, on a plane inside it, by its first face alone: a ray at a distance b from the axis meets the ball at an
/// angle sin i = b/R, is refracted to sin r = sin i/n and bent by i − r, and reaches the plane at ρ = b − z tan(i − r), z below the
/// point where it met the ball. So E = E₀ T b/|ρ dρ/db|.
#[test]
fn the_first_face_of_a_ball() {
    let (eta, plane) = (1.5f64, -0.2f64);
    let ball = scene(&format!("[[object]]\nshape = {{ sphere = {{}} }}\nrefractor = {{ eta = {eta} }}\n"));
    let pinholes = pinholes_of(&ball, 40_000, Strategy::Neighbourhood, Footprint::Cells, 1);
    let sigma = 0.02;
    let cube = sun(Vec3::Y, sigma);
    let at = |b: f64| {
        let incidence = b.asin();
        b - (incidence.cos() - plane) * (incidence - (b / eta).asin()).tan()
    };
    let (heights, step) = ([0.05f64, 0.2, 0.4, 0.6], 1e-5);
    let points = heights.map(|b| Vec3::new(at(b) as f32, plane as f32, 0.0));
    let receivers = Receivers::from_points(&points.map(|p| (p, Vec3::Y, 1)), 4);
    for (name, gather) in BACK_ENDS {
        let got = gather(&receivers, &pinholes, &cube, &Params::default());
        for (b, got) in heights.into_iter().zip(got) {
            let slope = (at(b + step) - at(b - step)) / (2.0 * step);
            let passing = transmittance(b.asin().cos(), eta);
            let expected = sun_irradiance(sigma.into()) * passing * b / (at(b) * slope).abs();
            let ratio = f64::from(got[0]) / expected;
            assert!((ratio - 1.0).abs() < 0.02, "{name} at {b}: {ratio}");
        }
    }
}

/// Irradiance under water and a sky of radiance 1.
fn passing_water() -> f64 {
    let steps = 10_000;
    let cosines = (0..steps).map(|k| (f64::from(k) + 0.5) / f64::from(steps));
    2.0 * PI * cosines.map(|c| c * transmittance(c, 1.333)).sum::<f64>() / f64::from(steps)
}

/// Water so wide that leaves are nearly as large as they are far away: parts of them light receivers that their middles do not, which are
/// beyond the critical angle.
#[test]
fn wide_water_has_its_light() {
    let water = "[[object]]\nname = \"water\"\nshape = { plane = { size = [400, 400] } }\ntranslate = [0, 1, 0]\n\
                 refractor = { eta = 1.333 }\ncamera_visible = false\n";
    let scene = above_floor("constant = [1, 1, 1]", water);
    let options = Options::default().with_size([8; 2]).with_samples(1000).with_aovs(vec![Aov::Caustic]);
    let caustic = render(scene, options, &BackendChoice::Cpu).unwrap().layers.remove(0).1;
    let ratio = f64::from(caustic.mean().x) / passing_water();
    println!("{ratio:.4}");
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

/// Under a uniform sky as much flux arrives below water as passes its surface, and beyond the critical angle nothing.
#[test]
#[ignore = "full: another closed form, on both back ends"]
fn water_under_constant_light() {
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    let water = |refractor: &str| {
        let plane = "[[object]]\nshape = { plane = { size = [6.0, 6.0] } }\ntranslate = [0.0, 1.0, 0.0]\n";
        pinholes_of(
            &scene(&format!("{plane}refractor = {{ {refractor} }}\n")),
            4000,
            Strategy::Neighbourhood,
            Footprint::Cells,
            1,
        )
    };
    let passing = passing_water();
    let receivers = Receivers::from_points(&[(Vec3::ZERO, Vec3::Y, 1)], 1);
    for (name, gather) in BACK_ENDS {
        for (refractor, expected) in [("eta = 1.333", passing), ("eta = 1.333, fresnel = false", PI)] {
            let got = gather(&receivers, &water(refractor), &cube, &Params::default())[0][0];
            let ratio = f64::from(got) / expected;
            assert!((ratio - 1.0).abs() < 0.005, "{name} {refractor}: {ratio}");
        }
    }
}

fn parsed(text: &str) -> Scene {
    parse::<toml::Table>("test.toml", text, std::path::Path::new(".")).unwrap().scene
}

const CAMERA: &str = "[camera]\nposition = [0.0, 1.5, 0.0]\ntarget = [0.0, 0.0, 0.0]\nup = [0.0, 0.0, -1.0]\n\
    orthographic = { height = 1.6 }\n";

fn layers(scene: Scene, options: Options, choice: &BackendChoice) -> Vec<Image> {
    render(scene, options, choice).unwrap().layers.into_iter().map(|(_, image)| image).collect()
}

/// An interface between two media that are the same changes nothing: under a dome of it the caustic is the direct light without it.
#[test]
fn an_interface_that_is_none_passes_the_direct_light() {
    let text = |dome: &str| {
        format!(
            "[environment]\nmap = \"overcast\"\n{CAMERA}[[object]]\nshape = {{ plane = {{ size = [1.6, 1.6] }} }}\nreceiver = {{}}\n{dome}"
        )
    };
    let dome = "[[object]]\nshape = { sphere = { radius = 2.0 } }\ncamera_visible = false\nrefractor = { eta = 1.0, fresnel = false }\n";
    let options = |aov| Options::default().with_size([24, 24]).with_aovs(vec![aov]).with_tolerance(0.001);
    let direct = layers(parsed(&text("")), options(Aov::Direct), &BackendChoice::Cpu);
    let caustic = layers(parsed(&text(dome)), options(Aov::Caustic), &BackendChoice::Cpu);
    let error = rel_l2(&caustic[0], &direct[0], None);
    assert!(error < 1e-3, "{error}");
}

/// Waves of water above a floor, which the camera sees as if there were no water.
fn waves(light: &str, refractor: &str) -> Scene {
    let camera = CAMERA.replace("[0.0, 1.5, 0.0]", "[0.0, 0.5, 0.0]").replace("1.6", "1.2");
    parsed(&format!(
        "[environment]\n{light}\n{camera}[[object]]\nname = \"water\"\ncamera_visible = false\n\
         shape = {{ water = {{ size = [1.77, 1.77], amplitude = 0.004, wavelength = 0.5 }} }}\nrefractor = {{ {refractor} }}\n\
         [[object]]\nname = \"floor\"\nshape = {{ plane = {{ size = [1.6, 1.6] }} }}\ntranslate = [0.0, -0.6, 0.0]\nreceiver = {{}}\n"
    ))
}

const SUN: &str = "spot = { direction = [0.3, 0.85, -0.25], sigma_rad = 0.011284, radiance = [1250, 1250, 1250] }";

fn truth(scene: Scene, options: reference::Options, error: f64) -> Image {
    let reference = Reference::new(scene, options).unwrap();
    reference.solve(&StoppingCriterion::new(error), None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance
}

/// As accurate as the ring of the same area, with as many samples and leaves (`ring` under the same sun: .013).
#[test]
#[ignore = "full: a ground truth"]
fn waves_in_the_sun_are_as_the_ground_truth_says() {
    for refractor in ["eta = 1.333", "eta = [1.31, 1.33, 1.36]"] {
        let size = [32, 32];
        let options = reference::Options { size, ..Default::default() };
        let truth = truth(waves(SUN, refractor), options, 0.004);
        let options = Options::default().with_size(size).with_aovs(vec![Aov::Caustic]);
        let rendered = layers(waves(SUN, refractor), options, &BackendChoice::Cpu);
        let error = rel_l2(&rendered[0], &truth, None);
        println!("{refractor}: {error:.4}");
        assert!(error < 0.0172, "{refractor}: {error}");
    }
}

/// Both parts of a caustic are layers of their own, and add up to it. A wall that stands in the water gets one below and the other above.
#[test]
#[ignore = "full: ground truths"]
fn chains_are_layers_of_their_own() {
    let text = format!(
        "[environment]\n{SUN}\n[camera]\nposition = [0.0, 0.0, 0.6]\ntarget = [0.0, 0.0, -0.8]\northographic = {{ height = 1.0 }}\n\
         [[object]]\nname = \"water\"\nshape = {{ water = {{ size = [1.6, 1.6], amplitude = 0.004, wavelength = 0.5 }} }}\n\
         camera_visible = false\nrefractor = {{ eta = 1.333 }}\n[[object]]\nname = \"wall\"\nshape = {{ plane = {{ size = [1.6, 1.6] }} }}\n\
         rotate_deg = [90.0, 0.0, 0.0]\ntranslate = [0.0, 0.0, -0.7]\nreceiver = {{}}\n"
    )
    .replace("-0.25]", "0.45]");
    let aovs = vec![Aov::Caustic, Aov::CausticR, Aov::CausticT];
    for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
        let options =
            Options::default().with_size([24, 24]).with_samples(200).with_leaves(Some(16)).with_aovs(aovs.clone());
        let options = options.with_cube_size(CubeSize::Texels(256));
        let layers = layers(parsed(&text), options, &choice);
        let sum = Image {
            pixels: layers[1].pixels.iter().zip(&layers[2].pixels).map(|(r, t)| *r + *t).collect(),
            ..layers[0].clone()
        };
        let error = rel_l2(&sum, &layers[0], None);
        assert!(error < 0.02, "{choice:?}: {error}");
        let half = |image: &Image, rows: std::ops::Range<usize>| -> f64 {
            image.pixels[24 * rows.start..24 * rows.end].iter().map(|p| f64::from(p.x)).sum()
        };
        let [reflected, refracted] = [&layers[1], &layers[2]].map(|layer| [half(layer, 0..10), half(layer, 14..24)]);
        assert!(reflected[0] > 0.1 && refracted[1] > 1.0, "{choice:?}: {reflected:?} {refracted:?}");
        assert!(reflected[1] == 0.0 && refracted[0] == 0.0, "{choice:?}: {reflected:?} {refracted:?}");
    }
}

/// A floor under water looks as bright as Fresnel's equations and the change of radiance say, beside the reflected sky.
#[test]
fn the_camera_sees_through_water() {
    let text = |water: &str| {
        format!(
            "[environment]\nconstant = [1.0, 1.0, 1.0]\n[camera]\nposition = [0.0, 1.0, 1.0]\ntarget = [0.0, 0.0, 0.0]\n\
             orthographic = {{ height = 0.02 }}\n[[object]]\nname = \"floor\"\nshape = {{ plane = {{ size = [4.0, 4.0] }} }}\n\
             translate = [0.0, -0.5, 0.0]\nreceiver = {{ albedo = [0.5, 0.5, 0.5] }}\n{water}"
        )
    };
    let water =
        "[[object]]\nname = \"water\"\nshape = { plane = { size = [12.0, 12.0] } }\nrefractor = { eta = 1.333 }\n";
    let options = Options::default().with_size([4, 4]);
    for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
        let seen = layers(parsed(&text(water)), options.clone(), &choice)[0].mean();
        let cosine = 0.5f64.sqrt();
        let steps = 10_000;
        let cosines = (0..steps).map(|k| (f64::from(k) + 0.5) / f64::from(steps));
        let passing = 2.0 * PI * cosines.map(|c| c * transmittance(c, 1.333)).sum::<f64>() / f64::from(steps);
        let passes = transmittance(cosine, 1.333);
        let expected = (1.0 - passes) + passes / (1.333 * 1.333) * 0.5 * passing / PI;
        let ratio = DVec3::from(seen) / expected;
        assert!((ratio.x - 1.0).abs() < 0.01, "{choice:?}: {seen} for {expected}");
    }
}

/// Without visibility nothing of a sum is different but what is hidden: here nothing is.
#[test]
fn visibility_of_both_sides_changes_nothing_where_nothing_hides() {
    let options = |visibility| {
        Options::default()
            .with_size([24, 24])
            .with_samples(300)
            .with_aovs(vec![Aov::Caustic])
            .with_visibility(visibility)
    };
    let calm = || waves(SUN, "eta = 1.333");
    let none = layers(calm(), options(Visibility::None), &BackendChoice::Cpu);
    let full = layers(calm(), options(Visibility::Full), &BackendChoice::Cpu);
    let error = rel_l2(&full[0], &none[0], None);
    assert!(error < 0.01, "{error}");
}
