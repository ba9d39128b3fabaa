//! Lamps against closed forms and the ground truth: light from near, reflected, refracted and direct.

use glam::Vec3;
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::reference::{self, Quantity, Reference, StoppingCriterion};
use pinspot::scene::{Scene, parse};
use pinspot::{BackendChoice, NoProgress, Options};

use crate::support::render;

/// Looks straight down on the floor, from −½ to ½ times this, m.
fn above(height: f32) -> String {
    format!(
        "environment = {{ constant = [0, 0, 0] }}\n[camera]\nposition = [0, 9, 0]\ntarget = [0, 0, 0]\nup = [0, 0, -1]\n\
         orthographic = {{ height = {height} }}\n"
    )
}

const FLOOR: &str =
    "[[object]]\nname = \"floor\"\nshape = { plane = { size = [8, 8] } }\nreceiver = { albedo = [0, 0, 0] }\n";

fn lamp(position: [f32; 3], radius: f32) -> String {
    format!("[[light]]\nposition = {position:?}\nradius = {radius}\nintensity = [1, 2, 3]\n")
}

fn parsed(text: &str) -> Scene {
    parse::<toml::Table>("lamps.toml", text, std::path::Path::new(".")).unwrap().scene
}

fn layer(scene: Scene, aov: Aov, size: u32) -> Image {
    layer_of(scene, aov, size, &BackendChoice::Cpu)
}

fn layer_of(scene: Scene, aov: Aov, size: u32, choice: &BackendChoice) -> Image {
    let options = Options::default().with_size([size; 2]).with_aovs(vec![aov]);
    render(scene, options, choice).unwrap().layers.remove(0).1
}

fn truth(scene: Scene, quantity: Quantity, size: u32, error: f64) -> Image {
    let options = reference::Options { size: [size; 2], quantity, ..Default::default() };
    let reference = Reference::new(scene, options).unwrap();
    reference.solve(&StoppingCriterion::new(error), None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance
}

/// Irradiance on the floor of a lamp of intensity 1 at this place, at the pixels of a picture.
fn falling_from(place: Vec3, height: f32, size: u32) -> Image {
    let at = |k: u32| height * ((k as f32 + 0.5) / size as f32 - 0.5);
    let pixel = |k: u32| {
        let to = place - Vec3::new(at(k % size), 0.0, at(k / size));
        place.y / to.length().powi(3) * Vec3::new(1.0, 2.0, 3.0)
    };
    Image { width: size, height: size, pixels: (0..size * size).map(pixel).collect() }
}

/// A mirror above the floor, which shows the lamp as far behind it as it is in front.
fn under_a_mirror(radius: f32) -> (Scene, Vec3) {
    let mirror = "[[object]]\nname = \"mirror\"\nshape = { plane = { size = [2, 2] } }\nrotate_deg = [180, 0, 0]\n\
                  translate = [0, 1, 0]\ncamera_visible = false\nreflector = {}\n";
    let place = [0.1, 0.4, 0.05];
    (parsed(&format!("{}{mirror}{FLOOR}{}", above(2.0), lamp(place, radius))), Vec3::new(0.1, 1.6, 0.05))
}

/// Means over squares of so many pixels.
fn blocks(image: &Image, edge: u32) -> Image {
    let size = image.width / edge;
    let mean = |k: u32| {
        let (x, y) = (k % size * edge, k / size * edge);
        let pixels = (0..edge * edge).map(|i| image.pixels[((y + i / edge) * image.width + x + i % edge) as usize]);
        pixels.sum::<Vec3>() / (edge * edge) as f32
    };
    Image { width: size, height: size, pixels: (0..size * size).map(mean).collect() }
}

/// E = I cos θ′ / d′², of the virtual image.
#[test]
fn a_mirror_shows_a_lamp_behind_it() {
    for (radius, edge) in [(0.05, 4), (0.0, 32)] {
        let (scene, image) = under_a_mirror(radius);
        let expected = blocks(&falling_from(image, 2.0, 64), edge);
        for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
            let rendered = blocks(&layer_of(scene.clone(), Aov::Caustic, 64, &choice), edge);
            let error = rel_l2(&rendered, &expected, None);
            println!("radius {radius}, {choice:?}: {error:.5}");
            assert!(error < 0.005, "radius {radius}, {choice:?}: {error}");
        }
    }
}

