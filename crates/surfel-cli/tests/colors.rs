//! Colouring by values: one range and one legend for everything drawn together, and meshes with their own columns.

use crate::common;

use common::{Folder, scene};
use serde_json::{Value, json};
use surfel_io::Planes;

/// Returns tile `i` of a slope of 60×100 units, which is divided into six by ten tiles, as text with a class per point.
fn tile(i: u32) -> String {
    let mut text = "x,y,z,classification\n".to_owned();
    for k in 0..144 {
        let (x, y) = (i % 6 * 10 + k % 12 * 10 / 12, i / 6 * 10 + k / 12 * 10 / 12);
        text += &format!("{x},{y},{},{}\n", f64::from(x) * 0.5 + f64::from(y) * 0.25, if i < 59 { 2 } else { 9 });
    }
    text
}

/// Returns tile `i` of the same slope as [`tile`], as splats.
fn splat_tile(i: u32) -> String {
    let properties =
        ["x", "y", "z", "nx", "ny", "nz", "radius"].map(|name| format!("property float {name}\n")).concat();
    let mut text =
        format!("ply\nformat ascii 1.0\ncomment shows both sides\nelement vertex 36\n{properties}end_header\n");
    for k in 0..36 {
        let (x, y) = (f64::from(i % 6 * 60 + k % 6 * 10) / 6.0, f64::from(i / 6 * 60 + k / 6 * 10) / 6.0);
        text += &format!("{x} {y} {} -0.436 -0.218 0.873 1.5\n", x * 0.5 + y * 0.25);
    }
    text
}

