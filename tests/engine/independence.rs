//! What the ground truth has in common with what it judges: the scene's description, file decoding, errors, progress and the
//! use of all cores.

use std::path::{Path, PathBuf};

/// Everything of `pinspot-base` that `src/reference` may name outside its tests; of the other crates it knows nothing.
const SHARED: [&str; 16] = [
    "OptionError",
    "Progress",
    "Stage",
    "brdf::Gloss",
    "image",
    "image::Image",
    "image::ImageError",
    "image::RgbImage",
    "image::read_exr",
    "image::read_exr_text",
    "image::write_exr_with_text",
    "maps",
    "maps::EnvironmentError",
    "maps::built_in_map",
    "parallel",
    "scene",
];

/// Of `scene` it may name the description of what is there; of `reflectance` the description of a finish.
const DESCRIPTIONS: [(&str, &[&str]); 2] = [
    (
        "scene",
        &[
            "Beam",
            "Camera",
            "Chain",
            "Chains",
            "EnvironmentMap",
            "EnvironmentSource",
            "Interfaces",
            "Lamp",
            "Light",
            "MapLayout",
            "Medium",
            "MeshError",
            "Object",
            "Projection",
            "Receiver",
            "Reflector",
            "Refractor",
            "Scene",
            "SceneError",
            "Sides",
            "Slide",
            "Specular",
            "Visibility",
        ],
    ),
    ("reflectance", &["Finish", "Metal"]),
];

#[test]
fn the_ground_truth_shares_nothing_with_what_it_judges() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/reference");
    let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
    let product = manifest.split("[dev-dependencies]").next().unwrap();
    let crates: Vec<&str> = product.lines().filter(|line| line.starts_with("pinspot")).collect();
    assert_eq!(crates, ["pinspot-base = { workspace = true }"]);

    let root = std::fs::read_to_string(folder.join("lib.rs")).unwrap();
    let own = own_names(&root);
    let sources = sources(&folder);
    let mut strangers = Vec::new();
    for path in &sources {
        let source = std::fs::read_to_string(path).unwrap();
        let product = source.split("#[cfg(test)]").next().unwrap();
        assert!(!product.contains("super::super"), "{} leaves its module by another way", path.display());
        let is_own = |name: &str| own.contains(&name.split("::").next().unwrap());
        let named = names(product).into_iter().filter(|name| !is_shared(name) && !is_own(name));
        strangers.extend(named.map(|name| format!("{}: {name}", path.display())));
    }
    assert!(sources.len() > 30, "only {} files", sources.len());
    assert!(strangers.is_empty(), "{strangers:#?}");
}

/// The files of a crate; nothing else may lie in its folders.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            found.extend(sources(&path));
        } else if !path.ends_with("Cargo.toml") {
            assert!(path.extension().is_some_and(|e| e == "rs"), "a stray file: {}", path.display());
            found.push(path);
        }
    }
    found
}

/// The modules of a crate's root, and the types that it declares.
fn own_names(root: &str) -> Vec<&str> {
    let declared = |line: &'static str| root.lines().filter_map(move |l| l.strip_prefix(line));
    let all = ["mod ", "pub struct ", "pub enum "].into_iter().flat_map(declared);
    all.map(|rest| rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap()).collect()
}

fn is_shared(name: &str) -> bool {
    SHARED.contains(&name)
        || DESCRIPTIONS.iter().any(|(module, items)| {
            name.strip_prefix(module).and_then(|rest| rest.strip_prefix("::")).is_some_and(|item| items.contains(&item))
        })
}

/// All paths below `crate::`, whose root imports modules of `pinspot-base`, and `pinspot_base::` that a source names, with lists in braces
/// taken apart.
fn names(source: &str) -> Vec<String> {
    let code = source.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join(" ");
    let mut found = Vec::new();
    let roots = ["crate::", "pinspot_base::"].into_iter().flat_map(|root| code.match_indices(root));
    for (_, rest) in roots.map(|(at, part)| code[at..].split_at(part.len())) {
        let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).unwrap_or(rest.len());
        let path = &rest[..end];
        match rest[end..].strip_prefix('{').filter(|_| path.is_empty() || path.ends_with("::")) {
            Some(list) => {
                let items = list.split('}').next().unwrap();
                assert!(!items.contains('{'), "a nested list of imports: write one `use` a module");
                let items = items.split(',').map(|item| item.split(" as ").next().unwrap().trim());
                found.extend(items.filter(|item| !item.is_empty()).map(|item| format!("{path}{item}")));
            }
            None => found.push(path.to_owned()),
        }
    }
    found
}

#[test]
fn names_are_found_however_they_are_written() {
    let source = "use crate::scene::{Object as Thing, Scene};\nuse crate::{Error, Progress};\n// crate::nothing\nfn f(x: crate::pinhole::Filter) {}";
    assert_eq!(names(source), ["scene::Object", "scene::Scene", "Error", "Progress", "pinhole::Filter"]);
    assert!(!is_shared("pinhole::Filter") && !is_shared("reflectance::Curve") && is_shared("scene::Scene"));
}
