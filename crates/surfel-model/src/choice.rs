//! Selection of a file's points and splats by the options `crop`, `classes`, `returns`, `where` and `every`.

use crate::{Condition, ConvertOptions, ExtraColumn};
use glam::DVec3;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Selection of points by their return: the number of an echo among the echoes of one laser pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum Returns {
    /// Last return of each pulse: the ground below trees.
    Last,
    /// First return of each pulse: roofs and crowns.
    First,
    /// Single return of pulses with only one.
    Single,
}

/// Selection of points by class number. Written as `2,6`, `!7,18` (all but these) or `all`; scene files may also use
/// `[2, 6]`.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "ClassesKey", into = "ClassesKey"))]
pub enum Classes {
    /// Every class.
    All,
    /// Only the listed classes; at least one.
    Only(Vec<u32>),
    /// Every class but these; at least one.
    Except(Vec<u32>),
}

impl Classes {
    /// True if points of this class are selected. NaN is no class: `Only` excludes it, `All` and `Except` include it.
    pub fn include(&self, class: f64) -> bool {
        let is_among = |numbers: &[u32]| numbers.iter().any(|n| f64::from(*n) == class);
        match self {
            Self::All => true,
            Self::Only(numbers) => is_among(numbers),
            Self::Except(numbers) => !is_among(numbers),
        }
    }
}

impl std::str::FromStr for Classes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text == "all" {
            return Ok(Self::All);
        }
        let (is_exclusion, list) = text.strip_prefix('!').map_or((false, text), |list| (true, list));
        let numbers: Option<Vec<u32>> = list.split(',').map(|n| n.trim().parse().ok()).collect();
        match numbers {
            Some(numbers) if is_exclusion => Ok(Self::Except(numbers)),
            Some(numbers) => Ok(Self::Only(numbers)),
            None => Err("expected numbers of classes, such as 2,6, or '!7,18' for all but these, or all".to_owned()),
        }
    }
}

impl std::fmt::Display for Classes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let list = |numbers: &[u32]| numbers.iter().map(u32::to_string).collect::<Vec<_>>().join(",");
        match self {
            Self::All => f.write_str("all"),
            Self::Only(numbers) => f.write_str(&list(numbers)),
            Self::Except(numbers) => write!(f, "!{}", list(numbers)),
        }
    }
}

#[cfg(feature = "serde")]
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "a list of classes such as [2, 6], \"!7,18\" for all but these, or \"all\"")]
enum ClassesKey {
    Numbers(Vec<u32>),
    Text(String),
}

#[cfg(feature = "serde")]
impl TryFrom<ClassesKey> for Classes {
    type Error = String;

    fn try_from(key: ClassesKey) -> Result<Self, String> {
        match key {
            // An empty list would select nothing, so it means all classes.
            ClassesKey::Numbers(numbers) if numbers.is_empty() => Ok(Self::All),
            ClassesKey::Numbers(numbers) => Ok(Self::Only(numbers)),
            ClassesKey::Text(text) => text.parse().map_err(|problem| format!("classes is \"{text}\", {problem}")),
        }
    }
}

#[cfg(feature = "serde")]
impl From<Classes> for ClassesKey {
    fn from(classes: Classes) -> Self {
        match classes {
            Classes::Only(numbers) => Self::Numbers(numbers),
            other => Self::Text(other.to_string()),
        }
    }
}

/// Result of a selection of points, with the number of points that are left after each step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chosen {
    /// One flag per point, true if the point is selected; empty if no step was requested, so that all are selected.
    pub keep: Vec<bool>,
    /// Steps that the options request, in order: the step's key in the scene file, and the number of points left after
    /// it. Notes report them.
    pub left: Vec<(&'static str, usize)>,
}

