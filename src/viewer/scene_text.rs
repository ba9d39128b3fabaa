//! Settings as the text of a scene file. Knows nothing of documents.

use std::ops::Range;

use glam::Vec3;
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, Value, value};

use crate::Epsilon;
use crate::scene::{Camera, Emitter, Lamp, Medium, Object, Projection, Refractor};
use pinspot_render::options::{Exposure, Options};

/// A number with as many digits as tell it from others, as people would write it.
pub fn number(value: f32) -> f64 {
    value.to_string().parse().unwrap_or_else(|_| value.into())
}

pub fn vector(v: Vec3) -> Item {
    value(v.to_array().iter().map(|c| Value::from(number(*c))).collect::<Array>())
}

pub fn write_camera(document: &mut DocumentMut, old: &Camera, new: &Camera) {
    let Some(table) = document.get_mut("camera").and_then(Item::as_table_like_mut).filter(|_| old != new) else {
        return;
    };
    table.insert("position", vector(new.position));
    table.insert("target", vector(new.position + new.forward));
    table.insert("up", vector(new.up));
    if let Projection::Orthographic { height } = new.projection {
        let mut orthographic = InlineTable::new();
        orthographic.insert("height", number(height).into());
        table.insert("orthographic", value(orthographic));
    }
}

pub fn write_medium(document: &mut DocumentMut, old: Option<Medium>, new: Option<Medium>) {
    let table = document.get_mut("medium").and_then(Item::as_table_like_mut);
    let (Some(table), Some(old), Some(new)) = (table, old, new) else { return };
    let coefficients = [("sigma_s", old.sigma_s, new.sigma_s), ("sigma_a", old.sigma_a, new.sigma_a)];
    for (key, _, new) in coefficients.into_iter().filter(|(_, old, new)| old != new) {
        table.insert(key, vector(new));
    }
    if old.g != new.g {
        table.insert("g", value(number(new.g)));
    }
}

/// Positions and brightness.
pub fn write_lamps(document: &mut DocumentMut, old: &[Lamp], new: &[Lamp]) {
    let Some(tables) = document.get_mut("light").and_then(Item::as_array_of_tables_mut) else { return };
    for ((old, new), table) in old.iter().zip(new).zip(tables.iter_mut()) {
        if let Some(light) = new.sunlight() {
            if let Some(directional) = table.get_mut("directional").and_then(Item::as_table_like_mut)
                && (new.position, new.intensity) != (old.position, old.intensity)
            {
                directional.insert("direction", vector(light.towards));
                directional.insert("irradiance", vector(light.irradiance));
            }
            continue;
        }
        if new.position != old.position {
            table["position"] = vector(new.position);
            // A beam keeps its direction.
            if let Some(spot) = table.get_mut("spot").and_then(Item::as_table_like_mut)
                && let Some(beam) = &new.beam
            {
                spot.insert("target", vector(new.position + beam.direction));
            }
        }
        if new.intensity != old.intensity {
            table.remove("radiance");
            table["intensity"] = vector(new.intensity);
        }
    }
}

/// Placements, emitters and refractive indices. The parts of a mesh of several materials have one table, and are moved together.
pub fn write_objects(document: &mut DocumentMut, of_tables: &[Range<usize>], old: &[Object], new: &[Object]) {
    let Some(tables) = document.get_mut("object").and_then(Item::as_array_of_tables_mut) else { return };
    for (objects, table) in of_tables.iter().zip(tables.iter_mut()) {
        let (Some(old), Some(new)) = (old.get(objects.start), new.get(objects.start)) else { continue };
        if new.placement.translate != old.placement.translate {
            table["translate"] = vector(new.placement.translate);
        }
        if new.placement.rotate_rad != old.placement.rotate_rad {
            let degrees = new.placement.rotate_rad.to_array().map(f32::to_degrees);
            table["rotate_deg"] = vector(degrees.into());
        }
        if new.placement.scale != old.placement.scale {
            table["scale"] = value(number(new.placement.scale));
        }
        write_emitter(table, old.emitter, new.emitter);
        write_refractor(table, old.refractor.as_ref(), new.refractor.as_ref());
    }
}

fn write_emitter(object: &mut Table, old: Option<Emitter>, new: Option<Emitter>) {
    let table = object.get_mut("emitter").and_then(Item::as_table_like_mut);
    let (Some(table), Some(old), Some(new)) = (table, old, new) else { return };
    if new.radiance != old.radiance {
        table.insert("radiance", vector(new.radiance));
    }
    if new.is_near != old.is_near {
        table.insert("near", value(new.is_near));
    }
}

fn write_refractor(object: &mut Table, old: Option<&Refractor>, new: Option<&Refractor>) {
    let table = object.get_mut("refractor").and_then(Item::as_table_like_mut);
    let (Some(table), Some(old), Some(new)) = (table, old, new) else { return };
    if new.eta != old.eta {
        table.remove("cauchy");
        let eta = new.eta.as_vec3();
        table.insert("eta", if new.is_dispersive() { vector(eta) } else { value(number(eta.x)) });
    }
}

