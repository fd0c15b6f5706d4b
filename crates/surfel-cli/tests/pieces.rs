//! Shards of a job: frames, shards and tiles, `stitch`, `serve` and `jobs`.

use crate::common;

use common::{Folder, Run, ball, las_at};
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

/// Runs `surfel` with environment variables.
fn run_with(f: &Folder, words: &str, variables: &[(&str, &str)]) -> std::process::Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surfel"));
    command.current_dir(f.path()).args(words.split(' ')).env("NO_COLOR", "1");
    command.envs(variables.iter().copied()).output().unwrap()
}

/// Writes a scene file of two translucent balls, one before the other, for images of `size` pixels.
fn scene(f: &Folder, size: [u32; 2], settings: &str) {
    f.write("ball.ply", ball());
    f.write(
        "scene.json",
        format!(
            r#"{{"camera": {{"eye": [0.3, 0.2, 4], "target": [0.1, 0, 0], "up": [0, 1, 0],
                "projection": {{"perspective": {{"fov_y_deg": 40}}}}, "near": 0.1, "size": [{}, {}]}},
               "objects": [{{"splats": "ball.ply"}},
                 {{"splats": "ball.ply", "matrix": [0.4,0,0,0, 0,0.4,0,0, 0,0,0.4,0, 0.5,0.3,1.2,1]}}],
               "settings": {settings}}}"#,
            size[0], size[1]
        ),
    );
}

