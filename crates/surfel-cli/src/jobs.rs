//! `surfel jobs`: prints a job for an existing job system. The job's tasks run `surfel` with `--shard` or `--tile`.
//!
//! Tasks run in the folder in which the job was created, so that relative paths keep their meaning; workers must share
//! it. Job files that are usually YAML are written as JSON, a subset of YAML, so that no name is mistaken for syntax.

use crate::args::{self, Command, JobsArgs, command};
use crate::console::Console;
use crate::convert;
use crate::failure::Failure;
use crate::parse::{default_color_bar_path, join_values};
use crate::pieces;
use crate::stdin::is_stdin;
use crate::stdout;
use serde_json::json;
use std::ffi::OsString;
use std::path::Path;
use surfel_app::camera;
use surfel_app::request::{self, Source, SplatOptions};
use surfel_app::save_color_bar;
use surfel_io::ShowPath as _;
use surfel_load::levels;

/// Default number of tasks into which a job is divided.
const TASKS: usize = 64;
/// Placeholder for a task's number in [`Job`], which is replaced by the syntax of each job system. It consists of
/// private-use characters, which JSON doesn't escape.
const TASK: &str = "\u{e000}TASK\u{e000}";

pub(crate) fn run(args: &JobsArgs, console: &Console) -> Result<(), Failure> {
    let folder = std::env::current_dir().map_err(|e| Failure::other(format!("there is no current folder: {e}")))?;
    let folder = folder.to_str().ok_or_else(|| Failure::usage("the name of the current folder is not UTF-8"))?;
    let job = Job::of(args, folder, console)?;
    let engine = args.engine;
    let text = if engine.openjd {
        job.openjd()?
    } else if engine.slurm {
        job.slurm()
    } else if engine.k8s {
        job.k8s(&args.image)
    } else if engine.cuecmd {
        job.cuecmd()?
    } else {
        job.snakemake()?
    };
    console.note(&format!("{} by {} tasks in {folder}", job.what, job.tasks));
    match &job.pieces {
        Some(pieces) if engine.cuecmd => {
            console.note(&format!("when all tasks are done: {}", shell(&pieces.join)));
        }
        Some(_) if engine.slurm => console.note("bash, not sbatch, runs the script: it submits two jobs"),
        _ => {}
    }
    stdout::result(text.as_bytes())
}

/// Description of a job, independent of the job system that runs it.
#[derive(Debug)]
struct Job {
    name: String,
    folder: String,
    /// Description of the job's result, such as the number of images, for messages.
    what: String,
    tasks: usize,
    /// Words of the command line of a task, with [`TASK`] for the task's number.
    words: Vec<String>,
    /// Files that the tasks write, one each, if a last step merges them; `None` if the tasks' files are the result.
    pieces: Option<TaskFiles>,
}

/// Files that the tasks of a job write, and the last step that merges them.
#[derive(Debug)]
struct TaskFiles {
    /// Name of the file of a task, with [`TASK`] for the task's number.
    name: String,
    /// Names of the files of all tasks.
    files: Vec<String>,
    /// Name of the merging step, which job systems show.
    step: &'static str,
    /// Words of the command line of the merging step.
    join: Vec<String>,
    /// Name of the merged file.
    whole: String,
}

impl TaskFiles {
    /// Creates the description of `count` files. `name` contains `placeholder` for the number of a file. `step` is the
    /// name of the merging step, and `whole` the name of the merged file.
    fn new([name, placeholder]: [&str; 2], count: usize, step: &'static str, whole: &str) -> Self {
        let files: Vec<String> = (0..count).map(|i| name.replace(placeholder, &format!("{i:04}"))).collect();
        let command = if step == "stitch" { "stitch" } else { "convert" };
        let words = ["surfel", command].map(str::to_owned).into_iter();
        let join = words.chain([format!("--output={whole}"), "--".to_owned()]).chain(files.iter().cloned()).collect();
        Self { name: name.replace(placeholder, TASK), files, step, join, whole: whole.to_owned() }
    }
}

