//! The documents say what the sources do.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What an attribute says that keeps a test out of the quick run.
const MARK: &str = "#[ignore = \"full: ";

/// A test of the full run: its file, its name, and why it is there.
type FullTest = [String; 3];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All Rust files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let of = |path: PathBuf| match path.extension() {
        _ if path.is_dir() => sources(&path),
        Some(extension) if extension == "rs" => vec![path],
        _ => Vec::new(),
    };
    entries.flat_map(of).collect()
}

/// The tests that attributes in a file keep for the full run.
fn marked(path: &Path) -> Vec<FullTest> {
    let name = path.strip_prefix(root()).unwrap().to_string_lossy().replace('\\', "/");
    let text = std::fs::read_to_string(path).unwrap();
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let mut found = Vec::new();
    for (at, line) in lines.iter().enumerate().filter(|(_, line)| line.starts_with("#[ignore")) {
        let why = line.strip_prefix(MARK).and_then(|rest| rest.strip_suffix("\"]"));
        let why = why.unwrap_or_else(|| panic!("{name}:{}: {line} says nothing that begins with 'full: '", at + 1));
        let function = lines[at..].iter().find_map(|line| line.strip_prefix("fn "));
        let test = function.and_then(|line| line.split('(').next()).expect("a test is a function");
        found.push([&name, test, why].map(str::to_owned));
    }
    found
}

/// The rows of the table in docs/testing.md.
fn listed() -> Vec<FullTest> {
    let text = std::fs::read_to_string(root().join("docs/testing.md")).unwrap();
    let (_, table) = text.split_once("| file | test | why |\n|---|---|---|\n").expect("the table's head");
    let cells = |line: &str| -> Option<FullTest> {
        let line = line.strip_prefix("| `")?.strip_suffix(" |")?;
        let cells: Vec<&str> = line.split(" | ").map(|cell| cell.trim_matches('`')).collect();
        let cells: [&str; 3] = cells.try_into().unwrap_or_else(|_| panic!("not a file, a test and a reason: {line}"));
        Some(cells.map(str::to_owned))
    };
    table.lines().map_while(cells).collect()
}

#[test]
fn the_list_of_the_full_runs_tests_is_that_of_the_sources() {
    let folders = ["src", "tests"].map(|folder| sources(&root().join(folder)));
    let marked: BTreeSet<FullTest> = folders.iter().flatten().flat_map(|path| marked(path)).collect();
    let listed: BTreeSet<FullTest> = listed().into_iter().collect();
    let rows = |of: &BTreeSet<FullTest>, without: &BTreeSet<FullTest>| {
        let rows = of.difference(without).map(|[file, test, why]| format!("| `{file}` | `{test}` | {why} |\n"));
        rows.collect::<String>()
    };
    let (missing, stale) = (rows(&marked, &listed), rows(&listed, &marked));
    assert!(
        missing.is_empty() && stale.is_empty(),
        "docs/testing.md lacks\n{missing}and lists what is not marked so\n{stale}"
    );
}

/// The scene files in a document.
fn scenes_in(document: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(document)).unwrap();
    let blocks = text.split("```toml\n").skip(1);
    blocks.map(|block| block.split("```").next().unwrap().to_owned()).collect()
}

#[test]
fn the_first_scene_is_short_and_loads() {
    let scenes = scenes_in("docs/first-scene.md");
    let [scene] = &scenes[..] else { panic!("{} scenes", scenes.len()) };
    assert!(scene.lines().filter(|line| !line.is_empty()).count() <= 15, "{scene}");
    let loaded = pinspot::scene::parse::<pinspot::Settings>("bowl.toml", scene, Path::new(".")).unwrap();
    assert_eq!(loaded.scene.objects.len(), 3);
}

/// What the reader says of a key that it does not know: those that it does.
fn known_keys(scene: &str) -> Vec<String> {
    let error = pinspot::scene::parse::<pinspot::Settings>("t", scene, Path::new(".")).unwrap_err().to_string();
    let (_, known) = error.split_once("unknown key 'zzqq'; known are: ").unwrap_or_else(|| panic!("{scene}: {error}"));
    known.split(", ").map(str::to_owned).collect()
}

#[test]
fn all_keys_of_scene_files_are_in_the_table() {
    let text = std::fs::read_to_string(root().join("docs/scenes.md")).unwrap();
    let (_, tables) = text.split_once("## All keys").expect("the section");
    let rest = "environment = { constant = [1, 1, 1] }\n\
                camera = { position = [0, 1, 1], target = [0, 0, 0], perspective = { fov_y_deg = 40 } }\n";
    let row = |name: &str| {
        let start = format!("| {name} |");
        tables.lines().find(|line| line.starts_with(&start)).unwrap_or_else(|| panic!("no row of {name}"))
    };
    let check = |name: &str, scene: &str| {
        for key in known_keys(scene) {
            assert!(row(name).contains(&format!("`{key}`")), "{name} lacks {key}");
        }
    };
    check("the file", &format!("zzqq = 1\n{rest}"));
    check("`environment`", "environment = { zzqq = 1 }\n");
    check("`environment.spot`", "environment = { spot = { zzqq = 1 } }\n");
    check("`camera`", "camera = { zzqq = 1 }\n");
    let tables = [
        ("render", "zzqq = 1"),
        ("medium", "zzqq = 1"),
        ("animation", "zzqq = 1"),
        ("light", "zzqq = 1"),
        ("light.spot", "spot = { zzqq = 1 }"),
        ("light.directional", "directional = { zzqq = 1 }"),
        ("object", "zzqq = 1"),
        ("object.reflector", "reflector = { zzqq = 1 }"),
        ("object.refractor", "refractor = { zzqq = 1 }"),
        ("object.receiver", "receiver = { zzqq = 1 }"),
        ("object.receiver.phong", "receiver = { phong = { zzqq = 1 } }"),
        ("object.receiver.ggx", "receiver = { ggx = { zzqq = 1 } }"),
        ("object.emitter", "emitter = { zzqq = 1 }"),
    ];
    for (name, keys) in tables {
        let table = name.split('.').next().unwrap();
        let head = if ["render", "medium"].contains(&table) { format!("[{table}]") } else { format!("[[{table}]]") };
        check(&format!("`{name}`"), &format!("{rest}{head}\n{keys}\n"));
    }
    let shapes = [
        "ring",
        "solid-ring",
        "spoon",
        "cup",
        "sphere",
        "ellipsoid",
        "box",
        "torus",
        "knot",
        "disco-ball",
        "plane",
        "tiles",
        "sheet",
        "water",
    ];
    for shape in shapes {
        check(&format!("`{shape}`"), &format!("{rest}[[object]]\nshape = {{ {shape} = {{ zzqq = 1 }} }}\n"));
    }
}
