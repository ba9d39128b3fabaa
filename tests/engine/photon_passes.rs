//! Photons whose mode, number and directions follow from a tolerance, as by default.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_4, PI};
use std::path::PathBuf;

use pinspot::image::{Image, rel_l2};
use pinspot::scene::{Scene, parse};
use pinspot::{BackendChoice, ImageSpaceOptions, MapView, Mode, Options, Rendered, Technique};

use crate::support::meshes::paraboloid;
use crate::support::{above_floor, photon_options, render};

/// Irradiance of the sun on a surface that faces it, W/m², and its angular radius.
const SUN: f64 = 1000.0;
const SUN_RADIUS: f64 = 0.00465;

fn caustic(scene: &Scene, options: Options) -> (Image, Rendered) {
    let mut rendered = render(scene.clone(), options, &BackendChoice::Cpu).unwrap();
    (rendered.layers.remove(0).1, rendered)
}

/// A dish of 45° from its axis to its rim, with a focal length of 1 m and a hole in the middle, and a small target in its focus.
fn dish() -> (Scene, f64) {
    let (inner, outer) = (0.05, 2.0 * (0.5 * FRAC_PI_4).tan());
    let text = format!(
        "environment = {{ constant = [0, 0, 0] }}\n\
         [[light]]\ndirectional = {{ direction = [0, 0, 1], irradiance = [{SUN}, {SUN}, {SUN}], sigma_rad = {} }}\n\
         [camera]\nposition = [0, 0, -0.5]\ntarget = [0, 0, 0]\northographic = {{ height = 0.02 }}\n\
         [[object]]\nmesh = \"dish.obj\"\nreflector = {{}}\ncamera_visible = false\n\
         [[object]]\nshape = {{ plane = {{ size = [0.03, 0.03] }} }}\nrotate_deg = [-90, 0, 0]\nreceiver = {{}}\n",
        0.5 * SUN_RADIUS
    );
    let assets = HashMap::from([(PathBuf::from("dish.obj"), paraboloid(1.0, [inner as f32, outer as f32]))]);
    let scene = parse::<toml::Table>("dish.toml", &text, &assets).unwrap().scene;
    // The middle sees the sun in all of the dish: E = L π (sin² rim − sin² hole).
    let angle = |radius: f64| 2.0 * (0.5 * radius).atan();
    let radiance = SUN / (PI * SUN_RADIUS * SUN_RADIUS);
    (scene, radiance * PI * (angle(outer).sin().powi(2) - angle(inner).sin().powi(2)))
}

/// One even disc, where 24 points of the sun would be 24 images.
#[test]
fn a_dish_shows_one_sun() {
    let (scene, expected) = dish();
    let (found, rendered) = caustic(&scene, photon_options(ImageSpaceOptions::default()).with_size([48, 48]));
    let photons = rendered.report.photons.unwrap();
    let passes = photons.passes.unwrap();
    println!("{} in {} passes, error {:.4}", photons.mode.name(), passes.photon_passes, passes.photon_error);
    assert!(passes.photon_error <= 0.02 && photons.flux.error().abs() < 1e-3 && rendered.report.warnings.is_empty());
    let metres = |k: usize| 0.02 * ((k as f64 + 0.5) / 48.0 - 0.5);
    // The rim's images of the sun are wider, none is narrower.
    let is_within = |k: &usize| metres(k % 48).hypot(metres(k / 48)) < 0.9 * SUN_RADIUS;
    let differences = (0..48 * 48).filter(is_within).map(|k| f64::from(found.pixels[k].x) / expected - 1.0);
    let (count, sum, squares) =
        differences.fold((0.0, 0.0, 0.0), |(n, sum, squares), d| (n + 1.0, sum + d, squares + d * d));
    println!("mean {:+.4}, rms {:.4}", sum / count, f64::sqrt(squares / count));
    assert!(f64::abs(sum / count) < 0.005 && f64::sqrt(squares / count) < 0.03);
}

