//! Light that a medium scatters and absorbs, against closed forms and the ground truth.

use glam::Vec3;
use pinspot::blocking::wait;
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::reference::{self, Quantity, Reference, StoppingCriterion};
use pinspot::scene::{Medium, Scene, Visibility, parse};
use pinspot::{Backend, BackendChoice, Engine, NoProgress, Options};

use crate::support::render;

const HAZE: Medium = Medium { sigma_s: Vec3::new(0.2, 0.3, 0.4), sigma_a: Vec3::new(0.1, 0.0, 0.3), g: 0.0 };

/// A perspective camera that looks along −z from here, through one narrow pixel or many.
fn camera(position: [f32; 3], fov_y_deg: f32) -> String {
    let [x, y, z] = position;
    format!(
        "[camera]\nposition = {position:?}\ntarget = [{x}, {y}, {}]\nperspective = {{ fov_y_deg = {fov_y_deg} }}\n",
        z - 1.0
    )
}

fn parsed(environment: &str, camera: &str, medium: Medium, rest: &str) -> Scene {
    let text = format!("environment = {{ {environment} }}\n{camera}{rest}");
    let mut scene = parse::<toml::Table>("media.toml", &text, std::path::Path::new(".")).unwrap().scene;
    scene.medium = Some(medium);
    scene
}

fn layer(scene: Scene, aov: Aov, size: u32) -> Image {
    let options =
        Options::default().with_size([size; 2]).with_aovs(vec![aov]).with_samples(10_000).with_medium_steps(64);
    render(scene, options, &BackendChoice::Cpu).unwrap().layers.remove(0).1
}

/// What is scattered between two distances along a ray, per light that is scattered evenly there, m/(4π sr).
fn scattered(medium: &Medium, [start, end]: [f32; 2]) -> Vec3 {
    let extinction = medium.extinction();
    let attenuated = |distance: f32| (-distance * extinction).map(f32::exp);
    medium.sigma_s / (4.0 * std::f32::consts::PI) * (attenuated(start) - attenuated(end)) / extinction
}

fn assert_close(what: &str, got: Vec3, expected: Vec3, tolerance: f32) {
    let error = (got - expected).abs() / expected;
    println!("{what}: {got} for {expected}, off by {:.4}", error.max_element());
    assert!(error.max_element() < tolerance, "{what}: {got}, expected {expected}");
}

/// A beam of directional light, let through by an interface that does nothing, and seen from the side.
#[test]
fn a_beam_is_as_bright_as_the_closed_form_says() {
    let (sigma, radiance) = (0.01f32, Vec3::new(3e3, 2e3, 1e3));
    let environment =
        format!("spot = {{ direction = [0, 1, 0], sigma_rad = {sigma}, radiance = {:?} }}", radiance.to_array());
    let window = "[[object]]\nshape = { plane = { size = [1.6, 1.0] } }\nrefractor = { eta = 1, fresnel = false }\n\
                  [[object]]\nshape = { plane = { size = [9, 9] } }\ntranslate = [0, -4, 0]\nreceiver = {}\n";
    let irradiance = 2.0 * std::f32::consts::PI * sigma * sigma * radiance;
    for g in [0.0, 0.7] {
        let medium = Medium { g, ..HAZE };
        let below = 0.4;
        let scene = parsed(&environment, &camera([0.0, -below, 2.0], 0.5), medium, window);
        let image = layer(scene, Aov::Scattered, 4);
        // Light is turned by a right angle, and comes through the medium from the window.
        let turned = 4.0 * std::f32::consts::PI * medium.phase(0.0);
        let expected = turned * irradiance * medium.transmittance(below) * scattered(&medium, [1.5, 2.5]);
        assert_close(&format!("beam, g = {g}"), image.mean(), expected, 0.01);
    }
}

/// An even environment without shadows is scattered as evenly, whatever the phase function.
#[test]
fn even_light_is_scattered_evenly() {
    let wall = "[[object]]\nshape = { plane = { size = [90, 90] } }\nrotate_deg = [90, 0, 0]\ntranslate = [0, 0, -3]\n\
                receiver = {}\n[[object]]\nshape = { sphere = { radius = 0.01 } }\ntranslate = [0, 0, 50]\nreflector = {}\n";
    for g in [0.0, -0.5, 0.8] {
        let medium = Medium { g, ..HAZE };
        let scene = parsed("constant = [1, 2, 3]", &camera([0.0, 0.0, 0.0], 1.0), medium, wall);
        let options = Options::default()
            .with_size([4; 2])
            .with_aovs(vec![Aov::ScatteredDirect])
            .with_visibility(pinspot::scene::Visibility::None);
        let image = render(scene, options, &BackendChoice::Cpu).unwrap().layers.remove(0).1;
        let expected = 4.0 * std::f32::consts::PI * Vec3::new(1.0, 2.0, 3.0) * scattered(&medium, [0.0, 3.0]);
        assert_close(&format!("even light, g = {g}"), image.mean(), expected, 0.01);
    }
}

