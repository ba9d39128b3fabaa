//! The ground truth by beams against closed forms, and against the one by points.

use std::f64::consts::TAU;

use glam::Vec3;
use pinspot::image::{Image, rel_l2};
use pinspot::reference::{Estimate, Estimator, Options, Reference, StoppingCriterion};
use pinspot::scene::{Chain, Scene, load};
use pinspot::{NoProgress, Settings};

use crate::support::above_floor as scene;

fn solve(scene: Scene, size: u32, change: impl FnOnce(&mut Options)) -> Estimate {
    let mut options = Options { size: [size; 2], estimator: Estimator::Beams, ..Default::default() };
    change(&mut options);
    let reference = Reference::new(scene, options).unwrap();
    reference.solve(&StoppingCriterion::new(0.01), None, &NoProgress, &mut |_| Ok(())).unwrap()
}

/// A plane mirror and a lamp: E = I cosθ′ / d′² of the virtual lamp, here as the mean over each pixel.
#[test]
fn a_plane_mirror_shows_a_virtual_lamp() {
    let lamp = "[[light]]\nposition = [0, 3, 0]\nintensity = [9, 18, 27]\n";
    let mirror = "[[object]]\nshape = { plane = { size = [6, 6] } }\nrotate_deg = [0, 0, -90]\ntranslate = [-1.5, 3, 0]\nreflector = {}\n";
    let found = solve(scene("constant = [0, 0, 0]", &format!("{lamp}{mirror}")), 32, |_| ());
    let at = |k: u32| 2.0 * (f64::from(k) + 0.5) / 32.0 - 1.0;
    let pixels = (0..32 * 32).map(|k| {
        let (x, z) = (at(k % 32), at(k / 32));
        let squared = (x + 3.0).powi(2) + z * z + 9.0;
        Vec3::new(9.0, 18.0, 27.0) * (3.0 / squared.powf(1.5)) as f32
    });
    let expected = Image { width: 32, height: 32, pixels: pixels.collect() };
    let error = rel_l2(&found.irradiance, &expected, None);
    println!("{error:.2e}, by its own account {:.2e}", found.rel_error());
    assert!(error < 1e-3 && found.rel_error() < 5e-3, "{error}");
}

/// A ball with the index of air: light passes it as if it were not there, so that its shadow is lit as the floor would be.
#[test]
fn a_ball_of_air_in_the_sun() {
    let sun = "spot = { direction = [0.6, 0.8, 0.0], sigma_rad = 0.0001, radiance = [1e7, 1e7, 1e7] }";
    let ball = "[[object]]\nshape = { sphere = { radius = 1 } }\ntranslate = [0, 1, 0]\n\
                refractor = { eta = 1.0, interfaces = 2, fresnel = false }\ncamera_visible = false\n";
    let found = solve(scene(sun, ball), 64, |options| options.chains = Chain::TT.into());
    let irradiance = TAU * 1e-8 * 1e7 * 0.8;
    let lit: Vec<f64> = found.irradiance.pixels.iter().map(|pixel| f64::from(pixel.x)).filter(|e| *e > 0.0).collect();
    let inside = lit.iter().filter(|e| (**e / irradiance - 1.0).abs() < 1e-3).count();
    println!("{} of {} pixels, error {:.2e}", inside, lit.len(), found.rel_error());
    assert!(inside as f64 > 0.9 * lit.len() as f64 && inside > 1000, "{inside} of {}", lit.len());
}

/// Both estimators have the same answer where both can be asked: the ring in a small sun.
#[test]
#[ignore = "full: ground truths of many pixels"]
fn beams_and_points_agree() {
    let ring = load::<Settings>("ring").unwrap().scene;
    let by_beams = solve(ring.clone(), 64, |options| options.replicates = 64);
    let options = Options { size: [64; 2], pixel_samples: 4, ..Default::default() };
    let by_points = Reference::new(ring, options).unwrap();
    let by_points = by_points.solve(&StoppingCriterion::new(0.005), None, &NoProgress, &mut |_| Ok(())).unwrap();
    let error = rel_l2(&by_beams.irradiance, &by_points.irradiance, None);
    let (a, b) = (by_beams.irradiance.mean().x, by_points.irradiance.mean().x);
    println!("{error:.4}, mean {a} and {b}, by its own account {:.4}", by_beams.rel_error());
    assert!(error < 0.02 && (a / b - 1.0).abs() < 0.005, "{error}, {a} and {b}");
}

/// What beams do not know is refused.
#[test]
fn lights_that_are_no_spots_are_refused() {
    for (name, reason) in [("ring-natural", "spot"), ("candle", "spot"), ("dance-floor", "beams"), ("gloss", "beams")] {
        let scene = load::<Settings>(name).unwrap().scene;
        let options = Options { estimator: Estimator::Beams, ..Default::default() };
        let error = Reference::new(scene, options).map(drop).unwrap_err().to_string();
        assert!(error.contains("beams") && error.contains(reason), "{name}: {error}");
    }
}
