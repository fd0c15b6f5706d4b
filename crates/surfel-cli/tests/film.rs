//! Films: turntables, camera paths and sequences as APNG, GIF and MP4.

use crate::common::{Folder, ball, points};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::process::Command;

/// Pixels of a frame: sRGB-encoded RGBA.
type Pixels = Vec<u8>;

/// Returns the frames of a PNG, which may be animated, and the delay of the first frame: a fraction of a second as
/// numerator and denominator. The delay is `None` without animation.
fn png_frames(path: &Path) -> (Vec<Pixels>, Option<(u16, u16)>) {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let info = reader.info();
    let bytes = 4 * (info.width * info.height) as usize;
    let count = info.animation_control.map_or(1, |control| control.num_frames);
    let mut delay = None;
    let frame = |_| {
        let mut pixels = vec![0; bytes];
        reader.next_frame(&mut pixels).unwrap();
        delay = delay.or_else(|| reader.info().frame_control.map(|c| (c.delay_num, c.delay_den)));
        pixels
    };
    ((0..count).map(frame).collect(), delay)
}

/// Returns the frames of a GIF, each with its delay in hundredths of a second.
fn gif_frames(path: &Path) -> Vec<(Pixels, u16)> {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(BufReader::new(File::open(path).unwrap())).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        frames.push((frame.buffer.to_vec(), frame.delay));
    }
    frames
}

/// Returns the root mean square of the difference of two frames, in levels.
fn rmse(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (square / a.len() as f64).sqrt()
}

/// Returns `count` points at random places on an ellipsoid, as XYZ. Different seeds give different points.
fn sampled(count: usize, seed: u64) -> String {
    let mut random = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 40) as f64 / f64::from(1 << 24)
    };
    let mut point = || {
        let (z, a) = (2.0 * next() - 1.0, std::f64::consts::TAU * next());
        let r = (1.0 - z * z).sqrt();
        format!("{} {} {}\n", r * a.cos(), r * a.sin(), 0.7 * z)
    };
    (0..count).map(|_| point()).collect()
}

/// Returns a camera path of three keys around the origin. `times` has the times of the keys, separated by spaces, or
/// nothing.
fn keys(times: &str) -> String {
    let key = |eye: &str, time: &str| {
        format!(
            r#"{{"camera": {{"eye": [{eye}], "target": [0,0,0], "up": [0,0,1],
                "projection": {{"perspective": {{"fov_y_deg": 30}}}}, "size": [40, 30]}}{time}}}"#
        )
    };
    let times: Vec<String> = times.split_whitespace().map(|time| format!(", \"time\": {time}")).collect();
    let time = |i: usize| times.get(i).map_or("", String::as_str);
    let all = [key("5,0,1", time(0)), key("0,5,2", time(1)), key("-5,0,1", time(2))];
    format!(r#"{{"keys": [{}]}}"#, all.join(", "))
}

#[test]
fn films_have_the_frames_of_numbered_images() {
    let f = Folder::new("film");
    f.write("a.ply", ball());
    let turn = "render a.ply --turntable --frames 5 --size 40x31 -o";
    f.run(&format!("{turn} f{{frame}}.png")).code(0);
    let said = f.run(&format!("{turn} turn.apng")).code(0).stderr();
    assert!(said.contains("turn.apng: 5 frames, 0.2 s at 25 a second, encoded by Surfel as animated PNG"), "{said}");
    let stills: Vec<Pixels> = (0..5).flat_map(|i| png_frames(&f.path().join(format!("f000{i}.png"))).0).collect();
    let (frames, delay) = png_frames(&f.path().join("turn.apng"));
    assert!(frames == stills && delay == Some((1, 25)));
    // Delays are hundredths of a second, whose rounding doesn't add up.
    f.run(&format!("{turn} turn.gif --fps 8")).code(0);
    let found = gif_frames(&f.path().join("turn.gif"));
    assert_eq!(found.iter().map(|(_, delay)| *delay).collect::<Vec<_>>(), [13, 12, 13, 12, 13]);
    for (i, (frame, _)) in found.iter().enumerate() {
        let nearest = (0..5).min_by(|a, b| rmse(frame, &stills[*a]).total_cmp(&rmse(frame, &stills[*b]))).unwrap();
        assert!(nearest == i && rmse(frame, &stills[i]) < 4.0, "{i}: {}", rmse(frame, &stills[i]));
    }
    // Some of the frames, a film of each input, and what exists already.
    f.run(&format!("{turn} part.apng --frame-range 1-3:2")).code(0);
    assert!(png_frames(&f.path().join("part.apng")).0 == [stills[1].clone(), stills[3].clone()]);
    f.write("b.ply", ball());
    f.run("render a.ply b.ply --turntable --frames 2 --size 9x9 -o {input}.gif").code(0);
    assert!(f.has("a.gif") && f.has("b.gif"));
    f.run(&format!("{turn} turn.apng")).fails(1, "turn.apng: already exists");
    let said = f.run(&format!("{turn} turn.apng --skip-existing")).code(0).stderr();
    assert!(said.contains("exist, so that none is drawn"), "{said}");
    f.run(&format!("{turn} turn.apng --force --background transparent")).code(0);
    assert!(png_frames(&f.path().join("turn.apng")).0[0].chunks(4).any(|pixel| pixel[3] == 0));
    let said = f.run(&format!("{turn} clear.gif --background transparent")).code(0).stderr();
    assert!(said.contains("clear.gif: this format has no transparency"), "{said}");
}

