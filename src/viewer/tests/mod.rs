//! The window without a windowing system: its controls are found by their accessible names, and operated by synthetic input.

mod lost_device;
mod tools;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui;
use egui::{Event, Key, Modifiers, Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};

use super::document::Document;
use super::scene_text::differing_options;
use super::worker::Quality;
use super::{Viewer, panel};
use crate::image::Aov;
use crate::scene::Light;
use crate::{BackendChoice, Epsilon, Footprint};
use pinspot_render::options::{EvaluationChoice, Exposure, FilterChoice, Overlay};
use pinspot_sums::sampling::Strategy;

/// Pictures of test scenes take a fraction of this.
const PATIENCE: Duration = Duration::from_mins(1);
/// The window is high enough to show all controls; its picture, which is as large as the area beside them, need not be fine.
const PIXELS_PER_POINT: f32 = 0.25;

type Window = Harness<'static, Viewer>;

/// What a control sets.
type Value<T> = fn(&Viewer) -> T;

/// What changes the state.
type Change = fn(&mut Viewer);

/// A small scene that moves, in a folder of its own.
const SCENE: &str = r#"
[environment]
spot = { direction = [0.6, 0.7, -0.35], sigma_rad = 0.05, radiance = [60.0, 60.0, 60.0] }
[camera]
position = [0.0, 2.0, 3.0]
target = [0.0, 0.1, 0.0]
perspective = { fov_y_deg = 40.0 }
[render]
size = [64, 48]
samples = 60
leaves = 4
[[object]]
name = "ring"
shape = { ring = {} }
reflector = {}
[[object]]
name = "table"
shape = { plane = { size = [4.0, 4.0] } }
receiver = {}
[[animation]]
object = "ring"
translate = [[0.0, [0.0, 0.0, 0.0]], [1.0, [0.3, 0.0, 0.0]], [2.0, [0.0, 0.0, 0.0]]]
loop = true
"#;

fn open(scene: &str, size: [f32; 2]) -> Window {
    let document = Document::open(scene).unwrap();
    let viewer = Viewer::new(document, BackendChoice::Cpu, egui::Context::default(), None);
    Harness::builder()
        .with_size(egui::Vec2::from(size))
        .with_pixels_per_point(PIXELS_PER_POINT)
        .build_ui_state(|ui, viewer| viewer.ui(ui), viewer)
}

/// A folder with the scene, and a window on it.
fn opened() -> (tempfile::TempDir, PathBuf, Window) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, SCENE).unwrap();
    let window = open(file.to_str().unwrap(), [760.0, 1500.0]);
    (folder, file, window)
}

/// Opens a section of the panel.
fn unfold(window: &mut Window, section: &str) {
    window.step();
    window.get_by_label(section).click();
    window.run_steps(10);
}

/// Frames until something is the case.
fn run_until(window: &mut Window, what: &str, mut is_so: impl FnMut(&Viewer) -> bool) {
    let began = Instant::now();
    loop {
        window.step();
        if is_so(window.state()) {
            return;
        }
        assert!(began.elapsed() < PATIENCE, "not in time: {what}; {:?}", window.state().notices);
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn is_finished(viewer: &Viewer) -> bool {
    viewer.is_finished() && viewer.notices.failure().is_none()
}

fn press(window: &mut Window, modifiers: Modifiers, key: Key) {
    window.key_press_modifiers(modifiers, key);
    window.step();
}

/// A file as the windowing system drops it.
#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|e| e.to_string())
    }
}

fn drop_file(window: &mut Window, path: PathBuf) {
    window.input_mut().dropped_files.push(Arc::new(Dropped(path)));
    window.step();
}