/// The `[render]` table's keys whose values differ, with the new ones; `None` where there is none any more.
fn changed_keys(old: &Options, new: &Options) -> Vec<(&'static str, Option<Item>)> {
    let aovs = |options: &Options| options.aovs.iter().map(|aov| aov.name()).collect::<Array>();
    let background = new.display.background_exposure_ev;
    let all: [(bool, &'static str, Option<Item>); 20] = [
        (old.samples != new.samples, "samples", Some(value(i64::from(new.samples)))),
        (old.strategy != new.strategy, "strategy", Some(value(new.strategy.name()))),
        (old.density != new.density, "density", Some(value(new.density.name()))),
        (old.seed != new.seed, "seed", Some(value(new.seed as i64))),
        (old.footprint != new.footprint, "footprint", Some(value(new.footprint.name()))),
        (old.filter != new.filter, "filter", Some(value(new.filter.name()))),
        (old.taps != new.taps, "taps", Some(value(i64::from(new.taps)))),
        (old.medium_steps != new.medium_steps, "medium_steps", Some(value(i64::from(new.medium_steps)))),
        (old.attenuation != new.attenuation, "attenuation", Some(value(new.attenuation))),
        (old.evaluation != new.evaluation, "evaluation", Some(value(new.evaluation.name()))),
        (old.leaves != new.leaves, "leaves", new.leaves.map(|leaves| value(i64::from(leaves)))),
        (old.tolerance != new.tolerance, "tolerance", Some(value(number(new.tolerance)))),
        (old.visibility != new.visibility, "visibility", Some(value(new.visibility.name()))),
        (old.caustic_gain != new.caustic_gain, "caustic_gain", Some(value(number(new.caustic_gain)))),
        (old.epsilon != new.epsilon, "epsilon", Some(epsilon(new))),
        (old.technique != new.technique, "technique", Some(value(new.technique.name()))),
        (old.display.exposure != new.display.exposure, "exposure_ev", Some(exposure(new.display.exposure))),
        (
            old.display.background_exposure_ev != background,
            "background_exposure_ev",
            background.map(|stops| value(number(stops))),
        ),
        (old.display.tone_map != new.display.tone_map, "tone_map", Some(value(new.display.tone_map.name()))),
        (old.aovs != new.aovs, "aov", Some(value(aovs(new)))),
    ];
    let (was, is) = (&old.image_space, &new.image_space);
    let of_photons: [(bool, &'static str, Option<Item>); 12] = [
        (was.mode != is.mode, "mode", Some(value(is.mode.name()))),
        (was.hits != is.hits, "hits", Some(value(is.hits.name()))),
        (was.traversal != is.traversal, "traversal", Some(value(is.traversal.name()))),
        (was.photons != is.photons, "photons", Some(value(i64::from(is.photons)))),
        (was.caustic_map != is.caustic_map, "caustic_map", Some(value(is.caustic_map.name()))),
        (was.caustic_map_size != is.caustic_map_size, "caustic_map_size", Some(value(i64::from(is.caustic_map_size)))),
        (was.lights != is.lights, "lights", Some(value(i64::from(is.lights)))),
        (was.light_directions != is.light_directions, "light_directions", Some(value(i64::from(is.light_directions)))),
        (was.splat_diameter != is.splat_diameter, "splat_diameter", Some(value(number(is.splat_diameter)))),
        (was.incidence != is.incidence, "incidence", Some(value(is.incidence.name()))),
        (was.temporal_frames != is.temporal_frames, "temporal_frames", Some(value(i64::from(is.temporal_frames)))),
        (was.paper != is.paper, "paper", Some(value(is.paper))),
    ];
    let changed = all.into_iter().chain(of_photons).filter(|(is_changed, ..)| *is_changed);
    changed.map(|(_, key, item)| (key, item)).collect()
}

pub fn write_options(document: &mut DocumentMut, old: &Options, new: &Options) {
    let changed = changed_keys(old, new);
    if changed.is_empty() {
        return;
    }
    let table = document.entry("render").or_insert(Item::Table(Table::new()));
    let Some(table) = table.as_table_like_mut() else { return };
    for (key, item) in changed {
        match item {
            Some(item) => drop(table.insert(key, item)),
            None => drop(table.remove(key)),
        }
    }
}

/// In which settings two options differ, with the values of either.
pub fn differing_options(a: &Options, b: &Options) -> [String; 2] {
    [(b, a), (a, b)].map(|(other, own)| {
        let shown = |(key, item): (&str, Option<Item>)| {
            let item = item.map_or_else(|| "auto".to_owned(), |item| item.to_string().trim().replace('"', ""));
            format!("{key} {item}")
        };
        let all: Vec<String> = changed_keys(other, own).into_iter().map(shown).collect();
        if all.is_empty() { "the same settings".to_owned() } else { all.join(", ") }
    })
}

fn epsilon(options: &Options) -> Item {
    match options.epsilon {
        Epsilon::Auto => value("auto"),
        Epsilon::Paper => value("paper"),
        Epsilon::Value(square_metres) => value(number(square_metres)),
    }
}

fn exposure(exposure: Exposure) -> Item {
    match exposure {
        Exposure::Auto => value("auto"),
        Exposure::Stops(stops) => value(number(stops)),
    }
}
