//! Planes of the nearest splat in EXR and NPZ files.

use crate::common;

use common::{Folder, cube};
use std::collections::BTreeMap;
use surfel_io::{Planes, read_image};

/// Returns a wall of 20 × 20 points 1 apart, some with classes; the sixth row of the file isn't a valid point.
fn wall() -> String {
    let mut text = "x,y,z,classification,height_class\n".to_owned();
    for i in 0..400 {
        if i == 5 {
            text += "nan,0,0,1,1\n";
        }
        let (x, y) = (i % 20, i / 20);
        text += &format!("{x},{y},0,{},{}\n", if x < 10 { 2 } else { -1 }, y / 10 * 70_000);
    }
    text
}

/// Returns the file row of the point at a column and row of the wall.
fn row(x: usize, y: usize) -> u32 {
    let i = 20 * y + x;
    (i + usize::from(i >= 5)) as u32
}

/// Returns type header and data of the arrays in an uncompressed NPZ file, by name.
fn arrays(bytes: &[u8]) -> BTreeMap<String, (String, Vec<u8>)> {
    let number = |at: usize, n: usize| bytes[at..at + n].iter().rev().fold(0, |v, b| v << 8 | usize::from(*b));
    let (mut at, mut found) = (0, BTreeMap::new());
    while bytes[at..].starts_with(b"PK\x03\x04") {
        let (size, name) = (number(at + 18, 4), number(at + 26, 2));
        let data = at + 30 + name + number(at + 28, 2);
        let name = std::str::from_utf8(&bytes[at + 30..at + 30 + name]).unwrap().strip_suffix(".npy").unwrap();
        let array = &bytes[data..data + size];
        assert!(array.starts_with(b"\x93NUMPY\x01\x00") && number(at + 22, 4) == size, "{name}");
        let head = 10 + number(data + 8, 2);
        assert_eq!(head % 64, 0);
        let header = String::from_utf8(array[10..head].to_vec()).unwrap();
        found.insert(name.to_owned(), (header, array[head..].to_vec()));
        at = data + size;
    }
    assert!(bytes[at..].starts_with(b"PK\x01\x02"));
    found
}

fn whole(planes: &Planes, name: &str) -> Vec<u32> {
    planes.whole.iter().find(|(n, _)| n == name).unwrap().1.clone()
}

