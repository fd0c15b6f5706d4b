//! Detection of the roles of columns without names.
//!
//! The method has three steps. First, statistics of each column are measured over all rows or a sample of them
//! ([`evidence`]). Second, layouts are scored. A layout divides the columns, from first to last, into roles of one, two
//! or three columns. The score of a role depends on the statistics of its columns and on the previous role. Third, the
//! layout with the largest sum of scores is chosen, and the decisive reasons are returned as text.

#![cfg_attr(not(all(feature = "npy", feature = "points")), allow(dead_code))]

mod evidence;
mod refused;

pub(crate) use evidence::ROUNDED_ONE;
#[cfg(feature = "npy")]
pub(crate) use refused::{Matrix, are_image_colors, is_image, matrix_kind};

use crate::error::Problem;
use crate::strided::Strided;
use evidence::{Column, MANY_ROWS, Scale, Triple, measure};
use std::collections::{HashMap, HashSet};

/// Role of one column or of neighbouring columns, such as a position of three columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Role {
    /// Row index or identifier.
    Index,
    Time,
    /// Three columns: x, y and z.
    Position,
    Normal,
    /// Three columns: red, green and blue.
    Color,
    /// Alpha channel, which follows a colour. It is recognised only if all rows are opaque.
    Alpha,
    Intensity,
    /// Whole numbers that recur, such as classes or instance ids.
    Label,
    ReturnNumber,
    /// Two columns: return number of a laser pulse, then number of returns of the pulse.
    Returns,
    /// Two columns: number of returns of a laser pulse, then the return number.
    ReturnsReversed,
    Unknown,
}

impl Role {
    const ALL: [Self; 12] = [
        Self::Position,
        Self::Color,
        Self::Normal,
        Self::Index,
        Self::Time,
        Self::Intensity,
        Self::Alpha,
        Self::Returns,
        Self::ReturnsReversed,
        Self::ReturnNumber,
        Self::Label,
        Self::Unknown,
    ];

    /// Returns the names that the role's columns get.
    pub(crate) fn names(self) -> &'static [&'static str] {
        match self {
            Self::Index => &["index"],
            Self::Time => &["time"],
            Self::Position => &["x", "y", "z"],
            Self::Normal => &["nx", "ny", "nz"],
            Self::Color => &["red", "green", "blue"],
            Self::Alpha => &["alpha"],
            Self::Intensity => &["intensity"],
            Self::Label => &["label"],
            Self::ReturnNumber => &["return_number"],
            Self::Returns => &["return_number", "number_of_returns"],
            Self::ReturnsReversed => &["number_of_returns", "return_number"],
            Self::Unknown => &[""],
        }
    }

    /// True if only one column, or group of columns, of a file can have the role.
    fn is_single(self) -> bool {
        !matches!(self, Self::Index | Self::Label | Self::Unknown)
    }
}

/// A role and the index of its first column, as a part of a [`Layout`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Part {
    pub(crate) role: Role,
    pub(crate) first: usize,
}

/// The roles of all columns, in order.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    pub(crate) parts: Vec<Part>,
    /// Reasons for the choice in words, for a note to the user.
    pub(crate) reasons: Vec<String>,
}

