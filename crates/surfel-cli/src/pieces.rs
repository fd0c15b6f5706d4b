//! Shards of a job: selection of the images, or of the tile of an image, that this run draws.
//!
//! A job is a list of images: all frames or cameras, in order, of each input in order. A shard is a contiguous range of
//! this list, so that few inputs are loaded by two runs.

use crate::console::Console;
use crate::failure::Failure;
use std::ops::Range;
use std::path::{Path, PathBuf};
use surfel_app::options::Options;
use surfel_app::values::Part;

/// Selection of the images that this run draws, of all images of a job (see the module).
#[derive(Clone, Debug, Default)]
pub(crate) struct Pictures {
    /// Numbers of the frames that the options request, the same for each input.
    frames: Vec<u32>,
    /// Range of the images that this run draws, as indices into the list of all images of the job.
    drawn: Range<usize>,
    /// True if the images of each input form a film. A film isn't divided between shards: the list then has one entry
    /// per input.
    are_films: bool,
}

impl Pictures {
    /// Selects this run's shard of the images. There are `inputs` inputs with `frames` frames each.
    pub(crate) fn of(
        args: &Options,
        inputs: usize,
        (frames, are_films): (u32, bool),
        console: &Console,
    ) -> Result<Self, Failure> {
        let frames: Vec<u32> = match args.frame_range {
            None => (0..frames).collect(),
            Some(range) => range.checked(frames as usize).map_err(Failure::usage)?.collect(),
        };
        let pictures = if are_films { inputs } else { inputs * frames.len() };
        let mut drawn = 0..pictures;
        let told = match args.shard {
            Some(part) => Some((part, None)),
            // A single image can't be divided. It may also belong to a job whose script divides the work itself.
            None if pictures > 1 => from_environment(|name| std::env::var(name).ok())
                .map_err(Failure::usage)?
                .map(|(part, from)| (part, Some(from))),
            None => None,
        };
        if let Some((part, from)) = told {
            let share = part.of(pictures as u64);
            drawn = share.start as usize..share.end as usize;
            let from = from.map(|from| format!(" (by {from}; --shard 0/1 draws all)")).unwrap_or_default();
            let which = match drawn.len() {
                0 => "none".to_owned(),
                1 => format!("number {}", drawn.start),
                _ => format!("numbers {} to {}", drawn.start, drawn.end - 1),
            };
            console.note(&format!("shard {} of {}{from}: {which} of {pictures} pictures", part.index(), part.count()));
        }
        Ok(Self { frames, drawn, are_films })
    }

    /// Returns the frames that this run draws of an input, given by its index.
    pub(crate) fn of_input(&self, input: usize) -> &[u32] {
        if self.are_films {
            return if self.drawn.contains(&input) { &self.frames } else { &[] };
        }
        let (start, count) = (input * self.frames.len(), self.frames.len());
        let within = |picture: usize| picture.saturating_sub(start).min(count);
        self.frames.get(within(self.drawn.start)..within(self.drawn.end)).unwrap_or_default()
    }
}

/// Returns the shard that a cluster's environment variables define, and a text that names these variables. Returns
/// `None` outside of clusters.
///
/// Kubernetes defines the index of a pod but not the number of pods, so `JOB_COMPLETIONS` must be set, too.
pub(crate) fn from_environment(get: impl Fn(&str) -> Option<String>) -> Result<Option<(Part, String)>, String> {
    let get = |name: &str| get(name).filter(|value| !value.is_empty());
    let number = |name: &str| {
        let parse = |value: String| {
            let wrong = || format!("{name}={value} is no number of a task\n  help: --shard 0/1 is all of them");
            value.trim().parse::<u64>().map_err(|_| wrong())
        };
        get(name).map(parse).transpose()
    };
    for [index_name, count_name] in [
        ["SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT"],
        ["JOB_COMPLETION_INDEX", "JOB_COMPLETIONS"],
        ["AWS_BATCH_JOB_ARRAY_INDEX", "AWS_BATCH_JOB_ARRAY_SIZE"],
    ] {
        let Some(id) = number(index_name)? else { continue };
        let Some(count) = number(count_name)? else {
            return Err(format!(
                "{index_name}={id} is set, but not {count_name}, of how many\n  help: set it, or give --shard I/N; \
                 --shard 0/1 is all of them"
            ));
        };
        let said = format!("{index_name}={id}, {count_name}={count}");
        let index = match (number("SLURM_ARRAY_TASK_MIN")?, number("SLURM_ARRAY_TASK_MAX")?) {
            (Some(min), Some(max)) if index_name.starts_with("SLURM") => place_in_array(id, count, min, max),
            _ => Some(id),
        };
        let part = index.and_then(|index| Part::new(index, count));
        let wrong = || format!("{said} is no share of an evenly numbered array\n  help: give --shard I/N");
        return part.map(|part| Some((part, said.clone()))).ok_or_else(wrong);
    }
    Ok(None)
}

/// Returns the index (from 0) of the task with the number `id` among `count` tasks, whose evenly spaced numbers reach
/// from `min` to `max`. Slurm's arrays may begin at any number and have a step above 1. Returns `None` if the numbers
/// contradict each other.
fn place_in_array(id: u64, count: u64, min: u64, max: u64) -> Option<u64> {
    let (offset, span) = (id.checked_sub(min)?, max.checked_sub(min)?);
    let gaps = count.checked_sub(1)?;
    let step = span.checked_div(gaps).unwrap_or(1);
    (step > 0 && gaps * step == span && offset % step == 0).then(|| offset / step).filter(|&place| place < count)
}

