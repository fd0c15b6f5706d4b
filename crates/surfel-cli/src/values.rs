//! Parsers of flag values.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use serde_json::Value;
use surfel::framing::{NamedView, ViewAngles, ViewChoice};
use surfel::model::Up;
use surfel::model::{
    Accumulate, ClipPolicy, Colormap, Cull, DepthTolerance, EdgeAa, Filter, MAX_IMAGE_SIDE, Mapping, PointColors,
    Returns, Shader, SplatCount, Transparency,
};
use surfel::{Preset, Region};

/// A parser of named values that is also known to help and completions.
macro_rules! named {
    ($function:ident, $type:ty, [$($name:literal => $value:expr),+ $(,)?]) => {
        #[doc = concat!("Parses a [`", stringify!($type), "`] by name.")]
        pub(crate) fn $function() -> impl TypedValueParser<Value = $type> {
            PossibleValuesParser::new([$($name),+]).try_map(|name| match name.as_str() {
                $($name => Ok($value),)+
                other => Err(format!("unknown name '{other}'")),
            })
        }
    };
}

named!(filter, Filter, [
    "none" => Filter::None, "clamp" => Filter::Clamp, "adjust" => Filter::Adjust,
    "principal" => Filter::Principal, "ewa" => Filter::Ewa,
]);
named!(cull, Cull, ["none" => Cull::None, "back" => Cull::Back]);
named!(colormap, Colormap, [
    "viridis" => Colormap::Viridis, "cividis" => Colormap::Cividis, "turbo" => Colormap::Turbo,
    "coolwarm" => Colormap::Coolwarm, "tab20" => Colormap::Tab20, "grey" => Colormap::Grey,
]);
named!(point_colors, PointColors, ["as-is" => PointColors::AsIs, "fit" => PointColors::Fit]);
named!(returns, Returns, ["last" => Returns::Last, "first" => Returns::First, "single" => Returns::Single]);
named!(mapping, Mapping, ["exact" => Mapping::Exact, "affine" => Mapping::Affine]);
named!(accumulate, Accumulate, ["f32" => Accumulate::F32, "f16" => Accumulate::F16]);
named!(clip, ClipPolicy, [
    "exact" => ClipPolicy::Exact, "paper" => ClipPolicy::Paper, "line" => ClipPolicy::Line, "off" => ClipPolicy::Off,
]);
named!(shader, Shader, [
    "unlit" => Shader::Unlit, "phong" => Shader::Phong, "toon" => Shader::Toon,
    "normal" => Shader::Normal, "depth" => Shader::Depth, "matcap" => Shader::Matcap, "edl" => Shader::Edl,
]);
named!(preset, Preset, [
    "fastest" => Preset::Fastest, "fast" => Preset::Fast, "balanced" => Preset::Balanced,
    "quality" => Preset::Quality, "reference" => Preset::Reference,
]);
named!(edge_aa, EdgeAa, ["on" => EdgeAa::Coverage, "off" => EdgeAa::Off, "samples" => EdgeAa::Samples]);

/// Views by name, as `--view` takes them.
const VIEWS: [(&str, ViewChoice); 8] = [
    ("auto", ViewChoice::Auto),
    ("iso", ViewChoice::Named(NamedView::Iso)),
    ("front", ViewChoice::Named(NamedView::Front)),
    ("back", ViewChoice::Named(NamedView::Back)),
    ("left", ViewChoice::Named(NamedView::Left)),
    ("right", ViewChoice::Named(NamedView::Right)),
    ("top", ViewChoice::Named(NamedView::Top)),
    ("bottom", ViewChoice::Named(NamedView::Bottom)),
];

/// Parses `--view`: a name, which help and completions know too, or AZIMUTH,ELEVATION.
#[derive(Clone)]
pub(crate) struct View;

impl TypedValueParser for View {
    type Value = ViewChoice;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &std::ffi::OsStr,
    ) -> Result<ViewChoice, clap::Error> {
        (|text: &str| view(text)).parse_ref(command, argument, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(VIEWS.iter().map(|(name, _)| PossibleValue::new(*name))))
    }
}

