//! Previews beside whole pictures of the same samples: alike when they are still, and as calm when they move.

use std::sync::Mutex;

use pinspot::blocking::wait;
use pinspot::glam::{Mat3, Vec2, Vec3};
use pinspot::image::{Image, ToneMap, srgb8};
use pinspot::low_level::gpu::Gpu;
use pinspot::scene::{Camera, Scene};
use pinspot::wgpu;
use pinspot::{
    Backend, Detail, Engine, EvaluationChoice, Exposure, Mark, NoProgress, Overlay, Progress, Stage, Technique,
};

use crate::support::{gpu_backend, with_engine};

const SIZE: [u32; 2] = [120, 90];
const SAMPLES: u32 = 150;
const SHADOW_DIRECTIONS: u32 = 256;
/// Frames per second of the slow animations whose flicker is measured.
const RATE: f32 = 24.0;

fn engine(scene: &str) -> Engine {
    let (scene, options) = pinspot::load(scene).unwrap();
    let options = options.with_size(SIZE).with_samples(SAMPLES).with_evaluation(EvaluationChoice::Flat);
    Engine::new(scene, options, Backend::cpu())
}

fn preview(engine: &mut Engine, spacing: u32) -> Image {
    let detail = Detail {
        size: SIZE,
        samples: SAMPLES,
        taps: 16,
        spacing,
        shadow_directions: SHADOW_DIRECTIONS,
        reuses_light: false,
    };
    wait(None, engine.preview(&detail, &NoProgress)).unwrap().image
}

fn whole(engine: &mut Engine) -> Image {
    let display = engine.options().display;
    wait(None, engine.render(&NoProgress)).unwrap().displayed(&display)
}

