//! Image-space techniques on the GPU against the CPU.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use pinspot::image::{Aov, Image, RgbImage};
use pinspot::scene::{Gloss, Scene, Slide};
use pinspot::{
    BackendChoice, Error, Hits, ImageSpaceOptions, Incidence, MapView, Mode, Options, PhotonStatistics, Rendered,
    Traversal,
};

use crate::support::{above_floor, gpu_backend, photon_options, render};

const DARK: &str = "constant = [0, 0, 0]";

fn options(mode: Mode, caustic_map: MapView) -> Options {
    let image_space = ImageSpaceOptions {
        mode,
        caustic_map,
        photons: 256,
        caustic_map_size: 256,
        light_directions: 2,
        ..Default::default()
    };
    photon_options(image_space).with_size([128, 96])
}

fn photons(rendered: &Rendered) -> PhotonStatistics {
    rendered.report.photons.unwrap()
}

/// The mean difference of two pictures, relative to their mean: single pixels at the edge of a texel may show the next one.
fn difference(one: &Image, other: &Image) -> f64 {
    let apart = |(a, b): (&Vec3, &Vec3)| f64::from((*a - *b).abs().element_sum());
    let all: f64 = one.pixels.iter().zip(&other.pixels).map(apart).sum();
    all / other.pixels.iter().map(|pixel| f64::from(pixel.element_sum())).sum::<f64>()
}

/// Pictures of both back ends, and how far they are apart.
fn compare(label: &str, scene: &Scene, options: &Options) -> f64 {
    let of = |backend| render(scene.clone(), options.clone(), &backend).unwrap();
    let [on_gpu, on_cpu] = [BackendChoice::Gpu(None), BackendChoice::Cpu].map(of);
    let error = difference(&on_gpu.layers[0].1, &on_cpu.layers[0].1);
    let [gpu, cpu] = [&on_gpu, &on_cpu].map(photons);
    println!("{label}: {error:.2e}; cast {} of {}, error {:.1e}", gpu.flux.cast, cpu.flux.cast, gpu.flux.error());
    assert!(on_cpu.layers[0].1.mean().x > 0.0, "{label}: no caustic");
    assert!((gpu.flux.cast / cpu.flux.cast - 1.0).abs() < 1e-4, "{label}: {} {}", gpu.flux.cast, cpu.flux.cast);
    // Rays into images end at edges of texels, which the rasterizer draws a little differently.
    let apart = if options.image_space.hits == Hits::Traced { 1000 } else { 100 };
    let (of_gpu, used) = (gpu.photons_used, cpu.photons_used);
    assert!(gpu.photons == cpu.photons && of_gpu.abs_diff(used) <= 8 + used / apart, "{label}: {of_gpu} {used}");
    let [closed, of_cpu] = [gpu, cpu].map(|photons| photons.flux.error());
    // Large triangles are not flat in the faces of cubes, and too long ones are culled on the GPU.
    assert!((closed - of_cpu).abs() < 3e-3, "{label}: {closed} {of_cpu}");
    error
}

/// Small pictures: each mode; light through glass by rays and in images; a glossy floor.
#[test]
fn back_ends_agree_on_small_pictures() {
    let (ring, _) = pinspot::load("ring").unwrap();
    let small = |mode| {
        let mut options = options(mode, MapView::Eye).with_size([64, 48]);
        options.image_space.photons = 128;
        options
    };
    for mode in Mode::ALL {
        let error = compare(mode.name(), &ring, &small(mode));
        assert!(error < 4e-3, "{}: {error}", mode.name());
    }
    let lamp = "[[light]]\nposition = [0.4, 3, 0.2]\nintensity = [9, 18, 27]\n";
    let ball = "[[object]]\nshape = { sphere = { radius = 0.4 } }\ntranslate = [0, 0.62, 0]\n\
                refractor = { eta = 1.5, interfaces = 2 }\ncamera_visible = false\n";
    let glass = above_floor(DARK, &format!("{lamp}{ball}"));
    for hits in [Hits::Traced, Hits::Image] {
        let mut options = small(Mode::ExactPolygons);
        options.image_space.hits = hits;
        let error = compare(&format!("glass {}", hits.name()), &glass, &options);
        assert!(error < 1e-2, "glass {}: {error}", hits.name());
    }
    let mut glossy = ring;
    let gloss = Gloss::Ggx { specular: Vec3::splat(0.2), roughness: 0.4 };
    glossy.objects.iter_mut().filter_map(|o| o.receiver.as_mut()).for_each(|r| r.gloss = gloss.clone());
    let error = compare("gloss", &glossy, &small(Mode::ExactPolygons).with_aovs(vec![Aov::Beauty]));
    assert!(error < 4e-3, "gloss: {error}");
}

