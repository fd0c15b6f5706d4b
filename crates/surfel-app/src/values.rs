//! Parsers for the values of flags, from text to typed values. The command line and
//! [`RenderOptions::set`](crate::request::RenderOptions::set) use them.
//!
//! # Errors
//! All parsers fail alike: the error is a message that states the expected values, such as "expected a number more than
//! 0, at most 50". It doesn't name the flag, which the caller prefixes.

#![expect(clippy::missing_errors_doc, reason = "all fail alike: what is expected, where the text is something else")]

pub use surfel_stage::NamedLight;

use crate::style::Style;
use std::ops::Range;
use surfel_framing::{NamedView, ViewAngles, ViewChoice};
use surfel_io::film::FrameRate;
use surfel_math::srgb;
use surfel_model::{
    Accumulate, Classes, ClipPolicy, Color, Colormap, Composite, Condition, ConvertOptions, Cull, DepthTolerance,
    EdgeAa, Filter, GroundStyle, MAX_IMAGE_SIDE, Mapping, Outliers, PointColors, PointsAs, Returns, Shader, Sort,
    SplatCount, TableColumns, Transparency, Up,
};
use surfel_render::{Preset, Region};

fn by_name<T: Copy>(named: &[(&str, T)], text: &str) -> Result<T, String> {
    let names = || named.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    named.iter().find(|(name, _)| *name == text).map(|(_, value)| *value).ok_or_else(|| format!("expected {}", names()))
}

/// Defines a table of named values, and a parser that finds a value by its name.
macro_rules! named {
    ($function:ident, $all:ident, $type:ty, [$($name:literal => $value:expr),+ $(,)?]) => {
        #[doc = concat!("Names and values of every [`", stringify!($type), "`].")]
        pub const $all: &[(&str, $type)] = &[$(($name, $value)),+];

        #[doc = concat!("Parses the name of a [`", stringify!($type), "`].")]
        pub fn $function(text: &str) -> Result<$type, String> {
            by_name($all, text)
        }
    };
}

named!(filter, FILTERS, Filter, [
    "none" => Filter::None, "clamp" => Filter::Clamp, "adjust" => Filter::Adjust,
    "principal" => Filter::Principal, "ewa" => Filter::Ewa,
]);
named!(cull, CULLS, Cull, ["none" => Cull::None, "back" => Cull::Back]);
named!(colormap, COLORMAPS, Colormap, [
    "viridis" => Colormap::Viridis, "cividis" => Colormap::Cividis, "turbo" => Colormap::Turbo,
    "coolwarm" => Colormap::Coolwarm, "magma" => Colormap::Magma, "inferno" => Colormap::Inferno,
    "plasma" => Colormap::Plasma, "rdbu" => Colormap::RdBu, "jet" => Colormap::Jet, "tab10" => Colormap::Tab10,
    "tab20" => Colormap::Tab20, "set1" => Colormap::Set1, "grey" => Colormap::Grey,
]);
named!(point_colors, POINT_COLORS, PointColors, ["as-is" => PointColors::AsIs, "fit" => PointColors::Fit]);
named!(outliers, OUTLIERS, Outliers, ["keep" => Outliers::Keep, "drop" => Outliers::Drop]);
named!(returns, RETURNS, Returns, ["last" => Returns::Last, "first" => Returns::First, "single" => Returns::Single]);
named!(light, LIGHTS, NamedLight, [
    "headlight" => NamedLight::Headlight, "studio" => NamedLight::Studio, "sky" => NamedLight::Sky,
    "sun" => NamedLight::Sun,
]);
named!(ground, GROUNDS, Option<GroundStyle>, [
    "none" => None, "shadow" => Some(GroundStyle::Shadow), "plane" => Some(GroundStyle::Plane),
    "grid" => Some(GroundStyle::Grid),
]);
named!(style, STYLES, Style, ["figure" => Style::Figure]);
named!(mapping, MAPPINGS, Mapping, ["exact" => Mapping::Exact, "affine" => Mapping::Affine]);
named!(accumulate, ACCUMULATES, Accumulate, ["f32" => Accumulate::F32, "f16" => Accumulate::F16]);
named!(clip, CLIPS, ClipPolicy, [
    "exact" => ClipPolicy::Exact, "paper" => ClipPolicy::Paper, "line" => ClipPolicy::Line, "off" => ClipPolicy::Off,
]);
named!(shader, SHADERS, Shader, [
    "unlit" => Shader::Unlit, "phong" => Shader::Phong, "toon" => Shader::Toon,
    "normal" => Shader::Normal, "depth" => Shader::Depth, "matcap" => Shader::Matcap, "edl" => Shader::Edl,
]);
named!(preset, PRESETS, Preset, [
    "fastest" => Preset::Fastest, "fast" => Preset::Fast, "balanced" => Preset::Balanced,
    "quality" => Preset::Quality, "reference" => Preset::Reference,
]);
named!(composite, COMPOSITES, Composite, ["surface" => Composite::Surface, "over" => Composite::Over]);
named!(sort, SORTS, Sort, ["center" => Sort::Center, "pixel" => Sort::Pixel]);
named!(edge_aa, EDGE_AA, EdgeAa, ["on" => EdgeAa::Coverage, "off" => EdgeAa::Off, "samples" => EdgeAa::Samples]);