#[test]
fn a_preview_comes_first_and_is_refined_to_the_scenes_own_settings() {
    let (_folder, _, mut window) = opened();
    run_until(&mut window, "a preview", |viewer| viewer.picture.is_some());
    let first = window.state().picture.as_ref().unwrap().quality;
    assert!(matches!(first, Quality::Preview(_)), "{first:?}");
    run_until(&mut window, "the whole picture", is_finished);
    let viewer = window.state();
    assert_eq!(viewer.picture.as_ref().unwrap().evaluation.unwrap().leaves(), 4);
    assert!(viewer.status().starts_with("finished"), "{}", viewer.status());
    assert!(viewer.picture.as_ref().unwrap().stages.iter().any(|(stage, _)| *stage == crate::Stage::Caustic));
    window.get_by_role_and_label(Role::Image, "Picture");
}

/// Sliders and check boxes by the keyboard, lists by their entries; each edit is undone and made again.
#[test]
fn every_setting_is_operated_and_undone() {
    let (_folder, _, mut window) = opened();
    unfold(&mut window, "Caustic");
    let numbers: [(&str, Value<f64>); 7] = [
        ("Rotation \u{b0}", |v| v.document.state.scene.environment.rotation_rad.into()),
        ("Intensity", |v| v.document.state.scene.environment.intensity.into()),
        ("Samples", |v| v.document.state.options.samples.into()),
        ("Tolerance", |v| v.document.state.options.tolerance.into()),
        ("Taps", |v| v.document.state.options.taps.into()),
        ("Gain", |v| v.document.state.options.caustic_gain.into()),
        ("Seed", |v| v.document.state.options.seed as f64),
    ];
    for (name, value) in numbers {
        let before = value(window.state());
        window.get_by_role_and_label(Role::Slider, name).focus();
        window.step();
        // Most can grow; the taps are at their largest.
        press(&mut window, Modifiers::NONE, if name == "Taps" { Key::ArrowLeft } else { Key::ArrowRight });
        window.step();
        let after = value(window.state());
        assert_ne!(before, after, "{name}");
        press(&mut window, Modifiers::COMMAND, Key::Z);
        assert_eq!(value(window.state()), before, "{name} is undone");
        press(&mut window, Modifiers::COMMAND, Key::Y);
        assert_eq!(value(window.state()), after, "{name} is made again");
        window.get_by_label(&format!("Reset {name}")).click();
        window.run_steps(2);
        assert_eq!(value(window.state()), before, "{name} is reset");
    }
    let choices: [(&str, &str, Value<bool>); 9] = [
        ("Picture", "caustic", |v| v.document.state.options.aovs == [Aov::Caustic]),
        ("Strategy", "random", |v| v.document.state.options.strategy == Strategy::Random),
        ("Density", "contribution", |v| v.document.state.options.density == crate::Density::Contribution),
        ("Evaluation", "flat", |v| v.document.state.options.evaluation == EvaluationChoice::Flat),
        ("Leaves", "16", |v| v.document.state.options.leaves == Some(16)),
        ("Filter", "isotropic", |v| v.document.state.options.filter == FilterChoice::Isotropic),
        ("Footprint", "curvature", |v| v.document.state.options.footprint == Footprint::Curvature),
        ("Overlay", "curvature", |v| v.document.state.options.overlay == Overlay::Curvature),
        ("Epsilon", "paper", |v| v.document.state.options.epsilon == Epsilon::Paper),
    ];
    for (name, entry, is_chosen) in choices {
        window.get_by_role_and_label(Role::ComboBox, name).click();
        window.run_steps(3);
        window.get_by_role_and_label(Role::Button, entry).click();
        window.run_steps(3);
        assert!(is_chosen(window.state()), "{name}: {entry}");
    }
    let switches: [(&str, Value<bool>); 4] = [
        ("Shapes only", |v| v.document.state.options.plain_diffuse),
        ("Automatic exposure", |v| v.document.state.options.display.exposure == Exposure::Auto),
        ("Background by itself", |v| v.document.state.options.display.background_exposure_ev.is_some()),
        ("Attenuation 1/l\u{b2}", |v| !v.document.state.options.attenuation),
    ];
    for (name, is_on) in switches {
        window.get_by_role_and_label(Role::CheckBox, name).click();
        window.run_steps(2);
        assert!(is_on(window.state()), "{name}");
    }
    run_until(&mut window, "a picture with all of it", |viewer| !viewer.is_waiting);
    assert!(window.state().notices.failure().is_none(), "{:?}", window.state().notices);
}

