//! `cargo xtask test`: runs all test suites, and summarises the output of cargo and the test harness.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::python::Tested;
use crate::vulkan::Verdict;
use crate::{FEATURES, cargo_for_tests, front_page, gpu_kit, page, python, required, vulkan, web};

/// Rule for skipping the tests of GPU backends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Gpu {
    /// The tests may be skipped if there is no Vulkan driver.
    IfPresent,
    /// The tests may not be skipped.
    Required,
}

pub(crate) fn run(root: &Path, gpu: Gpu, full: bool) -> bool {
    let driver = vulkan::prepare(root);
    if let Err(problem) = &driver {
        eprintln!("error: {problem}");
    }
    let program_ok = !full || checks_default_program(root);
    let must_run = must_run(gpu, driver.as_ref().ok());
    let (summary, exit_ok) = match run_cargo(root, must_run, full) {
        Ok(result) => result,
        Err(error) => {
            eprintln!("error: could not run cargo test: {error}");
            return false;
        }
    };
    let python = timed(|| python::test(root, full));
    let page = timed(|| page::test(root, full));
    let web = timed(|| web::test(root, full));
    // Like the GPU tests, the kit's script needs a Vulkan driver.
    let has_driver = matches!(driver, Ok(Verdict::Validated | Verdict::Unvalidated(_)));
    let kit_ok = !full || !has_driver || gpu_kit::test(root);
    let front_page_ok = !full || front_page::test(root);
    let total = summary.total();
    println!("\n== tests");
    if let Some(build) = &summary.build {
        println!("build: {build}");
    }
    for suite in &summary.suites {
        println!("{}", suite.line());
    }
    match &driver {
        Ok(Verdict::Unvalidated(reason)) => println!("vulkan: GPU tests ran without validation ({reason})"),
        Ok(Verdict::Skipped(reason)) => println!("vulkan: tests that need it are skipped ({reason})"),
        Ok(Verdict::Validated) | Err(_) => (),
    }
    let python_ok = told("Python package", &python, "python");
    let page_ok = told("page of surfel view", &page, "page");
    let web_ok = told("drawing module of exported pages", &web, "web");
    if full {
        let verdict = match (has_driver, kit_ok) {
            (false, _) => "skipped, no Vulkan",
            (true, true) => "ok",
            (true, false) => "FAILED, see above",
        };
        println!("GPU kit: {verdict}");
    }
    if !program_ok {
        println!("program with default features: FAILED, see above");
    }
    if !exit_ok && total.failed == 0 {
        println!("cargo test failed before or between the suites, see above");
    }
    println!("{} passed, {} failed, {} skipped", total.passed, total.failed, total.skipped);
    exit_ok
        && program_ok
        && python_ok
        && page_ok
        && web_ok
        && kit_ok
        && front_page_ok
        && total.failed == 0
        && driver.is_ok()
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    (work(), start.elapsed())
}

/// Prints the result of a test. Returns false if it failed, or if it was skipped although the environment forbids that.
fn told(what: &str, (tested, time): &(Tested, Duration), requirement: &str) -> bool {
    match tested {
        Tested::Passed => println!("{what}: ok, {:.0} s", time.as_secs_f64()),
        Tested::Failed => println!("{what}: FAILED, see above"),
        Tested::Skipped(why) => println!("{what}: skipped, {why}"),
    }
    match tested {
        Tested::Skipped(_) => !required(requirement),
        tested => *tested == Tested::Passed,
    }
}

/// Checks that the program compiles with default features only, as README.md's first command compiles it. The features
/// of the tests enable features of dependencies that this build doesn't have.
fn checks_default_program(root: &Path) -> bool {
    let mut command = cargo_for_tests(root);
    command.args(["check", "--package", "surfel-cli", "--locked", "--quiet"]);
    command.status().is_ok_and(|status| status.success())
}

/// Returns the tests that may not be skipped, in the format of `SURFEL_REQUIRE`.
fn must_run(gpu: Gpu, vulkan: Option<&Verdict>) -> &'static str {
    match (vulkan, gpu) {
        (Some(Verdict::Validated), _) => "wgpu,ash,validation",
        (Some(Verdict::Unvalidated(_)), _) | (_, Gpu::Required) => "wgpu,ash",
        _ => "",
    }
}