impl Job {
    fn of(args: &JobsArgs, folder: &str, console: &Console) -> Result<Self, Failure> {
        let inputs: Vec<String> = args.inputs.iter().map(|path| text_of(path)).collect::<Result<_, _>>()?;
        let is_conversion = args.output.as_deref().is_some_and(levels::is_copc);
        let named_by = if is_conversion { args.output.as_ref() } else { args.inputs.first() };
        let stem = named_by.and_then(|path| path.file_stem()).unwrap_or_default().to_string_lossy();
        let stem = stem.strip_suffix(".copc").unwrap_or(&stem);
        let plain: String =
            stem.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
        let plain = plain.trim_matches('-').chars().take(40).collect::<String>();
        let name = format!("surfel-{plain}").trim_end_matches('-').to_owned();
        let folder = folder.to_owned();
        let job = Self { name, folder, what: String::new(), tasks: 0, words: Vec::new(), pieces: None };
        if is_conversion { job.conversion_job(args, inputs) } else { job.image_job(args, inputs, console) }
    }

    fn image_job(self, args: &JobsArgs, inputs: Vec<String>, console: &Console) -> Result<Self, Failure> {
        let default = match (args.cameras.is_some(), args.frames.is_some()) {
            (true, _) => "{name}.png",
            (_, true) => "{frame}.png",
            _ => "whole.png",
        };
        let output = args.output.as_deref().map_or_else(|| Ok(default.to_owned()), text_of)?;
        let apart = inputs.len() > 1 && output.contains("{input}");
        let mut words: Vec<String> = ["surfel", "render"].map(str::to_owned).into();
        words.extend(flags_with_range(args, &output, apart, console)?);
        if let Some(frames) = args.frames {
            words.extend(["--turntable".to_owned(), format!("--frames={frames}")]);
        }
        if let Some(cameras) = &args.cameras {
            words.push(format!("--cameras={}", text_of(cameras)?));
        }
        if let Some(range) = args.frame_range {
            words.push(format!("--frame-range={range}"));
        }
        words.push("--skip-existing".to_owned());
        let frames = args.frames.map(|frames| frames as usize);
        let cameras = args.cameras.as_ref().map(|path| camera::named(path, None)).transpose()?;
        let of_input = cameras.map(|cameras| cameras.len()).or(frames).unwrap_or(1);
        let of_input = match args.frame_range {
            Some(range) => range.checked(of_input).map_err(Failure::usage)?.count(),
            None => of_input,
        };
        let pictures = args.tiles.map_or(of_input * if apart { inputs.len() } else { 1 }, |tiles| tiles as usize);
        let (tasks, pieces) = match args.tiles {
            Some(tiles) => {
                let name = tile_name(&output);
                words.extend([format!("--tile={TASK}/{tiles}"), format!("--output={name}")]);
                (tiles as usize, Some(TaskFiles::new([&name, "{tile}"], tiles as usize, "stitch", &output)))
            }
            None => {
                let tasks = args.tasks.map_or(TASKS, |tasks| tasks as usize).min(pictures);
                words.extend([format!("--shard={TASK}/{tasks}"), format!("--output={output}")]);
                (tasks, None)
            }
        };
        words.push("--".to_owned());
        words.extend(inputs);
        check(&words, args)?;
        Ok(Self { what: format!("{pictures} pictures"), tasks, words, pieces, ..self })
    }

