//! Options for the camera.

use crate::options::row::{Commands, Group, Row, names_of, put};
use crate::render_options::CameraSource;
use crate::values;

const fn camera(row: Row) -> Row {
    row.of(Group::Camera, Commands::DRAWN).image()
}

pub(super) const ROWS: &[Row] = &[
    camera(Row::text("size", "WxH", |o, text| put(&mut o.render.size, values::size(text))))
        .of(Group::Camera, Commands::IMAGES)
        .image()
        .help("Image size in pixels (default 1024x1024).", "")
        .everyday()
        .python("tuple[int, int]")
        .separator("x")
        .scene("camera.size")
        .example("33x44")
        .synonyms(&["width", "height", "resolution", "res", "dimensions", "geometry"]),
    camera(Row::text("view", "VIEW", |o, text| put(&mut o.render.view, values::view(text))))
        .names_or_other(|| names_of(&values::VIEWS))
        .signed()
        .help(
            "View the scene from this side; auto, the default, selects the side that shows most.",
            "Also AZIMUTH,ELEVATION in degrees: 0,0 is front, 90,0 right, 30,20 iso.",
        )
        .everyday()
        .python("str | tuple[float, float]")
        .example("30,20")
        .conflicts(&["camera", "eye", "target"])
        .synonyms(&["side", "direction", "angle", "azimuth", "elevation", "rotate", "rotation"]),
    camera(Row::text("up", "AXIS", |o, text| put(&mut o.render.up, values::up(text))))
        .signed()
        .help(
            "Up axis of the scene: +x, -x, +y, -y, +z or -z, or auto: as the file or its format states, else from its \
             shape.",
            "",
        )
        .everyday()
        .python(r#"Literal["auto", "+x", "-x", "+y", "-y", "+z", "-z"]"#)
        .scene("up")
        .example("-x")
        .synonyms(&["up-axis", "axis", "z-up", "y-up"]),
    camera(Row::switch("ortho", |o, on| o.render.ortho = on))
        .help("Use a parallel projection.", "")
        .everyday()
        .scene("camera.projection")
        .synonyms(&["orthographic", "parallel", "orthogonal", "projection"]),
    camera(Row::text("ortho-height", "UNITS", |o, text| put(&mut o.render.ortho_height, values::positive(text))))
        .help("Height of the view in world units, with --ortho.", "")
        .python("float")
        .scene("camera.projection")
        .example("7")
        .requires(&["ortho"])
        .synonyms(&["parallel-scale", "ortho-scale", "ortho-size"]),
    camera(Row::text("fov-y", "DEG", |o, text| put(&mut o.render.fov_y, values::fov(text))))
        .help("Vertical field of view in degrees.", "")
        .python("float")
        .scene("camera.projection")
        .example("7")
        .conflicts(&["ortho"])
        .synonyms(&["fov", "field-of-view", "focal", "zoom"]),
    camera(Row::text("eye", "X,Y,Z", |o, text| put(&mut o.render.eye, values::point(text))))
        .signed()
        .help("Position of the eye.", "")
        .python("_Numbers")
        .scene("camera.eye")
        .example("1,2.5,-3")
        .synonyms(&["position", "from", "camera-position"]),
    camera(Row::text("target", "X,Y,Z", |o, text| put(&mut o.render.target, values::point(text))))
        .signed()
        .help("Point that the camera is aimed at.", "")
        .python("_Numbers")
        .scene("camera.target")
        .example("1,2.5,-3")
        .synonyms(&["look-at", "lookat", "center", "focus"]),
    camera(Row::text("camera-up", "X,Y,Z", |o, text| put(&mut o.render.camera_up, values::direction(text))))
        .signed()
        .help("Direction that appears upward.", "")
        .python("_Numbers")
        .scene("camera.up")
        .example("1,2.5,-3")
        .synonyms(&["view-up", "up-vector", "roll"]),
    camera(Row::path("camera", "FILE", |o, path| {
        o.render.camera = Some(CameraSource::File(path));
        Ok(())
    }))
    .help("JSON file with the camera object of a scene file.", "")
    .python("Camera | Mapping[str, Any] | _Path")
    .scene("camera")
    .example("camera.json"),
    camera(Row::text("region", "X,Y,W,H", |o, text| put(&mut o.render.region, values::region(text))))
        .of(Group::Camera, Commands::RENDER)
        .help("Render only this rectangle of the image, in pixels.", "")
        .python("tuple[int, int, int, int]")
        .drawn()
        .example("1,2,3,4")
        .synonyms(&["crop-image", "window", "viewport", "roi"]),
];
