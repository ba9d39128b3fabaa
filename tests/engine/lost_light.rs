//! Light that sums leave out is warned of, with its share.

use pinspot::scene::Scene;
use pinspot::{BackendChoice, Options};

use crate::support::{above_floor, render, transmittance};

/// What a small picture warns of.
fn warnings(scene: Scene) -> Vec<String> {
    let options = Options::default().with_size([8, 8]).with_samples(100);
    render(scene, options, &BackendChoice::Cpu).unwrap().report.warnings
}

/// From straight above, unless said otherwise.
fn in_the_sun(objects: &str) -> Scene {
    let sun = "[[light]]\ndirectional = { direction = [0, 1, 0], irradiance = [9, 9, 9] }\n";
    above_floor("constant = [0, 0, 0]", &format!("{sun}{objects}"))
}

fn share(warning: &str) -> f32 {
    warning.split(" %").next().unwrap().parse::<f32>().unwrap()
}

/// A roof of two mirrors that meet at a right angle, open above: all light meets both.
#[test]
fn a_second_reflection_is_warned_of() {
    let side = |turn: i32, x: f32| {
        format!(
            "[[object]]\nshape = {{ plane = {{ size = [1, 1] }} }}\nrotate_deg = [0, 0, {turn}]\ntranslate = [{x}, 1, 0]\nreflector = {{}}\n"
        )
    };
    let both = format!("{}{}", side(-45, -0.354), side(45, 0.354));
    let found = warnings(in_the_sun(&both));
    assert!(found.len() == 1 && found[0].contains("meets another mirror"), "{found:?}");
    assert!(share(&found[0]) > 95.0, "{found:?}");
    assert_eq!(warnings(in_the_sun(&side(-45, -0.354))), [""; 0]);
}

/// Of a pane all is said that enters it.
#[test]
fn light_through_solids_is_warned_of() {
    let pane = "[[object]]\nname = \"pane\"\nshape = { box = { size = [1, 0.006, 1] } }\ntranslate = [0, 0.5, 0]\n\
                refractor = { eta = 1.52, interfaces = 2 }\n";
    let found = warnings(in_the_sun(pane));
    assert!(found.len() == 1 && found[0].contains("'pane'") && found[0].contains("image-space"), "{found:?}");
    let expected = 100.0 * transmittance(1.0, 1.52) as f32;
    assert!((share(&found[0]) - expected).abs() < 1.5, "{found:?}, not {expected}");
    let water =
        "[[object]]\nshape = { plane = { size = [1, 1] } }\ntranslate = [0, 0.5, 0]\nrefractor = { eta = 1.333 }\n";
    assert_eq!(warnings(in_the_sun(water)), [""; 0]);
}
