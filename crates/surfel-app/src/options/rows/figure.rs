//! Options for the panels and words of figures.

use crate::figure_options as figure_values;
use crate::options::row::{Commands, Group, Row, names_of, put, put_path};
use crate::values;

const fn figure(row: Row) -> Row {
    row.of(Group::Figure, Commands::FIGURE).keyword(Commands::FIGURE)
}

/// Splits a list at commas.
fn list(text: &str) -> Vec<String> {
    text.split(',').map(|part| part.trim().to_owned()).collect()
}

pub(super) const ROWS: &[Row] = &[
    figure(Row::text("title", "TEXT", |o, text| put(&mut o.figure.title, Ok(text.to_owned()))))
        .help("Title above the panels.", "")
        .everyday()
        .python("str")
        .example("Completion")
        .synonyms(&["heading", "suptitle"]),
    figure(Row::text("titles", "A,B,...", |o, text| {
        o.figure.titles = list(text);
        Ok(())
    }))
    .help("Titles below the panels, or below the columns; by default the names of the files.", "")
    .everyday()
    .python("str | Sequence[str]")
    .example("a,b")
    .synonyms(&["captions", "panel-titles", "names"]),
    figure(Row::text("row-titles", "A,B,...", |o, text| {
        o.figure.row_titles = list(text);
        Ok(())
    }))
    .help("Titles to the left of the rows.", "")
    .python("str | Sequence[str]")
    .example("a,b"),
    figure(Row::text("subjects", "N", |o, text| put(&mut o.figure.subjects, values::whole(text, 1..=1000))))
        .help(
            "Number of subjects (default 1). The files are divided into as many groups of equal size, in their order.",
            "Each subject has its own rows, camera and light. Its first file is the reference of --error-row.",
        )
        .everyday()
        .python("int")
        .example("2")
        .synonyms(&["rows", "scenes", "objects"]),
    figure(Row::text("wrap", "N", |o, text| put(&mut o.figure.wrap, values::whole(text, 1..=1000))))
        .help("Largest number of panels side by side.", "")
        .python("int")
        .example("7")
        .synonyms(&["per-row", "cols", "ncols", "grid"]),
    figure(Row::text("error-row", "COLORMAP", |o, text| put(&mut o.figure.error_row, values::colormap(text))))
        .names(|| names_of(values::COLORMAPS))
        .missing("viridis")
        .help(
            "Add a row of panels coloured by the distance to the first file: to its points, or to its surface if it is \
             a mesh.",
            "The value is a colour map (default viridis). Captions of these panels state Chamfer distances (CD-L1), or \
             mean distances to a mesh.",
        )
        .everyday()
        .python("str | bool")
        .example("inferno")
        .synonyms(&["difference", "diff", "distance", "error-map"]),
    figure(Row::text("error-max", "D", |o, text| put(&mut o.figure.error_max, values::positive(text))))
        .help("Distance at the end of the error row's colour map; by default the 98th percentile.", "")
        .python("float")
        .example("7")
        .requires(&["error-row"]),
    figure(Row::text("annotate", "MARK,...", |o, text| {
        o.figure.marks = list(text).iter().map(|name| figure_values::mark(name)).collect::<Result<_, _>>()?;
        Ok(())
    }))
    .names(|| names_of(figure_values::MARKS))
    .list()
    .help(
        "Marks over the panels: scale (a scale bar), axes (the directions of x, y and z), north (an arrow along y).",
        "In perspective a scale bar is true at the distance of the camera's target.",
    )
    .everyday()
    .python("str | Sequence[str]")
    .example("axes")
    .synonyms(&["scale-bar", "scalebar", "axis", "north-arrow", "compass", "orientation"]),
    figure(Row::text("unit", "UNIT", |o, text| put(&mut o.figure.unit, Ok(text.to_owned()))))
        .help("Unit of the coordinates, for scale bars and for colour bars of heights and distances.", "")
        .python("str")
        .example("mm")
        .synonyms(&["units"]),
    figure(Row::text("value-title", "TEXT", |o, text| put(&mut o.figure.value_title, Ok(text.to_owned()))))
        .help("Title of the colour bar or legend of --color-by; by default the attribute.", "")
        .python("str")
        .example("speed [m/s]")
        .synonyms(&["bar-title", "colorbar-title", "legend-title"]),
    figure(Row::switch("no-legend", |o, on| o.figure.no_legend = on))
        .help("Leave out colour bars and legends.", "")
        .synonyms(&["no-colorbar", "hide-legend"]),
    figure(Row::path("frusta", "FILE|DIR", |o, path| put_path(&mut o.figure.frusta, path)))
        .help("Draw the cameras of another program as frusta; the files are those of --cameras.", "")
        .python("_Path")
        .example("cameras.json")
        .synonyms(&["camera-frusta", "show-cameras"]),
    figure(Row::text("text-at", "X,Y,Z=TEXT", |o, text| {
        o.figure.texts.push(figure_values::text_at(text)?);
        Ok(())
    }))
    .repeated()
    .signed()
    .help("Write a text beside a point of the scene; may be given several times.", "")
    .python("str | Sequence[str]")
    .example("1,2,-3=door")
    .synonyms(&["text", "note", "annotation", "point-label"]),
    figure(Row::text("width", "W", |o, text| put(&mut o.figure.width, figure_values::length(text))))
        .help(
            "Width of the whole figure in pixels, or in mm, cm, inches (in) or points (pt).",
            "The panels get the room that words leave, with the proportions of --size.",
        )
        .everyday()
        .python("int | str")
        .example("174mm")
        .synonyms(&["figure-width", "figsize"]),
    figure(Row::text("size", "WxH", |o, text| put(&mut o.render.size, values::size(text))))
        .image()
        .help("Size of a panel in pixels (default 720x720), or with --width its proportions.", "")
        .everyday()
        .python("tuple[int, int]")
        .separator("x")
        .example("33x44")
        .synonyms(&["panel-size", "resolution", "dimensions"]),
    figure(Row::text("dpi", "N", |o, text| put(&mut o.figure.dpi, values::positive(text))))
        .help("Pixels per inch (default 300).", "")
        .python("float")
        .example("7")
        .synonyms(&["ppi", "resolution-dpi"]),
    figure(Row::text("font-size", "PT", |o, text| put(&mut o.figure.font_pt, values::positive(text))))
        .help(
            "Size of the words in points; by default 8 with a --width in units of length, else a fraction of a panel.",
            "",
        )
        .python("float")
        .example("7")
        .synonyms(&["fontsize", "text-size"]),
];