    /// Creates the job that converts points to a COPC file in shards.
    fn conversion_job(self, args: &JobsArgs, inputs: Vec<String>) -> Result<Self, Failure> {
        let output = args.output.as_deref().map_or_else(|| Ok(String::new()), text_of)?;
        let is_of_pictures = args.frames.is_some() || args.cameras.is_some() || args.tiles.is_some();
        if is_of_pictures || args.frame_range.is_some() {
            let what = "is no picture: expected no --frames, --frame-range, --cameras or --tiles";
            return Err(Failure::usage(format!("-o {output}: {what}")));
        }
        let tasks = args.tasks.map_or(TASKS, |tasks| tasks as usize);
        let stem = output.get(..output.len() - ".copc.laz".len()).unwrap_or_default();
        let name = format!("{stem}.{{shard}}.shard");
        let mut words: Vec<String> = ["surfel", "convert"].map(str::to_owned).into();
        words.extend(args.flags.iter().cloned());
        let own = ["--resume".to_owned(), format!("--shard={TASK}/{tasks}"), format!("--output={name}")];
        words.extend(own.into_iter().chain(["--".to_owned()]));
        let what = format!("{} inputs", inputs.len());
        words.extend(inputs);
        let Command::Convert(parsed) = parsed(&words)? else {
            return Err(Failure::usage("flags after -- are those of surfel convert"));
        };
        if parsed.force {
            return Err(Failure::usage("tasks go on with what is there: expected no --force; delete what is old"));
        }
        convert::check(&parsed)?;
        let pieces = Some(TaskFiles::new([&name, "{shard}"], tasks, "merge", &output));
        Ok(Self { what, tasks, words, pieces, ..self })
    }

    /// Returns a shell command line that runs `words` in the job's folder. `task` replaces the task's number, without
    /// quotes.
    fn shell(&self, words: &[String], task: &str) -> String {
        format!("cd {} && {}", quote(&self.folder), shell(words).replace(TASK, task))
    }

    /// Returns the job as a template of OpenJD, in JSON:
    /// <https://github.com/OpenJobDescription/openjd-specifications/wiki/2023-09-Template-Schemas>
    fn openjd(&self) -> Result<String, Failure> {
        let run = |script: String| {
            // OpenJD has no escape for its own brackets.
            if script.replace(OPENJD_TASK, "").contains("{{") {
                return Err(Failure::usage("OpenJD can't hold {{ in a name or a flag: rename the file"));
            }
            let script = line(script)?;
            Ok(json!({ "actions": { "onRun": { "command": "bash", "args": ["-c", script] } } }))
        };
        let first = if self.is_conversion() { "convert" } else { "render" };
        let mut steps = vec![json!({
            "name": first,
            "parameterSpace": { "taskParameterDefinitions": [
                { "name": "Task", "type": "INT", "range": format!("0-{}", self.tasks - 1) }
            ] },
            "script": run(self.shell(&self.words, OPENJD_TASK))?,
        })];
        if let Some(TaskFiles { step, join, .. }) = &self.pieces {
            steps.push(json!({
                "name": step,
                "dependencies": [{ "dependsOn": first }],
                "script": run(self.shell(join, ""))?,
            }));
        }
        Ok(pretty(&json!({ "specificationVersion": "jobtemplate-2023-09", "name": self.name, "steps": steps })))
    }

    fn is_conversion(&self) -> bool {
        self.pieces.as_ref().is_some_and(|pieces| pieces.step == "merge")
    }

    fn slurm(&self) -> String {
        let last = self.tasks - 1;
        let mut text = format!("#!/bin/bash\n#SBATCH --job-name={}\n#SBATCH --array=0-{last}\nset -eu\n", self.name);
        if let Some(TaskFiles { step, join, .. }) = &self.pieces {
            // The task's command is written to a script, because an argument may not exceed 128 KiB.
            text += &format!(
                "if [ -z \"${{SLURM_ARRAY_TASK_ID-}}\" ]; then\n  # Run by bash: the array, and then what needs all of \
                 it.\n  array=$(sbatch --parsable \"$0\")\n  exec sbatch --job-name={}-{step} \
                 --dependency=\"afterok:${{array%%;*}}\" <<'END OF {step}'\n#!/bin/bash\n{}\nEND OF {step}\nfi\n",
                self.name,
                self.shell(join, "")
            );
        }
        text + &self.shell(&self.words, "\"$SLURM_ARRAY_TASK_ID\"") + "\n"
    }

