//! `--columns` in every command that reads tables.

use crate::common;

use common::{Folder, scene};

/// Returns rows of a wave, each x y z intensity as float32.
fn rows() -> Vec<u8> {
    let value = |i: u32| [(i % 20) as f32, (i / 20) as f32, ((i % 20) as f32 * 0.5).sin(), i as f32];
    (0..400).flat_map(value).flat_map(f32::to_le_bytes).collect()
}

#[test]
fn columns_name_what_every_command_reads() {
    let f = Folder::new("columns");
    f.write("000000.bin", rows());
    let text: String = (0..400).map(|i| format!("{} 7 {} {} {}\n", i / 20, i, (i % 20) / 7, i % 20)).collect();
    f.write("t.txt", text);
    const RAW: &str = "--columns f4:x,y,z,intensity";
    const TEXT: &str = "--columns y,_,number,z,x";
    let refused = f.run("info 000000.bin").code(3);
    assert!(refused.stderr().contains(RAW), "{}", refused.stderr());
    for (input, flag, name, most) in [("000000.bin", RAW, "intensity", 1.0), ("t.txt", TEXT, "number", 2.0)] {
        let facts = f.run(&format!("info {input} --json {flag}")).code(0).json();
        assert_eq!((&facts["points"], &facts["attributes"][name]["max"]), (&400.into(), &399.0.into()), "{facts}");
        let bounds = facts["bounds"].as_array().unwrap();
        assert_eq!(
            (bounds[0][0].as_f64(), bounds[1][0].as_f64(), bounds[1][1].as_f64()),
            (Some(0.0), Some(19.0), Some(19.0))
        );
        assert!(bounds[1][2].as_f64().unwrap() <= most, "{bounds:?}");
        f.run(&format!("convert {input} -o o.ply --force {flag}")).code(0);
        assert_eq!(f.run("info o.ply --json").code(0).json()["splats"], 400);
        f.run(&format!("convert {input} -o o.copc.laz --force {flag}")).code(0);
        let facts = f.run("info o.copc.laz --json").code(0).json();
        assert_eq!((&facts["points"], &facts["bounds"][1][0]), (&400.into(), &19.0.into()), "{facts}");
        f.run(&format!("{input} -o o.png --size 16x16 --backend cpu --force {flag}")).code(0);
        if cfg!(feature = "ortho") {
            f.run(&format!("ortho {input} --gsd 1 -o o.tif --force --backend cpu {flag}")).code(0);
        }
        let columns = flag.trim_start_matches("--columns ");
        let convert = format!("\"{input}\", \"convert\": {{\"columns\": \"{columns}\"}}");
        f.write("o.json", scene("").replace("\"a.ply\"", &convert));
        assert_eq!(f.run("o.json --stats --backend cpu").code(0).json()["splats"], 400);
        let printed = f.run(&format!("render {input} --print-scene {flag}")).code(0).json();
        assert_eq!(printed["objects"][0]["convert"]["columns"], columns);
    }
    // Errors of the flag itself, and of its use.
    for (flag, code, says) in [
        ("--columns a,b,c", 2, "no position"),
        ("--columns f3:x,y,z", 2, "the type 'f3'"),
        ("--columns x,y,z", 3, "has 5 columns and --columns names 3 columns"),
    ] {
        let run = f.run(&format!("info t.txt {flag}")).code(code);
        assert!(run.stderr().contains(says), "{}", run.stderr());
    }
    f.write("s.json", scene("").replace("\"a.ply\"", "\"t.txt\", \"convert\": {\"columns\": \"x,y\"}"));
    assert!(f.run("s.json --stats").code(3).stderr().contains("too few columns"));
    let run = f.run("info o.ply --columns x,y,z").code(0);
    assert!(run.stderr().contains("--columns has no effect"), "{}", run.stderr());
    assert!(f.run("render --help").code(0).stdout().contains("--columns <NAME,...>"));
}