/// Runs all tests, and prints their output. The returned flag is true if cargo succeeded.
fn run_cargo(root: &Path, must_run: &str, full: bool) -> std::io::Result<(Summary, bool)> {
    // Both streams share a pipe, because cargo names a suite on stderr before the suite reports on stdout.
    let (reader, writer) = std::io::pipe()?;
    let mut command = cargo_for_tests(root);
    command.args(["test", "--workspace", "--features", FEATURES, "--locked", "--no-fail-fast"]);
    // This package has no tests, and its dependency criterion takes 20 CPU-seconds to compile.
    command.args(["--exclude", "surfel-benches"]);
    // A test whose data is missing prints a line and passes; `--show-output` shows this line.
    command.args(["--", "--show-output"]);
    if full {
        // Ignored tests take minutes on a software driver.
        command.arg("--include-ignored");
    }
    // Mesa's software driver compiles 700 shaders for small images. Without LLVM's optimisations, the tests take a
    // fifth less time.
    if std::env::var_os("GALLIVM_PERF").is_none() {
        command.env("GALLIVM_PERF", "nopt");
    }
    let asked = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
    command.env("SURFEL_REQUIRE", format!("{asked},{must_run}"));
    command.stdout(writer.try_clone()?).stderr(writer);
    let mut child = command.spawn()?;
    // The command has the writing ends of the pipe. It is dropped, because the pipe would never end otherwise.
    drop(command);
    let summary = Summary::read(reader, &packages(root), &mut std::io::stdout())?;
    Ok((summary, child.wait()?.success()))
}

/// Returns the folders of the workspace's packages, by package name.
fn packages(root: &Path) -> Vec<(String, PathBuf)> {
    let crates = std::fs::read_dir(root.join("crates")).into_iter().flatten().flatten().map(|entry| entry.path());
    let folders = crates.chain(std::fs::read_dir(root).into_iter().flatten().flatten().map(|entry| entry.path()));
    let mut named: Vec<_> =
        folders.filter_map(|folder| Some((crate::tidy::package_name(&folder.join("Cargo.toml"))?, folder))).collect();
    named.sort();
    named
}

/// Numbers of tests of a suite by result.
#[derive(Clone, Debug, Default, PartialEq)]
struct Suite {
    name: String,
    passed: usize,
    failed: usize,
    /// Number of ignored tests and of tests that passed only because their data was missing.
    skipped: usize,
    /// Time of the suite's tests.
    seconds: f64,
    /// True if the suite ended with a report; otherwise it counts as failed.
    reported: bool,
}

impl Suite {
    fn line(&self) -> String {
        let Self { name, passed, failed, skipped, seconds, .. } = self;
        let verdict = match (self.reported, failed) {
            (false, _) => "FAILED (ended without a report)",
            (true, 0) => "ok",
            _ => "FAILED",
        };
        format!("{name}: {verdict}, {passed} passed, {failed} failed, {skipped} skipped, {seconds:.0} s")
    }
}

#[derive(Debug, Default)]
struct Summary {
    suites: Vec<Suite>,
    /// Cargo's line about the build, which ends in the build's time.
    build: Option<String>,
}

impl Summary {
    /// Parses the output of `cargo test`, and copies it to `echo`.
    fn read(output: impl Read, packages: &[(String, PathBuf)], echo: &mut dyn Write) -> std::io::Result<Self> {
        let mut parser =
            Parser { packages, summary: Self::default(), package: None, excuse: CapturedOutput::Outside, excuses: 0 };
        let mut output = BufReader::new(output);
        let mut line = Vec::new();
        while output.read_until(b'\n', &mut line)? > 0 {
            echo.write_all(&line)?;
            parser.line(String::from_utf8_lossy(&line).trim());
            line.clear();
        }
        let mut summary = parser.summary;
        for suite in summary.suites.iter_mut().filter(|suite| !suite.reported) {
            suite.failed += 1;
        }
        Ok(summary)
    }

