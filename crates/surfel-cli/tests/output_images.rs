//! Images that commands write: JPEG, one image per input, stdin, and the default image of `surfel FILE`.

use crate::common;

use common::{Folder, ball, cube, points, scene};

#[test]
fn jpeg_shows_what_the_png_shows() {
    let f = Folder::new("jpeg");
    f.write("a.ply", ball());
    f.run("a.ply -o a.png --size 64x48").code(0);
    for name in ["a.jpg", "b.JPEG"] {
        let said = f.run(&format!("a.ply -o {name} --size 64x48")).code(0).stderr();
        assert!(!said.contains("JPEG"), "an opaque image needs no words: {said}");
        assert!(f.read(name).starts_with(&[0xff, 0xd8, 0xff]));
        // Quality 92, in linear light.
        f.run(&format!("compare a.png {name} --fail-above rmse=0.02")).code(0);
    }
    // Blended onto the background's colour, regardless of the background's alpha.
    for (background, opaque) in [("transparent", "0,0,0"), ("0.25,0.5,1,0.5", "0.25,0.5,1")] {
        let said = f.run(&format!("a.ply -o t.jpg --size 64x48 --force --background {background}")).code(0).stderr();
        assert!(said.contains("t.jpg: a JPEG has no transparency") && said.contains(opaque), "{said}");
        f.run(&format!("a.ply -o o.jpg --size 64x48 --force --background {opaque}")).code(0);
        f.run("compare o.jpg t.jpg --fail-above max_abs=0.02").code(0);
    }
    f.run("a.ply -o a.jpg --size 64x48").fails(1, "--force");
}

#[test]
fn each_input_gets_an_image_and_one_that_fails_stops_no_other() {
    let f = Folder::new("each");
    f.write("a.ply", ball());
    f.write("bad.ply", "ply\nnonsense");
    f.write("b.obj", cube());
    f.write("s.json", scene(""));
    f.run("convert b.obj --splats 400 -o b.ply").code(0);
    let run = f.run("a.ply bad.ply b.ply nowhere.xyz s.json -o o-{input}.png --size 16x16").code(3);
    let said = run.stderr();
    let errors: Vec<&str> = said.lines().filter(|l| l.starts_with("error: ")).collect();
    assert!(errors.len() == 3 && errors[0].contains("bad.ply") && errors[1].contains("nowhere.xyz"), "{said}");
    assert!(errors[2].contains("2 of 5 images failed"), "{said}");
    assert!(f.has("o-a.png") && f.has("o-b.png") && f.has("o-s.png") && !f.has("o-bad.png"));
    // Each image equals the one drawn alone.
    f.run("b.ply -o alone.png --size 16x16").code(0);
    assert_eq!(f.read("alone.png"), f.read("o-b.png"));
    // The exit code is that of the first failure: existing files, then the damaged one. Missing images are drawn.
    std::fs::remove_file(f.path().join("o-b.png")).unwrap();
    let said = f.run("a.ply b.ply bad.ply -o o-{input}.png --size 16x16").code(1).stderr();
    assert!(said.contains("o-a.png: already exists") && f.has("o-b.png"), "{said}");
    // Without {input} all inputs form one scene.
    f.run("a.ply b.ply -o both.png --size 16x16").code(0);
    assert_ne!(f.image("both.png").color, f.image("o-a.png").color);
    let stats = f.run("a.ply b.ply -o o-{input}.png --size 16x16 --force --stats").code(0).json();
    assert_eq!((&stats[0]["input"], &stats[1]["input"]), (&"a.ply".into(), &"b.ply".into()));
    assert_eq!(stats[0]["splats"], 200);
}

