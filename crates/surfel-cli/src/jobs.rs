//! `surfel jobs`: a job for an engine that exists, of the pieces that `--shard` and `--tile` draw.
//!
//! Tasks run in the folder in which the job was made, so that all paths mean what they mean there; workers share it.
//! Job files are JSON where YAML is usual, which JSON is a part of: nothing in a name is then taken for syntax.

use crate::args::{Cli, Command, JobsArgs, command};
use crate::console::Console;
use crate::failure::Failure;
use crate::pieces;
use crate::stdin::is_stdin;
use crate::stdout;
use clap::FromArgMatches;
use serde_json::json;
use std::path::Path;
use surfel::camera;

/// Tasks where nothing is said.
const TASKS: usize = 64;
/// What stands for a task's number in [`Job`], until an engine puts its own there: characters for private use, which
/// JSON doesn't escape.
const TASK: &str = "\u{e000}TASK\u{e000}";

pub(crate) fn run(args: &JobsArgs, console: &Console) -> Result<(), Failure> {
    let folder = std::env::current_dir().map_err(|e| Failure::other(format!("there is no current folder: {e}")))?;
    let folder = folder.to_str().ok_or_else(|| Failure::usage("the name of the current folder is not UTF-8"))?;
    let job = Job::of(args, folder)?;
    let engine = args.engine;
    let text = if engine.openjd {
        job.openjd()?
    } else if engine.slurm {
        job.slurm()
    } else if engine.k8s {
        job.k8s(&args.image)
    } else if engine.cuecmd {
        job.cuecmd()
    } else {
        job.snakemake()?
    };
    console.note(&format!("{} pictures by {} tasks in {folder}", job.pictures, job.tasks));
    if let Some(last) = job.stitch.as_ref().filter(|_| engine.slurm || engine.k8s || engine.cuecmd) {
        console.note(&format!("when all tasks are done: {}", shell(last)));
    }
    stdout::result(text.as_bytes())
}

/// What an engine is told.
#[derive(Debug)]
struct Job {
    name: String,
    folder: String,
    /// Pictures or tiles.
    pictures: usize,
    tasks: usize,
    /// The command of a task.
    words: Vec<String>,
    /// Files that tasks write, one each, where they are tiles, and their name with `{tile}`.
    tiles: Vec<String>,
    tile_name: String,
    /// What puts tiles together.
    stitch: Option<Vec<String>>,
}

impl Job {
    fn of(args: &JobsArgs, folder: &str) -> Result<Self, Failure> {
        let texts = |path: &Path| {
            let not = || Failure::usage(format!("{}: its name is not UTF-8, which job files are", path.display()));
            if is_stdin(path) {
                return Err(Failure::usage("-: a job's tasks have no stdin, expected a file"));
            }
            path.to_str().map(str::to_owned).ok_or_else(not)
        };
        let inputs: Vec<String> = args.inputs.iter().map(|path| texts(path)).collect::<Result<_, _>>()?;
        let default = match (args.cameras.is_some(), args.frames.is_some()) {
            (true, _) => "{name}.png",
            (_, true) => "{frame}.png",
            _ => "whole.png",
        };
        let output = args.output.as_deref().map_or_else(|| Ok(default.to_owned()), texts)?;
        let mut words: Vec<String> = ["surfel", "render"].map(str::to_owned).into();
        words.extend(args.flags.iter().cloned());
        if let Some(frames) = args.frames {
            words.extend(["--turntable".to_owned(), format!("--frames={frames}")]);
        }
        if let Some(cameras) = &args.cameras {
            words.push(format!("--cameras={}", texts(cameras)?));
        }
        if let Some(range) = args.frame_range {
            words.push(format!("--frame-range={range}"));
        }
        let (tile_name, whole) = (tile_name(&output), output.clone());
        let piece = match args.tiles {
            Some(tiles) => [format!("--tile={TASK}/{tiles}"), format!("--output={tile_name}")],
            None => [format!("--shard={TASK}/"), format!("--output={output}")],
        };
        words.push("--skip-existing".to_owned());
        let frames = args.frames.map(|frames| frames as usize);
        let cameras = args.cameras.as_ref().map(|path| camera::named(path, None)).transpose()?;
        let of_input = cameras.map(|cameras| cameras.len()).or(frames).unwrap_or(1);
        let of_input = match args.frame_range {
            Some(range) => range.checked(of_input).map_err(Failure::usage)?.count(),
            None => of_input,
        };
        let apart = inputs.len() > 1 && output.contains("{input}");
        let pictures = args.tiles.map_or(of_input * if apart { inputs.len() } else { 1 }, |tiles| tiles as usize);
        let tasks = match args.tiles {
            Some(tiles) => tiles as usize,
            None => args.tasks.map_or(TASKS, |tasks| tasks as usize).min(pictures),
        };
        let [part, to] = piece;
        words.push(if args.tiles.is_some() { part } else { format!("{part}{tasks}") });
        words.push(to);
        words.push("--".to_owned());
        words.extend(inputs.iter().cloned());
        check(&words, args)?;
        let tiles: Vec<String> = args.tiles.map_or_else(Vec::new, |tiles| {
            (0..tiles).map(|i| tile_name.replace("{tile}", &format!("{i:04}"))).collect()
        });
        let stitch = args.tiles.map(|_| {
            let words = ["surfel", "stitch"].map(str::to_owned).into_iter();
            words.chain([format!("--output={whole}"), "--".to_owned()]).chain(tiles.iter().cloned()).collect()
        });
        let stem = args.inputs.first().and_then(|path| path.file_stem()).unwrap_or_default().to_string_lossy();
        let plain: String =
            stem.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
        let plain = plain.trim_matches('-').chars().take(40).collect::<String>();
        let name = format!("surfel-{plain}").trim_end_matches('-').to_owned();
        Ok(Self { name, folder: folder.to_owned(), pictures, tasks, words, tiles, tile_name, stitch })
    }

