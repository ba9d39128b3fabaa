//! Media on the GPU: what they scatter along camera rays and leave of the light on surfaces, as on the CPU.

use pinspot::image::{Aov, rel_l2};
use pinspot::scene::{Scene, Visibility, parse};
use pinspot::{BackendChoice, BackendReport, EvaluationChoice, Options};

use crate::support::render;

/// A rough ball in haze that scatters light backwards, in the light of a lamp and of a small sun; a smaller ball is in the way of the lamp.
/// The floor is black, so that the mirror sees those alone.
fn rough_ball() -> Scene {
    let text = "environment = { spot = { direction = [-0.3, 1, 0.4], sigma_rad = 0.1, radiance = [20, 30, 40] } }\n\
        [camera]\nposition = [0, 1.2, 3]\ntarget = [0, 0.6, 0]\nperspective = { fov_y_deg = 50 }\n\
        [medium]\nsigma_s = [0.2, 0.3, 0.4]\nsigma_a = 0.05\ng = -0.4\n\
        [[light]]\nposition = [-1, 2, 1]\nintensity = [30, 20, 10]\nradius = 0.05\n\
        [[object]]\nshape = { sphere = { radius = 0.4 } }\ntranslate = [0, 0.5, 0]\nreflector = { roughness = 0.3 }\n\
        [[object]]\nshape = { sphere = { radius = 0.15 } }\ntranslate = [-0.6, 1.3, 0.6]\n\
        [[object]]\nshape = { plane = { size = [6, 6] } }\nreceiver = { albedo = [0, 0, 0] }\n";
    parse::<toml::Table>("ball.toml", text, std::path::Path::new(".")).unwrap().scene
}

#[test]
fn haze_is_that_of_the_cpu() {
    media_are_those_of_the_cpu(|name| name == "haze");
}

#[test]
#[ignore = "full: more scenes on a software adapter"]
fn other_media_are_those_of_the_cpu() {
    media_are_those_of_the_cpu(|name| name != "haze");
}

/// To rounding, but for hierarchical sums along rays, whose parts are allowed errors of their own: the CPU takes the least of sixteen, the GPU
/// that of each. With a larger tolerance and so few samples, single decisions would change the picture.
fn media_are_those_of_the_cpu(is_asked_for: fn(&str) -> bool) {
    let built_in = |name: &str| pinspot::load(name).unwrap().0;
    let mut failures = Vec::new();
    for (name, scene, evaluation, visibility) in [
        ("haze", built_in("haze"), EvaluationChoice::Flat, Visibility::Full),
        ("haze", built_in("haze"), EvaluationChoice::Hierarchical, Visibility::None),
        ("underwater", built_in("underwater"), EvaluationChoice::Flat, Visibility::None),
        ("underwater", built_in("underwater"), EvaluationChoice::Hierarchical, Visibility::Full),
        ("rough ball", rough_ball(), EvaluationChoice::Flat, Visibility::Full),
        ("rough ball", rough_ball(), EvaluationChoice::Hierarchical, Visibility::None),
    ]
    .into_iter()
    .filter(|case| is_asked_for(case.0))
    {
        let is_flat = evaluation == EvaluationChoice::Flat;
        let options = Options::default()
            // Whole packets of rays: a block counts its look-ups for all receivers that it could hold.
            .with_size([16, 8])
            .with_samples(80)
            .with_leaves((!is_flat).then_some(16))
            .with_tolerance(1e-5)
            .with_medium_steps(3)
            .with_evaluation(evaluation)
            .with_visibility(visibility)
            .with_aovs(vec![Aov::Caustic, Aov::Scattered]);
        let [on_gpu, on_cpu] = [BackendChoice::Gpu(None), BackendChoice::Cpu]
            .map(|choice| render(scene.clone(), options.clone(), &choice).unwrap());
        assert!(matches!(on_gpu.report.backend, BackendReport::Gpu { .. }));
        let fetches = on_gpu.report.lookups / on_cpu.report.lookups;
        let expected = if is_flat { 0.999..1.001 } else { 0.95..1.1 };
        for (aov, limit) in [(Aov::Caustic, 1e-4), (Aov::Scattered, if is_flat { 1e-4 } else { 2e-3 })] {
            let [gpu, cpu] = [&on_gpu, &on_cpu].map(|rendered| rendered.layer(aov).unwrap());
            assert!(cpu.mean().min_element() > 0.0, "{name} {aov:?}: nothing at all");
            let error = rel_l2(gpu, cpu, None);
            let what = format!("{name} {evaluation:?} {visibility:?} {aov:?}: {error:.1e}, fetches {fetches:.3}");
            println!("{what}");
            if error > limit || !expected.contains(&fetches) {
                failures.push(what);
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
