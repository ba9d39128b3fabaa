//! Rough mirrors: the engine's blurred footprints against the ground truth's brute force over facets.

use std::path::Path;

use glam::{DVec3, Vec3};
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::low_level::environment::{CubeMap, Environment};
use pinspot::low_level::pinhole::{Filter, Footprint, Params, Receivers};
use pinspot::low_level::reflectance::Curve;
use pinspot::low_level::sampling::Strategy;
use pinspot::reference::{Options, Reference, StoppingCriterion};
use pinspot::scene::{Scene, Visibility, parse};
use pinspot::{BackendChoice, EvaluationChoice, NoProgress};

use super::support::{self, BACK_ENDS, floor, on_cpu, on_gpu, pinholes_of, rel_l2_of};

const EDGE: u32 = 8;

/// A ring from above, in a light: what is rough about it.
fn ring(light: &str, roughness: f32) -> Scene {
    let text = format!(
        "[environment]\n{light}\n[camera]\nposition = [0.0, 4.0, 0.0]\ntarget = [0.0, 0.0, 0.0]\nup = [0.0, 0.0, -1.0]\n\
         orthographic = {{ height = 2.4 }}\n[[object]]\nshape = {{ ring = {{ radius = 1.0, height = 0.5 }} }}\ncamera_visible = false\n\
         reflector = {{ roughness = {roughness} }}\n[[object]]\nshape = {{ plane = {{ size = [3.0, 3.0] }} }}\n\
         receiver = {{ albedo = [0.5, 0.5, 0.5] }}\n"
    );
    parse::<toml::Table>("test.toml", &text, Path::new(".")).unwrap().scene
}

fn truth(scene: Scene, visibility: Visibility, rel_error: f64) -> Image {
    let goal = StoppingCriterion::new(rel_error);
    let options = Options { size: [EDGE; 2], visibility, ..Default::default() };
    Reference::new(scene, options).unwrap().solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance
}

fn receivers() -> Receivers {
    let at = |k: u32| 2.4 * ((k as f32 + 0.5) / EDGE as f32 - 0.5);
    let points = (0..EDGE * EDGE).map(|k| (Vec3::new(at(k % EDGE), 0.0, at(k / EDGE)), Vec3::Y, 1));
    Receivers::from_points(&points.collect::<Vec<_>>(), EDGE)
}

/// Relative errors at 2,000 samples.
struct Errors {
    roughness: f32,
    /// Of the default evaluation.
    default: f64,
    /// Of the flat sum.
    flat: f64,
    /// Of the flat sum without lobes.
    without: f64,
}

fn errors(light: &str, roughnesses: &[f32]) -> Vec<Errors> {
    let of = |roughness| {
        let scene = ring(light, roughness);
        // Its own error adds less than a tenth to the errors measured of rough mirrors.
        let expected = truth(scene.clone(), Visibility::None, 0.03);
        let expected: Vec<DVec3> = expected.pixels.iter().map(|p| p.as_dvec3()).collect();
        let environment = Environment::new(&scene.environment.light, Default::default()).unwrap();
        let pinholes = pinholes_of(&scene, 2000, Strategy::Neighbourhood, Footprint::Cells, 1);
        let mut sharp = pinholes.clone();
        sharp.samples.iter_mut().for_each(|s| s.lobe = 0.0);
        let [flat, without] = [&pinholes, &sharp]
            .map(|p| rel_l2_of(&on_cpu(&receivers(), p, &environment.cube, &Params::default()), &expected));
        let mut options = pinspot::Options::default().with_size([EDGE; 2]).with_samples(2000);
        (options.aovs, options.visibility) = (vec![Aov::Caustic], Visibility::None);
        let picture = support::render(scene, options, &BackendChoice::Cpu).unwrap().layers.remove(0).1;
        let picture: Vec<[f32; 4]> = picture.pixels.iter().map(|p| p.extend(0.0).to_array()).collect();
        let default = rel_l2_of(&picture, &expected);
        println!("{light}, roughness {roughness}: {default:.3}, flat {flat:.3}, without the lobe {without:.3}");
        Errors { roughness, default, flat, without }
    };
    roughnesses.iter().copied().map(of).collect()
}

#[test]
fn a_rough_mirror_is_as_near_to_the_truth_as_is_stated() {
    are_as_near_as_is_stated(&[("map = \"forest\"", &[0.3])]);
}

#[test]
#[ignore = "full: more ground truths"]
fn rough_mirrors_are_as_near_to_the_truth_as_is_stated() {
    are_as_near_as_is_stated(&[("map = \"forest\"", &[0.0, 0.2, 0.5]), ("map = \"studio\"", &[0.3])]);
}

/// Two parallelograms are no GGX lobe; this is what that costs.
fn are_as_near_as_is_stated(lights: &[(&str, &[f32])]) {
    for (light, roughnesses) in lights {
        for Errors { roughness, default, flat, without } in errors(light, roughnesses) {
            let place = format!("{light}, roughness {roughness}");
            let most = 0.04 + 0.25 * f64::from(roughness);
            assert!(default < most, "{place}: {default}");
            assert!(flat < most + 0.05, "{place}: {flat}");
            assert!(roughness == 0.0 || flat < 0.8 * without, "{place}: {flat} against {without}");
        }
    }
}

