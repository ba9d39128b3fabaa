//! Emitters: distant ones are drawn into the environment, as they are seen from the mirrors; near ones shine from where they are.

use std::f64::consts::PI;
use std::path::Path;

use glam::{DVec3, Vec3, Vec3Swizzles};
use pinspot::blocking::wait;
use pinspot::image::{Aov, ToneMap};
use pinspot::reference::{self, Quantity, Reference, StoppingCriterion};
use pinspot::scene::{Scene, Visibility, parse};
use pinspot::{Backend, Detail, Engine, Exposure, NoProgress, Options, Rendered, Settings, Stage};

use crate::support::gpu_backend;

/// A table seen from above, under what else there is; nothing shines but emitters.
fn over_table(objects: &str) -> Scene {
    let text = format!(
        "[environment]\nconstant = [0.0, 0.0, 0.0]\n[camera]\nposition = [0.0, 3.0, 0.0]\ntarget = [0.0, 0.0, 0.0]\n\
         up = [0.0, 0.0, -1.0]\northographic = {{ height = 1.0 }}\n[[object]]\nname = \"table\"\n\
         shape = {{ plane = {{ size = [2.0, 2.0] }} }}\nreceiver = {{ albedo = [0.5, 0.5, 0.5] }}\n{objects}"
    );
    parse::<toml::Table>("test.toml", &text, Path::new(".")).unwrap().scene
}

fn lamp(radius: f32, position: Vec3) -> String {
    let [x, y, z] = position.to_array();
    format!(
        "[[object]]\nname = \"lamp\"\nshape = {{ sphere = {{ radius = {radius} }} }}\ntranslate = [{x:?}, {y:?}, {z:?}]\n\
         emitter = {{ radiance = [10.0, 20.0, 5.0] }}\n"
    )
}

/// The same as a part of the environment.
fn distant(lamp: &str) -> String {
    lamp.replace("5.0]", "5.0], near = false")
}

fn render(engine: &mut Engine) -> Rendered {
    wait(None, engine.render(&NoProgress)).unwrap()
}

fn layer(rendered: &Rendered, aov: Aov) -> &[Vec3] {
    &rendered.layers.iter().find(|(known, _)| *known == aov).unwrap().1.pixels
}

fn pictures(aovs: &[Aov]) -> Options {
    Options::default().with_size([9, 9]).with_aovs(aovs.to_vec())
}

/// A ball of radius R at a distance d gives E = π L (R/d)² cos θ where nothing is in its way, everywhere the same, as it is far away;
/// itself it is in nobody's way.
#[test]
fn an_emitter_lights_receivers() {
    let position = Vec3::new(3.0, 6.0, -2.0);
    let expected = PI * 20.0 * (0.64 / f64::from(position.length_squared())) * f64::from(position.normalize().y);
    for visibility in [Visibility::None, Visibility::Full] {
        let scene = over_table(&distant(&lamp(0.8, position)));
        let options = pictures(&[Aov::Direct]).with_visibility(visibility);
        let rendered = render(&mut Engine::new(scene.clone(), options, Backend::cpu()));
        for pixel in layer(&rendered, Aov::Direct) {
            let ratio = f64::from(pixel.y) / expected;
            assert!((ratio - 1.0).abs() < 0.015, "{visibility:?}: {ratio}");
            assert!((2.0 * pixel.x - pixel.y).abs() < 1e-4);
        }
        let options = reference::Options { size: [1, 1], quantity: Quantity::Direct, visibility, ..Default::default() };
        let reference = Reference::new(scene, options).unwrap();
        let goal = StoppingCriterion::new(1e-3);
        let pixel = reference.solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance.pixels[0];
        let ratio = f64::from(pixel.y) / expected;
        assert!((ratio - 1.0).abs() < 5e-3, "reference, {visibility:?}: {ratio}");
    }
}

/// Moves emitters away from the mirrors and makes them as much larger, so that the directions to them are the same from everywhere.
fn with_distant_emitters(mut scene: Scene) -> Scene {
    const FARTHER: f32 = 100.0;
    let centre = scene.light_centre();
    for object in scene.objects.iter_mut().filter(|object| object.emitter.is_some()) {
        let placement = &mut object.placement;
        placement.translate = centre + FARTHER * (placement.translate - centre);
        placement.scale *= FARTHER;
    }
    drawn_into_environment(scene)
}

fn drawn_into_environment(mut scene: Scene) -> Scene {
    scene.objects.iter_mut().filter_map(|object| object.emitter.as_mut()).for_each(|emitter| emitter.is_near = false);
    scene
}

#[test]
#[ignore = "full: ground truths"]
fn caustics_of_emitters_are_those_of_the_reference() {
    caustics_are_those_of_the_reference("dynamic", 1.3, 0.04);
}

