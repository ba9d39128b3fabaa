//! The engine's stages: an edit makes only those again that depend on it, and the picture is that of a new engine.

use std::fmt::Write;
use std::sync::Arc;

use glam::Vec3;
use pinspot::Stage::{
    self, Bvh, Caustic, Differentials, Direct, Display, Estimate, Geometry, Irradiance, Light, LightBounds,
    LightSampler, Materials, PathEnds, Paths, Points, Rays, Shading, Surface, Tree, Upload,
};
use pinspot::blocking::wait;
use pinspot::image::Aov;
use pinspot::low_level::environment::CubeSize;
use pinspot::scene::{Mesh, Visibility};
use pinspot::{Backend, BackendChoice, Engine, EvaluationChoice, Exposure, NoProgress, Options, Rendered, StageCounts};

use crate::support::gpu_backend;

/// What an edit of the engine is, and the stages that depend on it.
struct Edit {
    name: &'static str,
    apply: fn(&mut Engine),
    makes: &'static [&'static [Stage]],
}

impl Edit {
    /// Whether the stage depends on what is edited.
    fn makes(&self, stage: Stage) -> bool {
        self.makes.iter().any(|group| group.contains(&stage))
    }
}

/// What a mirror's shape or place changes.
const MIRRORS: &[Stage] = &[Surface, Points, Tree];
/// What any object's shape or place changes.
const OBJECTS: &[Stage] = &[Geometry, Bvh, Stage::Visibility, Upload];
/// What other samples change.
const SAMPLES: &[Stage] = &[Points, Tree, Stage::Visibility, Upload, Estimate];
/// What another view of the scene changes.
const VIEW: &[Stage] = &[Estimate, Rays, Direct, Paths];
/// What is made of the light alone.
const LIGHT: &[Stage] = &[Light, LightBounds, Irradiance, LightSampler, Upload];
/// The sum over the samples, at what the camera sees and at the ends of paths.
const SUM: &[Stage] = &[Caustic, PathEnds];
/// What every change of the radiance changes.
const PICTURE: &[Stage] = &[Shading, Display];

/// The scene's mirror and what it lights, by their places in the list of objects.
const MIRROR: usize = 0;
const TABLE: usize = 1;

const EDITS: &[Edit] = &[
    Edit { name: "nothing", apply: |_| (), makes: &[] },
    Edit { name: "exposure", apply: |e| e.options_mut().display.exposure = Exposure::Stops(1.5), makes: &[&[Display]] },
    Edit { name: "caustic gain", apply: |e| e.options_mut().caustic_gain = 2.0, makes: &[PICTURE] },
    Edit { name: "scale the light", apply: |e| e.scene_mut().environment.intensity = 3.0, makes: &[PICTURE] },
    Edit {
        name: "rotate the light",
        apply: |e| e.scene_mut().environment.rotation_rad = 0.7,
        makes: &[&[Estimate, Direct], SUM, PICTURE],
    },
    Edit {
        name: "another map",
        apply: |e| e.scene_mut().environment.light = pinspot::scene::Light::BuiltInMap("studio".into()),
        makes: &[LIGHT, &[Estimate, Direct], SUM, PICTURE],
    },
    Edit { name: "tolerance", apply: |e| e.options_mut().tolerance = 0.05, makes: &[SUM, PICTURE] },
    Edit { name: "taps", apply: |e| e.options_mut().taps = 4, makes: &[&[Estimate], SUM, PICTURE] },
    Edit { name: "number of samples", apply: |e| e.options_mut().samples = 70, makes: &[SAMPLES, SUM, PICTURE] },
    Edit { name: "seed", apply: |e| e.options_mut().seed = 9, makes: &[SAMPLES, SUM, PICTURE] },
    Edit { name: "move the camera", apply: |e| e.scene_mut().camera.position.x += 0.05, makes: &[VIEW, SUM, PICTURE] },
    Edit {
        name: "move the table",
        apply: |e| e.scene_mut().objects[TABLE].placement.translate.x += 0.1,
        makes: &[OBJECTS, VIEW, SUM, PICTURE],
    },
    Edit {
        name: "turn the mirror",
        apply: |e| e.scene_mut().objects[MIRROR].placement.rotate_rad.y += 0.3,
        makes: &[OBJECTS, MIRRORS, VIEW, SUM, PICTURE],
    },
    Edit {
        name: "deform the mirror",
        apply: |e| {
            let object = &mut e.scene_mut().objects[MIRROR];
            object.mesh = Arc::new(stretched(&object.mesh));
        },
        makes: &[OBJECTS, MIRRORS, VIEW, SUM, PICTURE],
    },
    Edit {
        name: "the table's albedo",
        apply: |e| e.scene_mut().objects[TABLE].receiver.as_mut().unwrap().albedo = Vec3::new(0.2, 0.4, 0.1),
        makes: &[&[Materials, Paths, PathEnds], PICTURE],
    },
    Edit {
        name: "every sample for every receiver",
        apply: |e| (e.options_mut().evaluation, e.options_mut().leaves) = (EvaluationChoice::Flat, None),
        makes: &[&[Differentials, Stage::Visibility], SUM, PICTURE],
    },
];

