//! Light geometry: emitters are drawn into the environment, as they are seen from the mirrors.

use std::f64::consts::PI;
use std::path::Path;

use glam::{Vec3, Vec3Swizzles};
use pinspot::blocking::wait;
use pinspot::image::Aov;
use pinspot::reference::{self, Quantity, Reference, StoppingCriterion};
use pinspot::scene::{Scene, Visibility, parse};
use pinspot::{Backend, Engine, NoProgress, Options, Rendered, Settings, Stage};

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
        let scene = over_table(&lamp(0.8, position));
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

/// The caustics of both back ends are those of the reference, wherever the built-in scenes' emitters have moved.
#[test]
fn caustics_of_emitters_are_those_of_the_reference() {
    for (name, seconds, most) in [("dynamic", 1.3, 0.04), ("dance-floor", 2.2, 0.08)] {
        let (mut scene, options) = pinspot::load(name).unwrap();
        scene.pose(seconds);
        let size = [24, 24];
        let goal = StoppingCriterion::new(0.01).with_max_points(60_000.0);
        let asked = reference::Options { size, visibility: Visibility::Full, ..Default::default() };
        let reference = Reference::new(scene.clone(), asked).unwrap();
        let exact = reference.solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance.pixels;
        let options = options.with_size(size).with_aovs(vec![Aov::Caustic]);
        for backend in [Backend::cpu(), gpu_backend()] {
            let options = if backend.device().is_some() { options.clone().with_samples(600) } else { options.clone() };
            let most = if backend.device().is_some() { 2.0 * most } else { most };
            let rendered = render(&mut Engine::new(scene.clone(), options, backend));
            let caustic = layer(&rendered, Aov::Caustic);
            let off: f64 = caustic.iter().zip(&exact).map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
            let all: f64 = exact.iter().map(|b| f64::from(b.length_squared())).sum();
            let rel_l2 = (off / all).sqrt();
            println!("{name} at {seconds} s: rel_l2 {rel_l2:.4}");
            assert!(rel_l2 < most, "{name}: {rel_l2}");
        }
    }
}

/// A lamp that moves changes what depends on the light, and nothing of the environment's own; the picture is that of a new engine.
#[test]
fn a_moving_emitter_is_drawn_anew() {
    let (scene, options) = pinspot::load("dynamic").unwrap();
    let options = options.with_size([32, 32]).with_samples(60);
    let mut engine = Engine::new(scene, options.clone(), Backend::cpu());
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
    let scene = over_table(&format!("{mirror}{}", lamp(0.2, Vec3::new(0.0, 2.0, 0.0))));
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

/// One image of the emitters stands for the whole scene, which a lamp close by does not bear.
#[test]
fn a_near_emitter_is_warned_of() {
    let ring = "[[object]]\nname = \"ring\"\nshape = { ring = { radius = 0.4, height = 0.1 } }\nreflector = {}\n";
    let warnings = |position: Vec3| {
        let scene = over_table(&format!("{ring}{}", lamp(0.05, position)));
        let options = pictures(&[Aov::Caustic]).with_samples(30);
        render(&mut Engine::new(scene, options, Backend::cpu())).report.warnings.join("\n")
    };
    let near = warnings(Vec3::new(0.0, 0.8, 0.0));
    assert!(near.contains("'lamp' is 0.700 m from") && near.contains("m on"), "{near}");
    assert!(!warnings(Vec3::new(0.0, 8.0, 0.0)).contains("lamp"));
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
