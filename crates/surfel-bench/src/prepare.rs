//! Measurement of the time to make splats from points, stage by stage.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use surfel_model::{Column3, PointCloud};
use surfel_sample::Progress;
use surfel_sample::{PointOptions, splats_from_points};

use crate::machine::busy_ms;
use crate::{Failure, clouds};

/// Times the preparation of points without normals and prints a table.
///
/// The points lie on a bumpy ball, in random order, which is worse than in any scan.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Number of points; may be repeated.
    #[arg(long, value_name = "N", default_values_t = [1_000_000])]
    points: Vec<usize>,
    /// Thread count; may be repeated.
    #[arg(long, value_name = "N", default_values_t = [1, 2])]
    threads: Vec<usize>,
    /// Number of runs; the fastest one counts.
    #[arg(long, value_name = "N", default_value_t = 3)]
    runs: usize,
}

/// Result of a run: wall-clock seconds, CPU seconds if the system reports them, and seconds of each stage.
type Run = (f64, Option<f64>, Vec<(String, f64)>);

/// Clock that measures the seconds of each stage.
struct Clock(Mutex<(Instant, Vec<(String, f64)>)>);

impl Clock {
    fn new() -> Self {
        Self(Mutex::new((Instant::now(), vec![("checks".to_owned(), 0.0)])))
    }

    fn finish(self) -> Vec<(String, f64)> {
        self.stage("", 0);
        let mut stages = self.0.into_inner().unwrap_or_else(PoisonError::into_inner).1;
        stages.pop();
        stages
    }
}

impl Progress for Clock {
    fn stage(&self, name: &str, _total: u64) {
        let mut clock = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let seconds = clock.0.elapsed().as_secs_f64();
        if let Some(last) = clock.1.last_mut() {
            last.1 = seconds;
        }
        clock.0 = Instant::now();
        clock.1.push((name.to_owned(), 0.0));
    }

    fn advance(&self, _steps: u64) {}
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    println!("| points | threads | stage | µs a point | points/s |");
    println!("| ---: | ---: | --- | ---: | ---: |");
    for &count in &arguments.points {
        let cloud = clouds::ball(count)?;
        let high = cloud.data().centers.high();
        // The shuffle is fixed: i·k mod n, with k coprime to n.
        let step = (0..).map(|i| (count as f64 * 0.618) as usize + i).find(|k| gcd(*k, count) == 1).unwrap_or(1);
        let shuffled = (0..count).map(|i| high[(i as u128 * step as u128 % count as u128) as usize]).collect();
        drop(cloud);
        let points = PointCloud { positions: Column3::from_f32(shuffled), ..PointCloud::default() };
        for &threads in &arguments.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let mut best: Option<Run> = None;
            for _ in 0..arguments.runs.max(1) {
                let (clock, start, busy) = (Clock::new(), Instant::now(), busy_ms());
                pool.install(|| splats_from_points(&points, &PointOptions::default(), &clock))?;
                let seconds = start.elapsed().as_secs_f64();
                let busy = busy_ms().zip(busy).map(|(end, start)| (end - start) * 1e-3);
                if best.as_ref().is_none_or(|b| seconds < b.0) {
                    best = Some((seconds, busy, clock.finish()));
                }
            }
            let Some((seconds, busy, stages)) = best else { continue };
            let row = |stage: &str, seconds: f64| {
                let each = seconds / count as f64;
                println!("| {count} | {threads} | {stage} | {:.3} | {:.0} |", each * 1e6, 1.0 / each);
            };
            for (stage, seconds) in stages {
                row(&stage, seconds);
            }
            row("all", seconds);
            if let Some(busy) = busy {
                row("all, on CPUs", busy);
            }
        }
    }
    Ok(())
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