#[test]
#[ignore = "full: ground truths"]
fn caustics_of_a_dance_floor_are_those_of_the_reference() {
    caustics_are_those_of_the_reference("dance-floor", 2.2, 0.08);
}

/// The caustics of both back ends are those of the reference, wherever the built-in scenes' emitters have moved, near and far away.
fn caustics_are_those_of_the_reference(name: &str, seconds: f32, most: f64) {
    for is_distant in [false, true] {
        let (mut scene, options) = pinspot::load(name).unwrap();
        scene.pose(seconds);
        // What mirrors see of lit surfaces is another test's: the reference takes minutes for it.
        scene.objects.iter_mut().filter_map(|o| o.receiver.as_mut()).for_each(|receiver| receiver.albedo = Vec3::ZERO);
        let scene = if is_distant { with_distant_emitters(scene) } else { scene };
        let size = [16, 16];
        let goal = StoppingCriterion::new(0.01).with_max_points(60_000.0);
        let asked = reference::Options { size, visibility: Visibility::Full, ..Default::default() };
        let reference = Reference::new(scene.clone(), asked).unwrap();
        let exact = reference.solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap();
        println!("the reference's own error: {:.4}", exact.rel_error());
        let exact = exact.irradiance.pixels;
        let options = options.with_size(size).with_aovs(vec![Aov::Caustic]);
        for backend in [Backend::cpu(), gpu_backend()] {
            let options = if backend.device().is_some() { options.clone().with_samples(600) } else { options.clone() };
            let most = if backend.device().is_some() { 2.0 * most } else { most };
            let rendered = render(&mut Engine::new(scene.clone(), options, backend));
            let caustic = layer(&rendered, Aov::Caustic);
            let off: f64 = caustic.iter().zip(&exact).map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
            let all: f64 = exact.iter().map(|b| f64::from(b.length_squared())).sum();
            let rel_l2 = (off / all).sqrt();
            println!("{name} at {seconds} s, distant: {is_distant}: rel_l2 {rel_l2:.4}");
            assert!(rel_l2 < most, "{name}: {rel_l2}");
        }
    }
}

/// A lamp that moves changes what depends on the light, and nothing of the environment's own; the picture is that of a new engine.
#[test]
fn a_moving_emitter_is_drawn_anew() {
    let (scene, options) = pinspot::load("dynamic").unwrap();
    let options = options.with_size([32, 32]).with_samples(60);
    let mut engine = Engine::new(drawn_into_environment(scene), options.clone(), Backend::cpu());
    render(&mut engine);
    let before = engine.stage_counts();
    for object in engine.scene_mut().objects.iter_mut().filter(|object| object.emitter.is_some()) {
        object.placement.translate.x += 1.0;
    }
    let moved = render(&mut engine);
    let made = engine.stage_counts().made_since(&before);
    for stage in [Stage::LightGeometry, Stage::LitEnvironment, Stage::Caustic, Stage::Direct] {
        assert!(made.contains(&stage), "{stage} in {made:?}");
    }
    for stage in [Stage::Light, Stage::Points, Stage::Visibility] {
        assert!(!made.contains(&stage), "{stage} in {made:?}");
    }
    let mut fresh = Engine::new(engine.scene().clone(), options.clone(), Backend::cpu());
    assert_eq!(render(&mut fresh).layers, moved.layers);
    for object in &mut engine.scene_mut().objects {
        object.emitter.iter_mut().for_each(|emitter| emitter.radiance = emitter.radiance.zxy());
    }
    let dyed = render(&mut engine);
    let mut fresh = Engine::new(engine.scene().clone(), options, Backend::cpu());
    assert_eq!(render(&mut fresh).layers, dyed.layers);
}

/// The camera sees an emitter where it is, before what lies behind it, at its own radiance.
#[test]
fn the_camera_sees_emitters_where_they_are() {
    let mirror = "[[object]]\nname = \"mirror\"\nshape = { plane = { size = [0.1, 0.1] } }\ntranslate = [3.0, 0.0, 0.0]\nreflector = {}\n";
    let lamp = distant(&lamp(0.2, Vec3::new(0.0, 2.0, 0.0)));
    let scene = over_table(&format!("{mirror}{lamp}"));
    let rendered = render(&mut Engine::new(scene.clone(), pictures(&[Aov::Beauty, Aov::Depth]), Backend::cpu()));
    let (beauty, depth) = (layer(&rendered, Aov::Beauty), layer(&rendered, Aov::Depth));
    assert_eq!(beauty[4 * 9 + 4], Vec3::new(10.0, 20.0, 5.0));
    assert!((depth[4 * 9 + 4].x - 0.8).abs() < 0.01 && (depth[0].x - 3.0).abs() < 1e-4, "{depth:?}");
    assert!(beauty[0].y < 1.0 && beauty[0].y > 0.01, "the table: {}", beauty[0]);
    let mut hidden = scene;
    hidden.objects[2].camera_visible = false;
    let rendered = render(&mut Engine::new(hidden, pictures(&[Aov::Beauty, Aov::Depth]), Backend::cpu()));
    assert!(layer(&rendered, Aov::Beauty).iter().all(|pixel| (*pixel - beauty[0]).length() < 1e-3), "it still shines");
}

