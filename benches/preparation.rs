//! What preparing a light and a tree of cells costs, beside fixed yardsticks in the same run: `cargo bench --bench preparation`.
//!
//! Machines and loads differ; the ratios to the yardsticks are what to compare between two commits.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use kiddo::ImmutableKdTree;
use pinspot::Settings;
use pinspot::low_level::cell_tree::{CellTree, TreeOptions};
use pinspot::low_level::environment::{CubeMap, EnvironmentRadiance, LightBounds, LightSampler, irradiance_map};
use pinspot::low_level::sampling::{Options, Strategy, Surface, sample};
use pinspot::scene::{Light, load};

/// From a map of 1024×512 pixels that is in memory to all that gathers read of it, at 256² texels a face; beside a copy of 64 MB.
fn light(c: &mut Criterion) {
    let light = Light::BuiltInMap("clear-sky".into());
    let radiance = EnvironmentRadiance::new(&light).expect("a built-in map");
    let mut group = c.benchmark_group("light");
    group.bench_function("cube, irradiance, bounds, sampler", |b| {
        b.iter(|| {
            let cube = CubeMap::from_radiance_of_rows(256, radiance.detail_rad(), |row| radiance.radiance_of_all(row));
            black_box((irradiance_map(&cube), LightBounds::new(&cube), LightSampler::new(&cube)));
        });
    });
    let (from, mut to) = (vec![1.0f32; 1 << 24], vec![0.0f32; 1 << 24]);
    group.bench_function("yardstick: copying 64 MB", |b| {
        b.iter(|| black_box(&mut to).copy_from_slice(black_box(&from)));
    });
    group.finish();
}

/// 3,000 samples of `ring-natural`'s mirror, split into 64 leaves each; beside k-d trees of 24 points for each leaf.
fn tree(c: &mut Criterion) {
    let scene = load::<Settings>("ring-natural").expect("a built-in scene").scene;
    let surface = Surface::of_scene(&scene);
    let options = |samples| Options { samples, strategy: Strategy::Neighbourhood, seed: 1 };
    let set = sample(&surface, &options(3000)).expect("a reflector");
    let mut group = c.benchmark_group("tree");
    group.bench_function("3,000 samples of 64 leaves", |b| {
        b.iter(|| black_box(CellTree::new(&surface, &set, &TreeOptions { leaves: 64, seed: 1 })));
    });
    let random = Options { strategy: Strategy::Random, ..options(24 * 64 * 3000 / 40) };
    let many = sample(&surface, &random).expect("a reflector");
    let positions: Vec<[f32; 3]> = many.candidates.iter().map(|p| p.position.to_array()).collect();
    group.bench_function(format!("yardstick: a k-d tree of {} points", positions.len()), |b| {
        b.iter(|| black_box(ImmutableKdTree::<f32, 3>::new_from_slice(&positions).expect("finite")));
    });
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(Duration::from_secs(5));
    targets = light, tree
}
criterion_main!(benches);
