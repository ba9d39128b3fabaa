//! Bad input: an exit code and one clear line, before any work.

use crate::workplace::{Workplace, exr};

#[test]
fn missing_scenes_are_named_with_the_nearest_built_in_one() {
    let place = Workplace::new();
    place.refuses(&["render", "ring-naturel", "-o", "out.png"], &["'ring-naturel'", "did you mean 'ring-natural'"]);
    place.refuses(&["render", "no/such.toml", "-o", "out.png"], &["no/such.toml", "pinspot scenes"]);
}

#[test]
fn scene_files_with_mistakes_are_refused_with_line_and_key() {
    let place = Workplace::new();
    place.replace("samples = 60", "sampels = 60");
    place.refuses_scene(&["scene.toml:11:", "'sampels'", "'samples'"]);
    place.replace("target = [0.0, 0.0, 0.0]", "target = [0.0, 0.0");
    place.refuses_scene(&["scene.toml:"]);
    place.replace("samples = 60", "samples = 0");
    place.refuses_scene(&["scene", "samples is 0", "from 1 to"]);
    place.replace("size = [24, 16]", "size = [0, 16]");
    place.refuses_scene(&["size is 0×16", "1×1"]);
    place.replace("samples = 60", "taps = 0");
    place.refuses_scene(&["taps is 0", "from 1 to 64"]);
    place.replace("samples = 60", "visibility = \"half\"");
    place.refuses_scene(&["half", "none", "full"]);
    place.replace("samples = 60", "epsilon = -1.0");
    place.refuses_scene(&["epsilon is -1"]);
    place.replace("reflector = { sides = \"both\" }", "");
    place.refuses_scene(&["neither reflector nor refractor"]);
}

#[test]
fn unusable_meshes_are_named_with_the_reason() {
    let place = Workplace::new();
    for (mesh, reason) in [
        ("", "is empty"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "1 degenerate"),
        ("v 0 0 0\nv NaN 0 0\nv 0 1 0\nf 2 1 3\n", "ring.obj:2:"),
        ("v 0 0 0\nv 1 0 0\nf 1 2 3\n", "names vertex 3"),
        ("\u{0}\u{1}binary", "ring.obj"),
    ] {
        place.write("ring.obj", mesh);
        place.refuses_scene(&["ring.obj", reason]);
    }
    std::fs::remove_file(place.path("ring.obj")).unwrap();
    place.refuses_scene(&["ring.obj", "check the path"]);
    place.replace("ring.obj", "ring.gltf");
    place.refuses_scene(&["ring.gltf", "export it as Wavefront OBJ"]);
}

#[test]
fn unusable_environment_maps_are_named_with_the_reason() {
    let place = Workplace::new();
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"light.exr\"");
    place.refuses_scene(&["light.exr", "check the path"]);
    place.write("light.exr", "not an image");
    place.refuses_scene(&["light.exr", "damaged"]);
    exr(&place.path("light.exr"), 32, 16, 1.0);
    let whole = std::fs::read(place.path("light.exr")).unwrap();
    place.write("light.exr", &whole[..whole.len() / 2]);
    place.refuses_scene(&["light.exr", "damaged"]);
    exr(&place.path("light.exr"), 32, 16, f32::NAN);
    place.refuses_scene(&["light.exr", "pixel (0, 0)", "not a finite number"]);
    exr(&place.path("light.exr"), 30, 11, 1.0);
    place.refuses_scene(&["light.exr", "30×11", "2:1"]);
    place.write("light.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 0\n");
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"light.hdr\"");
    place.refuses_scene(&["light.hdr"]);
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"light.jpg\"");
    place.refuses_scene(&["light.jpg", "convert it to .exr or .hdr"]);
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"forrest\"");
    place.refuses_scene(&["'forrest'", "forest"]);
    place.replace(
        "constant = [1.0, 1.0, 1.0]",
        "spot = { direction = [0.0, 1.0, 0.0], sigma_rad = 0.0002, radiance = [1.0, 1.0, 1.0] }",
    );
    place.refuses_scene(&["4096", "wider spot"]);
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let place = Workplace::new();
    place.refuses(&["render", "scene.toml", "-o", "out.jpg"], &["out.jpg", ".png or .exr"]);
    place.refuses(&["render", "scene.toml", "-o", "no/folder/a.png"], &["no/folder", "create it first"]);
    place.refuses(&["samples", "ring", "-o", "out.txt"], &["out.txt", ".ply"]);
    std::fs::create_dir(place.path("folder.png")).unwrap();
    place.refuses(&["render", "scene.toml", "-o", "folder.png", "--backend", "cpu"], &["folder.png", "it is a folder"]);
}

#[test]
fn back_ends_that_are_not_there_are_refused() {
    let place = Workplace::new();
    place.refuses(&["render", "scene.toml", "-o", "out.exr", "--adapter", "voodoo"], &["voodoo", "found:"]);
    place.refuses(
        &["render", "scene.toml", "-o", "out.exr", "--filter", "hardware", "--backend", "cpu"],
        &["hardware needs a GPU"],
    );
    place.refuses_command_line(
        &["render", "scene.toml", "-o", "out.exr", "--size", "40000x2"],
        &["size is 40000×2", "16384"],
    );
}