    /// A task in a shell, in the job's folder; `task` goes in as it is.
    fn shell(&self, task: &str) -> String {
        format!("cd {} && {}", quote(&self.folder), shell(&self.words).replace(TASK, task))
    }

    /// <https://github.com/OpenJobDescription/openjd-specifications/wiki/2023-09-Template-Schemas>
    fn openjd(&self) -> Result<String, Failure> {
        let run = |script: String| {
            // The format's own brackets can't be written in it.
            if script.replace(OPENJD_TASK, "").contains("{{") {
                return Err(Failure::usage("OpenJD can't hold {{ in a name or a flag: rename the file"));
            }
            Ok(json!({ "actions": { "onRun": { "command": "bash", "args": ["-c", script] } } }))
        };
        let mut steps = vec![json!({
            "name": "render",
            "parameterSpace": { "taskParameterDefinitions": [
                { "name": "Task", "type": "INT", "range": format!("0-{}", self.tasks - 1) }
            ] },
            "script": run(self.shell(OPENJD_TASK))?,
        })];
        if let Some(stitch) = &self.stitch {
            steps.push(json!({
                "name": "stitch",
                "dependencies": [{ "dependsOn": "render" }],
                "script": run(format!("cd {} && {}", quote(&self.folder), shell(stitch)))?,
            }));
        }
        Ok(pretty(&json!({ "specificationVersion": "jobtemplate-2023-09", "name": self.name, "steps": steps })))
    }

    fn slurm(&self) -> String {
        let mut text = format!(
            "#!/bin/bash\n#SBATCH --job-name={}\n#SBATCH --array=0-{}\nset -eu\n{}\n",
            self.name,
            self.tasks - 1,
            self.shell("\"$SLURM_ARRAY_TASK_ID\"")
        );
        if let Some(stitch) = &self.stitch {
            // A name with a line feed must stay within the comment.
            let line = shell(stitch).replace('\n', " ");
            text += &format!("# Then: sbatch --dependency=afterok:JOB --wrap of\n#   {line}\n");
        }
        text
    }

    /// <https://kubernetes.io/docs/reference/kubernetes-api/workload-resources/job-v1/>
    fn k8s(&self, image: &str) -> String {
        // $(NAME) is replaced in what a container runs, and $$ is a dollar.
        let words = self.words.iter().map(|word| word.replace('$', "$$").replace(TASK, "$(JOB_COMPLETION_INDEX)"));
        pretty(&json!({
            "apiVersion": "batch/v1",
            "kind": "Job",
            "metadata": { "name": self.name },
            "spec": {
                "completionMode": "Indexed",
                "completions": self.tasks,
                "parallelism": self.tasks,
                "backoffLimitPerIndex": 3,
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
            },
        }))
    }

    fn cuecmd(&self) -> String {
        (0..self.tasks).map(|task| self.shell(&task.to_string()) + "\n").collect()
    }