/// A view's name, or degrees to the right of the front and above the horizon.
pub(crate) fn view(text: &str) -> Result<ViewChoice, String> {
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

pub(crate) fn point(text: &str) -> Result<[f64; 3], String> {
    list(text, "X,Y,Z")
}

pub(crate) fn direction(text: &str) -> Result<[f64; 3], String> {
    match point(text)? {
        [0.0, 0.0, 0.0] => Err("expected a direction that is not zero".into()),
        direction => Ok(direction),
    }
}

/// `--range`.
pub(crate) fn range(text: &str) -> Result<[f64; 2], String> {
    match list(text, "LO,HI")? {
        [lo, hi] if lo < hi => Ok([lo, hi]),
        _ => Err("expected LO,HI with LO less than HI".into()),
    }
}

/// `--crop`.
pub(crate) fn crop(text: &str) -> Result<[f64; 6], String> {
    let c: [f64; 6] = list(text, "X0,Y0,Z0,X1,Y1,Z1")?;
    let ordered = (0..3).all(|k| c[k] <= c[k + 3]);
    if ordered {
        Ok(c)
    } else {
        Err("expected X0,Y0,Z0,X1,Y1,Z1 with X0 at most X1, Y0 at most Y1, Z0 at most Z1".into())
    }
}

/// `--where`, whose text a scene file keeps.
pub(crate) fn condition(text: &str) -> Result<String, String> {
    surfel::model::parse_conditions(text).map(|_| text.trim().to_owned())
}

pub(crate) fn splat_count(text: &str) -> Result<SplatCount, String> {
    if text == "auto" {
        return Ok(SplatCount::Auto);
    }
    let count = text.parse::<u32>().ok().filter(|n| (1..=200_000_000).contains(n));
    count.map(SplatCount::Count).ok_or_else(|| "expected auto, or a whole number from 1 to 200000000".to_owned())
}

pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || format!("expected WxH in pixels, 1 to {MAX_IMAGE_SIDE} a side, such as 1024x768");
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    let side = |s: &str| s.parse::<u32>().ok().filter(|s| (1..=MAX_IMAGE_SIDE).contains(s)).ok_or_else(wrong);
    Ok([side(w)?, side(h)?])
}

pub(crate) fn region(text: &str) -> Result<Region, String> {
    let wrong = || "expected X,Y,W,H: four whole numbers of pixels, W and H at least 1".to_owned();
    let values: Result<Vec<u32>, _> = text.split(',').map(|v| v.trim().parse::<u32>()).collect();
    match values.map_err(|_| wrong())?[..] {
        [x, y, width, height] if width > 0 && height > 0 => Ok(Region { x, y, width, height }),
        _ => Err(wrong()),
    }
}

/// `--up`: an axis, or `None` for `auto`.
pub(crate) fn up(text: &str) -> Result<UpChoice, String> {
    if text == "auto" {
        return Ok(UpChoice(None));
    }
    text.parse().map(|up| UpChoice(Some(up))).map_err(|_| "expected auto, +x, -x, +y, -y, +z or -z".to_owned())
}

/// The value of `--up`; a type of its own, so that clap doesn't take the inner option for an optional flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct UpChoice(pub(crate) Option<Up>);

pub(crate) fn fov(text: &str) -> Result<f64, String> {
    number(text, "degrees, more than 0 and less than 180", |v| v > 0.0 && v < 180.0)
}

pub(crate) fn cutoff(text: &str) -> Result<f64, String> {
    number(text, "a number more than 0, at most 50", |v| v > 0.0 && v <= 50.0)
}

pub(crate) fn prefilter(text: &str) -> Result<f64, String> {
    number(text, "a number of pixels from 0 to 10000", |v| (0.0..=1e4).contains(&v))
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    number(text, "a number more than 0, at most 1000000", |v| v > 0.0 && v <= 1e6)
}

pub(crate) fn angle(text: &str) -> Result<f64, String> {
    number(text, "degrees from 0 to 180", |v| (0.0..=180.0).contains(&v))
}

