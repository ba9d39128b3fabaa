//! An environment rotated at look-up against a cube map into which the rotation was baked.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat3, Vec3};
use pinspot::Settings;
use pinspot::low_level::cell_tree::{CellTree, TreeOptions};
use pinspot::low_level::environment::{CubeMap, LightBounds};
use pinspot::low_level::pinhole::cpu::{self, Accuracy, Light, estimate_irradiance, gather_hierarchical};
use pinspot::low_level::pinhole::{Filter, Footprint, Params, PinholeTree, Pinholes, Receivers, pinholes};
use pinspot::low_level::sampling::{self, Strategy, Surface, sample};
use pinspot::low_level::tracing::Tracer;
use pinspot::low_level::visible_receivers;
use pinspot::scene::{Scene, load};

use crate::support::{on_cpu, rel_l2};

/// A cube map as it is, and with a rotation baked into it.
struct Cubes {
    angle: f32,
    still: CubeMap,
    rotated: CubeMap,
}

impl Cubes {
    fn new(angle: f32, radiance: fn(Vec3) -> Vec3) -> Self {
        let light_from_world = Mat3::from_rotation_y(-angle);
        let still = CubeMap::from_radiance(128, None, radiance);
        let rotated = CubeMap::from_radiance(128, None, move |d| radiance(light_from_world * d));
        Self { angle, still, rotated }
    }

    /// A quarter turn maps texels onto texels, so any light can be compared. At other angles the texels differ, so the light
    /// has to be smooth.
    fn both() -> [Self; 2] {
        let spots = |d: Vec3| {
            let spot = |axis: Vec3| (60.0 * (d.dot(axis.normalize()) - 1.0)).exp();
            Vec3::new(0.1, 0.2, 0.3) + 20.0 * spot(Vec3::new(1.0, 0.8, 0.3)) + 9.0 * spot(Vec3::new(-0.3, 0.5, 1.0))
        };
        let smooth = |d: Vec3| Vec3::new(1.0 + d.x, 1.1 + d.z, 1.5 + d.x * d.z + 0.4 * d.y);
        [Self::new(FRAC_PI_2, spots), Self::new(0.7, smooth)]
    }

    fn params(&self, filter: Filter) -> [Params; 2] {
        let params = Params { filter, ..Params::default() };
        [Params { environment_rotation_rad: self.angle, ..params }, params]
    }

    /// The texels of coarse mips map onto each other at quarter turns only.
    fn tolerance(&self) -> f64 {
        if self.angle == FRAC_PI_2 { 1e-3 } else { 0.012 }
    }

    /// Rotating at look-up gives the same sums as baking the rotation, and other sums than no rotation.
    fn assert_alike(&self, what: &str, filter: Filter, gather: impl Fn(&CubeMap, &Params) -> Vec<[f32; 4]>) {
        let [rotated, still] = self.params(filter);
        let (at_look_up, baked) = (gather(&self.still, &rotated), gather(&self.rotated, &still));
        let difference = rel_l2(&at_look_up, &baked);
        assert!(difference < self.tolerance(), "{what}, {filter:?}, {}: {difference}", self.angle);
        let without = rel_l2(&gather(&self.still, &still), &baked);
        println!("{what}, {filter:?}, {}: {difference:.5}, without rotation {without:.3}", self.angle);
        assert!(without > 10.0 * self.tolerance(), "{what}: the rotation makes no difference");
    }
}

struct Work {
    scene: Scene,
    tracer: Tracer,
    receivers: Receivers,
}

impl Work {
    fn new() -> Self {
        let scene = load::<Settings>("columns").unwrap().scene;
        let tracer = Tracer::new(&scene);
        let receivers = visible_receivers(&scene, &tracer, [16; 2]);
        Self { scene, tracer, receivers }
    }

    fn samples(&self, has_visibility: bool) -> Pinholes {
        let set = self.sample_set(3000);
        let mut samples =
            pinholes(&self.scene, &pinspot::low_level::differential::differentials(&set), Footprint::Cells);
        if has_visibility {
            samples.trace_visibility(&self.scene, &self.tracer, &pinspot::NoProgress);
        }
        samples
    }

