//! Attributes: selection of points, and colouring of splats.

use crate::common;

use common::{Folder, cube, scene};
use serde_json::json;

/// Returns a grid of 20 × 20 points whose classes, returns and intensities depend on row and column.
fn grid() -> String {
    let mut text = "x,y,z,intensity,classification,return_number,number_of_returns\n".to_owned();
    for i in 0..400 {
        let (x, y) = (i % 20, i / 20);
        let class = if x < 10 { 2 } else { 6 };
        text += &format!("{x},{y},{},{},{class},{},{}\n", x / 10, x * 10, 1 + y % 2, 1 + i / 200);
    }
    text
}

#[test]
fn points_are_chosen_in_order_and_the_counts_are_said() {
    let f = Folder::new("choose");
    f.write("a.csv", grid());
    let left = |flags: &[&str]| {
        let words = ["convert", "a.csv", "-o", "o.ply", "--force"];
        let run = f.run_words(&[&words[..], flags].concat()).code(0);
        let count = f.run("info o.ply --json").code(0).json()["splats"].as_u64().unwrap();
        (count, run.stderr())
    };
    assert_eq!(left(&[]).0, 400);
    assert_eq!(left(&["--crop", "-1,0,0,4.5,19,1"]).0, 100);
    assert_eq!(left(&["--classes", "2,7"]).0, 200);
    assert_eq!(left(&["--returns", "last"]).0, 200);
    assert_eq!(left(&["--returns", "first"]).0, 200);
    assert_eq!(left(&["--returns", "single"]).0, 200);
    assert_eq!(left(&["--where", "intensity>150 and y<10"]).0, 40);
    assert_eq!(left(&["--every", "3"]).0, 134);
    let all = ["--crop", "0,0,0,14,19,1", "--classes", "6", "--returns", "first", "--where", "intensity>=120"];
    let (count, said) = left(&[&all[..], &["--every", "4"]].concat());
    assert_eq!(count, 8);
    let expected = "chose 8 of 400 points: --crop leaves 300, --classes leaves 100, --returns leaves 50, ".to_owned()
        + "--where leaves 30, --every leaves 8";
    assert!(said.contains(&expected), "{said}");
    // Isolated points: two strays, dropped by the flag and by a scene file's key.
    f.write("s.csv", grid() + "9,9,500,0,2,1,1\n-1e8,0,0,0,2,1,1\n");
    let strays = |flags: &str| {
        let run = f.run(&format!("convert s.csv -o t.ply --force {flags}")).code(0);
        let counts = f.run("info t.ply --json").code(0).json()["splats"].as_u64().unwrap();
        (counts, run.stderr())
    };
    assert_eq!(strays("").0, 402);
    assert_eq!(strays("--outliers keep").0, 402);
    let (count, said) = strays("--outliers drop");
    assert_eq!(count, 400);
    assert!(said.contains("left out 2 of 402 points as outliers: they are more than 8 times"), "{said}");
    f.write("o.json", scene("").replace("\"a.ply\"", "\"s.csv\", \"convert\": {\"outliers\": \"drop\"}"));
    assert_eq!(f.run("o.json --stats").code(0).json()["splats"], 400);
    assert_eq!(f.run("o.json --stats --outliers keep").code(0).json()["splats"], 402);
    // The same selections of splats, by the extra columns that convert preserves.
    left(&[]);
    f.run("convert o.ply --classes 6 -o p.ply").code(0);
    assert_eq!(f.run("info p.ply --json").code(0).json()["splats"], 200);
    // And by a scene file's keys.
    let convert = json!({"classes": [6], "where": "intensity < 150", "every": 2});
    f.write("s.json", scene("").replace("\"a.ply\"", &format!("\"a.csv\", \"convert\": {convert}")));
    assert_eq!(f.run("s.json --stats").code(0).json()["splats"], 50);
    assert_eq!(f.run("s.json --every 1 --stats").code(0).json()["splats"], 100);
}

