//! Image-space techniques against closed forms, direct light and the ground truth.

use std::f64::consts::{PI, TAU};

use glam::Vec3;
use pinspot::blocking::wait;
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::reference::{self, Estimator, Reference, StoppingCriterion};
use pinspot::scene::{Chain, Emitter, Scene, load};
use pinspot::{
    BackendChoice, Error, Hits, ImageSpaceOptions, Incidence, Loss, MapView, Mark, Mode, NoProgress, Options, Overlay,
    Rendered, Settings, Traversal,
};

use crate::support::{above_floor as scene, new_engine, photon_options, render, render_again, transmittance};

/// A lamp without extent above the middle.
const LAMP: &str = "[[light]]\nposition = [0, 3, 0]\nintensity = [9, 18, 27]\n";
const DARK: &str = "constant = [0, 0, 0]";
/// A sun of little extent, high in the sky.
const SUN: &str = "spot = { direction = [0.36, 0.8, 0.48], sigma_rad = 0.001, radiance = [1e6, 1e6, 1e6] }";

fn options(mode: Mode, photons: u32) -> Options {
    photon_options(ImageSpaceOptions { mode, photons, light_directions: 1, ..Default::default() })
}

fn caustic(scene: &Scene, options: Options) -> (Image, Rendered) {
    let mut rendered = render(scene.clone(), options, &BackendChoice::Cpu).unwrap();
    (rendered.layers.remove(0).1, rendered)
}

/// A picture of a function of the place on the floor.
fn on_floor(size: u32, value: impl Fn(f64, f64) -> Vec3) -> Image {
    let at = |k: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(size) - 1.0;
    let pixels = (0..size * size).map(|k| value(at(k % size), at(k / size))).collect();
    Image { width: size, height: size, pixels }
}

#[test]
fn without_refraction_the_caustic_is_the_direct_light() {
    is_the_direct_light(|mode| [Mode::ExactPolygons, Mode::Points].contains(&mode));
}

#[test]
#[ignore = "full: the other modes"]
fn without_refraction_the_caustic_is_the_direct_light_in_other_modes() {
    is_the_direct_light(|mode| ![Mode::ExactPolygons, Mode::Points].contains(&mode));
}

/// Waves that change nothing: with the index of air and without Fresnel the caustic is the direct light, in every mode and map.
fn is_the_direct_light(is_asked_for: fn(Mode) -> bool) {
    let waves = "[[object]]\nname = \"film\"\nshape = { plane = { size = [8, 8] } }\ntranslate = [0, 1, 0]\n\
                 rotate_deg = [7, 0, 12]\nrefractor = { eta = 1.0, fresnel = false }\ncamera_visible = false\n";
    let lit = scene(DARK, &format!("{LAMP}{waves}"));
    let expected = on_floor(128, |x, z| {
        let squared = x * x + z * z + 9.0;
        Vec3::new(9.0, 18.0, 27.0) * (3.0 / squared.powf(1.5)) as f32
    });
    for mode in Mode::ALL.into_iter().filter(|mode| is_asked_for(*mode)) {
        for map in [MapView::Eye, MapView::Light] {
            let mut options = options(mode, 512);
            options.image_space.caustic_map = map;
            options.image_space.splat_diameter = 8.0;
            let (found, rendered) = caustic(&lit, options);
            let error = rel_l2(&found, &expected, None);
            // Points and small splats show the grid.
            let limit = match mode {
                Mode::Auto | Mode::ExactPolygons => 0.002,
                Mode::Polygons => 0.02,
                Mode::Points => 0.6,
                Mode::Gather => 0.08,
                // Splats of a texel or two do, too.
                Mode::MultiResolution | Mode::Splats | Mode::ThinLens | Mode::ThickLens | Mode::Footprints => 0.065,
            };
            let flux = rendered.report.photons.unwrap().flux;
            println!("{} {}: {error:.4}, flux {:.2e}", mode.name(), map.name(), flux.error());
            assert!(error < limit, "{} {}: {error}", mode.name(), map.name());
            let (sum, of_direct) = (found.mean().x, expected.mean().x);
            assert!((sum / of_direct - 1.0).abs() < 0.012, "{} {}: {sum} of {of_direct}", mode.name(), map.name());
        }
    }
}

