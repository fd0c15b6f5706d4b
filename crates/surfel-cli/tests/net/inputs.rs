//! Input files of the regression tests in this folder: one small file of each kind. Their numbers come from exact
//! arithmetic, so that every machine writes the same bytes.

use crate::common;

/// Generator of pseudo-random numbers in [0, 1): the high 24 bits of a linear congruential generator, which f32
/// represents exactly.
struct Lcg(u64);

impl Lcg {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / f64::from(1 << 24)
    }
}

/// Returns points of a bumpy sphere: the position and the outward unit direction of each.
fn sphere(count: usize, seed: u64) -> Vec<([f64; 3], [f64; 3])> {
    let mut random = Lcg(seed);
    let mut point = || loop {
        let p = [0; 3].map(|_| 2.0 * random.unit() - 1.0);
        let length = p.iter().map(|v| v * v).sum::<f64>().sqrt();
        if (0.1..1.0).contains(&length) {
            let n = p.map(|v| v / length);
            let radius = 1.0 + 0.125 * (n[0] * n[1] * n[2]);
            return (n.map(|v| v * radius), n);
        }
    };
    (0..count).map(|_| point()).collect()
}

/// Returns a colour for a position, as levels from 0 to 255.
fn color(p: [f64; 3]) -> [u8; 3] {
    p.map(|v| (127.5 + 100.0 * v) as u8)
}

/// Formats points as rows of text. `row` returns the columns of a row from the point's index, position and direction.
fn rows(
    points: &[([f64; 3], [f64; 3])],
    separator: &str,
    row: impl Fn(usize, [f64; 3], [f64; 3]) -> Vec<String>,
) -> String {
    points.iter().enumerate().map(|(i, (p, n))| row(i, *p, *n).join(separator) + "\n").collect()
}

fn shown(p: [f64; 3]) -> Vec<String> {
    p.iter().map(|v| format!("{v:.5}")).collect()
}

fn xyz(_: usize, p: [f64; 3], _: [f64; 3]) -> Vec<String> {
    shown(p)
}

fn xyz_rgb(_: usize, p: [f64; 3], _: [f64; 3]) -> Vec<String> {
    shown(p).into_iter().chain(color(p).map(|c| c.to_string())).collect()
}

/// Encodes numbers as 32-bit floats in little-endian order.
fn floats(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(|v| (v as f32).to_le_bytes()).collect()
}

/// Returns a grid of triangles over a hill: the positions of its `side`² vertices, and each triangle's vertex indices.
fn hill(side: usize) -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
    let at = |i: usize| i as f64 / (side - 1) as f64 - 0.5;
    let height = |x: f64, y: f64| 0.5 - 2.0 * (x * x + y * y) + 0.25 * x * y;
    let positions = (0..side * side).map(|k| (at(k % side), at(k / side))).map(|(x, y)| [x, y, height(x, y)]).collect();
    let cells = (0..(side - 1) * (side - 1)).map(|k| k % (side - 1) + k / (side - 1) * side);
    (positions, cells.flat_map(|a| [[a, a + 1, a + side], [a + 1, a + side + 1, a + side]]).collect())
}

fn npy(shape: &str, kind: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
    bytes.extend_from_slice(header.as_bytes());
    bytes.extend_from_slice(data);
    bytes
}

fn ply(format: &str, elements: &str, body: &[u8]) -> Vec<u8> {
    [format!("ply\nformat {format} 1.0\n{elements}end_header\n").as_bytes(), body].concat()
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";
const NORMALS: &str = "property float nx\nproperty float ny\nproperty float nz\n";
const RGB: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\n";

fn ply_points(count: usize) -> Vec<u8> {
    let body: Vec<u8> = sphere(count, 3).iter().flat_map(|(p, _)| [floats(*p), color(*p).to_vec()].concat()).collect();
    ply("binary_little_endian", &format!("element vertex {count}\n{XYZ}{RGB}"), &body)
}

fn ply_big_endian(count: usize) -> Vec<u8> {
    let body: Vec<u8> = sphere(count, 4)
        .iter()
        .flat_map(|(p, n)| [*p, *n].concat().into_iter().flat_map(|v| (v as f32).to_be_bytes()).collect::<Vec<u8>>())
        .collect();
    ply("binary_big_endian", &format!("element vertex {count}\n{XYZ}{NORMALS}"), &body)
}

fn ply_gaussians(count: usize) -> Vec<u8> {
    let names = "f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
    let body: Vec<u8> = sphere(count, 5)
        .iter()
        .flat_map(|(p, n)| {
            let rest = [n[0], n[1], n[2], 2.0, -2.5, -2.0, -4.0, 1.0, 0.25 * n[0], 0.25 * n[1], 0.0];
            floats(p.iter().copied().chain(rest))
        })
        .collect();
    ply("binary_little_endian", &format!("element vertex {count}\n{XYZ}{properties}"), &body)
}

fn ply_mesh(side: usize) -> Vec<u8> {
    let (positions, faces) = hill(side);
    let mut text: String = positions.iter().map(|p| format!("{} {} {} {}\n", p[0], p[1], p[2], 10.0 * p[2])).collect();
    text.extend(faces.iter().map(|f| format!("3 {} {} {}\n", f[0], f[1], f[2])));
    let elements = format!(
        "element vertex {}\n{XYZ}property float temperature\nelement face {}\nproperty list uchar int vertex_indices\n",
        positions.len(),
        faces.len()
    );
    ply("ascii", &elements, text.as_bytes())
}

fn obj(side: usize, colored: bool) -> String {
    let (positions, faces) = hill(side);
    let vertex = |p: &[f64; 3]| {
        let end = if colored { format!(" {} {} {}", p[0] + 0.5, p[1] + 0.5, 0.25) } else { String::new() };
        format!("v {} {} {}{end}\n", p[0], p[1], p[2])
    };
    let faces = faces.iter().map(|f| format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1));
    positions.iter().map(vertex).chain(faces).collect()
}

