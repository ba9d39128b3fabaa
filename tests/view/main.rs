//! The window under Xvfb, on Mesa's software adapter: it opens, shows a finished picture, and says in words why it cannot.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use tempfile::TempDir;

/// The scene, whose picture takes a second.
const SCENE: &str = r#"
[environment]
spot = { direction = [0.6, 0.7, -0.35], sigma_rad = 0.03, radiance = [180.0, 170.0, 150.0] }
[camera]
position = [0.0, 3.2, 2.6]
target = [0.0, 0.05, 0.0]
perspective = { fov_y_deg = 40.0 }
[render]
samples = 300
leaves = 16
tolerance = 0.05
[[object]]
name = "ring"
shape = { ring = {} }
reflector = { metal = "gold" }
[[object]]
name = "table"
shape = { plane = { size = [6.0, 6.0] } }
receiver = { albedo = [0.4, 0.42, 0.45] }
[[animation]]
object = "ring"
rotate_deg = [[0.0, [0.0, 0.0, 0.0]], [4.0, [0.0, 0.0, 20.0]]]
"#;

/// Mean difference of a channel, levels of 255, that other versions of Mesa and other processors may make.
const MOST_MEAN: f64 = 1.5;
/// Part of the pixels that may differ by more than [`STRAY`] levels: edges of letters and of shadows.
const MOST_STRAYS: f64 = 0.01;
const STRAY: u8 = 24;

/// A display without a screen.
struct Display {
    server: Child,
    name: String,
}

impl Display {
    fn open() -> Self {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb is installed; tests/run does that");
        let mut number = String::new();
        let stdout = server.stdout.take().expect("it is piped");
        BufReader::new(stdout).read_line(&mut number).expect("Xvfb says which display it opened");
        Self { server, name: format!(":{}", number.trim()) }
    }

    /// Opens the window with more arguments, and waits until it closes.
    fn view(&self, folder: &Path, args: &[&str]) -> Output {
        view(Some(&self.name), folder, args)
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

fn view(display: Option<&str>, folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinspot"));
    command.arg("view").args(args).current_dir(folder).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    match display {
        Some(display) => command.env("DISPLAY", display),
        None => command.env_remove("DISPLAY"),
    };
    command.output().unwrap()
}

fn place() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let path = folder.path().to_owned();
    (folder, path)
}

fn error_of(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    text.lines().find(|line| line.starts_with("pinspot: error:")).unwrap_or_else(|| panic!("{text}")).to_owned()
}

#[test]
fn a_window_opens_and_shows_a_finished_picture() {
    let (_folder, path) = place();
    let output = Display::open().view(&path, &["scene.toml", "--backend", "cpu", "--screenshot", "shot.png"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let actual = image::open(path.join("shot.png")).unwrap().into_rgb8();
    let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/view/window.png");
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join("window.png");
    actual.save(&kept).unwrap();
    let expected = image::open(&stored).unwrap().into_rgb8();
    assert_eq!(actual.dimensions(), expected.dimensions(), "see {}", kept.display());
    // The lower left corner tells the seconds that the picture took, which differ.
    let (width, height) = actual.dimensions();
    let is_compared = |x: u32, y: u32| !(x < 420 && y > height - 80);
    let (mut sum, mut strays, mut count) = (0.0, 0, 0);
    for (x, y, pixel) in actual.enumerate_pixels().filter(|(x, y, _)| is_compared(*x, *y)) {
        let differences = pixel.0.iter().zip(expected.get_pixel(x, y).0).map(|(a, b)| a.abs_diff(b));
        let most = differences.clone().max().unwrap_or(0);
        sum += differences.map(f64::from).sum::<f64>() / 3.0;
        strays += u32::from(most > STRAY);
        count += 1;
    }
    let (mean, strays) = (sum / f64::from(count), f64::from(strays) / f64::from(count));
    println!("{width}x{height}: {mean:.3} levels on average, {:.2} % of the pixels differ much", 100.0 * strays);
    assert!(mean < MOST_MEAN && strays < MOST_STRAYS, "compare {} with {}", kept.display(), stored.display());
    // The tolerance would not let a black picture pass: most of the window is the scene's, left of the panel.
    let scene = |picture: &image::RgbImage| {
        let pixels = picture.enumerate_pixels().filter(|(x, y, _)| *x < 2 * width / 3 && *y < 2 * height / 3);
        let levels: Vec<f64> = pixels.map(|(_, _, pixel)| f64::from(pixel.0[1])).collect();
        levels.iter().sum::<f64>() / levels.len() as f64
    };
    assert!(scene(&actual) > 10.0 * MOST_MEAN && scene(&expected) > 10.0 * MOST_MEAN);
}

#[test]
fn without_a_display_it_says_so() {
    let (_folder, path) = place();
    let message = error_of(&view(None, &path, &["scene.toml"]));
    assert!(message.contains("there is no display") && message.contains("pinspot render"), "{message}");
    let message = error_of(&view(Some(":987"), &path, &["scene.toml"]));
    assert!(message.contains("cannot open a window"), "{message}");
}

#[test]
fn what_cannot_be_opened_is_told_before_there_is_a_window() {
    let (_folder, path) = place();
    let message = error_of(&view(Some(":987"), &path, &["nothing.toml"]));
    assert!(message.contains("nothing.toml"), "{message}");
    std::fs::write(path.join("wrong.toml"), SCENE.replace("samples = 300", "samples = 0")).unwrap();
    let message = error_of(&view(Some(":987"), &path, &["wrong.toml"]));
    assert!(message.contains("wrong.toml:9: render.samples"), "{message}");
    let message = error_of(&view(Some(":987"), &path, &["scene.toml", "--screenshot", "no/folder.png"]));
    assert!(message.contains("folder 'no' does not exist"), "{message}");
}

/// Without a Vulkan driver there is a display, but nothing to draw with.
#[test]
fn without_a_driver_it_says_so() {
    let (_folder, path) = place();
    let display = Display::open();
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinspot"));
    let output = command
        .args(["view", "scene.toml"])
        .current_dir(&path)
        .env("DISPLAY", &display.name)
        .env("VK_DRIVER_FILES", path.join("none.json"))
        .env("VK_ICD_FILENAMES", path.join("none.json"))
        .output()
        .unwrap();
    let message = error_of(&output);
    assert!(message.contains("cannot open a window") && message.contains("mesa-vulkan-drivers"), "{message}");
}
