//! Scenes at random: what holds on the built-in ones holds on others, too. Each is rendered as by default, and compared with the ground truth,
//! whose flux is accounted for.
//!
//! Mirrors are smooth: what rough ones may differ by is in `gloss.rs`.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use glam::DVec3;
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::reference::{self, Estimate, Reference, ReferenceError, StoppingCriterion};
use pinspot::scene::{Scene, SceneError, parse};
use pinspot::{BackendChoice, NoProgress, Options};
use rand::rngs::ChaCha8Rng;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};

use crate::support::meshes::{cone, paraboloid, trough};
use crate::support::render;

/// Width and height of all pictures.
const SIZE: u32 = 32;

/// A scene of about two metres, times its scale.
struct Random {
    rng: ChaCha8Rng,
    scale: f64,
}

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.rng.random_range(low..high)
    }

    /// Evenly in its logarithm.
    fn of_order(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    fn one_of<'a>(&mut self, choices: &[&'a str]) -> &'a str {
        choices.choose(&mut self.rng).expect("some")
    }

    /// Upwards within an angle, degrees.
    fn upwards(&mut self, most_deg: f64) -> DVec3 {
        let (tilt, turn) = (self.between(0.0, most_deg).to_radians(), self.between(0.0, 360.0).to_radians());
        DVec3::new(tilt.sin() * turn.cos(), tilt.cos(), tilt.sin() * turn.sin())
    }

    fn lengths(&self, lengths: DVec3) -> String {
        let [x, y, z] = (lengths * self.scale).to_array();
        format!("[{x:.9}, {y:.9}, {z:.9}]")
    }

    fn length(&self, length: f64) -> String {
        format!("{:.9}", length * self.scale)
    }

    fn finish(&mut self) -> String {
        let colour = match self.one_of(&["perfect", "grey", "metal"]) {
            "perfect" => String::new(),
            "grey" => "reflectance = [0.9, 0.8, 0.5], ".into(),
            _ => format!("metal = \"{}\", ", self.one_of(&["gold", "copper", "aluminium"])),
        };
        format!("{colour}sides = \"{}\"", self.one_of(&["front", "both", "both"]))
    }

    /// An object that casts a caustic on the floor, with its mesh, and a place near its middle.
    fn mirror(&mut self) -> (String, Vec<u8>, DVec3) {
        let scale = self.scale as f32;
        let file = "mesh = \"mirror.obj\"".to_owned();
        let mut mesh = Vec::new();
        let finish = self.finish();
        let reflector = format!("reflector = {{ {finish} }}");
        let height = self.of_order(0.4, 3.0);
        let turned = |around: f64, tilt: f64| format!("rotate_deg = [{:.3}, {:.3}, 0]", 90.0 + tilt, around);
        let (shape, place, rotation, material) = match self.rng.random_range(0..9) {
            0 => {
                let focal_length = self.of_order(0.1, 1.5) as f32;
                mesh = paraboloid(focal_length * scale, [0.1 * focal_length * scale, 0.5 * scale]);
                let rotation = turned(self.between(0.0, 360.0), self.between(-35.0, 35.0));
                (file, DVec3::new(0.0, height, 0.0), rotation, reflector)
            }
            1 => {
                mesh = trough(self.of_order(0.15, 1.0) as f32 * scale, scale, 0.8 * scale);
                let rotation = format!("rotate_deg = [{:.3}, 0, 0]", self.between(140.0, 220.0));
                (file, DVec3::new(0.0, height, 0.0), rotation, reflector)
            }
            2 => {
                let slope = self.between(0.2, 3.0) as f32;
                mesh = cone(slope, [0.05 * scale, 0.4 * scale]);
                let rotation = turned(self.between(0.0, 360.0), self.between(-30.0, 30.0));
                (file, DVec3::new(0.0, height, 0.0), rotation, reflector)
            }
            3 => {
                let shape = format!("shape = {{ sphere = {{ radius = {} }} }}", self.length(0.3));
                (shape, DVec3::new(0.2, 0.4 * height + 0.3, 0.0), String::new(), reflector)
            }
            4 => {
                let (radius, tall) = (self.length(0.6), self.of_order(0.1, 0.8));
                let shape = format!("shape = {{ ring = {{ radius = {radius}, height = {} }} }}", self.length(tall));
                (shape, DVec3::ZERO, String::new(), reflector)
            }
            5 => {
                let size = self.length(0.4);
                let shape = format!("shape = {{ disco-ball = {{ radius = {size}, rows = 12 }} }}");
                (shape, DVec3::new(0.0, 0.5 + height, 0.0), String::new(), reflector)
            }
            6 => {
                let shape = format!("shape = {{ plane = {{ size = [{}, {}] }} }}", self.length(0.8), self.length(0.6));
                let rotation = format!("rotate_deg = [0, 0, {:.3}]", self.between(-150.0, -60.0));
                (shape, DVec3::new(-0.8, 0.3 * height + 0.4, 0.1), rotation, reflector)
            }
            kind => {
                let wavelength = self.of_order(0.2, 1.5);
                let amplitude = wavelength * self.of_order(0.003, 0.08);
                let [size, amplitude, wavelength] = [3.0, amplitude, wavelength].map(|length| self.length(length));
                let shape = format!(
                    "shape = {{ sheet = {{ size = [{size}, {size}], amplitude = {amplitude}, wavelength = {wavelength} }} }}"
                );
                let water = format!("refractor = {{ eta = 1.333, fresnel = {} }}", kind == 7);
                (shape, DVec3::new(0.0, 0.3 * height, 0.0), String::new(), water)
            }
        };
        let at = self.lengths(place);
        let object = format!(
            "[[object]]\nname = \"mirror\"\n{shape}\ntranslate = {at}\n{rotation}\n{material}\ncamera_visible = false\n"
        );
        (object, mesh, place)
    }

    /// What lights it, and the environment.
    fn light(&mut self, near: DVec3, least_height: f64) -> String {
        let dark = "environment = { constant = [0, 0, 0] }\n";
        match self.rng.random_range(0..7) {
            0 => {
                let map = self.one_of(&["clear-sky", "studio", "forest", "city"]);
                format!("environment = {{ map = \"{map}\", rotation_deg = {:.1} }}\n", self.between(0.0, 360.0))
            }
            1 => {
                let (towards, sigma) = (self.upwards(75.0), self.of_order(0.003, 0.3));
                format!(
                    "environment = {{ spot = {{ direction = [{:.6}, {:.6}, {:.6}], sigma_rad = {sigma:.6}, radiance = [100, 90, 70] }} }}\n",
                    towards.x, towards.y, towards.z
                )
            }
            2 | 3 => {
                let (towards, sigma) = (self.upwards(75.0), self.of_order(0.0023, 0.02));
                format!(
                    "{dark}[[light]]\ndirectional = {{ direction = [{:.6}, {:.6}, {:.6}], irradiance = [1000, 900, 700], sigma_rad = {sigma:.6} }}\n",
                    towards.x, towards.y, towards.z
                )
            }
            kind => {
                // In a mirror, before it, or far away.
                let distance = [0.15, 0.7, 4.0][kind - 4];
                let place =
                    near + self.upwards(if kind == 4 { 180.0 } else { 80.0 }) * distance * self.between(0.7, 1.4);
                // Above interfaces: what is behind them does not light them.
                let place = DVec3::new(place.x, place.y.max(least_height), place.z);
                let (radius, at) = (self.of_order(0.005, 0.08) * distance.max(0.5), self.lengths(place));
                // The smallest radius of a sphere is a tenth of a millimetre.
                let (radius, power) = (self.length(radius.max(1.1e-4 / self.scale)), self.scale * self.scale);
                format!(
                    "{dark}[[light]]\nposition = {at}\nradius = {radius}\nintensity = [{power:.9}, {power:.9}, {:.9}]\n",
                    0.5 * power
                )
            }
        }
    }

    /// The text of a scene and what is read from it; an error where it is refused: a lamp may lie inside of a mirror.
    fn scene(seed: u64) -> (String, Result<Scene, SceneError>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let scale = 10f64.powf(rng.random_range(-3.0..3.0));
        let mut random = Self { rng, scale };
        let (mirror, mesh, place) = random.mirror();
        let least_height = if mirror.contains("refractor") { place.y + 0.3 } else { 0.15 };
        let light = random.light(place, least_height);
        let view = random.length(2.5);
        let (camera, far) = (random.lengths(DVec3::new(0.0, 9.0, 0.0)), random.length(20.0));
        let mut text = light;
        let albedo = random.one_of(&["0", "0", "0.6"]);
        write!(
            text,
            "[camera]\nposition = {camera}\ntarget = [0, 0, 0]\nup = [0, 0, -1]\northographic = {{ height = {view} }}\n\
             [[object]]\nname = \"floor\"\nshape = {{ plane = {{ size = [{far}, {far}] }} }}\nreceiver = {{ albedo = [{albedo}, {albedo}, {albedo}] }}\n{mirror}"
        )
        .unwrap();
        let assets = HashMap::from([(PathBuf::from("mirror.obj"), mesh)]);
        let scene = parse::<toml::Table>("random.toml", &text, &assets).map(|loaded| loaded.scene);
        (text, scene)
    }
}