fn stl_binary(side: usize) -> Vec<u8> {
    let (positions, faces) = hill(side);
    let mut bytes = vec![0; 80];
    bytes.extend_from_slice(&(faces.len() as u32).to_le_bytes());
    for face in faces {
        bytes.extend(floats([0.0, 0.0, 1.0].into_iter().chain(face.iter().flat_map(|i| positions[*i]))));
        bytes.extend_from_slice(&[0, 0]);
    }
    bytes
}

fn stl_text(side: usize) -> String {
    let (positions, faces) = hill(side);
    let facet = |face: &[usize; 3]| {
        let corners: String =
            face.iter().map(|i| positions[*i]).map(|p| format!("vertex {} {} {}\n", p[0], p[1], p[2])).collect();
        format!("facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n")
    };
    format!("solid hill\n{}endsolid hill\n", faces.iter().map(facet).collect::<String>())
}

fn off(side: usize) -> String {
    let (positions, faces) = hill(side);
    let mut text = format!("OFF\n{} {} 0\n", positions.len(), faces.len());
    text.extend(positions.iter().map(|p| format!("{} {} {}\n", p[0], p[1], p[2])));
    text.extend(faces.iter().map(|f| format!("3 {} {} {}\n", f[0], f[1], f[2])));
    text
}

/// Encodes the hill as GLB, with its triangles or with its vertices as points.
fn glb(side: usize, with_faces: bool) -> Vec<u8> {
    let (positions, faces) = hill(side);
    let mut data = floats(positions.iter().flatten().copied());
    let bytes_of_positions = data.len();
    data.extend(faces.iter().flatten().flat_map(|i| (*i as u32).to_le_bytes()));
    let indices = if with_faces { r#","indices":1"# } else { "" };
    let mode = if with_faces { 4 } else { 0 };
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],"meshes":[{{
        "primitives":[{{"attributes":{{"POSITION":0}},"mode":{mode}{indices}}}]}}],"buffers":[{{"byteLength":{}}}],
        "bufferViews":[{{"buffer":0,"byteLength":{bytes_of_positions}}},{{"buffer":0,"byteOffset":{bytes_of_positions},
        "byteLength":{}}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3",
        "min":[-0.5,-0.5,-0.5625],"max":[0.5,0.5,0.5]}},{{"bufferView":1,"componentType":5125,"count":{},
        "type":"SCALAR"}}]}}"#,
        data.len(),
        data.len() - bytes_of_positions,
        positions.len(),
        3 * faces.len()
    );
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend_from_slice(&((28 + json.len() + data.len()) as u32).to_le_bytes());
    for (kind, content) in [(b"JSON", json.as_bytes()), (b"BIN\0", &data)] {
        bytes.extend_from_slice(&(content.len() as u32).to_le_bytes());
        bytes.extend_from_slice(kind);
        bytes.extend_from_slice(content);
    }
    bytes
}

fn pcd(count: usize, binary: bool) -> Vec<u8> {
    let points = sphere(count, 6);
    let kind = if binary { "binary" } else { "ascii" };
    let header = format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {count}\n\
         HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {kind}\n"
    );
    let body = if binary {
        points.iter().flat_map(|(p, _)| floats(p.iter().copied().chain([p[2] + 2.0]))).collect()
    } else {
        rows(&points, " ", |i, p, _| shown(p).into_iter().chain([i.to_string()]).collect()).into_bytes()
    };
    [header.as_bytes(), &body].concat()
}

fn splat(count: usize) -> Vec<u8> {
    let row = |(p, _): &([f64; 3], [f64; 3])| {
        let mut bytes = floats(p.iter().copied().chain([0.08, 0.08, 0.02]));
        bytes.extend(color(*p));
        bytes.extend([240, 255, 128, 128, 128]);
        bytes
    };
    sphere(count, 7).iter().flat_map(row).collect()
}

fn colmap(count: usize) -> String {
    let head = "# 3D point list with one line of data per point:\n\
                #   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";
    let row = |i: usize, p: [f64; 3], _: [f64; 3]| -> Vec<String> {
        let start = [(i + 1).to_string()].into_iter().chain(shown(p)).chain(color(p).map(|c| c.to_string()));
        start.chain(["0.5 1 2 3 4".to_owned()]).collect()
    };
    head.to_owned() + &rows(&sphere(count, 8), " ", row)
}