#[test]
fn turntables_and_paths_last_as_long_as_stated() {
    let f = Folder::new("film-length");
    f.write("a.ply", ball());
    let count = |words: &str| {
        let said = f.run(&format!("render a.ply --size 8x8 --force -o o.apng {words}")).code(0).stderr();
        let (before, _) = said.split_once(" frames, ").unwrap_or_else(|| panic!("{said}"));
        before.rsplit(' ').next().unwrap().parse::<u32>().unwrap()
    };
    f.write("timed.json", keys("0 1 3"));
    f.write("plain.json", keys(""));
    assert_eq!(count("--turntable"), 100);
    assert_eq!(count("--turntable --fps 5"), 20);
    assert_eq!(count("--path timed.json --fps 10"), 31);
    assert_eq!(count("--path plain.json --fps 10"), 41);
    assert_eq!(count("--path plain.json --frames 7"), 7);
}

#[test]
fn paths_begin_and_end_at_their_keys() {
    let f = Folder::new("film-path");
    f.write("a.ply", ball());
    f.write("keys.json", keys(""));
    f.run("render a.ply --path keys.json --frames 5 -o p{frame}.png").code(0);
    for (frame, eye) in [(0, "5,0,1"), (2, "0,5,2"), (4, "-5,0,1")] {
        let camera = format!("--eye {eye} --target 0,0,0 --camera-up 0,0,1 --fov-y 30 --size 40x30");
        f.run(&format!("render a.ply {camera} -o key.png --force")).code(0);
        let [found, want] = [format!("p000{frame}.png"), "key.png".to_owned()].map(|n| f.path().join(n));
        // Near planes differ.
        let difference = rmse(&png_frames(&found).0[0], &png_frames(&want).0[0]);
        assert!(difference < 0.5, "{frame}: {difference}");
    }
    f.run("render a.ply --path keys.json --frames 5 -o p.apng").code(0);
    let stills: Vec<Pixels> = (0..5).flat_map(|i| png_frames(&f.path().join(format!("p000{i}.png"))).0).collect();
    assert!(png_frames(&f.path().join("p.apng")).0 == stills);
    f.run("again p0001.png -o again.png").code(0);
    // A key may name a scene file.
    let scene = f.run("render a.ply --view top --size 40x30 --print-scene").code(0).stdout();
    f.write("top.json", scene);
    f.write("named.json", r#"{"keys": [{"camera": "top.json"}, {"camera": "top.json"}]}"#);
    f.run("render a.ply --path named.json --frames 2 -o n{frame}.png").code(0);
    assert!(png_frames(&f.path().join("n0000.png")).0 == png_frames(&f.path().join("n0001.png")).0);
}

/// The light of a sky is stored when a frame is uploaded, so every backend draws it.
#[test]
fn sequences_with_a_sky_are_drawn_by_the_fastest_backend() {
    let f = Folder::new("film-sequence-sky");
    f.write("a.ply", ball());
    f.write("b.ply", ball());
    let said =
        f.run("render a.ply b.ply --sequence --light studio --light-directions 4 --size 24x18 -o a.gif -v").code(0);
    assert!(!said.stderr().contains("'reference'"), "{}", said.stderr());
}

#[test]
fn sequences_share_camera_light_colours_and_radii() {
    let f = Folder::new("film-sequence");
    // A ball that moves, is dimmer and has fewer points in later files.
    for i in 0..4_u32 {
        let point = |k: usize, line: &str| {
            let mut x = line.split(' ').map(|x| x.parse::<f64>().unwrap());
            let [x, y, z] = [(); 3].map(|()| x.next().unwrap());
            let value = 10.0 * f64::from(i) + 0.01 * k as f64 + 0.005;
            format!("{},{y},{z},{value}\n", x + 0.5 * f64::from(i))
        };
        let text = sampled(2000 - 400 * i as usize, 3);
        let rows: String = text.lines().enumerate().map(|(k, line)| point(k, line)).collect();
        f.write(&format!("s{i}.csv"), format!("x,y,z,heat\n{rows}"));
    }
    let words = "render s0.csv s1.csv s2.csv s3.csv --sequence --color-by heat --up +z --points-as balls --size 40x30";
    let said = f.run(&format!("{words} -o s.apng --colorbar bar.png")).code(0).stderr();
    assert_eq!(["heat by viridis", "a point cloud"].map(|words| said.matches(words).count()), [1, 1], "{said}");
    f.run(&format!("{words} -o f{{frame}}.png")).code(0);
    f.run(&format!("{words} -o {{input}}.png")).code(0);
    let stills: Vec<Pixels> = (0..4).flat_map(|i| png_frames(&f.path().join(format!("f000{i}.png"))).0).collect();
    assert!(png_frames(&f.path().join("s.apng")).0 == stills);
    assert!(png_frames(&f.path().join("s3.png")).0[0] == stills[3] && f.has("bar.png"));
    let scenes: Vec<serde_json::Value> = (0..4)
        .map(|i| {
            let image = f.image(&format!("f000{i}.png"));
            let scene = image.metadata.iter().find(|(key, _)| key == "surfel:scene").unwrap();
            let mut scene: serde_json::Value = serde_json::from_str(&scene.1).unwrap();
            assert_eq!(scene["objects"][0]["splats"].take(), format!("s{i}.csv"));
            scene
        })
        .collect();
    assert!(scenes.iter().all(|scene| *scene == scenes[0]), "only the file differs");
    assert!(scenes[0]["objects"][0]["convert"]["range"].is_array());
    let balls = scenes[0]["objects"][0]["convert"]["points_as"].to_string();
    assert!(balls.contains(':') && !balls.contains("px"), "balls of one radius: {balls}");
    f.run("again f0002.png -o again.png").code(0);
    // The scene turns, once over all files.
    f.run(&format!("{words} --turntable -o t.apng")).code(0);
    assert_eq!(png_frames(&f.path().join("t.apng")).0.len(), 4);
    f.write("keys.json", keys(""));
    f.run(&format!("{words} --path keys.json -o p.apng")).code(0);
    assert_eq!(png_frames(&f.path().join("p.apng")).0.len(), 4);
    let scene = f.run(&format!("{words} --print-scene")).code(0).json();
    assert_eq!(scene["camera"], scenes[0]["camera"]);
}

#[test]
fn a_still_surface_that_is_sampled_anew_does_not_flicker() {
    let f = Folder::new("film-still");
    let names: Vec<String> = (0..4).map(|i| format!("s{i}.xyz")).collect();
    names.iter().zip(0..).for_each(|(name, seed)| f.write(name, sampled(40_000, seed)));
    let words = format!("render {} --sequence --size 120x120", names.join(" "));
    // Splats of all frames are blended by one weight.
    let scene = f.run(&format!("{words} --print-scene")).code(0).json();
    let weight = scene["objects"][0]["material"]["interior_weight"].as_f64().unwrap();
    assert!((1.0..20.0).contains(&weight), "{weight}");
    f.run(&format!("{words} -o s.apng")).code(0);
    let (frames, _) = png_frames(&f.path().join("s.apng"));
    let is_inside = |frame: &Pixels, x: i32, y: i32| {
        let at = |x: i32, y: i32| 4 * (120 * y + x) as usize;
        let background = &frame[..4];
        let near = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy)));
        near.into_iter().all(|(x, y)| {
            (0..120).contains(&x) && (0..120).contains(&y) && frame[at(x, y)..at(x, y) + 4] != *background
        })
    };
    for pair in frames.windows(2) {
        let inside: Vec<usize> = (0..120 * 120)
            .filter(|i| pair.iter().all(|frame| is_inside(frame, i % 120, i / 120)))
            .map(|i| 4 * i as usize)
            .collect();
        assert!(inside.len() > 3000);
        let of = |frame: &Pixels| inside.iter().flat_map(|at| frame[*at..at + 3].to_vec()).collect::<Vec<u8>>();
        let difference = rmse(&of(&pair[0]), &of(&pair[1]));
        assert!(difference <= 2.0, "{difference}");
    }
}

