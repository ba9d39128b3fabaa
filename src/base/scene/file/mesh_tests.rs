//! Meshes of scene files: their materials, where they lie, and models by themselves.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::Vec3;

use super::tests::{GOOD, Render};
use super::{load as load_scene, parse};
use crate::scene::{Interfaces, Mesh, Scene, Sides};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// A scene with a mesh and its library, in memory.
fn with_mesh(keys: &str, obj: &[u8], mtl: &str, rest: &str) -> Result<Scene, String> {
    let mesh = GOOD.replace(
        "shape = { plane = { size = [3.0, 3.0] } }\nreceiver = { albedo = [0.5, 0.5, 0.5] }",
        &format!("mesh = \"mesh.obj\"\n{keys}"),
    );
    let files =
        HashMap::from([(PathBuf::from("mesh.obj"), obj.to_vec()), (PathBuf::from("a.mtl"), mtl.as_bytes().to_vec())]);
    let loaded = parse::<Render>("scene.toml", &format!("{mesh}{rest}"), &files);
    loaded.map(|loaded| loaded.scene).map_err(|error| error.to_string())
}

#[test]
fn mirrors_of_materials_have_two_sides_unless_they_are_told() {
    let obj = format!("mtllib a.mtl\n{TRIANGLE}usemtl steel\nf 1 2 3\n");
    let mtl = "newmtl steel\nKs .9 .9 .9\nKd 0 0 0\nillum 3\n";
    let sides =
        |keys: &str| with_mesh(keys, obj.as_bytes(), mtl, "").map(|scene| scene.objects[1].reflector.unwrap().sides);
    assert_eq!(sides(""), Ok(Sides::Both));
    assert_eq!(sides("sides = \"back\""), Ok(Sides::Back));
    let message = sides("reflector = {}\nsides = \"back\"").unwrap_err();
    assert!(message.contains("object 'table'.sides: is for the mirrors among"), "{message}");
}

#[test]
fn libraries_may_be_missing_beside_others_and_files_may_be_utf_16() {
    let text = format!("mtllib missing.mtl a.mtl\n{TRIANGLE}usemtl paper\nf 1 2 3\n");
    let mtl = "newmtl paper\nKd .5 .5 .5\nmap_Kd paper.png\n";
    let utf_16: Vec<u8> = [0xfeff].into_iter().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    for obj in [text.as_bytes(), &utf_16] {
        let scene = with_mesh("", obj, mtl, "").unwrap();
        assert_eq!(scene.objects[1].receiver.as_ref().unwrap().albedo, Vec3::splat(0.5));
        let notes = scene.notes.join("\n");
        assert!(notes.contains("no material library 'missing.mtl'"), "{notes}");
        assert!(notes.contains("a.mtl: material 'paper': map_Kd has no effect"), "{notes}");
    }
    let message =
        with_mesh("", format!("mtllib none.mtl other.mtl\n{TRIANGLE}f 1 2 3\n").as_bytes(), "", "").unwrap_err();
    assert!(message.contains("cannot read the material library"), "{message}");
}

#[test]
fn glass_of_materials_is_closed_or_a_surface() {
    let mtl = "newmtl glass\nNi 1.5\nillum 7\n";
    let open = format!("mtllib a.mtl\n{TRIANGLE}usemtl glass\nf 1 2 3\n");
    let solid = format!("mtllib a.mtl\n{TRIANGLE}v 0 0 1\nusemtl glass\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
    for (obj, interfaces) in [(open, Interfaces::One), (solid, Interfaces::Two)] {
        let scene = with_mesh("", obj.as_bytes(), mtl, "").unwrap();
        let refractor = scene.objects[1].refractor.unwrap();
        assert_eq!((refractor.interfaces, refractor.eta.x), (interfaces, 1.5));
    }
}

/// Small solids are closed wherever they are: rounding where they are placed does not open their seams.
#[test]
fn small_solids_far_from_the_origin_are_closed() {
    for shape in ["sphere = { radius = 0.05 }", "solid-ring = { radius = 0.05, height = 0.03, thickness = 0.01 }"] {
        for translate in ["[10, 1, 10]", "[-300, 0.1, 7]"] {
            let ball = format!(
                "{GOOD}[[object]]\nshape = {{ {shape} }}\ntranslate = {translate}\nrotate_deg = [10, 20, 30]\n\
                 refractor = {{ eta = 1.5, interfaces = 2 }}\n"
            );
            let scene = parse::<Render>("scene.toml", &ball, Path::new("."));
            assert!(scene.is_ok(), "{shape} {translate}: {}", scene.unwrap_err());
        }
    }
}

#[test]
fn models_stand_on_a_table() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("My Model.OBJ");
    std::fs::write(&path, "v 4 2 0\nv 6 2 0\nv 4 2 1\nv 4 3 0\nf 1 2 4\nf 1 2 3\n").unwrap();
    let load = |path: &Path| load_scene::<Render>(path.to_str().unwrap()).map(|loaded| loaded.scene);
    let scene = load(&path).unwrap();
    assert_eq!(scene.objects.len(), 2);
    assert!(scene.objects[0].reflector.is_some() && scene.objects[1].receiver.is_some());
    let mesh = scene.objects[0].mesh_in_world();
    let low = mesh.positions().iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
    assert!(low.abs_diff_eq(Vec3::new(-1.0, 0.002, -0.5), 1e-5), "{low}");
    let message = load(&dir.path().join("none.obj")).unwrap_err().to_string();
    assert!(message.contains("cannot read mesh") && message.contains("none.obj"), "{message}");
    let message = load(&dir.path().join("ball.glb")).unwrap_err().to_string();
    assert!(message.contains("ball.glb") && message.contains("the format '.glb' is not read yet"), "{message}");
}