/// Returns the range given in a command line.
fn range_in(line: &str) -> [f64; 2] {
    let text =
        line.split_whitespace().find_map(|word| word.strip_prefix("--range=")).unwrap_or_else(|| panic!("{line}"));
    let numbers: Vec<f64> = text.split(',').map(|v| v.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

/// Runs one command line of a job.
fn run_task(f: &Folder, line: &str) {
    f.run(&line.split_once("surfel ").unwrap().1.replace('\'', "")).code(0);
}

/// Returns the scene in an image's metadata.
fn scene_of(image: &Planes) -> Value {
    let text = image.metadata.iter().find(|(key, _)| key == "surfel:scene").unwrap();
    serde_json::from_str(&text.1).unwrap()
}

/// True if an image has a pixel with this colour.
fn shows(image: &Planes, levels: [u8; 3]) -> bool {
    let color = image.color.as_ref().unwrap();
    let is = |c: &[f32; 4]| surfel_io::to_srgb8(&[*c])[0][..3] == levels;
    color.iter().any(is)
}

#[test]
fn sixty_tiles_have_one_range_in_one_image_in_tiles_and_in_shards() {
    let f = Folder::new("sixty");
    let names: Vec<String> = (0..60).map(|i| format!("t{i:02}.ply")).collect();
    names.iter().zip(0..).for_each(|(name, i)| f.write(name, splat_tile(i)));
    let inputs = names.join(" ");
    let flags = "--color-by height --up +z --view top --ortho --shader unlit";
    let said = f.run(&format!("{inputs} {flags} --size 60x100 -o whole.png")).code(0).stderr();
    assert_eq!(said.matches("coloured by height by viridis from").count(), 1, "{said}");
    assert!(said.contains("the 2nd to the 98th percentile of all 60 files"), "{said}");
    // The job states the range, and its tiles equal the corresponding parts of the image.
    let job = |rest: &str| f.run(&format!("jobs {inputs} --cuecmd {rest}")).code(0).stdout();
    let tiles = job(&format!("--tiles 2 -o by-tiles.png -- {flags} --size 60x100 --colorbar"));
    let range = range_in(&tiles);
    // 2 % of heights that are distributed evenly over x and y, 0 to 54.
    assert!(range[0] > 3.0 && range[0] < 6.0 && range[1] > 46.0 && range[1] < 51.0, "{range:?}");
    assert!(f.has("by-tiles-colorbar.png") && !tiles.contains("--colorbar"), "{tiles}");
    for line in tiles.lines() {
        assert_eq!(range_in(line), range);
        run_task(&f, line);
    }
    f.run("stitch by-tiles.0000.png by-tiles.0001.png -o by-tiles.png").code(0);
    assert!(f.image("by-tiles.png").color == f.image("whole.png").color);
    // Frames of shards have the same range, too.
    let frames = job(&format!("--frames 3 --tasks 2 -o s{{frame}}.png -- {flags} --size 30x50"));
    for line in frames.lines() {
        assert_eq!(range_in(line), range);
        run_task(&f, line);
    }
    f.run(&format!("{inputs} {flags} --size 30x50 --turntable --frames 3 -o w{{frame}}.png")).code(0);
    assert!((0..3).all(|i| f.image(&format!("s{i:04}.png")).color == f.image(&format!("w{i:04}.png")).color));
    // With a given range the files aren't read, so they needn't exist here.
    let given =
        f.run(&format!("jobs not-here.csv --cuecmd --tiles 1 -o x.png -- {flags} --range=1,2")).code(0).stdout();
    assert_eq!(range_in(&given), [1.0, 2.0]);
    f.run(&format!("jobs not-here.csv --cuecmd --tiles 1 -o x.png -- {flags}"))
        .fails(3, "--range LO,HI says the range");
}

#[test]
fn images_of_one_input_each_share_a_range_if_asked_to() {
    let f = Folder::new("shared-range");
    for i in [0, 59] {
        f.write(&format!("t{i:02}.csv"), tile(i));
    }
    let flags = "t00.csv t59.csv --color-by height --up +z --view top --size 16x16";
    let range = |name: &str| scene_of(&f.image(name))["objects"][0]["convert"]["range"].clone();
    f.run(&format!("{flags} -o alone-{{input}}.png")).code(0);
    assert_eq!((range("alone-t00.png"), range("alone-t59.png")), (Value::Null, Value::Null));
    f.run(&format!("{flags} --range shared --colorbar -o {{input}}.png")).code(0);
    assert_eq!(range("t00.png"), range("t59.png"));
    let [lo, hi] = [0, 1].map(|k| range("t00.png")[k].as_f64().unwrap());
    assert!(lo < 2.0 && hi > 50.0, "{lo} {hi}");
    assert_eq!(f.read("t00-colorbar.png"), f.read("t59-colorbar.png"));
    assert!(f.image("t00.png").color != f.image("alone-t00.png").color);
    // The range doesn't depend on which inputs a run draws.
    f.run(&format!("{flags} --range shared --shard 1/2 -o part-{{input}}.png")).code(0);
    assert_eq!((range("part-t59.png"), f.has("part-t00.png")), (range("t59.png"), false));
    assert!(f.run("again t59.png -o again.png").code(0).stderr().contains("the same image"));
    let job =
        f.run(&format!("jobs t00.csv t59.csv --cuecmd --tasks 2 -o {{input}}.png -- {} --range shared", &flags[16..]));
    let job = job.code(0).stdout();
    assert!(job.lines().all(|line| range_in(line) == [lo, hi]) && !job.contains("=shared"), "{job}");
    f.run("t00.csv --range shared -o x.png").fails(2, "give --color-by ATTRIBUTE");
    f.run("t00.csv --color-by height --range 3 -o x.png").fails(2, "or shared");
}

#[test]
fn legends_hold_the_classes_of_all_inputs_with_their_names() {
    let f = Folder::new("legend");
    for i in [0, 59] {
        f.write(&format!("t{i:02}.csv"), tile(i));
    }
    let (ground, water) = ([201, 174, 130], [60, 140, 230]);
    let both = |bar: &str| {
        let bar = f.image(bar);
        assert!(shows(&bar, ground) && shows(&bar, water) && bar.width > 100 && bar.height > 80);
    };
    let said = f.run("t00.csv t59.csv --color-by classification --colorbar -o two.png --size 16x16").code(0).stderr();
    assert!(said.contains("(2 ground 144, 9 water 144)") && !said.contains("colour bar shows"), "{said}");
    both("two-colorbar.png");
    let each = "t00.csv t59.csv --color-by classification --colorbar --range shared -o e-{input}.png --size 16x16";
    f.run(each).code(0);
    both("e-t00-colorbar.png");
    let ortho = "ortho t00.csv t59.csv --gsd 1";
    let said = f.run(&format!("{ortho} --color-by classification --colorbar -o c.tif")).code(0).stderr();
    assert!(said.contains("(2 ground 144, 9 water 144)"), "{said}");
    both("c-colorbar.png");
    let said = f.run(&format!("{ortho} --color-by height -o h.tif")).code(0).stderr();
    assert!(said.contains("coloured by height") && said.contains("percentile of all 2 files"), "{said}");
    // Files without colours are coloured by height, with one range.
    let said = f.run(&format!("{ortho} -o o.tif")).code(0).stderr();
    assert!(said.contains("coloured by height") && said.contains("of all 2 files"), "{said}");
}

#[test]
fn a_large_file_by_levels_has_one_range_for_all_views_and_tiles() {
    let f = Folder::new("levels-range");
    f.write("in.las", common::las_at(400, 0));
    f.run("convert in.las -o out.copc.laz").code(0);
    let views = [
        "--eye 600020,4999940,160 --target 600020,5000020,100 --fov-y 40",
        "--eye 600005,4999990,104 --target 600005,5000000,100 --fov-y 40",
    ];
    let range = |flags: &str, i: usize| {
        let flags = format!("{flags} --color-by height --size 40x30 --colorbar {i}.png -o i{i}.png -f");
        let said = f.run(&format!("out.copc.laz {flags}")).code(0).stderr();
        assert!(said.contains("drawn by levels"), "{said}");
        said.lines().find(|line| line.contains("coloured by height")).unwrap().to_owned()
    };
    let ranges = [range(views[0], 0), range(views[1], 1), range(&format!("{} --tile 0/3", views[0]), 2)];
    assert!(ranges[0] == ranges[1] && ranges[0] == ranges[2], "{ranges:?}");
    assert!(f.read("0.png") == f.read("1.png") && f.read("0.png") == f.read("2.png"));
    let job = f.run(&format!("jobs out.copc.laz --cuecmd --tiles 2 -o j.png -- --color-by height {}", views[1]));
    let [lo, hi] = range_in(&job.code(0).stdout());
    assert!(lo > 97.0 && lo < 98.5 && hi > 101.5 && hi < 103.0, "{lo} {hi}");
}

/// Returns a sheet of 10×10 quads as PLY. Vertices have a measurement `temp` and a class `kind`; faces have a part
/// number `part` and a measurement `temp`.
fn sheet() -> String {
    let mut text = "ply\nformat ascii 1.0\nelement vertex 121\nproperty float x\nproperty float y\nproperty float z\n\
                    property float temp\nproperty uchar kind\nelement face 100\n\
                    property list uchar int vertex_indices\nproperty ushort part\nproperty float temp\nend_header\n"
        .to_owned();
    for i in 0..121 {
        let (x, y) = (i % 11, i / 11);
        text += &format!("{x} {y} 0 {} {}\n", f64::from(x) + 0.25, if x < 5 { 3 } else { 7 });
    }
    for i in 0..100 {
        let a = i / 10 * 11 + i % 10;
        text += &format!("4 {a} {} {} {} {} {}\n", a + 1, a + 12, a + 11, i / 10 % 4, -i);
    }
    text
}

#[test]
fn meshes_are_coloured_and_labelled_by_their_own_columns() {
    let f = Folder::new("mesh-columns");
    f.write("m.ply", sheet());
    // Splats with their colours and columns.
    let rows = |flags: &str| {
        let said = f.run(&format!("convert m.ply -o o.ply --ascii --force {flags}")).code(0).stderr();
        let text = String::from_utf8(f.read("o.ply")).unwrap();
        let (header, rows) = text.split_once("end_header\n").unwrap();
        let names = header.lines().filter_map(|l| l.strip_prefix("property ")?.split(' ').next_back());
        let names: Vec<String> = names.map(str::to_owned).collect();
        let rows = rows.lines().map(|row| row.split(' ').map(|v| v.parse::<f64>().unwrap()).collect::<Vec<_>>());
        let of = move |row: &[f64], name: &str| row[names.iter().position(|n| n == name).unwrap()];
        (rows.collect::<Vec<_>>(), of, said)
    };
    for flags in ["", "--per-face", "--per-vertex", "--splats 900"] {
        let (all, of, _) = rows(flags);
        for row in &all {
            let (x, y) = (of(row, "x"), of(row, "y"));
            assert!((of(row, "temp") - x - 0.25).abs() < 1e-3, "{flags}: {row:?}");
            if (x - 4.5).abs() > 0.01 {
                assert_eq!(of(row, "kind"), if x < 4.5 { 3.0 } else { 7.0 }, "{flags}: {row:?}");
            }
            let is_inside = [x, y].iter().all(|v| (v - v.round()).abs() > 1e-3);
            if flags != "--per-vertex" && is_inside {
                assert_eq!(of(row, "part"), y.floor() % 4.0, "{flags}: {row:?}");
                assert_eq!(of(row, "face_temp"), -(y.floor() * 10.0 + x.floor()), "{flags}: {row:?}");
            }
        }
    }
    let (all, of, said) = rows("--color-by temp --range 0.25,10.25 --colormap grey");
    assert!(said.contains("coloured by temp by grey from 0.2500 to 10.25"), "{said}");
    let level = |x: f64| (x / 10.0 * 256.0).floor().min(255.0);
    assert!(all.iter().all(|row| (of(row, "red") - level(of(row, "x"))).abs() <= 1.0));
    // Categories aren't interpolated.
    let (_, _, said) = rows("--color-by kind");
    assert!(said.contains("coloured by kind (3: ") && said.contains(", 7: ") && !said.contains("4: "), "{said}");
    let (_, _, said) = rows("--color-by part");
    assert!(said.contains("coloured by part (0: ") && said.contains("3: "), "{said}");
    let info = f.run("info m.ply --json").code(0).json();
    assert_eq!(info["attributes"]["temp"], json!({"type": "float", "min": 0.25, "max": 10.25, "of": "vertices"}));
    assert_eq!(info["attributes"]["part"], json!({"type": "ushort", "min": 0.0, "max": 3.0, "of": "faces"}));
    assert_eq!(info["attributes"]["face_temp"]["of"], "faces");
    let text = f.run("info m.ply").code(0).stdout();
    assert!(text.contains("temp: float, 0.25 to 10.25, of vertices") && text.contains("face_temp: float"), "{text}");
    // Label planes from vertices and from faces.
    let labels = |attribute: &str| {
        let view = "--view top --ortho --up +z --size 20x20";
        f.run(&format!("m.ply --label {attribute} {view} -o l.exr -f")).code(0);
        let planes = f.image("l.exr");
        let mut found = planes.whole.iter().find(|(name, _)| name == "label").unwrap().1.clone();
        found.sort_unstable();
        found.dedup();
        found.retain(|label| *label != u32::MAX);
        found
    };
    assert_eq!((labels("kind"), labels("part")), (vec![3, 7], vec![0, 1, 2, 3]));
    f.run("m.ply --label temp -o l.exr -f").fails(3, "expected whole numbers");
    f.run("m.ply --color-by pressure -o x.png")
        .fails(2, "no attribute 'pressure' but height, normal, temp, kind, part");
}

#[test]
fn classes_are_left_out_and_conditions_are_joined() {
    let f = Folder::new("conditions");
    let mut text = "x,y,z,classification,intensity\n".to_owned();
    for i in 0..400 {
        text += &format!("{},{},0,{},{i}\n", i % 20, i / 20, [2, 6, 7, 18][i % 4]);
    }
    f.write("a.csv", text);
    let left = |words: &[&str]| {
        f.run_words(&[&["convert", "a.csv", "-o", "o.ply", "-f"][..], words].concat()).code(0);
        f.run("info o.ply --json").code(0).json()["splats"].as_u64().unwrap()
    };
    assert_eq!(left(&["--classes", "!7,18"]), 200);
    assert_eq!((left(&["--classes=all"]), left(&["--classes", "7, 18"])), (400, 200));
    assert_eq!(left(&["--where", "intensity<100 or intensity>=380"]), 120);
    assert_eq!(left(&["--where", "!(intensity<100 || classification=2) && y<10"]), 75);
    assert_eq!(left(&["--where", "intensity<100 or intensity>=380", "--where", "x<10"]), 60);
    f.write("c.toml", "where = ['intensity<100 or intensity>=380', 'x<10']\nclasses = '!7'\n");
    assert_eq!(left(&["--config", "c.toml"]), 48);
    let object = r#""a.csv", "convert": {"classes": "!7,18", "where": ["intensity<100 or x=0", "not y>10"]}"#;
    f.write("s.json", scene("").replace("\"a.ply\"", object));
    // 50 of the first hundred, and the first columns of 6 other rows; all are of class 2.
    assert_eq!(f.run("s.json --stats").code(0).json()["splats"], 56);
    assert_eq!(f.run_words(&["s.json", "--stats", "--where", "x=0"]).code(0).json()["splats"], 20);
    let said =
        f.run_words(&["ortho", "a.csv", "--gsd", "1", "-o", "o.tif", "--classes", "!7,18", "--where", "not x<1"]);
    assert!(said.code(0).stderr().contains("--classes leaves 200, --where leaves 180"));
    for (words, part) in [
        (["--where", "intensity>1 and (x<2"], "ends after character 20, expected 'and', 'or' or ')'"),
        (["--where", "intensity>1 x<2"], "has 'x<2' at character 13"),
        (["--classes", "2,!7"], "'!7,18' for all but these"),
    ] {
        f.run_words(&[&["a.csv", "-o", "x.png"][..], &words[..]].concat()).fails(2, part);
    }
}

#[test]
fn lights_without_a_shader_are_noted_and_values_are_spelled_as_flags() {
    let f = Folder::new("unlit-lights");
    f.write("a.ply", common::ball());
    let lit = |settings: &str| {
        let lights = r#""lights": [{"directional": {"direction": [0, 0, -1], "color": [1, 1, 1]}}], "objects""#;
        f.write("s.json", scene(settings).replacen("\"objects\"", lights, 1));
    };
    let is_noted = |flags: &str| {
        let said = f.run(&format!("s.json -o s.png -f {flags}")).code(0).stderr();
        said.contains("s.json: has lights, but settings.shader is not given, so that it is drawn unlit")
    };
    lit("\"filter\": \"ewa\"");
    assert!(is_noted("") && !is_noted("--shader phong") && !is_noted("--shader unlit"));
    assert!(!f.run("again s.png -o t.png").code(0).stderr().contains("has lights"));
    lit("\"shader\": \"unlit\"");
    assert!(!is_noted(""));
    lit("\"shader\": \"phong\", \"edge_aa\": \"on\", \"depth_tolerance\": \"abs:0.5\"");
    assert!(!is_noted(""));
    let file = f.read("s.json");
    f.run("s.json -o on.exr -f").code(0);
    lit("\"shader\": \"phong\", \"edge_aa\": true, \"depth_tolerance\": {\"absolute\": 0.5}");
    assert_ne!(f.read("s.json"), file);
    f.run("s.json -o true.exr -f").code(0);
    assert_eq!(f.read("on.exr"), f.read("true.exr"));
    f.write("n.json", scene("\"shader\": \"phong\""));
    assert!(!f.run("n.json -o n.png").code(0).stderr().contains("has lights"));
}