fn two_clusters() -> String {
    let near = sphere(500, 9);
    let far = sphere(500, 10).into_iter().map(|(p, n)| ([p[0] + 6.0, p[1], p[2]], n)).collect();
    [near, far].map(|points: Vec<_>| rows(&points, " ", xyz)).concat()
}

fn room() -> String {
    let mut random = Lcg(11);
    let mut wall = |axis: usize, at: f64| -> String {
        let point = |random: &mut Lcg| {
            let mut p = [0; 3].map(|_| 4.0 * random.unit() - 2.0);
            p[axis] = at;
            shown(p).join(" ") + "\n"
        };
        (0..600).map(|_| point(&mut random)).collect()
    };
    [(2, -2.0), (0, -2.0), (0, 2.0), (1, 2.0)].map(|(axis, at)| wall(axis, at)).concat()
}

/// Returns the name and the content of every input file.
pub(super) fn all() -> Vec<(&'static str, Vec<u8>)> {
    let (small, large) = (sphere(400, 1), sphere(3000, 2));
    let text = |text: String| text.into_bytes();
    let normals = |_: usize, p: [f64; 3], n: [f64; 3]| [shown(p), shown(n)].concat();
    let labelled = |i: usize, p: [f64; 3], _: [f64; 3]| shown(p).into_iter().chain([(i % 4).to_string()]).collect();
    let indexed = |i: usize, p: [f64; 3], _: [f64; 3]| [i.to_string()].into_iter().chain(shown(p)).collect();
    let fractions = |_: usize, p: [f64; 3], _: [f64; 3]| {
        shown(p).into_iter().chain(color(p).map(|c| format!("{:.4}", f64::from(c) / 255.0))).collect()
    };
    let double = |points: &[([f64; 3], [f64; 3])]| -> Vec<u8> {
        points.iter().flat_map(|(p, _)| p.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()).collect()
    };
    let octahedron = "OFF\n6 8 0\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n3 0 2 4\n3 2 1 4\n3 1 3 4\n3 3 0 4\n\
                      3 2 0 5\n3 1 2 5\n3 3 1 5\n3 0 3 5\n";
    vec![
        ("ball.ply", text(common::ball())),
        ("bare.xyz", text(rows(&small, " ", xyz))),
        ("dense.xyz", text(rows(&large, " ", xyz))),
        ("normals.xyz", text(rows(&small, " ", normals))),
        ("colors.txt", text(rows(&small, " ", xyz_rgb))),
        ("fractions.csv", text(rows(&small, ",", fractions))),
        ("names.csv", text("//X;Y;Z;Red;Green;Blue\n".to_owned() + &rows(&small, ";", xyz_rgb))),
        ("labels.txt", text(rows(&small, " ", labelled))),
        ("index-first.txt", text(rows(&small, " ", indexed))),
        ("scan.pts", text(format!("{}\n", small.len()) + &rows(&small, " ", xyz))),
        ("clusters.xyz", text(two_clusters())),
        ("room.xyz", text(room())),
        ("one.xyz", text("1 2 3\n".to_owned())),
        ("few.xyz", text(rows(&small[..5], " ", xyz))),
        ("points.ply", ply_points(400)),
        ("big-endian.ply", ply_big_endian(400)),
        ("gaussians.ply", ply_gaussians(300)),
        ("mesh.ply", ply_mesh(9)),
        ("cube.obj", text(common::cube())),
        ("hill.obj", text(obj(13, false))),
        ("colored.obj", text(obj(9, true))),
        ("hill.stl", stl_binary(9)),
        ("text.stl", text(stl_text(5))),
        ("hill.off", text(off(9))),
        ("octahedron.off", text(octahedron.to_owned())),
        ("hill.glb", glb(9, true)),
        ("points.glb", glb(21, false)),
        ("text.pcd", pcd(300, false)),
        ("binary.pcd", pcd(300, true)),
        ("points.npy", npy("(400, 3)", "<f8", &double(&small))),
        ("image.npy", npy("(20, 20, 3)", "|u1", &[9; 1200])),
        ("gaussians.splat", splat(300)),
        ("points3D.txt", text(colmap(300))),
        ("tile.las", common::las_at(24, 0)),
        ("raw.bin", floats(small.iter().flat_map(|(p, _)| *p))),
        ("empty.ply", Vec::new()),
        ("words.txt", text("this is no cloud\nnor is this\n".to_owned())),
        ("cut.ply", ply_points(400)[..3000].to_vec()),
        ("nan.xyz", text("1 2 3\nnan 2 3\n4 5 6\n".to_owned())),
        ("unknown.dae", text("<?xml version=\"1.0\"?><COLLADA></COLLADA>\n".to_owned())),
        ("a.json", text(common::scene(r#""shader": "phong""#).replace("a.ply", "ball.ply"))),
    ]
}
