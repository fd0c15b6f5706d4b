//! Shapes of meshes: fans, cones, needles, stars and others for which spatial searches may be slow.

use super::Shape;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

type Point = [f64; 3];

/// Polygon mesh to be written as an OBJ file.
#[derive(Default)]
struct Polygons {
    points: Vec<Point>,
    faces: Vec<Vec<usize>>,
}

impl Polygons {
    fn point(&mut self, p: Point) -> usize {
        self.points.push(p);
        self.points.len() - 1
    }

    fn triangle(&mut self, corners: [Point; 3]) {
        let face = corners.map(|p| self.point(p)).to_vec();
        self.faces.push(face);
    }

    /// Adds the triangles between a hub and each pair of neighbours on a closed ring.
    fn hub(&mut self, hub: Point, ring: impl Iterator<Item = Point>) {
        let hub = self.point(hub);
        let ring: Vec<usize> = ring.map(|p| self.point(p)).collect();
        let next = ring.iter().cycle().skip(1);
        self.faces.extend(ring.iter().zip(next).map(|(a, b)| vec![hub, *a, *b]));
    }

    fn write(&self, path: &Path) -> std::io::Result<()> {
        let mut text = String::new();
        for [x, y, z] in &self.points {
            let _ = writeln!(text, "v {x:.7} {y:.7} {z:.7}");
        }
        for face in &self.faces {
            text.push('f');
            face.iter().for_each(|i| _ = write!(text, " {}", i + 1));
            text.push('\n');
        }
        std::fs::write(path, text)
    }
}

/// Returns `n` points on a circle about the z axis.
fn circle(n: usize, radius: f64, z: f64) -> impl Iterator<Item = Point> {
    (0..n).map(move |i| {
        let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
        [radius * cos, radius * sin, z]
    })
}

/// Returns the i-th number of an evenly distributed sequence in [0, 1) (van der Corput's idea with the plastic number).
fn spread(i: usize, axis: usize) -> f64 {
    let step = [0.819_172_513_396_164, 0.671_043_606_703_789, 0.549_700_477_901_970][axis];
    (0.5 + step * i as f64).fract()
}

fn spread_point(i: usize) -> Point {
    [0, 1, 2].map(|axis| spread(i, axis))
}

/// Returns a height field over a grid of `columns`×`rows` squares.
fn grid(columns: usize, rows: usize, height: impl Fn(f64, f64) -> f64) -> Polygons {
    let mut mesh = Polygons::default();
    for (j, i) in (0..=rows).flat_map(|j| (0..=columns).map(move |i| (j, i))) {
        let (x, y) = (i as f64, j as f64);
        mesh.point([x, y, height(x, y)]);
    }
    for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
        let a = j * (columns + 1) + i;
        mesh.faces.extend([vec![a, a + 1, a + columns + 2], vec![a, a + columns + 2, a + columns + 1]]);
    }
    mesh
}

fn side(n: usize) -> usize {
    (n as f64).sqrt().ceil() as usize
}

fn fan(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    mesh.hub([0.0; 3], circle(n, 1.0, 0.0));
    mesh
}

/// Returns a cone with its base.
fn cone(n: usize, height: f64) -> Polygons {
    let mut mesh = Polygons::default();
    mesh.hub([0.0, 0.0, height], circle(n / 2, 1.0, 0.0));
    mesh.hub([0.0; 3], circle(n / 2, 1.0, 0.0));
    mesh
}

fn star(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    let ring = circle(n, 1.0, 0.0).enumerate();
    mesh.hub([0.0; 3], ring.map(|(i, p)| if i % 2 == 0 { p } else { p.map(|x| 0.1 * x) }));
    mesh
}

/// Returns slivers in all directions from one common corner.
fn urchin(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    let hub = mesh.point([0.5; 3]);
    for i in 0..n {
        let [x, y, z] = spread_point(i);
        let ends = [mesh.point([x, y, z]), mesh.point([x + 0.001, y, z])];
        mesh.faces.push(vec![hub, ends[0], ends[1]]);
    }
    mesh
}

