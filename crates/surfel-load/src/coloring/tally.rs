//! Statistics of an attribute's values over all objects that are drawn together, and the colour scale derived from
//! them.

use super::together::Colors;
use super::{Category, ColorMap, ColorScale, GREY, maps, short};
use std::collections::HashMap;
use surfel_model::Colormap;

/// Largest number of distinct integers at which an attribute's values are coloured as categories by default. With more,
/// they are coloured by a range.
const CATEGORIES: usize = 20;
/// Largest number of categories if the user or the attribute's name requests categories. Further values get no colour.
const MAX_CATEGORIES: usize = 1 << 16;
/// Percentiles of the values that become the ends of the colour map's range, if the user gives no range.
const PERCENTILES: [f64; 2] = [2.0, 98.0];
/// Number of collected values at which they are condensed: each run of [`RUN`] sorted values is then replaced by its
/// middle one.
const MAX_EXACT_VALUES: usize = 1 << 24;
/// Number of sorted values that one representative value replaces.
const RUN: usize = 1 << 8;

/// Statistics of the values of one attribute, collected from several files, from which its colour scale is derived.
pub(crate) struct Tally {
    colors: Colors,
    is_class: bool,
    /// True if the attribute's name is "intensity". Intensities are shown in grey by default.
    is_intensity: bool,
    /// Number of occurrences of each integer value, by the bits of its f64; empty if the values aren't categories.
    counts: HashMap<u64, usize>,
    are_categories: bool,
    spread: PercentileValues,
    /// Number of values that aren't finite, which get no colour.
    pub(crate) missing: usize,
}

impl Tally {
    /// Creates empty statistics for the attribute `name`.
    pub(crate) fn new(name: &str, colors: &Colors) -> Self {
        let is_class = super::is_class(name);
        let are_categories = match &colors.map {
            _ if colors.labels.is_some() => true,
            Some(map) => map.is_of_categories(),
            None => colors.range.is_none(),
        };
        Self {
            colors: colors.clone(),
            is_class,
            is_intensity: name.to_ascii_lowercase().trim_start_matches("scalar_") == "intensity",
            counts: HashMap::new(),
            are_categories,
            spread: PercentileValues::default(),
            missing: 0,
        }
    }

    /// True if all integers, up to [`MAX_CATEGORIES`], are categories, as for classes and named categories.
    fn has_unlimited_categories(&self) -> bool {
        match &self.colors.map {
            _ if self.colors.labels.is_some() => true,
            Some(map) => map.is_of_categories(),
            None => self.is_class,
        }
    }

    pub(crate) fn add(&mut self, values: impl Iterator<Item = f64>) {
        let (all, needs_range) = (self.has_unlimited_categories(), self.colors.range.is_none());
        for value in values {
            if !value.is_finite() {
                self.missing += 1;
                continue;
            }
            if self.are_categories {
                self.count(value, all);
            }
            if needs_range && !(all && self.are_categories) {
                self.spread.push(value);
            }
        }
    }

    fn count(&mut self, value: f64, all: bool) {
        let most = if all { MAX_CATEGORIES } else { CATEGORIES };
        // Adding zero turns −0 into 0.
        let bits = (value + 0.0).to_bits();
        let is_new = value.fract() == 0.0 && !self.counts.contains_key(&bits) && self.counts.len() == most;
        if value.fract() != 0.0 || is_new {
            if !all {
                self.are_categories = false;
                self.counts.clear();
            }
            return;
        }
        *self.counts.entry(bits).or_default() += 1;
    }