#[test]
fn rows_are_the_files_own_whatever_is_left_out_and_npz_and_exr_agree() {
    let f = Folder::new("planes");
    f.write("a.csv", wall());
    for flags in ["", "--every 3", "--where x>=4", "--crop 2,0,-1,19,12,1 --every 2", "--max-points 150"] {
        let common = format!("a.csv --size 80x60 --view front --up +y --backend cpu --force {flags}");
        f.run(&format!("{common} -o a.npz --planes index,position --label height_class")).code(0);
        f.run(&format!("{common} -o a.exr --planes label,position,object --label height_class")).code(0);
        f.run(&format!("{common} -o plain.exr")).code(0);
        let (exr, plain) =
            (read_image(&f.path().join("a.exr")).unwrap(), read_image(&f.path().join("plain.exr")).unwrap());
        assert!(plain.whole.is_empty() && plain.other.is_empty());
        assert_eq!((&exr.color, &exr.depth, &exr.normal), (&plain.color, &plain.depth, &plain.normal));
        let npz = arrays(&f.read("a.npz"));
        let names: Vec<&str> = npz.keys().map(String::as_str).collect();
        let expected =
            "A B G R Z index label normal.X normal.Y normal.Z object position.X position.Y position.Z weight";
        assert_eq!(names.join(" "), expected);
        let (header, _) = &npz["Z"];
        assert!(header.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (60, 80), }"), "{header}");
        let ids = |name: &str| -> Vec<u32> {
            let (header, data) = &npz[name];
            assert!(header.contains("'<u4'"), "{header}");
            data.chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect()
        };
        for name in ["index", "object", "label"] {
            assert_eq!(ids(name), whole(&exr, name), "{name} {flags}");
        }
        let position = |axis: &str| -> Vec<f64> {
            let (header, data) = &npz[&format!("position.{axis}")];
            assert!(header.contains("'<f8'"), "{header}");
            data.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect()
        };
        let (x, y, index, label) = (position("X"), position("Y"), ids("index"), ids("label"));
        let depth = exr.depth.as_ref().unwrap();
        let mut seen = 0;
        for i in 0..index.len() {
            let there = index[i] != u32::MAX;
            assert_eq!((there, there), (depth[i].is_finite(), x[i].is_finite()), "{flags}");
            if !there {
                assert_eq!((ids("object")[i], label[i]), (u32::MAX, u32::MAX));
                continue;
            }
            seen += 1;
            // The wall is flat, and its splats extend less than four points; with 150 of 400 points, correspondingly
            // farther.
            let found = (0..400).map(|i| (i % 20, i / 20)).find(|&(x, y)| row(x, y) == index[i]).unwrap();
            let reach = if flags.starts_with("--max-points") { 4.0 * (400.0_f64 / 150.0).sqrt() } else { 4.0 };
            assert!(
                (found.0 as f64 - x[i]).hypot(found.1 as f64 - y[i]) < reach,
                "{flags} {found:?} {} {}",
                x[i],
                y[i]
            );
            assert_eq!(label[i], (found.1 / 10 * 70_000) as u32);
            match flags {
                "--where x>=4" => assert!(found.0 >= 4),
                "--every 3" => assert!((20 * found.1 + found.0).is_multiple_of(3)),
                _ => {}
            }
        }
        assert!(seen > 1000, "{flags}: {seen}");
    }
}

#[test]
fn negative_classes_are_no_labels_and_objects_are_told_apart() {
    let f = Folder::new("labels");
    f.write("a.csv", wall());
    f.write("b.obj", cube());
    let run = f.run("b.obj a.csv -o o.exr --planes label --size 64x64 --backend reference --view front").code(0);
    assert!(run.stderr().contains("no attribute classification"), "{}", run.stderr());
    let planes = read_image(&f.path().join("o.exr")).unwrap();
    let (object, label) = (whole(&planes, "object"), whole(&planes, "label"));
    assert!(object.contains(&0) && object.contains(&1) && label.contains(&2), "{object:?}");
    for (object, label) in object.iter().zip(&label) {
        assert!(*label == u32::MAX || (*label == 2 && *object == 1));
    }
}

#[test]
fn what_holds_no_planes_is_a_usage_error_and_unfit_labels_are_bad_input() {
    let f = Folder::new("planes-wrong");
    f.write("a.csv", wall());
    for (words, code, part) in [
        ("a.csv -o a.png --planes index", 2, "--planes is for EXR and NPZ, but -o names a PNG"),
        ("a.csv -o a.jpg --label classification", 2, "--label is for EXR and NPZ, but -o names a JPEG"),
        ("a.csv -o - --planes position", 2, "--planes is for EXR and NPZ"),
        ("a.csv -o a.exr --planes uv", 2, "index"),
        ("a.csv -o a.exr --planes index --samples 2", 2, "have no mean"),
        ("a.csv -o a.npz --png16", 2, "NPZ"),
        ("a.csv -o a.exr --label mood", 3, "no file has the attribute mood"),
        ("a.csv -o a.exr --label z", 3, "no file has the attribute z"),
    ] {
        let run = f.run(words).code(code);
        assert!(run.stderr().contains(part), "{words}: {}", run.stderr());
    }
    f.write("b.csv", wall().replace(",70000\n", ",0.5\n"));
    let run = f.run("b.csv -o a.exr --label height_class").code(3);
    assert!(run.stderr().contains("whole numbers"), "{}", run.stderr());
    assert_eq!(f.names(), ["a.csv", "b.csv"]);
}
