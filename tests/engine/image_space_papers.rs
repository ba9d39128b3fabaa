//! What the papers of image-space techniques say of single steps, each beside its closed form.

use std::f64::consts::FRAC_1_PI;

use glam::Vec3;
use pinspot::image::{Aov, Image, mrse, rel_l2};
use pinspot::reference::{self, Estimator, Reference, StoppingCriterion};
use pinspot::scene::Scene;
use pinspot::{
    BackendChoice, Hits, ImageSpaceOptions, Incidence, MapView, Mode, NoProgress, Options, PhotonStatistics, Technique,
    Traversal,
};

use crate::support::{above_floor, above_floor_in, new_engine, photon_options, render, render_again, transmittance};

const DARK: &str = "constant = [0, 0, 0]";
const STRAIGHT_DOWN: &str = "[[light]]\ndirectional = { direction = [0, 1, 0], irradiance = [1, 2, 3] }\n";
const SLANTED: &str = "[[light]]\ndirectional = { direction = [0.36, 0.8, 0.48], irradiance = [1, 2, 3] }\n";
const FILM: &str = "[[object]]\nname = \"film\"\nshape = { plane = { size = [8, 8] } }\ntranslate = [0, 1, 0]\n\
                    refractor = { eta = 1.0, fresnel = false }\ncamera_visible = false\n";
const BALL: &str = "[[object]]\nshape = { sphere = { radius = 0.4, divisions = 96 } }\ntranslate = [0, 0.62, 0]\n\
                    refractor = { eta = 1.5, interfaces = 2 }\ncamera_visible = false\n";

fn options(mode: Mode, photons: u32) -> Options {
    photon_options(ImageSpaceOptions { mode, photons, ..Default::default() })
}

fn caustic(scene: &Scene, options: Options) -> (Image, PhotonStatistics) {
    let mut rendered = render(scene.clone(), options, &BackendChoice::Cpu).unwrap();
    (rendered.layers.remove(0).1, rendered.report.photons.unwrap())
}

/// Directional light is the same everywhere: E₀ cosθ on an empty floor, E₀ cosθ T under flat water, by either technique.
#[test]
fn directional_light_is_the_same_everywhere() {
    let water = "[[object]]\nshape = { plane = { size = [8, 8] } }\ntranslate = [0, 1, 0]\nrefractor = { eta = 1.333 }\n\
                 camera_visible = false\n";
    let even = |image: &Image, expected: f64, limit: f64, what: &str| {
        let mean = f64::from(image.mean().x);
        let flat =
            Image { pixels: vec![Vec3::new(1.0, 2.0, 3.0) * expected as f32; image.pixels.len()], ..image.clone() };
        let error = rel_l2(image, &flat, None);
        println!("{what}: {mean} of {expected}, {error:.1e}");
        assert!((mean / expected - 1.0).abs() < limit && error < 3.0 * limit, "{what}: {mean} of {expected}, {error}");
    };
    let under_water = above_floor(DARK, &format!("{SLANTED}{water}"));
    let expected = 0.8 * transmittance(0.8, 1.333);
    for mode in [Mode::ExactPolygons, Mode::Footprints] {
        // Footprints show their grid.
        let limit = if mode == Mode::Footprints { 0.025 } else { 0.005 };
        even(&caustic(&under_water, options(mode, 512)).0, expected, limit, mode.name());
    }
    let mut by_pinholes = options(Mode::Points, 16).with_technique(Technique::Pinhole).with_size([32, 32]);
    by_pinholes.samples = 3000;
    let pinholes = render(under_water, by_pinholes, &BackendChoice::Cpu).unwrap();
    even(&pinholes.layers[0].1, expected, 0.0075, "pinholes");
    let mirror = "[[object]]\nshape = { plane = { size = [1, 1] } }\ntranslate = [30, 1, 0]\nreflector = {}\n";
    let direct = options(Mode::Points, 16).with_technique(Technique::Pinhole).with_aovs(vec![Aov::Direct]);
    let empty = render(above_floor(DARK, &format!("{SLANTED}{mirror}")), direct, &BackendChoice::Cpu).unwrap();
    even(&empty.layers[0].1, 0.8, 1e-3, "direct");
}