    fn snakemake(&self) -> Result<String, Failure> {
        let tile = if self.tiles.is_empty() { String::new() } else { self.tile_name.replace("{tile}", "") };
        if [&self.folder, &tile].iter().any(|name| name.contains(['{', '}'])) {
            return Err(Failure::usage("Snakemake can't hold { or } in the name of a folder or a tile: rename it"));
        }
        // Python reads JSON's strings; Snakemake replaces what is in braces.
        let string = |text: &str| json!(text).to_string();
        let command =
            |text: &str| string(&text.replace('{', "{{").replace('}', "}}")).replace(TASK, "{wildcards.task}");
        let script = format!("cd {} && {}", quote(&self.folder), shell(&self.words));
        let (output, done) = if self.tiles.is_empty() {
            let marker = format!("{}/.{}-{{task}}.done", self.folder, self.name);
            (format!("touch({})", string(&marker)), marker)
        } else {
            let tile = Path::new(&self.folder).join(self.tile_name.replace("{tile}", "{task}"));
            let tile = tile.to_string_lossy().into_owned();
            (string(&tile), tile)
        };
        let tasks: Vec<String> = (0..self.tasks)
            .map(|task| if self.tiles.is_empty() { task.to_string() } else { format!("{task:04}") })
            .collect();
        let all = format!("expand({}, task={})", string(&done), json!(tasks));
        let mut text = String::new();
        if let Some(stitch) = &self.stitch {
            let whole = stitch.iter().find_map(|word| word.strip_prefix("--output=")).unwrap_or_default();
            let whole = string(&Path::new(&self.folder).join(whole).to_string_lossy());
            let stitch = command(&format!("cd {} && {}", quote(&self.folder), shell(stitch)));
            text += &format!(
                "rule all:\n    input: {whole}\n\nrule stitch:\n    input: {all}\n    output: {whole}\n    shell: \
                 {stitch}\n\n"
            );
        } else {
            text += &format!("rule all:\n    input: {all}\n\n");
        }
        Ok(text + &format!("rule render:\n    output: {output}\n    shell: {}\n", command(&script)))
    }
}

/// A task's number in OpenJD.
const OPENJD_TASK: &str = "{{Task.Param.Task}}";

/// OUT with `{tile}` before its extension.
fn tile_name(output: &str) -> String {
    if output.contains("{tile}") {
        return output.to_owned();
    }
    match output.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') => format!("{stem}.{{tile}}.{extension}"),
        _ => format!("{output}.{{tile}}"),
    }
}

/// Refuses here what every task would refuse.
fn check(words: &[String], args: &JobsArgs) -> Result<(), Failure> {
    let words = words.iter().map(|word| word.replace(TASK, "0"));
    let wrong = |e: clap::Error| {
        let text = e.to_string();
        let line = text.lines().next().unwrap_or_default();
        Failure::usage(format!("tasks can't run so: {}", line.strip_prefix("error: ").unwrap_or(line)))
    };
    let matches = command().try_get_matches_from(words).map_err(wrong)?;
    let Command::Render(render) = Cli::from_arg_matches(&matches).map_err(wrong)?.command else {
        return Err(Failure::usage("flags after -- are those of surfel render"));
    };
    let output = render.output.as_deref().unwrap_or(Path::new(""));
    let format = crate::output::Output::new(output, false, render.png16, render.exr_f32)?;
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

/// Words as a POSIX shell takes them.
fn shell(words: &[String]) -> String {
    words.iter().map(|word| quote(word)).collect::<Vec<_>>().join(" ")
}

fn quote(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=./,:%@+".contains(c);
    if !word.is_empty() && word.replace(TASK, "").chars().all(plain) {
        return word.to_owned();
    }
    // What stands for the task must be outside of quotes, where an engine's own variable works.
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
        let Command::Jobs(args) = Cli::from_arg_matches(&matches).unwrap().command else { panic!("{line}") };
        Job::of(&args, "/data/my scans")
    }

    #[test]
    fn jobs_share_pictures_out_to_tasks() {
        let job = job("surfel jobs a.json --frames 100 --slurm --tasks 8 -o out/{frame}.png -- --preset fast").unwrap();
        assert_eq!((job.pictures, job.tasks), (100, 8));
        assert_eq!(
            job.slurm(),
            "#!/bin/bash\n#SBATCH --job-name=surfel-a\n#SBATCH --array=0-7\nset -eu\ncd '/data/my scans' && surfel \
             render --preset fast --turntable --frames=100 --skip-existing --shard=\"$SLURM_ARRAY_TASK_ID\"/8 \
             '--output=out/{frame}.png' -- a.json\n"
        );
        let cuecmd = job.cuecmd();
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
        assert_eq!(job.tiles, ["whole.0000.exr", "whole.0001.exr", "whole.0002.exr"]);
        let openjd: serde_json::Value = serde_json::from_str(&job.openjd().unwrap()).unwrap();
        assert_eq!(openjd["steps"][1]["dependencies"][0]["dependsOn"], "render");
        let text = openjd.to_string();
        assert!(text.contains("--tile={{Task.Param.Task}}/3 '--output=whole.{tile}.exr'"), "{text}");
        assert!(text.contains("surfel stitch --output=whole.exr -- whole.0000.exr whole.0001.exr"), "{text}");
        assert!(job.snakemake().unwrap().contains("rule stitch:"));
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