/// A screen with a slit that is narrower than the texels of visibility maps, between a lamp and the mirror: the floor has a strip of light where
/// straight lines from the virtual image, folded back, pass through it.
#[test]
fn a_lamp_shines_through_a_narrow_slit() {
    const SIZE: u32 = 128;
    const HEIGHT: f32 = 0.8;
    let place = Vec3::new(-1.0, 0.1, 0.0);
    let slit = [-0.78, -0.74];
    let mirror = "[[object]]\nname = \"mirror\"\nshape = { plane = { size = [0.6, 0.6] } }\nrotate_deg = [180, 0, 0]\n\
                  translate = [-0.46, 1, 0]\ncamera_visible = false\nreflector = {}\n";
    // Light comes down again beside the second part.
    let part = |name: &str, [from, to]: [f32; 2]| {
        let (middle, width) = (0.5 * (from + to), to - from);
        format!(
            "[[object]]\nname = \"{name}\"\nshape = {{ plane = {{ size = [{width}, 8] }} }}\n\
             translate = [{middle}, 0.5, 0]\ncamera_visible = false\n"
        )
    };
    let screens = part("near", [-4.0, slit[0]]) + &part("far", [slit[1], -0.5]);
    let text = format!("{}{mirror}{screens}{FLOOR}{}", above(HEIGHT), lamp(place.to_array(), 0.001));
    // 0.9 m up to the mirror and 1 m down; 0.4 m of these to the screen.
    let lit = slit.map(|x| place.x + (x - place.x) / 0.4 * 1.9);
    let light = falling_from(Vec3::new(place.x, 1.9, place.z), HEIGHT, SIZE);
    let is_lit = |k: u32| {
        let x = HEIGHT * ((k % SIZE) as f32 + 0.5) / SIZE as f32 - 0.5 * HEIGHT;
        lit[0] < x && x < lit[1]
    };
    let expected: Vec3 = (0..SIZE * SIZE).filter(|k| is_lit(*k)).map(|k| light.pixels[k as usize]).sum();
    for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
        let found: Vec3 = layer_of(parsed(&text), Aov::Caustic, SIZE, &choice).pixels.iter().sum();
        println!("{choice:?}: {:.4}", found.x / expected.x);
        // Shadows are as sharp as cells, which are a fortieth as wide as the strip. By maps alone a quarter of the light is missing.
        assert!((found.x / expected.x - 1.0).abs() < 0.04, "{choice:?}: {found}, not {expected}");
    }
}

#[test]
fn the_ground_truth_knows_the_virtual_image() {
    let (scene, image) = under_a_mirror(0.05);
    let error = rel_l2(&truth(scene, Quantity::Caustic, 16, 0.004), &falling_from(image, 2.0, 16), None);
    assert!(error < 0.008, "{error}");
}