/// Every mode and both kinds of maps: a sun of some extent on a ring.
#[test]
#[ignore = "full: pictures of 128×96 pixels in every mode on a software adapter"]
fn back_ends_agree_in_every_mode() {
    let (ring, _) = pinspot::load("ring").unwrap();
    for mode in Mode::ALL {
        // Light maps differ from the camera's in their views alone, and in what is smoothed.
        let has_light_map = matches!(mode, Mode::Points | Mode::Gather | Mode::ExactPolygons);
        for map in [MapView::Eye, MapView::Light].into_iter().take(1 + usize::from(has_light_map)) {
            let error = compare(&format!("{} {}", mode.name(), map.name()), &ring, &options(mode, map));
            // Maps of lights are looked up: a pixel at the edge of a texel may show the next one.
            assert!(error < if map == MapView::Eye { 2e-3 } else { 5e-3 }, "{} {}: {error}", mode.name(), map.name());
        }
    }
}

/// Light through a closed object from a spotlight with a slide, and through dispersive water from a lamp of some extent.
#[test]
#[ignore = "full: eight pictures on a software adapter"]
fn back_ends_agree_on_refraction() {
    let spot = "[[light]]\nposition = [0, 3, 0]\nintensity = [9, 18, 27]\nspot = { target = [0, 0, 0], up = [0, 0, -1], angle_deg = 30 }\n";
    let ball = "[[object]]\nshape = { sphere = { radius = 0.4, divisions = 96 } }\ntranslate = [0, 0.62, 0]\n\
                refractor = { eta = 1.5, interfaces = 2 }\ncamera_visible = false\n";
    let mut slide = above_floor(DARK, &format!("{spot}{ball}"));
    let pixels = (0..12u8).map(|k| [f32::from(k % 4), f32::from(k / 4), 1.0]).collect();
    slide.lamps[0].beam.as_mut().unwrap().slide = Some(Slide(Arc::new(RgbImage { width: 4, height: 3, pixels })));
    let waves = "[[light]]\nposition = [0.3, 3, 0]\nintensity = [9, 18, 27]\nradius = 0.1\n\
                 [[object]]\nshape = { water = { size = [4, 4], amplitude = 0.02 } }\ntranslate = [0, 1, 0]\n\
                 refractor = { eta = [1.33, 1.34, 1.36] }\ncamera_visible = false\n";
    let waves = above_floor(DARK, waves);
    for (name, scene) in [("slide", slide), ("waves", waves)] {
        for mode in [Mode::Points, Mode::ExactPolygons, Mode::ThickLens, Mode::Footprints] {
            let mut options = options(mode, MapView::Eye);
            options.image_space.photons = 128;
            let error = compare(&format!("{name} {}", mode.name()), &scene, &options);
            assert!(error < 2e-3, "{name} {}: {error}", mode.name());
        }
    }
}

/// Images of what a light sees are drawn on the GPU and traced on the CPU: a ball, water, a mirror seen by a cube around the lamp, a ring.
#[test]
#[ignore = "full: five pictures on a software adapter"]
fn back_ends_agree_on_hits_in_images() {
    let lamp = "[[light]]\nposition = [0, 3, 0]\nintensity = [9, 18, 27]\n";
    let ball = "[[object]]\nshape = { sphere = { radius = 0.4, divisions = 96 } }\ntranslate = [0, 0.62, 0]\n\
                refractor = { eta = 1.5, interfaces = 2 }\ncamera_visible = false\n";
    let water = "[[object]]\nshape = { water = { size = [4, 4], amplitude = 0.02 } }\ntranslate = [0, 1, 0]\n\
                 refractor = { eta = 1.33 }\ncamera_visible = false\n";
    let mirror = "[[object]]\nshape = { plane = { size = [6, 6] } }\nrotate_deg = [0, 0, -90]\ntranslate = [-1.5, 3, 0]\nreflector = {}\n";
    let lit = |caster: &str| above_floor(DARK, &format!("{lamp}{caster}"));
    let cases = [
        ("ball", lit(ball)),
        ("water", lit(water)),
        ("mirror", lit(mirror)),
        ("ring", pinspot::load("ring").unwrap().0),
    ];
    for (name, scene) in cases {
        // A quarter of them is as good where surfaces are smooth.
        for hits in [Hits::Image, Hits::QuarterImage].into_iter().take(1 + usize::from(name == "ball")) {
            let mut options = options(Mode::ExactPolygons, MapView::Eye);
            options.image_space.photons = 128;
            options.image_space.hits = hits;
            let error = compare(&format!("{name} {}", hits.name()), &scene, &options);
            assert!(error < 1e-2, "{name} {}: {error}", hits.name());
        }
    }
}

