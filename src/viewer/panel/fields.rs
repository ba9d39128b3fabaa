//! Fields of the panel: a number or a choice with its name, and a button that resets it.

use std::ops::RangeInclusive;

use eframe::egui;
use egui::emath::Numeric;
use glam::Vec3;

/// A number in a range, as a slider whose value can be typed. Returns whether it was changed.
pub fn number<T: Numeric>(
    ui: &mut egui::Ui,
    name: &str,
    value: &mut T,
    original: T,
    (range, is_logarithmic): (RangeInclusive<T>, bool),
) -> bool {
    let mut is_changed = false;
    ui.horizontal(|ui| {
        // Files may hold values beyond what the slider offers.
        let clamping = egui::SliderClamping::Edits;
        let slider = egui::Slider::new(value, range).logarithmic(is_logarithmic).clamping(clamping).text(name);
        is_changed = ui.add(slider.custom_parser(typed_number)).changed();
        is_changed |= reset(ui, name, value, original);
    });
    is_changed
}

/// Three numbers. Returns whether any was changed.
pub fn vector(ui: &mut egui::Ui, name: &str, value: &mut Vec3, original: Vec3, speed: f64) -> bool {
    let before = *value;
    ui.horizontal(|ui| {
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let drag =
                ui.add(egui::DragValue::new(&mut value[axis]).speed(speed).max_decimals(3).custom_parser(typed_number));
            named(&drag, egui::Role::SpinButton, &format!("{name} {letter}"));
        }
        ui.label(name);
        reset(ui, name, value, original);
    });
    *value != before
}

/// A number that was typed; "nan" and "inf" are none.
pub fn typed_number(text: &str) -> Option<f64> {
    text.trim().replace('\u{2212}', "-").parse().ok().filter(|number: &f64| number.is_finite())
}

/// One of several values. Returns whether it was changed.
pub fn choice<T: Copy + PartialEq>(
    ui: &mut egui::Ui,
    name: &str,
    value: &mut T,
    original: T,
    choices: &[(T, &str)],
) -> bool {
    let before = *value;
    ui.horizontal(|ui| {
        let shown = choices.iter().find(|(choice, _)| choice == value).map_or("", |(_, text)| *text);
        egui::ComboBox::from_label(name).selected_text(shown).width(130.0).show_ui(ui, |ui| {
            for (choice, text) in choices {
                ui.selectable_value(value, *choice, *text);
            }
        });
        reset(ui, name, value, original);
    });
    *value != before
}

/// Yes or no. Returns whether it was changed.
pub fn switch(ui: &mut egui::Ui, name: &str, value: &mut bool, original: bool) -> bool {
    let before = *value;
    ui.horizontal(|ui| {
        ui.checkbox(value, name);
        reset(ui, name, value, original);
    });
    *value != before
}

/// A button that restores the value of the file. Returns whether it was pressed.
pub fn reset<T: Copy + PartialEq>(ui: &mut egui::Ui, name: &str, value: &mut T, original: T) -> bool {
    if *value == original {
        return false;
    }
    let button = ui.small_button("reset").on_hover_text(format!("Reset {name}"));
    named(&button, egui::Role::Button, &format!("Reset {name}"));
    if button.clicked() {
        *value = original;
        return true;
    }
    false
}

/// A button that opens a file dialog. Returns whether it was pressed.
pub fn browse(ui: &mut egui::Ui, name: &str) -> bool {
    let button = ui.button("\u{2026}").on_hover_text(name);
    named(&button, egui::Role::Button, name);
    button.clicked()
}

/// Gives a widget without a text of its own a name, for screen readers and tests.
pub fn named(response: &egui::Response, role: egui::Role, name: &str) {
    response.widget_info(|| egui::WidgetInfo::labeled(role, true, name));
}