/// What is cast is in the maps or is known to be lost, to the last part in 10⁴; only several resolutions at once are biased, and polygons
/// that cover centres have too much or too little.
#[test]
fn all_flux_is_accounted_for() {
    let (ring, _) = pinspot::load("ring").unwrap();
    for mode in Mode::ALL {
        for map in [MapView::Eye, MapView::Light] {
            let mut options = options(mode, 256);
            options.image_space.light_directions = 4;
            options.image_space.caustic_map = map;
            let flux = caustic(&ring, options).1.report.photons.unwrap().flux;
            let limit = match mode {
                Mode::MultiResolution => 0.15,
                Mode::Polygons => 0.03,
                _ => 1e-4,
            };
            let lost: Vec<String> =
                Loss::ALL.iter().map(|l| format!("{} {:.4}", l.name(), flux[*l] / flux.cast)).collect();
            println!("{} {}: error {:.2e}, {}", mode.name(), map.name(), flux.error(), lost.join(", "));
            assert!(flux.cast > 0.0 && flux.error().abs() < limit, "{} {}: {}", mode.name(), map.name(), flux.error());
            assert!(flux.deposited > 0.5 * flux.cast, "{}", mode.name());
        }
    }
}

/// A plane mirror and a lamp: E = I cosθ′ / d′² of the virtual lamp.
#[test]
fn a_plane_mirror_shows_a_virtual_lamp() {
    // In the plane x = −1.5, facing the floor's middle; the lamp's image is as far behind it.
    let mirror = "[[object]]\nshape = { plane = { size = [6, 6] } }\nrotate_deg = [0, 0, -90]\ntranslate = [-1.5, 3, 0]\nreflector = {}\n";
    let lit = scene(DARK, &format!("{LAMP}{mirror}"));
    let expected = on_floor(128, |x, z| {
        let squared = (x + 3.0).powi(2) + z * z + 9.0;
        Vec3::new(9.0, 18.0, 27.0) * (3.0 / squared.powf(1.5)) as f32
    });
    for map in [MapView::Eye, MapView::Light] {
        let mut options = options(Mode::ExactPolygons, 256);
        options.image_space.caustic_map = map;
        let error = rel_l2(&caustic(&lit, options).0, &expected, None);
        println!("{}: {error:.5}", map.name());
        // The lamp sees the mirror by three faces of a cube, which a map of its own shows.
        let limit = if map == MapView::Eye { 0.005 } else { 0.01 };
        assert!(error < limit, "{}: {error}", map.name());
    }
}

/// Photons of a coarse grid around all of them would miss most of these mirrors.
#[test]
fn maps_of_lights_show_what_small_mirrors_far_apart_cast() {
    let mirror = |k: u32| {
        let x = 1.7 * f64::from(k) - 3.4;
        format!(
            "[[object]]\nshape = {{ plane = {{ size = [0.05, 0.05] }} }}\nrotate_deg = [90, 0, 0]\ntranslate = [{x}, 0.3, 0]\nreflector = {{}}\n"
        )
    };
    let mirrors: String = (0..5).map(mirror).collect();
    let mut options = options(Mode::Points, 512);
    options.image_space.caustic_map = MapView::Light;
    let (_, rendered) = caustic(&scene(SUN, &mirrors), options);
    let flux = rendered.report.photons.as_ref().unwrap().flux;
    let [shown, beside] = [flux.deposited, flux[Loss::OffMap]].map(|watts| watts / flux.cast);
    assert!(shown > 0.97 && beside < 0.03, "{shown} shown, {beside} beside the map");
    assert!(rendered.report.warnings.is_empty(), "{:?}", rendered.report.warnings);
}