#[test]
fn what_can_not_be_chosen_is_one_clear_error() {
    let f = Folder::new("choose-wrong");
    f.write("a.csv", grid());
    f.write("b.obj", cube());
    f.write("p.xyz", common::points());
    let fails = |words: &[&str], code: i32, part: &str| {
        f.run_words(&[words, &["-o", "o.png", "--size", "8x8"]].concat()).fails(code, part);
        assert!(!f.has("o.png"));
    };
    fails(&["a.csv", "--classes", "9"], 3, "of its 400 points none is left: --classes leaves 0");
    fails(&["a.csv", "--crop", "50,0,0,60,1,1"], 3, "they are within 0,0,0,19,19,1");
    fails(&["p.xyz", "--classes", "2"], 3, "has no attribute 'classification', which classes needs: it has x, y, z");
    fails(&["a.csv", "--where", "gps>1"], 3, "'gps', which where needs: it has x, y, z, intensity, classification");
    fails(&["a.csv", "--where", "intensity"], 2, "ends after character 9, expected one of < <= > >= = !=");
    fails(&["a.csv", "--crop", "1,0,0,0,1,1"], 2, "X0 at most X1");
    fails(&["a.csv", "--returns", "second"], 2, "last");
    fails(&["b.obj", "--classes", "2"], 2, "holds a mesh, expected points or splats for --classes");
    fails(&["b.obj", "--outliers", "drop"], 2, "holds a mesh, expected points for --outliers");
    fails(
        &["a.csv", "--color-by", "temperature"],
        2,
        "no attribute 'temperature' but height, normal, intensity, classification",
    );
    fails(
        &["b.obj", "--color-by", "intensity"],
        2,
        "holds no attribute 'intensity' but height, normal, expected one of these",
    );
    fails(&["a.csv", "--colormap", "turbo"], 2, "give --color-by ATTRIBUTE");
    fails(&["a.csv", "--color-by", "height", "--range", "3,3"], 2, "LO less than HI");
    fails(&["a.csv", "--color-by", "normal", "--colorbar", "bar.png"], 2, "no file is coloured by one");
    f.write("s.json", scene("").replace("\"a.ply\"", "\"a.csv\", \"convert\": {\"where\": \"z\"}"));
    fails(&["s.json"], 3, "objects[0].convert.where");
}

/// Returns the colours of a file's splats as sRGB levels.
fn levels(f: &Folder, file: &str) -> Vec<[u8; 3]> {
    let text = String::from_utf8(f.read(file)).unwrap();
    let (header, rows) = text.split_once("end_header\n").unwrap();
    let names = header.lines().filter_map(|l| l.strip_prefix("property "));
    let names: Vec<&str> = names.map(|l| l.split(' ').next_back().unwrap()).collect();
    assert!(header.contains("property uchar red"), "{header}");
    let at = ["red", "green", "blue"].map(|c| names.iter().position(|n| *n == c).unwrap());
    let rows = rows.lines().map(|row| row.split(' ').collect::<Vec<_>>());
    rows.map(|row| at.map(|i| row[i].parse().unwrap())).collect()
}

