//! Frames of animations.

use crate::workplace::{SCENE, Workplace};

#[test]
fn frames_are_numbered_and_an_interrupted_sequence_goes_on() {
    let place = Workplace::new();
    let moving = "[[animation]]\nobject = \"ring\"\ntranslate = [[0.0, [0, 0, 0]], [1.0, [0.5, 0, 0]]]\n";
    place.write("moving.toml", format!("{SCENE}{moving}"));
    let render = |more: &[&str]| place.run(&[&["render", "moving.toml", "--backend", "cpu"], more].concat());
    let frames = &["--frames", "0..3", "--fps", "2", "-o", "f-##.png", "f-##.exr"];
    let output = render(frames);
    assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
    let bytes = |name: &str| std::fs::read(place.path(name)).unwrap();
    let first: Vec<Vec<u8>> = (0..3).map(|k| bytes(&format!("f-0{k}.png"))).collect();
    assert!(first[0] != first[1] && first[1] != first[2], "it moves");
    std::fs::remove_file(place.path("f-01.exr")).unwrap();
    let said = String::from_utf8(render(frames).stderr).unwrap();
    assert!(said.contains("1 frames rendered, 2 were there already"), "{said}");
    assert_eq!((0..3).map(|k| bytes(&format!("f-0{k}.png"))).collect::<Vec<_>>(), first);
    let json = render(&[&frames[..], &["--json"]].concat()).stdout;
    let report: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!((&report["kept"], &report["rendered"]), (&3.into(), &0.into()));
    let said =
        String::from_utf8(render(&["--frames", "0..3", "--fps", "4", "-o", "f-##.png", "f-##.exr"]).stderr).unwrap();
    assert!(said.contains("2 frames rendered, 1 were there already"), "other moments but the first: {said}");
    assert!(render(&["--frames", "0..2", "-o", "all.apng"]).succeeded());
    assert!(bytes("all.apng").windows(4).any(|chunk| chunk == b"fcTL"));
    let still = place.run(&["render", "scene.toml", "--backend", "cpu", "--frames", "0..1", "-o", "still-#.png"]);
    let still = String::from_utf8(still.stderr).unwrap();
    assert!(still.contains("nothing moves in scene 'scene'"), "{still}");
}

#[test]
fn frames_that_cannot_be_are_refused_before_the_work() {
    let place = Workplace::new();
    let code = |args: &[&str]| place.run(&[&["render", "scene.toml"], args].concat()).code;
    for frames in ["3", "3..3", "5..2", "x..2", "-1..2"] {
        assert_eq!(code(&["--frames", frames, "-o", "f-#.png"]), 2, "{frames}");
    }
    assert_eq!(code(&["--fps", "10", "-o", "f.png"]), 2, "--fps without --frames");
    assert_eq!(code(&["--frames", "0..2", "--seconds", "1", "-o", "f-#.png"]), 2);
    for (output, expected) in [
        ("f.png", "one file for many frames"),
        ("f-#.apng", "without '#'"),
        ("no/f-#.png", "/no' does not exist"),
        ("f-#.txt", "ends in .png or .exr or .apng"),
    ] {
        let output = place.run(&["render", "scene.toml", "--frames", "0..2", "-o", output]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.code == 1 && said.contains(expected), "{said}");
    }
}