#[test]
fn two_inputs_of_one_name_are_refused_before_anything_is_drawn() {
    let f = Folder::new("clash");
    std::fs::create_dir_all(f.path().join("sub")).unwrap();
    f.write("a.ply", ball());
    f.write("sub/a.ply", ball());
    f.run("a.ply sub/a.ply -o {input}.png --size 8x8").fails(2, "a.png");
    f.run("a.ply sub/a.ply -o {input}.png --print-scene").fails(2, "--print-scene");
    assert_eq!(f.names(), ["a.ply", "sub"]);
}

#[test]
fn stdin_is_an_input_of_any_format() {
    let f = Folder::new("pipe");
    f.write("a.ply", ball());
    for (name, content, flags) in [("b.obj", cube(), "--splats 400"), ("p.xyz", points(), ""), ("a.ply", ball(), "")] {
        f.write(name, &content);
        f.run(&format!("{name} {flags} -o file.exr --size 24x24 --force")).code(0);
        f.run_in("", &format!("- {flags} -o pipe.exr --size 24x24 --force"), content.as_bytes()).code(0);
        assert_eq!(f.image("file.exr").color, f.image("pipe.exr").color, "{name}");
        let info = f.run_in("", "info - --json", content.as_bytes()).code(0).json();
        assert_eq!(info["file_bytes"], content.len());
        f.run(&format!("convert {name} {flags} -o file.ply --force")).code(0);
        f.run_in("", &format!("convert - {flags} -o pipe.ply --force"), content.as_bytes()).code(0);
        assert_eq!(f.read("file.ply"), f.read("pipe.ply"), "{name}");
    }
    // A scene file's paths are then relative to the current folder.
    f.write("s.json", scene("\"shader\": \"normal\""));
    f.run("s.json -o s.png").code(0);
    f.run_in("", "- -o t.png", scene("\"shader\": \"normal\"").as_bytes()).code(0);
    assert_eq!(f.image("s.png").color, f.image("t.png").color);
    f.run_in("", "- -o {input}.png --size 8x8", ball().as_bytes()).code(0);
    assert!(f.has("stdin.png"));
    // Beside other inputs, and in a scene file.
    f.run_in("", "- b.obj -o both.png --size 8x8 --splats 400", ball().as_bytes()).code(0);
    f.write("dash.json", scene("").replace("a.ply", "-"));
    f.run_in("", "dash.json -o dash.png --size 8x8", ball().as_bytes()).code(0);
    f.run_in("", "- -o x.png", b"").fails(3, "stdin: is empty");
    f.run_in("", "- -o x.png", b"\xfe\xfe\xfe\xfe").fails(3, "stdin");
    f.run_in("", "- -o x.png", b"{\"camera\": 1}").fails(3, "stdin");
    assert!(!f.has("x.png"));
}

#[test]
fn file_alone_is_drawn_to_its_name_in_the_current_folder() {
    let f = Folder::new("alone");
    std::fs::create_dir_all(f.path().join("here")).unwrap();
    f.write("a.ply", ball());
    let said = f.run_in("here", "../a.ply --size 16x16", b"").code(0).stderr();
    assert!(said.contains("note: wrote a.png"), "{said}");
    f.run("a.ply -o b.png --size 16x16").code(0);
    assert_eq!(f.image("here/a.png").color, f.image("b.png").color);
    assert!(!f.has("a.png"), "beside the input instead of the current folder");
    // An existing file is replaced only with --force.
    f.write("here/a.png", "mine");
    f.run_in("here", "../a.ply --size 16x16", b"").fails(1, "--force");
    assert_eq!(f.read("here/a.png"), b"mine");
    f.run_in("here", "../a.ply --size 16x16 --force -q", b"").code(0);
    assert!(f.read("here/a.png").starts_with(b"\x89PNG"));
    f.run_in("here", "- --size 16x16", ball().as_bytes()).code(0);
    assert!(f.has("here/stdin.png"));
    // Commands that print something draw only with -o.
    f.run_in("here", "../a.ply --size 16x16 --stats", b"").code(0);
    f.run("a.ply --print-scene").code(0);
    assert!(!f.has("a.png"));
}
