//! Value parsers for clap, based on [`surfel::values`].

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use surfel::Preset;
use surfel::framing::ViewChoice;
use surfel::model::{
    Accumulate, ClipPolicy, Colormap, Composite, Cull, EdgeAa, Filter, Mapping, Outliers, PointColors, Returns, Shader,
    Sort, Up,
};
use surfel::values::{self, VIEWS};
pub(crate) use surfel::values::{
    angle, background, bounds, classes, columns, condition, crop, cutoff, depth_tolerance, direction, epsg, fov,
    json_number, memory, part, place, point, positive, prefilter, range_choice, region, size, splat_count,
    transparency, view,
};

/// Defines a parser of named values whose names appear in help and completions.
macro_rules! named {
    ($function:ident, $type:ty, $all:ident) => {
        #[doc = concat!("Parses a [`", stringify!($type), "`] by name.")]
        pub(crate) fn $function() -> impl TypedValueParser<Value = $type> {
            let names = values::$all.iter().map(|(name, _)| PossibleValue::new(*name));
            PossibleValuesParser::new(names).try_map(|name| values::$function(&name))
        }
    };
}

named!(filter, Filter, FILTERS);
named!(cull, Cull, CULLS);
named!(colormap, Colormap, COLORMAPS);
named!(outliers, Outliers, OUTLIERS);
named!(point_colors, PointColors, POINT_COLORS);
named!(returns, Returns, RETURNS);
named!(mapping, Mapping, MAPPINGS);
named!(accumulate, Accumulate, ACCUMULATES);
named!(clip, ClipPolicy, CLIPS);
named!(shader, Shader, SHADERS);
named!(preset, Preset, PRESETS);
named!(composite, Composite, COMPOSITES);
named!(sort, Sort, SORTS);
named!(edge_aa, EdgeAa, EDGE_AA);

/// Parser of `--view`: a name, which appears in help and completions, or AZIMUTH,ELEVATION.
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

/// Parses `--up`: an axis, or `None` for `auto`.
pub(crate) fn up(text: &str) -> Result<UpChoice, String> {
    values::up(text).map(UpChoice)
}

/// Value of `--up`. It is a type of its own, since clap would interpret a plain `Option` as an optional flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct UpChoice(pub(crate) Option<Up>);

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_out_of_range_are_refused() {
        for bad in ["rmse", "rmse=x", "ssim=1", "rmse=nan"] {
            assert!(threshold(bad).is_err(), "{bad}");
        }
        assert_eq!(threshold("max-abs=0.1").unwrap().metric, "max_abs");
    }
}