/// On the axis of a lamp at a height h above water of index n, at a depth z: E = I T / (h + z/n)².
#[test]
fn flat_water_under_a_lamp() {
    let (height, depth, eta) = (0.5, 0.4, 1.333f32);
    let text = format!(
        "{}[[object]]\nname = \"water\"\nshape = {{ plane = {{ size = [1, 1] }} }}\ntranslate = [0, {depth}, 0]\n\
         camera_visible = false\nrefractor = {{ eta = {eta} }}\n{FLOOR}{}",
        above(0.06),
        lamp([0.0, depth + height, 0.0], 0.02)
    );
    let passes = 1.0 - ((eta - 1.0) / (eta + 1.0)).powi(2);
    let expected = passes / (height + depth / eta).powi(2);
    let mean = layer(parsed(&text), Aov::Caustic, 8).mean();
    assert!((mean / Vec3::new(1.0, 2.0, 3.0) / expected - 1.0).abs().max_element() < 0.005, "{mean} {expected}");
    let options = reference::Options { size: [2; 2], ..Default::default() };
    let reference = Reference::new(parsed(&text), options).unwrap();
    let solved = reference.solve(&StoppingCriterion::new(0.002), None, &NoProgress, &mut |_| Ok(())).unwrap();
    let ratio = solved.irradiance.mean().x / expected;
    assert!((ratio - 1.0).abs() < 0.005, "{ratio}");
}

/// Without anything in its way, a lamp of any size lights the floor as a point does; a ball throws a soft shadow.
#[test]
fn lamps_light_surfaces_directly() {
    let place = Vec3::new(0.2, 0.8, -0.1);
    let open = |radius: f32| parsed(&format!("{}{FLOOR}{}", above(2.0), lamp(place.to_array(), radius)));
    let expected = falling_from(place, 2.0, 32);
    for radius in [0.0, 0.3] {
        let error = rel_l2(&layer(open(radius), Aov::Direct, 32), &expected, None);
        assert!(error < 0.005, "{error}, of which nearly all comes from interpolation between pixels");
        let error = rel_l2(&truth(open(radius), Quantity::Direct, 32, 0.002), &expected, None);
        assert!(error < 0.004, "{error}");
    }
    let ball = "[[object]]\nshape = { sphere = { radius = 0.15 } }\ntranslate = [0, 0.4, 0]\ncamera_visible = false\n";
    let shaded = || parsed(&format!("{}{ball}{FLOOR}{}", above(2.0), lamp(place.to_array(), 0.1)));
    let expected = truth(shaded(), Quantity::Direct, 32, 0.002);
    for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
        let error = rel_l2(&layer_of(shaded(), Aov::Direct, 32, &choice), &expected, None);
        assert!(error < 0.01, "{choice:?}: {error}");
    }
}

#[test]
fn a_lamp_in_the_ring_is_as_the_ground_truth_says() {
    are_as_the_ground_truth_says(|name| name == "ring");
}

#[test]
#[ignore = "full: more ground truths"]
fn lamps_near_the_cup_are_as_the_ground_truth_says() {
    are_as_the_ground_truth_says(|name| name != "ring");
}

/// A lamp inside the ring, and another one half a metre from the cup, whose inside mirrors itself. Mirrors on both sides do not show
/// themselves.
fn are_as_the_ground_truth_says(is_asked_for: fn(&str) -> bool) {
    let ring = "[camera]\nposition = [0, 4.5, 2.4]\ntarget = [0, 0.1, 0]\nperspective = { fov_y_deg = 32 }\n[[object]]\n\
                name = \"ring\"\nshape = { ring = {} }\nreflector = {}\n";
    let cup = |sides: &str| {
        format!(
            "[camera]\nposition = [0, 2.2, 1.3]\ntarget = [0, 0.2, 0]\nperspective = {{ fov_y_deg = 32 }}\n[[object]]\n\
             name = \"cup\"\nshape = {{ cup = {{}} }}\nreflector = {{ metal = \"silver\", sides = \"{sides}\" }}\n\
             receiver = {{ albedo = [0.3, 0.3, 0.3] }}\n"
        )
    };
    for (name, objects, place, size, of_truth, limit) in [
        ("ring", ring.to_owned(), [0.45, 0.3, 0.1], 16, 0.02, 0.05),
        ("cup", cup("front"), [0.35, 0.95, 0.2], 24, 0.02, 0.05),
        ("cup, both sides", cup("both"), [0.35, 0.95, 0.2], 16, 0.04, 0.09),
    ]
    .into_iter()
    .filter(|case| is_asked_for(case.0))
    {
        let scene =
            || parsed(&format!("environment = {{ constant = [0, 0, 0] }}\n{objects}{FLOOR}{}", lamp(place, 0.03)));
        let expected = truth(scene(), Quantity::Caustic, size, of_truth);
        let error = rel_l2(&layer(scene(), Aov::Caustic, size), &expected, None);
        println!("{name}: {error:.4}, with the ground truth's own {of_truth}");
        assert!(error < limit, "{name}: {error}");
    }
}