/// Largest accepted number of parts N of a [`Part`].
const MAX_PARTS: u32 = 1_000_000;

/// One of N equal parts, such as a shard of a job or a tile of an image, written `I/N`. I may count from 0 or from 1,
/// since `N/N` means the same as `0/N`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    index: u32,
    count: u32,
}

impl Part {
    /// Creates part `index` of `count`, where `index` = `count` means part 0. `None` if `index` is greater than
    /// `count`, or `count` isn't from 1 to 1,000,000.
    pub fn new(index: u64, count: u64) -> Option<Self> {
        let (index, count) = (u32::try_from(index).ok()?, u32::try_from(count).ok()?);
        ((1..=MAX_PARTS).contains(&count) && index <= count).then(|| Self { index: index % count, count })
    }

    /// Returns the part's index, less than [`Self::count`].
    pub fn index(self) -> u32 {
        self.index
    }

    /// Returns the number of parts, 1 to 1,000,000.
    pub fn count(self) -> u32 {
        self.count
    }

    /// Returns the part's index and the number of parts.
    pub fn index_and_count(self) -> [u32; 2] {
        [self.index, self.count]
    }

    /// Returns this part of the range `0..length`. All parts together cover it exactly once, and their lengths differ
    /// by at most one.
    pub fn of(self, length: u64) -> Range<u64> {
        let edge = |part: u32| u64::from(part) * length / u64::from(self.count);
        edge(self.index)..edge(self.index + 1)
    }
}

/// Parses a frame rate from 0.01 to 240 frames per second.
pub fn frame_rate(text: &str) -> Result<FrameRate, String> {
    let rate = text.trim().parse().ok().and_then(FrameRate::new);
    rate.ok_or_else(|| format!("expected a number of frames a second from 0.01 to {}", FrameRate::MOST))
}

/// Parses `I/N`, part I of N (1 to 1,000,000). Parts may be counted from 0 or from 1: `N/N` is the same part as `0/N`.
pub fn part(text: &str) -> Result<Part, String> {
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let part = text.split_once('/').and_then(|(index, count)| Part::new(number(index)?, number(count)?));
    part.ok_or_else(|| format!("expected I/N: part I of N, I from 0 to N, N from 1 to {MAX_PARTS}, as in 3/16"))
}

/// Range of frames `A-B[:STEP]`: every STEP-th frame from A to B, inclusive. Frames are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    first: u32,
    last: u32,
    step: u32,
}