/// Returns triangles that share one edge, like the pages of a book.
fn book(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    let spine = [mesh.point([0.0; 3]), mesh.point([0.0, 0.0, 1.0])];
    for p in circle(n, 1.0, 0.5) {
        let tip = mesh.point(p);
        mesh.faces.push(vec![spine[0], spine[1], tip]);
    }
    mesh
}

/// Returns `n` copies of one triangle.
fn copies(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    (0..n).for_each(|_| mesh.triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    mesh
}

/// Returns long, thin triangles that intersect each other.
fn needles(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    for i in 0..n {
        let (a, b) = (spread_point(2 * i), spread_point(2 * i + 1));
        mesh.triangle([a, b, [b[0] + 1e-4, b[1], b[2]]]);
    }
    mesh
}

fn tetrahedra(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    let side = (n as f64).cbrt().ceil() as usize;
    for i in 0..n / 4 {
        let at = [i % side, i / side % side, i / side / side].map(|k| 2.0 * k as f64);
        let first = mesh.point(at);
        for axis in 0..3 {
            let mut p = at;
            p[axis] += 1.0;
            mesh.point(p);
        }
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        mesh.faces.extend(faces.map(|face| face.map(|k| first + k).to_vec()));
    }
    mesh
}

/// Returns a ball of few rings and many sectors, with a hub at each pole.
fn ball(n: usize) -> Polygons {
    let (rings, sectors) = (8, n / 16);
    let mut mesh = Polygons::default();
    for ring in 1..rings {
        let (sin, cos) = (0.5 * TAU * ring as f64 / rings as f64).sin_cos();
        circle(sectors, sin, cos).for_each(|p| _ = mesh.point(p));
    }
    let [top, bottom] = [1.0, -1.0].map(|z| mesh.point([0.0, 0.0, z]));
    let last = (rings - 2) * sectors;
    for i in 0..sectors {
        let j = (i + 1) % sectors;
        mesh.faces.extend([vec![top, i, j], vec![bottom, last + j, last + i]]);
        for ring in 0..rings - 2 {
            let (a, b) = (ring * sectors, (ring + 1) * sectors);
            mesh.faces.extend([vec![a + i, b + i, b + j], vec![a + i, b + j, a + j]]);
        }
    }
    mesh
}

/// Returns a strip in the form of a helix.
fn helix(n: usize) -> Polygons {
    let mut mesh = Polygons::default();
    for i in 0..=n / 2 {
        let (sin, cos) = (0.05 * i as f64).sin_cos();
        for radius in [1.0, 1.2] {
            mesh.point([radius * cos, radius * sin, 0.005 * i as f64]);
        }
    }
    mesh.faces.extend((0..n / 2).flat_map(|i| [vec![2 * i, 2 * i + 1, 2 * i + 3], vec![2 * i, 2 * i + 3, 2 * i + 2]]));
    mesh
}

/// Returns one polygon of `n` corners: a circle, or a comb with teeth.
fn polygon(n: usize, is_comb: bool) -> Polygons {
    let mut mesh = Polygons::default();
    let teeth = (0..n / 2).flat_map(|i| [[i as f64, 1.0, 0.0], [i as f64 + 0.5, 50.0, 0.0]]);
    let comb = [[n as f64 / 2.0, 0.0, 0.0], [0.0, 0.0, 0.0]].into_iter().chain(teeth);
    let points: Vec<Point> = if is_comb { comb.collect() } else { circle(n, 1.0, 0.0).collect() };
    let face = points.into_iter().map(|p| mesh.point(p)).collect();
    mesh.faces.push(face);
    mesh
}

/// Returns a function that writes a mesh of a given size, and returns the words of the command that converts it with
/// `flags`.
fn convert(
    flags: &'static str,
    make: impl Fn(usize) -> Polygons + 'static,
) -> impl Fn(&Path, usize) -> std::io::Result<Vec<String>> {
    move |folder, n| {
        make(n).write(&folder.join("in.obj"))?;
        let output = if flags.contains("--hybrid") { "out.surfel" } else { "out.ply" };
        let words = ["convert", "in.obj", "-o", output, "--force"].into_iter().chain(flags.split_whitespace());
        Ok(words.map(str::to_owned).collect())
    }
}

pub(super) fn shapes() -> Vec<Shape> {
    let triangles = |n: usize| (n, "triangles");
    let wave = |x: f64, y: f64| 3.0 * (0.1 * x).sin() * (0.07 * y).cos();
    vec![
        Shape::new("fan, sharp", triangles(2000), convert("--sharp", fan)),
        Shape::new("fan, sharp and fewer", triangles(1000), convert("--sharp --error 0.001", fan)),
        Shape::new("fan, hybrid", triangles(8000), convert("--hybrid", fan)),
        Shape::new("fan, spread splats", triangles(8000), convert("", fan)),
        Shape::new("cone, sharp", triangles(2000), convert("--sharp", |n| cone(n, 1.0))),
        Shape::new("cone, hybrid", triangles(8000), convert("--hybrid", |n| cone(n, 1.0))),
        Shape::new("needle-like cone, sharp", triangles(2000), convert("--sharp", |n| cone(n, 20.0))),
        Shape::new("flat cone, sharp", triangles(2000), convert("--sharp", |n| cone(n, 0.05))),
        Shape::new("star, sharp", triangles(500), convert("--sharp", star)),
        Shape::new("star, hybrid", triangles(2000), convert("--hybrid", star)),
        Shape::new("one-vertex hub, sharp", triangles(1000), convert("--sharp", urchin)),
        Shape::new("one-vertex hub, spread splats", triangles(4000), convert("", urchin)),
        Shape::new("book about one edge, sharp", triangles(1000), convert("--sharp", book)),
        Shape::new("book about one edge, hybrid", triangles(2000), convert("--hybrid", book)),
        Shape::new("copies of a triangle, sharp", triangles(1000), convert("--sharp", copies)),
        Shape::new("copies of a triangle, hybrid", triangles(2000), convert("--hybrid", copies)),
        Shape::new("crossing needles, sharp", triangles(1000), convert("--sharp", needles)),
        Shape::new("crossing needles, hybrid", triangles(2000), convert("--hybrid", needles)),
        Shape::new("tetrahedra, sharp", triangles(2000), convert("--sharp", tetrahedra)),
        Shape::new("ball with two hubs, sharp", triangles(2000), convert("--sharp", ball)),
        Shape::new("ball with two hubs, fewer", triangles(2000), convert("--sharp --splats 500", ball)),
        Shape::new("strip, sharp", triangles(2000), convert("--sharp", |n| grid(n / 2, 1, |_, _| 0.0))),
        Shape::new("helix, sharp", triangles(2000), convert("--sharp", helix)),
        Shape::new(
            "coplanar grid, sharp",
            triangles(2000),
            convert("--sharp", |n| grid(side(n), side(n / 4), |_, _| 0.0)),
        ),
        Shape::new(
            "wavy grid, sharp and fewer",
            triangles(2000),
            convert("--sharp --splats 500", move |n| grid(side(n), side(n / 4), wave)),
        ),
        Shape::new(
            "wavy grid, hybrid",
            triangles(2000),
            convert("--hybrid", move |n| grid(side(n), side(n / 4), wave)),
        ),
        Shape::new("one round polygon, sharp", (2000, "corners"), convert("--sharp", |n| polygon(n, false))),
        Shape::new("one comb polygon, spread splats", (8000, "corners"), convert("", |n| polygon(n, true))),
    ]
}
