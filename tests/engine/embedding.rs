//! The engine inside another program: `examples/embed.rs` as it is, checked against the CPU twin on the same G-buffer.

#[expect(dead_code, reason = "the example's main is not called")]
#[path = "../../examples/embed.rs"]
mod embed;

use pinspot::Settings;
use pinspot::low_level::environment::Environment;
use pinspot::low_level::pinhole::{Params, Receivers};
use pinspot::low_level::tracing::Tracer;
use pinspot::scene::load;

use crate::support::{on_cpu, pinholes_of, rel_l2};

#[test]
fn the_example_gathers_what_the_cpu_gathers() {
    let output = embed::render_one_frame().unwrap();
    let [width, height] = embed::SIZE;
    let receivers =
        Receivers { width, height, positions: output.positions, normals: output.normals, ..Receivers::empty(0, 0) };
    let loaded = load::<Settings>(embed::SCENE).unwrap();
    let environment = Environment::new(&loaded.scene.environment.light, Default::default()).unwrap();
    let mut pinholes = pinholes_of(&loaded.scene, embed::SAMPLES, Default::default(), Default::default(), 1);
    pinholes.look_around(&loaded.scene, &Tracer::new(&loaded.scene));
    let expected = on_cpu(&receivers, &pinholes, &environment.cube, &Params::default());
    assert!(expected.iter().any(|e| e[0] > 0.0));
    let error = rel_l2(&output.caustic, &expected);
    assert!(error < 1e-3, "{error}");
}
