//! Surface models and framing from the command line.

use crate::common::{Folder, las_at};

/// Bytes per point of [`las_at`].
const RECORD: usize = 36;
/// Offset of the first point in bytes.
const FIRST: usize = 375;
const SIDE: u32 = 60;

/// Returns a scan with points modified by `change`, which gets each point's number and record.
fn las_with(change: impl Fn(usize, &mut [u8])) -> Vec<u8> {
    let mut bytes = las_at(SIDE, 0);
    bytes[FIRST..].chunks_exact_mut(RECORD).enumerate().for_each(|(i, record)| change(i, record));
    bytes
}

/// Raises a point by `metres`.
fn lift(record: &mut [u8], metres: i32) {
    let z = i32::from_le_bytes([8, 9, 10, 11].map(|k| record[k])) + 1000 * metres;
    record[8..12].copy_from_slice(&z.to_le_bytes());
}

/// Turns every hundredth point into noise, high or low.
fn noise(i: usize, record: &mut [u8]) {
    if i % 100 == 7 {
        record[16] = if i % 200 == 7 { 18 } else { 7 };
        lift(record, if i % 200 == 7 { 90 } else { -40 });
    }
}

#[test]
fn heights_are_written_alone() {
    let f = Folder::new("dsm-alone");
    f.write("in.las", las_with(|_, _| ()));
    let run = f.run("ortho in.las --gsd 0.2 --dsm dsm.tif").code(0);
    assert!(f.has("dsm.tif") && run.stderr().contains("dsm.tif: 30 x 30 pixels"), "{}", run.stderr());
    f.run("ortho in.las --gsd 0.2 --normals n.tif --dsm dsm.tif -f").code(0);
    f.run("ortho in.las --gsd 0.2 -o all.tif --dsm again.tif").code(0);
    assert!(f.read("again.tif") == f.read("dsm.tif"));
    f.run("ortho in.las --gsd 0.2 --dsm dsm.tif").fails(1, "exists");
    f.run("ortho in.las --gsd 0.2").fails(2, "--output");
    // The colour bar is named after the first image.
    f.run("ortho in.las --gsd 0.2 --dsm d.tif --color-by height --colorbar").code(0);
    assert!(f.has("d-colorbar.png"), "{:?}", f.names());
}