/// The mean difference of two pictures, levels of 255.
fn difference(a: &Image, b: &Image) -> f64 {
    let levels = |image: &Image| image.pixels.iter().flat_map(|p| srgb8(*p)).collect::<Vec<u8>>();
    let (a, b) = (levels(a), levels(b));
    a.iter().zip(&b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

/// The number of pixels that change by many levels while all around them hardly do.
fn lone_jumps(a: &Image, b: &Image) -> usize {
    let [width, height] = SIZE.map(|edge| edge as i32);
    let change = |x: i32, y: i32| {
        let pixel = (y * width + x) as usize;
        let levels = srgb8(a.pixels[pixel]).into_iter().zip(srgb8(b.pixels[pixel]));
        levels.map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
    };
    let is_alone = |x: i32, y: i32| {
        let own = change(x, y);
        let around = (0..9).filter(|k| *k != 4).map(|k| change(x + k % 3 - 1, y + k / 3 - 1));
        own > 40 && around.max().unwrap_or(0) < own / 4
    };
    (1..height - 1).map(|y| (1..width - 1).filter(|x| is_alone(*x, y)).count()).sum()
}

/// Cheap pictures of a bare mirror, one with shadows, and one of lamps.
const FIRST: [&str; 3] = ["mirror-sphere", "columns", "candle"];

#[test]
fn previews_look_like_the_whole_picture() {
    look_like_the_whole_picture(|scene| FIRST.contains(&scene));
}

#[test]
#[ignore = "full: more scenes"]
fn previews_of_more_scenes_look_like_the_whole_picture() {
    look_like_the_whole_picture(|scene| !FIRST.contains(&scene));
}

/// What differs are edges seen in mirrors, which previews do not anti-alias (those of lamps in `varnish`), shadows by fewer directions, light
/// near mirrors, and caustics in the lobes of glossy receivers.
fn look_like_the_whole_picture(is_asked_for: fn(&str) -> bool) {
    let cases = [
        ("ring-natural", 1.8),
        ("columns", 1.8),
        ("mirror-sphere", 1.8),
        ("spoon", 1.8),
        ("sheet", 1.2),
        ("varnish", 10.0),
        ("candle", 4.0),
        ("colours", 4.0),
        ("haze", 6.0),
        ("underwater", 8.0),
    ];
    for (scene, most) in cases.into_iter().filter(|(scene, _)| is_asked_for(scene)) {
        let mut engine = engine(scene);
        let whole = whole(&mut engine);
        let [every, second, fourth] = [1, 2, 4].map(|spacing| difference(&preview(&mut engine, spacing), &whole));
        println!("{scene}: {every:.2} levels in every pixel, {second:.2} at spacing 2, {fourth:.2} at spacing 4");
        assert!(every < most, "{scene}: {every}");
        // Beams in the air are narrow for rays so far apart.
        let most = if scene == "haze" { 8.0 } else { 1.6 };
        assert!(fourth < every + most, "{scene}: interpolation adds {every} → {fourth}");
    }
}

#[test]
fn previews_by_photons_look_like_the_whole_picture() {
    look_like_the_whole_picture_by_photons(&[Backend::cpu()], Some(256));
}

#[test]
#[ignore = "full: as many photons as by default, on both back ends"]
fn previews_by_many_photons_look_like_the_whole_picture() {
    look_like_the_whole_picture_by_photons(&[Backend::cpu(), gpu_backend()], None);
}

/// Photons light previews, too: fewer of them, added on the CPU whatever the back end.
fn look_like_the_whole_picture_by_photons(backends: &[Backend], photons: Option<u32>) {
    for backend in backends {
        let (scene, options) = pinspot::load("ring").unwrap();
        let mut options = options.with_size(SIZE).with_technique(Technique::ImageSpace);
        options.image_space.photons = photons.unwrap_or(options.image_space.photons);
        let display = options.display;
        let mut engine = Engine::new(scene, options, backend.clone());
        let detail = Detail {
            size: SIZE,
            samples: SAMPLES,
            taps: 16,
            spacing: 1,
            shadow_directions: SHADOW_DIRECTIONS,
            reuses_light: false,
        };
        let preview = wait(backend.device(), engine.preview(&detail, &NoProgress)).unwrap().image;
        let whole = wait(backend.device(), engine.render(&NoProgress)).unwrap().displayed(&display);
        let difference = difference(&preview, &whole);
        println!("{backend:?}: {difference:.2}");
        assert!(difference < 3.0, "{difference}");
    }
}

#[test]
fn previews_do_not_flicker() {
    do_not_flicker(&["mirror-sphere"]);
}

#[test]
#[ignore = "full: more scenes"]
fn previews_of_more_scenes_do_not_flicker() {
    do_not_flicker(&["ring-natural", "columns"]);
}

/// From frame to frame of a slow motion, a preview changes hardly more than the whole picture does.
fn do_not_flicker(scenes: &[&str]) {
    for &scene in scenes {
        let mut engine = engine(scene);
        let (mut changes, mut jumps) = ([0.0; 2], [0; 2]);
        let mut last: Option<[Image; 2]> = None;
        for frame in 0..4 {
            engine.scene_mut().pose(0.2 + frame as f32 / RATE);
            let pictures = [preview(&mut engine, 3), whole(&mut engine)];
            if let Some(last) = &last {
                (0..2).for_each(|k| changes[k] += difference(&pictures[k], &last[k]));
                (0..2).for_each(|k| jumps[k] += lone_jumps(&pictures[k], &last[k]));
            }
            last = Some(pictures);
        }
        let [preview, whole] = changes;
        println!(
            "{scene}: {preview:.2} levels of change in previews, {whole:.2} in whole pictures, lone jumps {jumps:?}"
        );
        assert!(preview < 1.2 * whole + 0.1, "{scene}: {preview} against {whole}");
        // Edges in mirrors are not anti-aliased: 3 of 10,000 pixels may.
        let most = jumps[1] + (3 * SIZE[0] * SIZE[1]) as usize * 3 / 10_000;
        assert!(jumps[0] <= most, "{scene}: {jumps:?} pixels jump alone");
    }
}

#[test]
fn previews_equal_those_of_a_new_engine() {
    equal_those_of_a_new_engine(&["columns"]);
}

#[test]
#[ignore = "full: a scene of many kinds of objects"]
fn previews_of_all_kinds_of_objects_equal_those_of_a_new_engine() {
    equal_those_of_a_new_engine(&["dynamic"]);
}

/// The picture does not depend on what was shown before: nothing is left of it in what is kept.
fn equal_those_of_a_new_engine(scenes: &[&str]) {
    for backend in [Backend::cpu(), gpu_backend()] {
        for &scene in scenes {
            let new = || {
                let (scene, options) = pinspot::load(scene).unwrap();
                Engine::new(scene, options.with_size([48, 36]), backend.clone())
            };
            let preview = |engine: &mut Engine, spacing| {
                let detail = Detail {
                    size: [48, 36],
                    samples: 60,
                    taps: 8,
                    spacing,
                    shadow_directions: 16,
                    reuses_light: false,
                };
                wait(backend.device(), engine.preview(&detail, &NoProgress)).unwrap().image
            };
            let mut moved = new();
            for (seconds, spacing) in [(0.0, 3), (0.5, 3), (1.0, 4)] {
                moved.scene_mut().pose(seconds);
                preview(&mut moved, spacing);
            }
            // Mirrors keep the samples that they got first.
            let mut new = new();
            preview(&mut new, 4);
            new.scene_mut().pose(1.0);
            assert_eq!(preview(&mut moved, 3), preview(&mut new, 3), "{scene}");
        }
    }
}

#[test]
fn light_is_kept_while_the_camera_moves() {
    keep_light_while_the_camera_moves(&["ring-natural"]);
}

#[test]
#[ignore = "full: near light, and what lies behind an interface"]
fn light_is_kept_in_more_scenes_while_the_camera_moves() {
    keep_light_while_the_camera_moves(&["candle", "pool"]);
}

/// Where only the camera has moved since the last whole picture, a preview of few samples is nearly as good as that.
fn keep_light_while_the_camera_moves(scenes: &[&str]) {
    for &name in scenes {
        let (scene, options) = pinspot::load(name).unwrap();
        let size = [60, 45];
        let options = options.with_size(size);
        let detail = Detail { size, samples: 60, taps: 8, spacing: 2, shadow_directions: 16, reuses_light: true };
        let show = |engine: &mut Engine| wait(None, engine.preview(&detail, &NoProgress)).unwrap().image;
        let new = || Engine::new(scene.clone(), options.clone(), Backend::cpu());
        let turned = |engine: &mut Engine| {
            let turn = Mat3::from_rotation_y(0.05);
            let Camera { position, forward, right, up, .. } = &mut engine.scene_mut().camera;
            for vector in [position, forward, right, up] {
                *vector = turn * *vector;
            }
        };
        let (mut rested, mut fresh) = (new(), new());
        whole(&mut rested);
        turned(&mut rested);
        turned(&mut fresh);
        let kept = show(&mut rested);
        let expected = whole(&mut fresh);
        let [kept, few] = [kept, show(&mut new_at(&fresh))].map(|image| difference(&image, &expected));
        println!("{name}: {kept:.2} levels, by few samples {few:.2}");
        assert!(kept < 0.5 * few, "{name}: {kept} {few}");
        // It is another light now.
        for engine in [&mut rested, &mut fresh] {
            engine.scene_mut().environment.rotation_rad += 0.3;
        }
        assert_eq!(show(&mut rested), show(&mut new_at(&fresh)), "{name}");
        for engine in [&mut rested, &mut fresh] {
            engine.scene_mut().environment.rotation_rad -= 0.3;
            engine.options_mut().samples /= 2;
        }
        assert_eq!(show(&mut rested), show(&mut new_at(&fresh)), "{name}: other samples");
    }
}

/// A new engine for the same picture.
fn new_at(engine: &Engine) -> Engine {
    Engine::new(engine.scene().clone(), engine.options().clone(), Backend::cpu())
}

/// What the quick run compares: a mirror in natural light, one that lights itself, and near emitters.
const COMPARED_FIRST: [&str; 3] = ["ring-natural", "cup", "candle"];

/// Passes on a GPU show what the CPU does, at any spacing and in the middle of animations; so do the exposures that they meter.
#[test]
fn both_back_ends_render_the_same_previews() {
    previews_are_the_same(|name| COMPARED_FIRST.contains(&name));
}

#[test]
#[ignore = "full: all other scenes"]
fn both_back_ends_render_the_same_previews_of_all_other_scenes() {
    previews_are_the_same(|name| !COMPARED_FIRST.contains(&name));
}

fn previews_are_the_same(is_asked_for: fn(&str) -> bool) {
    let backends = [Backend::cpu(), gpu_backend()];
    let scenes = pinspot::scene::BUILT_IN.iter().map(|scene| scene.name).enumerate();
    for (k, name) in scenes.filter(|(_, name)| is_asked_for(name)) {
        let spacing = 1 + k as u32 % 4;
        let is_metered = k % 3 == 2;
        let has_medium = ["haze", "underwater"].contains(&name);
        let (size, samples) = if has_medium { ([32, 24], 30) } else { ([56, 42], 60) };
        let detail = Detail { size, samples, taps: 8, spacing, shadow_directions: 32, reuses_light: false };
        let [cpu, gpu] = backends.each_ref().map(|backend| {
            with_engine(name, backend, |engine| {
                let options = engine.options_mut();
                if is_metered {
                    options.display.exposure = Exposure::Auto;
                }
                options.display.tone_map = ToneMap::ALL[k % 3];
                options.size = size;
                // Not only the first frame: what is kept on a GPU follows.
                let frames = [0.0, 0.4].map(|seconds| {
                    engine.scene_mut().pose(seconds);
                    wait(backend.device(), engine.preview(&detail, &NoProgress)).unwrap()
                });
                let [_, last] = frames;
                last
            })
        });
        let pairs = || cpu.image.pixels.iter().zip(&gpu.image.pixels).map(|(a, b)| (*a - *b).abs().max_element());
        let mean = pairs().sum::<f32>() / cpu.image.pixels.len() as f32;
        let off = pairs().filter(|difference| *difference > 0.05).count();
        println!("{name}: {mean:.5} on average at spacing {spacing}, {off} pixels differ, {:?}", gpu.exposures);
        let [cpu_ev, gpu_ev] = [&cpu, &gpu].map(|preview| preview.exposures.exposure_ev);
        // A GPU's visibility maps are finer, which shows where something is close to a mirror or an interface.
        let has_close_shadows = ["candle", "underwater"].contains(&name);
        let most = if has_close_shadows { 0.03 } else { 0.01 };
        assert!((cpu_ev - gpu_ev).abs() < most, "{name}: {cpu_ev} {gpu_ev}");
        // The median's pixel may be another one.
        let most = match is_metered {
            _ if has_close_shadows => 6e-3,
            true => 2e-3,
            false => 1e-3,
        };
        assert!(mean < most, "{name}: {mean}");
        // Edges of shadows and of what mirrors show, by rays that graze them.
        let one_of = if has_close_shadows { 100 } else { 200 };
        assert!(off * one_of < cpu.image.pixels.len(), "{name}: {off}");
        assert!(gpu.passes.iter().all(|pass| (0.0..10.0).contains(&pass.seconds)), "{name}: {:?}", gpu.passes);
        assert_eq!((cpu.samples, cpu.evaluation), (gpu.samples, gpu.evaluation), "{name}");
    }
}

/// What stays on the device is what is read back, as the eye sees it.
#[test]
fn previews_that_stay_on_the_device_are_the_same() {
    let own = wait(None, Gpu::open(None)).unwrap();
    let (device, queue) = (own.device.clone(), own.queue.clone());
    let backend = Backend::gpu(own);
    let (scene, options) = pinspot::load("mirror-sphere").unwrap();
    let mut engine = Engine::new(scene, options.with_size(SIZE), backend);
    let detail = Detail { size: SIZE, samples: 60, taps: 8, spacing: 4, shadow_directions: 32, reuses_light: false };
    let read_back = wait(Some(&device), engine.preview(&detail, &NoProgress)).unwrap();
    let kept = wait(Some(&device), engine.preview_on_device(&detail, &NoProgress)).unwrap().unwrap();
    assert_eq!((kept.samples, kept.exposures), (read_back.samples, read_back.exposures));
    let shown = read_bytes(&device, &queue, kept.image.texture());
    assert_eq!(shown.len(), read_back.image.pixels.len());
    let differ = |(shown, pixel): (&[u8; 4], &Vec3)| (0..3).any(|k| shown[k].abs_diff(srgb8(*pixel)[k]) > 1);
    let off = shown.iter().zip(&read_back.image.pixels).filter(|pair| differ(*pair)).count();
    assert_eq!(off, 0);
    let mut on_cpu = Engine::new(engine.scene().clone(), engine.options().clone(), Backend::cpu());
    assert!(wait(None, on_cpu.preview_on_device(&detail, &NoProgress)).unwrap().is_none());
}

fn read_bytes(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Vec<[u8; 4]> {
    let row = (4 * texture.width()).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * texture.height()),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = buffer.get_mapped_range(..).unwrap().to_vec();
    let texels = |row: &[u8]| row[..4 * texture.width() as usize].as_chunks().0.to_vec();
    bytes.chunks(row as usize).flat_map(texels).collect()
}

/// Where 32-bit textures do not blend, sums of one layer and frame do not reach the next.
#[test]
#[ignore = "full: pipelines of another device on a software adapter"]
fn previews_need_no_more_than_every_device_has() {
    let backends = [Backend::gpu(wait(None, Gpu::open_minimal()).unwrap()), gpu_backend()];
    // Emitters are drawn into cube maps of halves there.
    for scene in ["mirror-sphere", "dynamic"] {
        let [minimal, blending] = backends.each_ref().map(|backend| {
            let (scene, options) = pinspot::load(scene).unwrap();
            let mut engine = Engine::new(scene, options.with_size([64, 48]), backend.clone());
            let detail =
                Detail { size: [64, 48], samples: 300, taps: 8, spacing: 2, shadow_directions: 8, reuses_light: false };
            [0, 1].map(|_| wait(backend.device(), engine.preview(&detail, &NoProgress)).unwrap().image)
        });
        for (minimal, blending) in minimal.iter().zip(&blending) {
            let levels = difference(minimal, blending);
            assert!(levels < 0.3, "{scene}: {levels}");
        }
    }
}

/// The stages that were made.
#[derive(Default)]
struct MadeStages(Mutex<Vec<Stage>>);

impl Progress for MadeStages {
    fn begin(&self, stage: Stage, _: u64) {
        self.0.lock().unwrap().push(stage);
    }

    fn advance(&self, _: u64) {}

    fn end(&self, _: Stage) {}
}

/// Samples are not placed anew on a mirror that moves, and move with it: a camera that does the same sees them where they were.
#[test]
fn mirrors_keep_their_samples_while_they_move() {
    let mut engine = engine("spoon");
    engine.options_mut().overlay = Overlay::Samples;
    let detail =
        Detail { size: SIZE, samples: SAMPLES, taps: 4, spacing: 8, shadow_directions: 16, reuses_light: false };
    let mut preview = |change: &dyn Fn(&mut Scene)| {
        change(engine.scene_mut());
        let stages = MadeStages::default();
        let preview = wait(None, engine.preview(&detail, &stages)).unwrap();
        let dot = |mark: &Mark| if let Mark::Dot(at) = mark { *at } else { panic!("{mark:?}") };
        (preview.marks.iter().map(dot).collect::<Vec<Vec2>>(), stages.0.into_inner().unwrap())
    };
    let (before, stages) = preview(&|_| {});
    assert!(stages.contains(&Stage::Points));
    let (turn, step) = (Mat3::from_rotation_y(0.7), Vec3::new(0.3, 0.05, -0.2));
    let (moved, stages) = preview(&|scene| {
        let mirror = scene.objects.iter_mut().find(|object| object.reflector.is_some()).unwrap();
        mirror.placement = mirror.placement.turned(Vec3::Y, 0.7);
        mirror.placement.translate = turn * mirror.placement.translate + step;
        let Camera { position, forward, right, up, .. } = &mut scene.camera;
        *position = turn * *position + step;
        for axis in [forward, right, up] {
            *axis = turn * *axis;
        }
    });
    assert!(!stages.contains(&Stage::Points), "{stages:?}");
    // One at a silhouette may be seen or not.
    let is_there = |dot: &&Vec2| before.iter().any(|other| other.distance(**dot) < 0.02);
    let found = moved.iter().filter(is_there).count();
    assert!(found > 50 && found + 2 >= before.len().max(moved.len()), "{found} of {}, {}", before.len(), moved.len());
    // Another size is another surface.
    let (_, stages) = preview(&|scene| scene.objects.iter_mut().for_each(|object| object.placement.scale *= 1.5));
    assert!(stages.contains(&Stage::Points));
}

/// A receiver without a diffuse part shows its lobe.
#[test]
fn lobes_alone_are_seen() {
    for backend in [Backend::cpu(), gpu_backend()] {
        let (mut scene, options) = pinspot::load("varnish").unwrap();
        let table = scene.objects.iter_mut().find_map(|object| object.receiver.as_mut()).unwrap();
        table.albedo = Vec3::ZERO;
        let mut engine = Engine::new(scene, options.with_size([32, 24]), backend.clone());
        let detail =
            Detail { size: [32, 24], samples: 20, taps: 4, spacing: 2, shadow_directions: 16, reuses_light: false };
        let preview = wait(backend.device(), engine.preview(&detail, &NoProgress)).unwrap();
        let corner = preview.image.pixels.last().unwrap();
        assert!(corner.min_element() > 0.1, "{corner}");
    }
}
