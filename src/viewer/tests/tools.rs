//! What helps to look into a scene: the gizmo, what lies under the pointer, the difference to the reference.

use std::time::Duration;

use eframe::egui;
use egui::{Key, Modifiers, Role};
use egui_kittest::kittest::Queryable;

use super::{Window, open, opened, press, run_until};
use crate::viewer::Viewer;
use crate::viewer::gizmo::Handle;

#[test]
fn an_object_is_selected_and_dragged_by_its_arrow() {
    let (_folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    window.state_mut().document.state.is_animated = false;
    let middle = egui::Pos2::new(200.0, 700.0);
    window.hover_at(middle);
    window.drag_at(middle);
    window.step();
    window.drop_at(middle);
    window.step();
    run_until(&mut window, "the object that was clicked", |viewer| viewer.selected.is_some());
    let selected = window.state().selected.unwrap();
    let before = window.state().document.state.scene.objects[selected].placement.translate;
    let (start, end) = window.state().gizmo_of_selected().arrows[0].ends();
    let hold = start + 0.6 * (end - start);
    window.hover_at(hold);
    window.drag_at(hold);
    window.step();
    for part in [0.2, 0.4, 0.6] {
        window.hover_at(hold + part * (end - start));
        window.step();
    }
    window.drop_at(hold + 0.6 * (end - start));
    window.step();
    let after = window.state().document.state.scene.objects[selected].placement.translate;
    assert!((after - before).length() > 0.05, "{before} {after}");
    press(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(window.state().document.state.scene.objects[selected].placement.translate, before, "one step");
    // A part of a ring that no arrow crosses.
    let gizmo = window.state().gizmo_of_selected();
    let is_ring = |at: &&egui::Pos2| matches!(gizmo.at(**at), Some(Handle::Ring(_)));
    let hold = *gizmo.rings[1].points().iter().find(is_ring).unwrap();
    window.hover_at(hold);
    window.drag_at(hold);
    window.step();
    for part in [4.0, 8.0, 12.0] {
        window.hover_at(hold + egui::Vec2::new(part, 0.5 * part));
        window.step();
    }
    window.drop_at(hold + egui::Vec2::new(12.0, 6.0));
    window.step();
    assert_ne!(window.state().document.state.scene.objects[selected].placement.rotate_rad, glam::Vec3::ZERO);
}

/// The panel shows the footprints of the receiver under the pointer, and what a mirror's sample sees.
#[test]
fn what_lies_under_the_pointer_is_taken_apart() {
    let (_folder, _, mut window) = opened();
    run_until(&mut window, "a picture", |viewer| viewer.picture.is_some());
    window.get_by_label("Under the pointer").click();
    window.run_steps(10);
    window.get_by_role_and_label(Role::CheckBox, "Follow the pointer").click();
    window.step();
    // The middle of the ring, and a column across it.
    let area = window.get_by_role_and_label(Role::Image, "Picture").rect();
    window.hover_at(area.center());
    run_until(&mut window, "footprints", |viewer| {
        viewer.inspection.found().and_then(|found| found.receiver.as_ref()).is_some_and(|r| !r.footprints.is_empty())
    });
    window.run_steps(3);
    window.get_by_role_and_label(Role::Image, "Environment");
    window.get_by_role_and_label(Role::CheckBox, "Cells of the sum").click();
    window.step();
    run_until(&mut window, "cells", |viewer| !viewer.inspection.cells().is_empty());
    let is_mirror = |viewer: &Viewer| viewer.inspection.found().is_some_and(|found| found.view.is_some());
    let mirrors = (1..40).any(|k| {
        window.hover_at(egui::Pos2::new(area.center().x, area.top() + area.height() * k as f32 / 40.0));
        window.step();
        std::thread::sleep(Duration::from_millis(50));
        window.step();
        is_mirror(window.state())
    });
    assert!(mirrors, "the ring crosses the column");
    window.run_steps(2);
    window.get_by_role_and_label(Role::Image, "Visibility map");
}

/// A heat map of the error is shown over the finished picture, and starts anew with the next one.
#[test]
fn the_picture_is_compared_with_the_reference() {
    let (_folder, _, mut window) = opened();
    window.get_by_label("Reference").click();
    window.run_steps(10);
    window.get_by_role_and_label(Role::CheckBox, "Difference to the reference").click();
    let is_current =
        |viewer: &Viewer| viewer.difference.found().is_some_and(|found| found.view == viewer.sent_radiance());
    let is_good = |viewer: &Viewer| viewer.difference.found().is_some_and(|found| found.uncertainty < 0.1);
    run_until(&mut window, "a difference", |viewer| is_current(viewer) && is_good(viewer));
    window.state_mut().document.state.scene.environment.intensity = 2.0;
    window.state_mut().is_outdated = true;
    window.step();
    assert!(!is_current(window.state()));
    run_until(&mut window, "another difference", is_current);
}

/// What shines and what refracts has controls of its own in scenes that have any.
#[test]
fn emitters_and_interfaces_are_edited() {
    let mut window = open("dynamic", [760.0, 1500.0]);
    window.step();
    let emitter = |window: &Window| window.state().document.state.scene.objects[2].emitter.unwrap();
    let before = emitter(&window);
    window.get_by_role_and_label(Role::CheckBox, "warm light is near").click();
    window.step();
    assert_eq!(emitter(&window).is_near, !before.is_near);
    window.get_by_role_and_label(Role::Slider, "warm light brightness").focus();
    window.step();
    press(&mut window, Modifiers::NONE, Key::ArrowRight);
    window.step();
    assert!(emitter(&window).radiance.x > before.radiance.x);
    run_until(&mut window, "a preview of the edited scene", |viewer| viewer.picture.is_some());
    let mut window = open("pool", [760.0, 1500.0]);
    window.step();
    let index = |window: &Window| window.state().document.state.scene.objects[0].refractor.as_ref().unwrap().eta.x;
    let before = index(&window);
    window.get_by_role_and_label(Role::Slider, "water index").focus();
    window.step();
    press(&mut window, Modifiers::NONE, Key::ArrowRight);
    window.step();
    assert!(index(&window) > before);
}
