//! Statistics of the strategies.

use glam::Vec3;
use pinspot::low_level::sampling::{Options, PointSet, Strategy, Surface, quality, sample};
use pinspot::scene::shapes::{Cup, DiscoBall, Ring, Shape, Sphere, Spoon};

fn surface(shape: Shape) -> Surface {
    let mut surface = Surface::default();
    surface.append(&shape.mesh().unwrap(), 0, false);
    surface
}

fn points(shape: Shape, samples: u32, strategy: Strategy, seed: u64) -> (Surface, PointSet) {
    let surface = surface(shape);
    let set = sample(&surface, &Options { samples, strategy, seed }).unwrap();
    (surface, set)
}

/// χ² of the counts in bins of equal area: by Archimedes, slices of a sphere of equal height; halved by azimuth.
fn chi_squared(set: &PointSet) -> f64 {
    const BINS: usize = 40;
    let mut counts = [0.0; BINS];
    for p in &set.points {
        let slice = ((0.5 * (p.position.y.clamp(-1.0, 0.999_999) + 1.0)) * 20.0) as usize;
        counts[2 * slice + usize::from(p.position.x > 0.0)] += 1.0;
    }
    let expected = set.points.len() as f64 / BINS as f64;
    counts.iter().map(|c| (c - expected).powi(2) / expected).sum()
}

#[test]
fn strategies_are_area_uniform() {
    let sphere = Shape::Sphere(Sphere::of_radius(1.0));
    // 39 degrees of freedom: mean 39, deviation 8.8; independent points have to vary, but not much more than that.
    let random: Vec<f64> = (1..=8).map(|seed| chi_squared(&points(sphere, 4000, Strategy::Random, seed).1)).collect();
    let mean = random.iter().sum::<f64>() / 8.0;
    assert!(mean > 39.0 - 4.0 * 8.8 / 8f64.sqrt() && mean < 39.0 + 4.0 * 8.8 / 8f64.sqrt(), "{random:?}");
    // Stratified ones vary far less.
    for seed in 1..=3 {
        let chi = chi_squared(&points(sphere, 4000, Strategy::Neighbourhood, seed).1);
        assert!(chi < 15.0, "{chi}");
    }
}

#[test]
fn triangles_of_very_unequal_size_are_sampled_by_area() {
    // The rim of a spoon has triangles a hundred times smaller than its bowl.
    let (surface, set) = points(Shape::Spoon(Spoon::default()), 3000, Strategy::Random, 1);
    let in_half = |p: &Vec3| p.x > 0.0;
    let share = set.points.iter().filter(|p| in_half(&p.position)).count() as f64 / 3000.0;
    let area = set.candidates.iter().filter(|p| in_half(&p.position)).map(|p| f64::from(p.area)).sum::<f64>();
    let expected = area / surface.area();
    // Four deviations of a binomial share.
    assert!((share - expected).abs() < 4.0 * (expected * (1.0 - expected) / 3000.0).sqrt(), "{share} {expected}");
}

#[test]
fn neighbourhood_meets_the_number_asked_for() {
    for shape in [
        Shape::Ring(Ring::default()),
        Shape::Spoon(Spoon::default()),
        Shape::Cup(Cup::default()),
        Shape::DiscoBall(DiscoBall { radius: 0.5, rows: 20, joint: 0.0 }),
    ] {
        for samples in [50, 100, 317, 1000, 10_000] {
            let (_, set) = points(shape, samples, Strategy::Neighbourhood, 1);
            let miss = set.points.len().abs_diff(samples as usize);
            assert!(miss * 50 <= samples as usize, "{}: {} for {samples}", shape.name(), set.points.len());
        }
    }
}

#[test]
fn neighbourhood_keeps_its_distance() {
    for seed in 1..=3 {
        let (surface, set) = points(Shape::Sphere(Sphere::of_radius(1.0)), 1000, Strategy::Neighbourhood, seed);
        let even = quality(&set, surface.area());
        // Maximal Poisson-disk sets reach 0.65 to 0.8 of the densest packing.
        assert!(even.relative_radius > 0.65 && even.relative_radius < 0.85, "{even:?}");
        let (surface, set) = points(Shape::Sphere(Sphere::of_radius(1.0)), 1000, Strategy::Random, seed);
        assert!(quality(&set, surface.area()).relative_radius < 0.2);
    }
}

#[test]
fn grids_come_close_to_the_number_asked_for() {
    for strategy in [Strategy::Grid, Strategy::QuantisedGrid] {
        for samples in [300, 3000] {
            let (_, set) = points(Shape::Cup(Cup::default()), samples, strategy, 1);
            let miss = set.points.len().abs_diff(samples as usize);
            assert!(miss * 20 <= samples as usize, "{strategy:?}: {} for {samples}", set.points.len());
        }
    }
}

#[test]
fn the_seed_decides_everything() {
    for strategy in [Strategy::Random, Strategy::Grid, Strategy::QuantisedGrid, Strategy::Neighbourhood] {
        let run = |seed| points(Shape::Cup(Cup::default()), 200, strategy, seed).1.points;
        assert_eq!(run(5), run(5));
        assert_ne!(run(5), run(6));
    }
}