/// Two mirrors send light to a glossy floor from both sides. Photons one by one reflect it as it comes; their mean direction is neither's,
/// and the lamp's own is farther off (Wyman and Davis 2006, Equations 9 to 11).
#[test]
#[ignore = "full: exact polygons of many photons in every way"]
fn photons_one_by_one_show_gloss_best() {
    const SIZE: u32 = 48;
    let lamp = "[[light]]\nposition = [0, 3, 0]\nintensity = [9, 18, 27]\n";
    let mirror = |x: f32, angle: f32| {
        format!(
            "[[object]]\nshape = {{ plane = {{ size = [6, 6] }} }}\nrotate_deg = [0, 0, {angle}]\ntranslate = [{x}, 3, 0]\n\
             reflector = {{}}\n"
        )
    };
    let mut lit = above_floor(DARK, &format!("{lamp}{}{}", mirror(-1.5, -90.0), mirror(1.8, 90.0)));
    let gloss = pinspot::scene::Gloss::Phong { specular: Vec3::splat(0.3), exponent: 12.0 };
    let lambert = lit.clone();
    let floor = lit.objects.iter_mut().find_map(|object| object.receiver.as_mut()).unwrap();
    floor.gloss = gloss;
    let albedo = floor.albedo;
    // What the caustic adds to the picture: with twice the caustic, less once.
    let reflected = |scene: &Scene, incidence| {
        let of = |gain: f32| {
            let mut options = options(Mode::ExactPolygons, 256).with_aovs(vec![Aov::Beauty]).with_size([SIZE; 2]);
            options.caustic_gain = gain;
            options.image_space.incidence = incidence;
            render(scene.clone(), options, &BackendChoice::Cpu).unwrap().layers.remove(0).1
        };
        let (twice, once) = (of(2.0), of(1.0));
        let pixels = twice.pixels.iter().zip(&once.pixels).map(|(a, b)| *a - *b).collect();
        Image { pixels, ..once }
    };
    let expected = Image {
        width: SIZE,
        height: SIZE,
        pixels: (0..SIZE * SIZE)
            .map(|k: u32| {
                let at = |k: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(SIZE) - 1.0;
                let place = glam::DVec3::new(at(k % SIZE), 0.0, at(k / SIZE));
                let from = |lamp: glam::DVec3| {
                    let to = lamp - place;
                    let l = to.normalize();
                    // The camera looks straight down: what mirrors light to it comes from above.
                    let lobe = 0.3 * 14.0 / (2.0 * std::f64::consts::PI) * l.y.powi(12);
                    l.y / to.length_squared() * (albedo.as_dvec3() * FRAC_1_PI + lobe)
                };
                let both = from(glam::DVec3::new(-3.0, 3.0, 0.0)) + from(glam::DVec3::new(3.6, 3.0, 0.0));
                (both * glam::DVec3::new(9.0, 18.0, 27.0)).as_vec3()
            })
            .collect(),
    };
    let errors = Incidence::ALL.map(|incidence| rel_l2(&reflected(&lit, incidence), &expected, None));
    println!("photon, mean, light: {errors:.4?}");
    assert!(errors[0] < 0.01 && errors[0] < 0.5 * errors[1] && errors[1] < errors[2], "{errors:?}");
    // Diffuse floors do not ask.
    let [a, b] = [Incidence::Photon, Incidence::Light].map(|incidence| reflected(&lambert, incidence));
    assert!(a.pixels == b.pixels);
}

