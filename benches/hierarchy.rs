//! What the hierarchy is worth, as ratios within one run on one core: `cargo bench --bench hierarchy`.
//!
//! A table of its own instead of criterion's: single runs take seconds, and what counts is their ratio. The flat sum takes the
//! leaves of the same tree, on one row of pixels in sixteen; its time goes with the number of pixels.

mod bare_cpu;
mod bare_gpu;

use std::hint::black_box;
use std::time::Instant;

use bare_cpu::bare_cpu_loop;
use bare_gpu::BareLoop;
use glam::{Vec2, Vec3};
use pinspot::Settings;
use pinspot::blocking::wait;
use pinspot::low_level::cell_tree::{CellTree, NodeGeometry, TreeOptions};
use pinspot::low_level::differential::differentials;
use pinspot::low_level::environment::{Environment, LightBounds};
use pinspot::low_level::gpu::Gpu;
use pinspot::low_level::pinhole::cpu::{Accuracy, Light, estimate_irradiance, gather, gather_hierarchical};
use pinspot::low_level::pinhole::gpu::{
    CellTreeBuffers, EnvironmentCube, HierarchicalEngine, HierarchicalInputs, HierarchicalOptions, LightBoundsTexture,
    LightKind, Tolerance, TreeLight,
};
use pinspot::low_level::pinhole::{Params, PinholeTree, Receivers};
use pinspot::low_level::sampling::{self, Strategy, Surface, sample};
use pinspot::low_level::tracing::Tracer;
use pinspot::low_level::visible_receivers;
use pinspot::scene::{BUILT_IN, Mesh, Scene, load};

const EDGE: u32 = 512;
/// One row in so many is summed flat.
const FLAT_ROWS: u32 = 16;

/// A scene's light and what receives it.
struct Work {
    scene: Scene,
    surface: Surface,
    environment: Environment,
    bounds: LightBounds,
    receivers: Receivers,
}

impl Work {
    fn new(name: &'static str, edge: u32) -> Self {
        Self::of_size(name, [edge; 2])
    }

    fn of_size(name: &'static str, size: [u32; 2]) -> Self {
        let scene = load::<Settings>(name).expect("built-in").scene;
        let environment = Environment::new(&scene.environment.light, Default::default()).expect("built-in");
        let tracer = Tracer::new(&scene);
        let receivers = visible_receivers(&scene, &tracer, size);
        let (surface, bounds) = (Surface::of_scene(&scene), LightBounds::new(&environment.cube));
        Self { scene, surface, environment, bounds, receivers }
    }

    fn tree(&self, samples: u32, leaves: u32, seed: u64) -> PinholeTree {
        let options = sampling::Options { samples, strategy: Strategy::Neighbourhood, seed };
        let set = sample(&self.surface, &options).expect("a reflector");
        PinholeTree::new(&self.scene, CellTree::new(&self.surface, &set, &TreeOptions { leaves, seed }))
    }

    /// Gathers by the tree: the sums, and the best of some times, seconds.
    fn hierarchical(&self, tree: &PinholeTree, tolerance: f32, runs: u32) -> (Vec<[f32; 4]>, f64) {
        let (light, params) =
            (Light::Environment { cube: &self.environment.cube, bounds: &self.bounds }, Params::default());
        let run = || {
            let started = Instant::now();
            let error = tolerance * estimate_irradiance(&self.receivers, tree, light, &params);
            let accuracy = Accuracy { error, split_near: true };
            let sums = gather_hierarchical(&self.receivers, tree, light, &params, accuracy, &pinspot::NoProgress);
            (sums, started.elapsed().as_secs_f64())
        };
        (0..runs).map(|_| run()).min_by(|a, b| a.1.total_cmp(&b.1)).expect("at least one run")
    }

