//! The hierarchy on the GPU: what its CPU twin sums, within WebGPU's default limits, however its work is divided.

use std::sync::{Arc, Mutex};

use glam::Vec3;
use pinspot::blocking::wait;
use pinspot::image::Aov;
use pinspot::low_level::brdf::Materials;
use pinspot::low_level::gpu::Gpu;
use pinspot::low_level::pinhole::cpu::{Accuracy, estimate_irradiance, gather_hierarchical};
use pinspot::low_level::pinhole::gpu::{
    CellTreeBuffers, EnvironmentCube, FrameViewers, HierarchicalEngine, HierarchicalInputs, HierarchicalOptions,
    LightBoundsBuilder, LightBoundsTexture, LightKind, Tolerance, TreeLight,
};
use pinspot::low_level::pinhole::{Params, PinholeTree, ReceiverLayout, Receivers, ViewDirections};
use pinspot::scene::{Medium, Scene, Visibility};
use pinspot::{Backend, CubeSize, EvaluationChoice, FilterChoice, Rendered};

use crate::support::{self, PreparedLight, PreparedScene, gpu, gpu_backend, prepared, rel_l2, rotated_light};

/// A built-in scene's picture on a back end, with changes to the scene.
fn render(
    name: &str,
    aov: Aov,
    visibility: Visibility,
    size: [u32; 2],
    backend: &Backend,
    change: fn(&mut Scene),
) -> Rendered {
    support::with_engine(name, backend, |engine| {
        // By an angle at which no texel meets another: both back ends rotate their look-ups.
        engine.scene_mut().environment.rotation_rad += 0.7;
        change(engine.scene_mut());
        let options = engine.options_mut();
        options.size = size;
        options.samples = 150;
        // With visibility, `columns` in a coarser cube map exceeds the software adapter's limit of loop iterations.
        if visibility == Visibility::None {
            options.cube_size = CubeSize::Texels(128);
        }
        options.leaves = Some(16);
        options.visibility = visibility;
        options.filter = FilterChoice::Anisotropic;
        options.evaluation = EvaluationChoice::Hierarchical;
        options.aovs = vec![aov];
        support::render_again(engine).unwrap()
    })
}

/// Pictures of caustics, and what cameras see of glossy floors and in mirrors, where receivers come as lists.
#[test]
fn back_ends_agree_on_telling_scenes() {
    back_ends_agree(|name, visibility| support::is_telling(name) && visibility == Visibility::None);
}

#[test]
#[ignore = "full: all other scenes, and shadows by rays on a software adapter"]
fn back_ends_agree_on_all_other_scenes() {
    back_ends_agree(|name, visibility| !support::is_telling(name) || visibility != Visibility::None);
}

