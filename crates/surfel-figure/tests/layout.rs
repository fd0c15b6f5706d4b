//! Tests of layouts at several sizes: nothing overlaps, everything fits, and SVG and PDF contain the words.

use std::process::Command;
use surfel_figure::{Axis, Drawing, Figure, Item, Key, Mark, Panel, Picture, Rect, Row, Style};

/// Width and height of panels in pixels, each with the font size in pixels.
const SIZES: [([u32; 2], f64); 5] =
    [([64, 48], 9.0), ([200, 200], 12.0), ([512, 384], 16.0), ([300, 900], 20.0), ([2048, 1024], 40.0)];

fn figure(size: [u32; 2], font: f64) -> Figure {
    let panel = |name: &str| {
        let picture = Picture::filled(size, [90, 140, 200, 255]);
        let axis = |name: &str, direction: [f64; 3]| Axis { name: name.into(), direction, color: [200, 0, 0] };
        Panel::new(picture)
            .with_caption(name)
            .with_mark(Mark::Scale { length: 0.2 * f64::from(size[0]), label: "2 m".into() })
            .with_mark(Mark::Axes([
                axis("x", [0.8, 0.2, 0.5]),
                axis("y", [-0.5, 0.3, -0.8]),
                axis("z", [0.0, -0.95, 0.1]),
            ]))
    };
    let row = |names: [&str; 3]| {
        let mut row = Row::from(names.map(|name| Some(panel(name))).to_vec());
        row.label = Some("Airplane & <more>".into());
        row
    };
    let classes = ["ground", "building", "a class with quite a long name that goes on", "water"];
    let entries = classes.iter().enumerate().map(|(i, name)| ((*name).to_owned(), [40 * i as u8, 90, 10])).collect();
    Figure {
        title: Some("Completion of scans, a title that is rather long for small figures".into()),
        headings: ["First", "Second", "A third heading with too many words for its column"].map(str::to_owned).to_vec(),
        rows: vec![
            row(["Ground truth", "Ours", "A method with a long name (Someone et al. 2024)"]),
            row(["", "b", "c"]),
        ],
        keys: vec![
            Key::bar("distance [mm]", vec![[0, 0, 0], [255, 0, 0], [255, 255, 0]], [0.0, 3.7])
                .exceeded(true)
                .beside(0..1),
            Key::legend("classes", entries).beside(1..2),
        ],
        style: Style::new(font),
    }
}

fn whole(drawing: &Drawing) -> Rect {
    Rect::new([0.0; 2], drawing.size.map(f64::from))
}

#[test]
fn nothing_overlaps_and_all_fits_at_five_sizes() {
    for (size, font) in SIZES {
        let drawing = figure(size, font).layout();
        let areas: Vec<_> = drawing.areas.iter().filter(|(name, _)| *name != "mark").collect();
        for (i, (name, area)) in areas.iter().enumerate() {
            assert!(whole(&drawing).contains(area), "{size:?} {name} {area:?} isn't within {:?}", drawing.size);
            for (other, b) in &areas[i + 1..] {
                assert!(!area.overlaps(b), "{size:?}: {name} {area:?} overlaps {other} {b:?}");
            }
        }
        for text in drawing.texts() {
            let bounds = text.bounds();
            // Marks of tiny panels may leave their panel, but no text leaves the figure.
            assert!(whole(&drawing).contains(&bounds), "{size:?}: {} {bounds:?}", text.text);
        }
        let panels = drawing.areas.iter().filter(|(name, _)| *name == "panel").count();
        let captions = drawing.areas.iter().filter(|(name, _)| *name == "caption").count();
        assert_eq!((panels, captions), (6, 6));
    }
}

#[test]
fn marks_lie_in_their_panels_and_avoid_each_other() {
    for (size, font) in &SIZES[1..] {
        let mut panel = Panel::empty(*size)
            .with_mark(Mark::Scale { length: 50.0, label: "1 m".into() })
            .with_mark(Mark::North { direction: [0.3, -0.9] });
        let center = size.map(|side| 0.5 * f64::from(side));
        for (dx, dy) in [(0.0, 0.0), (0.2, 0.05), (-0.3, 0.2), (0.35, -0.2)] {
            let at = [center[0] * (1.0 + dx), center[1] * (1.0 + dy)];
            panel = panel.with_mark(Mark::Label { at, text: "door".into() });
        }
        let figure = Figure { rows: vec![vec![Some(panel)].into()], style: Style::new(*font), ..Figure::default() };
        let drawing = figure.layout();
        let area = |name: &str| -> Vec<Rect> {
            drawing.areas.iter().filter(|(n, _)| *n == name).map(|(_, area)| *area).collect()
        };
        let (panel, marks) = (area("panel")[0], area("mark"));
        assert_eq!(marks.len(), 6);
        for (i, mark) in marks.iter().enumerate() {
            assert!(panel.contains(mark), "{size:?}: {mark:?}");
            assert!(marks[i + 1..].iter().all(|other| !mark.overlaps(other)), "{size:?}: {mark:?}");
        }
    }
}