    fn tree(&self, has_visibility: bool) -> PinholeTree {
        let surface = Surface::of_scene(&self.scene);
        let cells = CellTree::new(&surface, &self.sample_set(200), &TreeOptions { leaves: 16, seed: 1 });
        let mut tree = PinholeTree::new(&self.scene, cells);
        if has_visibility {
            tree.trace_visibility(&self.scene, &self.tracer, &pinspot::NoProgress);
        }
        tree
    }

    fn sample_set(&self, samples: u32) -> sampling::PointSet {
        let options = sampling::Options { samples, strategy: Strategy::Neighbourhood, seed: 1 };
        sample(&Surface::of_scene(&self.scene), &options).unwrap()
    }
}

#[test]
fn flat_sums_rotate_the_environment() {
    flat_sums_rotate(true, &[Filter::Anisotropic, Filter::Ewa]);
    flat_sums_rotate(false, &[Filter::None]);
}

#[test]
#[ignore = "full: the other filters, with and without visibility"]
fn flat_sums_rotate_the_environment_with_all_filters() {
    flat_sums_rotate(true, &[Filter::None, Filter::Isotropic]);
    flat_sums_rotate(false, &[Filter::Isotropic, Filter::Anisotropic, Filter::Ewa]);
}

fn flat_sums_rotate(has_visibility: bool, filters: &[Filter]) {
    let work = Work::new();
    let samples = work.samples(has_visibility);
    for cubes in Cubes::both() {
        for &filter in filters {
            let what = format!("flat, visibility {has_visibility}");
            cubes.assert_alike(&what, filter, |cube, params| on_cpu(&work.receivers, &samples, cube, params));
        }
    }
}

#[test]
fn hierarchical_sums_rotate_the_environment() {
    let work = Work::new();
    for has_visibility in [false, true] {
        let tree = work.tree(has_visibility);
        for cubes in Cubes::both() {
            let gather = |cube: &CubeMap, params: &Params| {
                let bounds = LightBounds::new(cube);
                let light = Light::Environment { cube, bounds: &bounds };
                let error = 0.002 * estimate_irradiance(&work.receivers, &tree, light, params);
                let accuracy = Accuracy { error, split_near: true };
                gather_hierarchical(&work.receivers, &tree, light, params, accuracy, &pinspot::NoProgress)
            };
            cubes.assert_alike(&format!("tree, visibility {has_visibility}"), Filter::Anisotropic, gather);
        }
    }
}

#[test]
fn contributions_and_estimates_rotate_the_environment() {
    let work = Work::new();
    let (samples, tree) = (work.samples(false), work.tree(false));
    for cubes in Cubes::both() {
        let [rotated, still] = cubes.params(Filter::Isotropic);
        let of = |cube, params| cpu::contributions(&work.receivers, &samples, &cpu::Lights::environment(cube), params);
        let in_one = |values: Vec<f32>| values.into_iter().map(|v| [v, 0.0, 0.0, 0.0]).collect::<Vec<_>>();
        let (at_look_up, baked) = (in_one(of(&cubes.still, &rotated)), in_one(of(&cubes.rotated, &still)));
        let difference = rel_l2(&at_look_up, &baked);
        let without = rel_l2(&in_one(of(&cubes.still, &still)), &baked);
        let tolerance = if cubes.angle == FRAC_PI_2 { 1e-3 } else { 0.05 };
        assert!(difference < tolerance && without > 1.5 * tolerance, "{}: {difference} {without}", cubes.angle);

        let typical = |cube, params| {
            let bounds = LightBounds::new(cube);
            estimate_irradiance(&work.receivers, &tree, Light::Environment { cube, bounds: &bounds }, params)
        };
        let (at_look_up, baked) = (typical(&cubes.still, &rotated), typical(&cubes.rotated, &still));
        assert!((at_look_up / baked - 1.0).abs() < cubes.tolerance() as f32, "{at_look_up} {baked}");
    }
}
