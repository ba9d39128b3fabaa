//! The ground truth by beams against closed forms, and against the one by points.

use std::f64::consts::TAU;
use std::path::Path;

use glam::Vec3;
use pinspot::image::{Image, rel_l2};
use pinspot::reference::{Estimate, Estimator, Options, Reference, ReferenceError, StoppingCriterion};
use pinspot::scene::{Chain, Scene, load, parse};
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
fn what_beams_do_not_know_is_refused() {
    let rough = "[[light]]\nposition = [0, 3, 0]\nintensity = [9, 9, 9]\n[[object]]\nshape = { sphere = { radius = 0.3 } }\n\
                 reflector = { roughness = 0.3 }\n";
    let scenes = [
        ("ring-natural", "spot", load::<Settings>("ring-natural").unwrap().scene),
        ("rough", "rough", scene("constant = [0, 0, 0]", rough)),
    ];
    for (name, reason, scene) in scenes {
        let options = Options { estimator: Estimator::Beams, ..Default::default() };
        let error = Reference::new(scene, options).map(drop).unwrap_err().to_string();
        assert!(error.contains("beams") && error.contains(reason), "{name}: {error}");
    }
}

fn estimate(scene: Scene, options: Options) -> Result<Estimate, ReferenceError> {
    let goal = StoppingCriterion::new(0.01).with_max_points(2000.0);
    Reference::new(scene, options)?.solve(&goal, None, &NoProgress, &mut |_| Ok(()))
}

/// In the sun, 30° from the zenith.
fn in_the_sun(floor: &str, rest: &str) -> Scene {
    let text = format!(
        "[environment]\nconstant = [0, 0, 0]\n[[light]]\n\
         directional = {{ direction = [0.5, 0.8660254, 0.0], irradiance = [1000, 1000, 1000] }}\n\
         [camera]\nposition = [0, 9, 0]\ntarget = [0, 0, 0]\nup = [0, 0, -1]\northographic = {{ height = 2.0 }}\n\
         [[object]]\nshape = {{ plane = {{ size = [{floor}, {floor}] }} }}\nreceiver = {{ albedo = [0, 0, 0] }}\n{rest}"
    );
    parse::<toml::Table>("test.toml", &text, Path::new(".")).unwrap().scene
}

/// The part of unpolarised light that passes from air into glass or water at 30°.
fn passed(eta: f64) -> f64 {
    let (outside, inside) = (0.75f64.sqrt(), (1.0 - 0.25 / (eta * eta)).sqrt());
    let [s, p] = [(outside, eta * inside), (eta * outside, inside)].map(|(a, b)| ((a - b) / (a + b)).powi(2));
    1.0 - 0.5 * (s + p)
}

/// Light in a single direction by two flat faces: 1 m² of pane, behind which 791 W arrive. Its triangles are larger than the picture's pixels
/// by four orders of magnitude, and half of their corners send light nowhere.
#[test]
fn a_pane_in_the_sun() {
    let pane = "[[object]]\nshape = { box = { size = [1, 0.006, 1] } }\ntranslate = [0, 0.5, 0]\n\
                refractor = { eta = 1.52, interfaces = 2 }\ncamera_visible = false\n";
    for estimator in [Estimator::Auto, Estimator::Beams] {
        let options = Options { size: [48; 2], chains: Chain::TT.into(), estimator, ..Default::default() };
        let found = estimate(in_the_sun("6", pane), options).unwrap();
        // The light of the pane's own sides, 6 mm high, is left out.
        let expected = 1000.0 * 0.75f64.sqrt() * passed(1.52).powi(2) / 4.0;
        let mean = f64::from(found.irradiance.mean().x);
        assert!((mean / expected - 1.0).abs() < 0.01, "{estimator:?}: {mean}, not {expected}");
        let evenly = 4.0 * expected;
        let most = found.irradiance.pixels.iter().map(|pixel| f64::from(pixel.x)).fold(0.0, f64::max);
        assert!((most / evenly - 1.0).abs() < 0.01, "{estimator:?}: {most}, not {evenly}");
    }
}

