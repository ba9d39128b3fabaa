//! Speed, as ratios within one run: `cargo bench --bench engine`.
//!
//! The gather is measured in look-ups per second (criterion's "elements") per filter on both back ends, beside a bare loop
//! that does nothing but the same number of texture look-ups at the same levels. The ratio of the two rates says what the
//! rest of the gather costs. So are the gather with and without shadows. Sampling and differentials are measured beside one build of a k-d tree over their candidates.

mod bare_cpu;
mod bare_gpu;

use std::hint::black_box;
use std::time::Duration;

use bare_cpu::bare_cpu_loop;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main, measurement::WallTime};
use glam::Vec3;
use pinspot::Settings;
use pinspot::blocking::wait;
use pinspot::low_level::differential::differentials;
use pinspot::low_level::environment::Environment;
use pinspot::low_level::gpu::Gpu;
use pinspot::low_level::pinhole::cpu::gather;
use pinspot::low_level::pinhole::gpu::{Engine, EnvironmentCube, FrameInputs, FrameLight, GatherOptions};
use pinspot::low_level::pinhole::{Filter, Footprint, Params, Pinholes, Receivers, pinholes};
use pinspot::low_level::sampling::{self, Strategy, Surface, sample};
use pinspot::low_level::tracing::Tracer;
use pinspot::scene::load;

const EDGE: u32 = 128;
const SAMPLES: u32 = 1000;
const FILTERS: [(Filter, &str); 3] =
    [(Filter::None, "none"), (Filter::Isotropic, "isotropic"), (Filter::Anisotropic, "anisotropic")];

/// `ring-natural`'s gather on the table inside the ring: every sample reaches every receiver, so none is culled.
struct Work {
    receivers: Receivers,
    pinholes: Pinholes,
    environment: Environment,
}

impl Work {
    fn new() -> Self {
        let scene = load::<Settings>("ring-natural").expect("built-in").scene;
        let options = sampling::Options { samples: SAMPLES, strategy: Strategy::Neighbourhood, seed: 1 };
        let set = sample(&Surface::of_scene(&scene), &options).expect("a reflector");
        let pinholes = pinholes(&scene, &differentials(&set), Footprint::Cells);
        let environment = Environment::new(&scene.environment.light, Default::default()).expect("built-in");
        let place = |k: u32| {
            let at = |i: u32| 1.2 * ((i as f32 + 0.5) / EDGE as f32 - 0.5);
            (Vec3::new(at(k % EDGE), 0.0, at(k / EDGE)), Vec3::Y, 1)
        };
        let points: Vec<_> = (0..EDGE * EDGE).map(place).collect();
        Self { receivers: Receivers::from_points(&points, EDGE), pinholes, environment }
    }

    /// Fetches of one gather.
    fn fetches(&self, params: &Params) -> u64 {
        let sums =
            gather(&self.receivers, &self.pinholes, &self.environment.cube, params, &pinspot::NoProgress).unwrap();
        sums.iter().map(|s| f64::from(s[3])).sum::<f64>() as u64
    }

    /// The levels between which a filter reads; a bare loop reads there.
    fn typical_levels(filter: Filter) -> [f32; 2] {
        if filter == Filter::None { [0.0, 0.0] } else { [1.5, 3.5] }
    }
}

fn settings(group: &mut BenchmarkGroup<WallTime>) {
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(5));
}

fn gather_on_cpu(c: &mut Criterion) {
    let work = Work::new();
    let mut group = c.benchmark_group("gather, CPU");
    settings(&mut group);
    for (filter, name) in FILTERS {
        let params = Params { filter, ..Default::default() };
        let fetches = work.fetches(&params);
        group.throughput(Throughput::Elements(fetches));
        group.bench_function(name, |b| {
            b.iter(|| {
                black_box(gather(
                    &work.receivers,
                    &work.pinholes,
                    &work.environment.cube,
                    &params,
                    &pinspot::NoProgress,
                ))
            });
        });
        group.bench_function(format!("{name}, bare look-ups"), |b| {
            let groups = u64::from(EDGE * EDGE / 16);
            let cube = &work.environment.cube;
            b.iter(|| black_box(bare_cpu_loop(cube, Work::typical_levels(filter), groups, fetches / 16 / groups)));
        });
    }
}

/// One image, from the upload of its inputs until the device is done.
fn run_frame(gpu: &Gpu, engine: &Engine, inputs: &FrameInputs) {
    let mut frame = engine.frame(&gpu.device, inputs).expect("it fits");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    frame.record(&mut encoder, 0..frame.batch_count());
    gpu.queue.submit([encoder.finish()]);
    wait(Some(&gpu.device), gpu.submitted_work_done()).expect("the device stays");
}