/// Receivers that lie behind others, in the sky over a pool: its deck, rails, walls, tiles and what is between these.
#[test]
#[ignore = "full: a large scene"]
fn back_ends_agree_on_receivers_behind_others() {
    let (pool, _) = pinspot::load("pool").unwrap();
    for mode in [Mode::ExactPolygons, Mode::MultiResolution] {
        let mut options = options(mode, MapView::Light);
        options.image_space.lights = 2;
        let error = compare(mode.name(), &pool, &options);
        assert!(error < 5e-3, "{}: {error}", mode.name());
    }
}

/// Clusters of photons: as many are followed and kept, up to those that rounding decides, and pictures agree.
#[test]
#[ignore = "full: a million photons in six modes"]
fn back_ends_agree_on_clusters() {
    let lamp = "[[light]]\nposition = [0.4, 3, 0.2]\nintensity = [9, 18, 27]\n";
    let lit = |fresnel: bool| {
        let ball =
            "shape = { sphere = { radius = 0.4, divisions = 96 } }\ntranslate = [0, 0.62, 0]\ncamera_visible = false\n";
        let glass = format!("refractor = {{ eta = 1.5, interfaces = 2, fresnel = {fresnel} }}\n");
        above_floor(DARK, &format!("{lamp}[[object]]\n{ball}{glass}"))
    };
    let mut of_maximal_level = u64::MAX;
    for (traversal, mode, map) in [
        (Traversal::MaximalLevel, Mode::Splats, MapView::Eye),
        (Traversal::Hierarchical, Mode::Splats, MapView::Eye),
        (Traversal::TexelError, Mode::Splats, MapView::Eye),
        (Traversal::TexelError, Mode::Footprints, MapView::Light),
        (Traversal::TexelError, Mode::Gather, MapView::Eye),
        (Traversal::TexelError, Mode::MultiResolution, MapView::Eye),
    ] {
        let mut options = options(mode, map);
        options.image_space.photons = 1024;
        options.image_space.traversal = traversal;
        let label = format!("{} {} {}", traversal.name(), mode.name(), map.name());
        // What is reflected is followed with splats.
        let of = |backend| render(lit(mode == Mode::Splats), options.clone(), &backend).unwrap();
        let [on_gpu, on_cpu] = [BackendChoice::Gpu(None), BackendChoice::Cpu].map(of);
        let error = difference(&on_gpu.layers[0].1, &on_cpu.layers[0].1);
        let [gpu, cpu] = [&on_gpu, &on_cpu].map(photons);
        let apart = |a: u64, b: u64| a.abs_diff(b) as f64 / b as f64;
        let (followed, kept) = (apart(gpu.photons, cpu.photons), apart(gpu.photons_used, cpu.photons_used));
        println!(
            "{label}: {error:.2e}; {} of {} photons, {followed:.1e} and {kept:.1e} apart; flux {:.1e}",
            gpu.photons_used,
            gpu.photons,
            gpu.flux.error()
        );
        assert!(error < if map == MapView::Eye { 2e-3 } else { 5e-3 }, "{label}: {error}");
        assert!(followed < 2e-3 && kept < 2e-3, "{label}: {followed} {kept}");
        assert!((gpu.flux.cast / cpu.flux.cast - 1.0).abs() < 1e-4 && gpu.flux.error().abs() < 1e-4, "{label}");
        // The texels of the light's own map are finer than the photons are dense.
        if traversal == Traversal::MaximalLevel {
            of_maximal_level = gpu.photons_used;
        } else if map == MapView::Eye {
            assert!(2 * gpu.photons_used < of_maximal_level, "{label}: {}", gpu.photons_used);
        }
    }
}

