//! Hostile input: mutants of small valid files through every reader.
//!
//! Each reader must neither panic, nor abort, nor allocate out of proportion, nor accept a number that is not finite. The seeds,
//! and inputs that once failed, are in `corpus/`. `PINSPOT_FUZZ_RUNS` sets the runs of each reader, `PINSPOT_FUZZ_SEED` where
//! they start.

mod mutate;

use std::alloc::System;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};

use cap::Cap;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use pinspot::Settings;
use pinspot::image::RgbImage;
use pinspot::low_level::brdf::BrdfTable;
use pinspot::scene::{Light, Mesh, Scene, parse};

/// Half a GiB: a reader that allocates what a header declares ends here.
#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, 1 << 29);

/// Runs of each reader unless the environment says otherwise.
const RUNS: u64 = 500;

/// Every file of a format's corpus, then mutants of them.
fn fuzz(format: &str, words: &[&str], read: impl Fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus").join(format);
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let seeds: Vec<Vec<u8>> = files.iter().map(|file| std::fs::read(file).unwrap()).collect();
    assert!(!seeds.is_empty());
    for (file, seed) in files.iter().zip(&seeds) {
        run(&file.display().to_string(), seed, &read);
    }
    let number = |name: &str, default: u64| std::env::var(name).map_or(default, |text| text.parse().unwrap());
    let first = number("PINSPOT_FUZZ_SEED", 0);
    for k in first..first + number("PINSPOT_FUZZ_RUNS", RUNS) {
        let mutant = mutate::mutant(&seeds, words, &mut ChaCha8Rng::seed_from_u64(k));
        run(&format!("{format} {k}"), &mutant, &read);
    }
}

fn run(name: &str, bytes: &[u8], read: &impl Fn(&[u8])) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| read(bytes))) {
        eprintln!("{name} failed on b\"{}\"", bytes.escape_ascii());
        resume_unwind(panic);
    }
}

/// An error is one line.
fn check_message(error: &impl std::error::Error) {
    let message = error.to_string();
    assert!(!message.chars().any(char::is_control), "{message:?}");
}

fn check_mesh(mesh: &Mesh) {
    assert!(!mesh.triangles().is_empty() && mesh.area().is_finite());
    assert!(mesh.positions().iter().all(|p| p.is_finite()));
    assert!(mesh.normals().iter().all(|n| n.is_normalized()));
}

fn check_image(image: &RgbImage) {
    assert_eq!(image.pixels.len(), image.width * image.height);
    assert!(image.pixels.as_flattened().iter().all(|value| (0.0..=1e36).contains(value)));
}

fn check_scene(scene: &Scene) {
    for object in &scene.objects {
        check_mesh(&object.mesh_in_world());
        if let Some(receiver) = &object.receiver {
            assert!(receiver.albedo.is_finite());
        }
        if let Some(reflector) = &object.reflector {
            assert!(reflector.finish.reflectance.is_finite() && reflector.finish.roughness.is_finite());
        }
    }
    assert!(!scene.notes.iter().any(|note| note.chars().any(char::is_control)), "{:?}", scene.notes);
    let camera = &scene.camera;
    assert!([camera.position, camera.forward, camera.right, camera.up].iter().all(|v| v.is_finite()));
    assert!((scene.environment.intensity * scene.environment.rotation_rad).is_finite());
    match &scene.environment.light {
        Light::Map(map) => map.images().iter().for_each(|image| check_image(image)),
        Light::Spot { direction, radiance, .. } => assert!(direction.is_normalized() && radiance.is_finite()),
        Light::Constant(radiance) => assert!((*radiance * scene.environment.intensity).is_finite()),
        Light::BuiltInMap(_) => {}
    }
}

const OBJ_WORDS: [&str; 12] = [
    "\nf ",
    "\nv ",
    "\nvn ",
    "//",
    "/",
    "\\\n",
    "#",
    "\nusemtl a\n",
    "\nmtllib m.mtl\n",
    "-1 ",
    " 1 2 3 4 5",
    "\u{feff}",
];

#[test]
fn obj() {
    fuzz("obj", &OBJ_WORDS, |bytes| match Mesh::from_obj("mesh.obj", bytes, 0.7) {
        Ok((mesh, _)) => check_mesh(&mesh),
        Err(error) => check_message(&error),
    });
}