#[test]
fn noise_and_withheld_points_move_no_frame_and_are_no_surface() {
    let f = Folder::new("noise");
    f.write("clean.las", las_with(|_, _| ()));
    f.write("noise.las", las_with(noise));
    f.write(
        "withheld.las",
        las_with(|i, record| {
            if i % 100 == 7 {
                record[15] |= 4;
                lift(record, 90);
            }
        }),
    );
    f.run("convert noise.las -o noise.copc.laz").code(0);
    let eye = |words: &str| {
        let run = f.run(&format!("render {words} --print-scene")).code(0);
        let eye =
            run.json()["camera"]["eye"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>();
        (eye, run.stderr())
    };
    let (clean, said) = eye("clean.las --view 30,30");
    assert!(!said.contains("noise"), "{said}");
    let apart = |a: &[f64]| a.iter().zip(&clean).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    for (words, names) in [
        ("noise.las", "36 points of noise (classes 7 and 18)"),
        ("noise.copc.laz", "36 points of noise (classes 7 and 18)"),
        ("withheld.las", "36 points flagged as withheld"),
    ] {
        let (found, said) = eye(&format!("{words} --view 30,30"));
        assert!(apart(&found) < 1.0 && said.contains(names), "{words}: {found:?} {clean:?} {said}");
        // The automatic view and up axis, too.
        let (found, said) = eye(words);
        assert!((found[2] - clean[2]).abs() < 30.0 && said.contains("up is +z"), "{words}: {found:?} {said}");
        let (found, said) = eye(&format!("{words} --view 30,30 --classes all"));
        assert!(apart(&found) > 20.0 && !said.contains("out of the frame"), "{words}: {found:?} {said}");
        let model = |flags: &str| {
            f.run(&format!("ortho {words} --gsd 0.5 --dsm dsm.tif -f --outliers keep {flags}")).code(0).stderr()
        };
        let said = model("");
        assert!(said.contains(names) && said.contains("--classes all"), "{words}: {said}");
        let without = f.read("dsm.tif");
        assert!(!model("--classes all").contains("left out"), "{words}");
        assert!(f.read("dsm.tif") != without, "{words}");
    }
    // A class that is named is included.
    let run = f.run("ortho noise.las --gsd 0.5 --dsm dsm.tif -f --classes 2,7 --outliers keep").code(0);
    assert!(!run.stderr().contains("of noise"), "{}", run.stderr());
    f.write("only.las", las_with(|_, record| record[16] = 7));
    f.run("ortho only.las --gsd 0.5 --dsm only.tif").fails(3, "--classes all");
}

#[test]
fn conversion_drops_no_noise_and_nothing_withheld() {
    let f = Folder::new("convert");
    f.write(
        "in.las",
        las_with(|i, record| {
            noise(i, record);
            record[15] |= if i % 50 == 3 { 4 } else { 0 };
        }),
    );
    f.run("convert in.las -o out.ply").code(0);
    let found = f.run("info --json out.ply").code(0).json();
    assert_eq!(found["splats"], SIDE * SIDE, "{found}");
    assert!(f.run("info out.ply").code(0).stdout().contains("withheld"));
    f.run("convert in.las -o out.copc.laz").code(0);
    // A table's column has the same effect as a flag.
    let run = f.run("ortho out.copc.laz --gsd 0.5 --dsm a.tif").code(0);
    assert!(run.stderr().contains("72 points flagged as withheld"), "{}", run.stderr());
}

#[test]
fn degrees_and_strays_are_refused_by_what_was_given() {
    let f = Folder::new("refused");
    // Degrees as many programs write them: steps of 1e-7 beside centimetres, and no reference system.
    let mut bytes = las_with(|i, record| {
        let at = [86_000_000 + 10 * (i as i32 % 60), 470_000_000 + 10 * (i as i32 / 60), 41_000 + i as i32 % 90];
        at.iter().zip([0, 4, 8]).for_each(|(v, k)| record[k..k + 4].copy_from_slice(&v.to_le_bytes()));
    });
    for (k, (scale, offset)) in [(1e-7, 0.0), (1e-7, 0.0), (0.01, 0.0)].into_iter().enumerate() {
        bytes[131 + 8 * k..139 + 8 * k].copy_from_slice(&f64::to_le_bytes(scale));
        bytes[155 + 8 * k..163 + 8 * k].copy_from_slice(&f64::to_le_bytes(offset));
    }
    f.write("lonlat.las", bytes);
    f.run("ortho lonlat.las --gsd 1 -o o.tif").fails(3, "project it first");
    f.write("lonlat.csv", "lat,lon,alt\n47.3,8.5,400\n47.31,8.51,405\n47.32,8.5,404\n");
    f.run("ortho lonlat.csv --gsd 1 --dsm o.tif").fails(3, "project it first");
    assert!(!f.has("o.tif"));
    let mut text = String::from("x,y,z\n");
    for i in 0..100 {
        text += &format!("{},{},{}\n", 500_000.0 + 7.3 * f64::from(i), 4e6 + 3.7 * f64::from(i % 50), 300.0);
    }
    f.write("stray.csv", text.clone() + "0,0,0\n");
    let run = f.run("ortho stray.csv --gsd 1 -o o.tif").fails(3, "at 0,0,0");
    assert!(run.stderr().contains("--outliers drop") && !run.stderr().contains("--bounds is"), "{}", run.stderr());
    f.run("ortho stray.csv --gsd 1 -o o.tif --outliers drop").code(0);
    f.run("ortho stray.csv --gsd 1 -o o.tif -f --bounds 500000,4000000,500730,4000190").code(0);
    f.write("far.csv", text);
    f.run("ortho far.csv --gsd 1e-9 -o far.tif").fails(2, "--gsd");
}
