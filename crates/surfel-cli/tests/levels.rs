//! Levels of detail for points: writing COPC, and drawing what a view needs.

use crate::common;

use common::{Folder, las_at};

fn las(side: u32) -> Vec<u8> {
    las_at(side, 0)
}

/// Parses two sizes in MiB from the notes of a run: the data read, and the whole file.
fn read_mib(notes: &str) -> [f64; 2] {
    let line = notes.lines().find(|line| line.contains("drawn by levels")).unwrap_or_else(|| panic!("{notes}"));
    let words: Vec<&str> = line.split_whitespace().collect();
    let at = words.iter().position(|word| *word == "MiB").unwrap();
    [words[at - 3].parse().unwrap(), words[at - 1].parse().unwrap()]
}

#[test]
fn view_of_a_large_file_reads_what_it_needs_and_looks_like_all_of_it() {
    let folder = Folder::new("levels");
    folder.write("in.las", las(600));
    folder.run("convert in.las -o out.copc.laz").code(0);
    assert_eq!(folder.names(), ["in.las", "out.copc.laz"]);
    let far = "--size 160x120 --eye 600030,4999930,190 --target 600030,5000030,100 --fov-y 40 --no-metadata";
    let near = "--size 160x120 --eye 600030,5000010,112 --target 600030,5000030,100 --fov-y 40 --no-metadata";
    for (name, view, most) in [("far", far, 0.5), ("near", near, 0.95)] {
        folder.run(&format!("render out.copc.laz {view} --all-levels -o {name}-all.png")).code(0);
        let notes = folder.run(&format!("render out.copc.laz {view} -o {name}.png")).code(0).stderr();
        let [read, all] = read_mib(&notes);
        assert!(read < most * all, "{name}: {read} of {all} MiB");
        // Largest difference between an image with levels of detail at 1 px and one of all points.
        folder.run(&format!("compare {name}-all.png {name}.png --fail-above flip=0.02")).code(0);
        // Coarser levels are fewer bytes, and still cover what all points cover.
        let coarse = folder.run(&format!("render out.copc.laz {view} --lod-error 4 -o {name}-4.png")).code(0).stderr();
        assert!(read_mib(&coarse)[0] < read, "{coarse}");
        let alpha = |image: &str| -> Vec<f32> { folder.image(image).color.unwrap().iter().map(|c| c[3]).collect() };
        let (whole, levels) = (alpha(&format!("{name}-all.png")), alpha(&format!("{name}-4.png")));
        let inside =
            |i: usize| [0, 1, 2, 159, 160, 161, 320].iter().all(|d| whole.get(i + d).is_none_or(|a| *a == 1.0));
        let holes = (320..whole.len() - 480).filter(|i| inside(*i) && levels[*i] < 0.99).count();
        assert_eq!(holes, 0, "{name}");
    }
    let limited = folder.run(&format!("render out.copc.laz {near} --max-points 60000 -o few.png")).code(0).stderr();
    assert!(limited.contains("--max-points ends it at"), "{limited}");
}

#[test]
fn camera_is_the_same_for_a_part_of_the_levels_and_for_all() {
    let folder = Folder::new("levels-camera");
    folder.write("in.las", las(600));
    folder.run("convert in.las -o out.copc.laz").code(0);
    let camera = |flags: &str| {
        let printed = folder.run(&format!("render {flags} --size 160x120 --print-scene")).code(0).json();
        let camera = &printed["camera"];
        let place = |key: &str| [0, 1, 2].map(|k| camera[key][k].as_f64().unwrap());
        (place("eye"), place("target"))
    };
    assert_eq!(camera("out.copc.laz --lod-error 3"), camera("out.copc.laz --all-levels"));
    // The coarsest levels have at most 100,000 points, and with the next level more, on 60 m × 60 m, so points are at
    // most 0.38 m apart. Each end of the covered area is off by half of that, which moves the eye by the same fraction
    // of its distance.
    let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let (levels, points) = (camera("out.copc.laz --view iso"), camera("in.las --view iso"));
    let (off, away) = (apart(levels.0, points.0), apart(points.0, points.1));
    assert!(off < 0.38 / 60.0 * away, "{off} of {away}");
    for (name, flags) in [("some", ""), ("all", "--all-levels")] {
        let iso = format!("{flags} --view iso --size 160x120 --no-metadata");
        folder.run(&format!("render out.copc.laz {iso} -o {name}.png")).code(0);
    }
    folder.run("compare all.png some.png --fail-above flip=0.02").code(0);
}

