use pinspot::image::Image;
use pinspot::{Backend, Detail, Engine, NoProgress, blocking};
#[test]
fn dev() {
    let names = std::env::var("DEV_SCENES").unwrap_or("mirror-sphere".into());
    let backend = Backend::gpu(blocking::wait(None, pinspot::low_level::gpu::Gpu::open(None)).unwrap());
    let spacing: u32 = std::env::var("DEV_SPACING").map_or(1, |s| s.parse().unwrap());
    for name in names.split(',') {
        let (scene, options) = pinspot::load(name).unwrap();
        let size = [160, 120];
        let options = options.with_size(size);
        let detail = Detail { size, samples: 100, spacing, shadow_directions: 64 };
        let mut pictures = Vec::new();
        for backend in [Backend::cpu(), backend.clone()] {
            let mut engine = Engine::new(scene.clone(), options.clone(), backend.clone());
            for round in 0..2 {
            let began = std::time::Instant::now();
            engine.scene_mut().pose(0.5 + 0.1 * round as f32);
            let p = blocking::wait(backend.device(), engine.preview(&detail, &NoProgress)).unwrap();
            println!("{name}: {:?} {:?} s", p.exposures, began.elapsed().as_secs_f32());
            if round == 1 { pictures.push(p.image); }
            }
        }
        let [a, b] = &pictures[..] else { panic!() };
        let d: Vec<f32> = a.pixels.iter().zip(&b.pixels).map(|(a, b)| (*a - *b).abs().element_sum() / 3.0).collect();
        let mean = d.iter().sum::<f32>() / d.len() as f32;
        let large = d.iter().filter(|d| **d > 0.02).count();
        println!("{name}: mean {mean:.5}, {large} of {} off by .02", d.len());
        let save = |image: &Image, which: &str| pinspot::image::write_png(std::path::Path::new(&format!("/tmp/dev-{name}-{which}.png")), image).unwrap();
        let diff = Image { width: 160, height: 120, pixels: d.iter().map(|d| pinspot::glam::Vec3::splat(10.0 * d)).collect() };
        save(a, "cpu"); save(b, "gpu"); save(&diff, "diff");
    }
}
