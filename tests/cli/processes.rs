//! Real processes: exit codes, relative paths, pipes, signals, terminals, and an environment without a Vulkan driver.

use std::ffi::OsStr;
use std::io::pipe;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::workplace::{SCENE, Workplace};

fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap()
}

#[test]
fn renders_png_and_exr_and_reports() {
    let place = Workplace::new();
    let output = place
        .process(&["render", "scene.toml", "-o", "out.png", "out.exr", "--backend", "cpu", "--aov", "caustic,depth"])
        .arg("--json")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["scene"], "scene");
    assert_eq!(report["backend"], "cpu");
    assert_eq!(report["size"], serde_json::json!([24, 16]));
    assert!(report["lookups"].as_f64().unwrap() > 0.0);
    assert!(report["seconds"]["caustic"].as_f64().unwrap() > 0.0);
    let caustic = pinspot::image::read_exr(&place.path("out.exr"), "caustic").unwrap();
    assert_eq!((caustic.width, caustic.height), (24, 16));
    assert!(caustic.mean().x > 0.0);
    let depth = pinspot::image::read_exr(&place.path("out.exr"), "depth").unwrap();
    // The table is five metres down; nothing is behind its edge, where the picture is wider.
    assert!((depth.pixels[8 * 24 + 4].x - 5.0).abs() < 1e-4);
    assert_eq!(depth.pixels[0].x, -1.0);
    assert_eq!(&std::fs::read(place.path("out.png")).unwrap()[..4], b"\x89PNG");
}

