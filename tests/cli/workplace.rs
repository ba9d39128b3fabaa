//! A folder to work in, and the command run there.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use pinspot::cli::{Console, run};
use tempfile::TempDir;

pub const SCENE: &str = r#"
[environment]
constant = [1.0, 1.0, 1.0]
[camera]
position = [0.0, 5.0, 0.0]
target = [0.0, 0.0, 0.0]
up = [0.0, 0.0, -1.0]
orthographic = { height = 3.0 }
[render]
size = [24, 16]
samples = 60
[[object]]
name = "ring"
mesh = "ring.obj"
reflector = { sides = "both" }
[[object]]
name = "table"
shape = { plane = { size = [3.0, 3.0] } }
receiver = { albedo = [0.5, 0.5, 0.5] }
"#;

pub const MESH: &str = "v -0.5 0.1 0\nv 0.5 0.1 0\nv 0.5 0.8 0\nv -0.5 0.8 0\nf 1 2 3 4\n";

/// Options whose values are files or folders, whatever their names end in,
const PATH_OPTIONS: [&str; 2] = ["-o", "--output"];
/// and what the names of other files end in.
const ENDINGS: [&str; 7] = ["toml", "exr", "hdr", "png", "obj", "ply", "jpg"];

/// A folder with a scene and its mesh.
pub struct Workplace(TempDir);

/// What a command wrote, and how it ended.
pub struct Ran {
    pub code: u8,
    pub stdout: Vec<u8>,
    pub stderr: Vec<u8>,
}

impl Ran {
    pub fn succeeded(&self) -> bool {
        self.code == 0
    }
}

impl Workplace {
    pub fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        place.write("scene.toml", SCENE);
        place.write("ring.obj", MESH);
        place
    }

    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, contents: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), contents).unwrap();
    }

    /// Runs the command in this process. Paths are relative to the folder: a process has one working directory for all its threads, so that
    /// they are made absolute.
    pub fn run(&self, args: &[&str]) -> Ran {
        let mut is_path = false;
        let absolute = args.iter().map(|word| {
            if word.starts_with('-') {
                is_path = PATH_OPTIONS.contains(word);
                return OsString::from(word);
            }
            let has_ending = Path::new(word).extension().is_some_and(|ending| ENDINGS.iter().any(|e| ending == *e));
            if is_path || has_ending { self.path(word).into() } else { OsString::from(word) }
        });
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let words = std::iter::once("pinspot".into()).chain(absolute);
        let code = run(words, &Console::new(&mut stdout, &mut stderr));
        Ran { code, stdout, stderr }
    }

    /// A process of the command, which works in the folder.
    pub fn process(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pinspot"));
        command.args(args).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// Renders the scene with more arguments; the CPU back end, so that messages do not depend on the machine.
    pub fn render(&self, more: &[&str]) -> Ran {
        self.run(&[&["render", "scene.toml", "-o", "out.exr", "--backend", "cpu"], more].concat())
    }

    /// Asserts that a command fails with exit code 1, one line on stderr that has all of `parts`, and no output file.
    pub fn refuses(&self, args: &[&str], parts: &[&str]) {
        self.refuses_with(1, args, parts);
    }

    /// The same for a wrong command line.
    pub fn refuses_command_line(&self, args: &[&str], parts: &[&str]) {
        self.refuses_with(2, args, parts);
    }

    fn refuses_with(&self, code: u8, args: &[&str], parts: &[&str]) {
        let output = self.run(args);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.code, code, "{args:?}: {stderr}");
        let start = if code == 1 { "pinspot:" } else { "error:" };
        let lines: Vec<&str> = stderr.lines().filter(|l| l.starts_with(start)).collect();
        assert_eq!(lines.len(), 1, "{stderr}");
        for part in parts {
            assert!(lines[0].contains(part), "{args:?}: '{part}' is not in: {stderr}");
        }
        let left: Vec<_> = std::fs::read_dir(self.0.path()).unwrap().map(|f| f.unwrap().file_name()).collect();
        assert!(
            !left
                .iter()
                .any(|f| f.to_string_lossy().starts_with("out.") || f.to_string_lossy().starts_with(".pinspot")),
            "{left:?}"
        );
    }

    pub fn refuses_scene(&self, parts: &[&str]) {
        self.refuses(&["render", "scene.toml", "-o", "out.exr", "--backend", "cpu"], parts);
    }

    pub fn replace(&self, from: &str, to: &str) {
        assert!(SCENE.contains(from));
        self.write("scene.toml", SCENE.replace(from, to));
    }
}

pub fn exr(path: &Path, width: usize, height: usize, value: f32) {
    exr::prelude::write_rgb_file(path, width, height, |_, _| (value, value, value)).unwrap();
}

/// The long options of a command, as its help has them.
fn options_of(place: &Workplace, command: &str) -> BTreeSet<String> {
    let help = String::from_utf8(place.run(&[command, "--help"]).stdout).unwrap();
    let listed = help.lines().map(str::trim_start).filter(|line| line.starts_with('-'));
    let long = listed.filter_map(|line| line.split([' ', ',']).find(|word| word.starts_with("--")));
    long.map(str::to_owned).filter(|option| option != "--help").collect()
}

/// Fails when a command has an option that no case names, so that a new one needs a case.
pub fn assert_all_named<'a>(place: &Workplace, command: &str, named: impl IntoIterator<Item = &'a str>) {
    let named: BTreeSet<String> = named.into_iter().filter(|word| word.starts_with("--")).map(str::to_owned).collect();
    assert_eq!(named, options_of(place, command), "the options of {command}: exercised here, and in its help");
}

/// The adapters of this machine, which are examined once: that compiles pipelines on each.
pub fn adapters(place: &Workplace) -> &'static serde_json::Value {
    static ADAPTERS: OnceLock<serde_json::Value> = OnceLock::new();
    ADAPTERS.get_or_init(|| serde_json::from_slice(&place.run(&["adapters", "--json"]).stdout).unwrap())
}

pub fn first_adapter(place: &Workplace) -> String {
    adapters(place)[0]["name"].as_str().expect("run the tests by tests/run").to_owned()
}
