//! Metals and coats: both back ends, and the ground truth, against the equations.

use std::path::Path;

use glam::{DVec3, Vec3};
use pinspot::NoProgress;
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::pinhole::{Footprint, Params};
use pinspot::low_level::reflectance::{Finish, Metal};
use pinspot::low_level::sampling::Strategy;
use pinspot::reference::{Options, Reference, StoppingCriterion};
use pinspot::scene::{Scene, parse};

use super::support::{BACK_ENDS, floor, on_cpu, on_gpu, pinholes_of, rel_l2, scene};

const FINISHES: [&str; 4] = [
    "metal = \"gold\"",
    "coat = 1.5",
    "metal = \"chromium\", coat = 1.8",
    "metal = \"copper\", reflectance = [0.2, 0.5, 1.0]",
];

/// A flat mirror of 4 × 4 m, 1 m above the origin, that faces down.
fn ceiling(finish: &str) -> String {
    format!(
        "[[object]]\nshape = {{ plane = {{ size = [4.0, 4.0] }} }}\nrotate_deg = [180.0, 0.0, 0.0]\ntranslate = [0.0, 1.0, 0.0]\n\
         reflector = {{ {finish} }}\n"
    )
}

fn finish_of(scene: &Scene) -> Finish {
    scene.objects.iter().find_map(|o| o.reflector).unwrap().finish
}

/// Under constant radiance of 1 the ceiling adds ∫ R(θ) cos⁴θ / h² dA to what is at the origin: every piece at (x, z) mirrors
/// at cosθ = h/l, which is also the cosine at the receiver. By the midpoint rule.
fn irradiance_below(finish: &Finish) -> DVec3 {
    let steps = 160;
    let at = |k: u32| 4.0 * ((f64::from(k) + 0.5) / f64::from(steps) - 0.5);
    let mut sum = DVec3::ZERO;
    for (i, j) in (0..steps).flat_map(|j| (0..steps).map(move |i| (i, j))) {
        let cosine = (1.0 + at(i).powi(2) + at(j).powi(2)).sqrt().recip();
        sum += finish.reflectance_at(cosine) * cosine.powi(4);
    }
    sum * (4.0 / f64::from(steps)).powi(2)
}

#[test]
fn both_back_ends_mirror_as_the_equations_say() {
    let receivers = floor(1e-6, 1);
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    for finish in FINISHES {
        let scene = scene(&ceiling(finish));
        let pinholes = pinholes_of(&scene, 4000, Strategy::Neighbourhood, Footprint::Cells, 1);
        let expected = irradiance_below(&finish_of(&scene));
        for (name, gather) in BACK_ENDS {
            let [r, g, b, _] = gather(&receivers, &pinholes, &cube, &Params::default())[0];
            let got = DVec3::new(r.into(), g.into(), b.into());
            assert!((got / expected - 1.0).abs().max_element() < 0.01, "{name}, {finish}: {got}, not {expected}");
        }
    }
}

/// Where all angles occur, the angle matters: grazing light takes no colour.
#[test]
fn the_ground_truth_mirrors_as_the_equations_say() {
    for finish in FINISHES {
        let text = format!(
            "[environment]\nconstant = [1.0, 1.0, 1.0]\n[camera]\nposition = [0.0, 0.1, 0.0]\ntarget = [0.0, 0.0, 0.0]\n\
             up = [0.0, 0.0, -1.0]\northographic = {{ height = 1e-3 }}\n[[object]]\nshape = {{ plane = {{ size = [0.01, 0.01] }} }}\n\
             receiver = {{ albedo = [0.5, 0.5, 0.5] }}\n{}",
            ceiling(finish)
        );
        let scene = parse::<toml::Table>("test.toml", &text, Path::new(".")).unwrap().scene;
        let expected = irradiance_below(&finish_of(&scene));
        let goal = StoppingCriterion::new(3e-4);
        let options = Options { size: [1, 1], ..Default::default() };
        let estimate =
            Reference::new(scene, options).unwrap().solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap();
        let got = estimate.irradiance.pixels[0].as_dvec3();
        // The ground truth has colour tables of its own, which differ from the engine's by up to .2 %.
        assert!((got / expected - 1.0).abs().max_element() < 4e-3, "{finish}: {got}, not {expected}");
    }
}

#[test]
fn the_back_ends_agree_on_several_finishes_in_one_scene() {
    let ring = |x: f32, finish: &str| {
        format!(
            "[[object]]\nshape = {{ ring = {{ radius = 0.3, height = 0.2 }} }}\ntranslate = [{x}, 0.0, 0.0]\n\
             reflector = {{ sides = \"both\", {finish} }}\n"
        )
    };
    let objects: String = FINISHES.iter().zip([-1.0, -0.3, 0.4, 1.1]).map(|(f, x)| ring(x, f)).collect();
    let plain = ring(0.0, "reflectance = [0.9, 0.5, 0.1]");
    let pinholes = pinholes_of(&scene(&(objects + &plain)), 900, Strategy::Neighbourhood, Footprint::Cells, 1);
    assert_eq!(pinholes.curves.len(), FINISHES.len());
    let cube = CubeMap::from_radiance(32, None, |d| Vec3::new(1.0 + d.x, 2.0 + d.y, (9.0 * d.z).sin().abs()));
    let receivers = floor(3.0, 33);
    let [cpu, gpu] = [on_cpu, on_gpu].map(|gather| gather(&receivers, &pinholes, &cube, &Params::default()));
    assert!(rel_l2(&gpu, &cpu) < 1e-5, "{}", rel_l2(&gpu, &cpu));
}

/// What is known of gold: its colour fades towards grazing light.
#[test]
fn colours_fade_towards_grazing_light() {
    let gold = Finish { reflectance: DVec3::ONE, metal: Some(Metal::Gold), coat: None, roughness: 0.0 };
    let saturation = |cosine: f64| {
        let c = gold.reflectance_at(cosine);
        c.max_element() - c.min_element()
    };
    assert!(saturation(1.0) > 0.5 && saturation(0.05) < 0.3 * saturation(1.0));
    assert!(saturation(0.0) < 1e-9);
}
