//! The page: `report.html` with a comparison's data put in.

use serde_json::{Value, json};

use super::cells::Metadata;
use super::comparison::{Comparison, Picture, TestSurfaceResult, unit_square_places};
use super::encode::{packed, png, points_picture, rgb9e5, spectrum_picture};

const TEMPLATE: &str = include_str!("report.html");

/// What a comparison was made with, for its head.
pub(super) fn made_with(metadata: &Metadata) -> Vec<(String, String)> {
    let mut entries = vec![("Pinspot", env!("CARGO_PKG_VERSION").to_owned()), ("Back end", metadata.backend.clone())];
    entries.extend(metadata.adapter.iter().map(|adapter| ("Adapter", adapter.clone())));
    entries.push(("System", format!("{} {}", std::env::consts::OS, std::env::consts::ARCH)));
    entries.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// The whole page.
pub(super) fn html(comparison: &Comparison) -> String {
    // A script element ends at the first "</script", whatever is around it.
    let data = data(comparison).to_string().replace('<', "\\u003c");
    let title = format!("{}: comparison", comparison.scene).replace('&', "&amp;").replace('<', "&lt;");
    let (head, tail) = TEMPLATE.split_once("__PINSPOT_DATA__").expect("the template has a place for the data");
    format!("{}{data}{tail}", head.replace("__PINSPOT_TITLE__", &title))
}

fn data(comparison: &Comparison) -> Value {
    let images: Vec<Value> = comparison.pictures.iter().map(image).collect();
    let rows: Vec<Value> = comparison
        .rows
        .iter()
        .enumerate()
        .map(|(k, row)| {
            let mut value = serde_json::to_value(row).expect("rows are plain data");
            value["image"] = json!(comparison.pictures.iter().position(|p| p.row == Some(k)));
            value
        })
        .collect();
    let mut reference = serde_json::to_value(&comparison.reference).expect("plain data");
    reference["image"] = json!(0);
    reference["samples_per_pixel"] = json!(comparison.reference.statistics.points_per_pixel);
    json!({
        "title": format!("{}: comparison", comparison.scene),
        "scene": comparison.scene,
        "size": comparison.size,
        "made_with": comparison.made_with,
        "reference": reference,
        "exposure_ev": comparison.exposure_ev,
        "images": images,
        "rows": rows,
        "unavailable": comparison.unavailable,
        "findings": comparison.findings,
        "sampling": comparison.sampling.iter().map(sampling).collect::<Vec<_>>(),
    })
}

fn image(picture: &Picture) -> Value {
    let bytes = |map: &Vec<f32>| map.iter().map(|v| (255.0 * v.clamp(0.0, 1.0) + 0.5) as u8).collect::<Vec<_>>();
    json!({
        "label": picture.label,
        "width": picture.image.width,
        "height": picture.image.height,
        "rgb9e5": rgb9e5(&picture.image),
        "flip": picture.flip.as_ref().map(|map| packed(&bytes(map))),
        "dots": picture.dots,
    })
}

fn sampling(entry: &TestSurfaceResult) -> Value {
    let (quality, spectrum) = (&entry.statistics.quality, entry.statistics.spectrum.as_ref());
    json!({
        "surface": entry.surface,
        "strategy": entry.strategy,
        "points": quality.count,
        "sets": entry.statistics.sets,
        "relative_radius": quality.relative_radius,
        "nearest_mean": quality.nearest_mean,
        "nearest_spread": quality.nearest_spread,
        "coverage_radius": quality.coverage_radius,
        "orientation_bias": quality.orientation_bias,
        "low_power": spectrum.map(|s| s.low_power),
        "anisotropy_db": spectrum.map(|s| s.anisotropy_db),
        "radial": spectrum.map(|s| &s.radial),
        "anisotropy": spectrum.map(|s| &s.anisotropy),
        "spectrum_png": spectrum.map(|s| png(&spectrum_picture(s))),
        "points_png": png(&points_picture(&unit_square_places(entry))),
    })
}
