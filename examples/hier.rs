use pinspot::cell_tree::{CellTree, TreeOptions};
use pinspot::environment::{Environment, LightBounds};
use pinspot::pinhole::cpu::{Accuracy, Light, gather, gather_hierarchical, typical_irradiance};
use pinspot::pinhole::{Params, PinholeTree, Receivers};
use pinspot::render::Settings;
use pinspot::sampling::{self, Surface, sample};
use pinspot::scene::load;
use pinspot::tracing::Tracer;
use std::time::Instant;
fn arg(k: &str, d: &str) -> String {
    std::env::args().find_map(|a| a.strip_prefix(&format!("{k}=")).map(str::to_owned)).unwrap_or(d.into())
}
fn main() {
    let num = |k: &str, d: f64| arg(k, &d.to_string()).parse::<f64>().unwrap();
    let loaded = load::<Settings>(&arg("scene", "ring-above")).unwrap();
    let scene = loaded.scene;
    let mut options = loaded.render.options().unwrap();
    options.size = [num("size", 512.0) as u32; 2];
    if arg("cube", "") != "" { options.cube_size = arg("cube", "").parse().unwrap(); }
    let environment = Environment::load(&scene.environment, options.cube_size).unwrap();
    let t = Instant::now();
    let bounds = LightBounds::new(&environment.cube);
    println!("bounds {:.3}s", t.elapsed().as_secs_f64());
    let surface = Surface::of_scene(&scene);
    let t = Instant::now();
    let set = sample(&surface, &sampling::Options { samples: num("n", 1000.0) as u32, strategy: options.strategy, seed: num("seed", 1.0) as u64 }).unwrap();
    println!("sampling {:.3}s", t.elapsed().as_secs_f64());
    let tracer = Tracer::new(&scene);
    let mut receivers = Receivers::empty(options.size[0], options.size[1]);
    let size = glam::Vec2::new(options.size[0] as f32, options.size[1] as f32);
    for k in 0..options.size[0] * options.size[1] {
        let p = glam::Vec2::new((k % options.size[0]) as f32 + 0.5, (k / options.size[0]) as f32 + 0.5);
        if let Some(hit) = tracer.camera_hit(scene.camera.ray(p, size)).filter(|h| scene.objects[h.object as usize].receiver.is_some()) {
            receivers.set(k as usize, hit.position, hit.normal, hit.object);
        }
    }
    let error = |a: &[[f32; 4]], b: &[[f32; 4]], mask: &[bool]| {
        let (mut e, mut s) = (0.0f64, 0.0f64);
        for k in 0..a.len() { if mask[k] { for c in 0..3 { e += f64::from(a[k][c] - b[k][c]).powi(2); s += f64::from(b[k][c]).powi(2); } } }
        (e / s).sqrt()
    };
    let mean = |a: &[[f32; 4]], c: usize| a.iter().map(|v| f64::from(v[c])).sum::<f64>() / a.len() as f64;
    let all = vec![true; receivers.positions.len()];
    let reference = (arg("ref", "") != "").then(|| {
        let i = pinspot::image::read_exr(std::path::Path::new(&arg("ref", "")), &arg("layer","")).unwrap();
        i.pixels.iter().map(|p| p.extend(0.0).to_array()).collect::<Vec<_>>()
    });
    let mask = if arg("mask", "") != "" { pinspot::image::read_mask(std::path::Path::new(&arg("mask", ""))).unwrap().2 } else { all.clone() };
    let params = Params { taps: num("taps", 16.0) as u32, ..options.params };
    for leaves in arg("leaves", "64").split(',') {
        let leaves: u32 = leaves.parse().unwrap();
        let t = Instant::now();
        let tree = CellTree::new(&surface, &set, &TreeOptions { leaves, seed: 1 });
        let build = t.elapsed().as_secs_f64();
        let mut pinholes = PinholeTree::new(&scene, tree);
        if arg("vis", "0") == "1" { pinholes.roots_mut().look_around(&scene, &tracer); }
        let flat = (arg("flat", "0") == "1").then(|| {
            let mut l = pinholes.leaves();
            if arg("vis", "0") == "1" { l.look_around(&scene, &tracer); }
            let t = Instant::now();
            let f = gather(&receivers, &l, &environment.cube, &params, &|_| ());
            println!("flat N={} {:.3}s fetches {:.0} err {:.4}", l.samples.len(), t.elapsed().as_secs_f64(), mean(&f, 3), reference.as_ref().map_or(0.0, |r| error(&f, r, &mask)));
            f
        });
        for tol in arg("tol", "0.01").split(',') {
            let tol: f32 = tol.parse().unwrap();
            let t = Instant::now();
            let light = Light { cube: &environment.cube, bounds: &bounds };
            let h = gather_hierarchical(&receivers, &pinholes, light, &params, Accuracy { error: tol * typical_irradiance(&receivers, &pinholes, light, &params), split_near: arg("near", "1") == "1" }, &|_| ());
            let dt = t.elapsed().as_secs_f64();
            println!("{} leaves {} build {build:.3}s tol {tol} {dt:.3}s fetches {:.0} err {:.4} vs flat {:.5} energy {:.5}", scene.name, pinholes.tree().leaves().count(), mean(&h, 3),
                reference.as_ref().map_or(0.0, |r| error(&h, r, &mask)), flat.as_ref().map_or(0.0, |f| error(&h, f, &all)), flat.as_ref().map_or(0.0, |f| mean(&h, 1) / mean(f, 1)));
            if arg("out", "") != "" {
                let w = options.size[0] as usize;
                let mut img = pinspot::image::Image::new(options.size[0], options.size[1]);
                for k in 0..w * w { let v = if arg("diff","0")=="1" { let f = flat.as_ref().unwrap(); std::array::from_fn::<f32,3,_>(|c| h[k][c] - f[k][c]) } else { [h[k][0], h[k][1], h[k][2]] }; img.pixels[k] = glam::Vec3::from_array(v); }
                pinspot::image::write_exr(std::path::Path::new(&arg("out", "")), &[("", &img)]).unwrap();
            }
        }
    }
}