#[test]
fn nothing_is_asked_for_in_vain() {
    let place = Workplace::new();
    let refuses = |more: &[&str], part: &str| place.refuses(&[&["render", "scene.toml"], more].concat(), &[part]);
    refuses(&["-o", "out.exr", "--overlay", "samples"], "--overlay is drawn");
    refuses(&["-o", "out.png", "--aov", "caustic", "--overlay", "samples"], "--overlay is drawn");
    refuses(&["-o", "out.exr", "--aov", "caustic", "--plain-diffuse"], "--plain-diffuse changes the beauty only");
    refuses(&["-o", "out.exr", "--aov", "caustic", "--caustic-gain", "2"], "--caustic-gain changes the beauty only");
    refuses(&["-o", "out.png", "--aov", "caustic,depth"], "give an .exr");
    place.refuses_command_line(
        &["render", "scene.toml", "-o", "out.exr", "--aov", "caustic,caustic"],
        &["aov is caustic twice", "each once"],
    );
    refuses(&["-o", "out.exr", "--exposure", "1"], "--exposure changes what is displayed");
    refuses(&["-o", "out.exr", "--evaluation", "flat", "--tolerance", "0.1"], "--tolerance is that of a hierarchy");
    refuses(&["-o", "out.exr", "--filter", "none", "--taps", "2"], "--taps are those of a filter");
    place.replace("constant = [1.0, 1.0, 1.0]", "constant = [1.0, 1.0, 1.0]\nlayout = \"latlong\"");
    place.refuses_scene(&["scene.toml:4:", "environment.layout"]);
    place.replace(
        "shape = { plane = { size = [3.0, 3.0] } }",
        "shape = { plane = { size = [3.0, 3.0] } }\ncrease_angle_deg = 3.0",
    );
    place.refuses_scene(&["object 'table'.crease_angle_deg", "exact normals"]);
    place.replace("samples = 60", "epsilon = true");
    place.refuses_scene(&["scene.toml:11:", "a number or a word"]);
}

#[test]
fn wrong_command_lines_exit_with_two() {
    let place = Workplace::new();
    for args in [
        &["render"][..],
        &["rendr", "ring"],
        &["render", "ring", "-o", "a.png", "--leaves", "many"],
        &["render", "ring", "-o", "a.png", "--evaluation", "deep"],
        &["render", "ring", "-o", "a.png", "--filter", "bicubic"],
        &["render", "ring", "-o", "a.png", "--strategy", "hexagonal"],
        &["render", "ring", "-o", "a.png", "--visibility", "half"],
        &["reference", "ring", "-o", "a.exr", "--samples", "10"],
        &["compare", "ring", "-o", "a", "--figure", "6"],
        &["compare", "ring", "-o", "a", "--figure", "4", "--samples", "10"],
        &["render", "ring", "-o", "a.png", "--size", "512x"],
        &["render", "ring", "-o", "a.png", "--samples", "10q"],
        &["render", "ring", "-o", "a.png", "--cube-size", "100"],
        &["render", "scene.toml", "-o", "a.png", "--adapter", "voodoo", "--backend", "cpu"],
        &["view", "--frames", "1..2"],
        &["reference", "ring", "-o", "a.exr", "--rel-error", "0"],
        &["reference", "ring", "-o", "a.exr", "--seconds=-1"],
        &["reference", "ring", "-o", "a.exr", "--seconds", "NaN"],
        &["compare", "ring", "-o", "a", "--seconds", "0"],
    ] {
        let output = place.run(args);
        assert_eq!(output.code, 2, "{args:?}");
        assert!(!output.stderr.is_empty());
    }
}

/// Refused at once: each of these would otherwise compute a reference that is never good enough, or samples by the million.
#[test]
fn what_cannot_be_is_refused_before_the_work() {
    let place = Workplace::new();
    place.write("a.exr", "old");
    place.write("a.png", "old");
    place.write("a.ply", "old");
    for name in ["a.exr", "a.png", "a.ply"] {
        let mut permissions = std::fs::metadata(place.path(name)).unwrap().permissions();
        permissions.set_readonly(true);
        std::fs::set_permissions(place.path(name), permissions).unwrap();
    }
    std::fs::create_dir(place.path("f.exr")).unwrap();
    let endless = ["--rel-error", "1e-9", "--quiet"];
    let many = ["--samples", "1000000", "--quiet"];
    let reference = |output| [&["reference", "scene.toml", "-o", output][..], &endless].concat();
    place.refuses(&reference("a.exr"), &["a.exr", "read-only"]);
    place.refuses(&reference("f.exr"), &["f.exr", "it is a folder"]);
    place.refuses(&[&["render", "scene.toml", "-o", "b.exr", "a.png"][..], &many].concat(), &["a.png", "read-only"]);
    place.refuses(&[&["samples", "ring", "-o", "a.ply"][..], &many].concat(), &["a.ply", "read-only"]);
    assert_eq!(std::fs::read(place.path("a.exr")).unwrap(), b"old");
    std::fs::create_dir_all(place.path("report/report.html")).unwrap();
    let compare = |more: &[&str], part| {
        place.refuses(&[&["compare", "scene.toml", "-o", "report"][..], more, &endless].concat(), &[part]);
    };
    compare(&[], "report.html");
    std::fs::remove_dir_all(place.path("report")).unwrap();
    for more in [["hierarchical", "--filters", "none"], ["flat,hierarchical", "--footprints", "curvature"]] {
        let words = [&["compare", "scene.toml", "-o", "report", "--evaluations"][..], &more, &endless].concat();
        place.refuses_command_line(&words, &["evaluation hierarchical"]);
    }
    compare(&["--filters", "none,hardware", "--backend", "cpu"], "no hardware filter");
}