#[test]
fn tiles_equal_the_whole_to_the_byte() {
    let f = Folder::new("tiles");
    for (settings, flags) in [
        (r#"{"shader": "phong", "edge_aa": true}"#, ""),
        (r#"{"shader": "phong", "edge_aa": "samples"}"#, ""),
        (r#"{"shader": "edl"}"#, ""),
        (r#"{"shader": "phong", "transparency": "peel:3"}"#, "--exr-f32"),
    ] {
        scene(&f, [61, 47], settings);
        for extension in ["exr", "png"] {
            let flags = if extension == "png" { "--png16" } else { flags };
            let whole = format!("whole.{extension}");
            f.run(&format!("scene.json -f -o {whole} {flags}")).code(0);
            // Bands of 15 and 16 rows, which don't end at the EXR's blocks of 16 lines.
            for i in 0..3 {
                f.run(&format!("scene.json -f -o t{{tile}}.{extension} --tile {i}/3 {flags}")).code(0);
            }
            let joined = format!("joined.{extension}");
            f.run(&format!("stitch t0002.{extension} t0000.{extension} t0001.{extension} -f -o {joined}")).code(0);
            assert!(f.read(&joined) == f.read(&whole) || same(&f, &joined, &whole), "{settings} {extension}");
            // Regions can be merged too, beside and below each other.
            for (i, region) in ["0,0,20,47", "20,0,41,9", "20,9,41,38"].into_iter().enumerate() {
                f.run(&format!("scene.json -f -o r{i}.{extension} --region {region} {flags}")).code(0);
            }
            f.run(&format!("stitch r0.{extension} r1.{extension} r2.{extension} -f -o {joined}")).code(0);
            assert!(same(&f, &joined, &whole), "{settings} {extension} by regions");
        }
    }
    // The EXR is the same file in either case.
    assert_eq!(f.read("joined.exr"), f.read("whole.exr"));
    f.run("again joined.exr -o again.exr").code(0);
}

/// True if two images have the same size, the same colour, depth, normals and weights to the bit, and the same
/// metadata.
fn same(f: &Folder, a: &str, b: &str) -> bool {
    let bits = |name: &str| {
        let image = f.image(name);
        let planes: Vec<u32> = (image.color.iter().flatten().flatten())
            .chain(image.depth.iter().flatten())
            .chain(image.normal.iter().flatten().flatten())
            .chain(image.weight.iter().flatten())
            .map(|value| value.to_bits())
            .collect();
        (image.width, image.height, planes, image.metadata)
    };
    bits(a) == bits(b)
}

#[test]
fn tiles_of_a_poster_are_what_the_model_says() {
    let f = Folder::new("poster");
    scene(&f, [65_536, 65_536], r#"{"shader": "phong"}"#);
    // A band of 4 rows through the middle.
    f.run("scene.json -o band.png --tile 8192/16384 --backend cpu").code(0);
    let band = f.image("band.png");
    assert_eq!((band.width, band.height), (65_536, 4));
    let drawn = band.color.as_ref().unwrap().iter().filter(|c| c[3] > 0.0).count();
    assert!(drawn > 65_536, "{drawn} pixels are drawn");
    // A corner of the ball far from the pixel origin, by both backends.
    for backend in ["cpu", "reference"] {
        f.run(&format!("scene.json -o {backend}.exr --region 52000,33000,24,16 --backend {backend}")).code(0);
    }
    // The preset balanced promises 50 dB for a backend.
    f.run("compare reference.exr cpu.exr --fail-below psnr=50").code(0);
    f.run("scene.json -o all.png --backend cpu").fails(3, "at most 268435456 pixels at a time");
}

#[test]
fn tiles_that_do_not_fit_are_refused() {
    let f = Folder::new("misfits");
    scene(&f, [40, 30], r#"{"shader": "phong"}"#);
    for i in 0..3 {
        f.run(&format!("scene.json -o t{i}.png --tile {i}/3")).code(0);
    }
    f.run("stitch t0.png t2.png -o w.png").fails(3, "rows 10 to 19 are in no tile");
    f.run("stitch t0.png t1.png t1.png t2.png -o w.png").fails(3, "that another tile has");
    f.run("stitch t0.png t1.png t2.png -o w.exr").fails(2, "expected a name in .png");
    f.run("stitch t0.png t1.png t2.png -o w.gif").fails(2, "w.gif");
    f.run("stitch t0.png t2.png -o w.tif").fails(3, "rows 10 to 19 are in no tile");
    for i in 0..3 {
        f.run(&format!("scene.json -o t{i}.exr --tile {i}/3")).code(0);
    }
    f.run("stitch t0.exr t1.exr t2.exr -o w.tif").fails(2, "expected a name in .exr");
    f.write("w.tif", "mine");
    f.run("stitch t0.png t1.png t2.png -o w.tif").fails(1, "already exists");
    assert_eq!(f.read("w.tif"), b"mine");
    f.run("stitch t0.png t1.png t2.png -f -o w.tif").code(0);
    let tiff = f.read("w.tif");
    assert!(tiff.starts_with(b"II*\0") || tiff.starts_with(b"MM\0*"));
    f.run("stitch t0.png t1.png absent.png -o w.png").fails(3, "absent.png");
    f.run("scene.json -o other.png --tile 2/3 --cutoff 1.5").code(0);
    f.run("stitch t0.png t1.png other.png -o w.png").fails(3, "a setting differs");
    f.run("scene.json -o other.png -f --tile 2/3 --png16").code(0);
    f.run("stitch t0.png t1.png other.png -o w.png").fails(3, "how it was drawn");
    f.run("scene.json -o other.png -f --tile 2/3 --no-metadata").code(0);
    f.run("stitch t0.png t1.png other.png -o w.png").fails(3, "surfel:scene");
    f.write("ball.ply", ball().replace(" 255 90\n", " 250 90\n"));
    f.run("scene.json -o other.png -f --tile 2/3").code(0);
    f.run("stitch t0.png t1.png other.png -o w.png").fails(3, "an input's content differs");
    let tile = f.read("t2.png");
    f.write("other.png", &tile[..tile.len() - 40]);
    f.run("stitch t0.png t1.png other.png -o w.png").fails(3, "other.png");
    f.write("other.png", "no image");
    f.run("stitch t0.png t1.png other.png -o w.png").fails(3, "not a tile that can be read");
    assert!(!f.has("w.png"), "nothing half made is left");
    f.run("stitch t0.png t1.png t2.png -o w.png").code(0);
    f.run("stitch t0.png t1.png t2.png -o w.png").fails(1, "already exists");
    f.run("scene.json -o x.png --tile 0/31").fails(2, "at most as many tiles");
    f.run("scene.json -o x.png --tile 4/3").fails(2, "expected I/N");
    f.run("scene.json -o x.png --tile 0/3 --region 0,0,1,1").fails(2, "--region");
    f.run("scene.json -o x{tile}.png").fails(2, "give --tile");
}

#[test]
fn damaged_tiles_give_an_error_and_no_image() {
    let f = Folder::new("damaged");
    scene(&f, [40, 33], r#"{"shader": "phong"}"#);
    for extension in ["exr", "png"] {
        f.run(&format!("scene.json -o a.{extension} --tile 0/2")).code(0);
        f.run(&format!("scene.json -o b.{extension} --tile 1/2")).code(0);
        let whole = f.read(&format!("b.{extension}"));
        for i in 0..24 {
            let mut bytes = whole.clone();
            let at = i * bytes.len() / 24;
            if i % 3 == 0 {
                bytes.truncate(at);
            } else {
                bytes[at] ^= 0x55;
            }
            f.write(&format!("c.{extension}"), bytes);
            let run = f.run(&format!("stitch a.{extension} c.{extension} -f -o w.{extension}"));
            // Unnoticeable changes (a text that isn't compared, a checksum that the format lacks) may pass.
            assert!(!run.stderr().contains("defect"), "{extension} {at}: {}", run.stderr());
        }
    }
}

#[test]
fn shards_draw_every_picture_once() {
    let f = Folder::new("shards");
    scene(&f, [16, 12], "{}");
    let all = "scene.json --turntable --frames 7 -o";
    std::fs::create_dir_all(f.path().join("all")).unwrap();
    std::fs::create_dir_all(f.path().join("out")).unwrap();
    f.run(&format!("{all} all/{{frame}}.png")).code(0);
    let out = || {
        let mut names: Vec<_> = std::fs::read_dir(f.path().join("out")).unwrap().map(|e| e.unwrap().path()).collect();
        names.sort();
        names.iter().map(|p| p.file_stem().unwrap().to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
    };
    let clear = || {
        std::fs::read_dir(f.path().join("out")).unwrap().for_each(|e| std::fs::remove_file(e.unwrap().path()).unwrap());
    };
    // Shards counted from 1, without --force: a frame drawn twice would fail.
    for i in 1..=3 {
        f.run(&format!("{all} out/{{frame}}.png --shard {i}/3")).code(0);
    }
    assert_eq!(out(), "0000 0001 0002 0003 0004 0005 0006");
    for i in 0..7 {
        assert_eq!(f.read(&format!("out/000{i}.png")), f.read(&format!("all/000{i}.png")), "frame {i}");
    }
    // Existing frames are kept, and the others are drawn.
    std::fs::remove_file(f.path().join("out/0004.png")).unwrap();
    f.write("out/0003.png", "mine");
    let run = f.run(&format!("{all} out/{{frame}}.png --skip-existing")).code(0);
    assert!(run.stderr().contains("left out 6 of 7 pictures"), "{}", run.stderr());
    assert_eq!(f.read("out/0003.png"), b"mine");
    assert_eq!(f.read("out/0004.png"), f.read("all/0004.png"));
    let run = f.run(&format!("{all} out/{{frame}}.png --skip-existing")).code(0);
    assert!(run.stderr().contains("all of 7 pictures exist"), "{}", run.stderr());
    clear();
    f.run(&format!("{all} out/{{frame}}.png --frame-range 1-6:2")).code(0);
    assert_eq!(out(), "0001 0003 0005");
    clear();
    f.run(&format!("{all} out/{{frame}}.png --frame-range 1-6:2 --shard 0/2")).code(0);
    assert_eq!(out(), "0001");
    clear();
    for (variables, expected) in [
        ([("SLURM_ARRAY_TASK_ID", "3"), ("SLURM_ARRAY_TASK_COUNT", "4")], "0005 0006"),
        ([("JOB_COMPLETION_INDEX", "0"), ("JOB_COMPLETIONS", "4")], "0000"),
        ([("AWS_BATCH_JOB_ARRAY_INDEX", "1"), ("AWS_BATCH_JOB_ARRAY_SIZE", "4")], "0001 0002"),
    ] {
        let run = run_with(&f, &format!("{all} out/{{frame}}.png"), &variables);
        let stderr = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success() && stderr.contains(variables[0].0), "{stderr}");
        assert_eq!(out(), expected);
        clear();
        // A single image isn't divided, and the flag takes precedence.
        assert!(run_with(&f, "scene.json -o out/one.png", &variables).status.success());
        assert_eq!(out(), "one");
        clear();
        assert!(run_with(&f, &format!("{all} out/{{frame}}.png --shard 6/7"), &variables).status.success());
        assert_eq!(out(), "0006");
        clear();
    }
    let bad = run_with(&f, &format!("{all} out/{{frame}}.png"), &[("JOB_COMPLETION_INDEX", "2")]);
    assert_eq!(bad.status.code(), Some(2), "{}", String::from_utf8_lossy(&bad.stderr));
    let bad = run_with(&f, &format!("{all} out/{{frame}}.png"), &[("SLURM_ARRAY_TASK_ID", "x")]);
    assert_eq!(bad.status.code(), Some(2), "{}", String::from_utf8_lossy(&bad.stderr));
    assert_eq!(out(), "");
    // Several inputs form one list; shards beyond it have nothing to do.
    f.write("b.ply", ball());
    for i in 0..5 {
        f.run(&format!("ball.ply b.ply --size 8x8 --turntable --frames 2 -o out/{{input}}{{frame}}.png --shard {i}/5"))
            .code(0);
    }
    assert_eq!(out(), "b0000 b0001 ball0000 ball0001");
    f.run(&format!("{all} x{{frame}}.png --frame-range 0-7")).fails(2, "expected at most 6");
    f.run("scene.json -o x.png --frame-range 0-7").fails(2, "--turntable");
    f.run("scene.json --stats --skip-existing").fails(2, "give -o");
    f.run("scene.json -o x.png --skip-existing --force").fails(2, "--force");
}

/// Returns the answers of `surfel serve` to lines, one each.
fn serve(f: &Folder, words: &str, lines: &[&str]) -> Vec<serde_json::Value> {
    let mut child = Command::new(env!("CARGO_BIN_EXE_surfel"))
        .current_dir(f.path())
        .args(words.split(' '))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let answers = lines.iter().map(|line| {
        // The answer arrives before the next request is sent.
        writeln!(stdin, "{line}").unwrap();
        let mut answer = String::new();
        stdout.read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap_or_else(|e| panic!("{e}: {answer:?} to {line}"))
    });
    let answers = answers.collect();
    drop(stdin);
    assert!(child.wait().unwrap().success(), "the end of stdin ends it");
    answers
}

#[test]
fn serve_answers_every_line() {
    let f = Folder::new("serve");
    scene(&f, [40, 30], r#"{"shader": "phong", "edge_aa": true}"#);
    let long = format!(r#"{{"output": "{}.png"}}"#, "x".repeat(70_000));
    let camera = r#"{"eye": [3, 1, 2], "target": [0, 0, 0], "up": [0, 1, 0], "near": 0.1, "size": [30, 20],
                     "projection": {"orthographic": {"height": 3}}, "far": 9}"#
        .replace('\n', " ");
    f.write("camera.json", &camera);
    let by_camera = format!(r#"{{"id": 7, "output": "b.png", "camera": {camera}}}"#);
    let lines = [
        r#"{"output": "a.exr"}"#,
        by_camera.as_str(),
        r#"{"output": "c.png", "view": "30,20", "size": [20, 10], "id": "c"}"#,
        r#"{"output": "d.exr", "region": [8, 4, 16, 9], "planes": ["depth"]}"#,
        r#"{"output": "a.exr", "id": null}"#,
        r#"{"output": "a.exr", "force": true}"#,
        "not JSON",
        "{}",
        r#"{"output": "e.png", "region": [30, 0, 16, 9]}"#,
        r#"{"output": "e.png", "size": [65536, 65536]}"#,
        r#"{"output": "e.png", "size": [9000, 9000]}"#,
        r#"{"output": "absent/e.png"}"#,
        r#"{"output": "e.png", "planes": ["depth"]}"#,
        long.as_str(),
        r#"{"output": "f.jpg"}"#,
    ];
    let answers = serve(&f, "serve --stdio scene.json", &lines);
    let ok: Vec<bool> = answers.iter().map(|answer| answer["ok"].as_bool().unwrap()).collect();
    let expected = [true, true, true, true, false, true, false, false, false, false, false, false, false, false, true];
    assert_eq!(ok, expected, "{answers:#?}");
    assert_eq!((&answers[1]["id"], &answers[2]["id"]), (&7.into(), &"c".into()));
    assert_eq!(answers[2]["stats"]["width"], 20);
    assert!(answers[13]["error"].as_str().unwrap().contains("65536 bytes"), "{}", answers[13]);
    assert!(!f.has("e.png") && f.has("f.jpg"));
    // The same bytes as separate commands.
    f.run("scene.json -o ra.exr").code(0);
    f.run("scene.json -o rb.png --camera camera.json").code(0);
    f.run("scene.json -o rc.png --view 30,20 --size 20x10").code(0);
    f.run("scene.json -o rd.exr --region 8,4,16,9").code(0);
    for name in ["a.exr", "b.png", "c.png"] {
        assert_eq!(f.read(name), f.read(&format!("r{name}")), "{name}");
    }
    let (d, rd) = (f.image("d.exr"), f.image("rd.exr"));
    assert!(d.color == rd.color && d.depth == rd.depth && d.normal.is_none() && rd.normal.is_some());
    // Bare files are lit along the view, as with --cameras.
    let answers = serve(&f, "serve --stdio ball.ply --size 20x20", &[r#"{"output": "bare.png"}"#, "", "{}"][..1]);
    assert_eq!(answers[0]["ok"], true, "{}", answers[0]);
    f.run("serve --stdio scene.json -o a.png").fails(2, "-o is not for surfel serve");
    f.run("serve scene.json").fails(2, "--stdio");
    f.run("serve --stdio -").fails(2, "stdin has the requests");
    f.run("serve --stdio absent.json").fails(3, "absent.json");
}

/// Runs a job's lines in a shell whose PATH includes this program.
fn shell(f: &Folder, script: &str) {
    let folder = std::path::Path::new(env!("CARGO_BIN_EXE_surfel")).parent().unwrap();
    let path = std::env::join_paths(
        std::iter::once(folder.to_path_buf()).chain(std::env::split_paths(&std::env::var_os("PATH").unwrap())),
    );
    let run = Command::new("bash").args(["-ec", script]).env("PATH", path.unwrap()).current_dir(f.path()).output();
    let run = run.unwrap();
    assert!(run.status.success(), "{script}\n{}", String::from_utf8_lossy(&run.stderr));
}

/// Slurm emulated in a shell: the tasks of an array one by one, the last first, then the dependent job.
const SLURM: &str = r#"sbatch() {
    case "$1" in
    --parsable)
        for i in 2 1 0; do SLURM_ARRAY_TASK_ID=$i SLURM_ARRAY_TASK_COUNT=3 bash "$2"; done
        echo "17;cluster" ;;
    *) [ "$2" = --dependency=afterok:17 ] && bash ;;
    esac
}
mkdir -p bin && { echo '#!/bin/bash' && declare -f sbatch && echo 'sbatch "$@"'; } > bin/sbatch && chmod +x bin/sbatch
export PATH="$PWD/bin:$PATH"
"#;

#[test]
fn jobs_convert_what_one_command_does() {
    let f = Folder::new("a job's points");
    for east in 0..3 {
        f.write(&format!("{east} e.las"), las_at(150, east));
    }
    f.run_words(&["convert", "0 e.las", "1 e.las", "2 e.las", "-o", "whole.copc.laz"]).code(0);
    let whole = f.read("whole.copc.laz");
    let job = |engine: &str, output: &str| {
        let words = ["jobs", "0 e.las", "1 e.las", "2 e.las", engine, "--tasks=3", "-o", output, "--", "--threads=1"];
        f.run_words(&words).code(0)
    };
    let slurm = job("--slurm", "s it.copc.laz");
    assert!(slurm.stderr().contains("bash, not sbatch"), "{}", slurm.stderr());
    f.write("job.sh", slurm.bytes());
    shell(&f, &format!("{SLURM}bash job.sh"));
    assert!(f.read("s it.copc.laz") == whole);
    // A task restarted by a cluster: its shard exists, and is kept.
    let share = std::fs::metadata(f.path().join("s it.0001.shard")).unwrap().modified().unwrap();
    shell(&f, "SLURM_ARRAY_TASK_ID=1 bash job.sh");
    assert_eq!(std::fs::metadata(f.path().join("s it.0001.shard")).unwrap().modified().unwrap(), share);
    let lines = job("--cuecmd", "c.copc.laz");
    let merge = lines.stderr().lines().find_map(|l| Some(l.split_once("done: ")?.1.to_owned())).unwrap();
    shell(&f, &format!("{}{merge}", lines.stdout()));
    assert!(f.read("c.copc.laz") == whole);
    // Command of the pod that waits for the files of the others.
    let k8s: serde_json::Value = job("--k8s", "k.copc.laz").json();
    let command = |item: usize, index: &str| -> Vec<String> {
        let words = k8s["items"][item]["spec"]["template"]["spec"]["containers"][0]["command"].as_array().unwrap();
        let text = |word: &serde_json::Value| word.as_str().unwrap().replace("$(JOB_COMPLETION_INDEX)", index);
        words.iter().map(|word| text(word).replace("$$", "$")).collect()
    };
    let pod = |words: Vec<String>| {
        let quoted: String = words.iter().map(|word| format!("'{}' ", word.replace('\'', r"'\''"))).collect();
        quoted
    };
    let tasks: String = ["1", "2", "0"].map(|i| format!("{}\n", pod(command(0, i)))).concat();
    shell(&f, &format!("{} &\n{tasks}wait $!\n", pod(command(1, ""))));
    assert!(f.read("k.copc.laz") == whole);
}

#[test]
fn jobs_draw_what_one_command_does() {
    let f = Folder::new("a job's");
    scene(&f, [24, 18], "{}");
    let text = |run: Run| run.code(0).stdout();
    shell(&f, &text(f.run("jobs scene.json --frames 5 --tasks 2 --cuecmd -o f{frame}.exr")));
    f.run("scene.json --turntable --frames 5 -o r{frame}.exr").code(0);
    for i in 0..5 {
        assert_eq!(f.read(&format!("f000{i}.exr")), f.read(&format!("r000{i}.exr")), "frame {i}");
    }
    // Slurm's array, and the job that waits for it.
    f.write("tiles.sh", f.run("jobs scene.json --tiles 3 --slurm -o s.exr").code(0).bytes());
    shell(&f, &format!("{SLURM}bash tiles.sh"));
    f.run("scene.json -o once.exr").code(0);
    assert_eq!(f.read("s.exr"), f.read("once.exr"));
    std::fs::remove_file(f.path().join("once.exr")).unwrap();
    let run = f.run("jobs scene.json --tiles 4 --cuecmd -o whole.exr -- --cutoff 1.5").code(0);
    let stitch = run.stderr().lines().find_map(|l| Some(l.split_once("done: ")?.1.to_owned())).unwrap();
    shell(&f, &format!("{}{stitch}", run.stdout()));
    f.run("scene.json --cutoff 1.5 -o once.exr").code(0);
    assert_eq!(f.read("whole.exr"), f.read("once.exr"));
    // Slurm's script, as run by its second task.
    let slurm = text(f.run("jobs scene.json --frames 5 --tasks 5 --slurm -o s{frame}.exr"));
    shell(&f, &format!("export SLURM_ARRAY_TASK_ID=1\n{slurm}"));
    assert!(f.has("s0001.exr") && !f.has("s0000.exr"));
    f.run("jobs scene.json --frames 5").fails(2, "--openjd");
    f.run("jobs scene.json --frames 5 --slurm --k8s").fails(2, "--k8s");
}