/// A scene with one object, whose mesh comes with materials.
fn scene_of(obj: &[u8], mtl: &[u8]) {
    let scene = r#"
        environment = { constant = [1, 1, 1] }
        camera = { position = [0, 5, 5], target = [0, 0, 0], perspective = { fov_y_deg = 40 } }
        object = [{ mesh = "mesh.obj" }]
    "#;
    let files: HashMap<PathBuf, &[u8]> = HashMap::from([("mesh.obj".into(), obj), ("m.mtl".into(), mtl)]);
    match parse::<Settings>("scene.toml", scene, &files) {
        Ok(loaded) => check_scene(&loaded.scene),
        Err(error) => check_message(&error),
    }
}

const MTL_WORDS: [&str; 16] = [
    "\nKd ",
    "\nKs ",
    "\nKe ",
    "\nNs ",
    "\nNi ",
    "\nPr ",
    "\nPm ",
    "\nillum ",
    "\nd ",
    "\nnewmtl b\n",
    "\nmap_Kd ",
    "spectral ",
    "xyz ",
    "#",
    "\\\n",
    " 1",
];

#[test]
fn mtl() {
    let obj = b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 3 2 1\n";
    fuzz("mtl", &MTL_WORDS, |bytes| scene_of(obj, bytes));
    let mtl = b"newmtl a\nKd 0.5\nnewmtl b\nKd 0.5\nPm 1\n";
    fuzz("obj", &OBJ_WORDS, |bytes| scene_of(bytes, mtl));
}

const TOML_WORDS: [&str; 14] = [
    "\n[[object]]\n",
    "\n[camera]\n",
    "\n[render]\n",
    "scale = ",
    "spot = {",
    "faces = [",
    "[[[[[[[[",
    "ggx = {",
    "{",
    "}",
    "]",
    "\"",
    "'''",
    "\\u001b",
];

#[test]
fn toml() {
    let hdr: &[u8] = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x80\x80\x80\x81";
    let obj: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let files: HashMap<PathBuf, &[u8]> = HashMap::from([("sky.hdr".into(), hdr), ("mesh.obj".into(), obj)]);
    fuzz("toml", &TOML_WORDS, |bytes| match parse::<Settings>("scene.toml", &String::from_utf8_lossy(bytes), &files) {
        Ok(loaded) => {
            check_scene(&loaded.scene);
            // Whatever the options say, they are accepted or refused.
            let _ = loaded.render.options();
        }
        Err(error) => check_message(&error),
    });
}

fn decode(name: &str, bytes: &[u8]) {
    match RgbImage::decode(name, bytes) {
        Ok((image, notes)) => {
            check_image(&image);
            assert!(!notes.iter().any(|note| note.chars().any(char::is_control)), "{notes:?}");
        }
        Err(error) => check_message(&error),
    }
}

#[test]
fn exr() {
    fuzz("exr", &[], |bytes| decode("sky.exr", bytes));
}

#[test]
fn hdr() {
    let words = [
        "EXPOSURE=2\n",
        "COLORCORR=1 2 3\n",
        "PRIMARIES=",
        "\n-Y 4 +X 8\n",
        "\n+X 4 -Y 8\n",
        "\x01\x01\x01\x01",
        "\x02\x02",
        "\n\n",
    ];
    fuzz("hdr", &words, |bytes| decode("sky.hdr", bytes));
}

/// Tables are 35 MB: a mutant's first bytes are laid over a full one every so often, else it stands for itself.
#[test]
fn merl() {
    let sizes = [90i32, 90, 180].map(i32::to_le_bytes);
    let full = [sizes.as_flattened(), &vec![0; 3 * 8 * 90 * 90 * 180]].concat();
    let read = |bytes: &[u8]| match BrdfTable::decode("table.binary", bytes) {
        Ok(table) => assert!(table.entries().as_flattened().iter().all(|value| (0.0..=1e6).contains(value))),
        Err(error) => check_message(&error),
    };
    let runs = std::cell::Cell::new(0);
    fuzz("merl", &[], |bytes| {
        read(bytes);
        runs.set(runs.get() + 1);
        if runs.get() % 250 == 1 {
            let mut table = full.clone();
            table[..bytes.len()].copy_from_slice(bytes);
            read(&table);
        }
    });
}