#[test]
fn splats_have_the_colours_of_their_values_in_convert_and_render() {
    let f = Folder::new("color-by");
    f.write("a.csv", grid());
    let convert = |flags: &str| {
        let said = f.run(&format!("convert a.csv -o o.ply --ascii --force --color-by {flags}")).code(0).stderr();
        (levels(&f, "o.ply"), said)
    };
    let (colors, said) = convert("intensity --range 0,190 --colormap viridis");
    assert_eq!((colors[0], colors[19]), ([68, 1, 84], [253, 231, 37]));
    assert!(said.contains("coloured by intensity by viridis from 0 to 190"), "{said}");
    let (colors, said) = convert("intensity --colormap grey");
    assert_eq!((colors[0], colors[19]), ([0; 3], [255; 3]));
    assert!(said.contains("from 0 to 190, the 2nd to the 98th percentile"), "{said}");
    let (colors, said) = convert("classification");
    assert_eq!((colors[0], colors[19]), ([201, 174, 130], [225, 80, 70]), "ground and building");
    assert!(said.contains("2 ground 200, 6 building 200"), "{said}");
    let (colors, _) = convert("return_number");
    assert_eq!((colors[0], colors[20]), ([174, 199, 232], [255, 127, 14]), "1 and 2 of tab20");
    let (colors, said) = convert("height --colormap coolwarm");
    assert_eq!((colors[0], colors[19]), ([59, 76, 192], [180, 4, 38]));
    assert!(said.contains("coloured by height"), "{said}");
    // Drawn and written colours agree, and `again` draws the same image.
    f.run("convert a.csv --color-by classification -o c.ply").code(0);
    f.run("c.ply -o c.exr --size 32x32 --exr-f32 --up +z").code(0);
    f.run("a.csv --color-by classification -o d.exr --size 32x32 --exr-f32 --up +z").code(0);
    assert!(f.image("c.exr").color == f.image("d.exr").color);
    f.run("a.csv --color-by intensity --colormap turbo --range 10,90 --classes 6 -o e.png --size 32x32").code(0);
    let said = f.run("again e.png").code(0).stderr();
    assert!(said.contains("the same image as e.png, to the bit"), "{said}");
    let printed = f.run("a.csv --color-by height --range -1,2 --print-scene").code(0).json();
    assert_eq!(printed["objects"][0]["convert"], json!({"color_by": "height", "range": [-1.0, 2.0]}));
    // A mesh has heights and normals, too.
    f.write("b.obj", cube());
    f.run("b.obj --color-by height --per-face -o b.png --size 8x8").code(0);
    f.run("b.obj --color-by normal --per-face -o n.png --size 8x8").code(0);
    assert!(f.image("b.png").color != f.image("n.png").color);
    // Of two files, the one without the attribute is grey, which isn't an error.
    f.write("p.xyz", common::points());
    f.run("a.csv p.xyz --color-by intensity -o two.png --size 8x8").code(0);
}

#[test]
fn the_color_bar_is_an_image_of_its_own() {
    let f = Folder::new("color-bar");
    f.write("a.csv", grid());
    f.run("a.csv --color-by intensity --colormap turbo --colorbar bar.png -o a.png --size 8x8").code(0);
    f.run("convert a.csv --color-by classification --colorbar classes.png -o a.ply").code(0);
    let bar = f.image("bar.png");
    assert!(bar.width > 60 && bar.height > 120, "{}x{}", bar.width, bar.height);
    let classes = f.image("classes.png");
    assert!(classes.height > 80 && classes.width > 100, "{}x{}", classes.width, classes.height);
    f.run("a.csv --color-by intensity --colorbar bar.png -o b.png --size 8x8").fails(1, "bar.png");
    // The default name is beside the image.
    f.run("--color-by intensity --colormap turbo --colorbar a.csv --size 8x8 --force").code(0);
    assert_eq!(f.read("a-colorbar.png"), f.read("bar.png"));
    f.write("b.csv", grid());
    f.run("a.csv b.csv --color-by intensity --colormap turbo --colorbar -o of-{input}.png --size 8x8").code(0);
    assert!(["of-a-colorbar.png", "of-b-colorbar.png"].iter().all(|bar| f.read(bar) == f.read("bar.png")));
    f.write("c.toml", "colorbar = true\ncolor-by = 'intensity'\ncolormap = 'turbo'\n");
    f.run("--config c.toml a.csv -o asked.png --size 8x8").code(0);
    assert_eq!(f.read("asked-colorbar.png"), f.read("bar.png"));
    f.run("a.csv --color-by intensity --colorbar -o - --size 8x8").fails(2, "--colorbar=FILE.png");
}