    /// Every sixteenth row.
    fn some_rows(&self) -> (Receivers, Vec<usize>) {
        let width = self.receivers.width as usize;
        let rows = (0..self.receivers.height as usize).filter(|y| y % FLAT_ROWS as usize == 5);
        let places: Vec<usize> = rows.flat_map(|y| y * width..(y + 1) * width).collect();
        let of = |all: &[[f32; 4]]| places.iter().map(|&k| all[k]).collect::<Vec<_>>();
        let some = Receivers {
            height: places.len() as u32 / self.receivers.width,
            positions: of(&self.receivers.positions),
            normals: of(&self.receivers.normals),
            ..Receivers::empty(self.receivers.width, 0)
        };
        (some, places)
    }

    /// Sums the leaves flat: the sums of some rows, where they belong, and the seconds that all rows would take.
    fn flat(&self, tree: &PinholeTree) -> (Vec<[f32; 4]>, Vec<usize>, f64) {
        let (some, places) = self.some_rows();
        let leaves = tree.leaves();
        let started = Instant::now();
        let sums = gather(&some, &leaves, &self.environment.cube, &Params::default(), &pinspot::NoProgress).unwrap();
        let seconds = started.elapsed().as_secs_f64() * self.receivers.positions.len() as f64 / places.len() as f64;
        (sums, places, seconds)
    }

    /// Where errors count: not within 15 mm of the ring's wall, where the integral is singular, nor where there is hardly
    /// any light.
    fn mask(&self, truth: &[[f32; 4]]) -> Vec<bool> {
        let mut sorted: Vec<f32> = truth.iter().map(|t| t[1]).filter(|t| *t > 0.0).collect();
        sorted.sort_by(f32::total_cmp);
        let least = 0.02 * sorted[(sorted.len() as f64 * 0.999) as usize];
        let counts =
            |(p, t): (&[f32; 4], &[f32; 4])| t[1] > least && (Vec2::new(p[0], p[2]).length() - 1.0).abs() > 0.015;
        self.receivers.positions.iter().zip(truth).map(counts).collect()
    }
}

/// ‖a − b‖₂ / ‖b‖₂ over some places.
fn error(sums: &[[f32; 4]], truth: &[[f32; 4]], places: &[usize], mask: &[bool]) -> f64 {
    let (mut off, mut norm) = (0.0, 0.0);
    for (sum, &k) in sums.iter().zip(places).filter(|(_, k)| mask[**k]) {
        for c in 0..3 {
            off += f64::from(sum[c] - truth[k][c]).powi(2);
            norm += f64::from(truth[k][c]).powi(2);
        }
    }
    (off / norm).sqrt()
}

fn fetches(sums: &[[f32; 4]]) -> f64 {
    sums.iter().map(|s| f64::from(s[3])).sum::<f64>() / sums.len() as f64
}

fn all(work: &Work) -> Vec<usize> {
    (0..work.receivers.positions.len()).collect()
}

/// Time to an error: the tree with the fewest leaves that reaches it, flat and hierarchical.
fn equal_error(name: &'static str, goal: f64) {
    let work = Work::new(name, EDGE);
    let truth = work.hierarchical(&work.tree(1000, 1024, 9), 0.001, 1).0;
    let mask = work.mask(&truth);
    let mut flat_seconds = None;
    for leaves in [4u32, 16, 64, 256] {
        for samples in [500, 750, 1000, 1500] {
            let tree = work.tree(samples, leaves, 1);
            let (sums, places, seconds) = work.flat(&tree);
            let flat_error = error(&sums, &truth, &places, &mask);
            println!("  {name} flat {samples} x {leaves}: error {flat_error:.4}, {seconds:.1} s");
            if flat_error > goal {
                continue;
            }
            flat_seconds = flat_seconds.or(Some(seconds));
            for tolerance in [0.3, 0.1, 0.03, 0.01] {
                let (sums, seconds) = work.hierarchical(&tree, tolerance, 3);
                let tree_error = error(&sums, &truth, &all(&work), &mask);
                println!(
                    "  {name} hierarchical {samples} x {leaves}, tolerance {tolerance}: error {tree_error:.4}, {seconds:.3} s, {:.0} fetches",
                    fetches(&sums)
                );
                if tree_error <= goal {
                    let flat = flat_seconds.expect("flat is done first");
                    println!(
                        "{name} to an error of {goal}: {:.0} x as fast as the flat sum ({flat:.1} s, {seconds:.3} s)",
                        flat / seconds
                    );
                    return;
                }
            }
        }
    }
    println!("{name}: no error of {goal}");
}