/// Errors that any scene may have by default, relative to the truth, of single pixels and of the picture's flux; what the truth itself does not
/// know comes on top.
const MOST_ERROR: f64 = 0.05;
const MOST_FLUX_ERROR: f64 = 0.02;
/// The error that a truth has: what is not known so well in these seconds, of mirrors that show almost no light, for one, is not compared. Thus
/// a slow machine compares less, and no other truths. `FURTHER_OFF` was found with six times as many seconds.
const ERROR_OF_TRUTH: f64 = 0.015;
const SECONDS: f64 = 2.0;
/// The same for scenes that are off: the first passes of a truth may claim a smaller error than they have.
const MORE_SECONDS: f64 = 12.0;
/// Caustics of less than this part of the direct light are not compared.
const INVISIBLE: f64 = 1e-3;
/// The part of the scenes that have a truth.
const LEAST_KNOWN: f64 = 0.5;

/// Scenes that are further off: short waves, whose foci and cusps need more cells than there are by default (14, 58, 85, 86, 95, 108, 113, 126,
/// 135, 140, 142, 146, 147, 165, 175, 176, 185, 196); the feet of rings in light that falls along their walls (15, 35, 57, 87, 141, 172); cones and
/// troughs whose facets such light grazes (91, 93, 103); small tiles, whose edges are blurred (64, 190). No other may join them, and those that
/// are right leave the list.
const FURTHER_OFF: [u64; 29] = [
    14, 15, 35, 57, 58, 64, 85, 86, 87, 91, 93, 95, 103, 108, 113, 126, 135, 140, 141, 142, 146, 147, 165, 172, 175,
    176, 185, 190, 196,
];

