//! Options for the grid and the files of an orthoimage.

use crate::options::row::{Commands, Group, Row, put, put_path};
use crate::values;

const fn grid(row: Row) -> Row {
    row.of(Group::Grid, Commands::ORTHO).keyword(Commands::ORTHO)
}

pub(super) const ROWS: &[Row] = &[
    grid(Row::text("gsd", "M", |o, text| put(&mut o.gsd, values::positive(text))))
        .help("Ground sampling distance: side of a pixel, in the units of x and y.", "")
        .everyday()
        .required(&[])
        .python("Required[float]")
        .example("7")
        .synonyms(&["resolution", "res", "pixel-size", "cell-size", "cellsize", "spacing"]),
    grid(Row::path("dsm", "F.tif", |o, path| put_path(&mut o.dsm, path)))
        .help("GeoTIFF of heights to write (digital surface model); -9999 at empty pixels.", "")
        .everyday()
        .python("_Path | None")
        .example("dsm.tif")
        .synonyms(&["dem", "height", "heights", "elevation"]),
    grid(Row::path("normals", "F.tif", |o, path| put_path(&mut o.normals, path)))
        .help("GeoTIFF of unit normals to write; -9999 at empty pixels.", "")
        .python("_Path | None")
        .example("normals.tif"),
    grid(Row::text("bounds", "X0,Y0,X1,Y1", |o, text| put(&mut o.bounds, values::bounds(text))))
        .signed()
        .help("Bounds of the image, enlarged to whole pixels; by default those of the data.", "")
        .everyday()
        .python("_Numbers")
        .example("0,1,2,3")
        .synonyms(&["extent", "te", "bbox", "box"]),
    grid(Row::text("origin", "X,Y", |o, text| put(&mut o.origin, values::place(text))))
        .signed()
        .default_value("0,0")
        .help("Point at which a corner of pixels lies; all pixel edges are whole multiples of --gsd from it.", "")
        .python("_Numbers")
        .example("1,2"),
    grid(Row::text("size", "WxH", |o, text| put(&mut o.render.size, values::size(text))))
        .help("Image size in pixels, with its lower left corner at --origin.", "")
        .python("tuple[int, int]")
        .separator("x")
        .example("33x44")
        .conflicts(&["bounds"])
        .requires(&["origin"])
        .synonyms(&["width", "height", "ts"]),
    grid(Row::text("fill", "DISTANCE", |o, text| put(&mut o.fill, values::positive(text))))
        .help(
            "Fill gaps that no circle of this radius (in the units of x and y) fits into, by interpolation.",
            "An additional last band of each image marks the interpolated pixels.",
        )
        .everyday()
        .python("float | None")
        .example("7")
        .synonyms(&["interpolate", "fill-holes", "holes", "gaps"]),
    grid(Row::text("crs", "EPSG:N", |o, text| put(&mut o.crs, values::epsg(text))))
        .help("Coordinate reference system of the image, instead of the files'.", "")
        .python("str")
        .example("EPSG:25832")
        .synonyms(&["srs", "epsg", "projection", "a-srs", "t-srs"]),
];
