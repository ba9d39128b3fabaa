//! Receivers that are not Lambertian: both back ends against quadratures of the textbook formulas.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use pinspot::NoProgress;
use pinspot::image::{Aov, Image, rel_l2};
use pinspot::low_level::brdf::{BrdfTable, Gloss, Materials};
use pinspot::low_level::environment::{CubeMap, Environment};
use pinspot::low_level::pinhole::{Footprint, Params, Receivers, ViewDirections};
use pinspot::low_level::sampling::Strategy;
use pinspot::low_level::tracing::Tracer;
use pinspot::reference::{self, Quantity, Reference, StoppingCriterion};
use pinspot::scene::{Scene, parse};
use pinspot::{BackendChoice, Options};

use crate::support::{BACK_ENDS, pinholes_of, render, scene};

/// A flat mirror of 4 × 4 m, 1 m above the origin, that faces down.
const CEILING: &str = "[[object]]\nshape = { plane = { size = [4.0, 4.0] } }\nrotate_deg = [180.0, 0.0, 0.0]\n\
                       translate = [0.0, 1.0, 0.0]\nreflector = { reflectance = [1.0, 1.0, 1.0] }\n";
const ALBEDO: f64 = 0.3;

/// Of the directions towards the light and the viewer; the normal is up.
type Function = Box<dyn Fn(DVec3, DVec3) -> f64>;

/// Under constant radiance of 1: ∫ f(l, v) cos⁴θ dA over the ceiling, h = 1.
fn reflected(f: impl Fn(DVec3, DVec3) -> f64, view: DVec3) -> f64 {
    let steps = 800;
    let step = 4.0 / f64::from(steps);
    let at = |k: u32| step * (f64::from(k) + 0.5) - 2.0;
    let piece = |k: u32| {
        let l = DVec3::new(at(k % steps), 1.0, at(k / steps)).normalize();
        f(l, view) * l.y.powi(4)
    };
    (0..steps * steps).map(piece).sum::<f64>() * step * step
}

/// Phong, *Illumination for Computer Generated Pictures* (1975), normalised.
fn phong(l: DVec3, v: DVec3, specular: f64, exponent: f64) -> f64 {
    let mirrored = DVec3::new(-l.x, l.y, -l.z);
    ALBEDO / PI + specular * (exponent + 2.0) / (2.0 * PI) * mirrored.dot(v).max(0.0).powf(exponent)
}

/// Walter et al. (2007), Equations 20, 33 and 34, with the separate masking of each direction made one as in Heitz (2014).
fn ggx(l: DVec3, v: DVec3, specular: f64, roughness: f64) -> f64 {
    let alpha = roughness * roughness;
    let h = (l + v).normalize();
    let tan2 = |c: f64| (1.0 - c * c) / (c * c);
    let d = (alpha * alpha) / (PI * h.y.powi(4) * (alpha * alpha + tan2(h.y)).powi(2));
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * tan2(c)).sqrt() - 1.0);
    let g = 1.0 / (1.0 + lambda(l.y) + lambda(v.y));
    let fresnel = |c: f64| specular + (1.0 - specular) * (1.0 - c).powi(5);
    let passes = (1.0 - fresnel(l.y)) * (1.0 - fresnel(v.y));
    ALBEDO / PI * passes + d * g * fresnel(l.dot(h)) / (4.0 * l.y * v.y)
}

fn table(half: f64, diff: f64, phi: f64) -> f64 {
    0.1 + 0.3 * (-8.0 * half).exp() + 0.05 * diff.cos() * (2.0 * phi).cos().powi(2)
}

fn tabulated(l: DVec3, v: DVec3) -> f64 {
    let h = (l + v).normalize();
    let across = DVec3::Y.cross(h).normalize();
    let away = across.cross(h);
    table(h.y.acos(), l.dot(h).acos(), l.dot(across).atan2(l.dot(away)))
}