    /// Returns the job as a Kubernetes Job, in JSON:
    /// <https://kubernetes.io/docs/reference/kubernetes-api/workload-resources/job-v1/>
    fn k8s(&self, image: &str) -> String {
        let job = |name: &str, words: &[String], tasks: Option<usize>| {
            // In a container's command $(NAME) is replaced, and $$ means a dollar.
            let words = words.iter().map(|word| word.replace('$', "$$").replace(TASK, "$(JOB_COMPLETION_INDEX)"));
            let mut spec = json!({
                "template": { "spec": {
                    "restartPolicy": "Never",
                    "containers": [{
                        "name": "surfel",
                        "image": image,
                        "command": words.collect::<Vec<_>>(),
                        "workingDir": self.folder,
                        "volumeMounts": [{ "name": "data", "mountPath": self.folder }],
                    }],
                    "volumes": [{ "name": "data", "persistentVolumeClaim": { "claimName": "surfel-data" } }],
                } },
            });
            if let Some(tasks) = tasks {
                spec["completionMode"] = "Indexed".into();
                (spec["completions"], spec["parallelism"]) = (tasks.into(), tasks.into());
                spec["backoffLimitPerIndex"] = 3.into();
            }
            json!({ "apiVersion": "batch/v1", "kind": "Job", "metadata": { "name": name }, "spec": spec })
        };
        let tasks = job(&self.name, &self.words, Some(self.tasks));
        let Some(TaskFiles { step, join, files, .. }) = &self.pieces else { return pretty(&tasks) };
        // A Kubernetes job can't wait for another one. Files appear complete, so the merging job waits for the files.
        let command = &join[..join.len() - files.len()];
        let script = format!("for f do until [ -e \"$f\" ]; do sleep 5; done; done; exec {} \"$@\"", shell(command));
        let words = ["sh".to_owned(), "-c".to_owned(), script, "sh".to_owned()];
        let words: Vec<String> = words.into_iter().chain(files.iter().cloned()).collect();
        let last = job(&format!("{}-{step}", self.name), &words, None);
        pretty(&json!({ "apiVersion": "v1", "kind": "List", "items": [tasks, last] }))
    }

    fn cuecmd(&self) -> Result<String, Failure> {
        (0..self.tasks).map(|task| Ok(line(self.shell(&self.words, &task.to_string()))? + "\n")).collect()
    }

    fn snakemake(&self) -> Result<String, Failure> {
        let name = self.pieces.as_ref().map_or("", |pieces| &pieces.name);
        if [&self.folder, name].iter().any(|name| name.contains(['{', '}'])) {
            return Err(Failure::usage("Snakemake can't hold { or } in the name of a folder or a piece: rename it"));
        }
        // Python reads JSON strings; Snakemake replaces text in braces.
        let string = |text: &str| json!(text).to_string();
        let command = |words: &[String]| {
            let text = line(format!("cd {} && {}", quote(&self.folder), shell(words)))?;
            Ok::<_, Failure>(string(&text.replace('{', "{{").replace('}', "}}")).replace(TASK, "{wildcards.task}"))
        };
        let in_folder = |name: &str| Path::new(&self.folder).join(name).to_string_lossy().into_owned();
        let (output, done) = match &self.pieces {
            None => {
                let marker = in_folder(&format!(".{}-{{task}}.done", self.name));
                (format!("touch({})", string(&marker)), marker)
            }
            Some(pieces) => {
                let piece = in_folder(&pieces.name.replace(TASK, "{task}"));
                (string(&piece), piece)
            }
        };
        let number = |task| if self.pieces.is_some() { format!("{task:04}") } else { format!("{task}") };
        let tasks: Vec<String> = (0..self.tasks).map(number).collect();
        let all = format!("expand({}, task={})", string(&done), json!(tasks));
        let mut text = String::new();
        if let Some(TaskFiles { step, join, whole, .. }) = &self.pieces {
            let whole = string(&in_folder(whole));
            let rule = format!("rule {step}:\n    input: {all}\n    output: {whole}\n    shell: {}", command(join)?);
            text += &format!("rule all:\n    input: {whole}\n\n{rule}\n\n");
        } else {
            text += &format!("rule all:\n    input: {all}\n\n");
        }
        let first = if self.is_conversion() { "convert" } else { "render" };
        Ok(text + &format!("rule {first}:\n    output: {output}\n    shell: {}\n", command(&self.words)?))
    }
}