/// True if `area` contains a part of the border of `content`, and isn't entirely inside or outside of it.
fn straddles(area: Rect, content: Rect) -> bool {
    area.overlaps(&content) && !content.contains(&area)
}

#[test]
fn marks_in_corners_are_inside_the_content_or_outside() {
    // A map whose border would cross the scale bar and the arrow in the corners.
    for background in [[255; 4], [0; 4]] {
        for inset in 4..40_usize {
            let mut picture = Picture::filled([400, 400], background);
            let rows = picture.rgba.chunks_mut(400).take(400 - inset).skip(inset);
            rows.for_each(|row| row[inset..400 - inset].fill([160, 100, 40, 255]));
            let panel = Panel::new(picture)
                .with_mark(Mark::Scale { length: 80.0, label: "20 m".into() })
                .with_mark(Mark::North { direction: [0.0, -1.0] });
            let style = Style { background, ..Style::new(16.0) };
            let figure = Figure { rows: vec![vec![Some(panel)].into()], style, ..Figure::default() };
            let drawing = figure.layout();
            let area = |name: &str| -> Vec<Rect> {
                drawing.areas.iter().filter(|(n, _)| *n == name).map(|(_, area)| *area).collect()
            };
            let panel = area("panel")[0];
            let own = |side: f64| side + inset as f64;
            let content = Rect::new(panel.at.map(own), [400.0 - 2.0 * inset as f64; 2]);
            assert_eq!(area("mark").len(), 2);
            for mark in area("mark") {
                assert!(panel.contains(&mark) && !straddles(mark, content), "{inset}: {mark:?} in {content:?}");
            }
        }
    }
}

#[test]
fn marks_move_to_an_area_of_one_color() {
    // Two colours meet where the scale bar would be, and where a label would be to the right of its point.
    let mut picture = Picture::filled([400, 400], [160, 100, 40, 255]);
    for (y, row) in picture.rgba.chunks_mut(400).enumerate() {
        let from = if y < 300 { 230 } else { 60 };
        row[from..from + 40].fill([40, 160, 60, 255]);
    }
    let panel = Panel::new(picture)
        .with_mark(Mark::Scale { length: 40.0, label: "20 m".into() })
        .with_mark(Mark::Label { at: [220.0, 150.0], text: "bank".into() });
    let figure = Figure { rows: vec![vec![Some(panel)].into()], style: Style::new(16.0), ..Figure::default() };
    let drawing = figure.layout();
    let area =
        |name: &str| -> Vec<Rect> { drawing.areas.iter().filter(|(n, _)| *n == name).map(|(_, area)| *area).collect() };
    let (panel, marks) = (area("panel")[0], area("mark"));
    let places = [(60.0, 300.0, 100.0), (230.0, 0.0, 300.0)];
    let strips = places.map(|(x, y, height)| Rect::new([panel.at[0] + x, panel.at[1] + y], [40.0, height]));
    for mark in &marks {
        assert!(panel.contains(mark), "{mark:?}");
        assert!(!strips.iter().any(|strip| strip.overlaps(mark) && !strip.contains(mark)), "{mark:?} {strips:?}");
    }
    assert_eq!(marks.len(), 2);
}

#[test]
fn a_label_is_beside_its_row_and_the_rows_below_it() {
    let row = |label: Option<&str>| Row {
        label: label.map(str::to_owned),
        panels: vec![Some(Panel::new(Picture::filled([100, 80], [9; 4])).with_caption("a"))],
    };
    let rows = vec![row(Some("Chair")), row(None), row(Some("Table")), row(None)];
    let drawing = Figure { rows, style: Style::new(12.0), ..Figure::default() }.layout();
    let area =
        |name: &str| -> Vec<Rect> { drawing.areas.iter().filter(|(n, _)| *n == name).map(|(_, area)| *area).collect() };
    let (labels, panels) = (area("row label"), area("panel"));
    for (label, rows) in labels.iter().zip([0..2, 2..4]) {
        assert_eq!(label.at[1], panels[rows.start].at[1]);
        assert_eq!(label.end()[1], panels[rows.end - 1].end()[1]);
    }
    let distance = |above: usize| panels[above + 1].at[1] - panels[above].end()[1];
    assert!(distance(1) > distance(0) + 5.0 && distance(0) == distance(2), "groups are apart");
}

#[test]
fn a_fixed_width_is_the_width() {
    let mut figure = figure([100, 100], 10.0);
    let natural = figure.layout().size[0];
    figure.style.width = Some(natural + 60);
    assert_eq!(figure.layout().size[0], natural + 60);
    figure.style.width = Some(10);
    assert_eq!(figure.layout().size[0], natural, "nothing is cut");
}