/// How a picture is.
enum Compared {
    Right(String),
    /// What it should be is not known.
    Unknown,
    Wrong(String),
}

/// Compares a scene's picture with the truth.
fn compared(seed: u64) -> Compared {
    let (text, scene) = Random::scene(seed);
    let scene = match scene {
        Ok(scene) => scene,
        Err(e) if e.to_string().contains("lies inside") => return Compared::Right("refused".into()),
        Err(e) => panic!("seed {seed}: {e}\n{text}"),
    };
    let wrong = |what: &str| Compared::Wrong(format!("seed {seed}: {what}\n{text}"));
    let options = Options::default().with_size([SIZE; 2]).with_aovs(vec![Aov::Caustic, Aov::Direct]);
    let [found, direct] = match render(scene.clone(), options, &BackendChoice::Cpu) {
        Ok(found) => found.layers.into_iter().map(|(_, image)| image).collect::<Vec<_>>().try_into().expect("two"),
        Err(e) => return wrong(&e.to_string()),
    };
    let beside_truth = |seconds: f64| match truth(scene.clone(), seconds) {
        Ok(truth) => beside(&truth, [&found, &direct]),
        // More time would make it one.
        Err(ReferenceError::Unbalanced { .. }) => Compared::Unknown,
        Err(e) => Compared::Wrong(e.to_string()),
    };
    let first = beside_truth(SECONDS);
    let is_surprising = matches!(first, Compared::Wrong(_)) && !FURTHER_OFF.contains(&seed);
    match if is_surprising { beside_truth(MORE_SECONDS) } else { first } {
        Compared::Wrong(what) => wrong(&what),
        other => other,
    }
}

