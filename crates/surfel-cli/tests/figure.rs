//! `surfel figure`, and the colours that figures need.

use crate::common::{Folder, points};
use std::process::Command;

/// Returns a CSV of a plane of 20×20 points with three classes.
fn classes() -> String {
    let mut text = "x,y,z,classification,value\n".to_owned();
    for i in 0..400_i32 {
        let class = [2, 6, 9][i as usize % 20 / 7];
        text += &format!("{},{},{},{class},{}\n", i % 20, i / 20, f64::from(i % 7) * 0.05, f64::from(i) + 0.5);
    }
    text
}

#[test]
fn figures_are_pdf_svg_and_png() {
    let f = Folder::new("figure");
    f.write("a.xyz", points());
    f.write("b.xyz", points());
    let words = "figure a.xyz b.xyz --size 90x60 --title Both --titles Truth,Ours --error-row --annotate scale,axes \
                 --unit m";
    for name in ["fig.pdf", "fig.svg", "fig.png"] {
        f.run(&format!("{words} -o {name}")).code(0);
    }
    let svg = String::from_utf8(f.read("fig.svg")).unwrap();
    for text in ["Both", "Truth", "Ours", "distance [m]", "CD 0 m"] {
        assert!(svg.contains(&format!(">{text}</text>")), "{text}");
    }
    assert!(f.read("fig.pdf").starts_with(b"%PDF"));
    if let Ok(found) = Command::new("pdftotext").arg(f.path().join("fig.pdf")).arg("-").output() {
        let text = String::from_utf8_lossy(&found.stdout).into_owned();
        assert!(["Both", "Truth", "Ours", "distance [m]"].iter().all(|words| text.contains(words)), "{text}");
    }
    let image = f.image("fig.png");
    assert!(image.width > 270 && image.height > 60, "three panels in a row");
    f.run(&format!("{words} -o fig.png")).fails(1, "fig.png");
    f.run(&format!("{words} -o fig.png --force")).code(0);
    f.run(&format!("{words} -o fig.exr")).fails(2, ".pdf, .svg or .png");
    f.run("figure a.xyz --error-row -o x.png").fails(2, "at least two");
    f.run("figure a.xyz b.xyz --titles A -o x.png").fails(2, "expected 2");
    f.run("figure a.xyz --annotate scales -o x.png").fails(2, "scale");
    f.run("figure a.xyz --width wide -o x.png").fails(2, "174mm");
    f.run("figure a.xyz --frusta none.json -o x.png").fails(3, "none.json");
}

#[test]
fn files_with_few_points_are_drawn_alike() {
    let f = Folder::new("figure-alike");
    let sphere = |noise: f64| -> String {
        let fraction = |i: usize, step: f64| (i as f64 * step).fract();
        let point = |i: usize| {
            let (z, a) = (1.0 - (2 * i + 1) as f64 / 2048.0, 2.399_963 * i as f64);
            let r = 1.0 + noise * (fraction(i, 0.754_877_666) - 0.5);
            let across = r * (1.0 - z * z).sqrt();
            format!("{} {} {}\n", across * a.cos(), across * a.sin(), r * z)
        };
        (0..2048).map(point).collect()
    };
    f.write("smooth.xyz", sphere(0.0));
    f.write("rough.xyz", sphere(0.2));
    let said = f.run("figure smooth.xyz -o a.png --size 40x30").code(0).stderr();
    assert!(!said.contains("balls"), "{said}");
    let said = f.run("figure smooth.xyz rough.xyz -o b.png --size 40x30").code(0).stderr();
    for reason in ["smooth.xyz: its points are drawn as balls, because those of other files are", "few, and rough"] {
        assert!(said.contains(reason), "{said}");
    }
    let said = f.run("figure smooth.xyz rough.xyz --points-as surface -o c.png --size 40x30").code(0).stderr();
    assert!(!said.contains("balls"), "{said}");
}

#[test]
fn errors_of_overlapping_splats_have_colours_of_the_bar() {
    let f = Folder::new("figure-errors");
    let plane = |noise: f64| -> String {
        let point = |i: usize| {
            let (x, y) = (i % 60, i / 60);
            format!("{} {} {}\n", x as f64 * 0.1, y as f64 * 0.1, noise * ((x + y) % 2) as f64)
        };
        (0..3600).map(point).collect()
    };
    f.write("even.xyz", plane(0.0));
    // Every other point is off by one per cent of the spacing.
    f.write("noisy.xyz", plane(0.001));
    let words =
        "figure even.xyz noisy.xyz --view top --up +z --size 100x100 --points-as surface --error-row --no-legend";
    f.run(&format!("{words} --error-max 0.001 --titles A,B --font-size 4 -o a.png")).code(0);
    let image = f.image("a.png");
    let (width, color) = (image.width as usize, image.color.unwrap());
    // The middle of the panel on the right.
    let rows = image.height as usize * 3 / 8..image.height as usize * 5 / 8;
    let inside = |y: usize| &color[y * width + width * 9 / 12..y * width + width * 11 / 12];
    let sum = |k: usize| rows.clone().flat_map(inside).map(|c| c[k]).sum::<f32>();
    // The middle of viridis is teal. A mean of its ends, purple and yellow, is brown.
    assert!(sum(1) > 1.5 * sum(0) && sum(2) > 1.5 * sum(0), "{:?}", [sum(0), sum(1), sum(2)]);
}