/// Under constant light only what the facets hide from each other is lost.
#[test]
fn both_back_ends_and_the_ground_truth_lose_what_facets_hide() {
    let ceiling = "[[object]]\nshape = { plane = { size = [4.0, 4.0] } }\nrotate_deg = [180.0, 0.0, 0.0]\n\
                   translate = [0.0, 1.0, 0.0]\nreflector = { metal = \"copper\", roughness = 0.63 }\n";
    let text = format!(
        "[environment]\nconstant = [1.0, 1.0, 1.0]\n[camera]\nposition = [0.0, 0.1, 0.0]\ntarget = [0.0, 0.0, 0.0]\n\
         up = [0.0, 0.0, -1.0]\northographic = {{ height = 1e-3 }}\n[[object]]\n\
         shape = {{ plane = {{ size = [0.01, 0.01] }} }}\nreceiver = {{ albedo = [0.5, 0.5, 0.5] }}\n{ceiling}"
    );
    let scene = parse::<toml::Table>("test.toml", &text, Path::new(".")).unwrap().scene;
    let curve = Curve::new(&scene.objects[1].reflector.unwrap().finish, 512);
    let steps = 160;
    let at = |k: u32| 4.0 * ((f64::from(k) + 0.5) / f64::from(steps) - 0.5);
    let cosines = (0..steps * steps).map(|k| (1.0 + at(k % steps).powi(2) + at(k / steps).powi(2)).sqrt().recip());
    let sum: DVec3 = cosines.map(|cosine| curve.at(cosine) * cosine.powi(4)).sum();
    let expected = sum * (4.0 / f64::from(steps)).powi(2);
    let close = |got: DVec3, most: f64, who: &str| {
        assert!((got / expected - 1.0).abs().max_element() < most, "{who}: {got}, not {expected}");
    };

    let goal = StoppingCriterion::new(5e-4);
    let options = Options { size: [1, 1], ..Default::default() };
    let reference = Reference::new(scene.clone(), options).unwrap();
    let estimate = reference.solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap();
    close(estimate.irradiance.pixels[0].as_dvec3(), 4e-3, "the ground truth");

    let pinholes = pinholes_of(&scene, 4000, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    for (name, gather) in BACK_ENDS {
        let [r, g, b, _] = gather(&floor(1e-6, 1), &pinholes, &cube, &Params::default())[0];
        close(DVec3::new(r.into(), g.into(), b.into()), 0.01, name);
    }
}

#[test]
#[ignore = "full: a ground truth"]
fn a_rough_mirror_sees_as_much_of_the_sky_as_the_ground_truth() {
    see_as_much_of_the_sky(&[(0.5, 0.06)]);
}

#[test]
#[ignore = "full: more ground truths"]
fn rougher_mirrors_see_as_much_of_the_sky_as_the_ground_truth() {
    see_as_much_of_the_sky(&[(0.7, 0.07), (1.0, 0.2)]);
}

/// A lobe sees more of the sky, and of the ring's other side, than its middle does.
fn see_as_much_of_the_sky(cases: &[(f32, f64)]) {
    for &(roughness, most) in cases {
        let scene = ring("constant = [1.0, 1.0, 1.0]", roughness);
        let expected = truth(scene.clone(), Visibility::Full, 0.02);
        let [cpu, gpu, flat] = [
            (BackendChoice::Cpu, EvaluationChoice::Hierarchical),
            (BackendChoice::Gpu(None), EvaluationChoice::Hierarchical),
            (BackendChoice::Cpu, EvaluationChoice::Flat),
        ]
        .map(|(choice, evaluation)| {
            let size = [EDGE; 2];
            let mut options = pinspot::Options::default().with_size(size).with_samples(1000);
            (options.evaluation, options.aovs, options.tolerance) = (evaluation, vec![Aov::Caustic], 0.05);
            support::render(scene.clone(), options, &choice).unwrap().layers.remove(0).1
        });
        let error = rel_l2(&cpu, &expected, None);
        let [of_gpu, of_flat] = [gpu, flat].map(|other| rel_l2(&other, &cpu, None));
        println!("roughness {roughness}: {error:.3}; GPU from CPU {of_gpu:.4}, flat from hierarchical {of_flat:.3}");
        assert!(error < most, "roughness {roughness}: {error}");
        assert!(of_gpu < 0.02, "roughness {roughness}: {of_gpu}");
        assert!(of_flat < 0.15, "roughness {roughness}: {of_flat}");
    }
}

#[test]
fn the_back_ends_agree_on_rough_mirrors() {
    let pinholes =
        pinholes_of(&ring("constant = [1.0, 1.0, 1.0]", 0.45), 900, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(64, None, |d| Vec3::new(1.0 + d.x, 2.0 + d.y, (9.0 * d.z).sin().abs()));
    for filter in [Filter::Isotropic, Filter::Anisotropic] {
        let params = Params { filter, ..Default::default() };
        let [cpu, gpu] = [on_cpu, on_gpu].map(|gather| gather(&receivers(), &pinholes, &cube, &params));
        assert!(support::rel_l2(&gpu, &cpu) < 1e-4, "{filter:?}: {}", support::rel_l2(&gpu, &cpu));
    }
}