/// Near or distant, emitters are as bright as their scene says, whatever the intensity of the environment behind them.
#[test]
fn environments_do_not_scale_emitters() {
    for near in ["", ", near = false"] {
        let lamp = lamp(0.2, Vec3::new(0.0, 2.0, 0.0)).replace("5.0]", &format!("5.0]{near}"));
        let mirror = "[[object]]\nname = \"mirror\"\nshape = { plane = { size = [0.1, 0.1] } }\nreflector = {}\n";
        let mut scene = over_table(&format!("{mirror}{lamp}"));
        scene.environment.intensity = 0.3;
        let mut engine = Engine::new(scene, pictures(&[Aov::Beauty]), Backend::cpu());
        assert!(
            layer(&render(&mut engine), Aov::Beauty)[4 * 9 + 4].abs_diff_eq(Vec3::new(10.0, 20.0, 5.0), 1e-4),
            "{near}"
        );
        engine.options_mut().display.exposure = Exposure::Stops(-5.0);
        engine.options_mut().display.tone_map = ToneMap::Linear;
        let detail =
            Detail { size: [9, 9], samples: 20, taps: 4, spacing: 1, shadow_directions: 8, reuses_light: false };
        for backend in [Backend::cpu(), gpu_backend()] {
            let mut engine = Engine::new(engine.scene().clone(), engine.options().clone(), backend.clone());
            let preview = wait(backend.device(), engine.preview(&detail, &NoProgress)).unwrap();
            let shown = 32.0 * preview.image.pixels[4 * 9 + 4];
            assert!(shown.abs_diff_eq(Vec3::new(10.0, 20.0, 5.0), 1e-2), "{near} in previews: {shown}");
        }
    }
}

/// Scene files need not say whether emitters are near. Where they say wrongly that one is far away, a warning tells.
#[test]
fn emitters_are_near_unless_they_are_far_away() {
    let ring = "[[object]]\nname = \"ring\"\nshape = { ring = { radius = 0.4, height = 0.1 } }\nreflector = {}\n";
    let rendered = |position: Vec3, near: &str| {
        let lamp = lamp(0.05, position).replace("5.0]", &format!("5.0]{near}"));
        let scene = over_table(&format!("{ring}{lamp}"));
        let is_near = scene.objects[2].is_near_light();
        let options = pictures(&[Aov::Caustic]).with_samples(30);
        (is_near, render(&mut Engine::new(scene, options, Backend::cpu())).report.warnings.join("\n"))
    };
    let (close_by, far_away) = (Vec3::new(0.0, 0.8, 0.0), Vec3::new(0.0, 50.0, 0.0));
    let (is_near, warnings) = rendered(close_by, "");
    assert!(is_near && !warnings.contains("lamp"), "{warnings}");
    let (is_near, warnings) = rendered(close_by, ", near = false");
    assert!(!is_near && warnings.contains("'lamp' is 0.700 m from") && warnings.contains("near = true"), "{warnings}");
    let (is_near, warnings) = rendered(far_away, "");
    assert!(!is_near && !warnings.contains("lamp"), "{warnings}");
    assert!(rendered(far_away, ", near = true").0);
}

/// Of a near and a distant emitter each is where it belongs, in either order: the table gets the light of both, and none hides the other.
#[test]
fn near_and_distant_emitters_shine_together() {
    let mean = |emitters: &[String]| {
        let scene = over_table(&emitters.concat());
        let rendered = render(&mut Engine::new(scene, pictures(&[Aov::Direct]), Backend::cpu()));
        layer(&rendered, Aov::Direct).iter().map(|pixel| pixel.y).sum::<f32>() / 81.0
    };
    let near = lamp(0.1, Vec3::new(0.6, 0.5, 0.0)).replace("emitter", "camera_visible = false\nemitter");
    let distant = distant(&lamp(0.8, Vec3::new(6.0, 12.0, -4.0)));
    let both = mean(std::slice::from_ref(&near)) + mean(std::slice::from_ref(&distant));
    for emitters in [[near.clone(), distant.clone()], [distant, near]] {
        let found = mean(&emitters);
        assert!((found / both - 1.0).abs() < 0.01, "{found}, {both}");
    }
}