/// The nearest and the farthest surfaces side by side in one image are those in images of their own: with a second closed object, which is
/// too small to matter, light takes the same ways through the first one, up to rounding between vertices.
#[test]
#[ignore = "full: a comparison of fine images"]
fn images_in_halves_are_images_of_their_own() {
    let sun = "[[light]]\ndirectional = { direction = [0, 1, 0], irradiance = [1, 2, 3] }\n";
    let ball = |radius: f32, place: f32, eta: f32| {
        format!(
            "[[object]]\nshape = {{ sphere = {{ radius = {radius} }} }}\ntranslate = [{place}, 0.62, {place}]\n\
             refractor = {{ eta = {eta:?}, interfaces = 2 }}\ncamera_visible = false\n"
        )
    };
    // The second one turns no light.
    let (alone, second) = (ball(0.4, 0.0, 1.5), ball(0.01, 0.37, 1.0));
    let [mut alone, mut with_second] = [alone.clone(), format!("{alone}{second}")].map(|balls| {
        let mut options = options(Mode::ExactPolygons, MapView::Eye).with_aovs(vec![Aov::CausticTT]);
        options.image_space.photons = 128;
        options.image_space.hits = Hits::Image;
        let scene = above_floor(DARK, &format!("{sun}{balls}"));
        render(scene, options, &BackendChoice::Gpu(None)).unwrap().layers.remove(0).1
    });
    let [width, height] = [alone.width, alone.height].map(|size| size as f32);
    for (k, pixels) in alone.pixels.iter_mut().zip(&mut with_second.pixels).enumerate() {
        let place = Vec2::new(k as f32 % width / width, (k as f32 / width).floor() / height);
        // The picture shows two metres. What the second one lights is left out.
        if (2.0 * place - 1.0).distance(Vec2::splat(0.37)) < 0.1 {
            (*pixels.0, *pixels.1) = (Vec3::ZERO, Vec3::ZERO);
        }
    }
    let error = difference(&with_second, &alone);
    println!("{error:.1e}");
    // Rasterizers interpolate from the edge of an image, which rounds differently in its halves.
    assert!(alone.mean().x > 0.0 && error < 2e-3, "{error}");
}

/// Light through one closed object and another, by rays and in images of each, from directional light of some extent.
#[test]
#[ignore = "full: three pictures on a software adapter"]
fn back_ends_agree_on_two_closed_objects() {
    let sun = "[[light]]\ndirectional = { direction = [0.1, 1, 0.05], irradiance = [1, 2, 3], sigma_rad = 0.01 }\n";
    let ball = |x: f32, height: f32| {
        format!(
            "[[object]]\nshape = {{ sphere = {{ radius = 0.3 }} }}\ntranslate = [{x}, {height}, 0]\n\
             refractor = {{ eta = 1.3, interfaces = 2 }}\ncamera_visible = false\n"
        )
    };
    let lit = above_floor(DARK, &format!("{sun}{}{}", ball(0.0, 0.5), ball(0.1, 1.3)));
    for (hits, aov) in [(Hits::Traced, Aov::CausticTTTT), (Hits::Traced, Aov::Caustic), (Hits::Image, Aov::CausticTTTT)]
    {
        let mut options = options(Mode::ExactPolygons, MapView::Eye).with_aovs(vec![aov]);
        options.image_space.photons = 128;
        options.image_space.hits = hits;
        let error = compare(&format!("{} {}", hits.name(), aov.name()), &lit, &options);
        assert!(error < if hits == Hits::Traced { 2e-3 } else { 2e-2 }, "{} {}: {error}", hits.name(), aov.name());
    }
}