/// Interfaces of two triangles, far larger than what they light, or partly beside it: all of it gets the same.
#[test]
fn a_small_floor_below_wide_water() {
    for width in [1.5, 4.0, 8.0, 40.0] {
        let water = format!(
            "[[object]]\nshape = {{ plane = {{ size = [{width}, {width}] }} }}\ntranslate = [0, 0.1, 0]\n\
             refractor = {{ eta = 1.333 }}\ncamera_visible = false\n"
        );
        let options = Options { size: [32; 2], ..Default::default() };
        let found = estimate(in_the_sun("1", &water), options).unwrap();
        let expected = (1000.0 * 0.75f64.sqrt() * passed(1.333)) as f32;
        // The middle quarter.
        for pixel in (0..1024).filter(|k| (9..23).contains(&(k % 32)) && (9..23).contains(&(k / 32))) {
            let value = found.irradiance.pixels[pixel].x;
            assert!((value / expected - 1.0).abs() < 1e-3, "{width} m: {value}, not {expected}");
        }
        let ledger = found.ledger.expect("there is one");
        assert!(ledger.is_known() && ledger.closes(), "{ledger:?}");
    }
}

/// Points never find light in a single direction: that is refused, and not called black without error.
#[test]
fn points_that_find_no_light_are_refused() {
    let mirror = "[[object]]\nshape = { plane = { size = [1, 1] } }\nrotate_deg = [0, 0, -90]\ntranslate = [-0.5, 0.5, 0]\nreflector = {}\n\
                  camera_visible = false\n";
    let options = Options { size: [16; 2], estimator: Estimator::Points, ..Default::default() };
    let refused = estimate(in_the_sun("6", mirror), options.clone());
    let Err(ReferenceError::Unbalanced { ledger }) = &refused else {
        panic!("{:?}", refused.map(|found| found.ledger))
    };
    assert!(ledger.is_known() && ledger.estimated < 0.1 * ledger.counted, "{ledger:?}");
    let found = estimate(in_the_sun("6", mirror), Options { estimator: Estimator::Auto, ..options }).unwrap();
    assert!(found.ledger.is_some_and(|ledger| ledger.is_known() && ledger.closes()));
}

/// What a mirror shows of surfaces in the light of a lamp does not depend on how the lamp's own light is found.
#[test]
fn mirrors_show_lit_surfaces_whatever_the_lamp() {
    let with_lamp = |radius: f64, albedo: f64| {
        let rest = format!(
            "[[light]]\nposition = [0.6, 0.3, 0]\nintensity = [9, 9, 9]\nradius = {radius}\n[[object]]\nshape = {{ plane = {{ size = [2, 2] }} }}\n\
             rotate_deg = [0, 0, -120]\ntranslate = [-1, 1, 0]\nreflector = {{}}\ncamera_visible = false\n"
        );
        let mut scene = scene("constant = [0, 0, 0]", &rest);
        scene.objects[0].receiver.as_mut().unwrap().albedo = Vec3::splat(albedo as f32);
        let reference =
            Reference::new(scene, Options { size: [8; 2], pixel_samples: 2, ..Default::default() }).unwrap();
        assert_eq!(reference.uses_beams(), radius < 0.01);
        let goal = StoppingCriterion::new(0.01).with_max_points(2000.0);
        let found = reference.solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap();
        f64::from(found.irradiance.mean().x)
    };
    let [point, sphere] = [1e-3, 0.05].map(|radius| [0.0, 0.8].map(|albedo| with_lamp(radius, albedo)));
    let [of_point, of_sphere] = [point[1] / point[0], sphere[1] / sphere[0]];
    assert!(of_point > 1.1 && (of_point / of_sphere - 1.0).abs() < 0.02, "{point:?} {sphere:?}");
    assert!((point[1] / sphere[1] - 1.0).abs() < 0.02, "{point:?} {sphere:?}");
}