/// By the letter of Equations 3 and 9, light that a tilted mirror sends has the wrong energy: by the ratio of the cosines.
#[test]
fn the_papers_equations_err_by_the_ratio_of_cosines() {
    // Above the floor, turned about z: parallel light from above leaves it at twice the angle.
    let tilt = 20.0f64;
    let mirror = format!(
        "[[object]]\nshape = {{ plane = {{ size = [1, 1] }} }}\nrotate_deg = [0, 0, {}]\ntranslate = [-1.3, 0.5, 0]\n\
         reflector = {{}}\ncamera_visible = false\n",
        tilt - 90.0
    );
    let lit = above_floor(DARK, &format!("{SLANTED}{mirror}"));
    // The mirror's normal, and the direction after it.
    let normal = glam::DVec3::new(tilt.to_radians().cos(), tilt.to_radians().sin(), 0.0);
    let arriving = -glam::DVec3::new(0.36, 0.8, 0.48);
    let leaving = arriving - 2.0 * arriving.dot(normal) * normal;
    let expected = -leaving.y / 0.8;
    for mode in [Mode::Polygons, Mode::Gather] {
        let [right, literal] = [false, true].map(|paper| {
            let mut options = options(mode, 512);
            options.image_space.paper = paper;
            caustic(&lit, options)
        });
        let ratio = f64::from(literal.0.mean().y / right.0.mean().y);
        println!("{}: {ratio:.4} of {expected:.4}; {:?}", mode.name(), literal.1.flux);
        assert!(right.0.mean().y > 0.0 && (expected - 1.0).abs() > 0.05);
        // Edges without polygons are left out.
        let limit = if mode == Mode::Gather { 0.01 } else { 0.02 };
        assert!((ratio / expected - 1.0).abs() < limit, "{}: {ratio} of {expected}", mode.name());
    }
}

/// Gathers leave out texels with fewer than three photons in the 7×7 around them, and only those; what they had is accounted for.
#[test]
fn gathers_leave_out_fewer_than_three_photons() {
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{FILM}"));
    // A photon in about four by four texels.
    let (points, _) = caustic(&lit, options(Mode::Points, 130));
    let (gathered, photons) = caustic(&lit, options(Mode::Gather, 130));
    let one = points.pixels.iter().map(|pixel| pixel.x).filter(|x| *x > 0.0).fold(f32::INFINITY, f32::min);
    let count = |x: i64, y: i64| {
        let is_inside = (0..128).contains(&x) && (0..128).contains(&y);
        if is_inside { (points.pixels[(y * 128 + x) as usize].x / one).round() as u32 } else { 0 }
    };
    let mut left_out = 0;
    for (k, pixel) in gathered.pixels.iter().enumerate() {
        let (x, y) = (k as i64 % 128, k as i64 / 128);
        let around: u32 = (-3..=3).flat_map(|dy| (-3..=3).map(move |dx| count(x + dx, y + dy))).sum();
        assert_eq!(pixel.x > 0.0, around >= 3, "{x} {y}: {around} photons, {pixel}");
        left_out += u32::from((1..3).contains(&around));
    }
    println!("{left_out} texels left out; {:?}", photons.flux);
    assert!(left_out > 100 && photons.flux.culled > 0.0 && photons.flux.error().abs() < 1e-6);
}

/// Photons of four frames, each through another quarter of their grid's texels, are one grid that is twice as fine.
#[test]
#[ignore = "full: fine grids of photons"]
fn four_frames_are_a_grid_twice_as_fine() {
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{BALL}"));
    for mode in [Mode::Points, Mode::Gather] {
        let of = |photons, frames| {
            let mut options = options(mode, photons);
            options.image_space.temporal_frames = frames;
            caustic(&lit, options)
        };
        let ((fine, of_fine), (averaged, of_frames)) = (of(256, 1), of(128, 4));
        let error = rel_l2(&averaged, &fine, None);
        println!("{}: {error:.1e}", mode.name());
        assert_eq!(of_fine.photons, of_frames.photons);
        // Gathers drop other photons: those of a frame are fewer.
        assert!(error < if mode == Mode::Points { 1e-3 } else { 0.05 }, "{}: {error}", mode.name());
    }
}

