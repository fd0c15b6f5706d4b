//! Simulation of jobs of many tasks on many workers, from measured costs. It computes the tables of docs/scale.md.

use crate::Failure;
use crate::page::Table;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Texts that mark the begin and the end of the tables on the page.
const MARKS: [&str; 2] = ["<!-- figures -->\n", "<!-- end of figures -->\n"];
/// Simulated numbers of workers.
const WORKERS: [usize; 5] = [1, 10, 100, 1000, 10_000];

/// Simulates jobs of many tasks on 1 to 10,000 workers and prints tables.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Seed of the random numbers; docs/scale.md uses 1.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write the tables to this page, between its markers.
    #[arg(long, value_name = "docs/scale.md")]
    write: Option<std::path::PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let tables = tables(arguments.seed);
    let Some(path) = &arguments.write else {
        print!("{}", tables.map(|(name, table)| format!("{name}\n{}\n", table.text())).concat());
        return Ok(());
    };
    let text = std::fs::read_to_string(path)?;
    let parts = text.split_once(MARKS[0]).and_then(|(a, rest)| Some((a, rest.split_once(MARKS[1])?.1)));
    let (before, after) = parts.ok_or("the page has no marks for figures")?;
    let text = format!("{before}{}{}{}{after}", MARKS[0], markdown(arguments.seed), MARKS[1]);
    surfel_io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
    Ok(())
}

/// Costs measured on one core, on the machine and with the commands that docs/scale.md names.
mod measured {
    /// Time to start the program, in seconds.
    pub(super) const START_S: f64 = 0.001_8;
    /// Time of `convert` per point, from LAZ without normals to splats, in seconds of one core.
    pub(super) const CONVERT_S: f64 = 2.46e-6;
    /// Bytes per point of the LAZ input.
    pub(super) const LAZ_BYTES: f64 = 3.74;
    /// Bytes per splat of the PLY output.
    pub(super) const PLY_BYTES: f64 = 28.0;
    /// Time to load and upload the scene, per splat, in seconds of one core.
    pub(super) const LOAD_S: f64 = 0.218e-6;
    /// Number of splats of the scene.
    pub(super) const SPLATS: f64 = 2e6;
    /// Time of a frame of 1024×1024 pixels, in seconds: quantiles over a turntable, evenly spaced.
    pub(super) const FRAME_S: [f64; 11] =
        [0.0901, 0.0912, 0.0917, 0.0928, 0.0938, 0.0950, 0.0960, 0.0980, 0.1019, 0.1124, 0.1728];
    /// Time to encode and write an image, in seconds.
    pub(super) const WRITE_S: f64 = 0.0047;
    /// Size of an image file, in bytes.
    pub(super) const FRAME_BYTES: f64 = 408e3;
}

/// Assumed properties of a cluster, which aren't measured.
mod supposed {
    /// Bandwidth of the storage that all workers share, in bytes per second.
    pub(super) const STORAGE: f64 = 10e9;
    /// Number of lost workers per worker and hour; typical of discounted machines.
    pub(super) const LOSSES_PER_HOUR: f64 = 0.05;
    /// Time until a lost worker is replaced, in seconds.
    pub(super) const REPLACE_S: f64 = 120.0;
    /// Number of tasks that a scheduler starts per second.
    pub(super) const DISPATCH_PER_S: f64 = 100.0;
    /// Mean number of points of a tile.
    pub(super) const TILE_POINTS: f64 = 2e7;
    /// Relative half-width of the uniform distribution of a tile's number of points about the mean.
    pub(super) const TILE_SPREAD: f64 = 0.5;
}

/// Simulated job, given by the costs of its tasks.
struct Job {
    /// Costs of each task: core seconds, and bytes read and written.
    tasks: Vec<(f64, f64)>,
    /// Core seconds that the job's work takes without the overhead of tasks, such as starting the program.
    useful_s: f64,
}

/// Result of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Outcome {
    /// Time until the last task is done, in seconds.
    wall_s: f64,
    /// Time that workers spent on lost tasks, in seconds.
    lost_s: f64,
    /// Number of tasks that were lost with their workers and started again.
    losses: usize,
}