#[test]
fn legends_have_the_names_of_classes_and_of_labels() {
    let f = Folder::new("labels");
    f.write("a.csv", classes());
    // Heights have the unit of the coordinates, unless their title names one.
    for (title, shown) in [("", "height [m]"), ("--value-title up", "up [m]"), ("--value-title a[km]", "a[km]")] {
        f.run(&format!("figure a.csv --color-by height --unit m {title} --size 60x60 -o h.svg --force")).code(0);
        assert!(String::from_utf8(f.read("h.svg")).unwrap().contains(&format!(">{shown}<")), "{shown}");
    }
    f.run("figure a.csv --color-by classification --size 60x60 -o a.svg").code(0);
    let svg = String::from_utf8(f.read("a.svg")).unwrap();
    assert!(["ground", "building", "water"].iter().all(|name| svg.contains(&format!(">{name}<"))));
    // Ochre and green, which people without green cones confuse.
    f.write("names.txt", "2 lawn #be8c3c\n6 wood #78a53c\n");
    let said = f.run("figure a.csv --color-by classification --labels names.txt --size 60x60 -o b.svg");
    let said = said.code(0).stderr();
    let svg = String::from_utf8(f.read("b.svg")).unwrap();
    assert!(["lawn", "wood", "water"].iter().all(|name| svg.contains(&format!(">{name}<"))));
    assert!(said.contains("deuteranopia: lawn and wood"), "{said}");
    let said = f.run("a.csv --color-by classification --labels names.txt --size 9x9 -o c.png").code(0).stderr();
    assert!(said.contains("2 lawn 140"), "{said}");
    f.run("a.csv --labels names.txt -o d.png").fails(2, "--color-by");
    f.write("wrong.txt", "ground 2\n");
    f.run("a.csv --color-by classification --labels wrong.txt -o d.png").fails(3, "line 1");
}

#[test]
fn colour_maps_are_names_or_files_and_images_repeat() {
    let f = Folder::new("maps");
    f.write("a.csv", classes());
    f.write("map.txt", "#0000ff\n#ff0000\n");
    let flags = "--color-by value --shader unlit --view top --up +z --size 20x20 --edge-aa=off";
    f.run(&format!("a.csv {flags} --colormap map.txt -o a.png")).code(0);
    let image = f.image("a.png");
    let color = image.color.unwrap();
    assert!(color.iter().all(|c| c[1] < 0.01 || c[3] < 1.0 || c[0] > 0.9), "no green but the background's");
    f.run("again a.png -o b.png").code(0);
    assert_eq!(f.image("b.png").color.unwrap(), color);
    for name in ["magma", "inferno", "plasma", "RdBu", "rdbu", "jet", "tab10", "Set1"] {
        f.run(&format!("a.csv {flags} --colormap {name} -o n.png --force")).code(0);
    }
    f.run(&format!("a.csv {flags} --colormap virdis -o x.png")).fails(2, "viridis");
    f.run("a.csv --color-by value --color red -o x.png").fails(2, "cannot be used with");
    f.run("a.csv --color redd -o x.png").fails(2, "#rrggbb");
    f.run("a.csv --color steelblue --background #f0f0f0 --size 9x9 -o c.png").code(0);
    f.run("again c.png -o d.png").code(0);
    assert_eq!(f.image("c.png").color, f.image("d.png").color);
}

#[test]
fn the_style_of_figures_leaves_given_flags_alone() {
    let f = Folder::new("style");
    f.write("a.xyz", points());
    let scene = f.run("a.xyz --style figure --print-scene").code(0).stdout();
    let scene: serde_json::Value = serde_json::from_str(&scene).unwrap();
    assert_eq!(scene["camera"]["size"], serde_json::json!([2048, 2048]));
    assert_eq!(scene["background"], serde_json::json!([1.0, 1.0, 1.0, 1.0]));
    let given = f.run("a.xyz --style figure --size 40x30 --background black --print-scene").code(0).stdout();
    let given: serde_json::Value = serde_json::from_str(&given).unwrap();
    assert_eq!((&given["camera"]["size"], &given["background"][0]), (&serde_json::json!([40, 30]), &0.0.into()));
}
