//! Comparison program that estimates normals of points with Surfel or with the crate kiddo:
//! `rivals surfel|kiddo THREADS POINTS [NORMALS]`.
//!
//! POINTS is a file of f64, three per point; NORMALS is an output file of the same format. The program prints durations
//! in seconds: of the neighbour search, of search and normals, and of everything up to splats. It also prints the
//! largest amount of memory in use, in bytes per point, besides the points themselves.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::error::Error;
use std::num::NonZero;
use std::sync::Mutex;
use std::time::Instant;
use surfel_model::{Column3, PointCloud};
use surfel_sample::{PointOptions, Progress, splats_from_points};

/// Number of neighbours per point; the default of Surfel.
const NEIGHBOURS: usize = 16;

fn main() -> Result<(), Failure> {
    let words: Vec<String> = std::env::args().collect();
    let [_, who, threads, input, rest @ ..] = &words[..] else {
        return Err("rivals surfel|kiddo THREADS POINTS".into());
    };
    let bytes = std::fs::read(input)?;
    let values: Vec<f64> =
        bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap_or_default())).collect();
    let points: Vec<[f64; 3]> = values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    drop((bytes, values));
    let held = resident(true)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.parse()?).build()?;
    let (normals, times) = pool.install(|| if who == "kiddo" { kiddo(&points) } else { surfel(&points) })?;
    let each = (resident(false)? - held) / points.len() as f64;
    let text: Vec<String> = times.iter().map(|time| time.map_or("null".into(), |t| format!("{t:.4}"))).collect();
    println!("[{}, {each:.1}]", text.join(", "));
    if let Some(path) = rest.first() {
        std::fs::write(path, normals.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?;
    }
    Ok(())
}

/// Returns the resident memory in bytes. With `starts`, resets the peak and returns the current size; otherwise returns
/// the peak since the reset.
fn resident(starts: bool) -> Result<f64, Failure> {
    if starts {
        std::fs::write("/proc/self/clear_refs", "5")?;
    }
    let name = if starts { "VmRSS:" } else { "VmHWM:" };
    let status = std::fs::read_to_string("/proc/self/status")?;
    let kib = status.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next()?.parse::<f64>().ok());
    Ok(kib.ok_or("no VmRSS")? * 1024.0)
}

/// Clock that records the start times of stages.
struct Clock(Mutex<Vec<(String, Instant)>>);

impl Progress for Clock {
    fn stage(&self, name: &str, _: u64) {
        if let Ok(mut stages) = self.0.lock() {
            stages.push((name.to_owned(), Instant::now()));
        }
    }

    fn advance(&self, _: u64) {}
}

type Failure = Box<dyn Error + Send + Sync>;
type Normals = (Vec<[f64; 3]>, [Option<f64>; 3]);

fn surfel(points: &[[f64; 3]]) -> Result<Normals, Failure> {
    let mut cloud = PointCloud::default();
    cloud.positions = Column3::from_f64(&points.iter().map(|p| (*p).into()).collect::<Vec<_>>());
    let (clock, start) = (Clock(Mutex::new(Vec::new())), Instant::now());
    let (splats, _) = splats_from_points(&cloud, &PointOptions::default(), &clock)?;
    let all = start.elapsed().as_secs_f64();
    let stages = clock.0.into_inner()?;
    // The normals are complete when the next stage starts.
    let after = stages.iter().skip_while(|(name, _)| name != "normals").nth(1);
    let normals = after.map(|(_, at)| (*at - start).as_secs_f64());
    let normal = |i: usize| splats.normal(i).normalize().to_array();
    Ok(((0..splats.len()).map(normal).collect(), [None, normals, Some(all)]))
}

fn kiddo(points: &[[f64; 3]]) -> Result<Normals, Failure> {
    let count = NonZero::new(NEIGHBOURS + 1).ok_or("no neighbours")?;
    let tree = || ImmutableKdTree::new_from_slice(points).map_err(|e| format!("kiddo: {e:?}"));
    let start = Instant::now();
    let built: ImmutableKdTree<f64, 3> = tree()?;
    let farthest = |p: &[f64; 3]| {
        let near = built.query(p).nearest_n::<SquaredEuclidean<f64>>(count).execute();
        near.last().map_or(f64::NAN, |last| last.distance)
    };
    let sum: f64 = points.par_iter().map(farthest).sum();
    let neighbours = start.elapsed().as_secs_f64();
    if !sum.is_finite() {
        return Err("kiddo found no neighbours".into());
    }
    drop(built);
    let start = Instant::now();
    let built: ImmutableKdTree<f64, 3> = tree()?;
    let normals = points.par_iter().map(|p| {
        let near = built.query(p).nearest_n::<SquaredEuclidean<f64>>(count).execute();
        normal(p, near.iter().map(|n| &points[n.item as usize]))
    });
    let normals: Vec<[f64; 3]> = normals.collect();
    Ok((normals, [Some(neighbours), Some(start.elapsed().as_secs_f64()), None]))
}

/// Returns the direction of least variance of a point's neighbourhood, by inverse iteration.
fn normal<'a>(at: &[f64; 3], near: impl Iterator<Item = &'a [f64; 3]>) -> [f64; 3] {
    let (mut first, mut c, mut count) = ([0.0; 3], [[0.0; 3]; 3], 0.0);
    for q in near {
        let d = [0, 1, 2].map(|k| q[k] - at[k]);
        count += 1.0;
        for i in 0..3 {
            first[i] += d[i];
            (0..3).for_each(|j| c[i][j] += d[i] * d[j]);
        }
    }
    for i in 0..3 {
        (0..3).for_each(|j| c[i][j] -= first[i] * first[j] / count);
    }
    // The columns of the adjugate approximate the direction of least variance. The approximation is better for flatter
    // neighbourhoods.
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let adjugate = [cross(c[1], c[2]), cross(c[2], c[0]), cross(c[0], c[1])];
    let mut n = adjugate.into_iter().max_by(|a, b| dot(*a, *a).total_cmp(&dot(*b, *b))).unwrap_or([0.0, 0.0, 1.0]);
    for _ in 0..4 {
        n = [0, 1, 2].map(|i| dot(adjugate[i], n));
        let length = dot(n, n).sqrt();
        n = n.map(|v| v / length);
    }
    n
}
