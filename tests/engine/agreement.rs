//! GPU against CPU, batches against one submission, and the same bits twice.

use pinspot::blocking::wait;
use pinspot::image::Aov;
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::pinhole::gpu::GatherOptions;
use pinspot::low_level::pinhole::{BATCH_SIZE, Filter, Footprint, Params, PinholeSample, Pinholes, Receivers};
use pinspot::low_level::sampling::Strategy;
use pinspot::{
    Backend, BackendChoice, BackendReport, CubeSize, DisplaySettings, EvaluationChoice, FilterChoice, Options, Rendered,
};

use crate::support::{
    self, floor, gpu, gpu_backend, on_cpu, on_gpu, on_gpu_with, pinholes_of, prepared, rel_l2, rotated_light, scene,
};

/// A number of samples that is not a whole number of batches.
const MORE_THAN_A_BATCH: u32 = BATCH_SIZE + 77;

/// What the pictures of this module have in common: few samples, one by one.
fn set(options: &mut Options, aovs: &[Aov], filter: FilterChoice) {
    options.size = [48, 36];
    options.samples = 100;
    options.cube_size = CubeSize::Texels(128);
    options.evaluation = EvaluationChoice::Flat;
    options.aovs = aovs.to_vec();
    options.filter = filter;
}

/// A built-in scene's picture on a back end.
fn picture(
    name: &str,
    backend: &Backend,
    aovs: &[Aov],
    filter: FilterChoice,
    change: impl FnOnce(&mut Options),
) -> Rendered {
    support::with_engine(name, backend, |engine| {
        set(engine.options_mut(), aovs, filter);
        change(engine.options_mut());
        support::render_again(engine).unwrap()
    })
}

#[test]
fn back_ends_agree_on_telling_scenes() {
    back_ends_agree(support::is_telling);
}

#[test]
#[ignore = "full: all other scenes"]
fn back_ends_agree_on_all_other_scenes() {
    back_ends_agree(|name| !support::is_telling(name));
}