/// What lies between the lamp and the floor hides nothing of the mirror's light: maps of receivers show those behind others, too.
#[test]
#[ignore = "full: a large scene"]
fn maps_show_receivers_behind_others() {
    let mirror = "[[object]]\nshape = { plane = { size = [6, 6] } }\nrotate_deg = [0, 0, -90]\ntranslate = [-1.5, 3, 0]\nreflector = {}\n";
    // Below the lamp: a plate, and a closed ring, which alone takes four layers.
    let between = "[[object]]\nshape = { plane = { size = [0.4, 0.4] } }\ntranslate = [0, 2.5, 0]\nreceiver = {}\n\
                   camera_visible = false\n\
                   [[object]]\nshape = { solid-ring = { radius = 0.1, height = 0.3, thickness = 0.02 } }\n\
                   rotate_deg = [90, 0, 0]\ntranslate = [0, 2.7, -0.15]\nreceiver = {}\ncamera_visible = false\n";
    let alone = scene(DARK, &format!("{LAMP}{mirror}"));
    let hidden = scene(DARK, &format!("{LAMP}{mirror}{between}"));
    for mode in [Mode::Points, Mode::Gather, Mode::ExactPolygons, Mode::MultiResolution] {
        let mut options = options(mode, 256);
        options.image_space.caustic_map = MapView::Light;
        let [expected, found] = [&alone, &hidden].map(|scene| caustic(scene, options.clone()).0);
        let error = rel_l2(&found, &expected, None);
        let energy = found.mean().x / expected.mean().x;
        println!("{}: {error:.5}, energy {energy:.4}", mode.name());
        assert!((energy - 1.0).abs() < 0.01, "{}: {energy}", mode.name());
        // The windows of the maps are not quite the same, so that what is smoothed over texels is not, either.
        assert!(mode != Mode::ExactPolygons || error < 0.02, "{error}");
    }
}

/// Where no light is reflected or refracted, the report says so.
#[test]
fn reports_say_that_there_is_no_caustic() {
    let mirror = "[[object]]\nshape = { plane = { size = [1, 1] } }\ntranslate = [0, 1, 0]\n\
                  reflector = { sides = \"back\" }\ncamera_visible = false\n";
    let (_, rendered) = caustic(&scene(DARK, &format!("{LAMP}{mirror}")), options(Mode::Points, 64));
    let warnings = rendered.report.warnings;
    assert!(warnings.iter().any(|warning| warning.contains("no light meets a mirror or an interface")), "{warnings:?}");
    // What the mirror casts upwards, no receiver is there to show.
    let mirror = mirror.replace("back", "front").replace("translate", "rotate_deg = [0, 0, 0]\ntranslate");
    let (_, rendered) = caustic(&scene(DARK, &format!("{LAMP}{mirror}")), options(Mode::Points, 64));
    let warnings = rendered.report.warnings;
    assert!(warnings.iter().any(|warning| warning.contains("lands on a receiver")), "{warnings:?}");
}

/// Of two mirrors that form a roof all light meets the second one, and a prism keeps it by total reflection: reports say how much is lost.
#[test]
fn reports_say_how_much_light_is_lost() {
    let side = |x: f32, angle: f32| {
        format!(
            "[[object]]\nshape = {{ plane = {{ size = [0.4, 4] }} }}\nrotate_deg = [0, 0, {angle}]\ntranslate = [{x}, 1, 0]\n\
             reflector = {{}}\ncamera_visible = false\n"
        )
    };
    let sun = "[[light]]\ndirectional = { direction = [0, 1, 0], irradiance = [1, 1, 1] }\n";
    let lost = |objects: &str| {
        let (_, rendered) = caustic(&scene(DARK, &format!("{sun}{objects}")), options(Mode::Points, 128));
        rendered.report.warnings.join("; ")
    };
    // A valley: what one side reflects goes to the other.
    let valley = lost(&format!("{}{}", side(-0.15, -45.0), side(0.15, 45.0)));
    assert!(valley.contains("100 % of the light") && valley.contains("meets another mirror"), "{valley}");
    // A box on its edge, of glass: the critical angle is 41.8 degrees.
    let prism = lost(
        "[[object]]\nshape = { box = { size = [0.4, 0.4, 0.4] } }\nrotate_deg = [0, 0, 45]\ntranslate = [0, 1, 0]\n\
         refractor = { eta = 1.8, interfaces = 2 }\n",
    );
    assert!(prism.contains("is reflected inside of glass"), "{prism}");
    assert!(!lost(&side(0.0, 10.0)).contains("is missing"), "a mirror that lights the floor or nothing loses none");
}

