//! The hierarchical gather against the flat sum over its leaves, and against the ground truth.

use std::sync::Arc;

use pinspot::image::rel_l2 as image_rel_l2;
use pinspot::low_level::brdf::{Gloss, Materials};
use pinspot::low_level::pinhole::cpu::{Accuracy, CachedGather, estimate_irradiance, gather_hierarchical};
use pinspot::low_level::pinhole::{Params, PinholeTree, ReceiverLayout, Receivers, ViewDirections};
use pinspot::reference::Quantity;
use pinspot::scene::{self, BUILT_IN, Visibility};
use pinspot::{BackendChoice, CubeSize, EvaluationChoice};

use crate::support::{self, PreparedLight, PreparedScene, on_cpu, prepared, rel_l2, rendered, truth};

/// A scene under one light, ready to be gathered.
struct Work {
    prepared: Arc<PreparedScene>,
    receivers: Arc<Receivers>,
    light: Arc<PreparedLight>,
}

/// A light from a built-in map.
fn light_of_map(name: &str) -> Arc<PreparedLight> {
    PreparedLight::of(&scene::Light::BuiltInMap(name.to_owned()), CubeSize::Auto)
}

impl Work {
    /// A built-in scene under its own light.
    fn new(name: &str, size: u32) -> Self {
        let prepared = prepared(name);
        Self { receivers: prepared.receivers([size; 2]), light: prepared.light(CubeSize::Auto), prepared }
    }

    fn tree(&self, samples: u32, leaves: u32) -> Arc<PinholeTree> {
        self.prepared.tree(samples, leaves, Visibility::None)
    }

    fn hierarchical(&self, tree: &PinholeTree, receivers: &Receivers, tolerance: f32) -> Vec<[f32; 4]> {
        let (light, params) = (self.light.as_light(), Params::default());
        let error = tolerance * estimate_irradiance(&self.receivers, tree, light, &params);
        gather_hierarchical(
            receivers,
            tree,
            light,
            &params,
            Accuracy { error, split_near: false },
            &pinspot::NoProgress,
        )
    }

    fn flat(&self, leaves: &pinspot::low_level::pinhole::Pinholes, receivers: &Receivers) -> Vec<[f32; 4]> {
        on_cpu(receivers, leaves, &self.light.cube, &Params::default())
    }
}

fn energy(sums: &[[f32; 4]]) -> f64 {
    sums.iter().map(|s| f64::from(s[0] + s[1] + s[2])).sum()
}

fn fetches(sums: &[[f32; 4]]) -> f64 {
    sums.iter().map(|s| f64::from(s[3])).sum::<f64>() / sums.len() as f64
}

/// The error is below the tolerance and no energy is lost, in every scene and under three maps. A fourth, a city at
/// night, is all small lights in the dark: the wide kernels of large cells carry a little of them over the mirrors' edges.
#[test]
fn it_sums_what_its_leaves_do() {
    sums_are_those_of_leaves(support::is_telling);
}

#[test]
#[ignore = "full: all other scenes"]
fn it_sums_what_its_leaves_do_in_all_other_scenes() {
    sums_are_those_of_leaves(|name| !support::is_telling(name));
}