fn growth(name: &'static str) {
    let work = Work::new(name, EDGE);
    let mut times = Vec::new();
    for leaves in [1, 4, 16, 64, 256, 1024] {
        let tree = work.tree(1000, leaves, 1);
        let (sums, seconds) = work.hierarchical(&tree, 0.02, 3);
        println!("  {name}, {} leaves: {seconds:.3} s, {:.0} fetches", tree.tree().leaves().count(), fetches(&sums));
        times.push(seconds);
    }
    println!("{name}, from 1,000 to 1,000,000 leaves: {:.1} x the time", times[5] / times[0]);
    let flat = work.flat(&work.tree(1000, 1, 1)).2;
    println!("  {name}, 1,000 samples flat: {flat:.2} s");
}

fn size(name: &'static str) {
    let seconds = [EDGE, 4 * EDGE].map(|edge| {
        let work = Work::new(name, edge);
        work.hierarchical(&work.tree(1000, 64, 1), 0.02, 2).1
    });
    println!("{name}, from 512² to 2048²: {:.1} x the time", seconds[1] / seconds[0]);
}

/// What a look-up costs, of the light or of its bounds, beside one in a loop that does nothing else.
fn look_ups(name: &'static str) {
    let work = Work::new(name, EDGE);
    let tree = work.tree(1000, 64, 1);
    let (sums, seconds) = work.hierarchical(&tree, 0.01, 3);
    let groups = u64::from(EDGE * EDGE / 16);
    let per_group = (fetches(&sums) * f64::from(EDGE * EDGE)) as u64 / 16 / groups;
    let bare = best(3, &|| {
        black_box(bare_cpu_loop(&work.environment.cube, [1.5, 3.5], groups, per_group));
    });
    let of_all = (per_group * 16 * groups) as f64 / 1e6;
    println!(
        "{name}: {:.0} M look-ups a second, {:.2} of a bare loop's {:.0}",
        of_all / seconds,
        bare / seconds,
        of_all / bare
    );
}

/// A frame of the hierarchy on a GPU, everything on the device: look-ups a pixel, and the shortest of some times, seconds.
fn frame_on_gpu(gpu: &Gpu, work: &Work, tree: &PinholeTree) -> (f64, f64) {
    let (device, size) = (&gpu.device, [work.receivers.width, work.receivers.height]);
    let params = Params::default();
    let options = HierarchicalOptions {
        filter: params.filter,
        light: LightKind::Environment,
        visibility: false,
        refraction: false,
        medium: false,
    };
    let engine = HierarchicalEngine::new(device, &options);
    let environment = EnvironmentCube::upload(device, &gpu.queue, &work.environment.cube).expect("it fits");
    let inputs = HierarchicalInputs {
        positions: &gpu.upload_texture(size, &work.receivers.positions),
        normals: &gpu.upload_texture(size, &work.receivers.normals),
        viewers: None,
        size,
        is_grid: true,
        tree: &CellTreeBuffers::upload(device, tree).expect("it fits"),
        light: TreeLight::Environment {
            cube: &environment,
            bounds: &LightBoundsTexture::upload(device, &gpu.queue, &work.bounds),
        },
        params,
        tolerance: Tolerance::Relative(0.01),
        has_tolerances: false,
        split_near: true,
        split_passes: if gpu.adapter.software { 64 } else { 1 },
    };
    let frame = || {
        let mut frame = engine.frame(device, &inputs).expect("it fits");
        let started = Instant::now();
        let mut encoder = device.create_command_encoder(&Default::default());
        frame.record(&mut encoder, 0..frame.batch_count());
        gpu.queue.submit([encoder.finish()]);
        wait(Some(&gpu.device), gpu.submitted_work_done()).expect("a device");
        (frame, started.elapsed().as_secs_f64())
    };
    let (first, _) = frame();
    let sums = wait(Some(&gpu.device), gpu.read_texture(first.caustic())).expect("a device");
    assert!(sums.iter().all(|sum| sum[3] >= 0.0), "loops were cut short");
    let seconds = (0..5).map(|_| frame().1).fold(f64::INFINITY, f64::min);
    (fetches(&sums), seconds)
}