/// Flat water below a lamp, on the axis: E = I T / (h + z/n)²; in the sun everywhere E₀ cosθ T.
#[test]
fn flat_water_has_its_closed_forms() {
    let water = "[[object]]\nshape = { plane = { size = [8, 8] } }\ntranslate = [0, 1, 0]\nrefractor = { eta = 1.333 }\n\
                 camera_visible = false\n";
    let below_lamp = caustic(&scene(DARK, &format!("{LAMP}{water}")), options(Mode::ExactPolygons, 512)).0;
    let middle = below_lamp.pixels[64 * 128 + 64].y;
    let expected = 18.0 * transmittance(1.0, 1.333) / (2.0 + 1.0 / 1.333f64).powi(2);
    assert!((f64::from(middle) / expected - 1.0).abs() < 0.005, "{middle} {expected}");
    let in_the_sun = caustic(&scene(SUN, water), options(Mode::ExactPolygons, 256)).0;
    let expected = TAU * 0.001f64.powi(2) * 1e6 * 0.8 * transmittance(0.8, 1.333);
    let mean = f64::from(in_the_sun.mean().x);
    assert!((mean / expected - 1.0).abs() < 0.005, "{mean} {expected}");
    let flat = on_floor(128, |_, _| Vec3::splat(expected as f32));
    assert!(rel_l2(&in_the_sun, &flat, None) < 0.005);
}

/// A glass ball in parallel light: a ray at b from the axis meets the ball at sin i = b/R, is refracted to sin r = sin i / n and again on its
/// way out, turned by 2 (i − r) in all, and meets a plane D below the middle at ρ = R sin(2r − i) − (D − R cos(2r − i)) tan 2(i − r).
fn ball_with_its_closed_form(size: u32) -> (Scene, Image) {
    let (n, below, radius) = (1.5f64, 0.9f64, 0.5f64);
    let sun = "spot = { direction = [0, 1, 0], sigma_rad = 0.0005, radiance = [1e6, 1e6, 1e6] }";
    let ball = format!(
        "[[object]]\nshape = {{ sphere = {{ radius = {radius}, divisions = 96 }} }}\ntranslate = [0, {below}, 0]\n\
         refractor = {{ eta = {n}, interfaces = 2 }}\ncamera_visible = false\n"
    );
    let mut flux = vec![0.0f64; (size * size) as usize];
    let steps = 20_000;
    let irradiance = TAU * 0.0005f64.powi(2) * 1e6;
    for k in 0..steps {
        let b = radius * (f64::from(k) + 0.5) / f64::from(steps);
        let (i, r) = ((b / radius).asin(), (b / radius / n).asin());
        let (turned, leaving) = (2.0 * (i - r), 2.0 * r - i);
        if turned >= PI / 2.0 {
            continue;
        }
        let place = radius * leaving.sin() - (below - radius * leaving.cos()) * turned.tan();
        let passing = transmittance(i.cos(), n).powi(2);
        let amount = irradiance * passing * TAU * b * radius / f64::from(steps) / 720.0;
        for azimuth in 0..720 {
            let angle = TAU * f64::from(azimuth) / 720.0;
            let texel = |x: f64| ((x + 1.0) * 0.5 * f64::from(size)).floor();
            let (x, y) = (texel(place * angle.cos()), texel(place * angle.sin()));
            if x >= 0.0 && y >= 0.0 && x < f64::from(size) && y < f64::from(size) {
                flux[y as usize * size as usize + x as usize] += amount;
            }
        }
    }
    let area = (2.0 / f64::from(size)).powi(2);
    let expected =
        Image { width: size, height: size, pixels: flux.iter().map(|f| Vec3::splat((f / area) as f32)).collect() };
    (scene(sun, &ball), expected)
}

#[test]
fn a_glass_ball_has_its_closed_form() {
    let (scene, expected) = ball_with_its_closed_form(64);
    let of = |hits, photons| {
        let mut options = options(Mode::ExactPolygons, photons);
        options.size = [64; 2];
        options.aovs = vec![Aov::CausticTT];
        options.image_space.hits = hits;
        let (found, rendered) = caustic(&scene, options);
        let flux = rendered.report.photons.unwrap().flux;
        let error = rel_l2(&found, &expected, None);
        println!("{} {photons}²: {error:.4}, {} of {}", hits.name(), found.mean().x, expected.mean().x);
        println!("{flux:?}");
        assert!(flux.error().abs() < 1e-4);
        error
    };
    assert!(of(Hits::Traced, 1024) < 0.03);
    let errors = [of(Hits::Traced, 512), of(Hits::Image, 512), of(Hits::QuarterImage, 512)];
    assert!(errors[1] < errors[0] + 0.02 && errors[2] < errors[0] + 0.02, "{errors:?}");
}