/// What a spotlight's beam does not reach stays dark, and a slide is projected.
#[test]
fn spotlights_are_as_the_ground_truth_says() {
    let folder = tempfile::tempdir().unwrap();
    let slide = |k: u32| Vec3::new(((k % 4) % 2) as f32, (k / 8) as f32, 0.5);
    let image = Image { width: 4, height: 4, pixels: (0..16).map(slide).collect() };
    pinspot::image::write_exr(&folder.path().join("slide.exr"), &[("", &image)]).unwrap();
    let mirror = "[[object]]\nname = \"mirror\"\nshape = { plane = { size = [2, 2] } }\nrotate_deg = [180, 0, 0]\n\
                  translate = [0, 1, 0]\ncamera_visible = false\nreflector = {}\n";
    for spot in ["angle_deg = 25", "angle_deg = 20, up = [0, 0, 1], slide = \"slide.exr\""] {
        let text = format!(
            "{}{mirror}{FLOOR}{}spot = {{ target = [0.2, 1, 0], {spot} }}\n",
            above(2.0),
            lamp([0.1, 0.3, 0.0], 0.02)
        );
        let scene = || parse::<toml::Table>("spot.toml", &text, folder.path()).unwrap().scene;
        let expected = truth(scene(), Quantity::Caustic, 32, 0.01);
        let rendered = layer(scene(), Aov::Caustic, 32);
        let error = rel_l2(&rendered, &expected, None);
        println!("{spot}: {error:.4}");
        assert!(error < 0.05, "{spot}: {error}");
        assert_eq!(rendered.pixels[0], Vec3::ZERO);
    }
}

/// The intensity of the environment is not that of lamps, even where there is none.
#[test]
fn lamps_shine_whatever_the_environment_does() {
    let lit = |intensity: f32| {
        let (mut scene, _) = under_a_mirror(0.05);
        scene.environment.intensity = intensity;
        let options = Options::default().with_size([16; 2]).with_samples(100).with_aovs(vec![Aov::Caustic]);
        render(scene, options, &BackendChoice::Cpu).unwrap().layers.remove(0).1
    };
    let expected = lit(1.0);
    for intensity in [0.0, 1e-6, 30.0] {
        assert!(rel_l2(&lit(intensity), &expected, None) < 1e-3, "{intensity}");
    }
}

/// A ball sees a red and a blue wall in the light of a lamp: what it throws into its own shadow.
#[test]
#[ignore = "full: a ground truth"]
fn mirrors_show_what_lamps_light() {
    let scene = || {
        let mut scene = pinspot::load("colours").unwrap().0;
        scene.environment.light = pinspot::scene::Light::Constant(Vec3::ZERO);
        scene
    };
    let expected = truth(scene(), Quantity::Caustic, 24, 0.015);
    let rendered = layer(scene(), Aov::Caustic, 24);
    let error = rel_l2(&rendered, &expected, None);
    println!("{error:.4}");
    assert!(error < 0.065, "{error}");
    // Without the light of surfaces there is next to nothing.
    let mut dark = scene();
    dark.objects.iter_mut().filter_map(|o| o.receiver.as_mut()).for_each(|receiver| receiver.albedo = Vec3::ZERO);
    let (dark, lit) = (layer(dark, Aov::Caustic, 24).mean(), rendered.mean());
    assert!(dark.x < 0.8 * lit.x, "{dark} {lit}");
}