    /// Returns the colour scale for all values that were added. If `known` is a scale from an earlier call, it is
    /// preserved, and only new categories are added to it.
    pub(crate) fn scale(self, known: Option<&ColorScale>) -> ColorScale {
        match known {
            Some(ColorScale::Range { map, range }) => ColorScale::Range { map: map.clone(), range: *range },
            Some(ColorScale::Categories(known)) => {
                let mut found = self.categories();
                for category in known {
                    if let Err(at) = found.binary_search_by(|c| c.value.total_cmp(&category.value)) {
                        found.insert(at, Category { count: 0, ..category.clone() });
                    }
                }
                ColorScale::Categories(found)
            }
            _ if self.are_categories && (self.has_unlimited_categories() || !self.counts.is_empty()) => {
                ColorScale::Categories(self.categories())
            }
            _ => {
                let usual = if self.is_intensity { Colormap::Grey } else { Colormap::Viridis };
                let map = self.colors.map.clone().unwrap_or(usual.into());
                ColorScale::Range { map, range: self.colors.range.unwrap_or_else(|| self.spread.percentiles()) }
            }
        }
    }

    /// Returns the distinct integers as categories, in ascending order.
    fn categories(&self) -> Vec<Category> {
        let of_categories = self.colors.map.as_ref().filter(|map| map.is_of_categories());
        let colors = of_categories.map_or_else(|| maps::levels(Colormap::Tab20), ColorMap::levels);
        let is_class = self.is_class && self.colors.map.is_none();
        let of = |(bits, count): (&u64, &usize)| {
            let value = f64::from_bits(*bits);
            let labelled = self.colors.labels.as_ref().and_then(|labels| labels.of(value));
            let (name, color) = labelled.map_or((None, None), |(name, color)| (Some(name), color));
            let known = if is_class { maps::class(value) } else { None };
            let cyclic = colors[value.rem_euclid(colors.len() as f64) as usize % colors.len()];
            Category {
                value,
                name: name.or_else(|| known.map(|k| k.0.into())),
                color: color.or(known.map(|k| k.1)).unwrap_or(cyclic),
                count: *count,
            }
        };
        let mut found: Vec<Category> = self.counts.iter().map(of).collect();
        found.sort_unstable_by(|a, b| a.value.total_cmp(&b.value));
        found
    }
}

/// Describes a scale in a note. `is_given` is true if the user states the range. `files` is the number of files;
/// `missing` is the number of values without a colour.
pub(crate) fn words(name: &str, scale: &ColorScale, is_given: bool, files: usize, missing: usize) -> String {
    let mut note = format!("coloured by {}", name.escape_debug());
    match scale {
        ColorScale::Direct => {}
        ColorScale::Range { map, range: [lo, hi] } => {
            note += &format!(" by {} from {} to {}", map.name(), short(*lo), short(*hi));
            if !is_given {
                note += ", the 2nd to the 98th percentile";
                if files > 1 {
                    note += &format!(" of all {files} files");
                }
                note += ": `range` says others";
            }
        }
        ColorScale::Categories(categories) => {
            let present = || categories.iter().filter(|c| c.count > 0);
            let shown = present().take(CATEGORIES).map(|c| match &c.name {
                Some(name) => format!("{} {name} {}", c.value, c.count),
                None => format!("{}: {}", c.value, c.count),
            });
            let mut shown: Vec<String> = shown.collect();
            match present().count().saturating_sub(CATEGORIES) {
                0 => {}
                more => shown.push(format!("and {more} more")),
            }
            note += &format!(" ({})", shown.join(", "));
        }
    }
    if missing > 0 {
        note += &format!("; {missing} without a value are grey (sRGB {GREY})");
    }
    note
}

/// Collected finite values, from which percentiles are computed. For up to [`MAX_EXACT_VALUES`] values, percentiles are
/// exact. For more, their ranks are exact to within a fraction of 2⁻¹⁶ of the number of values.
#[derive(Default)]
struct PercentileValues {
    held: Vec<f64>,
    /// Representative values, each with the number of values that it stands for.
    runs: Vec<(f64, u64)>,
}

impl PercentileValues {
    fn push(&mut self, value: f64) {
        self.held.push(value);
        if self.held.len() == MAX_EXACT_VALUES {
            self.reduce();
        }
    }

    /// Replaces the exact values by representatives: the middle of each run of [`RUN`] sorted values.
    fn reduce(&mut self) {
        self.held.sort_unstable_by(f64::total_cmp);
        self.runs.extend(self.held.chunks(RUN).map(|run| (run[run.len() / 2], run.len() as u64)));
        self.held.clear();
    }