fn stretched(mesh: &Mesh) -> Mesh {
    let positions = mesh.positions().iter().map(|p| *p * Vec3::new(1.2, 1.0, 0.9)).collect();
    let normals = mesh.normals().iter().map(|n| *n / Vec3::new(1.2, 1.0, 0.9)).collect();
    Mesh::new("stretched", positions, normals, mesh.triangles().to_vec()).unwrap().0
}

fn engine(backend: &Backend) -> Engine {
    let (scene, options) = pinspot::load("ring-natural").unwrap();
    assert!(scene.objects[MIRROR].reflector.is_some() && scene.objects[TABLE].receiver.is_some());
    let aovs = vec![Aov::Beauty, Aov::Caustic, Aov::Direct, Aov::Depth];
    let options = options.with_size([32, 24]).with_samples(60).with_leaves(Some(16)).with_aovs(aovs);
    let options = options.with_cube_size(CubeSize::Texels(64));
    Engine::new(scene, options, backend.clone())
}

fn render(engine: &mut Engine) -> Rendered {
    let backend = engine.backend().clone();
    wait(backend.device(), engine.render(&NoProgress)).unwrap()
}

/// The same scene and options in a new engine.
fn afresh(engine: &Engine) -> Rendered {
    render(&mut Engine::new(engine.scene().clone(), engine.options().clone(), engine.backend().clone()))
}