/// Chooses the roles of the columns of a file, which has at least three columns and one row. `numbers` are the columns'
/// numbers in the file, from 1, for messages.
///
/// # Errors
/// [`Problem`] if each sampled row is a camera pose.
pub(crate) fn choose(columns: &[Strided<'_>], numbers: &[usize]) -> Result<Layout, Problem> {
    let measured = measure(columns);
    if let Some(problem) = refused::poses(&measured) {
        return Err(problem);
    }
    let mut choice = Choice { columns: &measured, best: HashMap::new() };
    choice.score(State::default());
    let mut parts = choice.parts();
    // Columns that may be intensities count as unknown if any other column's role is unknown.
    let is_unknown = |part: &Part| part.role == Role::Unknown && !choice.is_uninformative(part.first);
    if parts.iter().any(is_unknown) {
        let intensity = parts.iter_mut().filter(|part| part.role == Role::Intensity);
        intensity.for_each(|part| part.role = Role::Unknown);
    }
    let mut reasons: Vec<String> = parts.iter().filter_map(|part| choice.reason(*part, numbers)).collect();
    let counts = |c: &Column| c.step == Some(1.0) && c.sample.len() >= MANY_ROWS;
    if columns.len() == 3 && counts(&measured[0]) {
        reasons.push("x counts the rows, but there is no other column for it".to_owned());
    }
    Ok(Layout { parts, reasons })
}

/// Returns a note that combines `what` with the decisive reasons, and with advice for choosing other roles.
pub(crate) fn as_note(what: &str, reasons: &[String]) -> String {
    let reasons: String = reasons.iter().map(|reason| format!(", {reason}")).collect();
    format!("{what}{reasons}; `columns` names them otherwise")
}

/// True if the first column is an index of the rows, judging from all columns.
pub(crate) fn begins_with_index(columns: &[Strided<'_>]) -> bool {
    let measured = measure(columns);
    Choice { columns: &measured, best: HashMap::new() }.index(State::default()).is_some()
}

/// State of the search for a layout: the index of the next column, and what the roles of the columns before it exclude.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
struct State {
    next: usize,
    /// Roles that may occur only once and are already used, as bits `1 << role`.
    taken: u16,
    before: Option<Role>,
}

impl State {
    fn has(self, role: Role) -> bool {
        self.taken & 1 << role as u16 != 0
    }

    fn after(self, role: Role) -> Self {
        let taken = if role.is_single() { self.taken | 1 << role as u16 } else { self.taken };
        Self { next: self.next + role.names().len(), taken, before: Some(role) }
    }
}

/// True if at least 99 % of the sampled pairs of x and y are distinct, as the cells of a raster are. Two columns of
/// whole numbers that precede three columns of fractions get a lower score as x and y if this is false.
fn are_distinct_pairs(x: &Column, y: &Column) -> bool {
    let pairs: HashSet<(u64, u64)> = x.sample.iter().zip(&y.sample).map(|(x, y)| (x.to_bits(), y.to_bits())).collect();
    pairs.len() * 100 >= x.sample.len() * 99
}

/// The search for the layout with the largest sum of scores.
struct Choice<'a> {
    columns: &'a [Column],
    /// Best role for the column `next` of each state, with the sum of scores from that column to the last one.
    best: HashMap<State, (f64, Role)>,
}

/// Score of a layout without a position, so low that every layout with a position scores higher.
const IMPOSSIBLE_SCORE: f64 = -1e9;

impl Choice<'_> {
    /// Returns the largest sum of scores that roles of the columns from `state.next` to the last one can have.
    fn score(&mut self, state: State) -> f64 {
        if state.next == self.columns.len() {
            return if state.has(Role::Position) { 0.0 } else { IMPOSSIBLE_SCORE };
        }
        if let Some((score, _)) = self.best.get(&state) {
            return *score;
        }
        let mut best = (2.0 * IMPOSSIBLE_SCORE, Role::Unknown);
        for role in Role::ALL {
            let fits = state.next + role.names().len() <= self.columns.len() && !state.has(role);
            let Some(own) = fits.then(|| self.of_role(role, state)).flatten() else { continue };
            let score = own + self.score(state.after(role));
            if score > best.0 {
                best = (score, role);
            }
        }
        self.best.insert(state, best);
        best.0
    }

    fn parts(&self) -> Vec<Part> {
        let (mut parts, mut state) = (Vec::new(), State::default());
        while let Some((_, role)) = self.best.get(&state) {
            parts.push(Part { role: *role, first: state.next });
            state = state.after(*role);
        }
        parts
    }

    fn rows(&self) -> usize {
        self.columns[0].sample.len()
    }

    fn triple(&self, first: usize) -> Triple<'_> {
        Triple::of([0, 1, 2].map(|k| &self.columns[first + k]))
    }

    /// True if a column has the same value in all of many rows. Its statistics are then no evidence of its role.
    fn is_uninformative(&self, i: usize) -> bool {
        self.rows() >= MANY_ROWS && self.columns[i].is_constant()
    }

    /// Returns the score of a role for the column `state.next` and, if the role needs several columns, the following
    /// ones. Returns `None` if the columns' statistics exclude the role.
    fn of_role(&self, role: Role, state: State) -> Option<f64> {
        let (i, rows) = (state.next, self.rows());
        let column = &self.columns[i];
        match role {
            Role::Unknown => Some(-0.1),
            Role::Index => self.index(state),
            Role::Time => self.time(state),
            Role::Position => Some(self.position(state)),
            Role::Normal => self.triple(i).is_unit().then(|| {
                let is_flag = |c: &Column| c.is_whole && c.least >= 0.0;
                let are_flags = rows >= MANY_ROWS && self.columns[i..i + 3].iter().all(is_flag);
                let after = if state.has(Role::Position) { 0.0 } else { -1.0 };
                after
                    + if are_flags {
                        3.0
                    } else if rows > 1 {
                        6.0
                    } else {
                        4.0
                    }
            }),
            Role::Color => {
                let after = if state.has(Role::Position) { 0.0 } else { -1.5 };
                self.triple(i).color().map(|score| score + after)
            }
            Role::Alpha => {
                let scale = (state.before == Some(Role::Color)).then(|| self.triple(i - 3).color_scale()).flatten()?;
                let is_full = column.is_constant() && column.most == scale.most();
                (is_full && rows >= MANY_ROWS).then_some(1.6)
            }
            Role::Intensity => {
                let is_last = i + 1 == self.columns.len();
                let few = if rows < MANY_ROWS { 0.15 } else { 0.0 };
                match state.before {
                    _ if self.is_uninformative(i) && i > 3 || column.is_row_number() && rows >= MANY_ROWS => None,
                    Some(Role::Position) => Some(1.05 + few),
                    Some(Role::Color | Role::Normal) if is_last => Some(1.0),
                    _ => None,
                }
            }
            Role::Label => match () {
                () if column.is_dense_label() => Some(1.5),
                () if column.is_sparse_label() => Some(1.3),
                () => None,
            },
            Role::ReturnNumber => self.are_returns(i).then_some(1.7),
            Role::Returns => self.are_pairs_of_returns(i, i + 1).then_some(3.6),
            Role::ReturnsReversed => self.are_pairs_of_returns(i + 1, i).then_some(3.5),
        }
    }

    /// Returns the score of the next column as row numbers or identifiers; `None` if it can't have this role. An index
    /// is the first column, or the second after another index, or it follows the position.
    fn index(&self, state: State) -> Option<f64> {
        let (i, rows) = (state.next, self.rows());
        let column = &self.columns[i];
        let is_first = matches!(state.before, None | Some(Role::Index)) && i + 3 < self.columns.len();
        if !column.is_whole || rows < 3 {
            return None;
        }
        if !is_first {
            return (column.is_row_number() && rows >= MANY_ROWS && state.has(Role::Position)).then_some(2.0);
        }
        // A table that was saved twice with an index has two index columns.
        let is_twice = state.before.is_none() && self.columns[i + 1].counts() && column.counts();
        let next = self.columns.get(i + 1 + usize::from(is_twice)..i + 4 + usize::from(is_twice))?;
        let fractional = next.iter().filter(|c| !c.is_whole).count();
        if rows < MANY_ROWS {
            return (column.is_row_number() && fractional == 3).then_some(6.0);
        }
        // If several columns count rows with the same step, none of them is an index.
        if next.iter().any(Column::counts) && next.iter().any(|c| c.step == column.step) {
            return None;
        }
        if column.counts() {
            return Some(6.0);
        }
        if column.is_increasing && (fractional > 0 || column.has_even_steps()) {
            return Some(5.0);
        }
        let is_distinct = rows >= 2 * MANY_ROWS && column.distinct == rows.min(1024);
        (is_distinct && fractional == 3).then_some(3.0)
    }

    /// Returns the score of the next column as ascending times since 1970 or 1980, in seconds or smaller units. Returns
    /// `None` if it can't have this role.
    fn time(&self, state: State) -> Option<f64> {
        const LEAST: f64 = 1e8;
        let column = &self.columns[state.next];
        if self.rows() < 3 || !column.is_sorted || column.least < LEAST {
            return None;
        }
        if matches!(state.before, None | Some(Role::Index)) {
            let next = self.columns.get(state.next + 1..state.next + 4)?;
            return next.iter().all(|c| c.most < LEAST).then_some(4.0);
        }
        state.has(Role::Position).then_some(1.5)
    }

    fn position(&self, state: State) -> f64 {
        let i = state.next;
        let [x, y, z] = [0, 1, 2].map(|k| &self.columns[i + k]);
        let mut score = match state.before {
            None => 3.0,
            Some(Role::Index) => 2.0,
            Some(Role::Time) => 1.0,
            Some(Role::Label) if i == 1 => 0.5,
            Some(_) => -0.5 * i as f64,
        };
        if self.rows() < MANY_ROWS {
            return score;
        }
        if x.is_whole && !y.is_whole && !z.is_whole {
            score -= 4.0;
        }
        // Two columns of whole numbers before three of fractions aren't x and y, unless they are the cells of a raster.
        let next = self.columns.get(i + 3..i + 5).unwrap_or_default();
        let are_fractions_next = next.len() == 2 && next.iter().all(|c| !c.is_whole);
        if x.is_whole && y.is_whole && !z.is_whole && are_fractions_next && !are_distinct_pairs(x, y) {
            score -= 3.0;
        }
        if i > 0 && [x, y, z].iter().any(|c| c.counts()) {
            score -= 6.0;
        }
        let constant = [x, y, z].iter().filter(|c| c.is_constant()).count();
        score - if constant == 3 { 6.0 } else { 0.5 * constant as f64 }
    }

    /// True if a column seems to contain return numbers of laser pulses: whole numbers from 1 to at most 15. In at
    /// least 90 % of the sampled pairs of rows, the number goes up by 1, within a pulse, or restarts with 1.
    fn are_returns(&self, i: usize) -> bool {
        let column = &self.columns[i];
        let is_small = column.is_whole && column.least == 1.0 && column.most <= 15.0 && !column.is_constant();
        let (mut ordered, mut all) = (0, 0);
        for (before, after) in column.successive() {
            ordered += u32::from(after == 1.0 || after == before + 1.0);
            all += 1;
        }
        is_small && self.rows() >= 2 * MANY_ROWS && f64::from(ordered) >= 0.9 * f64::from(all)
    }

    /// True if the column `number` seems to have return numbers, and the column `count` the number of returns of the
    /// same pulse. Both are whole numbers from 1 to 15, and no sampled return number exceeds its count.
    fn are_pairs_of_returns(&self, number: usize, count: usize) -> bool {
        let [number, count] = [number, count].map(|i| &self.columns[i]);
        let is_small = |c: &Column| c.is_whole && c.least >= 1.0 && c.most <= 15.0;
        let pairs = || number.sample.iter().zip(&count.sample);
        let is_within = pairs().all(|(number, count)| number <= count) && pairs().any(|(number, count)| number < count);
        self.rows() >= MANY_ROWS && is_small(number) && is_small(count) && !count.is_constant() && is_within
    }

    /// Returns the reason for a role in words, for the note to the user, with the columns' numbers in the file. Returns
    /// `None` if the role needs no explanation.
    fn reason(&self, part: Part, numbers: &[usize]) -> Option<String> {
        let Part { role, first } = part;
        let last = first + role.names().len() - 1;
        let number = |i: usize| numbers.get(i).copied().unwrap_or(i + 1);
        let place = match last - first {
            0 => format!("column {}", number(first)),
            1 => format!("columns {} and {}", number(first), number(last)),
            _ => format!("columns {} to {}", number(first), number(last)),
        };
        let column = &self.columns[first];
        let are_many = self.rows() >= MANY_ROWS;
        let why = match role {
            Role::Index if column.counts() => "counts the rows".to_owned(),
            Role::Index => "has another whole number in every row".to_owned(),
            Role::Time => "goes up from row to row as times do".to_owned(),
            Role::Normal => "have length one".to_owned(),
            Role::Color => {
                let scale = self.triple(first).color_scale().map_or(255.0, Scale::most);
                format!("share a range, 0 to {scale}{}", if are_many { ", as colours do" } else { "" })
            }
            Role::Alpha => "is the largest value of the colours throughout".to_owned(),
            Role::Label => "holds few whole numbers".to_owned(),
            Role::ReturnNumber => "counts up from 1 again and again".to_owned(),
            Role::Returns | Role::ReturnsReversed => "hold small numbers, one never above the other".to_owned(),
            Role::Position | Role::Intensity | Role::Unknown => return None,
        };
        Some(format!("{place} {why}"))
    }
}