impl FrameRange {
    /// Returns the frames of the range. Fails if the range's end B isn't less than `frames`, the number of frames.
    pub fn checked(self, frames: usize) -> Result<impl Iterator<Item = u32>, String> {
        if self.last as usize >= frames {
            return Err(format!(
                "--frame-range goes to {}, expected at most {}: there are {frames} frames or cameras",
                self.last,
                frames.saturating_sub(1)
            ));
        }
        Ok((self.first..=self.last).step_by(self.step as usize))
    }
}

impl std::fmt::Display for FrameRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}-{}:{}", self.first, self.last, self.step)
    }
}

/// Parses a value of `--frame-range`: `A-B[:STEP]`, or `A` for one frame.
pub fn frame_range(text: &str) -> Result<FrameRange, String> {
    let parse = || {
        let (range, step) = text.split_once(':').unwrap_or((text, "1"));
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        let number = |text: &str| text.trim().parse::<u32>().ok();
        let range = FrameRange { first: number(first)?, last: number(last)?, step: number(step)? };
        (range.first <= range.last && range.step > 0).then_some(range)
    };
    parse().ok_or_else(|| {
        "expected A-B or A-B:STEP: frames that count from 0, A at most B, STEP at least 1, as in 0-99:10".to_owned()
    })
}

/// Parses a whole number within a range.
pub fn whole(text: &str, range: std::ops::RangeInclusive<u32>) -> Result<u32, String> {
    let wrong = || format!("expected a whole number from {} to {}", range.start(), range.end());
    text.trim().parse::<u32>().ok().filter(|n| range.contains(n)).ok_or_else(wrong)
}

/// Parses a port, 1 to 65535.
pub fn port(text: &str) -> Result<u16, String> {
    let wrong = || "expected a port from 1 to 65535".to_owned();
    text.trim().parse().ok().filter(|port| *port > 0).ok_or_else(wrong)
}

/// Parses `on` as true and `off` as false.
pub fn switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("expected on or off".to_owned()),
    }
}

/// All views that have a name, with their names.
pub const VIEWS: [(&str, ViewChoice); 8] = [
    ("auto", ViewChoice::Auto),
    ("iso", ViewChoice::Named(NamedView::Iso)),
    ("front", ViewChoice::Named(NamedView::Front)),
    ("back", ViewChoice::Named(NamedView::Back)),
    ("left", ViewChoice::Named(NamedView::Left)),
    ("right", ViewChoice::Named(NamedView::Right)),
    ("top", ViewChoice::Named(NamedView::Top)),
    ("bottom", ViewChoice::Named(NamedView::Bottom)),
];

/// Parses a view: a name ([`VIEWS`]), or `AZIMUTH,ELEVATION` in degrees. The azimuth is to the right of the front, from
/// −360 to 360. The elevation is above the horizon, from −90 to 90.
pub fn view(text: &str) -> Result<ViewChoice, String> {
    if let Some((_, choice)) = VIEWS.iter().find(|(name, _)| *name == text) {
        return Ok(*choice);
    }
    let names = VIEWS.map(|(name, _)| name).join(", ");
    let wrong = |_| format!("expected {names}, or degrees from the front and above it, as in 30,20");
    let [azimuth_deg, elevation_deg] = list(text, "AZIMUTH,ELEVATION").map_err(wrong)?;
    if azimuth_deg.abs() > 360.0 || elevation_deg.abs() > 90.0 {
        return Err("expected an azimuth from -360 to 360 and an elevation from -90 to 90 degrees".into());
    }
    Ok(ViewChoice::From(ViewAngles { azimuth_deg, elevation_deg }))
}

fn list<const N: usize>(text: &str, form: &str) -> Result<[f64; N], String> {
    let wrong = || format!("expected {form}: {N} finite numbers with commas between them");
    let values: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse::<f64>()).collect();
    let values: [f64; N] = values.ok().and_then(|v| v.try_into().ok()).ok_or_else(wrong)?;
    if values.iter().all(|v| v.is_finite()) { Ok(values) } else { Err(wrong()) }
}