/// Random number generator: SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a random number that is uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a random number of the exponential distribution with mean 1.
    fn exponential(&mut self) -> f64 {
        -(1.0 - self.unit()).ln()
    }

    /// Returns a random number of the distribution with these quantiles, evenly spaced from the minimum to the maximum.
    fn of_quantiles(&mut self, quantiles: &[f64]) -> f64 {
        let at = self.unit() * (quantiles.len() - 1) as f64;
        let (i, t) = (at as usize, at.fract());
        quantiles[i] + t * (quantiles[(i + 1).min(quantiles.len() - 1)] - quantiles[i])
    }
}

/// Returns the job of converting the 10¹² points of a country in tiles, with one task per tile.
fn country(random: &mut Random) -> Job {
    use measured::{CONVERT_S, LAZ_BYTES, PLY_BYTES, START_S};
    use supposed::{TILE_POINTS, TILE_SPREAD};
    let mut left = 1e12;
    let mut tasks = Vec::new();
    while left > 0.0 {
        let points = (TILE_POINTS * (1.0 + TILE_SPREAD * (2.0 * random.unit() - 1.0))).min(left);
        left -= points;
        tasks.push((START_S + points * CONVERT_S, points * (LAZ_BYTES + PLY_BYTES)));
    }
    Job { tasks, useful_s: 1e12 * CONVERT_S }
}

/// Returns the job of drawing a million frames, with `per_task` frames per task.
fn frames(random: &mut Random, per_task: usize) -> Job {
    use measured::{FRAME_BYTES, FRAME_S, LOAD_S, PLY_BYTES, SPLATS, START_S, WRITE_S};
    let mut useful_s = 0.0;
    let tasks = (0..1_000_000 / per_task).map(|_| {
        let drawn: f64 = (0..per_task).map(|_| random.of_quantiles(&FRAME_S) + WRITE_S).sum();
        useful_s += drawn;
        (START_S + SPLATS * LOAD_S + drawn, SPLATS * PLY_BYTES + per_task as f64 * FRAME_BYTES)
    });
    let tasks = tasks.collect();
    Job { tasks, useful_s }
}

/// Simulates a job. Tasks start in the order of the scheduler. The bytes of all tasks pass one after another through
/// one storage. The task of a lost worker starts again on another worker.
fn simulate(job: &Job, workers: usize, losses_per_hour: f64, random: &mut Random) -> Outcome {
    // Times at which workers become free, in nanoseconds. Integers are used because they can be ordered.
    let ns = |s: f64| (s * 1e9) as u128;
    let s = |ns: u128| ns as f64 * 1e-9;
    let mut free: BinaryHeap<Reverse<u128>> = (0..workers).map(|_| Reverse(0)).collect();
    // Lost tasks, each with the time of the loss.
    let mut again: Vec<(f64, (f64, f64))> = Vec::new();
    let (mut outcome, mut storage_free, mut dispatch_free) = (Outcome::default(), 0.0_f64, 0.0_f64);
    let mut waiting = job.tasks.iter().copied();
    while let Some(Reverse(at)) = free.pop() {
        let known = again.iter().position(|(lost_at, _)| *lost_at <= s(at)).map(|i| again.swap_remove(i));
        let next = known.or_else(|| Some((0.0, waiting.next()?))).or_else(|| again.pop());
        let Some((lost_at, task)) = next else { break };
        let started = s(at).max(lost_at).max(dispatch_free);
        dispatch_free = started + 1.0 / supposed::DISPATCH_PER_S;
        let lost_at = started + random.exponential() * 3600.0 / losses_per_hour;
        let stored = storage_free.max(started) + task.1 / supposed::STORAGE;
        // Reading and writing overlap with computing, so the longer time of both counts.
        let done = (started + task.0).max(stored);
        if lost_at < done {
            outcome.lost_s += lost_at - started;
            outcome.losses += 1;
            again.push((lost_at, task));
            free.push(Reverse(ns(lost_at + supposed::REPLACE_S)));
            continue;
        }
        storage_free = stored;
        outcome.wall_s = outcome.wall_s.max(done);
        free.push(Reverse(ns(done)));
    }
    outcome
}

fn duration(s: f64) -> String {
    match s {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s if s < 1.5 * 86_400.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.0} days", s / 86_400.0),
    }
}