fn back_ends_agree(is_asked_for: fn(&str) -> bool) {
    let mut failures = Vec::new();
    // Other filters and several batches on some scenes only, in turn.
    let others = [Some(FilterChoice::None), None, None, Some(FilterChoice::Isotropic), None, None];
    let scenes = support::clear_scenes().zip(others.into_iter().cycle());
    for (scene, other) in scenes.filter(|(scene, _)| is_asked_for(scene)) {
        for filter in other.into_iter().chain([FilterChoice::Anisotropic]) {
            let [on_gpu, on_cpu] = [gpu_backend(), Backend::cpu()].map(|backend| {
                picture(scene, &backend, &[Aov::Caustic], filter, |options| {
                    if other.is_some() {
                        options.samples = MORE_THAN_A_BATCH;
                    }
                })
            });
            assert!(matches!(on_gpu.report.backend, BackendReport::Gpu { .. }));
            let [gpu, cpu] = [&on_gpu, &on_cpu].map(|r| r.layer(Aov::Caustic).unwrap());
            assert!(cpu.mean().x > 0.0, "{scene}: no caustic at all");
            let error = pinspot::image::rel_l2(gpu, cpu, None);
            println!("{scene:16} {filter:?}: {error:.2e}");
            // Rays of the visibility maps that pass an edge closely may meet it on one back end only; emitters have sharp edges, too.
            let has_emitters = prepared(scene).scene.objects.iter().any(|object| object.emitter.is_some());
            if error > if has_emitters { 5e-3 } else { 3e-3 } {
                failures.push(format!("{scene} {filter:?}: {error}"));
            }
            let fetches = (on_gpu.report.lookups, on_cpu.report.lookups);
            assert!((fetches.0 / fetches.1 - 1.0).abs() < 1e-2, "{scene}: fetches {fetches:?}");
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// One scene for each kind of surface and light: their caustics are compared above.
const SHADED: [&str; 8] = ["still-life", "cup", "pool", "dynamic", "columns", "gloss", "varnish", "candle"];

/// What the quick run looks at: a mirror that lights itself, and one in the light of near emitters.
const FIRST_SHADED: [&str; 2] = ["cup", "candle"];

#[test]
fn back_ends_agree_on_the_beauty_of_telling_scenes() {
    back_ends_agree_on_beauty(|name| FIRST_SHADED.contains(&name));
}

#[test]
#[ignore = "full: all other scenes"]
fn back_ends_agree_on_the_beauty_of_other_scenes() {
    back_ends_agree_on_beauty(|name| !FIRST_SHADED.contains(&name));
}

/// On a GPU the rays of the camera, of paths and of shadows are traced there, too; pictures are those of the CPU, up to rays that graze
/// edges.
fn back_ends_agree_on_beauty(is_asked_for: fn(&str) -> bool) {
    let mut failures = Vec::new();
    for scene in SHADED.into_iter().filter(|name| is_asked_for(name)) {
        let [gpu, cpu] = [gpu_backend(), Backend::cpu()].map(|backend| {
            picture(scene, &backend, &[Aov::Beauty], FilterChoice::Anisotropic, |options| options.size = [32, 24])
                .displayed(&prepared(scene).options.display)
        });
        let differences = gpu.pixels.iter().zip(&cpu.pixels).map(|(a, b)| (*a - *b).abs().max_element());
        let mean = differences.clone().sum::<f32>() / cpu.pixels.len() as f32;
        let off = differences.filter(|difference| *difference > 0.05).count();
        println!("{scene:16} {mean:.1e} on average, {off} pixels differ");
        if mean > 1e-3 || off * 200 > cpu.pixels.len() {
            failures.push(format!("{scene}: {mean} on average, {off} pixels"));
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    gives_the_same_bits(&[BackendChoice::Cpu]);
}

#[test]
#[ignore = "full: every layer on a software adapter"]
fn the_same_seed_gives_the_same_bits_on_the_gpu() {
    gives_the_same_bits(&[BackendChoice::Gpu(None)]);
}

fn gives_the_same_bits(backends: &[BackendChoice]) {
    for backend in backends {
        let aovs = [Aov::Beauty, Aov::Caustic, Aov::Direct, Aov::Normal, Aov::Depth];
        let [one, two] = [1, 2].map(|_| {
            let (scene, mut options) = pinspot::load("cup").unwrap();
            set(&mut options, &aovs, FilterChoice::Anisotropic);
            support::render(scene, options, backend).unwrap()
        });
        assert_eq!(one.layers, two.layers, "{backend:?}");
        let settings = DisplaySettings::default();
        assert_eq!(one.displayed(&settings), two.displayed(&settings));
    }
}

struct Case {
    receivers: Receivers,
    pinholes: Pinholes,
    cube: CubeMap,
}

fn two_sided_ring() -> Case {
    let ring = scene(
        "[[object]]\nshape = { ring = { radius = 0.5, height = 0.3 } }\nreflector = { sides = \"both\", reflectance = [0.9, 0.5, 0.1] }\n",
    );
    let pinholes = pinholes_of(&ring, 900, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(64, None, |d| glam::Vec3::new(1.0 + d.x, 2.0 + d.y, (9.0 * d.z).sin().abs()));
    Case { receivers: floor(3.0, 33), pinholes, cube }
}

#[test]
fn ping_pong_and_ranges_of_batches_give_what_one_blended_draw_gives() {
    let Case { receivers, pinholes, cube } = two_sided_ring();
    let params = Params::default();
    let whole = on_gpu(&receivers, &pinholes, &cube, &params);
    for (force_ping_pong, step) in [(false, 1), (true, 1), (true, u32::MAX)] {
        let options = GatherOptions { filter: params.filter, force_ping_pong, ..Default::default() };
        let parts = on_gpu_with(&receivers, &pinholes, &cube, &params, &options, step);
        let error = rel_l2(&parts, &whole);
        assert!(error < 1e-6, "ping-pong {force_ping_pong}, step {step}: {error}");
    }
}

/// A quarter turn maps the cube's texels onto each other: rotating the look-ups is rotating the light.
#[test]
fn a_rotated_environment_is_the_rotated_light() {
    let Case { receivers, pinholes, .. } = two_sided_ring();
    let turn = std::f32::consts::FRAC_PI_2;
    let (light, rotated) = (rotated_light(0.0), rotated_light(turn));
    for filter in [Filter::None, Filter::Isotropic, Filter::Anisotropic, Filter::Ewa] {
        let params = Params { filter, ..Default::default() };
        let expected = on_gpu(&receivers, &pinholes, &rotated, &params);
        let change = rel_l2(&on_gpu(&receivers, &pinholes, &light, &params), &expected);
        let params = Params { environment_rotation_rad: turn, ..params };
        let error = rel_l2(&on_gpu(&receivers, &pinholes, &light, &params), &expected);
        assert!(error < 1e-3 && change > 0.05, "{filter:?}: {error}, {change} without the rotation");
    }
}

/// A thin sheet that reflects on both sides is its front and its back together.
#[test]
fn two_sided_reflectors_reflect_on_both_sides() {
    let Case { receivers, pinholes, cube } = two_sided_ring();
    let params = Params::default();
    let turned = |sign: f32| -> Pinholes {
        let turn = |v: [f32; 3]| v.map(|c| sign * c);
        let one = |s: &PinholeSample| PinholeSample {
            normal: turn(s.normal),
            // One side alone.
            object_flags: s.object_flags & !2,
            change_1: turn(s.change_1),
            change_2: turn(s.change_2),
            ..*s
        };
        pinholes.samples.iter().map(one).collect::<Vec<_>>().into()
    };
    let both = on_cpu(&receivers, &pinholes, &cube, &params);
    let [front, back] = [1.0, -1.0].map(|sign| on_cpu(&receivers, &turned(sign), &cube, &params));
    let sum: Vec<[f32; 4]> = front.iter().zip(&back).map(|(f, b)| [0, 1, 2, 3].map(|c| f[c] + b[c])).collect();
    assert!(back.iter().any(|b| b[0] > 0.0));
    assert!(rel_l2(&sum, &both) < 1e-5, "{}", rel_l2(&sum, &both));
    assert!(rel_l2(&on_gpu(&receivers, &pinholes, &cube, &params), &both) < 1e-5);
}

/// The run says so where the hardware filter is wrong, and such an adapter (lavapipe) is known to be. Where it is right it
/// shows what the anisotropic one of the CPU does, and where it is wrong the picture is visibly so.
#[test]
fn a_wrong_hardware_filter_is_reported() {
    let verdict = wait(Some(&gpu().device), pinspot::low_level::pinhole::gpu::check_hardware_filter(gpu())).unwrap();
    let render = |backend: Backend, filter: FilterChoice| {
        picture("mirror-sphere", &backend, &[Aov::Caustic], filter, |options| options.samples = MORE_THAN_A_BATCH)
    };
    let rendered = render(gpu_backend(), FilterChoice::Hardware);
    let warned = rendered.report.warnings.iter().any(|w| w.contains("hardware filter"));
    assert_eq!(warned, !verdict.is_right(), "{verdict:?}");
    let expected = render(Backend::cpu(), FilterChoice::Anisotropic);
    let [own, expected] = [&rendered, &expected].map(|r| r.layer(Aov::Caustic).unwrap());
    let (error, light) = (pinspot::image::rel_l2(own, expected, None), own.mean().x / expected.mean().x);
    println!("{}: off by {error:.3}, {light:.4} of the light", gpu().adapter);
    assert_eq!(error < 0.05 && (light - 1.0).abs() < 0.02, verdict.is_right(), "{error}, {light} of the light");
    if gpu().adapter.name.contains("llvmpipe") {
        assert!(!verdict.is_right(), "lavapipe has learnt to filter: {verdict:?}");
    }
}