fn number(text: &str, expected: &str, ok: impl Fn(f64) -> bool) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if ok(value) => Ok(value),
        _ => Err(format!("expected {expected}")),
    }
}

/// Parses a point `X,Y,Z`: three finite numbers separated by commas.
pub fn point(text: &str) -> Result<[f64; 3], String> {
    list(text, "X,Y,Z")
}

/// Parses the value of `--origin`: a point `X,Y` of the plane, in the units of the files.
pub fn place(text: &str) -> Result<[f64; 2], String> {
    list(text, "X,Y")
}

/// Parses the value of `--bounds`: a rectangle `X0,Y0,X1,Y1` of the plane with X0 < X1 and Y0 < Y1, in the units of the
/// files.
pub fn bounds(text: &str) -> Result<[f64; 4], String> {
    let bounds = list(text, "X0,Y0,X1,Y1")?;
    if bounds[0] < bounds[2] && bounds[1] < bounds[3] {
        return Ok(bounds);
    }
    Err("expected the least x and y first, then the largest: X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1".into())
}

/// Parses the code of a coordinate reference system that GeoTIFF can store: `EPSG:N`, N from 1024 to 32,766.
pub fn epsg(text: &str) -> Result<u16, String> {
    let digits = text.get(..5).filter(|p| p.eq_ignore_ascii_case("EPSG:")).map_or("", |_| &text[5..]);
    match digits.parse() {
        Ok(code @ 1024..=32_766) => Ok(code),
        _ => Err("expected EPSG:N with N from 1024 to 32766, as in EPSG:25832".into()),
    }
}

/// Parses a direction `X,Y,Z` of any length: three finite numbers, not all 0.
pub fn direction(text: &str) -> Result<[f64; 3], String> {
    match point(text)? {
        [0.0, 0.0, 0.0] => Err("expected a direction that is not zero".into()),
        direction => Ok(direction),
    }
}

/// Parses a range of values `LO,HI`: finite numbers, LO less than HI.
pub fn range(text: &str) -> Result<[f64; 2], String> {
    match list(text, "LO,HI")? {
        [lo, hi] if lo < hi => Ok([lo, hi]),
        _ => Err("expected LO,HI with LO less than HI".into()),
    }
}

/// Value of `--range`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RangeChoice {
    /// One range over all inputs, even if each has its own image.
    Shared,
    /// Stated values at the two ends of the colour map, the first less than the second.
    Values([f64; 2]),
}

/// Parses a value of `--range`: `LO,HI` or `shared`.
pub fn range_choice(text: &str) -> Result<RangeChoice, String> {
    match text {
        "shared" => Ok(RangeChoice::Shared),
        _ => range(text).map(RangeChoice::Values).map_err(|problem| format!("{problem}, or shared")),
    }
}

/// Parses a box `X0,Y0,Z0,X1,Y1,Z1`: its minimum and maximum corner, in the file's coordinates.
pub fn crop(text: &str) -> Result<[f64; 6], String> {
    let c: [f64; 6] = list(text, "X0,Y0,Z0,X1,Y1,Z1")?;
    let ordered = (0..3).all(|k| c[k] <= c[k + 3]);
    if ordered {
        Ok(c)
    } else {
        Err("expected X0,Y0,Z0,X1,Y1,Z1 with X0 at most X1, Y0 at most Y1, Z0 at most Z1".into())
    }
}

/// Checks the syntax of a [`Condition`] such as `intensity>100 and not z<5`. Returns the text, which scene files store.
pub fn condition(text: &str) -> Result<String, String> {
    Condition::parse(text).map(|_| text.trim().to_owned())
}

/// Parses a set of point classes, such as `2,6`, `!7,18` (all but these) or `all`.
pub fn classes(text: &str) -> Result<Classes, String> {
    text.parse()
}