#[test]
fn exit_codes_tell_errors_from_wrong_command_lines() {
    let place = Workplace::new();
    let run = |args: &[&str]| {
        let Output { status, stdout, stderr } = place.process(args).output().unwrap();
        (status.code(), text(stdout), text(stderr))
    };
    let (code, out, err) = run(&["render", "ring-naturel", "-o", "out.png"]);
    assert!(code == Some(1) && out.is_empty(), "{out}");
    assert!(err.starts_with("pinspot: error: ") && err.contains("did you mean 'ring-natural'"), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    let (code, out, err) = run(&["rendr", "ring"]);
    assert!(code == Some(2) && out.is_empty() && err.starts_with("error: ") && err.contains("'rendr'"), "{err}");
    let (code, out, err) = run(&["--version"]);
    assert!(code == Some(0) && err.is_empty(), "{err}");
    assert_eq!(out, format!("pinspot {}\n", env!("CARGO_PKG_VERSION")));
}

/// As behind `pinspot scenes | head -1`, when `head` has ended.
#[test]
fn a_closed_pipe_is_no_error() {
    let place = Workplace::new();
    let closed = || {
        let (reader, writer) = pipe().unwrap();
        drop(reader);
        writer
    };
    let output = place.process(&["scenes"]).stdout(closed()).output().unwrap();
    assert_eq!((output.status.code(), text(output.stderr)), (Some(0), String::new()));
    let render = ["render", "scene.toml", "-o", "out.exr", "--backend", "cpu"];
    assert_eq!(place.process(&render).stderr(closed()).status().unwrap().code(), Some(0));
    assert!(place.path("out.exr").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_behind_standard_output_is_an_error() {
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = Workplace::new().process(&["scenes"]).stdout(full).output().unwrap();
    let said = text(output.stderr);
    assert!(output.status.code() == Some(1) && said.contains("cannot write to standard output"), "{said}");
}

/// A process that would work for ever; it ends with the test at the latest.
struct Endless(Child);

impl Endless {
    fn start(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    /// Waits until the process has written what is asked for.
    fn wait_until(&mut self, is_there: impl Fn() -> bool) {
        let started = Instant::now();
        while !is_there() {
            assert!(self.0.try_wait().unwrap().is_none(), "it ended before that");
            assert!(started.elapsed() < Duration::from_mins(1), "it has not written it after a minute");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Endless {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The number of passes in a reference's file: it is in the header's text.
#[cfg(unix)]
fn passes_in(path: &Path) -> u64 {
    let bytes = std::fs::read(path).unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]).into_owned();
    let number = text.split_once("\"passes\":").map(|(_, rest)| rest.split(',').next().unwrap().parse().unwrap());
    number.unwrap_or_default()
}

/// A reference that is ended has kept what it knew, and the same command goes on from there.
#[cfg(unix)]
#[test]
fn a_reference_that_is_ended_goes_on() {
    use std::os::unix::process::ExitStatusExt;
    const PASSES: u64 = 5;
    let place = Workplace::new();
    let reference =
        |file, goal| ["reference", "ring", "-o", file, "--size", "12x12", "--rel-error", goal, "--quiet", "--json"];
    let mut process = Endless::start(&mut place.process(&reference("ring.exr", "1e-7")));
    process.wait_until(|| passes_in(&place.path("ring.exr")) >= PASSES);
    // Not SIGINT, which shells have background processes ignore.
    let ended = Command::new("sh").args(["-c", "kill -TERM $0", &process.0.id().to_string()]).status().unwrap();
    assert!(ended.success());
    assert_eq!(process.0.wait().unwrap().signal(), Some(15));
    let [new, ended] = ["new.exr", "ring.exr"].map(|file| {
        let output = place.run(&reference(file, "10"));
        assert!(output.succeeded(), "{}", text(output.stderr));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        report["passes"].as_u64().unwrap()
    });
    assert!(new < PASSES && ended >= PASSES, "{new} passes are enough, and {ended} were known");
}

/// A sequence that is killed leaves whole frames only, and the same command renders the others.
#[test]
fn a_killed_sequence_leaves_whole_frames() {
    let place = Workplace::new();
    let moving = "[[animation]]\nobject = \"ring\"\ntranslate = [[0.0, [0, 0, 0]], [1.0, [0.5, 0, 0]]]\n";
    place.write("moving.toml", format!("{SCENE}{moving}"));
    let render =
        |frames| ["render", "moving.toml", "--backend", "cpu", "--frames", frames, "-o", "f-###.png", "f-###.exr"];
    let mut process = Endless::start(&mut place.process(&render("0..900")));
    process.wait_until(|| place.path("f-002.exr").exists());
    drop(process);
    for k in 0..3 {
        image::open(place.path(format!("f-{k:03}.png"))).unwrap();
        pinspot::image::read_exr(&place.path(format!("f-{k:03}.exr")), "").unwrap();
    }
    let output = place.run(&[&render("0..3")[..], &["--json"]].concat());
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["kept"], &report["rendered"]), (&3.into(), &0.into()));
}

/// Runs the command in a terminal of its own, and returns what that shows.
#[cfg(target_os = "linux")]
fn in_a_terminal(place: &Workplace, args: &str) -> (Option<i32>, String) {
    let command = format!("'{}' {args}", env!("CARGO_BIN_EXE_pinspot"));
    let output = Command::new("script")
        .args(["--quiet", "--return", "--command", &command, "/dev/null"])
        .current_dir(place.path(""))
        .env("TERM", "xterm")
        .env_remove("NO_COLOR")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    (output.status.code(), text(output.stdout))
}

#[cfg(target_os = "linux")]
#[test]
fn progress_and_colours_are_for_terminals() {
    const BAR: &str = "(left: ";
    const COLOUR: &str = "\u{1b}[";
    let place = Workplace::new();
    let reference = "reference scene.toml -o a.exr --rel-error 1e-9 --seconds 1 --force";
    let (code, shown) = in_a_terminal(&place, reference);
    assert!(code == Some(0) && shown.contains(BAR) && shown.contains("time is up"), "{shown}");
    let (code, shown) = in_a_terminal(&place, &format!("{reference} --quiet"));
    assert!(code == Some(0) && !shown.contains(BAR), "{shown}");
    let words: Vec<&str> = reference.split(' ').collect();
    let said = text(place.process(&words).output().unwrap().stderr);
    assert!(said.contains("time is up") && !said.contains(BAR) && !said.contains(COLOUR), "{said}");
    let (code, shown) = in_a_terminal(&place, "rendr");
    assert!(code == Some(2) && shown.contains(COLOUR), "{shown}");
    let said = text(place.process(&["rendr"]).output().unwrap().stderr);
    assert!(!said.contains(COLOUR), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn machines_without_a_gpu_render_on_the_cpu() {
    let place = Workplace::new();
    let run = |args: &[&str]| {
        let mut process = place.process(args);
        for list in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
            process.env(list, "/nowhere.json");
        }
        let Output { status, stdout, stderr } = process.output().unwrap();
        (status.code(), text(stdout), text(stderr))
    };
    let (code, out, _) = run(&["adapters"]);
    assert!(code == Some(0) && out.contains("no GPU adapter found"), "{out}");
    let render = ["render", "scene.toml", "-o", "out.exr"];
    let (code, _, err) = run(&render);
    assert!(code == Some(0) && err.contains("on the CPU"), "{err}");
    let (code, _, err) = run(&[&render[..], &["--backend", "gpu"]].concat());
    assert!(code == Some(1) && err.contains("give --backend cpu, or install a Vulkan driver"), "{err}");
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_names_need_no_unicode() {
    use std::os::unix::ffi::OsStrExt;
    let place = Workplace::new();
    std::fs::create_dir(place.path("real")).unwrap();
    std::os::unix::fs::symlink("real/picture.exr", place.path("out.exr")).unwrap();
    assert!(place.render(&["--quiet"]).succeeded());
    assert!(place.path("out.exr").is_symlink() && place.path("real/picture.exr").is_file());
    let name = OsStr::from_bytes(b"re\xffport");
    let output = place
        .process(&["compare", "scene.toml", "--samples", "10", "--seeds", "1", "--filters", "none"])
        .args(["--rel-error", "0.5", "--backend", "cpu", "-o"])
        .arg(name)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let folder = place.path(name);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("report.json")).unwrap()).unwrap();
    let command = report["made_with"].as_array().unwrap().iter().find(|entry| entry[0] == "Command").unwrap();
    assert!(command[1].as_str().unwrap().ends_with("-o re\u{fffd}port"), "{command}");
}

/// Mesa's layer for the choice of a device asks for a Wayland compositor, even where there cannot be one.
#[cfg(unix)]
#[test]
fn without_a_session_nothing_is_said_of_it() {
    let place = Workplace::new();
    let mut command = place.process(&["adapters"]);
    for variable in ["XDG_RUNTIME_DIR", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        command.env_remove(variable);
    }
    let output = command.output().unwrap();
    let said = text(output.stderr);
    assert!(output.status.success() && !said.contains("XDG_RUNTIME_DIR"), "{said}");
}

/// Without a file to write to, the picture has the scene's name.
#[test]
fn pictures_have_the_names_of_their_scenes() {
    let place = Workplace::new();
    let words = ["render", "scene.toml", "--size", "4x4", "--samples", "20", "--backend", "cpu"];
    let output = place.process(&words).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(place.path("scene.png").is_file());
}