/// Placeholder for a task's number in OpenJD.
const OPENJD_TASK: &str = "{{Task.Param.Task}}";
/// Limit of the length, in bytes, of a command that a job system passes as one word; commands must be shorter. Linux
/// allows 128 KiB including the terminating zero.
const MAX_COMMAND_BYTES: usize = 128 * 1024 - 1;

/// Returns an error if a command is too long for a job system that passes it to a shell as one word.
fn line(command: String) -> Result<String, Failure> {
    if command.len() < MAX_COMMAND_BYTES {
        return Ok(command);
    }
    let what = format!("a task's command has {} bytes, expected fewer than {MAX_COMMAND_BYTES}", command.len());
    Err(Failure::usage(format!("{what}\n  help: fewer files, shorter names, or --slurm, whose scripts are files")))
}

/// Returns the name of a file that tasks read or write. Refuses stdin and names that aren't UTF-8.
fn text_of(path: &Path) -> Result<String, Failure> {
    if is_stdin(path) {
        return Err(Failure::usage("-: a job's tasks have no stdin, expected a file"));
    }
    let not = || Failure::usage(format!("{}: its name is not UTF-8, which job files are", path.shown()));
    path.to_str().map(str::to_owned).ok_or_else(not)
}

/// Returns the output name with `{tile}` inserted before its extension, unless the name contains `{tile}` already.
fn tile_name(output: &str) -> String {
    if output.contains("{tile}") {
        return output.to_owned();
    }
    match output.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') => format!("{stem}.{{tile}}.{extension}"),
        _ => format!("{output}.{{tile}}"),
    }
}

/// Parses the command line of a task, because a parse error would occur in every task.
fn parsed(words: &[String]) -> Result<Command, Failure> {
    let words = words.iter().map(|word| word.replace(TASK, "0"));
    let wrong = |e: clap::Error| {
        let text = e.to_string();
        let line = text.lines().next().unwrap_or_default();
        Failure::usage(format!("tasks can't run so: {}", line.strip_prefix("error: ").unwrap_or(line)))
    };
    let matches = command().try_get_matches_from(words).map_err(wrong)?;
    Ok(args::parsed(&matches).map_err(wrong)?.command)
}

/// Refuses options of a job's tasks that every task would refuse, too, before the job is printed.
fn check(words: &[String], args: &JobsArgs) -> Result<(), Failure> {
    let Command::Render(render) = parsed(words)? else {
        return Err(Failure::usage("flags after -- are those of surfel render"));
    };
    let output = render.output.as_deref().unwrap_or(Path::new(""));
    let format = crate::output::Output::still(output, false, render.png16, render.exr_f32)?;
    for (several, names, placeholder) in [
        (args.frames.is_some_and(|n| n > 1), format.names_frames(), "{frame}"),
        (args.cameras.is_some(), format.names_cameras(), "{name}"),
    ] {
        if several && !names {
            let output = output.display();
            return Err(Failure::usage(format!("-o {output}: expected {placeholder} in the name, for several images")));
        }
    }
    if args.tiles.is_some() && format.format == crate::output::Format::Jpeg {
        return Err(Failure::usage("tiles are not JPEGs, whose samples change: expected -o in .png or .exr"));
    }
    pieces::check(&render, !format.is_stdout())
}

