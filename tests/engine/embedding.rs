//! The engine inside another program: `examples/embed.rs` as it is, checked against the CPU on the same G-buffers.

#[expect(dead_code, reason = "the example's main is not called")]
#[path = "../../examples/embed.rs"]
mod embed;

use pinspot::low_level::environment::{Environment, LightBounds};
use pinspot::low_level::pinhole::cpu::{Accuracy, Light, estimate_irradiance, gather_hierarchical};
use pinspot::low_level::pinhole::{Params, Receivers};

use crate::support::rel_l2;

#[test]
fn the_example_gathers_what_the_cpu_gathers() {
    assert_gathers_what_the_cpu_gathers(&embed::render_frames(1).unwrap());
}

#[test]
#[ignore = "full: all frames of the example on a software adapter"]
fn the_example_gathers_what_the_cpu_gathers_while_its_mirror_moves() {
    let outputs = embed::render_frames(embed::FRAMES).unwrap();
    assert_gathers_what_the_cpu_gathers(&outputs);
    for pair in outputs.windows(2) {
        assert!(rel_l2(&pair[1].caustic, &pair[0].caustic) > 0.1, "nothing has moved");
    }
}

fn assert_gathers_what_the_cpu_gathers(outputs: &[embed::Output]) {
    let [width, height] = embed::SIZE;
    let environment = Environment::new(&embed::scene_at(0).unwrap().environment.light, Default::default()).unwrap();
    let bounds = LightBounds::new(&environment.cube);
    let light = Light::Environment { cube: &environment.cube, bounds: &bounds };
    let params = Params::default();
    for (number, output) in (0..).zip(outputs) {
        let (positions, normals) = (output.positions.clone(), output.normals.clone());
        let receivers = Receivers { width, height, positions, normals, ..Receivers::empty(0, 0) };
        let tree = embed::cells_of(&embed::scene_at(number).unwrap()).unwrap();
        let error = embed::TOLERANCE * estimate_irradiance(&receivers, &tree, light, &params);
        let expected = gather_hierarchical(
            &receivers,
            &tree,
            light,
            &params,
            Accuracy { error, split_near: true },
            &pinspot::NoProgress,
        );
        assert!(expected.iter().any(|e| e[0] > 0.0));
        let error = rel_l2(&output.caustic, &expected);
        println!("frame {number}: {error:.1e}");
        assert!(error < f64::from(embed::TOLERANCE), "frame {number}: {error}");
    }
}
