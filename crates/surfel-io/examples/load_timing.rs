//! Loads each file named on the command line five times. Prints the median time, the contents, the peak memory of the
//! process so far (on Linux), and the notes.

use std::path::Path;
use std::time::Instant;
use surfel_io::{Content, LoadOptions, load};

fn main() {
    for name in std::env::args().skip(1) {
        let mut times = Vec::new();
        let mut last = None;
        for _ in 0..5 {
            drop(last.take());
            let start = Instant::now();
            last = Some(load(Path::new(&name), &LoadOptions::default()));
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("?").trim();
        match last {
            Some(Ok(loaded)) => {
                let what = match &loaded.content {
                    Content::Splats(s) => format!("{} splats", s.len()),
                    Content::Points(p) => format!("{} points", p.len()),
                    Content::Mesh(m) => format!("{} vertices, {} triangles", m.positions.len(), m.triangles.len()),
                    Content::Gaussians(g) => format!("{} Gaussians", g.len()),
                    Content::Octree(h) => format!("{} splats, {} nodes", h.cloud().len(), h.nodes().len()),
                };
                let (format, up, attributes) = (loaded.format, loaded.up, loaded.attributes.join(", "));
                println!("{name}: {:.1} ms, {format}, {what}, up {up}; {attributes}; peak {peak}", times[2]);
                loaded.notes.iter().for_each(|note| println!("  note: {note}"));
            }
            Some(Err(error)) => println!("{error}"),
            None => {}
        }
    }
}