/// Parses the column names of a table, optionally with a type, such as `x,y,z,_,r,g,b` or `f4:x,y,z,intensity`.
pub fn columns(text: &str) -> Result<TableColumns, String> {
    let columns: TableColumns = text.parse()?;
    surfel_io::check_columns(&columns).map(|()| columns)
}

/// Parses the value of `--splats`: `auto`, or a number of splats from 1 to 200,000,000.
pub fn splat_count(text: &str) -> Result<SplatCount, String> {
    if text == "auto" {
        return Ok(SplatCount::Auto);
    }
    let count = text.trim().parse::<u32>().ok().filter(|n| (1..=200_000_000).contains(n));
    count.map(SplatCount::Count).ok_or_else(|| "expected auto, or a whole number from 1 to 200000000".to_owned())
}

/// Parses an image size `WxH` in pixels, each side from 1 to [`MAX_IMAGE_SIDE`].
pub fn size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || format!("expected WxH in pixels, 1 to {MAX_IMAGE_SIDE} a side, such as 1024x768");
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    let side = |s: &str| s.parse::<u32>().ok().filter(|s| (1..=MAX_IMAGE_SIDE).contains(s)).ok_or_else(wrong);
    Ok([side(w)?, side(h)?])
}

/// Parses a memory size in bytes, from 1 to 2⁶⁰: a number, optionally with a unit K, M, G or T, in upper or lower case.
/// B or iB may follow. K is 1024 bytes, and each larger unit is 1024 times the one before.
pub fn memory(text: &str) -> Result<u64, String> {
    let upper = text.trim().to_ascii_uppercase();
    let text = ["IB", "B"].into_iter().find_map(|word| upper.strip_suffix(word)).unwrap_or(&upper);
    let units = [('K', 10), ('M', 20), ('G', 30), ('T', 40)];
    let unit = units.iter().find_map(|(name, bits)| Some((text.strip_suffix(*name)?, *bits)));
    let (count, bits) = unit.unwrap_or((text, 0));
    let bytes = count.trim().parse::<f64>().ok().map(|count| count * f64::from(bits).exp2());
    let ok = bytes.filter(|bytes| (1.0..=2_f64.powi(60)).contains(bytes));
    ok.map(|bytes| bytes as u64).ok_or_else(|| "expected bytes, such as 4G or 512M".to_owned())
}

/// Parses a region `X,Y,W,H` in pixels: left column, top row, width and height, which are at least 1.
pub fn region(text: &str) -> Result<Region, String> {
    let wrong = || "expected X,Y,W,H: four whole numbers of pixels, W and H at least 1".to_owned();
    let values: Result<Vec<u32>, _> = text.split(',').map(|v| v.trim().parse::<u32>()).collect();
    match values.map_err(|_| wrong())?[..] {
        [x, y, width, height] if width > 0 && height > 0 => Ok(Region { x, y, width, height }),
        _ => Err(wrong()),
    }
}

/// Parses the name of an up axis: `+x`, `-x`, `+y`, `-y`, `+z`, `-z`, or `auto` for `None`. A plus sign may be omitted.
pub fn up(text: &str) -> Result<Option<Up>, String> {
    if text == "auto" {
        return Ok(None);
    }
    text.parse().map(Some).map_err(|_| "expected auto, +x, -x, +y, -y, +z or -z".to_owned())
}

/// Parses a field of view in degrees, more than 0 and less than 180.
pub fn fov(text: &str) -> Result<f64, String> {
    number(text, "degrees, more than 0 and less than 180", |v| v > 0.0 && v < 180.0)
}

/// Parses a kernel cutoff: more than 0, at most 50.
pub fn cutoff(text: &str) -> Result<f64, String> {
    number(text, "a number more than 0, at most 50", |v| v > 0.0 && v <= 50.0)
}

/// Parses a prefilter radius in pixels, from 0 to 10,000.
pub fn prefilter(text: &str) -> Result<f64, String> {
    number(text, "a number of pixels from 0 to 10000", |v| (0.0..=1e4).contains(&v))
}

