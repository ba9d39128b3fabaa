//! Lamps on the GPU: beams and slides, in rough mirrors and through water, as on the CPU. What lamps light, and lamps beside other light,
//! are in the comparisons of all built-in scenes.

use std::path::Path;

use glam::Vec3;
use pinspot::image::{Aov, Image, rel_l2, write_exr};
use pinspot::scene::{Scene, Visibility, parse};
use pinspot::{BackendChoice, EvaluationChoice, Options};

use crate::support::render;

/// A rough ball under a cone, with a small one in the way of the lamp, and water under a slide. Receivers are black, so that mirrors see the lamps
/// alone.
fn scene(folder: &Path) -> Scene {
    let at = |k: u32| Vec3::new((k % 3) as f32, (k / 3) as f32, 1.0);
    let slide = Image { width: 3, height: 2, pixels: (0..6).map(at).collect() };
    write_exr(&folder.join("slide.exr"), &[("", &slide)]).unwrap();
    let text = "environment = { constant = [0, 0, 0] }\n\
        [camera]\nposition = [0, 3, 4]\ntarget = [0, 0, 0]\nperspective = { fov_y_deg = 40 }\n\
        [[light]]\nposition = [-1, 2, 1]\nintensity = [3, 2, 1]\nradius = 0.05\n\
        spot = { target = [-1, 0.4, 0], angle_deg = 20, softness = 0.5 }\n\
        [[light]]\nposition = [1, 2, 0.3]\nintensity = [1, 2, 3]\n\
        spot = { target = [1, 0, 0], angle_deg = 18, slide = \"slide.exr\" }\n\
        [[object]]\nshape = { sphere = { radius = 0.4 } }\ntranslate = [-1, 0.4, 0]\nreflector = { roughness = 0.4 }\n\
        [[object]]\nshape = { plane = { size = [1, 1] } }\ntranslate = [1, 0.5, 0]\n\
        refractor = { eta = 1.333, fresnel = true }\n\
        [[object]]\nshape = { sphere = { radius = 0.2 } }\ntranslate = [-0.8, 1.2, 0.5]\n\
        [[object]]\nshape = { plane = { size = [6, 6] } }\nreceiver = { albedo = [0, 0, 0] }\n";
    parse::<toml::Table>("spots.toml", text, folder).unwrap().scene
}

#[test]
fn shadowed_beams_are_those_of_the_cpu() {
    assert_beams_are_those_of_the_cpu([20, 15], &[(EvaluationChoice::Flat, Visibility::Full, 1e-4)]);
}

#[test]
#[ignore = "full: eight pictures, four of them on a software adapter"]
fn beams_are_those_of_the_cpu() {
    assert_beams_are_those_of_the_cpu(
        [40, 30],
        &[
            (EvaluationChoice::Flat, Visibility::None, 1e-4),
            (EvaluationChoice::Flat, Visibility::Full, 1e-4),
            (EvaluationChoice::Hierarchical, Visibility::None, 1e-3),
            (EvaluationChoice::Hierarchical, Visibility::Full, 5e-3),
        ],
    );
}

/// In pictures of this size, one for each way to evaluate and its greatest error.
fn assert_beams_are_those_of_the_cpu(size: [u32; 2], ways: &[(EvaluationChoice, Visibility, f64)]) {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let by = |evaluation, visibility, choice| {
        let options = Options::default()
            .with_size(size)
            .with_samples(200)
            .with_evaluation(evaluation)
            .with_visibility(visibility)
            .with_aovs(vec![Aov::Caustic]);
        render(scene.clone(), options, &choice).unwrap().layers.remove(0).1
    };
    let [width, height] = size.map(|edge| edge as usize);
    let unoccluded = by(EvaluationChoice::Flat, Visibility::None, BackendChoice::Cpu).mean();
    for &(evaluation, visibility, limit) in ways {
        let [gpu, cpu] =
            [BackendChoice::Gpu(None), BackendChoice::Cpu].map(|choice| by(evaluation, visibility, choice));
        // Both lamps are seen.
        let column = |x: usize| (0..height).map(|y| cpu.pixels[y * width + x].x).sum::<f32>();
        let [left, right] = [column(width / 4), column(width * 3 / 4)];
        assert!(left > 0.0 && right > 0.0, "{left} {right}");
        if visibility == Visibility::Full {
            assert!(cpu.mean().x < 0.99 * unoccluded.x, "the small ball throws no shadow");
        }
        let error = rel_l2(&gpu, &cpu, None);
        println!("{evaluation:?}, visibility {visibility:?}: {error:.1e}");
        assert!(error < limit, "{evaluation:?}, visibility {visibility:?}: {error}");
    }
}