#[test]
fn wrong_films_are_refused_and_leave_nothing() {
    let f = Folder::new("film-refused");
    f.write("a.ply", ball());
    f.write("s.json", crate::common::scene(""));
    f.write("keys.json", keys(""));
    f.write("one.json", keys("").replace(", {\"camera\"", "], \"other\": [{\"camera\""));
    f.write("single.json", r#"{"keys": [{"camera": "s.json"}]}"#);
    f.write("unknown.json", keys("").replace("\"fov_y_deg\"", "\"fov\""));
    let before = f.names();
    for (words, code, part) in [
        ("a.ply -o a.gif", 2, "several frames"),
        ("a.ply --turntable --frames 0 -o a.gif", 2, "frames"),
        ("a.ply --turntable -o {frame}.gif", 2, "one film"),
        ("a.ply --turntable -o a.png", 2, "{frame}"),
        ("a.ply --turntable --fps 0 -o a.gif", 2, "0.01"),
        ("a.ply --turntable --fps 60 -o a.gif", 1, "at most 50"),
        ("a.ply --fps 5 -o a.png", 2, "--fps is for films"),
        ("a.ply --turntable --path keys.json -o a.gif", 2, "cannot be used with"),
        ("a.ply --path single.json -o a.gif", 3, "has 1 key"),
        ("a.ply --path one.json -o a.gif", 3, "unknown field `other`"),
        ("a.ply --path unknown.json -o a.gif", 3, "unknown field `fov`"),
        ("a.ply --path none.json -o a.gif", 3, "none.json"),
        ("a.ply --path keys.json --view top -o a.gif", 2, "cannot be used with"),
        ("a.ply s.json --sequence -o a.gif", 2, "s.json: is no frame"),
        ("a.ply a.ply --sequence -o a.png", 2, "--sequence writes several files"),
        ("a.ply none.ply --sequence -o a.gif", 3, "none.ply"),
        ("a.ply --sequence --frames 3 -o a.gif", 2, "cannot be used with"),
        ("a.ply --turntable --shard 0/2 -o a.gif", 2, "--shard is for images"),
        ("a.ply --turntable --planes index -o a.gif", 2, "a film"),
        ("a.ply --turntable --size 70000x1 -o a.gif", 2, "65536"),
        ("a.ply --turntable --frames 1 -o none/a.gif", 1, "no folder"),
    ] {
        f.run(&format!("render {words}")).fails(code, part);
    }
    f.run("a.ply --cameras s.json -o a.gif").parts();
    assert_eq!(f.names(), before);
}

/// Writes a program `ffmpeg` that lists encoders if asked to, and otherwise runs `script`. Returns a PATH with its
/// folder.
#[cfg(unix)]
fn write_ffmpeg(f: &Folder, script: &str) -> String {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::create_dir_all(f.path().join("bin")).unwrap();
    let list = "ffmpeg version 1.2-test Copyright'; echo ' V....D libx264              H.264";
    let text = format!("#!/bin/sh\nif [ \"$1\" = -encoders ]; then echo '{list}'; exit 0; fi\n{script}\n");
    f.write("bin/ffmpeg", text);
    let path = f.path().join("bin/ffmpeg");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    format!("{}:/usr/bin:/bin", f.path().join("bin").display())
}

#[cfg(unix)]
#[test]
fn mp4_needs_ffmpeg_and_tells_why_it_failed() {
    let f = Folder::new("film-ffmpeg");
    f.write("a.ply", ball());
    let words = ["render", "a.ply", "--turntable", "--frames", "3", "--size", "16x16", "-o", "a.mp4"];
    let missing = f.path().join("none").display().to_string();
    f.run_words_with(&words, &[("PATH", &missing)]).fails(1, "install ffmpeg, or write .gif or .apng");
    assert_eq!(f.names(), ["a.ply"]);
    let path = write_ffmpeg(&f, "cat > /dev/null; echo 'no space for frames' >&2; exit 7");
    f.run_words_with(&words, &[("PATH", &path)]).fails(1, "no space for frames");
    assert_eq!(f.names(), ["a.ply", "bin"]);
    let path = write_ffmpeg(&f, "echo 'wrong pixels' >&2; exit 1");
    f.run_words_with(&words, &[("PATH", &path)]).fails(1, "wrong pixels");
    assert_eq!(f.names(), ["a.ply", "bin"]);
    // The last argument is the file.
    let path = write_ffmpeg(&f, "for last; do :; done; cat > \"${last#file:}\"");
    let said = f.run_words_with(&words, &[("PATH", &path)]).code(0).stderr();
    assert!(said.contains("encoded by the installed ffmpeg 1.2-test (libx264)"), "{said}");
    assert_eq!(f.read("a.mp4").len(), 3 * 16 * 16 * 3);
    assert_eq!(f.names(), ["a.mp4", "a.ply", "bin"]);
}

#[cfg(unix)]
#[test]
fn a_signal_ends_ffmpeg_and_leaves_nothing() {
    let f = Folder::new("film-signal");
    f.write("a.ply", ball());
    // It ignores what a terminal sends, and never ends by itself.
    let path = write_ffmpeg(&f, "trap '' INT TERM; echo $$ > pid; while :; do sleep 0.05; done");
    let mut child = f.spawn_with("render a.ply --turntable --frames 9 --size 16x16 -o a.mp4", &[("PATH", &path)]);
    let pid = || f.has("pid").then(|| String::from_utf8(f.read("pid")).unwrap()).filter(|text| text.ends_with('\n'));
    while pid().is_none() {
        assert!(child.try_wait().unwrap().is_none(), "it was never seen encoding");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let pid = pid().unwrap().trim().to_owned();
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    assert!(!child.wait().unwrap().success());
    assert!(!Path::new(&format!("/proc/{pid}")).exists(), "it goes on");
    assert_eq!(f.names(), ["a.ply", "bin", "pid"]);
}

#[test]
fn mp4_is_a_film_of_all_frames() {
    if Command::new("ffprobe").arg("-version").output().is_err() {
        println!("skipped: ffmpeg isn't installed");
        return;
    }
    let f = Folder::new("film-mp4");
    f.write("a.ply", ball());
    f.write("b.xyz", points());
    let turn = "render a.ply --turntable --frames 6 --size 63x48";
    f.run(&format!("{turn} -o f{{frame}}.png")).code(0);
    let said = f.run(&format!("{turn} --fps 12.5 -o a.mp4")).code(0).stderr();
    assert!(said.contains("a.mp4: 6 frames, 0.5 s at 12.5 a second, encoded by the installed ffmpeg"), "{said}");
    let probe = Command::new("ffprobe")
        .current_dir(f.path())
        .args(["-v", "error", "-count_frames", "-show_streams", "a.mp4"])
        .output()
        .unwrap();
    let probe = String::from_utf8_lossy(&probe.stdout).into_owned();
    for part in [
        "codec_name=h264\n",
        "width=64\n",
        "height=48\n",
        "pix_fmt=yuv420p\n",
        "r_frame_rate=25/2\n",
        "nb_read_frames=6\n",
        "color_space=bt709\n",
    ] {
        assert!(probe.contains(part), "{part}: {probe}");
    }
    let raw = ["-v", "error", "-i", "a.mp4", "-f", "rawvideo", "-pix_fmt", "rgba", "-"];
    let raw = Command::new("ffmpeg").current_dir(f.path()).args(raw).output().unwrap().stdout;
    let stills: Vec<Pixels> = (0..6).flat_map(|i| png_frames(&f.path().join(format!("f000{i}.png"))).0).collect();
    for (i, frame) in raw.chunks(64 * 48 * 4).enumerate() {
        // Without the column that makes the width even.
        let frame: Pixels = frame.chunks(64 * 4).flat_map(|row| row[..63 * 4].to_vec()).collect();
        let nearest = (0..6).min_by(|a, b| rmse(&frame, &stills[*a]).total_cmp(&rmse(&frame, &stills[*b]))).unwrap();
        assert!(nearest == i && rmse(&frame, &stills[i]) < 8.0, "{i}: {nearest} {}", rmse(&frame, &stills[i]));
    }
    assert_eq!(raw.len(), 6 * 64 * 48 * 4);
}