/// What has moved is left behind after four frames.
#[test]
fn averages_follow_in_four_frames() {
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{BALL}"));
    let mut averaged = options(Mode::ThinLens, 128);
    averaged.image_space.temporal_frames = 4;
    let mut engine = new_engine(lit.clone(), averaged.clone(), &BackendChoice::Cpu).unwrap();
    let first = render_again(&mut engine).unwrap().layers.remove(0).1;
    let moved = |scene: &mut Scene| {
        let ball = scene.objects.iter_mut().find(|object| object.refractor.is_some()).unwrap();
        ball.placement.translate.x += 0.3;
    };
    moved(engine.scene_mut());
    let frames = [0; 5].map(|_| render_again(&mut engine).unwrap().layers.remove(0).1);
    let mut expected = lit;
    moved(&mut expected);
    let (expected, _) = caustic(&expected, averaged);
    let errors = frames.each_ref().map(|frame| rel_l2(frame, &expected, None));
    println!("{errors:.4?}, at first {:.2}", rel_l2(&first, &expected, None));
    assert!(errors[0] > 0.3 && errors[0] < rel_l2(&first, &expected, None), "{errors:?}");
    assert!(errors[0] > errors[1] && errors[1] > errors[2] && errors[2] > errors[3], "{errors:?}");
    assert!(errors[3] < 1e-3 && errors[4] < 1e-3, "{errors:?}");
}

/// Lenses with frames that are averaged, as with as many photons in one frame, and with maps twice as fine (Wyman and Dachsbacher 2006,
/// Section 5): about the same picture, and the same energy.
#[test]
fn lenses_work_with_frames_and_with_finer_maps() {
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{BALL}"));
    let of = |photons, frames, (caustic_map, texels)| {
        let mut options = options(Mode::ThinLens, photons);
        options.image_space.temporal_frames = frames;
        options.image_space.caustic_map = caustic_map;
        options.image_space.caustic_map_size = texels;
        caustic(&lit, options)
    };
    let fine_map = (MapView::Light, 512);
    let (supersampled, of_fine_map) = of(256, 1, fine_map);
    let (averaged, of_frames) = of(128, 4, fine_map);
    let (fine, _) = of(256, 1, (MapView::Light, 256));
    let energy = |image: &Image| f64::from(image.mean().x / fine.mean().x);
    let error = rel_l2(&averaged, &supersampled, None);
    println!("{error:.4}, energies {:.5} {:.5}", energy(&averaged), energy(&supersampled));
    assert!(error <= 0.1, "{error}");
    assert!((energy(&averaged) - 1.0).abs() < 0.01 && (energy(&supersampled) - 1.0).abs() < 0.01);
    assert!(of_frames.flux.error().abs() < 1e-4 && of_fine_map.flux.error().abs() < 1e-4);
}

/// Photons that are all followed and then put together: those that the traversals leave, with the same picture and the same flux.
#[test]
#[ignore = "full: a million photons"]
fn hierarchies_put_photons_together() {
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{BALL}"));
    let of = |traversal| {
        let mut options = options(Mode::Splats, 1024);
        options.image_space.traversal = traversal;
        caustic(&lit, options)
    };
    let ((dense, of_dense), (picture, of_hierarchy)) = (of(Traversal::Dense), of(Traversal::Hierarchical));
    let (_, of_clusters) = of(Traversal::TexelError);
    let error = rel_l2(&picture, &dense, None);
    let [all, kept, of_clusters] = [of_dense, of_hierarchy, of_clusters].map(|photons| photons.photons_used);
    println!("{kept} of {all} photons, {of_clusters} by clusters; {error:.4}");
    // What is reflected and what is refracted are followed one after the other.
    assert_eq!(of_hierarchy.photons, 2 * of_dense.photons);
    assert!(kept <= of_clusters && 2 * kept < all && error < 0.01, "{kept} of {all}, {of_clusters}, {error}");
    let flux = [of_hierarchy.flux.cast, of_hierarchy.flux.deposited];
    let ratios = [flux[0] / of_dense.flux.cast, flux[1] / of_dense.flux.deposited];
    assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 1e-4), "{ratios:?}");
}