pub(crate) fn depth_tolerance(text: &str) -> Result<DepthTolerance, String> {
    let expected = "K (times the splat's radius) or abs:D (world units), at least 0";
    let ok = |v: f64| v >= 0.0 && v.is_finite();
    match text.strip_prefix("abs:") {
        Some(absolute) => number(absolute, expected, ok).map(DepthTolerance::Absolute),
        None => number(text, expected, ok).map(DepthTolerance::Relative),
    }
}

pub(crate) fn transparency(text: &str) -> Result<Transparency, String> {
    text.parse().map_err(|_| "expected off, peel:N, peel:N:drop or abuffer:L, with 1 to 64 layers".to_owned())
}

/// `R,G,B[,A]` (linear, straight alpha) or `transparent`.
pub(crate) fn background(text: &str) -> Result<[f64; 4], String> {
    if text == "transparent" {
        return Ok([0.0; 4]);
    }
    let wrong = |_| "expected R,G,B or R,G,B,A (linear numbers, A from 0 to 1), or transparent".to_owned();
    let [r, g, b, a] = match text.split(',').count() {
        3 => list::<3>(text, "").map(|[r, g, b]| [r, g, b, 1.0]).map_err(wrong)?,
        _ => list::<4>(text, "").map_err(wrong)?,
    };
    if (0.0..=1.0).contains(&a) { Ok([r, g, b, a]) } else { Err(wrong(String::new())) }
}

/// A metric's name and its threshold.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Threshold {
    pub(crate) metric: &'static str,
    pub(crate) value: f64,
}

/// Names of metrics, as `compare` prints them.
pub(crate) const METRICS: [&str; 4] = ["max_abs", "rmse", "psnr", "flip"];

pub(crate) fn threshold(text: &str) -> Result<Threshold, String> {
    let wrong = || format!("expected METRIC=V, METRIC one of {}, V a number", METRICS.join(", "));
    let (name, value) = text.split_once('=').ok_or_else(wrong)?;
    let name = name.trim().to_ascii_lowercase().replace('-', "_");
    let metric = METRICS.into_iter().find(|m| *m == name).ok_or_else(wrong)?;
    let value = value.trim().parse::<f64>().ok().filter(|v| !v.is_nan()).ok_or_else(wrong)?;
    Ok(Threshold { metric, value })
}

/// A number for JSON, which knows no infinities: those become `"inf"` and `"-inf"`.
pub(crate) fn json_number(value: f64) -> Value {
    match value {
        v if v.is_finite() => Value::from(v),
        v if v.is_nan() => Value::from("nan"),
        v => Value::from(if v > 0.0 { "inf" } else { "-inf" }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        for bad in ["1,1", "1,1,1,2", "red", "0,0,0,-0.1"] {
            assert!(background(bad).is_err(), "{bad}");
        }
        for bad in ["0", "180", "nan", "x"] {
            assert!(fov(bad).is_err(), "{bad}");
        }
        for bad in ["rmse", "rmse=x", "ssim=1", "rmse=nan"] {
            assert!(threshold(bad).is_err(), "{bad}");
        }
        assert!(depth_tolerance("abs:-1").is_err() && depth_tolerance("inf").is_err());
        assert_eq!(depth_tolerance("abs:0.5"), Ok(DepthTolerance::Absolute(0.5)));
        assert_eq!(threshold("max-abs=0.1").unwrap().metric, "max_abs");
        assert_eq!(background("transparent"), Ok([0.0; 4]));
        for bad in ["", "side", "30", "30,91", "1,2,3", "nan,0"] {
            assert!(view(bad).is_err(), "{bad}");
        }
        assert_eq!(view("auto"), Ok(ViewChoice::Auto));
        assert_eq!(view("-30,45"), Ok(ViewChoice::From(ViewAngles { azimuth_deg: -30.0, elevation_deg: 45.0 })));
        assert_eq!(up("-Z"), Ok(UpChoice(Some(Up::MinusZ))));
    }
}
