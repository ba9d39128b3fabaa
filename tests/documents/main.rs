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
