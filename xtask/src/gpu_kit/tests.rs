use super::*;

/// Kit of mock programs, in a folder that is removed when the value is dropped.
struct Pretended(PathBuf);

/// Shell script that replaces the kit's programs. For frames, it appends one complete and one incomplete line to the
/// results. It hangs on the backend that `PRETENDED_HANG` names. It finds a GPU once the driver that `PRETENDED_DRIVER`
/// names is selected.
const PROGRAM: &str = r#"#!/bin/sh
case "$*" in *--help*) exit 0 ;; esac
while [ $# -gt 0 ]; do
    case $1 in
    devices) devices=yes ;;
    frames) backend=$2 ;;
    --out) out=$2 ;;
    esac
    shift
done
if [ -n "$devices" ]; then
    grep -q "$PRETENDED_DRIVER" "${VK_DRIVER_FILES:-/dev/null}" && exit 0
    exit 3
fi
[ -n "$backend" ] && printf '{"kind":"frame"}\n{"kind":"cut' >>"$out/results.jsonl"
[ "$backend" = "$PRETENDED_HANG" ] && exec sleep 60
exit 0
"#;

impl Pretended {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("surfel-kit-{name}-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("lib")).unwrap();
        for (name, text) in [("run.sh", SCRIPT), ("gpu-kit", PROGRAM), ("surfel", "#!/bin/sh\n")] {
            write(&folder.join(name), text).unwrap();
            executable(&folder.join(name)).unwrap();
        }
        write(&folder.join("kit.json"), "{\"kind\":\"kit\",\"commit\":\"abc\",\"glibc\":\"2.17\"}\n").unwrap();
        write(&folder.join("lib/libEGL_nvidia.so.0"), "").unwrap();
        Self(folder)
    }

    /// Runs the script in an empty environment, and returns its exit code, results and log.
    fn run(&self, variables: &[(&str, &str)]) -> (Option<i32>, String, String) {
        let mut script = Command::new(self.0.join("run.sh"));
        script.arg(self.0.join("out")).env_clear().env("PATH", "/usr/bin:/bin").envs(variables.iter().copied());
        let code = script.output().unwrap().status.code();
        let read = |name: &str| std::fs::read_to_string(self.0.join("out").join(name)).unwrap();
        (code, read("results.jsonl"), read("log.txt"))
    }
}

impl Drop for Pretended {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
#[cfg(target_os = "linux")]
fn script_stops_a_step_that_hangs_keeps_its_lines_and_ends_in_time() {
    let kit = Pretended::new("hang");
    let (code, results, log) =
        kit.run(&[("PRETENDED_DRIVER", "none"), ("PRETENDED_HANG", "ash"), ("SURFEL_KIT_SECONDS", "2")]);
    assert_eq!(code, Some(1), "{log}");
    let lines: Vec<&str> = results.lines().collect();
    let at = lines.iter().position(|line| *line == "{\"kind\":\"frame\"}").unwrap();
    // The killed program's incomplete line ends before the next line begins.
    assert_eq!(lines[at + 1], "{\"kind\":\"cut");
    assert!(lines[at + 2].contains("frames on ash") && lines[at + 2].contains("FAILED: stopped after"), "{results}");
    assert!(
        results.contains("\"frames on wgpu\",\"seconds\":0,\"outcome\":\"FAILED: left out, the time is over"),
        "{results}"
    );
    assert!(results.contains("missing: a GPU") && log.contains("missing: a GPU"), "{results}");
    assert!(kit.run(&[]).0 == Some(2), "a folder with results is refused");
}

#[test]
#[cfg(target_os = "linux")]
fn script_names_a_driver_that_is_there_without_its_file() {
    let kit = Pretended::new("driver");
    let folder = kit.0.join("lib").to_string_lossy().into_owned();
    let variables = [("PRETENDED_DRIVER", "libEGL_nvidia"), ("PRETENDED_HANG", "none"), ("LD_LIBRARY_PATH", &folder)];
    let (code, results, log) = kit.run(&variables);
    assert_eq!(code, Some(0), "{log}");
    assert!(results.contains("libEGL_nvidia.so.0, for which") && !results.contains("missing: a GPU"), "{results}");
    assert!(results.contains("\"name\":\"frames on cpu\""), "{results}");
}

#[test]
fn least_glibc_is_the_greatest_version_that_is_named() {
    assert_eq!(least_glibc(b"..GLIBC_2.2.5\0GLIBC_2.17\0x\0GLIBC_2.9\0"), [2, 17]);
    assert_eq!(least_glibc(b"GLIBC_2.34"), [2, 34]);
    assert_eq!(least_glibc(b"GLIBC_PRIVATE\0"), [0, 0]);
    assert_eq!(least_glibc(b"no library"), [0, 0]);
}

#[test]
fn problems_name_what_a_run_lacks_and_a_page_that_claims_too_much() {
    let kinds = ["kit", "machine", "device", "conformance", "probe", "step"];
    let mut results: Vec<String> = kinds.iter().map(|kind| format!("{{\"kind\":\"{kind}\"}}")).collect();
    for backend in ["ash", "wgpu", "cpu"] {
        let is_software = backend != "cpu";
        results.push(format!("{{\"kind\":\"frame\",\"backend\":\"{backend}\",\"is_software\":{is_software}}}"));
    }
    let sections = "## Devices ## Conformance ## Frames ## Passes ## Probes ## Repeated frames";
    let page = format!("{NOT_MEASURED} {sections}");
    assert_eq!(problems(&results.join("\n"), &page), [""; 0]);
    assert_eq!(problems(&results.join("\n"), sections).len(), 1);
    let on_gpu = results.join("\n").replace("\"ash\",\"is_software\":true", "\"ash\",\"is_software\":false");
    assert_eq!(problems(&on_gpu, &page).len(), 1);
    assert_eq!(problems(&on_gpu, sections), [""; 0]);
    let without = results[..5].join("\n");
    let problems = problems(&without, &page);
    assert!(problems.iter().any(|problem| problem.contains("kind step")), "{problems:?}");
    assert!(problems.iter().any(|problem| problem.contains("no frame on ash")), "{problems:?}");
}
