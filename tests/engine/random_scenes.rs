//! Scenes at random: what holds on the built-in ones holds on others, too. Each is computed as by default, as a flat sum over the same cells, and
//! by the ground truth, which keeps a ledger of its own.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::PathBuf;

use glam::DVec3;
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::reference::{self, Reference, StoppingCriterion};
use pinspot::scene::{Scene, parse};
use pinspot::{BackendChoice, EvaluationChoice, NoProgress, Options};
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
        let roughness = match self.rng.random_range(0..4) {
            0 => format!("roughness = {:.3}, ", self.between(0.1, 0.6)),
            _ => String::new(),
        };
        format!("{colour}{roughness}sides = \"{}\"", self.one_of(&["front", "both", "both"]))
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
                let (size, amplitude) = (self.length(3.0), self.of_order(0.002, 0.1));
                let shape = format!("shape = {{ sheet = {{ size = [{size}, {size}], amplitude = {} }} }}", self.length(amplitude));
                let water = format!("refractor = {{ eta = 1.333, fresnel = {} }}", kind == 7);
                (shape, DVec3::new(0.0, 0.3 * height, 0.0), String::new(), water)
            }
        };
        let at = self.lengths(place);
        let object = format!("[[object]]\nname = \"mirror\"\n{shape}\ntranslate = {at}\n{rotation}\n{material}\ncamera_visible = false\n");
        (object, mesh, place)
    }

    /// What lights it, and the environment.
    fn light(&mut self, near: DVec3) -> String {
        let dark = "environment = { constant = [0, 0, 0] }\n";
        match self.rng.random_range(0..7) {
            0 => {
                let map = self.one_of(&["clear-sky", "studio", "forest", "grace-interior"]);
                let map = if map == "grace-interior" { "city" } else { map };
                format!("environment = {{ map = \"{map}\", rotation_deg = {:.1} }}\n", self.between(0.0, 360.0))
            }
            1 => {
                let (towards, sigma) = (self.upwards(75.0), self.of_order(0.003, 0.3));
                format!("environment = {{ spot = {{ direction = [{:.6}, {:.6}, {:.6}], sigma_rad = {sigma:.6}, radiance = [100, 90, 70] }} }}\n", towards.x, towards.y, towards.z)
            }
            2 | 3 => {
                let (towards, sigma) = (self.upwards(75.0), self.of_order(0.0023, 0.02));
                format!("{dark}[[light]]\ndirectional = {{ direction = [{:.6}, {:.6}, {:.6}], irradiance = [1000, 900, 700], sigma_rad = {sigma:.6} }}\n", towards.x, towards.y, towards.z)
            }
            kind => {
                // In a mirror, before it, or far away.
                let distance = [0.15, 0.7, 4.0][kind - 4];
                let place = near + self.upwards(if kind == 4 { 180.0 } else { 80.0 }) * distance * self.between(0.7, 1.4);
                let place = DVec3::new(place.x, place.y.max(0.15), place.z);
                let (radius, at) = (self.of_order(0.005, 0.08) * distance.max(0.5), self.lengths(place));
                let (radius, power) = (self.length(radius), self.scale * self.scale);
                format!("{dark}[[light]]\nposition = {at}\nradius = {radius}\nintensity = [{power:.9}, {power:.9}, {:.9}]\n", 0.5 * power)
            }
        }
    }

    fn scene(seed: u64) -> (String, Scene) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let scale = 10f64.powf(rng.random_range(-3.0..3.0));
        let mut random = Self { rng, scale };
        let (mirror, mesh, place) = random.mirror();
        let light = random.light(place);
        let view = random.length(random.scale.signum() * 2.5);
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
        let scene = parse::<toml::Table>("random.toml", &text, &assets).unwrap_or_else(|e| panic!("{seed}: {e}\n{text}"));
        (text, scene.scene)
    }
}

fn caustic(scene: &Scene, options: Options) -> Image {
    render(scene.clone(), options.with_aovs(vec![Aov::Caustic]), &BackendChoice::Cpu).unwrap().layers.remove(0).1
}

/// Root mean square of the channels' sum over the pixels.
fn rms(pixels: impl Iterator<Item = glam::Vec3>) -> f64 {
    let (sum, count) = pixels.fold((0.0, 0), |(sum, count), p| (sum + f64::from(p.element_sum()).powi(2), count + 1));
    (sum / f64::from(count)).sqrt()
}

#[test]
#[ignore = "exploration"]
fn explore() {
    let range = std::env::var("SEEDS").unwrap_or_else(|_| "0..20".into());
    let (from, to) = range.split_once("..").unwrap();
    for seed in from.parse::<u64>().unwrap()..to.parse::<u64>().unwrap() {
        let (text, scene) = Random::scene(seed);
        let what = text.lines().filter(|l| !l.contains("camera") && !l.contains("floor")).collect::<Vec<_>>().join(" ");
        let started = std::time::Instant::now();
        let seconds = || started.elapsed().as_secs_f64();
        let options = Options::default().with_size([SIZE; 2]);
        let fast = caustic(&scene, options.clone());
        let t_fast = seconds();
        let flat = caustic(&scene, options.with_evaluation(EvaluationChoice::Flat));
        let t_flat = seconds() - t_fast;
        let wanted = reference::Options { size: [SIZE; 2], ..Default::default() };
        let reference = Reference::new(scene, wanted).unwrap();
        let limit = || 20.0 - (seconds() - t_fast - t_flat);
        let goal = StoppingCriterion::new(0.005).with_seconds_left(&limit);
        let found = reference.solve(&goal, None, &NoProgress, &mut |_| Ok(()));
        let t_ref = started.elapsed().as_secs_f64() - t_fast - t_flat;
        let mean = |image: &Image| f64::from(image.mean().element_sum());
        let from_leaves = rms(fast.pixels.iter().zip(&flat.pixels).map(|(a, b)| *a - *b)) / rms(flat.pixels.iter().copied());
        let energy = mean(&fast) / mean(&flat);
        match found {
            Ok(truth) => {
                let error = rel_l2(&fast, &truth.irradiance, None);
                let flat_error = rel_l2(&flat, &truth.irradiance, None);
                let of_truth = mean(&fast) / mean(&truth.irradiance);
                println!("{seed} [{t_fast:.1} {t_flat:.1} {t_ref:.1} s] leaves {from_leaves:.4} {energy:.4} | truth {error:.4} (flat {flat_error:.4}) {of_truth:.4} ± {:.4} beams {} | {what}", truth.rel_error(), reference.uses_beams());
            }
            Err(e) => println!("{seed} [{t_fast:.1} {t_flat:.1} {t_ref:.1} s] leaves {from_leaves:.4} {energy:.4} | {e} | {what}"),
        }
    }
}