/// What glossy floors reflect of photons, by each way of telling from where they come.
#[test]
#[ignore = "full: three pictures on a software adapter"]
fn back_ends_agree_on_gloss() {
    let (ring, _) = pinspot::load("ring").unwrap();
    let glosses = [
        Gloss::Phong { specular: Vec3::splat(0.3), exponent: 20.0 },
        Gloss::Ggx { specular: Vec3::splat(0.2), roughness: 0.4 },
    ];
    for (gloss, incidence) in [(0, Incidence::Photon), (1, Incidence::Photon), (1, Incidence::Light)] {
        let mut lit = ring.clone();
        lit.objects
            .iter_mut()
            .filter_map(|object| object.receiver.as_mut())
            .for_each(|r| r.gloss = glosses[gloss].clone());
        let mut options = options(Mode::ExactPolygons, MapView::Eye).with_aovs(vec![Aov::Beauty]);
        options.image_space.incidence = incidence;
        let error = compare(&format!("gloss {gloss} {}", incidence.name()), &lit, &options);
        assert!(error < 2e-3, "gloss {gloss} {}: {error}", incidence.name());
    }
}

/// Averaged frames, and the equations of the paper.
#[test]
#[ignore = "full: three pictures on a software adapter"]
fn back_ends_agree_on_frames_and_on_the_papers_equations() {
    let (ring, _) = pinspot::load("ring").unwrap();
    for (mode, frames, paper) in [(Mode::Points, 3, false), (Mode::Polygons, 1, true), (Mode::Gather, 1, true)] {
        let mut options = options(mode, MapView::Eye);
        (options.image_space.temporal_frames, options.image_space.paper) = (frames, paper);
        let error = compare(&format!("{} of {frames} frames", mode.name()), &ring, &options);
        // Rounding decides which centres the smallest triangles cover, which are points otherwise.
        let limit = if mode == Mode::Polygons { 5e-3 } else { 2e-3 };
        assert!(error < limit, "{} of {frames} frames: {error}", mode.name());
    }
}

/// A lamp between the casters sends its photons through six faces of a cube.
#[test]
#[ignore = "full: two pictures through six faces on a software adapter"]
fn back_ends_agree_around_a_lamp() {
    let (mut ring, _) = pinspot::load("ring").unwrap();
    let lamp = above_floor(DARK, "[[light]]\nposition = [0.1, 0.2, 0]\nintensity = [9, 18, 27]\n");
    ring.environment = lamp.environment.clone();
    ring.lamps = lamp.lamps;
    for (mode, map) in [(Mode::ExactPolygons, MapView::Light), (Mode::Splats, MapView::Eye)] {
        let error = compare(&format!("{} {}", mode.name(), map.name()), &ring, &options(mode, map));
        // Maps of lights are looked up: a pixel at the edge of a texel may show the next one.
        assert!(error < if map == MapView::Eye { 2e-3 } else { 5e-3 }, "{} {}: {error}", mode.name(), map.name());
    }
}

#[test]
fn polygons_on_the_gpu_are_the_same_bits_every_time() {
    are_the_same_bits_every_time(&[Mode::ExactPolygons]);
}

#[test]
#[ignore = "full: more modes"]
fn splats_on_the_gpu_are_the_same_bits_every_time() {
    are_the_same_bits_every_time(&[Mode::Footprints, Mode::MultiResolution]);
}

/// Atomic sums in fixed point are the same bits every time.
fn are_the_same_bits_every_time(modes: &[Mode]) {
    let (ring, _) = pinspot::load("ring").unwrap();
    for mode in modes {
        let options = options(*mode, MapView::Eye).with_size([64, 48]);
        let [first, second] = [0; 2].map(|_| render(ring.clone(), options.clone(), &BackendChoice::Gpu(None)).unwrap());
        assert!(first.layers[0].1.pixels == second.layers[0].1.pixels, "{}", mode.name());
    }
}

/// A map that the adapter's buffers cannot hold is refused with its size and a way out.
#[test]
fn maps_that_do_not_fit_are_refused() {
    let (ring, _) = pinspot::load("ring").unwrap();
    let limit = gpu_backend().device().unwrap().limits().max_storage_buffer_binding_size;
    let mut large = options(Mode::MultiResolution, MapView::Light);
    large.image_space.caustic_map_size = 8192;
    assert!(8192 * 8192 * 4 * 24 > limit);
    match render(ring, large, &BackendChoice::Gpu(None)) {
        Err(Error::Gpu(error)) => {
            let message = error.to_string();
            assert!(message.contains("8192×8192") && message.contains("choose the CPU"), "{message}");
        }
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("a map of {limit} bytes is not refused"),
    }
}