#[test]
fn rows_and_tiles_are_those_of_all_whatever_levels_are_read() {
    let folder = Folder::new("levels-rows");
    folder.write("in.las", las(400));
    folder.run("convert in.las -o out.copc.laz").code(0);
    let view = "out.copc.laz --size 96x80 --eye 600020,4999980,140 --target 600020,5000020,100 --no-metadata";
    let loaded = surfel_io::load(&folder.path().join("out.copc.laz"), &Default::default()).unwrap();
    let surfel_io::Content::Points(points) = loaded.content else { panic!("no points") };
    // Points that are left out before, by place or by step, don't count as rows.
    let left_out = ["--lod-error 3 --every 2", "--all-levels --crop 600010,4999990,0,600030,5000030,200"];
    for flags in ["--lod-error 3", "--all-levels"].into_iter().chain(left_out) {
        let notes = folder.run(&format!("{view} --planes index,position -o a.exr --force {flags}")).code(0).stderr();
        assert_eq!(notes.contains("drawn by levels"), !flags.contains("--all-levels"), "{notes}");
        let image = folder.image("a.exr");
        let index = &image.whole.iter().find(|(name, _)| name == "index").unwrap().1;
        let other = |name: &str| &image.other.iter().find(|(n, _)| n == name).unwrap().1;
        let (x, y) = (other("position.X"), other("position.Y"));
        let mut seen = 0;
        for i in (0..index.len()).filter(|i| index[*i] != u32::MAX) {
            let point = points.origin + points.positions.get(index[i] as usize);
            // Splats of a level at 3 pixels are less than 2 wide, and single precision is half a unit here.
            let away = [f64::from(x[i]) - point.x, f64::from(y[i]) - point.y];
            assert!(away.iter().all(|d| d.abs() < 2.0), "{flags}: row {} is {away:?} away", index[i]);
            seen += 1;
        }
        assert!(seen > 1000, "{flags}: {seen}");
    }
    // Columns that selections add while they load are none of the file's attributes.
    folder.run(&format!("{view} --lod-error 3 --where surfel_level_spacing>0 -o b.png")).fails(3, "has no attribute");
    // The selection for tiles is that of the whole image.
    folder.run(&format!("{view} --lod-error 3 -o whole.png")).code(0);
    let whole = folder.image("whole.png").color.unwrap();
    for i in 0..4 {
        folder.run(&format!("{view} --lod-error 3 --tile {i}/4 -o tile.png --force")).code(0);
        let tile = folder.image("tile.png");
        assert_eq!((tile.width, tile.height), (96, 20));
        assert_eq!(tile.color.unwrap(), whole[96 * 20 * i..][..96 * 20], "tile {i}");
    }
}