/// In images of what a light sees, photons meet what rays meet: mirrors that face a floor, waves over it, and a ring that stands on it.
#[test]
#[ignore = "full: fine images"]
fn images_show_what_rays_meet() {
    let mirror = "[[object]]\nshape = { plane = { size = [6, 6] } }\nrotate_deg = [0, 0, -90]\ntranslate = [-1.5, 3, 0]\nreflector = {}\n";
    let water = "[[object]]\nshape = { water = { size = [4, 4], amplitude = 0.02 } }\ntranslate = [0, 1, 0]\n\
                 refractor = { eta = 1.33 }\ncamera_visible = false\n";
    let cases = [
        ("mirror", scene(DARK, &format!("{LAMP}{mirror}")), 0.001),
        ("water below a lamp", scene(DARK, &format!("{LAMP}{water}")), 0.001),
        ("water in the sun", scene(SUN, water), 0.001),
        ("ring", pinspot::load("ring").unwrap().0, 0.03),
    ];
    let mut failures = Vec::new();
    for (name, scene, limit) in cases {
        let of = |hits| {
            let mut options = options(Mode::ExactPolygons, 256);
            options.image_space.hits = hits;
            let (picture, rendered) = caustic(&scene, options);
            (picture, rendered.report.photons.unwrap().flux)
        };
        let (traced, of_traced) = of(Hits::Traced);
        let (found, flux) = of(Hits::Image);
        let error = rel_l2(&found, &traced, None);
        println!("{name}: {error:.4}, cast {:.5}, missed {:.4}", flux.cast / of_traced.cast, flux.missed / flux.cast);
        println!("  {flux:?}");
        failures.extend((error > limit || (flux.cast / of_traced.cast - 1.0).abs() > 1e-3).then_some((name, error)));
        assert!(flux.error().abs() < 1e-4);
    }
    assert!(failures.is_empty(), "{failures:?}");
}

/// The mean over pixels of the built-in ring's caustic in a small sun, by every mode, beside the ground truth.
#[test]
#[ignore = "full: a ground truth, in every mode"]
fn the_ring_in_a_small_sun() {
    let scene = load::<Settings>("ring").unwrap().scene;
    let wanted = reference::Options { size: [128; 2], estimator: Estimator::Beams, ..Default::default() };
    let truth = Reference::new(scene.clone(), wanted).unwrap();
    let truth = truth.solve(&StoppingCriterion::new(0.01), None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance;
    let mut errors = Vec::new();
    for mode in Mode::ALL {
        let mut options = options(mode, 512);
        options.image_space.light_directions = 32;
        let error = rel_l2(&caustic(&scene, options).0, &truth, None);
        println!("{}: {error:.4}", mode.name());
        errors.push((mode, error));
    }
    for (mode, error) in errors {
        let limit = match mode {
            Mode::Auto | Mode::ExactPolygons | Mode::Polygons | Mode::Footprints | Mode::ThinLens | Mode::ThickLens => {
                0.07
            }
            Mode::Points => 0.1,
            Mode::Gather | Mode::MultiResolution => 0.6,
            Mode::Splats => 0.3,
        };
        assert!(error < limit, "{}: {error}", mode.name());
    }
}

/// A sun above a glass ball whose focus is near the floor.
fn ball_in_the_sun() -> Scene {
    let ball = "[[object]]\nshape = { sphere = { radius = 0.4, divisions = 96 } }\ntranslate = [0, 0.62, 0]\n\
                refractor = { eta = 1.5, interfaces = 2 }\ncamera_visible = false\n";
    scene(SUN, ball)
}

/// Where casters are, the traversal follows the photons that a dense grid has, and the map is the same, but for rays that graze an edge: what
/// they meet depends on the rays of their packet.
#[test]
fn the_maximal_level_is_the_dense_grid() {
    let (ring, _) = pinspot::load("ring").unwrap();
    for (scene, mode) in [(ball_in_the_sun(), Mode::Points), (ring, Mode::Splats)] {
        let of = |traversal| {
            let mut options = options(mode, 512);
            options.image_space.traversal = traversal;
            let (picture, rendered) = caustic(&scene, options);
            (picture, rendered.report.photons.unwrap())
        };
        let (dense, of_dense) = of(Traversal::Dense);
        let (found, photons) = of(Traversal::MaximalLevel);
        println!("{}: {} of {} rays", photons.photons_used, photons.photons, of_dense.photons);
        assert!(photons.photons_used.abs_diff(of_dense.photons_used) <= 4);
        let error = rel_l2(&found, &dense, None);
        assert!(error < 1e-4, "{error}");
        assert!((photons.flux.cast / of_dense.flux.cast - 1.0).abs() < 1e-4 && photons.flux.error().abs() < 1e-4);
    }
}

#[test]
fn clusters_within_a_texel_are_one_photon() {
    clusters_are_one_photon(1024, 0.8);
}

#[test]
#[ignore = "full: four million photons"]
fn clusters_of_more_photons_are_one_photon() {
    clusters_are_one_photon(2048, 0.6);
}

/// Photons that land in one texel are one: fewer of them have about the same picture, and the same flux.
fn clusters_are_one_photon(photons: u32, most: f64) {
    let scene = ball_in_the_sun();
    let of = |traversal, photons| {
        let mut options = options(Mode::Splats, photons);
        options.image_space.traversal = traversal;
        let (picture, rendered) = caustic(&scene, options);
        (picture, rendered.report.photons.unwrap())
    };
    let (dense, of_dense) = of(Traversal::MaximalLevel, photons);
    let (found, merged) = of(Traversal::TexelError, photons);
    let part = merged.photons_used as f64 / of_dense.photons_used as f64;
    let error = rel_l2(&found, &dense, None);
    println!("{photons}: {part:.3} of the photons, {error:.4} from the dense picture");
    assert!(part < most && error < 0.02, "{photons}: {part}, {error}");
    assert!((merged.flux.cast / of_dense.flux.cast - 1.0).abs() < 1e-4 && merged.flux.error().abs() < 1e-6);
}

/// A wall a hundredth of a metre high is not lost between the first grid's rays.
#[test]
fn thin_casters_are_found() {
    let wall = "[[object]]\nshape = { ring = { radius = 0.6, height = 0.01 } }\nreflector = { sides = \"front\" }\n";
    let low = scene(SUN, wall);
    let cast = |traversal| {
        let mut options = options(Mode::Points, 1024);
        options.image_space.traversal = traversal;
        caustic(&low, options).1.report.photons.unwrap().flux.cast
    };
    let (dense, found) = (cast(Traversal::Dense), cast(Traversal::TexelError));
    assert!(found > 0.999 * dense && dense > 0.0, "{found} of {dense}");
}

/// The same bits every time, whatever the number of threads.
#[test]
fn sums_are_the_same_bits_every_time() {
    let (ring, _) = pinspot::load("ring").unwrap();
    for mode in Mode::ALL {
        let pictures = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| caustic(&ring, options(mode, 64)).0)
        });
        assert!(pictures[0].pixels == pictures[1].pixels, "{}", mode.name());
    }
}