/// Geographic coordinates, which 32-bit numbers round to half a metre.
#[test]
fn places_far_from_the_origin_keep_their_millimetres() {
    let corner = |x: f64, z: f64| format!("v {} 0 {}\n", 691_618.12 + x, -5_334_760.45 + z);
    let obj = format!("{}{}{}f 1 2 3\n", corner(0.0, 0.0), corner(1.25, 0.0), corner(0.0, 0.75));
    let keys = |more: &str| format!("translate = [-691608.12, 0.0, 5334760.45]\nreceiver = {{}}\n{more}");
    let scene = with_mesh(&keys(""), obj.as_bytes(), "", "").unwrap();
    let mesh = scene.objects[1].mesh_in_world();
    for (place, expected) in mesh.positions().iter().zip([[10.0, 0.0], [11.25, 0.0], [10.0, 0.75]]) {
        let expected = Vec3::new(expected[0], 0.0, expected[1]);
        assert!(place.abs_diff_eq(expected, 2e-6), "{place} {expected}");
    }
    let turned = with_mesh(&keys("rotate_deg = [0, 90, 0]"), obj.as_bytes(), "", "").unwrap();
    // A quarter turn about the origin: (x, z) becomes (z, −x).
    let first = turned.objects[1].mesh_in_world().positions()[0];
    let expected = Vec3::new(-691_608.1 - 5_334_760.5, 0.0, 5_334_760.5 - 691_618.1);
    assert!(first.abs_diff_eq(expected, 1.0), "{first} {expected}");
    let moving = "[[animation]]\nobject = \"table\"\ntranslate = [[0, [0, 0, 0]], [1, [1, 0, 0]]]\n";
    assert!(with_mesh(&keys(""), obj.as_bytes(), "", moving).unwrap_err().contains("cannot move"));
    let (mesh, _) = Mesh::from_obj("utm.obj", obj.as_bytes(), 0.5).unwrap();
    assert!(mesh.positions()[1].abs_diff_eq(Vec3::new(691_619.4, 0.0, -5_334_760.5), 0.5));
}

#[test]
fn a_mesh_without_a_surface_of_its_own_takes_its_materials() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("two.mtl", "newmtl wood\nKd 0.5 0.3 0.1\nnewmtl steel\nKd 0.8 0.8 0.8\nPm 1\nPr 0.2\n");
    let faces =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl wood\nf 1 2 3\nusemtl steel\nf 1 2 4\nusemtl wood\nf 2 3 4\n";
    write("two.obj", &format!("mtllib two.mtl\n{faces}"));
    let mesh = GOOD.replace(
        "shape = { plane = { size = [3.0, 3.0] } }\nreceiver = { albedo = [0.5, 0.5, 0.5] }",
        "mesh = \"two.obj\"",
    );
    let load = || parse::<Render>("scene.toml", &mesh, dir.path());
    let scene = load().unwrap().scene;
    let names: Vec<&str> = scene.objects.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["ring", "table/wood", "table/steel"]);
    assert_eq!(scene.objects[1].mesh.triangles().len(), 2);
    assert!(scene.objects[1].receiver.is_some() && scene.objects[1].reflector.is_none());
    assert!(scene.objects[2].reflector.is_some());
    assert!(scene.notes.is_empty(), "{:?}", scene.notes);
    write("two.obj", faces);
    let scene = load().unwrap().scene;
    assert!(scene.objects[1..].iter().all(|o| o.receiver.is_none() && o.reflector.is_none()));
    assert!(scene.notes[0].contains("two.obj: its faces name 2 materials, but it names no material library"));
    write("two.obj", &format!("mtllib two.mtl\n{faces}"));
    write("two.mtl", "newmtl wood\nKd -5 0.3 0.1\n");
    let refused = || load().unwrap_err().to_string();
    assert!(refused().contains("two.mtl:2: Kd of material 'wood'"), "{}", refused());
    write("two.mtl", "newmtl wood\nKd 0.5\n");
    assert!(refused().contains("two.obj:8: there is no material 'steel' in "), "{}", refused());
    std::fs::remove_file(dir.path().join("two.mtl")).unwrap();
    assert!(refused().contains("two.obj:1: cannot read the material library 'two.mtl'"), "{}", refused());
}