fn back_ends_agree(is_asked_for: fn(&str, Visibility) -> bool) {
    let limit = |name: &str| match name {
        // Next to total reflection directions turn without bound, and rounding decides what is refined. Of views of lit surfaces the GPU
        // has bounds without blur only, and refines more.
        "pool" | "colours" => 6e-4,
        // Errors are allowed relative to all light. Of the environment, dim beside the lamps, that is a large part, and the back ends
        // interpolate it over blocks of different sizes. A tenth of the tolerance leaves 3e-5.
        "dance-floor" => 1.5e-3,
        _ => 1e-4,
    };
    // Flat sums are compared in all scenes.
    let scenes = support::clear_scenes().skip(1).step_by(2);
    let caustics = scenes.map(|name| (name, Aov::Caustic, Visibility::None, [40, 32], limit(name)));
    // Rays that pass an edge closely may meet it on one back end only. In a whole picture, what is interpolated may then differ, too.
    let others = [
        ("columns", Aov::Caustic, Visibility::Full, [40, 32], 5e-4),
        ("ring-natural", Aov::Caustic, Visibility::Full, [40, 32], 5e-4),
        // The CPU finds shadows for groups of points, which is off by a twentieth in some pixels at their edges.
        ("cup", Aov::Beauty, Visibility::Full, [56, 48], 6e-3),
        ("varnish", Aov::Beauty, Visibility::None, [72, 64], 2.5e-3),
    ];
    let mut failures = Vec::new();
    for (name, aov, visibility, size, limit) in caustics.chain(others).filter(|case| is_asked_for(case.0, case.2)) {
        let [on_cpu, on_gpu] =
            [Backend::cpu(), gpu_backend()].map(|backend| render(name, aov, visibility, size, &backend, |_| ()));
        let [cpu, gpu] = [&on_cpu, &on_gpu].map(|r| r.layer(aov).unwrap());
        assert!(cpu.mean().x > 0.0, "{name}: nothing at all");
        let error = pinspot::image::rel_l2(gpu, cpu, None);
        let fetches = on_gpu.report.lookups / on_cpu.report.lookups;
        println!("{name:16} {aov:?} {visibility:?}: {error:.1e}, fetches {fetches:.3}");
        // Where a small contribution is partly occluded, only the CPU interpolates it.
        // Of errors that other light hides, it takes the least of sixteen points, the GPU that of each.
        let expected = match (visibility, aov) {
            (Visibility::Full, Aov::Beauty) => 0.9..1.5,
            (Visibility::Full, _) => 0.95..1.5,
            (_, Aov::Beauty) => 0.75..1.05,
            _ => 0.99..1.01,
        };
        if error > limit || !expected.contains(&fetches) {
            failures.push(format!("{name} {aov:?} {visibility:?}: {error:.1e}, fetches {fetches:.3}"));
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// The emitters of `dance-floor` as a part of the environment.
#[test]
fn back_ends_agree_on_distant_emitters() {
    let pictures = [Backend::cpu(), gpu_backend()].map(|backend| {
        render("dance-floor", Aov::Caustic, Visibility::None, [40, 32], &backend, |scene| {
            scene.objects.iter_mut().filter_map(|o| o.emitter.as_mut()).for_each(|emitter| emitter.is_near = false);
        })
    });
    let [cpu, gpu] = pictures.each_ref().map(|rendered| rendered.layer(Aov::Caustic).unwrap());
    let error = pinspot::image::rel_l2(gpu, cpu, None);
    let fetches = pictures[1].report.lookups / pictures[0].report.lookups;
    assert!(error < 1e-4 && (0.99..1.01).contains(&fetches), "{error:.1e}, fetches {fetches:.3}");
}

#[test]
fn back_ends_agree_on_visibility_maps() {
    agree_on_visibility_maps(&[("ring-natural", 1e-4)]);
}

#[test]
#[ignore = "full: more scenes"]
fn back_ends_agree_on_visibility_maps_of_more_scenes() {
    agree_on_visibility_maps(&[("columns", 1e-4), ("cup", 1e-3), ("gloss", 2e-3)]);
}

/// By maps alone, both look visibility up the same way.
fn agree_on_visibility_maps(cases: &[(&str, f64)]) {
    for &(name, limit) in cases {
        let work = Work::new(name, [48, 40], 150, 16, Visibility::Full);
        let how = How { environment_rotation_rad: 0.7, ..work.how(0.01) };
        let error = rel_l2(&work.on_gpu(gpu(), &how), &work.on_cpu(&how));
        println!("{name}: {error:.1e}");
        assert!(error < limit, "{name}: {error}");
    }
}

/// An engine of a device; those of the adapter under test are made once for all tests.
fn engine(gpu: &Gpu, options: HierarchicalOptions) -> Arc<HierarchicalEngine> {
    static ENGINES: Mutex<Vec<(HierarchicalOptions, Arc<HierarchicalEngine>)>> = Mutex::new(Vec::new());
    if !std::ptr::eq(gpu, support::gpu()) {
        return Arc::new(HierarchicalEngine::new(&gpu.device, &options));
    }
    let mut engines = ENGINES.lock().unwrap();
    if let Some((_, known)) = engines.iter().find(|(known, _)| *known == options) {
        return known.clone();
    }
    let made = Arc::new(HierarchicalEngine::new(&gpu.device, &options));
    engines.push((options, made.clone()));
    made
}

/// A scene ready to be gathered by engines of the caller's.
struct Work {
    prepared: Arc<PreparedScene>,
    receivers: Receivers,
    light: Arc<PreparedLight>,
    tree: Arc<PinholeTree>,
}

/// What differs from one gather to another.
#[derive(Clone, Copy)]
struct How {
    tolerance: Tolerance,
    split_passes: u32,
    split_near: bool,
    environment_rotation_rad: f32,
    medium: Option<Medium>,
}

impl How {
    fn params(&self) -> Params {
        let Self { environment_rotation_rad, medium, .. } = *self;
        Params { environment_rotation_rad, medium, ..Params::default() }
    }
}

impl Work {
    fn new(name: &str, size: [u32; 2], samples: u32, leaves: u32, visibility: Visibility) -> Self {
        let prepared = prepared(name);
        Self {
            receivers: (*prepared.receivers(size)).clone(),
            light: prepared.light(CubeSize::Texels(128)),
            tree: prepared.tree(samples, leaves, visibility),
            prepared,
        }
    }

    fn typical(&self) -> f32 {
        estimate_irradiance(&self.receivers, &self.tree, self.light.as_light(), &Params::default())
    }

    fn how(&self, tolerance: f32) -> How {
        let tolerance = Tolerance::Absolute(tolerance * self.typical());
        How { tolerance, split_passes: 16, split_near: false, environment_rotation_rad: 0.0, medium: None }
    }

    /// As the device wants them: parts of rays come as the ways from one end to the other.
    fn normals(&self) -> Vec<[f32; 4]> {
        let Some(lengths) = &self.receivers.lengths else { return self.receivers.normals.clone() };
        let way = |([x, y, z, w], length): (&[f32; 4], &f32)| [x * length, y * length, z * length, *w];
        self.receivers.normals.iter().zip(lengths).map(way).collect()
    }

    fn on_cpu(&self, how: &How) -> Vec<[f32; 4]> {
        let error = match how.tolerance {
            Tolerance::Absolute(error) => error,
            Tolerance::Relative(part) => part * self.typical(),
        };
        let accuracy = Accuracy { error, split_near: how.split_near };
        gather_hierarchical(
            &self.receivers,
            &self.tree,
            self.light.as_light(),
            &how.params(),
            accuracy,
            &pinspot::NoProgress,
        )
    }

    /// Everything in one submission, the light's bounds made there.
    fn on_gpu(&self, gpu: &Gpu, how: &How) -> Vec<[f32; 4]> {
        let (device, size) = (&gpu.device, [self.receivers.width, self.receivers.height]);
        let environment = EnvironmentCube::upload(device, &gpu.queue, &self.light.cube).unwrap();
        let builder = LightBoundsBuilder::new(device, &environment).unwrap();
        // Those of means along parts of rays are found on the CPU only.
        let uploaded = how.medium.map(|_| LightBoundsTexture::upload(device, &gpu.queue, &self.light.bounds));
        let bounds = uploaded.as_ref().unwrap_or(builder.bounds());
        let params = how.params();
        let visibility = self.tree.sample_nodes().visibility.is_some();
        let engine = engine(
            gpu,
            HierarchicalOptions {
                filter: params.filter,
                light: LightKind::Environment,
                visibility,
                refraction: self.tree.refracts(),
                medium: how.medium.is_some(),
            },
        );
        let viewers = self.receivers.view_directions.as_ref();
        let directions = viewers.map(|viewers| gpu.upload_texture(size, &viewers.directions));
        let viewers = directions.as_ref().zip(viewers);
        let inputs = HierarchicalInputs {
            positions: &gpu.upload_texture(size, &self.receivers.positions),
            normals: &gpu.upload_texture(size, &self.normals()),
            viewers: viewers.map(|(directions, v)| FrameViewers { directions, materials: &v.materials }),
            size,
            is_grid: self.receivers.layout == ReceiverLayout::Grid,
            tree: &CellTreeBuffers::upload(device, &self.tree).unwrap(),
            light: TreeLight::Environment { cube: &environment, bounds },
            params,
            tolerance: how.tolerance,
            has_tolerances: false,
            split_near: how.split_near,
            split_passes: how.split_passes,
        };
        let mut frame = engine.frame(device, &inputs).unwrap();
        let mut encoder = device.create_command_encoder(&Default::default());
        builder.record(&mut encoder);
        frame.record(&mut encoder, 0..frame.batch_count());
        gpu.queue.submit([encoder.finish()]);
        let sums = wait(Some(device), gpu.read_texture(frame.caustic())).unwrap();
        gpu.check().unwrap();
        sums
    }
}

/// What a medium scatters along camera rays, in four parts of each. In pictures, parts are allowed errors of their own beside.
#[test]
fn parts_of_rays_are_those_of_the_cpu() {
    let mut work = Work::new("ring-natural", [16, 12], 100, 16, Visibility::None);
    let camera = work.prepared.scene.camera.position;
    let ends: Vec<Vec3> =
        work.receivers.positions.iter().filter(|p| p[3] >= 0.0).map(|p| Vec3::from_slice(p)).collect();
    let mut parts = Receivers::of_rays(16, (4 * ends.len()).div_ceil(16) as u32);
    for (k, end) in ends.iter().enumerate() {
        let way = (camera - end) / 4.0;
        (0..4).for_each(|j| parts.set_part(4 * k + j, end + (j as f32 + 0.5) * way, way.normalize(), way.length()));
    }
    let fog = Medium { sigma_s: Vec3::new(0.1, 0.2, 0.3), sigma_a: Vec3::splat(0.1), g: 0.6 };
    let how = How { split_near: true, medium: Some(fog), ..work.how(0.01) };
    work.receivers = parts;
    let on_cpu = work.on_cpu(&how);
    let (in_tiles, places) = work.receivers.in_tiles();
    work.receivers = in_tiles;
    let on_gpu = work.on_gpu(gpu(), &how);
    let on_gpu: Vec<[f32; 4]> = places.iter().map(|&place| on_gpu[place]).collect();
    let error = rel_l2(&on_gpu, &on_cpu);
    let [gpu, cpu] = [&on_gpu, &on_cpu].map(|sums| sums.iter().map(|sum| sum[3]).sum::<f32>());
    println!("{error:.1e}, fetches {}", gpu / cpu);
    assert!(error < 1e-4, "{error}");
    assert!((gpu / cpu - 1.0).abs() < 0.01, "{gpu} {cpu}");
}

/// Half floats for the light, 128 MiB a binding, eight storage buffers a stage: what browsers have.
#[test]
fn a_minimal_device_is_enough() {
    let work = Work::new("ring-natural", [56, 48], 300, 16, Visibility::Full);
    let how = work.how(0.01);
    let error = rel_l2(&work.on_gpu(&wait(None, Gpu::open_minimal()).unwrap(), &how), &work.on_cpu(&how));
    println!("{error:.1e}");
    assert!(error < 3e-3, "{error}");
}

#[test]
fn split_passes_add_up() {
    let work = Work::new("spoon", [72, 72], 200, 16, Visibility::None);
    let [whole, split] = [1, 5].map(|split_passes| work.on_gpu(gpu(), &How { split_passes, ..work.how(0.02) }));
    assert!(whole.iter().any(|sum| sum[0] > 0.0));
    let error = rel_l2(&split, &whole);
    assert!(error < 1e-6, "{error}");
}

/// The estimate's pass finds what the CPU's estimate finds, so that as much is done.
#[test]
#[ignore = "full: larger pictures on a software adapter"]
fn the_error_may_be_relative_to_what_the_image_is_like() {
    for visibility in [Visibility::None, Visibility::Full] {
        let work = Work::new("ring-natural", [96, 64], 300, 16, visibility);
        let fetches = |sums: &[[f32; 4]]| sums.iter().map(|s| f64::from(s[3])).sum::<f64>();
        let relative = work.on_gpu(gpu(), &How { tolerance: Tolerance::Relative(0.01), ..work.how(0.01) });
        let cpu = work.on_cpu(&work.how(0.01));
        let (error, cost) = (rel_l2(&relative, &cpu), fetches(&relative) / fetches(&cpu));
        println!("{error:.1e} {cost:.3}");
        // Where a small contribution is partly occluded, only the CPU interpolates it.
        let most = if visibility == Visibility::Full { 1.35 } else { 1.15 };
        assert!(error < 2e-3 && (0.85..most).contains(&cost), "{visibility:?}: {error} {cost}");
    }
}

/// A quarter turn maps the cube's texels onto each other: rotating the look-ups is rotating the light.
#[test]
#[ignore = "full: many sums on a software adapter"]
fn a_rotated_environment_is_the_rotated_light() {
    let mut work = Work::new("ring-natural", [56, 48], 200, 16, Visibility::Full);
    let turn = std::f32::consts::FRAC_PI_2;
    let mut set_light = |rotation: f32| {
        work.light = Arc::new(PreparedLight::new(rotated_light(rotation)));
        let how = work.how(0.01);
        let relative = How { tolerance: Tolerance::Relative(0.01), ..how };
        (how, relative, [how, relative].map(|how| work.on_gpu(gpu(), &how)))
    };
    let (how, relative, expected) = set_light(turn);
    let (_, _, unrotated) = set_light(0.0);
    for ((how, expected), unrotated) in [how, relative].iter().zip(&expected).zip(&unrotated) {
        let rotated = work.on_gpu(gpu(), &How { environment_rotation_rad: turn, ..*how });
        let (error, change) = (rel_l2(&rotated, expected), rel_l2(unrotated, expected));
        println!("{:?}: {error:.1e}, {change:.1e} without the rotation", how.tolerance);
        assert!(error < 1e-3 && change > 0.05, "{error} {change}");
    }
}

/// More cells than a list holds: they are handed on unrefined, and nothing is lost.
#[test]
fn full_lists_lose_nothing() {
    let work = Work::new("ring-natural", [16, 16], 6000, 1, Visibility::Full);
    let how = How { split_passes: 512, ..work.how(0.001) };
    let error = rel_l2(&work.on_gpu(gpu(), &how), &work.on_cpu(&how));
    println!("{error:.1e}");
    assert!(error < 1e-4, "{error}");
}

/// Receivers in no picture's order, with viewers of their own.
#[test]
fn lists_of_glossy_receivers_are_gathered() {
    let mut work = Work::new("varnish", [64, 64], 200, 16, Visibility::None);
    let view = glam::Vec3::new(0.3, 0.8, 0.5).normalize().extend(0.0).to_array();
    let directions = vec![view; work.receivers.positions.len()];
    let materials: Arc<Materials> = Arc::new(work.prepared.scene.materials());
    let list = Receivers {
        layout: ReceiverLayout::Unordered,
        view_directions: Some(ViewDirections { directions, materials }),
        ..work.receivers.clone()
    };
    let (tiled, places) = list.in_tiles();
    work.receivers = list;
    let how = work.how(0.01);
    let cpu = work.on_cpu(&how);
    work.receivers = tiled;
    let gpu = work.on_gpu(gpu(), &how);
    let gpu: Vec<[f32; 4]> = places.iter().map(|&place| gpu[place]).collect();
    let error = rel_l2(&gpu, &cpu);
    println!("{error:.1e}");
    assert!(error < 1e-3, "{error}");
}

/// Mesa's software adapter, up to some version between 22.3 and 25.0, ends loops after 65,535 iterations. What that cuts short says so.
#[test]
fn loops_that_are_cut_short_are_reported() {
    let work = Work::new("ring-natural", [8, 8], 100, 1024, Visibility::None);
    let how = How { split_passes: 1, split_near: true, ..work.how(1e-5) };
    let gathered = work.on_gpu(gpu(), &how);
    let is_short = gathered.iter().any(|sum| sum[3] < 0.0);
    if gpu().adapter.driver.contains("Mesa 22.") {
        assert!(is_short, "lavapipe has learnt to loop");
    }
    let cpu = work.on_cpu(&how);
    for (gpu, cpu) in gathered.iter().zip(&cpu).filter(|(gpu, _)| gpu[3] >= 0.0) {
        assert!((gpu[0] - cpu[0]).abs() <= 1e-3 * (cpu[0] + work.typical()), "{gpu:?} {cpu:?}");
    }
}