    /// Returns the values at the two percentiles ([`PERCENTILES`]). If they are equal, returns a range of length 1
    /// around them; without values, 0 to 1.
    fn percentiles(mut self) -> [f64; 2] {
        let [lo, hi] = if self.runs.is_empty() {
            let Some(last) = self.held.len().checked_sub(1) else { return [0.0, 1.0] };
            PERCENTILES.map(|p| {
                let at = (p / 100.0 * last as f64).round() as usize;
                *self.held.select_nth_unstable_by(at, f64::total_cmp).1
            })
        } else {
            self.reduce();
            self.runs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            let total: u64 = self.runs.iter().map(|run| run.1).sum();
            PERCENTILES.map(|p| {
                let at = (p / 100.0 * (total - 1) as f64).round() as u64;
                let mut before = 0;
                let holds = |run: &&(f64, u64)| {
                    before += run.1;
                    before > at
                };
                self.runs.iter().find(holds).map_or(0.0, |run| run.0)
            })
        };
        if lo < hi && (hi - lo).is_finite() { [lo, hi] } else { [lo - 0.5, lo + 0.5] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_leave_two_percent_out_at_each_end() {
        let of = |values: &[f64]| {
            let map = Some(Colormap::Viridis.into());
            let mut tally = Tally::new("a", &Colors { map, ..Colors::default() });
            tally.add(values.iter().copied());
            match tally.scale(None) {
                ColorScale::Range { range, .. } => range,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(of(&(0..=100).map(|i| f64::from(i) + 0.5).collect::<Vec<_>>()), [2.5, 98.5]);
        // Equal values have a colour, too.
        assert_eq!(of(&[7.0; 9]), [6.5, 7.5]);
        assert_eq!((of(&[f64::NAN]), of(&[])), ([0.0, 1.0], [0.0, 1.0]));
    }

    #[test]
    fn percentiles_of_many_values_are_close() {
        // Order that mixes large and small values.
        let count = 100_003_u64;
        let value = |i: u64| ((i * 48_271) % count) as f64;
        let mut spread = PercentileValues::default();
        for i in 0..count {
            spread.push(value(i));
            if i % 30_000 == 29_999 {
                spread.reduce();
            }
        }
        let [lo, hi] = spread.percentiles();
        let step = 2.0 * RUN as f64;
        assert!((lo - 0.02 * count as f64).abs() < step && (hi - 0.98 * count as f64).abs() < step, "{lo} {hi}");
    }

    #[test]
    fn one_fraction_or_a_twenty_first_number_makes_a_range() {
        let of = |values: &[f64]| {
            let mut tally = Tally::new("a", &Colors::default());
            // Each value as if from its own file.
            values.iter().for_each(|v| tally.add([*v].into_iter()));
            match tally.scale(None) {
                ColorScale::Categories(all) => all.len(),
                _ => 0,
            }
        };
        let few: Vec<f64> = (0..20).map(f64::from).collect();
        assert_eq!((of(&few), of(&[&few[..], &[20.0]].concat()), of(&[&few[..], &[0.5]].concat())), (20, 0, 0));
        assert_eq!((of(&[0.0, -0.0]), of(&[f64::NAN])), (1, 0));
    }

    #[test]
    fn categories_that_are_known_stay_among_those_found() {
        let scale = |values: &[f64], known: Option<&ColorScale>| {
            let mut tally = Tally::new("classification", &Colors::default());
            tally.add(values.iter().copied());
            tally.scale(known)
        };
        let first = scale(&[2.0, 6.0, 6.0], None);
        let ColorScale::Categories(all) = scale(&[9.0, 6.0], Some(&first)) else { panic!() };
        let found: Vec<_> = all.iter().map(|c| (c.value, c.label(), c.count)).collect();
        let named = |value, name: &str, count| (value, name.to_owned(), count);
        assert_eq!(found, [named(2.0, "ground", 0), named(6.0, "building", 1), named(9.0, "water", 1)]);
    }
}