/// Returns the flags for all tasks. If the flags colour by an attribute without stating a range, and all images share
/// one range, the range over all inputs is added. Tasks then don't compute the range, and all use the same one. The
/// colour bar, if requested, is written here.
fn flags_with_range(args: &JobsArgs, output: &str, apart: bool, console: &Console) -> Result<Vec<String>, Failure> {
    let mut flags: Vec<OsString> = args.flags.iter().map(OsString::from).collect();
    join_values(&mut flags);
    let mut flags: Vec<String> = flags.into_iter().map(|flag| flag.to_string_lossy().into_owned()).collect();
    let words = ["surfel", "render"].map(str::to_owned).into_iter().chain(flags.iter().cloned());
    let words = words.chain([format!("--output={output}"), "--".to_owned(), "INPUT".to_owned()]);
    let Command::Render(render) = parsed(&words.collect::<Vec<_>>())? else { return Ok(flags) };
    let splats = &render.render.splats;
    let is_shared = splats.shared_range;
    if splats.convert.color_by.is_none() || splats.convert.range.is_some() || (apart && !is_shared) {
        return Ok(flags);
    }
    let of_each = || args.inputs.iter().map(|input| Source::of(std::slice::from_ref(input), None)).collect::<Vec<_>>();
    let sources = if apart { of_each() } else { vec![Source::of(&args.inputs, None)] };
    let progress = console.progress();
    let found = request::shared_coloring(sources, &render.render, None, &progress);
    drop(progress);
    let found = found.map_err(|error| {
        let failure = Failure::from(error);
        let help = "--range LO,HI says the range, so that no input is read here";
        Failure::with_code(failure.code(), format!("{}\n  help: {help}", failure.message()))
    })?;
    let Some(coloring) = found else { return Ok(flags) };
    let beside = render.names_colorbar.then(|| default_color_bar_path(Path::new(output)));
    if let Some(bar) = splats.colorbar.clone().or(beside) {
        save_color_bar(&bar, render.force, &coloring)?;
        console.note(&format!("{}: the colour bar of all tasks", bar.display()));
    }
    // The value of a flag may be a separate word.
    let is_range = |flag: &String| flag == "--range";
    while let Some(at) = flags.iter().position(is_range) {
        flags.drain(at..(at + 2).min(flags.len()));
    }
    flags.retain(|flag| !flag.starts_with("--range=") && flag != "--colorbar" && !flag.starts_with("--colorbar="));
    let mut fixed = SplatOptions::default();
    fixed.convert.colormap = splats.convert.colormap;
    fixed.set_coloring(coloring);
    if let Some([lo, hi]) = fixed.convert.range {
        flags.push(format!("--range={lo},{hi}"));
    }
    if let Some(map) = fixed.convert.colormap.filter(|_| splats.convert.colormap.is_none()) {
        flags.push(format!("--colormap={}", map.name()));
    }
    Ok(flags)
}

/// Quotes words for a POSIX shell.
fn shell(words: &[String]) -> String {
    words.iter().map(|word| quote(word)).collect::<Vec<_>>().join(" ")
}

fn quote(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=./,:%@+".contains(c);
    if !word.is_empty() && word.replace(TASK, "").chars().all(plain) {
        return word.to_owned();
    }
    // The placeholder of the task's number must be outside of quotes, where the shell expands a job system's variable.
    format!("'{}'", word.replace('\'', r"'\''").replace(TASK, &format!("'{TASK}'")))
}