/// The hierarchy on the best adapter: beside bare look-ups; and, on hardware, milliseconds.
fn on_gpu() {
    let gpu = match wait(None, Gpu::open(None)) {
        Ok(gpu) => gpu,
        Err(error) => return println!("on a GPU: not measured: {error}"),
    };
    for name in ["ring-above", "ring-natural"] {
        let edge = if gpu.adapter.software { 256 } else { 1024 };
        let work = Work::new(name, edge);
        let (fetches, seconds) = frame_on_gpu(&gpu, &work, &work.tree(1000, 64, 1));
        let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &work.environment.cube).expect("it fits");
        let bare = BareLoop::new(&gpu, &environment, edge);
        let per_pixel = fetches.round() as u32;
        bare.run(&gpu, per_pixel, [1.5, 3.5]);
        let bare = best(5, &|| bare.run(&gpu, per_pixel, [1.5, 3.5]));
        let millions = fetches * f64::from(edge * edge) / 1e6;
        println!(
            "{name}, {}: {:.0} M look-ups a second, {:.2} of a bare loop's {:.0}",
            gpu.adapter.name,
            millions / seconds,
            bare / seconds,
            millions / bare
        );
    }
    if gpu.adapter.software {
        return;
    }
    for scene in BUILT_IN {
        for size in [[1920, 1080], [3840, 2160]] {
            let work = Work::of_size(scene.name, size);
            for [samples, leaves] in [[625, 16], [1563, 64], [3907, 256]] {
                let (fetches, seconds) = frame_on_gpu(&gpu, &work, &work.tree(samples, leaves, 1));
                let count = samples * leaves;
                println!(
                    "{}, {size:?}, {count} leaves: {:.2} ms, {fetches:.0} look-ups a pixel",
                    scene.name,
                    1e3 * seconds
                );
            }
        }
    }
}

/// The shortest of some times, seconds.
fn best(runs: u32, run: &dyn Fn()) -> f64 {
    let time = |_| {
        let started = Instant::now();
        run();
        started.elapsed().as_secs_f64()
    };
    (0..runs).map(time).fold(f64::INFINITY, f64::min)
}

fn building() {
    let work = Work::new("spoon", 16);
    let options = sampling::Options { samples: 1562, strategy: Strategy::Neighbourhood, seed: 1 };
    let set = sample(&work.surface, &options).expect("a reflector");
    let options = TreeOptions { leaves: 64, seed: 1 };
    let tree = CellTree::new(&work.surface, &set, &options);
    let positions: Vec<[f32; 3]> = tree.leaves().map(|leaf| leaf.centroid().to_array()).collect();
    let within = |k: u32| {
        let (i, j) = (((k % 4) as f32 - 1.5) / 4.0, ((k / 4) as f32 - 2.5) / 6.0);
        let place = move |g: NodeGeometry| g.centroid + i * g.sides[0] + j * g.sides[1];
        tree.leaves().map(move |leaf| place(leaf.geometry()).to_array())
    };
    let many: Vec<[f32; 3]> = (0..24).flat_map(within).collect();
    let build = best(5, &|| drop(CellTree::new(&work.surface, &set, &options)));
    let kiddo = |points: &[[f32; 3]]| drop(kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(points).expect("finite"));
    let (of_leaves, of_points) = (best(5, &|| kiddo(&positions)), best(5, &|| kiddo(&many)));
    println!(
        "a tree of {} leaves: {build:.3} s; {:.1} x a k-d tree of the 24 points that each leaf is made of, {:.0} x one of the leaves",
        positions.len(),
        build / of_points,
        build / of_leaves
    );
}