#[test]
fn an_edit_makes_only_what_depends_on_it() {
    let backend = Backend::cpu();
    let mut engine = engine(&backend);
    render(&mut engine);
    let mut table = format!("| edit | {} |\n", Stage::ENGINE.map(Stage::name).join(" | "));
    let mut failures = Vec::new();
    for edit in EDITS {
        let name = edit.name;
        let before = engine.stage_counts();
        (edit.apply)(&mut engine);
        let edited = render(&mut engine);
        let made = engine.stage_counts().made_since(&before);
        let marks = Stage::ENGINE.map(|stage| if made.contains(&stage) { "●" } else { "" });
        writeln!(table, "| {name} | {} |", marks.join(" | ")).unwrap();
        let expected: Vec<Stage> =
            Stage::ENGINE.into_iter().filter(|stage| edit.makes(*stage) && *stage != Upload).collect();
        if made != expected {
            failures.push(format!("{name}: made {made:?}, expected {expected:?}"));
        }
        let fresh = afresh(&engine);
        let display = engine.options().display;
        if edited.layers != fresh.layers || edited.displayed(&display) != fresh.displayed(&display) {
            failures.push(format!("{name}: the picture is not that of a new engine"));
        }
    }
    println!("{table}");
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
#[ignore = "full: every kind of edit on a software adapter"]
fn on_a_gpu_nothing_else_is_made_and_the_pictures_agree() {
    let backend = gpu_backend();
    let mut engine = engine(&backend);
    render(&mut engine);
    let mut failures = Vec::new();
    for edit in EDITS {
        let name = edit.name;
        let before = engine.stage_counts();
        (edit.apply)(&mut engine);
        let edited = render(&mut engine);
        let made = engine.stage_counts().made_since(&before);
        let expected: Vec<Stage> = Stage::ENGINE.into_iter().filter(|stage| edit.makes(*stage)).collect();
        if made != expected {
            failures.push(format!("{name}: made {made:?}, expected {expected:?}"));
        }
        for ((aov, a), (_, b)) in edited.layers.iter().zip(&afresh(&engine).layers) {
            let error = pinspot::image::rel_l2(a, b, None);
            if error.is_nan() || error > 1e-6 {
                failures.push(format!("{name}: {aov:?} differs from that of a new engine by {error:.1e}"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn a_new_engine_makes_only_what_its_options_use() {
    let unused = |options: fn(Options) -> Options| {
        let (scene, defaults) = pinspot::load("ring-natural").unwrap();
        let defaults = defaults.with_size([16, 16]).with_samples(60).with_leaves(Some(4));
        let mut engine = Engine::new(scene, options(defaults), Backend::cpu());
        render(&mut engine);
        let made = engine.stage_counts().made_since(&StageCounts::default());
        // The scene has neither emitters nor lamps nor a medium, no GPU renders it, and pinholes send no photons.
        let is_of_others = |stage: &Stage| {
            matches!(
                stage,
                Upload
                    | Stage::LightGeometry
                    | Stage::LitEnvironment
                    | Stage::Surroundings
                    | Stage::Scattering
                    | Stage::Photons
            )
        };
        Stage::ENGINE.into_iter().filter(|s| !made.contains(s) && !is_of_others(s)).collect::<Vec<_>>()
    };
    assert_eq!(unused(|options| options), [Differentials]);
    assert_eq!(
        unused(|options| options.with_visibility(Visibility::None)),
        [LightSampler, Differentials, Stage::Visibility],
    );
    assert_eq!(
        unused(|options| options.with_evaluation(EvaluationChoice::Flat).with_leaves(None)),
        [LightBounds, Tree, Estimate],
    );
}

#[test]
fn an_engine_is_usable_after_an_error() {
    let backend = Backend::cpu();
    let mut engine = engine(&backend);
    let first = render(&mut engine);
    type Change = fn(&mut Engine);
    let mistakes: [(Change, Change); 4] = [
        (|e| e.options_mut().taps = 0, |e| e.options_mut().taps = 16),
        (
            |e| e.scene_mut().environment.light = pinspot::scene::Light::BuiltInMap("nowhere".into()),
            |e| e.scene_mut().environment.light = pinspot::load("ring-natural").unwrap().0.environment.light,
        ),
        (
            |e| e.scene_mut().objects[TABLE].placement.translate.y = f32::NAN,
            |e| {
                e.scene_mut().objects[TABLE].placement =
                    pinspot::load("ring-natural").unwrap().0.objects[TABLE].placement;
            },
        ),
        (
            |e| e.options_mut().filter = pinspot::FilterChoice::Hardware,
            |e| e.options_mut().filter = pinspot::FilterChoice::Auto,
        ),
    ];
    for (mistake, mend) in mistakes {
        mistake(&mut engine);
        assert!(wait(None, engine.render(&NoProgress)).is_err());
        mend(&mut engine);
        assert_eq!(render(&mut engine).layers, first.layers);
    }
}

#[test]
fn a_choice_of_the_cpu_opens_no_device() {
    assert!(wait(None, Backend::open(&BackendChoice::Cpu)).unwrap().device().is_none());
}

/// Photons are sent again when the camera moves, whose map they are added to, or the mirror does, but not for another exposure or intensity.
#[test]
fn photons_are_sent_again_only_where_it_matters() {
    let (scene, options) = pinspot::load("ring").unwrap();
    let mut options = options.with_size([24, 24]).with_technique(pinspot::Technique::ImageSpace);
    (options.image_space.photons, options.image_space.light_directions) = (64, 2);
    let mut engine = Engine::new(scene, options, Backend::cpu());
    let mut sent = |edit: fn(&mut Engine)| {
        let before = engine.stage_counts();
        edit(&mut engine);
        wait(None, engine.render(&NoProgress)).unwrap();
        engine.stage_counts().made_since(&before).contains(&Stage::Photons)
    };
    assert!(sent(|_| ()) && !sent(|_| ()));
    assert!(!sent(|engine| engine.options_mut().display.exposure = Exposure::Stops(1.0)));
    assert!(!sent(|engine| engine.scene_mut().environment.intensity = 2.0));
    assert!(sent(|engine| engine.scene_mut().environment.rotation_rad = 0.3));
    assert!(sent(|engine| engine.scene_mut().camera.position.y += 0.1));
    assert!(sent(|engine| engine.scene_mut().objects[0].placement.translate.y += 0.1));
    assert!(sent(|engine| engine.options_mut().image_space.mode = pinspot::Mode::Points));
}

/// A chain that is shown alone is all that is computed; beside another one, the report needs the whole caustic, too.
#[test]
fn a_chain_alone_is_computed_alone() {
    let sent = |aovs: &[Aov]| {
        let (scene, options) = pinspot::load("ring").unwrap();
        let mut options = options.with_size([24, 24]).with_technique(pinspot::Technique::ImageSpace);
        (options.image_space.photons, options.image_space.light_directions) = (64, 1);
        let mut engine = Engine::new(scene, options.with_aovs(aovs.to_vec()), Backend::cpu());
        let report = wait(None, engine.render(&NoProgress)).unwrap().report;
        assert!(report.photons.unwrap().photons > 0);
        engine.stage_counts().of(Stage::Photons)
    };
    assert_eq!(sent(&[Aov::CausticR]), 1);
    assert_eq!(sent(&[Aov::Caustic, Aov::CausticR]), 2);
    // Nothing casts this one.
    assert_eq!(sent(&[Aov::CausticTT]), 1);
}