/// A point light beside a ray, against a quadrature along it.
#[test]
fn a_lamp_glows_in_the_medium() {
    let rest = "[[light]]\nposition = [0.5, 0.2, -2]\nintensity = [1, 2, 3]\n\
                [[object]]\nshape = { plane = { size = [9, 9] } }\nrotate_deg = [90, 0, 0]\ntranslate = [0, 0, -5]\nreceiver = {}\n\
                [[object]]\nshape = { sphere = { radius = 0.01 } }\ntranslate = [0, 0, 50]\nreflector = {}\n";
    for g in [0.0, 0.5] {
        let medium = Medium { g, ..HAZE };
        let image =
            layer(parsed("constant = [0, 0, 0]", &camera([0.0, 0.0, 0.0], 0.1), medium, rest), Aov::ScatteredDirect, 2);
        let (lamp, steps) = (Vec3::new(0.5, 0.2, -2.0), 20_000);
        let step = 5.0 / steps as f32;
        let expected: Vec3 = (0..steps)
            .map(|k| {
                let distance = (k as f32 + 0.5) * step;
                let from_lamp = distance * Vec3::NEG_Z - lamp;
                let phase = medium.phase(from_lamp.normalize().dot(Vec3::Z));
                let passed = medium.transmittance(distance + from_lamp.length());
                step * phase * medium.sigma_s * passed * Vec3::new(1.0, 2.0, 3.0) / from_lamp.length_squared()
            })
            .sum();
        assert_close(&format!("lamp, g = {g}"), image.mean(), expected, 0.01);
    }
}

/// Surfaces are seen through the medium, and lit through it.
#[test]
fn light_is_absorbed_on_its_way() {
    let murky = Medium { sigma_s: Vec3::ZERO, sigma_a: Vec3::new(0.1, 0.2, 0.4), g: 0.0 };
    let rest = "[[light]]\nposition = [0, 0, 1]\nintensity = [1, 1, 1]\n\
                [[object]]\nshape = { plane = { size = [9, 9] } }\nrotate_deg = [90, 0, 0]\ntranslate = [0, 0, -3]\nreceiver = {}\n\
                [[object]]\nshape = { plane = { size = [1, 1] } }\nrotate_deg = [-90, 0, 0]\ntranslate = [0, 0, 2]\nreflector = {}\n";
    let seen = |medium: Option<Medium>, aov: Aov| {
        let mut scene = parsed("constant = [0, 0, 0]", &camera([0.0, 0.0, 0.0], 0.5), murky, rest);
        scene.medium = medium;
        layer(scene, aov, 8).mean()
    };
    for (aov, way) in [(Aov::Direct, 4.0), (Aov::Caustic, 6.0), (Aov::Beauty, f32::NAN)] {
        let (clear, through) = (seen(None, aov), seen(Some(murky), aov));
        // Beauty shows both, after another three metres.
        let expected = if way.is_nan() {
            let [direct, caustic] = [Aov::Direct, Aov::Caustic].map(|aov| seen(None, aov));
            let passed = murky.transmittance(4.0) * direct + murky.transmittance(6.0) * caustic;
            clear * murky.transmittance(3.0) * passed / (direct + caustic)
        } else {
            clear * murky.transmittance(way)
        };
        assert_close(aov.name(), through, expected, 0.02);
    }
}

/// Caustics in the air: of a mirror ball in natural light, and of waves under a sun.
#[test]
#[ignore = "full: ground truths"]
fn scattered_light_is_the_ground_truths() {
    let waves = "[[object]]\nshape = { sheet = { size = [2.0, 2.0], amplitude = 0.03 } }\nrefractor = { eta = 1.333 }\n\
                 [[object]]\nshape = { plane = { size = [3.0, 3.0] } }\ntranslate = [0.0, -0.8, 0.0]\nreceiver = {}\n";
    let sun = "spot = { direction = [0.2, 1, 0.1], sigma_rad = 0.05, radiance = [300, 300, 300] }";
    let haze = Medium { g: 0.4, sigma_s: Vec3::splat(0.1), sigma_a: Vec3::splat(0.02) };
    let murk = Medium { g: 0.3, sigma_s: Vec3::splat(0.4), sigma_a: Vec3::new(0.3, 0.1, 0.1) };
    let mut ball = pinspot::load("mirror-sphere").unwrap().0;
    ball.medium = Some(haze);
    // The reference takes longer for each pixel of the waves.
    let waves = parsed(sun, &camera([0.0, -0.5, 1.2], 70.0), murk, waves);
    for (name, scene, size) in [("ball", ball, [12, 9]), ("waves", waves, [8, 6])] {
        let options = reference::Options { size, quantity: Quantity::Scattered, ..Default::default() };
        let criterion = StoppingCriterion::new(0.02).with_max_points(1e5);
        let solver = Reference::new(scene.clone(), options).unwrap();
        let truth = solver.solve(&criterion, None, &NoProgress, &mut |_| Ok(())).unwrap();
        let options = Options::default().with_size(size).with_aovs(vec![Aov::Scattered]);
        let image = render(scene, options, &BackendChoice::Cpu).unwrap().layers.remove(0).1;
        let error = rel_l2(&image, &truth.irradiance, None);
        let energy = image.mean().element_sum() / truth.irradiance.mean().element_sum();
        println!("{name}: {error:.4} (reference {:.4}), energy {energy:.4}", truth.rel_error());
        assert!(truth.rel_error() < 0.02, "{name}: {}", truth.rel_error());
        assert!(error < 0.05, "{name}: {error}");
        assert!((energy - 1.0).abs() < 0.04, "{name}: {energy}");
    }
}