/// Selects points by the options `crop`, `classes`, `returns`, `where` and `every`, in this order.
///
/// `count` is the number of points, and `position(i)` is the position of point `i` in the file's coordinates. `extras`
/// has the points' attributes.
///
/// # Errors
/// A message about a missing attribute, with the available ones, or about a condition that can't be parsed.
pub fn choose(
    options: &ConvertOptions,
    count: usize,
    position: &dyn Fn(usize) -> DVec3,
    extras: &[ExtraColumn],
) -> Result<Chosen, String> {
    let find = |name: &str, key: &str| {
        ExtraColumn::find(extras, name).ok_or_else(|| {
            let mut names: Vec<String> = ["x", "y", "z"].map(str::to_owned).to_vec();
            names.extend(extras.iter().map(|e| e.name.escape_debug().to_string()));
            format!("has no attribute '{}', which {key} needs: it has {}", name.escape_debug(), names.join(", "))
        })
    };
    let mut chosen = Chosen::default();
    let mut step = |key: &'static str, holds: &dyn Fn(usize) -> bool| {
        if chosen.keep.is_empty() {
            chosen.keep = vec![true; count];
        }
        chosen.keep.iter_mut().enumerate().for_each(|(i, keep)| *keep = *keep && holds(i));
        chosen.left.push((key, chosen.keep.iter().filter(|k| **k).count()));
    };
    if let Some([x0, y0, z0, x1, y1, z1]) = options.crop {
        let (lo, hi) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
        step("crop", &|i| {
            let p = position(i);
            p.cmpge(lo).all() && p.cmple(hi).all()
        });
    }
    match &options.classes {
        None | Some(Classes::All) => {}
        // Readers omit a column of zeros.
        Some(Classes::Except(_)) if ExtraColumn::find(extras, "classification").is_none() => {
            step("classes", &|_| true);
        }
        Some(classes) => {
            let column = &find("classification", "classes")?.values;
            step("classes", &|i| classes.include(column.get(i)));
        }
    }
    if let Some(returns) = options.returns {
        let total = || Ok::<_, String>(&find("number_of_returns", "returns")?.values);
        let number = || Ok::<_, String>(&find("return_number", "returns")?.values);
        match returns {
            Returns::First => {
                let number = number()?;
                step("returns", &|i| number.get(i) == 1.0);
            }
            Returns::Last => {
                let (number, total) = (number()?, total()?);
                step("returns", &|i| number.get(i) == total.get(i));
            }
            Returns::Single => {
                let total = total()?;
                step("returns", &|i| total.get(i) == 1.0);
            }
        }
    }
    if let Some(text) = &options.condition {
        let condition = Condition::parse(text).map_err(|problem| format!("can't be chosen from: where {problem}"))?;
        let mut columns = Vec::new();
        for term in condition.terms() {
            let axis = ["x", "y", "z"].iter().position(|axis| term.name.eq_ignore_ascii_case(axis));
            let column = if axis.is_some() { None } else { Some(&find(&term.name, "where")?.values) };
            columns.push((axis.unwrap_or(0), column));
        }
        step("where", &|i| {
            condition.holds(&|term| {
                let (axis, column) = columns[term];
                column.map_or_else(|| position(i)[axis], |column| column.get(i))
            })
        });
    }
    if let Some(every) = options.every.filter(|n| *n > 1) {
        if chosen.keep.is_empty() {
            chosen.keep = vec![true; count];
        }
        for (nth, keep) in chosen.keep.iter_mut().filter(|keep| **keep).enumerate() {
            *keep = nth % every as usize == 0;
        }
        chosen.left.push(("every", chosen.keep.iter().filter(|k| **k).count()));
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ExtraValues;

    #[test]
    fn classes_are_listed_or_left_out() {
        let parse = |text: &str| text.parse::<Classes>();
        assert_eq!(parse(" 2, 6"), Ok(Classes::Only(vec![2, 6])));
        assert_eq!(parse("!7,18"), Ok(Classes::Except(vec![7, 18])));
        assert_eq!(parse("all"), Ok(Classes::All));
        for bad in ["", "!", "2,", "-1", "2,!7", "!7,!18", "1.5", "ground", "ALL"] {
            assert!(parse(bad).unwrap_err().contains("'!7,18' for all but these"), "{bad}");
        }
        for text in ["all", "2,6", "!7,18"] {
            assert_eq!(parse(text).unwrap().to_string(), text);
        }
        let include = |text: &str| [2.0, 7.0, 18.0, f64::NAN].map(|class| parse(text).unwrap().include(class));
        assert_eq!(include("2,18"), [true, false, true, false]);
        assert_eq!(include("!7,18"), [true, false, false, true]);
        assert_eq!(include("all"), [true; 4]);
    }

    #[test]
    fn no_class_is_left_out_where_a_file_has_none() {
        let at = |_: usize| DVec3::ZERO;
        let of = |text: &str| {
            let options = ConvertOptions { classes: Some(text.parse().unwrap()), ..ConvertOptions::default() };
            choose(&options, 3, &at, &[]).map(|chosen| chosen.left)
        };
        assert_eq!(of("!7"), Ok(vec![("classes", 3)]));
        assert_eq!(of("all"), Ok(vec![]));
        assert!(of("2").unwrap_err().contains("has no attribute 'classification'"));
    }

    #[test]
    fn steps_come_in_order_and_each_says_what_it_leaves() {
        let column = |name: &str, f: fn(usize) -> f64| ExtraColumn {
            name: name.into(),
            values: ExtraValues::F64((0..100).map(f).collect()),
        };
        let extras = [
            column("Classification", |i| if i % 2 == 0 { 2.0 } else { f64::NAN }),
            column("return_number", |i| if i < 50 { 1.0 } else { 2.0 }),
            column("number_of_returns", |i| if i < 25 { 1.0 } else { 2.0 }),
        ];
        let at = |i: usize| DVec3::splat(i as f64);
        let run = |options: &ConvertOptions| choose(options, 100, &at, &extras).unwrap();
        let all = ConvertOptions {
            crop: Some([10.0, 10.0, 10.0, 90.0, 90.0, 89.0]),
            classes: Some(Classes::Only(vec![2, 6])),
            returns: Some(Returns::First),
            condition: Some("x>=20 and z<40".into()),
            every: Some(4),
            ..ConvertOptions::default()
        };
        let chosen = run(&all);
        assert_eq!(chosen.left, [("crop", 80), ("classes", 40), ("returns", 20), ("where", 10), ("every", 3)]);
        let kept: Vec<usize> = (0..100).filter(|i| chosen.keep[*i]).collect();
        assert_eq!(kept, [20, 28, 36]);
        let only = |returns| run(&ConvertOptions { returns: Some(returns), ..ConvertOptions::default() }).left[0].1;
        assert_eq!([Returns::First, Returns::Last, Returns::Single].map(only), [50, 75, 25]);
        // NaN is no class, and isn't a number different from one either.
        let not = ConvertOptions { condition: Some("classification != 7".into()), ..ConvertOptions::default() };
        assert_eq!(run(&not).left, [("where", 50)]);
        let either = "not (classification = 2 or x < 90) || x=0 && return_number==1";
        let either = ConvertOptions { condition: Some(either.into()), ..ConvertOptions::default() };
        assert_eq!(run(&either).left, [("where", 6)]);
        assert_eq!(run(&ConvertOptions::default()), Chosen::default());
        let unknown = ConvertOptions { condition: Some("gps>1".into()), ..ConvertOptions::default() };
        let error = choose(&unknown, 100, &at, &extras).unwrap_err();
        assert!(error.contains("'gps'") && error.contains("x, y, z, Classification, return_number"), "{error}");
    }
}