/// Simulates both jobs with a seed. Returns a title and a table for each job.
fn tables(seed: u64) -> [(String, Table); 2] {
    let hours = |s: f64| format!("{:.0}", s / 3600.0);
    let mut random = Random(seed);
    let country = country(&mut random);
    let of_country = |random: &mut Random, workers: usize| {
        let outcome = simulate(&country, workers, supposed::LOSSES_PER_HOUR, random);
        let used = workers as f64 * outcome.wall_s;
        vec![
            workers.to_string(),
            duration(outcome.wall_s),
            hours(used),
            format!("{:.0} %", 100.0 * country.useful_s / used),
            outcome.losses.to_string(),
        ]
    };
    let mut first = Table::new(&["workers", "time", "core hours", "of use", "workers lost"]);
    first.rows = WORKERS.map(|workers| of_country(&mut random, workers)).into();

    let mut second = Table::new(&["workers", "1,000 a task", "of use", "100 a task", "of use"]);
    let jobs = [1000, 100].map(|per_task| frames(&mut random, per_task));
    for workers in WORKERS {
        let mut row = vec![workers.to_string()];
        for job in &jobs {
            let outcome = simulate(job, workers, supposed::LOSSES_PER_HOUR, &mut random);
            let share = 100.0 * job.useful_s / (workers as f64 * outcome.wall_s);
            row.extend([duration(outcome.wall_s), format!("{share:.0} %")]);
        }
        second.rows.push(row);
    }
    let tiles = country.tasks.len();
    [(format!("10¹² points, {tiles} tiles:"), first), ("A million frames:".to_owned(), second)]
}

/// Returns the tables of the page as Markdown.
fn markdown(seed: u64) -> String {
    tables(seed).map(|(name, table)| format!("{name}\n\n{}\n", table.markdown())).concat().replace("\n\n\n", "\n\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(tasks: usize, seconds: f64, bytes: f64) -> Job {
        Job { tasks: vec![(seconds, bytes); tasks], useful_s: tasks as f64 * seconds }
    }

    #[test]
    fn the_page_has_the_simulated_figures() {
        let page = include_str!("../../../docs/scale.md");
        assert!(page.contains(&markdown(1)), "run cargo xtask bench scale --write docs/scale.md");
    }

    #[test]
    fn tasks_of_equal_cost_take_whole_rounds() {
        let wall = |tasks, workers| simulate(&even(tasks, 600.0, 0.0), workers, 1e-30, &mut Random(3)).wall_s;
        // The time that the scheduler needs to start a round of tasks is added.
        for (tasks, workers, rounds) in [(7, 1, 7.0), (8, 4, 2.0), (9, 4, 3.0), (3, 100, 1.0)] {
            let started = workers.min(tasks) as f64 / supposed::DISPATCH_PER_S;
            let extra = wall(tasks, workers) - 600.0 * rounds;
            assert!((0.0..=started).contains(&extra), "{tasks} tasks by {workers}: {extra}");
        }
    }

    #[test]
    fn shared_storage_bounds_what_workers_do() {
        let job = even(1000, 1.0, 100e9);
        let bound = 1000.0 * 100e9 / supposed::STORAGE;
        let wall = simulate(&job, 1000, 1e-30, &mut Random(3)).wall_s;
        assert!((bound..bound + 11.0).contains(&wall), "{wall} against {bound}");
    }

    #[test]
    fn losses_cost_what_probability_says() {
        // A task of length T with losses at rate λ takes (e^{λT} − 1)(1/λ + R) on average (Ross, Introduction to
        // Probability Models, on repair with restarts).
        let (length, rate) = (1800.0, 0.5_f64);
        let tasks = 20_000;
        let wall = simulate(&even(tasks, length, 0.0), 1, rate, &mut Random(9)).wall_s;
        let expected = (length * rate / 3600.0).exp_m1() * (3600.0 / rate + supposed::REPLACE_S);
        let found = wall / tasks as f64;
        // The standard deviation of a task's time is below its mean, so 3 % are more than four standard errors of the
        // mean.
        assert!((found / expected - 1.0).abs() < 0.03, "{found} against {expected}");
    }

    #[test]
    fn chance_is_even_and_the_same_for_a_seed() {
        let mut random = Random(1);
        let mean = (0..100_000).map(|_| random.of_quantiles(&[0.0, 1.0, 4.0])).sum::<f64>() / 1e5;
        // The standard error is 1.12 / sqrt(1e5) = 0.0035.
        assert!((mean - 1.5).abs() < 0.015, "{mean}");
        assert_eq!(Random(5).bits(), Random(5).bits());
        // First output for the seed 0, by Vigna's splitmix64.c.
        assert_eq!(Random(0).bits(), 0xe220_a839_7b1d_cdaf);
    }
}
