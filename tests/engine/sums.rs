//! Sums on the CPU, whole and taken apart.

use std::sync::Arc;

use pinspot::NoProgress;
use pinspot::glam::{Vec3, Vec4};
use pinspot::low_level::cell_tree::{CellTree, TreeOptions};
use pinspot::low_level::differential::differentials;
use pinspot::low_level::environment::{CubeMap, LightBounds};
use pinspot::low_level::pinhole::cpu::{
    self, Accuracy, HardwareFilterError, Light, Lights, cells_taken, contributions_to, gather, gather_hierarchical,
    probe,
};
use pinspot::low_level::pinhole::{Params, PinholeParts, PinholeTree, Pinholes, Receivers, pinholes};
use pinspot::low_level::sampling::{Options, Surface, sample};
use pinspot::low_level::tracing::Tracer;
use pinspot::scene::{Lamp, Sides};
use pinspot::{Filter, Footprint, Strategy};

#[test]
fn contributions_add_up_to_the_sum() {
    let scene = pinspot::load("ring").unwrap().0;
    let options = Options { samples: 300, strategy: Strategy::Neighbourhood, seed: 2 };
    let set = sample(&Surface::of_scene(&scene), &options).unwrap();
    let mut pinholes = pinholes(&scene, &differentials(&set), Footprint::Cells);
    pinholes.trace_visibility(&scene, &Tracer::new(&scene), &NoProgress);
    let cube = CubeMap::from_radiance(64, None, |d| Vec3::new(1.0 + d.x, 1.5 + d.y, 2.0 - d.z));
    let params = Params { filter: Filter::Anisotropic, environment_rotation_rad: 0.4, ..Params::default() };
    let lamp = Lamp {
        name: String::new(),
        position: Vec3::new(0.3, 0.5, 0.1),
        radius: 0.1,
        intensity: Vec3::new(1.0, 2.0, 3.0),
        beam: None,
        is_distant: false,
    };
    let lights = Lights { lamps: std::slice::from_ref(&lamp), ..Lights::environment(&cube) };
    for x in [0.0, 0.5, -1.4] {
        let receiver = (Vec3::new(x, 0.0, 0.2), Vec3::Y, 1);
        let parts = contributions_to(receiver, &pinholes, &lights, &params);
        let receivers = Receivers::from_points(&[receiver], 1);
        let of_environment = cpu::gather(&receivers, &pinholes, &cube, &params, &NoProgress).unwrap()[0];
        let of_lamp = Vec4::from(cpu::gather_lamp(&receivers, &pinholes, &lamp, &params, &NoProgress)[0]).truncate();
        assert!(x < -1.0 || of_lamp.min_element() > 0.0, "{of_lamp}");
        let whole = Vec4::from(of_environment).truncate() + of_lamp;
        let sum: Vec3 = parts.iter().map(|part| part.irradiance).sum();
        assert!(sum.abs_diff_eq(whole, 1e-4 * (1.0 + sum.x)), "{sum} {whole}");
        assert!(parts.iter().all(|part| part.direction.is_normalized() && part.irradiance.min_element() >= 0.0));
    }
}

#[test]
fn cells_add_up_to_the_sum() {
    let scene = pinspot::load("ring").unwrap().0;
    let surface = Surface::of_scene(&scene);
    let set = sample(&surface, &Options { samples: 300, strategy: Strategy::Neighbourhood, seed: 2 }).unwrap();
    let tree = CellTree::new(&surface, &set, &TreeOptions { leaves: 16, seed: 1 });
    let mut pinholes = PinholeTree::new(&scene, tree);
    let tracer = Arc::new(Tracer::new(&scene));
    pinholes.trace_visibility_and_doubts(&scene, tracer, &NoProgress);
    let cube = CubeMap::from_radiance(64, None, |d| Vec3::new(1.0 + d.x, 1.5 + d.y, 2.0 - d.z));
    let bounds = LightBounds::new(&cube);
    let light = Light::Environment { cube: &cube, bounds: &bounds };
    let params = Params::default();
    let counts = [1e-4, 1e-2].map(|error| {
        let receiver = (Vec3::new(0.4, 0.0, 0.2), Vec3::Y, 1);
        let accuracy = Accuracy { error, split_near: true };
        let cells = cells_taken(receiver, &pinholes, light, &params, accuracy);
        let receivers = Receivers::from_points(&[receiver], 1);
        let sums = gather_hierarchical(&receivers, &pinholes, light, &params, accuracy, &NoProgress);
        let sum: Vec3 = cells.iter().map(|cell| cell.irradiance).sum();
        assert!(sum.abs_diff_eq(Vec4::from(sums[0]).truncate(), 2.0 * error + 1e-5), "{sum} {:?}", sums[0]);
        cells.len()
    });
    assert!(counts[0] > counts[1] && counts[1] > 10, "{counts:?}");
}

#[test]
fn parameters_out_of_range_do_not_panic() {
    let cube = CubeMap::from_radiance(16, None, |d| Vec3::new(1.0 + d.x, 1.0, 1.0 + d.z));
    let sample = PinholeParts {
        position: Vec3::Y,
        normal: Vec3::NEG_Y,
        area: 0.5,
        sides: [Vec3::X, 0.1 * Vec3::Z],
        changes: [Vec3::ZERO; 2],
        reflectance: Vec3::ONE,
        curve: None,
        lobe: 0.0,
        object: 1,
        lights: Sides::Front,
        interface: None,
    };
    let pinholes = Pinholes::from(vec![sample.into()]);
    let receivers = Receivers::from_points(&[(Vec3::ZERO, Vec3::Y, 0)], 1);
    let sums = |params: Params| gather(&receivers, &pinholes, &cube, &params, &NoProgress);
    assert_eq!(sums(Params { filter: Filter::Hardware, ..Params::default() }), Err(HardwareFilterError));
    let one_tap = sums(Params { taps: 1, ..Params::default() }).unwrap();
    assert!(one_tap[0][0] > 0.1, "{one_tap:?}");
    assert_eq!(sums(Params { taps: 0, ..Params::default() }).unwrap(), one_tap);
    assert!(probe(&cube, Filter::Hardware, 0, &[]).is_err());
}