#[test]
fn both_back_ends_reflect_as_the_formulas_say() {
    let functions: [(Gloss, Function); 5] = [
        (Gloss::None, Box::new(|_, _| ALBEDO / PI)),
        (Gloss::Phong { specular: Vec3::splat(0.5), exponent: 30.0 }, Box::new(|l, v| phong(l, v, 0.5, 30.0))),
        (Gloss::Ggx { specular: Vec3::splat(0.2), roughness: 0.5 }, Box::new(|l, v| ggx(l, v, 0.2, 0.5))),
        (Gloss::Ggx { specular: Vec3::splat(0.04), roughness: 0.3 }, Box::new(|l, v| ggx(l, v, 0.04, 0.3))),
        (
            Gloss::Table(Arc::new(BrdfTable::from_function("test", |a, b, c| {
                Vec3::splat(table(a.into(), b.into(), c.into()) as f32)
            }))),
            Box::new(tabulated),
        ),
    ];
    let pinholes = pinholes_of(&scene(CEILING), 20_000, Strategy::Neighbourhood, Footprint::Cells, 1);
    let cube = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
    // The object's index in `Receivers::from_points` below is 1.
    let objects = |gloss| [None, Some((Vec3::splat(ALBEDO as f32), gloss))];
    let views = [DVec3::Y, DVec3::new(0.5, 0.8, 0.2).normalize(), DVec3::new(-0.8, 0.4, 0.5).normalize()];
    for (gloss, f) in &functions {
        let materials = Arc::new(Materials::new(objects(gloss).into_iter()));
        let mut receivers = Receivers::from_points(&[(Vec3::ZERO, Vec3::Y, 1); 3], 3);
        let directions = views.map(|v| v.as_vec3().extend(0.0).to_array()).to_vec();
        receivers.view_directions = Some(ViewDirections { directions, materials });
        for (name, gather) in BACK_ENDS {
            let got = gather(&receivers, &pinholes, &cube, &Params::default());
            for (got, view) in got.iter().zip(views) {
                let expected = reflected(f, view);
                let off = f64::from(got[0]) / expected - 1.0;
                assert!(off.abs() < 0.015, "{name}, {gloss:?}, from {view}: {} is not {expected}", got[0]);
            }
        }
    }
}

/// A ring of gold in forest light on a table, seen obliquely.
fn ring_on(receiver: &str) -> Scene {
    let text = format!(
        "[environment]\nmap = \"forest\"\n[camera]\nposition = [0.0, 4.0, 3.0]\ntarget = [0.0, 0.0, 0.0]\n\
         orthographic = {{ height = 1.2 }}\n[[object]]\nname = \"ring\"\nshape = {{ ring = {{ radius = 1.0, height = 0.5 }} }}\n\
         camera_visible = false\nreflector = {{ metal = \"gold\" }}\n[[object]]\nshape = {{ plane = {{ size = [3.0, 3.0] }} }}\n\
         receiver = {{ {receiver} }}\n"
    );
    parse::<toml::Table>("test.toml", &text, std::path::Path::new(".")).unwrap().scene
}

#[test]
fn a_glossy_receiver_is_right() {
    let glossy = error_of(8, "albedo = [0.2, 0.2, 0.2], phong = { specular = [0.5, 0.5, 0.5], exponent = 40 }", 0.02);
    println!("{glossy:.3}");
    assert!(glossy < 0.08, "{glossy}");
}

/// Lobes make the integrand sharper, so that 2,000 samples are not as near to the ground truth as on a diffuse receiver (.024).
#[test]
#[ignore = "full: ground truths"]
fn glossy_receivers_are_right() {
    let error = |receiver| error_of(16, receiver, 0.01);
    let diffuse = error("albedo = [0.5, 0.5, 0.5]");
    println!("diffuse: {diffuse:.3}");
    assert!(diffuse < 0.04, "{diffuse}");
    for receiver in [
        "albedo = [0.2, 0.2, 0.2], phong = { specular = [0.5, 0.5, 0.5], exponent = 40 }",
        "albedo = [0.2, 0.2, 0.2], ggx = { specular = [0.3, 0.3, 0.3], roughness = 0.4 }",
        "albedo = [0.2, 0.2, 0.2], ggx = { specular = [0.04, 0.04, 0.04], roughness = 0.3 }",
    ] {
        let glossy = error(receiver);
        println!("{receiver}: {glossy:.3}");
        assert!(glossy < 0.08, "{receiver}: {glossy}");
    }
}

/// How far what a receiver reflects, in a square picture, is from a ground truth of such an error; on both back ends the same.
fn error_of(edge: u32, receiver: &str, truth_error: f64) -> f64 {
    let scene = ring_on(receiver);
    let options = reference::Options { size: [edge; 2], quantity: Quantity::Reflected, ..Default::default() };
    let goal = StoppingCriterion::new(truth_error);
    let expected = Reference::new(scene.clone(), options).unwrap();
    let expected = expected.solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance;
    let mut pinholes = pinholes_of(&scene, 2000, Strategy::Neighbourhood, Footprint::Cells, 1);
    pinholes.trace_visibility(&scene, &Tracer::new(&scene), &pinspot::NoProgress);
    let environment = Environment::new(&scene.environment.light, Default::default()).unwrap();
    let size = glam::Vec2::splat(edge as f32);
    let rays = (0..edge * edge).map(|k| {
        let at = glam::Vec2::new((k % edge) as f32, (k / edge) as f32) + 0.5;
        scene.camera.ray(at, size)
    });
    let (points, directions): (Vec<_>, Vec<_>) = rays
        .map(|ray| {
            let position = ray.origin - ray.direction * (ray.origin.y / ray.direction.y);
            ((position, Vec3::Y, 1), (-ray.direction).extend(0.0).to_array())
        })
        .unzip();
    let mut receivers = Receivers::from_points(&points, edge);
    receivers.view_directions = Some(ViewDirections { directions, materials: Arc::new(scene.materials()) });
    let errors = BACK_ENDS.map(|(_, gather)| {
        let got = gather(&receivers, &pinholes, &environment.cube, &Params::default());
        let pixels = got.iter().map(|g| Vec3::new(g[0], g[1], g[2])).collect();
        rel_l2(&Image { width: edge, height: edge, pixels }, &expected, None)
    });
    assert!((errors[0] - errors[1]).abs() < 1e-4, "{receiver}: {errors:?}");
    errors[0]
}