/// Parses a number greater than 0, at most 1,000,000.
pub fn positive(text: &str) -> Result<f64, String> {
    number(text, "a number more than 0, at most 1000000", |v| v > 0.0 && v <= 1e6)
}

/// Parses the angle of a crease in degrees, from 1 to 179.
pub fn crease_angle(text: &str) -> Result<f64, String> {
    number(text, "degrees from 1 to 179", |v| ConvertOptions::CREASE_ANGLES_DEG.contains(&v))
}

/// Parses a depth tolerance: `K` splat radii, or `abs:D` world units; both are finite and at least 0.
pub fn depth_tolerance(text: &str) -> Result<DepthTolerance, String> {
    let expected = "K (times the splat's radius) or abs:D (world units), at least 0";
    let ok = |v: f64| v >= 0.0 && v.is_finite();
    match text.strip_prefix("abs:") {
        Some(absolute) => number(absolute, expected, ok).map(DepthTolerance::Absolute),
        None => number(text, expected, ok).map(DepthTolerance::Relative),
    }
}

/// Parses a transparency method: `off`, `peel:N`, `peel:N:drop` or `abuffer:L`, with N and L from 1 to 64.
pub fn transparency(text: &str) -> Result<Transparency, String> {
    text.parse().map_err(|_| "expected off, peel:N, peel:N:drop or abuffer:L, with 1 to 64 layers".to_owned())
}

/// Parses the kind of splat of a point: `surface`, `balls`, `disks` or `dots`, the last three optionally with a radius.
pub fn points_as(text: &str) -> Result<PointsAs, String> {
    text.parse()
}

/// Parses a colour: `#rrggbb`, `#rgb`, or a name of CSS.
pub fn color(text: &str) -> Result<Color, String> {
    text.parse()
}

