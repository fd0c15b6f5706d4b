//! Comparison of the times of passes with lower bounds, which are the passes' work at the measured peak rates.

use std::collections::BTreeMap;

use super::record::{Frame, Probe};
use super::work::Work;

/// Smallest fraction of a frame's time at which a pass may be listed as far above its bound. In shorter passes, the
/// fixed cost of a pass dominates.
const MIN_SHARE: f64 = 0.02;
/// Number of passes that the page lists as farthest above their bounds.
const NAMED: usize = 3;

/// Peak rates of the device per second, by the name of the probe. A rate that both backends measured is the larger of
/// both.
pub(super) struct Roofline<'a>(BTreeMap<&'a str, f64>);

/// Lower bound of a pass's time, and the resource that limits it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bound {
    pub by: String,
    pub ms: f64,
}

/// Pass of a frame, compared with its bound.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PassComparison<'a> {
    pub frame: &'a Frame,
    pub name: &'a str,
    pub ms: f64,
    pub work: Option<&'a Work>,
    /// Lower bound of the time; `None` if the work of the pass isn't estimated, or if no probe measured a rate for any
    /// of it.
    pub bound: Option<Bound>,
}

impl PassComparison<'_> {
    /// Returns the ratio of the measured time to the bound; 0 without a bound.
    pub(super) fn ratio_to_bound(&self) -> f64 {
        self.bound.as_ref().map_or(0.0, |bound| self.ms / bound.ms)
    }

    /// Returns the pass's fraction of the time of all passes in its frame.
    fn share(&self) -> f64 {
        self.ms / self.frame.row.stages_ms.values().sum::<f64>()
    }
}

impl<'a> Roofline<'a> {
    pub(super) fn of(probes: &[&'a Probe]) -> Self {
        let mut rates = BTreeMap::new();
        for probe in probes {
            let rate = rates.entry(probe.name.as_str()).or_insert(probe.per_s);
            *rate = probe.per_s.max(*rate);
        }
        Self(rates)
    }

    /// Returns all passes of a frame, each compared with its bound.
    pub(super) fn judge(&self, frame: &'a Frame) -> Vec<PassComparison<'a>> {
        let passes = frame.row.stages_ms.iter().map(|(name, &ms)| {
            let work = frame.work.iter().find(|work| work.pass == *name);
            PassComparison { frame, name, ms, work, bound: work.and_then(|work| self.bound(work)) }
        });
        passes.collect()
    }

    /// Returns the lower bound of the time: the largest of the times that each kind of work would take alone. Kinds
    /// without a measured rate are ignored; `None` if no kind remains.
    fn bound(&self, work: &Work) -> Option<Bound> {
        let ms = |probe: &str, amount: f64| Some(amount / self.0.get(probe)? * 1e3);
        let mut kinds = vec![
            ("memory", ms("memory copy", work.bytes)),
            ("arithmetic in compute shaders", ms("f32 arithmetic, compute", work.compute_flops)),
            ("arithmetic in fragment shaders", ms("f32 arithmetic, fragments", work.fragment_flops)),
            ("quads", ms("quads of a pixel, strips", work.quads)),
        ];
        // Draws to different sets of targets run one after another, so their times add up.
        let fills = work.fill.iter().map(|(probe, fragments)| ms(&format!("fill: {probe}"), *fragments));
        kinds.push(("fill rate", fills.sum()));
        let known = kinds.into_iter().filter_map(|(by, ms)| Some((by, ms?)));
        let (by, ms) = known.filter(|kind| kind.1 > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Bound { by: by.to_owned(), ms })
    }
}

/// Returns at most [`NAMED`] passes with the largest ratio of time to bound, each name once. Passes without a bound,
/// and with a negligible fraction of their frame, are ignored.
pub(super) fn farthest<'a, 'b>(judged: &'b [PassComparison<'a>]) -> Vec<&'b PassComparison<'a>> {
    let mut sorted: Vec<&PassComparison<'a>> =
        judged.iter().filter(|pass| pass.bound.is_some() && pass.share() >= MIN_SHARE).collect();
    sorted.sort_by(|a, b| b.ratio_to_bound().total_cmp(&a.ratio_to_bound()));
    let mut named: Vec<&PassComparison<'a>> = Vec::new();
    for pass in sorted {
        if named.len() < NAMED && !named.iter().any(|other| other.name == pass.name) {
            named.push(pass);
        }
    }
    named
}