fn pretty(value: &serde_json::Value) -> String {
    format!("{value:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(line: &str) -> Result<Job, Failure> {
        let matches = command().try_get_matches_from(line.split(' ')).unwrap();
        let Command::Jobs(args) = args::parsed(&matches).unwrap().command else { panic!("{line}") };
        Job::of(&args, "/data/my scans", &Console::new(true, false))
    }

    #[test]
    fn jobs_share_pictures_out_to_tasks() {
        let job = job("surfel jobs a.json --frames 100 --slurm --tasks 8 -o out/{frame}.png -- --preset fast").unwrap();
        assert_eq!((job.what.as_str(), job.tasks), ("100 pictures", 8));
        assert_eq!(
            job.slurm(),
            "#!/bin/bash\n#SBATCH --job-name=surfel-a\n#SBATCH --array=0-7\nset -eu\ncd '/data/my scans' && surfel \
             render --preset fast --turntable --frames=100 --skip-existing --shard=\"$SLURM_ARRAY_TASK_ID\"/8 \
             '--output=out/{frame}.png' -- a.json\n"
        );
        let cuecmd = job.cuecmd().unwrap();
        assert_eq!(cuecmd.lines().count(), 8);
        assert!(cuecmd.lines().nth(7).unwrap().contains("--shard=7/8 "));
        let k8s: serde_json::Value = serde_json::from_str(&job.k8s("registry/surfel:1")).unwrap();
        let container = &k8s["spec"]["template"]["spec"]["containers"][0];
        assert_eq!(k8s["spec"]["completions"], 8);
        assert_eq!(container["image"], "registry/surfel:1");
        assert!(container["command"].as_array().unwrap().contains(&json!("--shard=$(JOB_COMPLETION_INDEX)/8")));
        let openjd: serde_json::Value = serde_json::from_str(&job.openjd().unwrap()).unwrap();
        assert_eq!(openjd["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0]["range"], "0-7");
        assert!(openjd.to_string().contains("--shard={{Task.Param.Task}}/8"));
        assert_eq!(
            job.snakemake().unwrap(),
            "rule all:\n    input: expand(\"/data/my scans/.surfel-a-{task}.done\", \
             task=[\"0\",\"1\",\"2\",\"3\",\"4\",\"5\",\"6\",\"7\"])\n\nrule render:\n    output: touch(\"/data/my \
             scans/.surfel-a-{task}.done\")\n    shell: \"cd '/data/my scans' && surfel render --preset fast \
             --turntable --frames=100 --skip-existing --shard={wildcards.task}/8 '--output=out/{{frame}}.png' -- \
             a.json\"\n"
        );
    }

    #[test]
    fn tiles_are_put_together_by_a_step_of_their_own() {
        let job = job("surfel jobs a.json --tiles 3 --openjd -o whole.exr").unwrap();
        assert_eq!(job.pieces.as_ref().unwrap().files, ["whole.0000.exr", "whole.0001.exr", "whole.0002.exr"]);
        let openjd: serde_json::Value = serde_json::from_str(&job.openjd().unwrap()).unwrap();
        assert_eq!(openjd["steps"][1]["dependencies"][0]["dependsOn"], "render");
        let text = openjd.to_string();
        assert!(text.contains("--tile={{Task.Param.Task}}/3 '--output=whole.{tile}.exr'"), "{text}");
        assert!(text.contains("surfel stitch --output=whole.exr -- whole.0000.exr whole.0001.exr"), "{text}");
        assert!(job.snakemake().unwrap().contains("rule stitch:"));
    }

    #[test]
    fn conversions_are_shares_and_what_they_are_together() {
        let line = "surfel jobs a.laz b.laz --tasks 3 --slurm -o out/big.copc.laz -- --memory 4G";
        let job = job(line).unwrap();
        assert_eq!((job.what.as_str(), job.tasks, job.name.as_str()), ("2 inputs", 3, "surfel-big"));
        let task = "surfel convert --memory 4G --resume --shard=\"$SLURM_ARRAY_TASK_ID\"/3 \
                    '--output=out/big.{shard}.shard' -- a.laz b.laz";
        let merge = "surfel convert --output=out/big.copc.laz -- out/big.0000.shard out/big.0001.shard \
                     out/big.0002.shard";
        let slurm = job.slurm();
        assert!(slurm.ends_with(&format!("fi\ncd '/data/my scans' && {task}\n")), "{slurm}");
        assert!(slurm.contains(&format!("#!/bin/bash\ncd '/data/my scans' && {merge}\nEND OF merge\n")), "{slurm}");
        let openjd: serde_json::Value = serde_json::from_str(&job.openjd().unwrap()).unwrap();
        assert_eq!(openjd["steps"][0]["name"], "convert");
        assert_eq!(openjd["steps"][1]["dependencies"][0]["dependsOn"], "convert");
        let k8s: serde_json::Value = serde_json::from_str(&job.k8s("surfel")).unwrap();
        assert_eq!(k8s["items"][0]["spec"]["completions"], 3);
        assert_eq!(k8s["items"][1]["metadata"]["name"], "surfel-big-merge");
        let snakemake = job.snakemake().unwrap();
        assert!(snakemake.contains("output: \"/data/my scans/out/big.{task}.shard\""), "{snakemake}");
        assert!(snakemake.contains("rule merge:") && snakemake.contains("/3 '--output=out/big.{{shard}}.shard'"));
        assert_eq!(job.cuecmd().unwrap().lines().count(), 3);
    }

    #[test]
    fn commands_that_no_shell_takes_are_refused() {
        let names: String = (0..9000).map(|i| format!("{i:015}.laz ")).collect();
        let job = job(&format!("surfel jobs {names}--tasks 2 --slurm -o a.copc.laz")).unwrap();
        assert!(job.slurm().len() > MAX_COMMAND_BYTES);
        let told = [job.openjd().unwrap_err(), job.snakemake().unwrap_err(), job.cuecmd().unwrap_err()];
        assert!(told.iter().all(|failure| failure.code() == 2 && failure.message().contains("expected fewer than")));
    }

    #[test]
    fn jobs_that_no_task_could_run_are_refused() {
        for bad in [
            "surfel jobs a.json --frames 4 --slurm -o a.png",
            "surfel jobs a.json --frames 4 --slurm -o a{frame}.gif",
            "surfel jobs a.json --frames 4 --slurm -- --no-such-flag",
            "surfel jobs a.json --frames 4 --slurm -- --force",
            "surfel jobs a.json --frames 4 --frame-range 0-4 --slurm",
            "surfel jobs a.json --frame-range 0-4 --slurm",
            "surfel jobs a.json --tiles 4 --slurm -o a.jpg",
            "surfel jobs - --tiles 4 --slurm",
            "surfel jobs - --slurm -o a.copc.laz",
            "surfel jobs a.laz --frames 4 --slurm -o a.copc.laz",
            "surfel jobs a.laz --slurm -o a.copc.laz -- --cull none",
            "surfel jobs a.laz --slurm -o a.copc.laz -- --force",
            "surfel jobs a.laz --slurm -o a.copc.laz -- --hybrid",
            "surfel jobs a.laz --slurm -o a.copc.laz -- --shard 0/2",
            "surfel jobs a.laz --slurm -o a.copc.laz -- --size 4x4",
        ] {
            assert_eq!(job(bad).map(|job| job.words).map_err(|f| f.code()), Err(2), "{bad}");
        }
        let braces = job("surfel jobs {{a}}.json --frames 4 --openjd").unwrap();
        assert!(braces.openjd().is_err());
    }

    #[test]
    fn names_survive_the_shell() {
        for word in ["it's", "a b", "$HOME", "`x`", "", "größe", "a\nb", "\\", "*"] {
            let out = std::process::Command::new("sh").args(["-c", &format!("printf %s {}", quote(word))]).output();
            assert_eq!(String::from_utf8(out.unwrap().stdout).unwrap(), word);
        }
    }
}