#[test]
fn points_that_do_not_fit_into_memory_are_refused_with_what_to_do() {
    let folder = Folder::new("levels-memory");
    folder.write("in.las", las(60));
    folder.write("in.xyz", "0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 0 0\n2 1 0\n");
    folder.run("convert in.las -o out.copc.laz --memory 2G").code(0);
    folder.run("render in.las --size 16x16 -o a.png --memory 2M").code(0);
    for (command, expected) in [
        ("render in.las --memory 256K", "surfel convert"),
        ("render in.las --memory 100K --max-points 1024", " kB of memory at 1"),
        ("render out.copc.laz --memory 100K", "at most 930 points (--max-points)"),
        ("render out.copc.laz --memory 100K --all-levels", "at most 930 points (--max-points)"),
        ("render in.xyz --memory 256", "has 6 points to draw"),
        ("render in.las --memory 1K --every 2", "has 1800 points to draw"),
    ] {
        folder.run(&format!("{command} -o b.png")).fails(3, expected).fails(3, "--memory");
    }
    folder.run("convert in.las -o b.ply --memory 256K").fails(3, "--memory");
    folder.run("render in.las --size 16x16 -o c.png --memory 100K --max-points 512").code(0);
    folder.run("convert in.las -o less.copc.laz --memory 128M").fails(2, "takes at least");
    assert_eq!(folder.names(), ["a.png", "c.png", "in.las", "in.xyz", "out.copc.laz"]);
}