/// The overlay shows where photons land: on the floor inside and beside the ring, where the caustic is.
#[test]
fn photons_can_be_shown() {
    let (ring, _) = pinspot::load("ring").unwrap();
    let shown = options(Mode::Points, 128).with_overlay(Overlay::Photons).with_aovs(vec![Aov::Beauty, Aov::Caustic]);
    let mut engine = new_engine(ring, shown, &BackendChoice::Cpu).unwrap();
    let caustic = render_again(&mut engine).unwrap().layer(Aov::Caustic).unwrap().clone();
    let marks = wait(None, engine.marks(&NoProgress)).unwrap();
    let bright = marks.iter().filter(|mark| {
        let Mark::Dot(at) = mark else { panic!("{mark:?}") };
        let around = |k: u32| (at.x as u32 + k % 3).saturating_sub(1) + 128 * (at.y as u32 + k / 3).saturating_sub(1);
        (0..9).any(|k| caustic.pixels.get(around(k) as usize).is_some_and(|pixel| pixel.x > 0.0))
    });
    let bright = bright.count();
    println!("{bright} of {}", marks.len());
    assert!(marks.len() > 200 && bright * 100 > marks.len() * 95, "{bright} of {}", marks.len());
}

/// The overlay of a map shows it in a corner: some of its texels are lit, and white is the brightest of them.
#[test]
fn caustic_maps_can_be_shown() {
    let (ring, _) = pinspot::load("ring").unwrap();
    for map in [MapView::Eye, MapView::Light] {
        let mut shown = options(Mode::Points, 128).with_overlay(Overlay::CausticMap).with_aovs(vec![Aov::Beauty]);
        shown.image_space.caustic_map = map;
        let mut engine = new_engine(ring.clone(), shown, &BackendChoice::Cpu).unwrap();
        render_again(&mut engine).unwrap();
        let marks = wait(None, engine.marks(&NoProgress)).unwrap();
        let texels: Vec<_> = marks
            .iter()
            .map(
                |mark| {
                    if let Mark::Texel { corners, colour } = mark { (*corners, *colour) } else { panic!("{mark:?}") }
                },
            )
            .collect();
        assert_eq!(texels.len() % 86, 0, "512 texels in steps of six");
        let in_corner = |[low, high]: [glam::Vec2; 2]| low.min_element() >= 0.0 && high.x < 64.0 && high.y < 128.1;
        assert!(texels.iter().all(|(corners, _)| in_corner(*corners)), "{}", map.name());
        let lit = texels.iter().filter(|(_, colour)| colour.x > 0.0).count();
        let white = texels.iter().filter(|(_, colour)| colour.x == 1.0).count();
        println!("{}: {lit} lit, {white} white of {}", map.name(), texels.len());
        assert!(lit > 100 && white > 0 && 20 * white < lit, "{}: {lit} {white}", map.name());
    }
}

