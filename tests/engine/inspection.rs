//! What an engine tells of a place in its picture.

use pinspot::glam::{Vec2, Vec3};
use pinspot::{Backend, Engine, EvaluationChoice, NoProgress, scene};

fn engine(scene: &str) -> Engine {
    let (scene, options) = pinspot::load(scene).unwrap();
    Engine::new(scene, options.with_size([64, 64]).with_samples(200), Backend::cpu())
}

/// Of some places, the one with the brightest caustic.
fn bright_place(engine: &mut Engine) -> Vec2 {
    let places = (0..100).map(|k| Vec2::new((k % 10) as f32 + 0.5, (k / 10) as f32 + 0.5) / 10.0);
    let with_irradiance = places.map(|place| {
        let found = engine.inspect(place, &NoProgress).unwrap();
        (found.and_then(|found| found.receiver).map_or(0.0, |receiver| receiver.irradiance.y), place)
    });
    with_irradiance.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap().1
}

/// At a receiver footprints with a contribution each; at a mirror what its sample sees; nothing where nothing is.
#[test]
fn receivers_have_footprints_and_mirrors_have_views() {
    let mut ring = engine("ring-above");
    let place = bright_place(&mut ring);
    let table = ring.inspect(place, &NoProgress).unwrap().unwrap();
    let receiver = table.receiver.unwrap();
    let parts: f32 = receiver.footprints.iter().map(|footprint| footprint.part).sum();
    assert!((parts - 1.0).abs() < 1e-3 && receiver.irradiance.y > 0.0 && table.view.is_none());
    assert!(receiver.footprints.is_sorted_by(|a, b| a.part >= b.part));
    let mut ball = engine("mirror-sphere");
    let mirror = (0..64)
        .find_map(|k| {
            let place = Vec2::new((k % 8) as f32 + 0.5, (k / 8) as f32 + 0.5) / 8.0;
            ball.inspect(place, &NoProgress).unwrap().and_then(|found| found.view)
        })
        .expect("the camera sees the mirror");
    let sky = mirror.sees_environment.iter().filter(|sees| **sees).count();
    assert_eq!(mirror.sees_environment.len(), (mirror.resolution * mirror.resolution) as usize);
    assert!(sky > 0, "a ball above a table sees the sky");
    assert!(engine("dynamic").inspect(Vec2::new(0.99, 0.01), &NoProgress).unwrap().is_none());
}

/// They bring what the samples do, up to the tolerance, and there are fewer of them than leaves.
#[test]
fn cells_bring_what_samples_do() {
    let mut ring = engine("ring-above");
    let place = bright_place(&mut ring);
    let samples = ring.inspect(place, &NoProgress).unwrap().unwrap().receiver.unwrap();
    let cells = ring.cells_taken(place, &NoProgress).unwrap().unwrap();
    let sum: Vec3 = cells.iter().map(|cell| cell.irradiance).sum();
    assert!((sum.y / samples.irradiance.y - 1.0).abs() < 0.5, "{sum} {}", samples.irradiance);
    assert!(!cells.is_empty() && cells.len() < 200 * 64, "{}", cells.len());
    *ring.options_mut() = ring.options().clone().with_evaluation(EvaluationChoice::Flat);
    assert!(ring.cells_taken(place, &NoProgress).unwrap().is_none());
}

#[test]
fn the_environment_map_shows_directions_where_files_have_them() {
    let mut engine = engine("ring-above");
    engine.scene_mut().environment.light =
        scene::Light::Spot { direction: Vec3::X, sigma_rad: 0.2, radiance: Vec3::ONE };
    let map = engine.environment_map(16, &NoProgress).unwrap();
    let brightest = (0..map.pixels.len()).max_by(|&a, &b| map.pixels[a].x.total_cmp(&map.pixels[b].x)).unwrap();
    assert!((7..=8).contains(&(brightest % 32)) && (7..=8).contains(&(brightest / 32)), "{brightest}");
}