/// A ball between a lamp and the air that the camera looks through.
#[test]
fn shadows_in_the_air_are_the_ground_truths() {
    let rest = "[[light]]\nposition = [0, 1, -2]\nradius = 0.05\nintensity = [3, 3, 3]\n\
                [[object]]\nshape = { sphere = { radius = 0.3 } }\ntranslate = [0, 0.45, -2]\nreflector = {}\n\
                [[object]]\nshape = { plane = { size = [9, 9] } }\ntranslate = [0, -1, 0]\nreceiver = {}\n";
    let haze = Medium { g: 0.3, sigma_s: Vec3::splat(0.2), sigma_a: Vec3::splat(0.02) };
    let scene = parsed("constant = [0.02, 0.03, 0.05]", &camera([0.0, 0.0, 1.0], 60.0), haze, rest);
    let size = [16, 12];
    let options = reference::Options { size, quantity: Quantity::ScatteredDirect, ..Default::default() };
    let solver = Reference::new(scene.clone(), options).unwrap();
    let truth = solver.solve(&StoppingCriterion::new(0.01), None, &NoProgress, &mut |_| Ok(())).unwrap();
    let layer = |visibility| {
        let options =
            Options::default().with_size(size).with_aovs(vec![Aov::ScatteredDirect]).with_visibility(visibility);
        render(scene.clone(), options, &BackendChoice::Cpu).unwrap().layers.remove(0).1
    };
    let error = |visibility| rel_l2(&layer(visibility), &truth.irradiance, None);
    let (with, without) = (error(Visibility::Full), error(Visibility::None));
    println!("shadows: {with:.4} (reference {:.4}), without them {without:.4}", truth.rel_error());
    assert!(with < 0.04 && without > 2.0 * with, "{with} {without}");
}

/// After edits of the medium and of what hides its light, a picture is that of a new engine; without mirrors' light there is none.
#[test]
fn an_edit_of_a_medium_is_seen() {
    assert_edits_are_seen(
        [6, 4],
        &[|scene| scene.medium.as_mut().unwrap().sigma_a *= 2.0, |scene| scene.medium = None],
    );
}

#[test]
#[ignore = "full: many pictures of a medium"]
fn edits_of_a_medium_are_seen() {
    assert_edits_are_seen(
        [12, 9],
        &[
            |scene| scene.medium.as_mut().unwrap().g = -0.5,
            |scene| scene.medium.as_mut().unwrap().sigma_a *= 2.0,
            |scene| scene.objects[1].receiver.as_mut().unwrap().albedo *= 0.25,
            |scene| scene.medium = None,
        ],
    );
}

/// The last edit takes the medium away.
fn assert_edits_are_seen(size: [u32; 2], edits: &[fn(&mut Scene)]) {
    let (scene, options) = pinspot::load("underwater").unwrap();
    let options = options.with_size(size).with_samples(60).with_medium_steps(4);
    let render = |engine: &mut Engine| wait(None, engine.render(&NoProgress)).unwrap().layers.remove(0).1;
    let mut engine = Engine::new(scene, options.clone(), Backend::cpu());
    let mut before = render(&mut engine);
    for edit in edits {
        edit(engine.scene_mut());
        let edited = render(&mut engine);
        assert_ne!(edited, before);
        assert_eq!(edited, render(&mut Engine::new(engine.scene().clone(), options.clone(), Backend::cpu())));
        before = edited;
    }
    engine.options_mut().aovs = vec![Aov::Scattered];
    let message = wait(None, engine.render(&NoProgress)).unwrap_err().to_string();
    assert!(message.contains("aov is scattered, but nothing in the scene scatters light"), "{message}");
}

/// Shapes are shown without a medium, whatever else is rendered beside them, and several points a pixel see it alike.
#[test]
fn media_in_other_pictures() {
    let (scene, options) = pinspot::load("haze").unwrap();
    let options = options.with_size([24, 18]).with_samples(100).with_medium_steps(8);
    let render =
        |options: Options| wait(None, Engine::new(scene.clone(), options, Backend::cpu()).render(&NoProgress)).unwrap();
    let plain = |aovs: &[Aov]| render(options.clone().with_plain_diffuse(true).with_aovs(aovs.to_vec()));
    let [alone, beside] = [&[Aov::Beauty][..], &[Aov::Beauty, Aov::Scattered]].map(plain);
    assert_eq!(alone.layer(Aov::Beauty), beside.layer(Aov::Beauty));
    let [one, four] = [1, 2].map(|n| render(options.clone().with_pixel_samples(n)).layers.remove(0).1.mean());
    assert!((one - four).abs().max_element() < 0.1 * one.max_element(), "{one} {four}");
}