/// A sky is more than some of its directions: photons bring what pinholes do, which are .8 % above the closed form of the constant one.
#[test]
fn skies_have_all_their_light() {
    let ball = "[[object]]\nshape = { sphere = { radius = 0.35 } }\ntranslate = [0.3, 0.5, 0]\nreflector = { reflectance = [0.9, 0.9, 0.9] }\n\
                camera_visible = false\n";
    for light in ["constant = [1, 1, 1]", "map = \"forest\""] {
        let scene = above_floor(light, ball);
        let size = [32, 32];
        let by_photons = photon_options(ImageSpaceOptions { photons: 256, ..Default::default() }).with_size(size);
        let (expected, _) = caustic(&scene, by_photons.clone().with_technique(Technique::Pinhole));
        let (found, rendered) = caustic(&scene, by_photons);
        let photons = rendered.report.photons.unwrap();
        let energy = found.mean().element_sum() / expected.mean().element_sum() - 1.0;
        let error = rel_l2(&found, &expected, None);
        let passes = photons.passes.unwrap();
        println!(
            "{light}: {} in {} passes, energy {energy:+.4}, {error:.4}",
            photons.mode.name(),
            passes.photon_passes
        );
        assert!(energy.abs() < 0.015 && error < 0.04 && passes.photon_error < 0.04, "{light}");
    }
}

/// Where nothing can be drawn out of a light, grids become finer; where photons are followed as in the papers, they are sent once.
#[test]
fn points_and_papers_are_as_their_options_say() {
    let lamp = "[[light]]\nposition = [0, 3, 0]\nintensity = [9, 18, 27]\n";
    let waves = "[[object]]\nshape = { sheet = { size = [4, 4], amplitude = 0.02, wavelength = 0.9 } }\ntranslate = [0, 1, 0]\n\
                 refractor = { eta = 1.333 }\ncamera_visible = false\n";
    let scene = above_floor("constant = [0, 0, 0]", &format!("{lamp}{waves}"));
    let of = |image_space: ImageSpaceOptions| {
        let options = photon_options(image_space).with_size([48, 48]).with_tolerance(1e-4);
        let rendered = caustic(&scene, options).1;
        let photons = rendered.report.photons.unwrap();
        (photons.mode, photons.photons, photons.passes)
    };
    let few = ImageSpaceOptions { photons: 32, ..Default::default() };
    let (mode, photons, passes) = of(few);
    assert!(mode == Mode::ExactPolygons && passes.unwrap().photon_passes == 2);
    assert_eq!(photons, 2 * 128 * 128, "the finest of three grids");
    assert_eq!(of(ImageSpaceOptions { caustic_map: MapView::Light, ..few }), (Mode::ExactPolygons, 32 * 32, None));
    assert_eq!(of(ImageSpaceOptions { temporal_frames: 2, ..few }).2, None);
}

/// A floor that the camera sees through water alone has its caustic in other maps than the camera's.
#[test]
fn caustics_behind_water_are_not_missing() {
    let water = "[[light]]\nposition = [0.3, 3, 0]\nintensity = [9, 18, 27]\n\
                 [[object]]\nshape = { sheet = { size = [6, 6], amplitude = 0.02, wavelength = 0.9 } }\ntranslate = [0, 1, 0]\n\
                 refractor = { eta = 1.333 }\n";
    let warnings = |camera_visible: bool| {
        let water = format!("{water}camera_visible = {camera_visible}\n");
        let mut scene = above_floor("constant = [0, 0, 0]", &water);
        if !camera_visible {
            // It looks away.
            scene.camera.position.y = -1.0;
        }
        let options = ImageSpaceOptions { photons: 64, ..Default::default() };
        caustic(&scene, photon_options(options).with_size([24, 24])).1.report.warnings
    };
    assert_eq!(warnings(true), Vec::<String>::new());
    assert!(warnings(false).iter().any(|warning| warning.contains("there is no caustic")), "{:?}", warnings(false));
}