#[test]
fn error_of_any_size_draws_all_points_to_few() {
    let folder = Folder::new("levels-extremes");
    folder.write("in.las", las(400));
    folder.run("convert in.las -o out.copc.laz").code(0);
    let view = "render out.copc.laz --size 96x80 --eye 600020,4999980,140 --target 600020,5000020,100 --no-metadata";
    folder.run(&format!("{view} --all-levels -o all.png")).code(0);
    // The limit on points per pixel rises as splats shrink.
    for error in ["0.01", "1e-300"] {
        folder.run(&format!("{view} --lod-error {error} -o fine.png --force")).code(0);
        folder.run("compare all.png fine.png --fail-above flip=0.0001").code(0);
    }
    let covered = |name: &str| folder.image(name).color.unwrap().iter().filter(|c| c[3] > 0.5).count();
    for error in ["1000", "1e6"] {
        let notes = folder.run(&format!("{view} --lod-error {error} -o coarse.png --force")).code(0).stderr();
        assert!(notes.contains("by levels: 1 of"), "{notes}");
        assert!(covered("coarse.png") >= covered("all.png"), "{error}");
    }
    for error in ["0", "-1", "NaN", "inf", "1e7"] {
        folder.run(&format!("{view} --lod-error={error} -o no.png")).fails(2, "--lod-error");
    }
    // A scene file has the same limit; coarser progressive images also respect it.
    let scene = |error: &str| {
        let camera = r#"{"eye": [600020, 4999980, 140], "target": [600020, 5000020, 100], "up": [0, 0, 1],
            "near": 0.1, "size": [96, 80], "projection": {"perspective": {"fov_y_deg": 40}}}"#;
        let settings = format!(r#"{{"lod_error_px": {error}}}"#);
        let objects = r#"[{"splats": "out.copc.laz"}]"#;
        let text = format!(r#"{{"camera": {camera}, "settings": {settings}, "objects": {objects}}}"#);
        folder.write("scene.json", text);
    };
    for error in ["1e7", "1e308"] {
        scene(error);
        for flags in ["", "--progressive"] {
            let run = folder.run(&format!("scene.json {flags} -o no.png"));
            run.fails(3, "expected a number of pixels in (0, 1000000]");
        }
    }
    assert!(!folder.has("no.png"));
    scene("1e6");
    folder.run("scene.json --no-metadata --progressive -o largest.png").code(0);
    assert!(covered("largest.png") > 96 * 80 / 4);
}

/// Tests with a sparse file, whose points need 0.8 GB of memory but no space on disk.
#[cfg(target_os = "linux")]
#[test]
fn render_that_is_ended_while_it_writes_levels_leaves_nothing() {
    use std::os::unix::process::ExitStatusExt;
    use std::time::{Duration, Instant};
    let folder = Folder::new("levels-ended");
    std::fs::create_dir(folder.path().join("temporary")).unwrap();
    let points = 6_000_000_u64;
    let mut bytes = las(1);
    bytes[247..255].copy_from_slice(&points.to_le_bytes());
    folder.write("in.las", bytes);
    let file = std::fs::File::options().write(true).open(folder.path().join("in.las")).unwrap();
    file.set_len(375 + 36 * points).unwrap();
    let held = || std::fs::read_dir(folder.path().join("temporary")).unwrap().count();
    for later in [0, 700] {
        let words = "render in.las --memory 512M --size 16x16 -o out.png";
        let mut child = folder.spawn_with(words, &[("TMPDIR", "temporary")]);
        let began = Instant::now();
        while held() == 0 {
            assert!(child.try_wait().unwrap().is_none() && began.elapsed() < Duration::from_secs(60), "{later}");
            std::thread::sleep(Duration::from_millis(2));
        }
        std::thread::sleep(Duration::from_millis(later));
        let pid = child.id().to_string();
        assert!(std::process::Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
        let status = child.wait().unwrap();
        assert_eq!((status.signal(), held()), (Some(15), 0), "{later}");
        assert_eq!(folder.names(), ["in.las", "temporary"]);
    }
}

#[test]
fn server_draws_by_levels_what_does_not_fit() {
    let folder = Folder::new("levels-serve");
    folder.write("in.las", las(600));
    folder.run("convert in.las -o out.copc.laz").code(0);
    let camera = |x: u32| {
        format!(
            r#"{{"eye": [6000{x}, 5000010, 112], "target": [6000{x}, 5000030, 100], "up": [0, 0, 1], "near": 0.1,
                 "size": [160, 120], "projection": {{"perspective": {{"fov_y_deg": 40}}}}}}"#
        )
        .replace('\n', " ")
    };
    let mut lines = Vec::new();
    for (name, x) in [("a", 30), ("b", 40), ("c", 30)] {
        lines.push(format!(r#"{{"output": "{name}.png", "camera": {}}}"#, camera(x)));
        let scene = format!(r#"{{"camera": {}, "objects": [{{"splats": "out.copc.laz"}}]}}"#, camera(x));
        folder.write(&format!("{name}.json"), scene);
    }
    lines.push(r#"{"output": "d.png", "view": "iso", "size": [80, 60]}"#.to_owned());
    // All 360,000 points take 32 MB.
    for name in ["a", "b", "c"] {
        folder.run(&format!("{name}.json -o {name}-plain.png --memory 30M --no-metadata")).code(0);
    }
    let answers = folder.run_in("", "serve --stdio a.json --memory 30M --no-metadata", lines.join("\n").as_bytes());
    let (answers, notes) = (answers.stdout(), answers.stderr());
    assert!(
        notes.contains("drawn by levels") && answers.lines().all(|line| line.contains(r#""ok":true"#)),
        "{answers}"
    );
    for name in ["a", "b", "c"] {
        assert!(folder.read(&format!("{name}.png")) == folder.read(&format!("{name}-plain.png")), "{name}");
    }
    assert!(folder.has("d.png"));
}

#[test]
fn file_that_a_view_needs_all_of_is_drawn_as_ever() {
    let folder = Folder::new("levels-small");
    folder.write("in.las", las(60));
    folder.run("convert in.las -o out.copc.laz").code(0);
    let notes = folder.run("render out.copc.laz --size 64x64 -o a.png --no-metadata").code(0).stderr();
    assert!(!notes.contains("by levels") && notes.contains("normals and radii"), "{notes}");
    folder.run("render out.copc.laz --size 64x64 -o b.png --no-metadata --all-levels").code(0);
    assert_eq!(folder.read("a.png"), folder.read("b.png"));
    folder.run("convert in.las in.las -o out.ply").fails(2, "second input");
    folder.run("convert in.las -o other.copc.laz --max-points 9").fails(2, "takes the points as they are");
}

/// Runs `surfel`, and returns the successive contents of `out` during the run.
fn pictures_of(folder: &Folder, words: &str, out: &str) -> Vec<Vec<u8>> {
    let mut child = folder.spawn(words);
    let mut pictures: Vec<Vec<u8>> = Vec::new();
    loop {
        let ended = child.try_wait().unwrap();
        if let Ok(bytes) = std::fs::read(folder.path().join(out))
            && pictures.last() != Some(&bytes)
        {
            pictures.push(bytes);
        }
        if let Some(status) = ended {
            assert!(status.success(), "surfel {words}");
            return pictures;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

#[test]
fn progressive_pictures_are_whole_and_the_last_is_the_one_without_the_flag() {
    let folder = Folder::new("levels-progressive");
    folder.write("in.las", las(600));
    folder.run("convert in.las -o out.copc.laz").code(0);
    let view = "--eye 600030,5000010,112 --target 600030,5000030,100 --fov-y 40 --size 320x240";
    for (words, coarse, out) in [
        (format!("render out.copc.laz {view}"), 2, "copc.png"),
        (format!("render out.copc.laz {view} --planes index,position"), 2, "copc.exr"),
        (format!("render out.copc.laz {view} --all-levels"), 2, "all.png"),
        ("render in.las --size 320x240 --stats".to_owned(), 1, "las.png"),
    ] {
        folder.run(&format!("{words} -o {out}")).code(0);
        let plain = folder.read(out);
        std::fs::remove_file(folder.path().join(out)).unwrap();
        let pictures = pictures_of(&folder, &format!("{words} --progressive -o {out}"), out);
        assert_eq!(pictures.len(), coarse + 1, "{out}");
        assert!(pictures.last() == Some(&plain), "{out}");
        for (i, bytes) in pictures.iter().enumerate() {
            let name = format!("{i}-{out}");
            folder.write(&name, bytes);
            let image = folder.image(&name);
            assert_eq!((image.width, image.height), (320, 240), "{name}");
            let covered = image.color.unwrap().iter().filter(|c| c[3] > 0.99).count();
            assert!(covered > 320 * 240 / 4, "{name}: {covered}");
        }
        // A file that existed before isn't an image of this run.
        folder.run(&format!("{words} --progressive -o {out}")).fails(1, "--force");
        assert!(folder.read(out) == plain, "{out}");
    }
    folder.write("ball.ply", common::ball());
    let once = pictures_of(&folder, "render ball.ply --progressive -o ball.png", "ball.png");
    folder.run("render ball.ply -o ball.png --force").code(0);
    assert!(once == [folder.read("ball.png")]);
}

#[test]
fn progressive_is_of_one_picture_in_a_file() {
    let folder = Folder::new("levels-progressive-refused");
    folder.write("a.ply", common::ball());
    folder.write("b.ply", common::ball());
    for (flags, expected) in [
        ("a.ply -o -", "--progressive rewrites a file"),
        ("a.ply --stats", "--progressive rewrites a file"),
        ("a.ply --turntable --frames 3 -o {frame}.png", "one picture, but this draws 3"),
        ("a.ply b.ply -o {input}.png", "--progressive is of one picture"),
        ("a.ply -o a.png --skip-existing", "--skip-existing"),
        ("a.ply -o /dev/null", "expected a name that ends in"),
    ] {
        folder.run(&format!("render {flags} --progressive")).fails(2, expected);
    }
    assert_eq!(folder.names(), ["a.ply", "b.ply"]);
}

#[test]
fn killed_conversion_goes_on_with_resume_and_leaves_nothing_without() {
    let folder = Folder::new("levels-killed");
    for east in 0..3 {
        folder.write(&format!("{east}.las"), las_at(260, east));
    }
    let convert = "convert 0.las 1.las 2.las -o";
    let began = std::time::Instant::now();
    folder.run(&format!("{convert} whole.copc.laz")).code(0);
    let took = began.elapsed();
    let whole = folder.read("whole.copc.laz");
    let names = ["0.las", "1.las", "2.las", "out.copc.laz", "whole.copc.laz"];
    let kill = |words: &str, after: std::time::Duration| {
        let mut child = folder.spawn(words);
        std::thread::sleep(after);
        child.kill().unwrap();
        child.wait().unwrap();
        // At each moment the file is absent or complete.
        assert!(!folder.has("out.copc.laz") || folder.read("out.copc.laz") == whole);
    };
    let resume = format!("{convert} out.copc.laz --resume");
    for twentieths in [1, 3, 6, 9, 12, 14, 16, 17, 18, 19, 20] {
        kill(&resume, took * twentieths / 20);
        // Most runs continue from here until the output exists; some start again.
        if twentieths % 3 == 0 && !folder.has("out.copc.laz") {
            folder.run(&resume).code(0);
            assert_eq!(folder.names(), names);
            assert!(folder.read("out.copc.laz") == whole, "killed after {twentieths}/20");
            std::fs::remove_file(folder.path().join("out.copc.laz")).unwrap();
        }
    }
    if folder.has("out.copc.laz.resume") {
        folder.run(&resume).code(0);
    }
    assert_eq!(folder.names(), names);
    assert!(folder.read("out.copc.laz") == whole);
    std::fs::remove_file(folder.path().join("out.copc.laz")).unwrap();
    // Files left by a run without --resume are removed by the next one; those of a run with it are reported.
    for half in [1, 2, 3] {
        kill(&format!("{convert} out.copc.laz --force"), took * half / 4);
    }
    folder.run(&format!("{convert} out.copc.laz --force")).code(0);
    assert_eq!(folder.names(), names);
    std::fs::create_dir(folder.path().join("out.copc.laz.resume")).unwrap();
    folder.write("out.copc.laz.resume/manifest.json", "{}");
    let run = folder.run(&format!("{convert} out.copc.laz --force")).code(0);
    assert!(run.stderr().contains("out.copc.laz.resume is left of an interrupted run with --resume: delete it"));
    let run = folder.run(&format!("{resume} --force")).fails(3, "delete this folder to start anew");
    assert!(run.stderr().contains("has what is done"));
}

#[test]
fn shards_of_a_conversion_are_put_together() {
    let folder = Folder::new("levels-shards");
    for east in 0..3 {
        folder.write(&format!("{east}.las"), las_at(150, east));
    }
    let inputs = "0.las 1.las 2.las";
    folder.run(&format!("convert {inputs} -o whole.copc.laz")).code(0);
    folder.run(&format!("convert {inputs} -o a-{{shard}}.shard --shard 0/2")).code(0);
    let run = folder.run_words_with(
        &["convert", "0.las", "1.las", "2.las", "-o", "a-{shard}.shard", "--resume"],
        &[("SLURM_ARRAY_TASK_ID", "1"), ("SLURM_ARRAY_TASK_COUNT", "2")],
    );
    assert!(run.code(0).stderr().contains("shard 1 of 2 (by SLURM_ARRAY_TASK_ID=1, SLURM_ARRAY_TASK_COUNT=2)"));
    folder.run("convert a-0001.shard -o one.copc.laz").fails(3, "is shard 1 of 2, and 0 is not there once");
    folder.run("convert a-0001.shard a-0000.shard -o merged.copc.laz").code(0);
    assert!(folder.read("merged.copc.laz") == folder.read("whole.copc.laz"));
    folder.run("convert a-0001.shard a-0000.shard -o merged.copc.laz").fails(1, "already exists");
    for (words, part) in [
        ("-o x.copc.laz --shard 0/2", "--shard 0/2 writes a name that ends in .shard"),
        ("-o x.shard", "is the name of a shard, expected --shard I/N"),
        ("-o x.ply --shard 0/2", "--shard 0/2 writes a name that ends in .shard"),
        ("-o x.ply --resume", "--resume is of OUT.copc.laz"),
        ("-o x.shard --shard 0/2 --cull none", "no flag on splats"),
    ] {
        folder.run(&format!("convert 0.las {words}")).fails(2, part);
    }
    folder.run("convert a-0000.shard -o x.shard --shard 0/2").fails(3, "can't be divided again");
    assert!(!folder.names().iter().any(|name| name.starts_with('x') || name.ends_with(".resume")));
}

#[test]
fn info_by_blocks_is_that_of_all_points() {
    let folder = Folder::new("levels-info");
    let mut bytes = las(400);
    // Classes and user data that are zero in earlier blocks, a class 0 after others, and 8-bit colours.
    for (i, record) in bytes[375..].chunks_exact_mut(36).enumerate() {
        record[16] = if i % 7 == 0 { 0 } else { (i / 60_000) as u8 };
        record[17] = u8::from(i == 159_999);
        (30..36).filter(|at| at % 2 == 1).for_each(|at| record[at] = 0);
    }
    folder.write("in.las", bytes);
    folder.run("convert in.las -o in.copc.laz").code(0);
    for file in ["in.las", "in.copc.laz"] {
        // Stdin is in memory anyway.
        let mut whole = folder.run_in("", "info - --json", &folder.read(file)).code(0).json();
        let mut blocks = folder.run(&format!("info {file} --json")).code(0).json();
        assert!(whole["attributes"]["user_data"].is_object() && whole["classes"].as_array().unwrap().len() == 3);
        for side in ["median", "min", "max"] {
            let [a, b] = [&mut whole, &mut blocks].map(|facts| facts["radii"][side].take().as_f64().unwrap());
            // Positions are rounded to f32 from another origin: by 2^-24 of 60 m, with a spacing of 0.1 m.
            assert!((a / b - 1.0).abs() < 1e-4, "{file}, {side}: {a} {b}");
        }
        let [a, b] = [&mut whole, &mut blocks].map(|facts| facts["memory_bytes"].take().as_f64().unwrap());
        // Columns that are zero in a block are omitted from it.
        assert!((0.9..=1.0).contains(&(b / a)), "{file}: {a} {b}");
        for facts in [&mut whole, &mut blocks] {
            // Equal up to the origin.
            drop(facts["file"].take());
            let place = [facts["bounds"].take(), facts["attributes"]["position"].take()].map(|v| v.to_string());
            assert!(place.iter().all(|text| text.contains("600000.0") && text.contains("5000039.95")), "{place:?}");
        }
        assert_eq!(whole, blocks);
    }
}

#[test]
fn columns_of_different_files_are_told_apart_by_name() {
    let folder = Folder::new("levels-columns");
    let file = |names: &str, row: fn(u32, u32) -> String| {
        let rows: String = (0..400).map(|i| row(i % 20, i / 20)).collect();
        format!("{names}\n{rows}")
    };
    folder.write("plain.csv", file("x,y,z", |x, y| format!("{x},{y},0\n")));
    folder.write("a.csv", file("x,y,z,red,green,blue", |x, y| format!("{x},{y},0,9,8,7\n")));
    folder.write("b.csv", file("red,green,blue,x,y,z", |x, y| format!("9,8,7,{x},{y},2000\n")));
    // More columns than the first file has.
    folder.run("convert plain.csv a.csv -o c.copc.laz").fails(3, "a.csv: has points of format 7");
    for inputs in ["a.csv b.csv", "b.csv a.csv"] {
        folder.run(&format!("convert {inputs} -o c.copc.laz --force")).code(0);
        let facts = folder.run("info c.copc.laz --json").code(0).json();
        let colour = &facts["attributes"]["colour"]["max"];
        // sRGB 9 of 255, in linear light.
        assert!((colour[0].as_f64().unwrap() - 0.00273).abs() < 1e-5, "{inputs}: {facts}");
    }
}