    fn total(&self) -> Suite {
        self.suites.iter().fold(Suite::default(), |sum, suite| Suite {
            passed: sum.passed + suite.passed,
            failed: sum.failed + suite.failed,
            skipped: sum.skipped + suite.skipped,
            ..sum
        })
    }
}

/// Position of the parser within the captured output of passed tests. A test whose data is missing prints a line that
/// begins with `skip`, its excuse.
#[derive(PartialEq)]
enum CapturedOutput {
    /// Outside of the output of any test.
    Outside,
    /// In the output of a test without an excuse so far.
    InBlock,
    /// In the output of a test whose excuse was counted.
    Counted,
}

struct Parser<'a> {
    packages: &'a [(String, PathBuf)],
    summary: Summary,
    /// Package of the most recent unit-test suite. Cargo doesn't print the package of an integration-test suite, so
    /// this package is tried first as its owner.
    package: Option<String>,
    /// Position within the captured output of passed tests.
    excuse: CapturedOutput,
    /// Number of excuses that the current suite's tests printed.
    excuses: usize,
}

impl Parser<'_> {
    fn line(&mut self, line: &str) {
        if let Some(suite) = line.strip_prefix("Running ").and_then(|rest| self.suite_name(rest)) {
            self.start(suite);
        } else if let Some(package) = line.strip_prefix("Doc-tests ") {
            self.start(format!("{package} doc tests"));
        } else if let Some(build) = line.strip_prefix("Finished ") {
            self.summary.build.get_or_insert_with(|| build.to_owned());
        } else if let Some(counts) = line.strip_prefix("test result: ") {
            self.finish(counts);
        } else if line.starts_with("---- ") && line.ends_with(" stdout ----") {
            self.excuse = CapturedOutput::InBlock;
        } else if line == "successes:" || line == "failures:" {
            self.excuse = CapturedOutput::Outside;
        } else if self.excuse == CapturedOutput::InBlock
            && line.get(..4).is_some_and(|s| s.eq_ignore_ascii_case("skip"))
        {
            self.excuse = CapturedOutput::Counted;
            self.excuses += 1;
        }
    }

    fn start(&mut self, name: String) {
        self.excuse = CapturedOutput::Outside;
        self.excuses = 0;
        self.summary.suites.push(Suite { name, ..Suite::default() });
    }

    /// Parses a suite's summary, such as `ok. 3 passed; 0 failed; 1 ignored; ...`.
    fn finish(&mut self, counts: &str) {
        let count = |what: &str| {
            let clause = counts.split(['.', ';']).map(str::trim).find_map(|clause| clause.strip_suffix(what));
            clause.and_then(|n| n.trim().parse::<usize>().ok()).unwrap_or(0)
        };
        let (passed, failed, ignored) = (count("passed"), count("failed"), count("ignored"));
        let seconds =
            counts.split_once("finished in ").and_then(|(_, time)| time.strip_suffix('s')?.parse::<f64>().ok());
        // A crate's doc tests may report twice (merged and standalone); the counts are added.
        let Some(suite) = self.summary.suites.last_mut() else { return };
        let excused = self.excuses.min(passed);
        suite.passed += passed - excused;
        suite.failed += failed;
        suite.skipped += ignored + excused;
        suite.seconds += seconds.unwrap_or(0.0);
        suite.reported = true;
        (self.excuse, self.excuses) = (CapturedOutput::Outside, 0);
    }

    /// Returns the name of a suite, such as `surfel-math unit tests of src/lib.rs`. `rest` has the form `unittests
    /// src/lib.rs (target/debug/deps/surfel_math-0123)`. Integration tests have their file's path in place of the first
    /// two words. `None` if nothing is in parentheses.
    fn suite_name(&mut self, rest: &str) -> Option<String> {
        let (source, binary) = rest.split_once(" (")?;
        let source = source.replace('\\', "/");
        let stem = Path::new(binary.trim_end_matches(')')).file_stem()?.to_str()?;
        let target = stem.rsplit_once('-').map_or(stem, |(target, _hash)| target).replace('_', "-");
        if let Some(main) = source.strip_prefix("unittests ") {
            let package = self.packages.iter().map(|(name, _)| name).find(|name| **name == target);
            self.package = package.cloned().or_else(|| self.package.take());
            return Some(format!("{target} unit tests of {main}"));
        }
        // Cargo doesn't print the package of a suite. It runs one package after another, so the package of the previous
        // suite is tried first.
        let has_it = |(_, folder): &&(String, PathBuf)| folder.join(&source).is_file();
        let mut owners = self.packages.iter().filter(has_it).map(|(name, _)| name.as_str());
        let last = self.package.as_deref();
        let owner = owners.clone().find(|name| Some(*name) == last).or_else(|| owners.next());
        Some(owner.map_or_else(|| source.clone(), |owner| format!("{owner} {source}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validation_is_required_where_its_layer_is() {
        let reason = String::new;
        let verdicts = [None, Some(Verdict::Skipped(reason())), Some(Verdict::Unvalidated(reason()))];
        assert_eq!(verdicts.each_ref().map(|v| must_run(Gpu::IfPresent, v.as_ref())), ["", "", "wgpu,ash"]);
        assert_eq!(verdicts.each_ref().map(|v| must_run(Gpu::Required, v.as_ref())), ["wgpu,ash"; 3]);
        assert_eq!(must_run(Gpu::IfPresent, Some(&Verdict::Validated)), "wgpu,ash,validation");
    }

    fn summary(output: &str) -> Summary {
        let packages = [("xtask".to_string(), crate::workspace_root().join("xtask"))];
        Summary::read(output.as_bytes(), &packages, &mut Vec::new()).unwrap()
    }

    #[test]
    fn summary_names_suites_and_adds_up() {
        let s = summary(
            "   Compiling xtask v0.1.0\n    Finished `test` profile [optimized] target(s) in 2m 05s\n     \
             Running unittests src/main.rs (target/debug/deps/xtask-01ab)\n\
             running 3 tests\ntest result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in \
             1.6s\n Running tests/dependencies.rs (target/debug/deps/dependencies-23cd)\n\
             test result: FAILED. 1 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out; finished in 75s\n\
             Doc-tests xtask\ntest result: ok. 0 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out\n",
        );
        let lines: Vec<_> = s.suites.iter().map(Suite::line).collect();
        assert_eq!(
            lines,
            [
                "xtask unit tests of src/main.rs: ok, 3 passed, 0 failed, 1 skipped, 2 s",
                "xtask tests/dependencies.rs: FAILED, 1 passed, 2 failed, 0 skipped, 75 s",
                "xtask doc tests: ok, 0 passed, 0 failed, 0 skipped, 0 s",
            ]
        );
        assert_eq!(s.build.as_deref(), Some("`test` profile [optimized] target(s) in 2m 05s"));
        let total = s.total();
        assert_eq!((total.passed, total.failed, total.skipped), (4, 2, 1));
    }

    #[test]
    fn summary_counts_a_passed_test_that_says_it_skipped_once() {
        let s = summary(
            "Running tests/a.rs (target/debug/deps/a-1)\ntest one ... ok\n\nsuccesses:\n\n\
             ---- one stdout ----\nskipped: no models\nskipped: nothing at all\n\n\
             ---- two stdout ----\nread 5 models\n\nsuccesses:\n    skipper\n    two\n\n\
             test result: ok. 2 passed; 0 failed; 0 ignored; 0 measured\n",
        );
        assert_eq!((s.total().passed, s.total().skipped), (1, 1));
    }

    #[test]
    fn summary_fails_a_suite_that_dies() {
        let s = summary(
            "Running tests/a.rs (target/debug/deps/a-1)\nrunning 2 tests\nerror: test failed\n\
             Running tests/b.rs (target/debug/deps/b-1)\ntest result: ok. 1 passed; 0 failed; 0 ignored\n",
        );
        assert_eq!((s.total().passed, s.total().failed), (1, 1));
        assert!(s.suites[0].line().contains("without a report"));
    }
}