/// What the technique does not know is refused with a reason.
#[test]
fn scenes_that_it_does_not_know_are_refused() {
    let refused = |name: &str, change: fn(&mut Scene, &mut Options)| {
        let (mut scene, _) = pinspot::load(name).unwrap();
        let mut options = options(Mode::Points, 16);
        change(&mut scene, &mut options);
        match render(scene, options, &BackendChoice::Cpu) {
            Err(Error::Option(error)) => error.to_string(),
            Err(error) => panic!("{name}: {error}"),
            Ok(_) => panic!("{name} is not refused"),
        }
    };
    assert!(refused("haze", |_, _| ()).contains("media"));
    let shining = |scene: &mut Scene, _: &mut Options| {
        let last = scene.objects.last_mut().unwrap();
        last.receiver = None;
        last.emitter = Some(Emitter { radiance: Vec3::ONE, is_near: true });
    };
    assert!(refused("ring", shining).contains("emitters that are near"));
    assert!(refused("ring", |_, options| options.visibility = pinspot::scene::Visibility::None).contains("visibility"));
    assert!(refused("ring", |_, options| options.attenuation = false).contains("attenuation"));
    assert!(refused("ring", |scene, _| scene.objects.retain(|o| o.reflector.is_none())).contains("reflector"));
    assert!(refused("ring", |_, options| options.image_space.photons = 7).contains("photons"));
    let clusters = |_: &mut Scene, options: &mut Options| {
        options.image_space.traversal = Traversal::TexelError;
        options.image_space.photons = 600;
    };
    assert!(refused("ring", clusters).contains("power of two"));
    assert!(refused("ring", |_, options| options.overlay = Overlay::Cells).contains("shows samples"));
    let polygons = |_: &mut Scene, options: &mut Options| {
        options.image_space.traversal = Traversal::MaximalLevel;
        options.image_space.mode = Mode::ExactPolygons;
    };
    assert!(refused("ring", polygons).contains("neighbours"));
    let of_each_photon = |_: &mut Scene, options: &mut Options| {
        options.image_space.incidence = Incidence::Photon;
        options.image_space.caustic_map = MapView::Light;
    };
    assert!(refused("ring", of_each_photon).contains("a light's map has none"));
    assert!(refused("ring", |_, options| options.image_space.paper = true).contains("polygons and gathers"));
    assert!(refused("ring", |_, options| options.image_space.temporal_frames = 5).contains("from 1 to 4"));
    let large = |_: &mut Scene, options: &mut Options| {
        options.image_space.caustic_map_size = 8192;
        options.image_space.mode = Mode::MultiResolution;
    };
    assert!(refused("ring", large).contains("GiB"));
}

/// Chains are told apart: what the ball reflects and what passes it are together what it casts.
#[test]
fn chains_add_up() {
    let ball = "[[object]]\nshape = { sphere = { radius = 0.3 } }\ntranslate = [0, 0.6, 0]\n\
                refractor = { eta = 1.5, interfaces = 2 }\ncamera_visible = false\n";
    let lit = scene(SUN, ball);
    assert!(lit.objects[1].casts(Chain::TT));
    let mut all = options(Mode::Splats, 256);
    all.aovs = vec![Aov::Caustic, Aov::CausticR];
    let rendered = render(lit, all, &BackendChoice::Cpu).unwrap();
    let [whole, reflected] = [0, 1].map(|k| rendered.layers[k].1.mean().x);
    assert!(reflected > 0.0 && reflected < 0.1 * whole, "{reflected} {whole}");
}