/// From the first control on, the tabulator reaches every one of them.
#[test]
fn the_keyboard_reaches_every_control() {
    let (_folder, _, mut window) = opened();
    unfold(&mut window, "Caustic");
    let mut reached = std::collections::BTreeSet::new();
    for _ in 0..120 {
        press(&mut window, Modifiers::NONE, Key::Tab);
        let focused = window.root().children_recursive().find(egui_kittest::Node::is_focused);
        reached.extend(focused.and_then(|node| node.accesskit_node().label()));
    }
    for name in [
        "Play",
        "Time",
        "Animate",
        "Help",
        "Hide panel",
        "Scene",
        "File to open",
        "Open",
        "Browse for a file to open",
        "Quality",
        "Map studio",
        "Open map\u{2026}",
        "Rotation \u{b0}",
        "Intensity",
        "Picture",
        "Exposure",
        "Overlay",
        "Technique",
        "Samples",
        "Strategy",
        "Density",
        "Evaluation",
        "Leaves",
        "Tolerance",
        "Filter",
        "Taps",
        "Footprint",
        "Visibility",
        "Gain",
        "Epsilon",
        "Seed",
        "Objects",
        "Under the pointer",
        "Reference",
        "Save and record",
        "Frame time",
    ] {
        assert!(reached.contains(name), "'{name}' is not among {reached:?}");
    }
}

#[test]
fn the_camera_orbits_pans_dollies_and_comes_back() {
    let (_folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    let home = window.state().document.state.scene.camera;
    let at = |x: f32| egui::Pos2::new(x, 300.0);
    window.hover_at(at(200.0));
    window.drag_at(at(200.0));
    window.step();
    window.hover_at(at(240.0));
    window.step();
    window.drop_at(at(240.0));
    window.step();
    let orbited = window.state().document.state.scene.camera;
    assert!(orbited != home && (orbited.position.length() - home.position.length()).abs() < 0.05);
    window.hover_at(at(240.0));
    window.step();
    window.event(Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: egui::Vec2::new(0.0, 100.0),
        phase: egui::TouchPhase::Move,
        modifiers: Modifiers::NONE,
        source: egui::MouseWheelSource::Wheel,
    });
    window.run_steps(20);
    let near = window.state().document.state.scene.camera;
    assert!(near.position.length() < orbited.position.length());
    press(&mut window, Modifiers::SHIFT, Key::ArrowLeft);
    let panned = window.state().document.state.scene.camera;
    assert!(panned.position != near.position && panned.forward == near.forward);
    press(&mut window, Modifiers::NONE, Key::R);
    assert_eq!(window.state().document.state.scene.camera, home);
}

