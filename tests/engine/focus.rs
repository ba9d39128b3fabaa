//! Mirrors that focus lamps and suns: all of a mirror's cells light the same few receivers, so that their errors add up.

use std::collections::HashMap;
use std::f32::consts::PI;
use std::path::PathBuf;

use pinspot::image::{Aov, Image};
use pinspot::scene::{Scene, parse};
use pinspot::{BackendChoice, EvaluationChoice, Options};

use crate::support::meshes::{paraboloid, trough};
use crate::support::render;

fn scene(text: &str, mesh: Vec<u8>) -> Scene {
    let assets = HashMap::from([(PathBuf::from("mirror.obj"), mesh)]);
    parse::<toml::Table>("focus.toml", text, &assets).unwrap().scene
}

fn caustic(scene: &Scene, options: Options, choice: &BackendChoice) -> Image {
    render(scene.clone(), options.with_aovs(vec![Aov::Beauty, Aov::Caustic]), choice).unwrap().layers.remove(1).1
}

fn mean_of(image: &Image, is_meant: impl Fn(u32, u32) -> bool) -> f32 {
    let at = |k: usize| (k as u32 % image.width, k as u32 / image.width);
    let meant = image.pixels.iter().enumerate().filter(|(k, _)| is_meant(at(*k).0, at(*k).1));
    let (sum, count) = meant.fold((0.0, 0.0), |(sum, count), (_, pixel)| (sum + pixel.x, count + 1.0));
    sum / count
}

/// A lamp of 0.5 mm in the focus of a torch's mirror. On the axis the mirror is as bright as the lamp all over: E = π L (sin² θ₂ − sin² θ₁), the
/// angles being those to its rims.
#[test]
fn a_torch_has_all_of_its_beam() {
    let (focal_length, rims, wall) = (0.01, [0.004, 0.025], 3.0);
    let text = "environment = { constant = [0, 0, 0] }\n[[light]]\nposition = [0, 0, 0]\nradius = 0.0005\nintensity = [100, 100, 100]\n\
         [camera]\nposition = [0, 0, 0.5]\ntarget = [0, 0, 3]\northographic = { height = 0.5 }\n\
         [[object]]\nname = \"mirror\"\nmesh = \"mirror.obj\"\nreflector = { sides = \"front\" }\n\
         [[object]]\nname = \"wall\"\nshape = { plane = { size = [4, 4] } }\nrotate_deg = [-90, 0, 0]\ntranslate = [0, 0, 3]\n\
         receiver = { albedo = [0.5, 0.5, 0.5] }\n";
    let scene = scene(text, paraboloid(focal_length, rims));
    let sine2 = |radius: f32| {
        let along = wall - (radius * radius / (4.0 * focal_length) - focal_length);
        radius * radius / (radius * radius + along * along)
    };
    let radiance = 100.0 / (PI * 0.0005 * 0.0005);
    let expected = PI * radiance * (sine2(rims[1]) - sine2(rims[0]));
    let size = 32;
    let options = Options::default().with_size([size; 2]);
    let in_beam = |x: u32, y: u32| (x as f32 + 0.5 - 16.0).hypot(y as f32 + 0.5 - 16.0) < 0.04 * size as f32;
    let flat = caustic(&scene, options.clone().with_evaluation(EvaluationChoice::Flat), &BackendChoice::Cpu);
    for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
        let image = caustic(&scene, options.clone(), &choice);
        let (beam, energy) =
            (mean_of(&image, in_beam) / expected, mean_of(&image, |_, _| true) / mean_of(&flat, |_, _| true));
        println!("{choice:?}: beam {beam:.4}, energy {energy:.4}");
        assert!((beam - 1.0).abs() < 0.005 && (energy - 1.0).abs() < 0.005, "{choice:?}: {beam} {energy}");
    }
    let beam = mean_of(&flat, in_beam) / expected;
    assert!((beam - 1.0).abs() < 0.005, "flat: {beam}");
}

/// The sun on a trough of 5.76 m: on its focal line E = 4 E₀ (sin φ₂ − sin φ₁) / (π a), φ₂ being the angle to the rims, φ₁ that to the edge of
/// the shadow of what is lit, and a the sun's radius.
#[test]
fn a_trough_has_the_peak_of_its_line() {
    let (focal_length, width, sigma) = (1.71f32, 5.76f32, 0.002325);
    let text = format!(
        "environment = {{ constant = [0, 0, 0] }}\n[[light]]\n\
         directional = {{ direction = [0, 1, 0], irradiance = [1000, 1000, 1000], sigma_rad = {sigma} }}\n\
         [camera]\nposition = [0, 0.8, 0]\ntarget = [0, 1.71, 0]\nup = [0, 0, -1]\northographic = {{ height = 0.1 }}\n\
         [[object]]\nname = \"mirror\"\nmesh = \"mirror.obj\"\nreflector = {{ sides = \"front\" }}\n\
         [[object]]\nname = \"strip\"\nshape = {{ plane = {{ size = [0.1, 12] }} }}\nrotate_deg = [180, 0, 0]\n\
         translate = [0, 1.71, 0]\nreceiver = {{ albedo = [0.5, 0.5, 0.5] }}\n"
    );
    let scene = scene(&text, trough(focal_length, width, 12.0));
    let rim = (0.5 * width).atan2(focal_length - width * width / (16.0 * focal_length));
    let shadow = 0.05f32.atan2(focal_length);
    let expected = 4.0 * 1000.0 * (rim.sin() - shadow.sin()) / (PI * 2.0 * sigma);
    let options = Options::default().with_size([33, 33]);
    for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
        let image = caustic(&scene, options.clone(), &choice);
        let peak = mean_of(&image, |x, _| x == 16) / expected;
        println!("{choice:?}: {peak:.4}");
        assert!((peak - 1.0).abs() < 0.03, "{choice:?}: {peak}");
    }
}