#[test]
fn headings_are_above_their_columns() {
    let drawing = figure([200, 200], 12.0).layout();
    let area = |name: &str, n: usize| drawing.areas.iter().filter(|(area, _)| *area == name).nth(n).unwrap().1;
    for n in 0..3 {
        let (heading, panel) = (area("heading", n), area("panel", n));
        assert!(heading.end()[1] <= panel.at[1] && heading.at[1] >= area("title", 0).end()[1]);
        let middle = |rect: Rect| rect.at[0] + 0.5 * rect.size[0];
        assert!((middle(heading) - middle(panel)).abs() < 1.0);
    }
}

#[test]
fn bars_end_in_an_arrow_where_values_are_larger() {
    let drawing = |exceeded| {
        let key = Key::bar("distance", vec![[0; 3], [255, 200, 0]], [0.0, 1.0]).exceeded(exceeded);
        Figure { keys: vec![key], style: Style::new(16.0), ..Figure::default() }.layout()
    };
    let has_arrow = |drawing: &Drawing| {
        drawing.items.iter().any(|item| matches!(item, Item::Polygon(corners, [255, 200, 0]) if corners.len() == 3))
    };
    assert!(has_arrow(&drawing(true)) && !has_arrow(&drawing(false)));
}

#[test]
fn a_key_alone_is_a_figure() {
    let bar = Key::bar("", vec![[0; 3], [255; 3]], [-1.234_567e-30, 1e300]);
    let entries = (0..300).map(|i| (i.to_string(), [i as u8; 3])).collect();
    for key in [bar, Key::legend("", entries)] {
        let drawing = Figure { keys: vec![key], style: Style::new(16.0), ..Figure::default() }.layout();
        assert!(drawing.texts().all(|text| whole(&drawing).contains(&text.bounds())));
        let border = drawing.picture();
        let [width, height] = drawing.size.map(|side| side as usize);
        let is_border = |i: usize| {
            let (x, y) = (i % width, i / width);
            x < 4 || y < 4 || x >= width - 4 || y >= height - 4
        };
        assert!((0..border.rgba.len()).all(|i| !is_border(i) || border.rgba[i] == [255; 4]));
    }
}

#[test]
fn svg_is_xml_and_has_the_words() {
    let svg = figure([200, 200], 12.0).layout().svg_at(Some(300.0));
    let document = roxmltree::Document::parse(&svg).unwrap();
    let texts: Vec<&str> = document.descendants().filter(|n| n.has_tag_name("text")).filter_map(|n| n.text()).collect();
    for words in ["Ground truth", "Airplane & <more>", "distance [mm]", "water", "2 m"] {
        assert!(texts.contains(&words), "{words}: {texts:?}");
    }
    let images = document.descendants().filter(|n| n.has_tag_name("image"));
    assert_eq!(images.count(), 7, "six panels and the colour bar");
    assert!(document.root_element().attribute("width").unwrap().ends_with("mm"));
}

#[test]
fn pdf_has_the_words_and_the_size() {
    let drawing = figure([200, 200], 12.0).layout();
    let pdf = drawing.pdf(144.0);
    assert!(pdf.starts_with(b"%PDF"));
    let folder = std::env::temp_dir().join(format!("surfel-figure-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("figure.pdf");
    std::fs::write(&file, &pdf).unwrap();
    // poppler-utils may not be installed.
    if let Ok(output) = Command::new("pdftotext").arg("-raw").arg(&file).arg("-").output() {
        let text = String::from_utf8_lossy(&output.stdout).split_whitespace().collect::<Vec<_>>().join(" ");
        for words in ["Ground truth", "Airplane & <more>", "distance [mm]", "water", "2 m"] {
            assert!(text.contains(words), "{words}: {text}");
        }
        let info = Command::new("pdfinfo").arg(&file).output().unwrap();
        let info = String::from_utf8_lossy(&info.stdout).into_owned();
        let [width, height] = drawing.size.map(|side| f64::from(side) / 2.0);
        assert!(info.contains(&format!("{width} x {height} pts")), "{info}");
        let drawn = Command::new("pdftoppm").args(["-r", "144", "-png"]).arg(&file).arg(folder.join("page")).output();
        let drawn = drawn.unwrap();
        assert!(drawn.status.success() && drawn.stderr.is_empty(), "{}", String::from_utf8_lossy(&drawn.stderr));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn pdf_has_the_opacity_of_the_background() {
    let opacity = |alpha: u8| {
        let mut drawing = figure([200, 200], 12.0).layout();
        drawing.background = [10, 20, 30, alpha];
        let pdf = String::from_utf8_lossy(&drawing.pdf(144.0)).into_owned();
        let (_, state) = pdf.split_once("/Type /ExtGState")?;
        let (_, value) = state.split_once("/ca ")?;
        value.split_whitespace().next()?.parse::<f64>().ok()
    };
    // Transparent and opaque backgrounds need no graphics state.
    assert_eq!([0, 255].map(opacity), [None; 2]);
    assert!((opacity(51).unwrap() - 0.2).abs() < 1e-6);
}