/// Encodes a LAS 1.2 file of a plane of 40×40 points, 0.5 apart, in millimetres from 640,000 and 9,990,000. Its
/// reference system is given by `text`, or else by GeoTIFF keys.
fn las_with_system(text: Option<&str>) -> Vec<u8> {
    let records: Vec<(u16, Vec<u8>)> = match text {
        Some(text) => vec![(2112, format!("{text}\0").into_bytes())],
        None => {
            let keys = [1_u16, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 32_733, 3073, 34_737, 8, 0];
            let keys = keys.iter().flat_map(|key| key.to_le_bytes()).collect();
            vec![(34_735, keys), (34_737, b"Zone 33|\0".to_vec())]
        }
    };
    let mut bytes = vec![0; 227];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 2]);
    bytes[94..96].copy_from_slice(&227_u16.to_le_bytes());
    bytes[100..104].copy_from_slice(&(records.len() as u32).to_le_bytes());
    bytes[105..107].copy_from_slice(&20_u16.to_le_bytes());
    bytes[107..111].copy_from_slice(&1600_u32.to_le_bytes());
    for (k, (offset, extent)) in [(640_000.0, 19.501), (9_990_000.0, 19.501), (0.0, 100.0)].into_iter().enumerate() {
        let mut put = |at: usize, v: f64| bytes[at..at + 8].copy_from_slice(&v.to_le_bytes());
        put(131 + 8 * k, 0.001);
        put(155 + 8 * k, offset);
        put(179 + 16 * k, offset + extent);
        put(187 + 16 * k, offset + if k == 2 { 100.0 } else { 0.001 });
    }
    for (id, data) in records {
        let mut record = vec![0; 54];
        record[2..17].copy_from_slice(b"LASF_Projection");
        record[18..20].copy_from_slice(&id.to_le_bytes());
        record[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        bytes.extend(record.into_iter().chain(data));
    }
    let start = bytes.len() as u32;
    bytes[96..100].copy_from_slice(&start.to_le_bytes());
    for i in 0..1600_i32 {
        let at = [500 * (i % 40) + 1, 500 * (i / 40) + 1, 100_000];
        at.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        bytes.extend_from_slice(&[0, 0, 0x11, 2, 0, 0, 0, 0]);
    }
    bytes
}

#[test]
fn system_and_millimetres_survive_conversion_and_orthoimages() {
    // A southern zone, whose y coordinates are near ten million, with a text of several lines.
    let text =
        "PROJCS[\"South, zone 33\",\n  GEOGCS[\"g\",AUTHORITY[\"EPSG\",\"4326\"]],AUTHORITY[\"EPSG\",\"32733\"]]";
    for text in [None, Some(text)] {
        let folder = Folder::new("system");
        folder.write("in.las", las_with_system(text));
        folder.run("convert in.las -o points.copc.laz").code(0);
        folder.run("convert points.copc.laz -o splats.ply").code(0);
        for input in ["in.las", "points.copc.laz", "splats.ply"] {
            let info = folder.run(&format!("info --json {input}")).code(0).json();
            assert_eq!(info["crs"]["code"], "EPSG:32733", "{input}");
            let name = if text.is_some() { "South, zone 33" } else { "Zone 33" };
            assert_eq!(info["crs"]["name"], name, "{input}");
            folder.run(&format!("ortho {input} --gsd 0.5 -o rgb.tif --dsm dsm.tif --force")).code(0);
            // Keys: projected, pixels are areas, and the code in the directory itself.
            let model: Vec<u8> = [1024_u16, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32_733].map(u16::to_le_bytes).concat();
            for image in ["rgb.tif", "dsm.tif"] {
                let bytes = folder.read(image);
                assert!(bytes.windows(model.len()).any(|window| window == model), "{input} {image}");
            }
        }
        let bounds = folder.run("info --json points.copc.laz").code(0).json()["bounds"].clone();
        let expected = [[640_000.001, 9_990_000.001, 100.0], [640_019.501, 9_990_019.501, 100.0]];
        for (side, expected) in expected.into_iter().enumerate() {
            for (k, expected) in expected.into_iter().enumerate() {
                let found = bounds[side][k].as_f64().unwrap();
                // Positions stored as two f32 are off by at most a thousandth of a millimetre.
                assert!((found - expected).abs() < 1e-5, "{side} {k}: {found}, expected {expected}");
            }
        }
    }
}