/// Returns the output name with `{tile}` replaced by the number of the tile.
pub(crate) fn with_tile(output: &Path, args: &Options) -> PathBuf {
    match (args.render.tile, output.to_str()) {
        (Some(part), Some(name)) => name.replace("{tile}", &format!("{:04}", part.index())).into(),
        _ => output.to_path_buf(),
    }
}

/// Returns the output name with `{shard}` replaced by the number of the shard.
pub(crate) fn with_shard(output: &Path, shard: Option<Part>) -> PathBuf {
    match (shard, output.to_str()) {
        (Some(part), Some(name)) => name.replace("{shard}", &format!("{:04}", part.index())).into(),
        _ => output.to_path_buf(),
    }
}

/// Refuses `--frame-range` for a single image, `--skip-existing` without a file, and `{tile}` in the output name
/// without `--tile`.
pub(crate) fn check(args: &Options, to_files: bool) -> Result<(), Failure> {
    let moves = args.render.turntable || args.path.is_some();
    if args.frame_range.is_some() && !moves && !args.sequence && args.cameras.is_none() {
        return Err(Failure::usage(
            "--frame-range is of several frames: give --turntable --frames N, --path, --sequence or --cameras",
        ));
    }
    if args.skip_existing && !to_files {
        return Err(Failure::usage("--skip-existing is for images in files: give -o a file name"));
    }
    let named = args.output.as_ref().is_some_and(|name| name.to_string_lossy().contains("{tile}"));
    if named && args.render.tile.is_none() {
        return Err(Failure::usage("-o has {tile}, the number of a tile: give --tile I/N"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn environment(text: &str) -> Result<Option<Part>, String> {
        let get = |name: &str| {
            let pairs = text.split(' ').filter_map(|pair| pair.split_once('='));
            pairs.filter(|(n, _)| *n == name).map(|(_, value)| value.to_owned()).next()
        };
        Ok(from_environment(get)?.map(|(part, _)| part))
    }

    #[test]
    fn clusters_say_shards_by_their_variables() {
        let is = |index, count| Ok(Part::new(index, count));
        assert_eq!(environment("PATH=/bin"), Ok(None));
        assert_eq!(environment("SLURM_ARRAY_TASK_ID= SLURM_ARRAY_TASK_COUNT="), Ok(None));
        assert_eq!(environment("SLURM_ARRAY_TASK_ID=2 SLURM_ARRAY_TASK_COUNT=4"), is(2, 4));
        assert_eq!(environment("JOB_COMPLETION_INDEX=0 JOB_COMPLETIONS=8"), is(0, 8));
        assert_eq!(environment("AWS_BATCH_JOB_ARRAY_INDEX=7 AWS_BATCH_JOB_ARRAY_SIZE=8"), is(7, 8));
        // Arrays that start elsewhere and have steps: --array=10-30:10.
        let slurm = |id: u32| {
            environment(&format!(
                "SLURM_ARRAY_TASK_ID={id} SLURM_ARRAY_TASK_COUNT=3 SLURM_ARRAY_TASK_MIN=10 SLURM_ARRAY_TASK_MAX=30"
            ))
        };
        assert_eq!([slurm(10), slurm(20), slurm(30)], [is(0, 3), is(1, 3), is(2, 3)]);
        assert!(slurm(15).is_err() && slurm(40).is_err() && slurm(0).is_err());
        for bad in [
            "SLURM_ARRAY_TASK_ID=x SLURM_ARRAY_TASK_COUNT=4",
            "SLURM_ARRAY_TASK_ID=1",
            "SLURM_ARRAY_TASK_ID=9 SLURM_ARRAY_TASK_COUNT=4",
            "JOB_COMPLETION_INDEX=3",
            "JOB_COMPLETION_INDEX=-1 JOB_COMPLETIONS=8",
            "AWS_BATCH_JOB_ARRAY_INDEX=1 AWS_BATCH_JOB_ARRAY_SIZE=0",
            // --array=1,2,4
            "SLURM_ARRAY_TASK_ID=2 SLURM_ARRAY_TASK_COUNT=3 SLURM_ARRAY_TASK_MIN=1 SLURM_ARRAY_TASK_MAX=4",
        ] {
            assert!(environment(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn shards_of_several_inputs_are_stretches_of_one_list() {
        let pictures = |drawn| Pictures { frames: vec![0, 2, 4], drawn, are_films: false };
        let of = |p: &Pictures| [0, 1, 2].map(|input| p.of_input(input).to_vec());
        assert_eq!(of(&pictures(0..9)), [vec![0, 2, 4], vec![0, 2, 4], vec![0, 2, 4]]);
        assert_eq!(of(&pictures(2..4)), [vec![4], vec![0], vec![]]);
        assert!(of(&pictures(6..6)).iter().all(Vec::is_empty));
        let films = Pictures { are_films: true, ..pictures(1..2) };
        assert_eq!(of(&films), [vec![], vec![0, 2, 4], vec![]]);
    }
}