/// Photons of clusters that part are added in lower resolutions: less noise than points of as many photons, and the same energy.
#[test]
#[ignore = "full: a million photons"]
fn clusters_that_part_are_added_in_lower_resolutions() {
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{BALL}"));
    let of = |mode, photons| {
        let mut options = options(mode, photons);
        options.image_space.traversal =
            if mode == Mode::ExactPolygons { Traversal::Dense } else { Traversal::TexelError };
        caustic(&lit, options)
    };
    let (truth, _) = of(Mode::ExactPolygons, 1024);
    let ((single, of_single), (several, of_several)) = (of(Mode::Points, 512), of(Mode::MultiResolution, 512));
    let [alone, mixed] = [&single, &several].map(|image| mrse(image, &truth, None));
    let energy = several.mean().x / single.mean().x;
    println!("mrse {alone:.3} and {mixed:.3}, energy {energy:.5}, {} photons", of_several.photons_used);
    assert_eq!(of_single.photons_used, of_several.photons_used);
    assert!(mixed < 0.5 * alone && (energy - 1.0).abs() < 1e-3, "{alone} {mixed} {energy}");
    assert!(of_several.flux.error().abs() < 1e-4);
}

/// Two parallel slabs of glass, by rays and in images of each: E₀ cosθ T⁴.
#[test]
fn two_slabs_have_their_closed_form() {
    let slab = |height: f32| {
        format!(
            "[[object]]\nshape = {{ box = {{ size = [8, 0.1, 8] }} }}\ntranslate = [0, {height}, 0]\n\
             refractor = {{ eta = 1.5, interfaces = 2 }}\ncamera_visible = false\n"
        )
    };
    let lit = above_floor(DARK, &format!("{SLANTED}{}{}", slab(0.5), slab(0.9)));
    let expected = 0.8 * transmittance(0.8, 1.5).powi(4);
    for hits in [Hits::Traced, Hits::Image] {
        let mut options = options(Mode::ExactPolygons, 256).with_aovs(vec![Aov::CausticTTTT]);
        options.image_space.hits = hits;
        let (found, photons) = caustic(&lit, options);
        let mean = f64::from(found.mean().x);
        let flat =
            Image { pixels: vec![Vec3::new(1.0, 2.0, 3.0) * expected as f32; found.pixels.len()], ..found.clone() };
        let error = rel_l2(&found, &flat, None);
        println!("{}: {mean} of {expected}, {error:.1e}, {:.1e}", hits.name(), photons.flux.error());
        assert!((mean / expected - 1.0).abs() < 0.01 && error < 0.01, "{}: {mean} of {expected}, {error}", hits.name());
        assert!(photons.flux.error().abs() < 1e-4);
    }
}