fn sums_are_those_of_leaves(is_asked_for: fn(&str) -> bool) {
    const TOLERANCE: f32 = 0.01;
    let mut failures = Vec::new();
    let maps = ["forest", "clear-sky", "studio", "city"].map(|name| (name, light_of_map(name)));
    for (number, built_in) in BUILT_IN.iter().enumerate().filter(|(_, scene)| is_asked_for(scene.name)) {
        let mut work = Work::new(built_in.name, 16);
        let tree = work.tree(400, 16);
        let own = ("its own light", work.light.clone());
        // One of the maps each.
        let maps = maps.iter().cycle().skip(number % 4).take(1);
        for (map, light) in std::iter::once(&own).chain(maps) {
            work.light = light.clone();
            let flat = work.flat(&tree.leaves(), &work.receivers);
            let fast = work.hierarchical(&tree, &work.receivers, TOLERANCE);
            let (error, kept) = (rel_l2(&fast, &flat), energy(&fast) / energy(&flat));
            let cost = fetches(&fast) / fetches(&flat);
            println!("{:16} {map}: {error:.4}, energy {kept:.4}, fetches {cost:.3}", built_in.name);
            // Under a light that is the same everywhere, the largest cells do, and their errors have one sign.
            let is_even = *map == own.0 && matches!(work.prepared.scene.environment.light, scene::Light::Constant(_));
            let off = if is_even {
                0.012
            } else if *map == "city" {
                0.006
            } else {
                0.002
            };
            if error > f64::from(TOLERANCE) || (kept - 1.0).abs() > off {
                failures.push(format!("{} {map}: {error:.4}, energy {kept:.4}", built_in.name));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn shadows_are_those_of_the_samples() {
    are_those_of_the_samples(&["columns", "cup"]);
}

#[test]
#[ignore = "full: more scenes"]
fn shadows_are_those_of_the_samples_in_more_scenes() {
    are_those_of_the_samples(&["ring-natural", "spoon", "disco-ball"]);
}

/// With one leaf per sample, both use the same visibility maps.
fn are_those_of_the_samples(scenes: &[&str]) {
    for name in scenes {
        let work = Work::new(name, 96);
        let tree = work.prepared.tree(1000, 1, Visibility::Full);
        let flat = work.flat(tree.sample_nodes(), &work.receivers);
        let fast = work.hierarchical(&tree, &work.receivers, 0.01);
        let (error, kept) = (rel_l2(&fast, &flat), energy(&fast) / energy(&flat));
        println!("{name}: {error:.4}, energy {kept:.4}");
        assert!(error < 0.01 && (kept - 1.0).abs() < 0.002, "{name}: {error} {kept}");
    }
}

#[test]
fn tolerance_is_what_the_error_follows() {
    let work = Work::new("ring-natural", 128);
    let tree = work.tree(300, 16);
    let flat = work.flat(&tree.leaves(), &work.receivers);
    let tries = [0.1, 0.01, 0.001].map(|tolerance| work.hierarchical(&tree, &work.receivers, tolerance));
    let errors = tries.each_ref().map(|sums| rel_l2(sums, &flat));
    let costs = tries.each_ref().map(|sums| fetches(sums));
    println!("{errors:?} {costs:?}");
    assert!(errors[0] < 0.1 && errors[1] < 0.01 && errors[2] < 0.002, "{errors:?}");
    assert!(errors[0] > 2.0 * errors[1] && costs[0] < 0.5 * costs[1] && costs[1] < costs[2]);
}

#[test]
fn receivers_may_come_as_a_list() {
    let work = Work::new("cup", 64);
    let tree = work.tree(300, 16);
    let picture = work.hierarchical(&tree, &work.receivers, 1e-3);
    let list = Receivers { layout: ReceiverLayout::Unordered, ..(*work.receivers).clone() };
    assert!(rel_l2(&work.hierarchical(&tree, &list, 1e-3), &picture) < 2e-3);
}

#[test]
fn a_thousand_times_the_leaves_cost_a_few_times_the_fetches() {
    leaves_cost_little("ring-above");
}

#[test]
#[ignore = "full: a picture of 256² pixels"]
fn leaves_cost_little_in_natural_light() {
    leaves_cost_little("ring-natural");
}

fn leaves_cost_little(name: &str) {
    let work = Work::new(name, 256);
    let cost = |leaves| fetches(&work.hierarchical(&work.tree(250, leaves), &work.receivers, 0.02));
    let (few, many) = (cost(4), cost(1024));
    println!("{name}: {few} {many}");
    assert!(many < 6.0 * few, "{name}: {few} {many}");
}

/// The hierarchy on glossy receivers, seen from above at an angle.
#[test]
fn glossy_receivers_get_what_the_leaves_bring() {
    let glosses = [
        Gloss::Phong { specular: glam::Vec3::splat(0.3), exponent: 60.0 },
        Gloss::Ggx { specular: glam::Vec3::splat(0.05), roughness: 0.35 },
    ];
    for gloss in &glosses {
        let work = Work::new("ring-natural", 48);
        let tree = work.tree(300, 16);
        let material = |_| Some((glam::Vec3::splat(0.4), gloss));
        let materials = Arc::new(Materials::new(work.prepared.scene.objects.iter().map(material)));
        let view = glam::Vec3::new(0.3, 0.8, 0.5).normalize().extend(0.0).to_array();
        let directions = vec![view; work.receivers.positions.len()];
        let receivers =
            Receivers { view_directions: Some(ViewDirections { directions, materials }), ..(*work.receivers).clone() };
        let flat = work.flat(&tree.leaves(), &receivers);
        let fast = work.hierarchical(&tree, &receivers, 0.01);
        let (error, kept) = (rel_l2(&fast, &flat), energy(&fast) / energy(&flat));
        println!("{gloss:?}: {error:.4} {kept:.4}");
        assert!(error < 0.01 && (kept - 1.0).abs() < 0.002, "{gloss:?}: {error} {kept}");
    }
}

#[test]
fn leaves_bring_it_nearer_to_the_truth() {
    leaves_bring_nearer(&[("spoon", Visibility::None)]);
}

#[test]
#[ignore = "full: more ground truths"]
fn leaves_bring_more_scenes_nearer_to_the_truth() {
    leaves_bring_nearer(&[("ring-natural", Visibility::None), ("spoon", Visibility::Full)]);
}

/// By default, leaves bring the picture nearer to the truth than samples alone do.
fn leaves_bring_nearer(cases: &[(&str, Visibility)]) {
    const EDGE: u32 = 16;
    for &(name, visibility) in cases {
        let truth = truth(name, Quantity::Caustic, visibility, EDGE, 0.01);
        let error = |evaluation| {
            let image = rendered(name, EDGE, |options| {
                options.samples = 300;
                options.visibility = visibility;
                options.evaluation = evaluation;
            });
            image_rel_l2(&image, &truth, None)
        };
        let [flat, tree] = [EvaluationChoice::Flat, EvaluationChoice::Hierarchical].map(error);
        println!("{name} {visibility:?}: {flat:.4} {tree:.4}");
        assert!(tree < 0.6 * flat, "{name} {visibility:?}: {flat} {tree}");
    }
}

/// What the hierarchy does not know it leaves to the flat sum, or says so.
#[test]
fn what_is_not_known_is_refused_or_left_to_the_flat_sum() {
    let render = |change: &dyn Fn(&mut pinspot::Options)| {
        let (scene, mut options) = pinspot::load("mirror-sphere").unwrap();
        (options.size, options.samples) = ([16, 16], 40);
        change(&mut options);
        let rendered = support::render(scene, options, &BackendChoice::Cpu);
        rendered.map(|r| r.report.evaluation.unwrap()).map_err(|e| e.to_string())
    };
    use pinspot::Evaluation::{Flat, Hierarchical};
    use pinspot::{Epsilon, FilterChoice, Footprint};
    assert_eq!(render(&|_| ()).unwrap(), Hierarchical { leaves: 256, tolerance: 0.01 });
    assert_eq!(render(&|o| o.leaves = Some(20)).unwrap(), Hierarchical { leaves: 16, tolerance: 0.01 });
    let obstacles: [&dyn Fn(&mut pinspot::Options); 3] =
        [&|o| o.filter = FilterChoice::None, &|o| o.footprint = Footprint::Curvature, &|o| {
            o.epsilon = Epsilon::Paper;
        }];
    for obstacle in obstacles {
        assert_eq!(render(obstacle).unwrap(), Flat { leaves: 1 });
        let insisted = render(&|o| {
            obstacle(o);
            o.evaluation = EvaluationChoice::Hierarchical;
        });
        assert!(insisted.unwrap_err().starts_with("evaluation hierarchical "));
    }
}

/// A ball of receivers rolls over the floor: only the tiles that it left or entered are gathered again, and the picture is the
/// same to the bit.
#[test]
fn what_did_not_move_is_taken_from_the_image_before() {
    let work = Work::new("ring-natural", 192);
    let tree = work.tree(200, 16);
    let light = work.light.as_light();
    let (params, accuracy) = (Params::default(), Accuracy { error: 1e-3, split_near: true });
    let mut still = CachedGather::new(&tree, light, &params, accuracy);
    for (frame, expected) in [(0, 0), (0, 192 * 192), (1, 192 * 192 - 64 * 64), (2, 192 * 192 - 64 * 64)] {
        let mut receivers = (*work.receivers).clone();
        for k in (0..192 * 192).filter(|k| frame > 0 && k % 192 < 64 && k / 192 < 20 * frame) {
            receivers.positions[k] = [0.1, 0.3, 0.01 * frame as f32, 7.0];
        }
        let anew = gather_hierarchical(&receivers, &tree, light, &params, accuracy, &pinspot::NoProgress);
        let again = still.gather(receivers, &pinspot::NoProgress);
        assert_eq!(again.reused, expected, "image {frame}");
        assert!(again.sums == anew);
    }
    let smaller = &Work::new("ring-natural", 64).receivers;
    assert_eq!(still.gather(Receivers::clone(smaller), &pinspot::NoProgress).reused, 0);
}