/// Parses a background: a colour, `R,G,B[,A]` (finite linear RGB, straight alpha from 0 to 1), or `transparent`.
pub fn background(text: &str) -> Result<[f64; 4], String> {
    if text == "transparent" {
        return Ok([0.0; 4]);
    }
    if let Ok(Color(levels)) = color(text) {
        let [r, g, b] = levels.map(|level| srgb::decode(f64::from(level) / 255.0));
        return Ok([r, g, b, 1.0]);
    }
    let wrong = |_| {
        let forms = "R,G,B or R,G,B,A (linear numbers, A from 0 to 1), or transparent";
        format!("expected a colour such as white or #f0f0f0, {forms}")
    };
    let [r, g, b, a] = match text.split(',').count() {
        3 => list::<3>(text, "").map(|[r, g, b]| [r, g, b, 1.0]).map_err(wrong)?,
        _ => list::<4>(text, "").map_err(wrong)?,
    };
    if (0.0..=1.0).contains(&a) { Ok([r, g, b, a]) } else { Err(wrong(String::new())) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    #[test]
    fn frame_ranges_have_both_ends() {
        let range = |first, last, step| Ok(FrameRange { first, last, step });
        assert_eq!(frame_range("0-9"), range(0, 9, 1));
        assert_eq!(frame_range("5-5:3"), range(5, 5, 3));
        assert_eq!(frame_range("7"), range(7, 7, 1));
        for bad in ["", "-", "9-0", "0-9:0", "0-9:", "a-b", "0..9", "-1-3", "0-99999999999"] {
            assert!(frame_range(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn memory_is_bytes_with_or_without_a_unit() {
        for (text, bytes) in [
            ("7", 7),
            ("2K", 2048),
            ("512M", 512 << 20),
            ("1.5g", 3 << 29),
            (" 4 G ", 4 << 30),
            ("200MB", 200 << 20),
            ("2GiB", 2 << 30),
            ("9b", 9),
        ] {
            assert_eq!(memory(text), Ok(bytes), "{text}");
        }
        for text in ["", "G", "GB", "B", "-1G", "0", "nan", "1e99T", "4BG", "4é"] {
            assert!(memory(text).is_err(), "{text}");
        }
    }

    #[test]
    fn scene_files_spell_values_as_flags_do() {
        macro_rules! check {
            ($type:ty, $named:expr) => {
                for (name, value) in $named {
                    let read = serde_json::from_value::<$type>(Value::from(*name));
                    assert_eq!(read.ok().as_ref(), Some(value), "{name}");
                }
            };
        }
        check!(Filter, FILTERS);
        check!(Cull, CULLS);
        check!(Colormap, COLORMAPS);
        check!(PointColors, POINT_COLORS);
        check!(Outliers, OUTLIERS);
        check!(Returns, RETURNS);
        check!(Mapping, MAPPINGS);
        check!(Accumulate, ACCUMULATES);
        check!(ClipPolicy, CLIPS);
        check!(Shader, SHADERS);
        check!(Composite, COMPOSITES);
        check!(Sort, SORTS);
        check!(EdgeAa, EDGE_AA);
        for text in ["off", "peel:3", "peel:3:drop", "abuffer:8"] {
            check!(Transparency, &[(text, transparency(text).unwrap())]);
        }
        for text in ["2,6", "!7,18", "all"] {
            check!(Classes, &[(text, classes(text).unwrap())]);
        }
        for text in ["+x", "-y", "+z"] {
            check!(Up, &[(text, up(text).unwrap().unwrap())]);
        }
        check!(SplatCount, &[("auto", SplatCount::Auto)]);
        check!(DepthTolerance, &[("abs:0.5", depth_tolerance("abs:0.5").unwrap())]);
    }

    #[test]
    fn parts_have_everything_once_counted_from_0_or_from_1() {
        for count in [1_u32, 2, 3, 7, 64, 1000] {
            for length in [0_u64, 1, 2, 7, 63, 64, 65, 65_536] {
                for first in [0, 1] {
                    let mut all: Vec<u64> = (first..first + count)
                        .flat_map(|i| part(&format!("{i}/{count}")).unwrap().of(length))
                        .collect();
                    all.sort_unstable();
                    assert_eq!(all, (0..length).collect::<Vec<_>>(), "{count} parts of {length} from {first}");
                }
            }
        }
        for bad in ["", "1", "1/0", "3/2", "-1/2", "1/2/3", "a/b", "1/1000001", "1/99999999999999999999"] {
            assert!(part(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for bad in ["0x5", "5", "x", "-1x2", "70000x2", "1.5x2"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        for bad in ["1,2", "1,2,nan", "1,2,inf", "a,b,c", ""] {
            assert!(point(bad).is_err(), "{bad}");
        }
        for bad in ["0,0,0,1", "1,2,3", "-1,0,1,1"] {
            assert!(region(bad).is_err(), "{bad}");
        }
        for bad in ["1,1", "1,1,1,2", "reddish", "0,0,0,-0.1"] {
            assert!(background(bad).is_err(), "{bad}");
        }
        for bad in ["0", "180", "nan", "x"] {
            assert!(fov(bad).is_err(), "{bad}");
        }
        assert!(depth_tolerance("abs:-1").is_err() && depth_tolerance("inf").is_err());
        assert_eq!(depth_tolerance("abs:0.5"), Ok(DepthTolerance::Absolute(0.5)));
        assert_eq!(background("transparent"), Ok([0.0; 4]));
        assert_eq!((background("red"), background("#fff")), (Ok([1.0, 0.0, 0.0, 1.0]), Ok([1.0; 4])));
        for bad in ["", "side", "30", "30,91", "1,2,3", "nan,0"] {
            assert!(view(bad).is_err(), "{bad}");
        }
        assert_eq!(view("auto"), Ok(ViewChoice::Auto));
        assert_eq!(view("-30,45"), Ok(ViewChoice::From(ViewAngles { azimuth_deg: -30.0, elevation_deg: 45.0 })));
        assert_eq!(up("-Z"), Ok(Some(Up::MinusZ)));
    }
}