fn table_under_the_sky(receiver: &str) -> Scene {
    let text = format!(
        "[environment]\nconstant = [1.0, 1.0, 1.0]\n[camera]\nposition = [1.0, 1.0, 0.0]\ntarget = [0.0, 0.0, 0.0]\n\
         orthographic = {{ height = 0.1 }}\n[[object]]\nshape = {{ plane = {{ size = [1.0, 1.0] }} }}\nreceiver = {{ {receiver} }}\n\
         [[object]]\nshape = {{ sphere = {{ radius = 1e-3 }} }}\ntranslate = [0.0, 50.0, 0.0]\nreflector = {{}}\n"
    );
    parse::<toml::Table>("test.toml", &text, std::path::Path::new(".")).unwrap().scene
}

/// Under light of 1 from everywhere a surface shows what it reflects of all of it.
#[test]
fn the_sky_is_reflected_by_the_albedo_of_the_direction() {
    let v = DVec3::new(1.0, 1.0, 0.0).normalize();
    let over_the_sky = |f: &dyn Fn(DVec3, DVec3) -> f64| {
        let steps = 1500;
        let mut sum = 0.0;
        for k in 0..steps * steps {
            let (u, w) = (f64::from(k % steps) + 0.5, f64::from(k / steps) + 0.5);
            let (sin2, angle) = (u / f64::from(steps), 2.0 * PI * w / f64::from(steps));
            let (radius, y) = (sin2.sqrt(), (1.0 - sin2).sqrt());
            sum += f(DVec3::new(radius * angle.cos(), y, radius * angle.sin()), v);
        }
        sum * PI / f64::from(steps * steps)
    };
    let cases: [(&str, Function); 2] = [
        (
            "albedo = [0.3, 0.3, 0.3], phong = { specular = [0.5, 0.5, 0.5], exponent = 30 }",
            Box::new(|l, v| phong(l, v, 0.5, 30.0)),
        ),
        (
            "albedo = [0.3, 0.3, 0.3], ggx = { specular = [0.2, 0.2, 0.2], roughness = 0.4 }",
            Box::new(|l, v| ggx(l, v, 0.2, 0.4)),
        ),
    ];
    for (receiver, f) in cases {
        let options = Options::default().with_size([8, 8]).with_samples(4).with_aovs(vec![Aov::Beauty]);
        let rendered = render(table_under_the_sky(receiver), options, &BackendChoice::Cpu).unwrap();
        let mean = rendered.layers[0].1.mean().x;
        let expected = over_the_sky(&*f);
        assert!((f64::from(mean) / expected - 1.0).abs() < 0.02, "{receiver}: {mean}, not {expected}");
    }
}

/// Nearer than a part of a cell to a wall, whether a cell of it is opposite is up to chance.
#[test]
fn light_is_even_along_the_foot_of_a_wall() {
    let text = "environment = { constant = [1, 1, 1] }
        camera = { position = [0.9985, 2, 0], target = [0.9985, 0, 0], up = [0, 0, -1], orthographic = { height = 0.004 } }
        object = [
            { shape = { ring = { radius = 1.0, height = 0.5 } }, reflector = {} },
            { shape = { plane = { size = [4, 4] } }, receiver = {} },
        ]";
    let wall = parse::<pinspot::Settings>("wall.toml", text, std::path::Path::new(".")).unwrap().scene;
    for choice in [BackendChoice::Cpu, BackendChoice::Gpu(None)] {
        let options = Options::default().with_size([32, 32]).with_samples(1000).with_aovs(vec![Aov::Caustic]);
        let picture = render(wall.clone(), options, &choice).unwrap();
        let light = &picture.layers[0].1;
        // The wall is at column 28. Columns are an eighth of a millimetre, cells 3.5 mm wide.
        let column = |x: u32| (0..32).map(move |y| f64::from(light.pixels[(y * 32 + x) as usize].x));
        let mean = |x: u32| column(x).sum::<f64>() / 32.0;
        let far = mean(0);
        for x in 16..27 {
            let deviation = (column(x).map(|value| (value - mean(x)).powi(2)).sum::<f64>() / 32.0).sqrt();
            assert!((mean(x) / far - 1.0).abs() < 0.03, "{choice:?}, column {x}: {} beside {far}", mean(x));
            assert!(deviation < 0.02 * far, "{choice:?}, column {x}: {deviation} of {far}");
        }
    }
}
