//! Samples that are denser where they matter: they bias nothing, and the errors fall where they should.

use pinspot::image::rel_l2;
use pinspot::low_level::differential::differentials;
use pinspot::low_level::sampling::{Density, Strategy, Surface};
use pinspot::reference::Quantity;
use pinspot::scene::{Visibility, load};
use pinspot::{Settings, place_samples};

use crate::support::{median, rendered, truth};

const DENSITIES: [Density; 4] = [Density::Curvature, Density::Normal, Density::Visibility, Density::Contribution];

#[test]
fn the_number_is_met_and_all_of_the_surface_is_stood_for() {
    for (strategy, density) in
        DENSITIES.map(|d| (Strategy::Neighbourhood, d)).into_iter().chain([(Strategy::Random, Density::Contribution)])
    {
        let loaded = load::<Settings>("spoon").unwrap();
        let mut options = loaded.render.options().unwrap();
        options.samples = 800;
        (options.strategy, options.density) = (strategy, density);
        let set = place_samples(&loaded.scene, &options).unwrap();
        assert!(set.points.len().abs_diff(800) <= 16, "{density:?}: {}", set.points.len());
        let samples = differentials(&set);
        let whole = Surface::of_scene(&loaded.scene).area();
        let cells: f64 = samples.iter().map(|s| f64::from(s.cell.area)).sum();
        assert!((cells / whole - 1.0).abs() < 1e-3, "{density:?}: cells of {cells} m² on {whole} m²");
        let points: f64 = samples.iter().map(|s| f64::from(s.area)).sum();
        assert!((points / whole - 1.0).abs() < 0.1, "{density:?}: points of {points} m² on {whole} m²");
        let mut areas: Vec<f32> = samples.iter().map(|s| s.cell.area).collect();
        areas.sort_by(f32::total_cmp);
        let spread = areas[areas.len() * 9 / 10] / areas[areas.len() / 10];
        assert!(spread > 1.5, "{density:?} places samples as evenly as ever: {spread}");
    }
}

/// Glass that only refracts twice casts nothing by sums, and a prism has a sample for each colour: neither shifts the importance of others.
#[test]
fn samples_that_cast_nothing_or_thrice_keep_the_others_in_place() {
    let refractors = ["eta = 1.5, interfaces = 2, fresnel = false", "eta = [1.5, 1.51, 1.52]"];
    for (refractor, density) in refractors.iter().flat_map(|refractor| DENSITIES.map(|density| (refractor, density))) {
        let text = format!(
            "environment = {{ constant = [1, 1, 1] }}\ncamera = {{ position = [0, 3, 3], target = [0, 0, 0], perspective = {{ fov_y_deg = 40 \
             }} }}\n[[object]]\nshape = {{ sphere = {{ radius = 0.3 }} }}\ntranslate = [-1, 0.4, 0]\nrefractor = {{ {refractor} }}\n\
             [[object]]\nshape = {{ sphere = {{ radius = 0.3 }} }}\ntranslate = [1, 0.4, 0]\nreflector = {{}}\n\
             [[object]]\nshape = {{ plane = {{ size = [4, 4] }} }}\nreceiver = {{}}\n"
        );
        let loaded = pinspot::scene::parse::<Settings>("test.toml", &text, std::path::Path::new(".")).unwrap();
        let mut options = loaded.render.options().unwrap();
        (options.samples, options.density, options.size) = (300, density, [32, 32]);
        let points = place_samples(&loaded.scene, &options).unwrap().points;
        let right = points.iter().filter(|point| point.position.x > 0.0);
        // What lies next to the table contributes most.
        let (low, high) = right.partition::<Vec<&_>, _>(|point| point.position.y < 0.4);
        assert!(low.len() > 30 && high.len() > 30, "{refractor} {density:?}: {} {}", low.len(), high.len());
        if density == Density::Contribution {
            assert!(low.len() > high.len(), "{refractor}: {} {}", low.len(), high.len());
        }
    }
}

#[test]
#[ignore = "full: statistics over samples"]
fn no_density_makes_the_picture_brighter_or_darker() {
    let mean = |density| rendered("mirror-sphere", 32, |o| (o.density, o.samples) = (density, 3000)).mean().x;
    let even = mean(Density::Uniform);
    for density in DENSITIES {
        let off = mean(density) / even - 1.0;
        assert!(off.abs() < 0.01, "{density:?}: {off}");
    }
}

#[test]
#[ignore = "full: a ground truth"]
fn knowing_the_light_lowers_the_error_of_a_ring() {
    knowing_the_light_lowers_the_error("ring");
}

#[test]
#[ignore = "full: another ground truth"]
fn knowing_the_light_lowers_the_error_of_a_spoon() {
    knowing_the_light_lowers_the_error("spoon");
}

/// 300 samples placed by contribution have a smaller error than even ones: docs/accuracy.md, "Sampling by contribution".
fn knowing_the_light_lowers_the_error(name: &str) {
    const SIZE: u32 = 24;
    let expected = truth(name, Quantity::Caustic, Visibility::Full, SIZE, 0.02);
    let error = |density| {
        let of = |seed| {
            let image = rendered(name, SIZE, |o| (o.density, o.samples, o.seed) = (density, 300, seed));
            rel_l2(&image, &expected, None)
        };
        median([1, 2, 3].map(of).to_vec())
    };
    let (even, knowing) = (error(Density::Uniform), error(Density::Contribution));
    println!("{name}: {even:.3} even, {knowing:.3} by contribution");
    assert!(knowing < 0.95 * even, "{name}: {knowing} by contribution, {even} even");
}

#[test]
fn strategies_that_place_samples_evenly_say_so() {
    let loaded = load::<Settings>("ring").unwrap();
    let mut options = loaded.render.options().unwrap();
    (options.strategy, options.density) = (Strategy::Grid, Density::Curvature);
    let message = place_samples(&loaded.scene, &options).unwrap_err().to_string();
    assert!(message.contains("strategy grid"), "{message}");
    assert!(message.contains("neighbourhood and random"), "{message}");
}