fn gather_on_gpu(c: &mut Criterion) {
    let gpu =
        wait(None, Gpu::open(None)).expect("an adapter; on Debian: apt-get install libvulkan1 mesa-vulkan-drivers");
    let work = Work::new();
    let size = [EDGE, EDGE];
    let positions = gpu.upload_texture(size, &work.receivers.positions);
    let normals = gpu.upload_texture(size, &work.receivers.normals);
    let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &work.environment.cube).expect("it fits");
    let mut group = c.benchmark_group(format!("gather, {}", gpu.adapter.name));
    settings(&mut group);
    for (filter, name) in FILTERS {
        let params = Params { filter, ..Default::default() };
        let engine = Engine::new(&gpu.device, &GatherOptions { filter, ..Default::default() });
        let fetches = work.fetches(&params);
        group.throughput(Throughput::Elements(fetches));
        let inputs = FrameInputs {
            positions: &positions,
            normals: &normals,
            viewers: None,
            size,
            pinholes: &work.pinholes,
            maps: None,
            light: FrameLight::Environment(&environment),
            params,
        };
        group.bench_function(name, |b| b.iter(|| run_frame(&gpu, &engine, &inputs)));
        let bare = bare_gpu::BareLoop::new(&gpu, &environment, EDGE);
        let per_pixel = (fetches / u64::from(EDGE * EDGE)) as u32;
        group.bench_function(format!("{name}, bare look-ups"), |b| {
            b.iter(|| bare.run(&gpu, per_pixel, Work::typical_levels(filter)));
        });
    }
}

fn sampling_and_differentials(c: &mut Criterion) {
    let scene = load::<Settings>("spoon").expect("built-in").scene;
    let surface = Surface::of_scene(&scene);
    let mut group = c.benchmark_group("sampling");
    settings(&mut group);
    for samples in [1000, 10_000] {
        let options = sampling::Options { samples, strategy: Strategy::Neighbourhood, seed: 1 };
        let set = sample(&surface, &options).expect("a reflector");
        group.throughput(Throughput::Elements(u64::from(samples)));
        group.bench_function(format!("neighbourhood, {samples}"), |b| b.iter(|| black_box(sample(&surface, &options))));
        group.bench_function(format!("cells and curvature, {samples}"), |b| b.iter(|| black_box(differentials(&set))));
        let positions: Vec<[f32; 3]> = set.candidates.iter().map(|p| p.position.to_array()).collect();
        group.bench_function(format!("one k-d tree over the candidates of {samples}"), |b| {
            b.iter(|| black_box(kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&positions).expect("finite")));
        });
    }
}

/// What shadows cost: the same gather with and without, and letting the samples look around.
fn visibility(c: &mut Criterion) {
    let gpu =
        wait(None, Gpu::open(None)).expect("an adapter; on Debian: apt-get install libvulkan1 mesa-vulkan-drivers");
    let mut work = Work::new();
    let scene = load::<Settings>("ring-natural").expect("built-in").scene;
    let tracer = Tracer::new(&scene);
    let size = [EDGE, EDGE];
    let positions = gpu.upload_texture(size, &work.receivers.positions);
    let normals = gpu.upload_texture(size, &work.receivers.normals);
    let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &work.environment.cube).expect("it fits");
    let params = Params::default();
    let mut group = c.benchmark_group("visibility");
    settings(&mut group);
    for name in ["unshadowed", "shadowed"] {
        let visibility = name == "shadowed";
        if visibility {
            work.pinholes.trace_visibility(&scene, &tracer, &pinspot::NoProgress);
        }
        group.bench_function(format!("CPU, {name}"), |b| {
            b.iter(|| {
                black_box(gather(
                    &work.receivers,
                    &work.pinholes,
                    &work.environment.cube,
                    &params,
                    &pinspot::NoProgress,
                ))
            });
        });
        let engine = Engine::new(&gpu.device, &GatherOptions { visibility, ..Default::default() });
        let inputs = FrameInputs {
            positions: &positions,
            normals: &normals,
            viewers: None,
            size,
            pinholes: &work.pinholes,
            maps: None,
            light: FrameLight::Environment(&environment),
            params,
        };
        group.bench_function(format!("{}, {name}", gpu.adapter.name), |b| {
            b.iter(|| run_frame(&gpu, &engine, &inputs));
        });
    }
    group.bench_function(format!("looking around, {SAMPLES} samples"), |b| {
        b.iter(|| work.pinholes.trace_visibility(&scene, &tracer, &pinspot::NoProgress));
    });
}

criterion_group!(benches, gather_on_cpu, gather_on_gpu, visibility, sampling_and_differentials);
criterion_main!(benches);