/// Compares a caustic with the truth.
fn beside(truth: &Estimate, [found, direct]: [&Image; 2]) -> Compared {
    let wrong = |what: &str| Compared::Wrong(what.to_owned());
    let own_error = truth.rel_error();
    let flux = |image: &Image| f64::from(image.mean().element_sum());
    // Beside direct light it cannot be seen.
    let invisible = INVISIBLE * flux(direct);
    if flux(&truth.irradiance) <= invisible {
        return match flux(found) <= 2.0 * invisible {
            true => Compared::Right("black".into()),
            // A truth is dark as long as no light was found.
            false if own_error > ERROR_OF_TRUTH => Compared::Unknown,
            false => wrong("is not black"),
        };
    }
    if own_error > ERROR_OF_TRUTH {
        return Compared::Unknown;
    }
    let error = rel_l2(found, &truth.irradiance, None);
    let of_flux = flux(found) / flux(&truth.irradiance) - 1.0;
    let line = format!("error {error:.4}, flux {of_flux:+.4}, truth ± {own_error:.4}");
    let is_right = error <= MOST_ERROR + 2.0 * own_error && of_flux.abs() <= MOST_FLUX_ERROR + own_error;
    if is_right { Compared::Right(line) } else { wrong(&line) }
}

fn truth(scene: Scene, seconds: f64) -> Result<Estimate, ReferenceError> {
    let wanted = reference::Options { size: [SIZE; 2], ..Default::default() };
    let reference = Reference::new(scene, wanted)?;
    let started = Instant::now();
    let seconds_left = || seconds - started.elapsed().as_secs_f64();
    let goal = StoppingCriterion::new(ERROR_OF_TRUTH).with_seconds_left(&seconds_left);
    reference.solve(&goal, None, &NoProgress, &mut |_| Ok(()))
}

fn are_as_the_truth_says(seeds: std::ops::Range<u64>) {
    let (mut known, mut wrong) = (0, Vec::new());
    let count = (seeds.end - seeds.start) as f64;
    for seed in seeds {
        match compared(seed) {
            Compared::Right(line) => {
                println!("seed {seed}: {line}");
                known += 1;
            }
            Compared::Unknown => println!("seed {seed}: unknown"),
            Compared::Wrong(line) => {
                println!("{}", line.lines().next().unwrap_or_default());
                known += 1;
                if !FURTHER_OFF.contains(&seed) {
                    wrong.push(line);
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} scenes:\n{}", wrong.len(), wrong.join("\n"));
    assert!(f64::from(known) >= LEAST_KNOWN * count, "only {known} of {count} have a truth");
}

#[test]
fn twelve_scenes_are_as_the_truth_says() {
    are_as_the_truth_says(0..12);
}

#[test]
#[ignore = "full: ground truths of 188 scenes"]
fn two_hundred_scenes_are_as_the_truth_says() {
    are_as_the_truth_says(12..200);
}