/// A sheet of a million triangles, in waves that move.
fn waves(time: f32) -> Mesh {
    const N: u32 = 707;
    let place = |k: u32| {
        let [u, v] = [k % (N + 1), k / (N + 1)].map(|k| k as f32 / N as f32);
        Vec3::new(u, 0.1 * (9.0 * u + time).sin() * (7.0 * v).cos(), v)
    };
    let positions: Vec<Vec3> = (0..(N + 1) * (N + 1)).map(place).collect();
    let square = |k: u32| {
        let a = k / N * (N + 1) + k % N;
        [[a, a + N + 1, a + 1], [a + 1, a + N + 1, a + N + 2]]
    };
    let triangles = (0..N * N).flat_map(square).collect();
    let normals = vec![Vec3::Y; positions.len()];
    Mesh::new("waves", positions, normals, triangles).expect("a sheet").0
}

/// A mirror that changes every frame: from its mesh to samples with their cells and curvature.
fn resampling() {
    let options = sampling::Options { samples: 10_000, strategy: Strategy::Neighbourhood, seed: 1 };
    let (mut ours, mut theirs) = (f64::INFINITY, f64::INFINITY);
    for frame in 0..5 {
        let mesh = waves(frame as f32);
        let started = Instant::now();
        let mut surface = Surface::default();
        surface.append(&mesh, 0, false);
        let set = sample(&surface, &options).expect("a reflector");
        let samples = differentials(&set);
        ours = ours.min(started.elapsed().as_secs_f64());
        let positions: Vec<[f32; 3]> = set.candidates.iter().map(|p| p.position.to_array()).collect();
        let started = Instant::now();
        let tree = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&positions).expect("finite");
        theirs = theirs.min(started.elapsed().as_secs_f64());
        drop((tree, samples));
    }
    println!(
        "10,000 samples of a million triangles, two cores: {ours:.3} s, {:.1} x a k-d tree of the candidates",
        ours / theirs
    );
}

fn on_threads(threads: usize, work: impl FnOnce() + Send) {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(work);
}

fn two_cores(name: &'static str) {
    let work = Work::new(name, EDGE);
    let tree = work.tree(1000, 64, 1);
    let mut seconds = [0.0; 2];
    for (threads, seconds) in [1, 2].into_iter().zip(&mut seconds) {
        on_threads(threads, || *seconds = work.hierarchical(&tree, 0.01, 5).1);
    }
    println!("{name}, two cores against one: {:.2} x as fast", seconds[0] / seconds[1]);
}

fn main() {
    // `cargo test --benches` only wants to know whether this compiles and starts.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    // Parts may be asked for by name.
    let wanted = |part: &str| {
        let mut named = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).peekable();
        named.peek().is_none() || named.any(|name| name == part)
    };
    on_threads(1, || {
        if wanted("building") {
            building();
        }
        for name in ["ring-above", "ring-natural"] {
            if wanted("growth") {
                growth(name);
            }
            if wanted("size") {
                size(name);
            }
            if wanted("look-ups") {
                look_ups(name);
            }
        }
        if wanted("error") {
            equal_error("ring-above", 0.05);
            equal_error("ring-natural", 0.01);
        }
    });
    if wanted("gpu") {
        on_gpu();
    }
    if wanted("resampling") {
        on_threads(2, resampling);
    }
    for name in ["ring-above", "ring-natural"] {
        if wanted("cores") {
            two_cores(name);
        }
    }
}
