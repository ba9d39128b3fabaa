//! The shaders, and their `#import name` lines: each is replaced by `shaders/shared/name.wgsl`.

use std::borrow::Cow;

/// Entry shaders by name.
pub const SHADERS: &[(&str, &str)] = &[
    ("blocks", include_str!("../../shaders/blocks.wgsl")),
    ("cut", include_str!("../../shaders/cut.wgsl")),
    ("filter_probe", include_str!("../../shaders/filter_probe.wgsl")),
    ("finish", include_str!("../../shaders/finish.wgsl")),
    ("gather", include_str!("../../shaders/gather.wgsl")),
    ("light_bounds", include_str!("../../shaders/light_bounds.wgsl")),
    ("scout", include_str!("../../shaders/scout.wgsl")),
];

const SHARED: &[(&str, &str)] = &[
    ("brdf", include_str!("../../shaders/shared/brdf.wgsl")),
    ("cube", include_str!("../../shaders/shared/cube.wgsl")),
    ("filters", include_str!("../../shaders/shared/filters.wgsl")),
    ("footprint", include_str!("../../shaders/shared/footprint.wgsl")),
    ("hierarchy", include_str!("../../shaders/shared/hierarchy.wgsl")),
    ("pair", include_str!("../../shaders/shared/pair.wgsl")),
    ("visibility", include_str!("../../shaders/shared/visibility.wgsl")),
    ("work", include_str!("../../shaders/shared/work.wgsl")),
];

/// A shader's source with its imports in place. Panics on a name that does not exist: the names are this crate's own.
pub fn resolve(name: &str) -> Cow<'static, str> {
    let find = |table: &'static [(&str, &str)], name: &str| {
        table.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no shader '{name}'")).1
    };
    let source = find(SHADERS, name);
    let lines = source.lines().map(|line| match line.strip_prefix("#import ") {
        Some(import) => find(SHARED, import.trim()),
        None => line,
    });
    Cow::Owned(lines.collect::<Vec<_>>().join("\n"))
}