/// Light through one glass ball and another, beside beams of the ground truth.
#[test]
#[ignore = "full: a ground truth"]
fn two_balls_are_as_the_ground_truth_says() {
    let ball = |x: f32, height: f32| {
        format!(
            "[[object]]\nshape = {{ sphere = {{ radius = 0.3, divisions = 32 }} }}\ntranslate = [{x}, {height}, 0]\n\
             refractor = {{ eta = 1.3, interfaces = 2 }}\ncamera_visible = false\n"
        )
    };
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{}{}", ball(0.0, 0.5), ball(0.1, 1.3)));
    let wanted = reference::Options {
        size: [64; 2],
        estimator: Estimator::Beams,
        chains: pinspot::scene::Chain::TTTT.into(),
        ..Default::default()
    };
    let truth = Reference::new(lit.clone(), wanted).unwrap();
    let truth = truth.solve(&StoppingCriterion::new(0.01), None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance;
    let mut energies = Vec::new();
    for (hits, limit) in [(Hits::Traced, 0.05), (Hits::Image, 0.15)] {
        let mut options = options(Mode::ExactPolygons, 512).with_aovs(vec![Aov::CausticTTTT]).with_size([64; 2]);
        options.image_space.hits = hits;
        let (found, _) = caustic(&lit, options);
        let (error, energy) = (rel_l2(&found, &truth, None), found.mean().x / truth.mean().x);
        println!("{}: {error:.4}, energy {energy:.4}", hits.name());
        energies.push(energy);
        assert!(error < limit, "{}: {error}", hits.name());
    }
    assert!(energies.iter().all(|energy| (energy - 1.0).abs() < 0.02), "{energies:?}");
}

/// A box of interfaces that change nothing, around a lamp: the six faces of its view have all of its light, 4 π I, and there is no step on the
/// floor where they meet.
#[test]
fn six_faces_around_a_lamp_have_all_of_its_light() {
    let folder = tempfile::tempdir().unwrap();
    // The fronts of its sides are inside.
    let corners = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2].map(|side| 0.5 * side as f32 - 0.25));
    let vertices: Vec<String> = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let sides = "f 1 3 7 5\nf 2 6 8 4\nf 1 5 6 2\nf 3 4 8 7\nf 1 2 4 3\nf 5 7 8 6\n";
    std::fs::write(folder.path().join("shell.obj"), vertices.concat() + sides).unwrap();
    let shell = "[[light]]\nposition = [0, 0.5, 0]\nintensity = [9, 18, 27]\n[[object]]\nmesh = \"shell.obj\"\n\
                 translate = [0, 0.5, 0]\nrefractor = { eta = 1.0, fresnel = false }\ncamera_visible = false\n";
    let lit = above_floor_in(folder.path(), DARK, shell);
    let (found, photons) = caustic(&lit, options(Mode::ExactPolygons, 256));
    let all = 4.0 * std::f64::consts::PI * (9.0 + 18.0 + 27.0);
    assert!((photons.flux.cast / all - 1.0).abs() < 2e-3, "{} of {all}", photons.flux.cast);
    let mut largest = 0.0f64;
    for (k, pixel) in (0..).zip(&found.pixels) {
        let at = |k: u32| 2.0 * (f64::from(k) + 0.5) / 128.0 - 1.0;
        let squared = at(k % 128).powi(2) + at(k / 128).powi(2) + 0.25;
        let expected = 9.0 * 0.5 / squared.powf(1.5);
        largest = largest.max((f64::from(pixel.x) / expected - 1.0).abs());
    }
    println!("{} of {all}, at most {largest:.4} apart", photons.flux.cast);
    assert!(largest < 0.02, "{largest}");
}

/// What is reflected and what is refracted at one interface are together all of the light on it.
#[test]
fn interfaces_divide_light_without_loss() {
    let water = "[[object]]\nshape = { plane = { size = [4, 4] } }\ntranslate = [0, 1, 0]\nrefractor = { eta = 1.333 }\n\
                 camera_visible = false\n";
    let lit = above_floor(DARK, &format!("{STRAIGHT_DOWN}{water}"));
    let flux = caustic(&lit, options(Mode::Points, 256)).1.flux;
    // Of 1, 2 and 3 W/m² on 16 m²; what is reflected finds no receiver.
    println!("{flux:?}");
    assert!((flux.cast / 96.0 - 1.0).abs() < 1e-3, "{}", flux.cast);
    let reflected = 1.0 - transmittance(1.0, 1.333);
    assert!((flux.missed / flux.cast - reflected).abs() < 1e-4, "{} {reflected}", flux.missed / flux.cast);
}
