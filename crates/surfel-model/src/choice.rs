//! Which points and splats of a file count: what `crop`, `classes`, `returns`, `where` and `every` mean.

use crate::{ConvertOptions, ExtraColumn};
use glam::DVec3;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Which of a pulse's returns count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum Returns {
    /// The last one of each pulse: the ground, below trees.
    Last,
    /// The first one of each pulse: roofs and crowns.
    First,
    /// The only one of pulses with one return.
    Single,
}

/// A comparison of an attribute with a number.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// `x`, `y`, `z` or the name of a property.
    pub name: String,
    /// How they are compared.
    pub comparison: Comparison,
    /// The number.
    pub value: f64,
}

/// How two numbers are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Comparison {
    Less,
    AtMost,
    Greater,
    AtLeast,
    Equal,
    NotEqual,
}

impl Comparison {
    fn holds(self, a: f64, b: f64) -> bool {
        match self {
            Self::Less => a < b,
            Self::AtMost => a <= b,
            Self::Greater => a > b,
            Self::AtLeast => a >= b,
            Self::Equal => a == b,
            // What isn't a number fulfils no condition.
            Self::NotEqual => a != b && !a.is_nan(),
        }
    }
}

/// Parses comparisons joined by `and`: `intensity>100 and classification != 7`.
///
/// # Errors
/// What was found and what is expected.
pub fn parse_conditions(text: &str) -> Result<Vec<Condition>, String> {
    let mut rest = text;
    let mut parts = Vec::new();
    // `and` counts as a word of its own, in any case: a name such as `band` has it inside.
    while let Some(at) = and_in(rest) {
        parts.push(&rest[..at]);
        rest = &rest[at + 3..];
    }
    parts.push(rest);
    parts.into_iter().map(condition).collect()
}

fn and_in(text: &str) -> Option<usize> {
    let is_blank = |c: Option<u8>| c.is_some_and(|c| c.is_ascii_whitespace());
    let bytes = text.as_bytes();
    (1..bytes.len().saturating_sub(3)).find(|&i| {
        bytes[i..i + 3].eq_ignore_ascii_case(b"and")
            && is_blank(bytes.get(i - 1).copied())
            && is_blank(bytes.get(i + 3).copied())
    })
}

fn condition(text: &str) -> Result<Condition, String> {
    let wrong = || {
        let text: String = text.trim().chars().take(60).collect();
        format!("has '{text}', expected comparisons with a number, such as intensity>100 and classification!=7")
    };
    let at = text.find(['<', '>', '=', '!']).ok_or_else(wrong)?;
    let (name, rest) = text.split_at(at);
    let table = [
        ("<=", Comparison::AtMost),
        (">=", Comparison::AtLeast),
        ("==", Comparison::Equal),
        ("!=", Comparison::NotEqual),
        ("<", Comparison::Less),
        (">", Comparison::Greater),
        ("=", Comparison::Equal),
    ];
    let found = table.into_iter().find_map(|(sign, comparison)| Some((rest.strip_prefix(sign)?, comparison)));
    let (value, comparison) = found.ok_or_else(wrong)?;
    let value = value.trim().parse::<f64>().ok().filter(|v| !v.is_nan()).ok_or_else(wrong)?;
    let name = name.trim().to_owned();
    if name.is_empty() { Err(wrong()) } else { Ok(Condition { name, comparison, value }) }
}

/// What is chosen of a file's points or splats, step by step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chosen {
    /// A flag a point; empty where nothing is asked for.
    pub keep: Vec<bool>,
    /// What each step that was asked for leaves: its key in the scene file and the number of points.
    pub left: Vec<(&'static str, usize)>,
}

/// Applies `crop`, `classes`, `returns`, `where` and `every`, in this order, to `count` points at `position(i)`.
///
/// # Errors
/// What attribute is missing, and which there are; or a condition that can't be parsed.
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
    if !options.classes.is_empty() {
        let column = &find("classification", "classes")?.values;
        step("classes", &|i| options.classes.iter().any(|c| f64::from(*c) == column.get(i)));
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
        let mut columns = Vec::new();
        for condition in parse_conditions(text).map_err(|problem| format!("can't be chosen from: where {problem}"))? {
            let axis = ["x", "y", "z"].iter().position(|axis| condition.name.eq_ignore_ascii_case(axis));
            let column = if axis.is_some() { None } else { Some(&find(&condition.name, "where")?.values) };
            columns.push((condition, axis.unwrap_or(0), column));
        }
        step("where", &|i| {
            columns.iter().all(|(condition, axis, column)| {
                let value = column.map_or_else(|| position(i)[*axis], |column| column.get(i));
                condition.comparison.holds(value, condition.value)
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
    fn conditions_are_comparisons_joined_by_and() {
        let parsed = parse_conditions(" intensity>100 AND band <= -2.5e1 and z != 3 and a=1").unwrap();
        let is = |name: &str, comparison, value| Condition { name: name.into(), comparison, value };
        let expected = [
            is("intensity", Comparison::Greater, 100.0),
            is("band", Comparison::AtMost, -25.0),
            is("z", Comparison::NotEqual, 3.0),
            is("a", Comparison::Equal, 1.0),
        ];
        assert_eq!(parsed, expected);
        for bad in ["", "intensity", "intensity>", ">3", "a>b", "a>1 and", "a>1 or b<2", "a>nan", "a!3", "and", "ü<"] {
            assert!(parse_conditions(bad).is_err(), "{bad}");
        }
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
            classes: vec![2, 6],
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
        // NaN is neither a class nor another number than one.
        let not = ConvertOptions { condition: Some("classification != 7".into()), ..ConvertOptions::default() };
        assert_eq!(run(&not).left, [("where", 50)]);
        assert_eq!(run(&ConvertOptions::default()), Chosen::default());
        let unknown = ConvertOptions { condition: Some("gps>1".into()), ..ConvertOptions::default() };
        let error = choose(&unknown, 100, &at, &extras).unwrap_err();
        assert!(error.contains("'gps'") && error.contains("x, y, z, Classification, return_number"), "{error}");
    }
}
