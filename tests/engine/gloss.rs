//! Rough mirrors: the engine's blurred footprints against the ground truth's brute force over facets.

use std::path::Path;

use glam::DVec3;
use pinspot::Silent;
use pinspot::environment::Environment;
use pinspot::pinhole::{Footprint, Params, Pinholes, Receivers, cpu};
use pinspot::reference::{Goal, Options, Reference};
use pinspot::reflectance::Curve;
use pinspot::sampling::Strategy;
use pinspot::scene::{Scene, parse};

use super::support::{on_cpu, on_gpu, pinholes_of, rel_l2};

const EDGE: u32 = 24;

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

fn truth(scene: Scene, rel_error: f64) -> Vec<DVec3> {
    let goal = Goal { rel_error, seconds: None, points: None };
    let options = Options { size: [EDGE; 2], ..Default::default() };
    let estimate = Reference::new(scene, options).unwrap().solve(&goal, None, &Silent, &mut |_| Ok(())).unwrap();
    estimate.irradiance.pixels.iter().map(|p| p.as_dvec3()).collect()
}

fn receivers() -> Receivers {
    let at = |k: u32| 2.4 * ((k as f32 + 0.5) / EDGE as f32 - 0.5);
    let points = (0..EDGE * EDGE).map(|k| (glam::Vec3::new(at(k % EDGE), 0.0, at(k / EDGE)), glam::Vec3::Y, 1));
    Receivers::from_points(&points.collect::<Vec<_>>(), EDGE)
}

fn error(got: &[[f32; 4]], expected: &[DVec3]) -> f64 {
    let off: f64 = got
        .iter()
        .zip(expected)
        .map(|(g, e)| (DVec3::new(g[0].into(), g[1].into(), g[2].into()) - *e).length_squared())
        .sum();
    (off / expected.iter().map(|e| e.length_squared()).sum::<f64>()).sqrt()
}

#[test]
fn fit() {
    for light in [
        "map = \"forest\"",
        "map = \"studio\"",
        "spot = { direction = [0.5, 0.8, 0.2], sigma_rad = 0.05, radiance = [300, 300, 300] }",
    ] {
        for roughness in [0.0, 0.05, 0.1, 0.2, 0.3, 0.5] {
            let scene = ring(light, roughness);
            let t = std::time::Instant::now();
            let expected = truth(scene.clone(), 0.004);
            let dt = t.elapsed().as_secs_f64();
            let environment = Environment::load(&scene.environment, Default::default()).unwrap();
            let pinholes = pinholes_of(&scene, 2000, Strategy::Neighbourhood, Footprint::Cells, 1);
            let mut line = format!("{light:.20} α {roughness} ({dt:.0} s):");
            for c in [0.0, 2.0, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0] {
                let mut changed = pinholes.clone();
                for s in &mut changed.samples {
                    s.side_1[3] = c * roughness;
                }
                let got = cpu::gather(&receivers(), &changed, &environment.cube, &Params::default(), &|_| ());
                line += &format!(" {c}: {:.3}", error(&got, &expected));
            }
            println!("{line}");
        }
    }
}