/// A ball of radius R at a distance d above the table gives E = π L (R/d)² cos θ at each place.
#[test]
fn an_emitter_close_by_lights_receivers() {
    let position = DVec3::new(0.2, 0.5, -0.1);
    let lamp = lamp(0.1, position.as_vec3()).replace("emitter", "camera_visible = false\nemitter");
    for visibility in [Visibility::None, Visibility::Full] {
        let options = pictures(&[Aov::Direct]).with_visibility(visibility);
        let rendered = render(&mut Engine::new(over_table(&lamp), options, Backend::cpu()));
        let mut sum = 0.0;
        for (index, pixel) in (0u8..).zip(layer(&rendered, Aov::Direct)) {
            let place = |k: u8| (f64::from(k) + 0.5) / 9.0 - 0.5;
            let to = position - DVec3::new(place(index % 9), 0.0, place(index / 9));
            let expected = PI * 20.0 * 0.01 / to.length_squared() * to.normalize().y;
            let ratio = f64::from(pixel.y) / expected;
            assert!((ratio - 1.0).abs() < 0.015, "{visibility:?}, {index}: {ratio}");
            sum += ratio / 81.0;
        }
        assert!((sum - 1.0).abs() < 0.005, "{visibility:?}: {sum}");
    }
}

/// A mirror ball between a panel and a bulb, neither farther away than it is large: caustics of both back ends are the reference's.
#[test]
#[ignore = "full: a ground truth"]
fn caustics_of_emitters_close_by_are_those_of_the_reference() {
    let text = "[environment]\nconstant = [0.0, 0.0, 0.0]\n[camera]\nposition = [0.0, 1.1, 2.2]\ntarget = [0.0, 0.25, 0.0]\n\
        perspective = { fov_y_deg = 38.0 }\n\
        [[object]]\nshape = { sphere = { radius = 0.25 } }\ntranslate = [-0.25, 0.25, 0.0]\nreflector = {}\n\
        [[object]]\nshape = { plane = { size = [4.0, 4.0] } }\nreceiver = { albedo = [0.0, 0.0, 0.0] }\n\
        [[object]]\nshape = { plane = { size = [0.5, 0.3] } }\ntranslate = [0.75, 0.6, 0.0]\nrotate_deg = [0.0, 0.0, 70.0]\n\
        emitter = { radiance = [8.0, 7.0, 5.0] }\n\
        [[object]]\nshape = { sphere = { radius = 0.05, divisions = 16 } }\ntranslate = [-0.7, 0.3, 0.35]\n\
        emitter = { radiance = [10.0, 20.0, 40.0] }\n";
    let scene = parse::<toml::Table>("test.toml", text, Path::new(".")).unwrap().scene;
    let size = [16, 12];
    let asked = reference::Options { size, visibility: Visibility::Full, ..Default::default() };
    let goal = StoppingCriterion::new(0.01).with_max_points(60_000.0);
    let reference = Reference::new(scene.clone(), asked).unwrap();
    let exact = reference.solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap();
    println!("the reference's own error: {:.4}", exact.rel_error());
    let exact = exact.irradiance.pixels;
    for backend in [Backend::cpu(), gpu_backend()] {
        let options = pictures(&[Aov::Caustic]).with_size(size).with_visibility(Visibility::Full);
        let rendered = render(&mut Engine::new(scene.clone(), options, backend));
        let caustic = layer(&rendered, Aov::Caustic);
        let off: f64 = caustic.iter().zip(&exact).map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
        let all: f64 = exact.iter().map(|b| f64::from(b.length_squared())).sum();
        let rel_l2 = (off / all).sqrt();
        println!("{rel_l2:.4}");
        assert!(rel_l2 < 0.05, "{rel_l2}");
    }
}

#[test]
fn emitters_with_mistakes_are_refused() {
    let refused = |table: &str| {
        let text = format!(
            "[environment]\nconstant = [1.0, 1.0, 1.0]\n[camera]\nposition = [0.0, 3.0, 0.0]\ntarget = [0.0, 0.0, 0.0]\n\
             [[object]]\nname = \"lamp\"\nshape = {{ sphere = {{}} }}\n{table}\n"
        );
        parse::<Settings>("lamps.toml", &text, Path::new(".")).unwrap_err().to_string()
    };
    for (table, words) in [
        ("emitter = {}", "radiance"),
        ("emitter = { radiance = [1.0, -1.0, 1.0] }", "emitter.radiance"),
        ("emitter = { radiance = [1.0, nan, 1.0] }", "emitter.radiance"),
        ("emitter = { radiance = [1.0, 1e37, 1.0] }", "emitter.radiance"),
        ("emitter = { radience = [1.0, 1.0, 1.0] }", "radiance"),
        ("emitter = { radiance = [1.0, 1.0, 1.0] }\nreceiver = {}", "an object of its own"),
    ] {
        let message = refused(table);
        assert!(message.starts_with("lamps.toml:") && message.contains(words), "{table}: {message}");
    }
}