#[test]
fn the_animation_plays_pauses_and_is_scrubbed() {
    let (_folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    press(&mut window, Modifiers::NONE, Key::Space);
    assert!(window.state().clock.is_playing);
    run_until(&mut window, "time goes on", |viewer| viewer.clock.seconds > 0.3);
    assert!(
        matches!(window.state().picture.as_ref().unwrap().quality, Quality::Preview(_)),
        "nothing is refined meanwhile"
    );
    press(&mut window, Modifiers::NONE, Key::Space);
    let paused = window.state().clock.seconds;
    run_until(&mut window, "the whole picture of the moment", is_finished);
    assert_eq!(window.state().clock.seconds, paused);
    assert!(window.state().posed_scene().objects[0].placement.translate.x > 0.0);
    window.get_by_role_and_label(Role::Slider, "Time").focus();
    window.step();
    press(&mut window, Modifiers::NONE, Key::ArrowRight);
    assert_ne!(window.state().clock.seconds, paused);
}

#[test]
fn files_are_dropped_and_bad_ones_leave_everything_as_it_was() {
    let (folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    std::fs::write(folder.path().join("good.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    drop_file(&mut window, folder.path().join("good.obj"));
    run_until(&mut window, "the mesh", |viewer| viewer.document.state.scene.objects.len() == 3);
    assert_eq!(window.state().selected, Some(2));
    for (name, contents, expected) in [
        ("broken.obj", "v 0 0\nf 1 2 3\n", "broken.obj"),
        ("broken.toml", "[camera]\n", "the key 'position' is missing"),
        ("broken.exr", "no image", "broken.exr"),
        ("notes.txt", "", "drop a scene (.toml)"),
    ] {
        std::fs::write(folder.path().join(name), contents).unwrap();
        drop_file(&mut window, folder.path().join(name));
        run_until(&mut window, name, |viewer| viewer.notices.failure().is_some());
        let failure = window.state().notices.failure().unwrap().to_owned();
        assert!(failure.contains(expected), "{failure}");
        assert_eq!(window.state().document.state.scene.objects.len(), 3);
        window.step();
        window.get_by_label("OK").click();
        window.run_steps(2);
        assert!(window.state().notices.failure().is_none());
    }
    std::fs::write(folder.path().join("other.toml"), SCENE.replace("samples = 60", "samples = 61")).unwrap();
    drop_file(&mut window, folder.path().join("other.toml"));
    run_until(&mut window, "the other scene", |viewer| viewer.document.state.options.samples == 61);
}

#[test]
fn a_file_that_is_broken_on_disk_is_told_and_read_again_once_it_is_mended() {
    let (_folder, file, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    std::thread::sleep(Duration::from_millis(30));
    std::fs::write(&file, SCENE.replace("samples = 60", "samples = \"many\"")).unwrap();
    run_until(&mut window, "the message", |viewer| viewer.notices.failure().is_some());
    assert!(window.state().notices.failure().unwrap().contains("samples"));
    assert_eq!(window.state().document.state.options.samples, 60);
    std::thread::sleep(Duration::from_millis(30));
    std::fs::write(&file, SCENE.replace("samples = 60", "samples = 99")).unwrap();
    run_until(&mut window, "the new samples", |viewer| viewer.document.state.options.samples == 99);
}

#[test]
fn values_that_cannot_be_are_not_taken() {
    let (_folder, _, mut window) = opened();
    unfold(&mut window, "Caustic");
    // A value is typed into the number beside its slider; the slider's own node has the name.
    let samples_slider = window.get_by_role_and_label(Role::Slider, "Samples").rect();
    for (typed, expected) in [("17", 17), ("nan", 17), ("0", 1), ("-5", 1), ("44", 44)] {
        let at = egui::Pos2::new(samples_slider.right() + 20.0, samples_slider.center().y);
        window.hover_at(at);
        window.drag_at(at);
        window.step();
        window.drop_at(at);
        window.run_steps(2);
        press(&mut window, Modifiers::COMMAND, Key::A);
        window.event(Event::Text(typed.to_owned()));
        window.step();
        press(&mut window, Modifiers::NONE, Key::Enter);
        window.run_steps(2);
        assert_eq!(window.state().document.state.options.samples, expected, "{typed}");
    }
    run_until(&mut window, "a picture", |viewer| !viewer.is_waiting);
    assert!(window.state().notices.failure().is_none());
}

/// Settings that contradict each other are explained; the picture stays until they are mended.
#[test]
fn settings_that_cannot_be_rendered_are_explained() {
    let (_folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    let set_samples = |window: &mut Window, samples: u32| {
        window.state_mut().document.state.options.samples = samples;
        window.state_mut().is_outdated = true;
        window.step();
    };
    // With four leaves each, these are more cells than fit.
    set_samples(&mut window, pinspot_sums::sampling::MAX_SAMPLES);
    run_until(&mut window, "the reason", |viewer| viewer.notices.failure().is_some());
    assert!(window.state().notices.failure().unwrap().contains("leaves"), "{:?}", window.state().notices);
    assert!(window.state().picture.is_some());
    set_samples(&mut window, 50);
    run_until(&mut window, "a picture again", |viewer| viewer.notices.failure().is_none());
}

/// A finished picture is displayed in another way without being rendered again.
#[test]
fn a_finished_picture_survives_what_changes_its_display_alone() {
    let (folder, _, mut window) = opened();
    run_until(&mut window, "the whole picture", is_finished);
    let picture = |viewer: &Viewer| viewer.picture.clone().unwrap();
    let before = picture(window.state());
    let changes: [(&str, Change); 4] = [
        ("exposure", |v| v.document.state.options.display.exposure = Exposure::Stops(2.5)),
        ("background", |v| v.document.state.options.display.background_exposure_ev = Some(-1.0)),
        ("tone map", |v| v.document.state.options.display.tone_map = crate::image::ToneMap::Linear),
        ("overlay", |v| v.document.state.options.overlay = Overlay::Samples),
    ];
    let mut radiance = None;
    for (name, change) in changes {
        change(window.state_mut());
        window.state_mut().is_outdated = true;
        window.step();
        let sent = window.state().sent();
        run_until(&mut window, name, |viewer| !viewer.is_waiting);
        let after = picture(window.state());
        assert_eq!((after.view, after.quality, after.seconds), (sent, before.quality, before.seconds), "{name}");
        assert_eq!(*radiance.get_or_insert(window.state().sent_radiance()), window.state().sent_radiance());
    }
    let after = picture(window.state());
    assert_eq!(after.exposures.unwrap().exposure_ev, 2.5);
    assert_eq!(after.exposures.unwrap().background_exposure_ev, -1.0);
    assert!(before.marks.is_empty() && !after.marks.is_empty());
    window.state_mut().panel.picture_file = folder.path().join("still.png").display().to_string();
    unfold(&mut window, "Save and record");
    window.get_by_label("Save picture").click();
    window.step();
    run_until(&mut window, "the picture's file", |viewer| viewer.job.is_none() && viewer.notices.done().is_some());
    window.run_steps(3);
    assert_eq!(picture(window.state()).view, after.view, "saving changes nothing");
    window.state_mut().document.state.options.samples = 50;
    window.state_mut().is_outdated = true;
    window.step();
    assert_ne!(radiance, Some(window.state().sent_radiance()), "but other samples do");
}

/// Maps are chosen by their thumbnails, and the scene keeps its own.
#[test]
fn maps_are_chosen_by_their_thumbnails() {
    let (folder, _, mut window) = opened();
    let own = window.state().document.original.scene.environment.light.clone();
    let light = |window: &Window| window.state().document.state.scene.environment.light.clone();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    window.get_by_role_and_label(Role::Button, "Map forest").click();
    window.run_steps(2);
    assert_eq!(light(&window), Light::BuiltInMap("forest".to_owned()));
    press(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(light(&window), own);
    window.get_by_role_and_label(Role::Button, "Map studio").click();
    window.run_steps(2);
    window.get_by_label("Reset map").click();
    window.run_steps(2);
    assert_eq!(light(&window), own);
    // By name, too.
    window.state_mut().panel.open_file = "city".to_owned();
    window.get_by_label("Open").click();
    run_until(&mut window, "the map", |viewer| viewer.document.state.map.as_deref() == Some("city"));
    window.state_mut().panel.scene_file = folder.path().join("lit.toml").display().to_string();
    press(&mut window, Modifiers::COMMAND, Key::S);
    let saved = Document::open(&window.state().panel.scene_file).unwrap();
    assert_eq!(saved.state.scene.environment.light, Light::BuiltInMap("city".to_owned()));
    run_until(&mut window, "a picture in its light", |viewer| !viewer.is_waiting);
    assert!(window.state().notices.failure().is_none());
}

#[test]
fn qualities_are_chosen_by_name() {
    let (_folder, _, mut window) = opened();
    window.step();
    for (entry, points) in [("final", 2), ("draft", 1), ("normal", 1)] {
        window.get_by_role_and_label(Role::ComboBox, "Quality").click();
        window.run_steps(3);
        window.get_by_role_and_label(Role::Button, entry).click();
        window.run_steps(3);
        assert_eq!(window.state().document.state.options.pixel_samples, points, "{entry}");
    }
    assert_eq!(window.state().document.state.options, window.state().document.original.options);
}

#[test]
fn windows_of_any_size_have_a_picture() {
    let (_folder, _, mut window) = opened();
    for size in [[1.0, 1.0], [320.0, 240.0], [1600.0, 300.0]] {
        window.set_size(egui::Vec2::from(size));
        window.step();
        run_until(&mut window, "a picture", |viewer| !viewer.is_waiting && viewer.picture.is_some());
        assert!(window.state().notices.failure().is_none(), "{size:?}: {:?}", window.state().notices);
    }
}

#[test]
fn pictures_and_frames_are_saved_and_scenes_keep_their_edits() {
    let (folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    let file = |name: &str| folder.path().join(name).display().to_string();
    let state = panel::PanelState {
        picture_file: file("still.exr"),
        frames_file: file("moving.apng"),
        scene_file: file("mine.toml"),
        frame_count: 2,
        output_size: [24, 16],
        ..window.state().panel.clone()
    };
    window.state_mut().panel = state;
    window.get_by_label("Save and record").click();
    window.run_steps(10);
    window.get_by_label("Save picture").click();
    window.step();
    run_until(&mut window, "the picture's file", |viewer| viewer.job.is_none() && viewer.notices.done().is_some());
    assert_eq!(crate::image::read_exr(&folder.path().join("still.exr"), "").unwrap().width, 24);
    window.get_by_label("Record").click();
    window.step();
    run_until(&mut window, "the frames' file", |viewer| viewer.job.is_none());
    assert!(folder.path().join("moving.apng").exists());
    window.state_mut().document.state.options.samples = 44;
    window.get_by_label("Copy command").click();
    window.run_steps(2);
    assert!(window.state().notices.failure().unwrap().contains("save the scene first"));
    press(&mut window, Modifiers::COMMAND, Key::S);
    let saved = Document::open(&file("mine.toml")).unwrap();
    assert_eq!(saved.state.options.samples, 44);
    window.get_by_label("Copy command").click();
    window.run_steps(2);
    assert!(window.state().notices.done().unwrap().contains("mine.toml"), "{:?}", window.state().notices);
}

#[test]
fn two_settings_are_compared_on_either_side_of_a_divider() {
    let (_folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    window.get_by_label("Compare").click();
    window.run_steps(2);
    window.state_mut().document.state.options.filter = FilterChoice::None;
    window.state_mut().document.state.options.leaves = None;
    window.state_mut().is_outdated = true;
    window.step();
    run_until(&mut window, "both pictures", is_finished);
    let viewer = window.state();
    let leaves = |picture: &Option<super::Picture>| picture.as_ref().unwrap().evaluation.unwrap().leaves();
    assert_eq!((leaves(&viewer.kept_picture), leaves(&viewer.picture)), (4, 1));
    let differing = differing_options(viewer.document.state.kept.as_ref().unwrap(), &viewer.document.state.options);
    assert_eq!(differing, ["filter auto, leaves 4", "filter none, leaves auto"]);
    window.get_by_label("Swap sides").click();
    window.run_steps(2);
    assert_eq!(window.state().document.state.kept.as_ref().unwrap().filter, FilterChoice::None);
    let middle = egui::Pos2::new(215.0, 400.0);
    let before = window.state().document.state.scene.camera;
    window.hover_at(middle);
    window.drag_at(middle);
    window.step();
    window.hover_at(middle - egui::Vec2::new(100.0, 0.0));
    window.step();
    window.drop_at(middle - egui::Vec2::new(100.0, 0.0));
    window.step();
    assert!(window.state().canvas.divider() < 0.4, "{}", window.state().canvas.divider());
    assert_eq!(window.state().document.state.scene.camera, before, "the camera stays");
    window.get_by_label("End comparison").click();
    window.run_steps(2);
    assert!(window.state().document.state.kept.is_none());
}
