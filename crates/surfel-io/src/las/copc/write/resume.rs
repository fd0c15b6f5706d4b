//! What is done of a file that is being written, in a folder beside it, so that another run can go on with it.
//!
//! Points, margins, chunks and upper nodes are in files that only grow. Now and then these are brought to the disk, and
//! then a short file says how much of them counts: whatever a run that was killed wrote after that is cut off.

use super::CopcOptions;
use super::inputs::Stop;
use crate::error::{IoError, Problem, WRITE};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

pub(super) const POINTS: &str = "points";
pub(super) const MARGINS: &str = "margins";
pub(super) const CHUNKS: &str = "chunks";
pub(super) const UPPER: &str = "upper";
pub(super) const SORTED: &str = "sorted.json";
pub(super) const BUILT: &str = "built.json";
const WRITTEN: &str = "written.json";
const MANIFEST: &str = "manifest.json";
const LOCK: &str = "lock";
/// All files of such a folder in the order in which they are removed: none says what is in one that is gone.
const NAMES: [&str; 9] = [BUILT, SORTED, UPPER, CHUNKS, MARGINS, POINTS, MANIFEST, WRITTEN, LOCK];

/// What an unfinished conversion is of.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
pub(super) struct Manifest {
    version: String,
    splats: bool,
    shard: Option<[u32; 2]>,
    columns: Option<String>,
    inputs: Vec<Stated>,
}

/// An input as it was when the conversion began.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct Stated {
    path: PathBuf,
    bytes: u64,
    /// Seconds and nanoseconds since 1970.
    modified: Option<[u64; 2]>,
}

impl Manifest {
    pub(super) fn new(inputs: &[PathBuf], splats: bool, options: &CopcOptions) -> Result<Self, IoError> {
        let state = |path: &PathBuf| {
            let system = |source| IoError::System { path: path.clone(), action: crate::error::READ, source };
            let found = fs::metadata(path).map_err(system)?;
            let modified = found.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
            let modified = modified.map(|time| [time.as_secs(), time.subsec_nanos().into()]);
            Ok(Stated { path: std::path::absolute(path).map_err(system)?, bytes: found.len(), modified })
        };
        let inputs = inputs.iter().map(state).collect::<Result<_, IoError>>()?;
        let columns = options.columns.as_ref().map(ToString::to_string);
        Ok(Self { version: env!("CARGO_PKG_VERSION").to_owned(), splats, shard: options.shard, columns, inputs })
    }

    /// How another one differs, if it does.
    fn difference(&self, other: &Self) -> Option<[String; 2]> {
        if self == other {
            return None;
        }
        let words = |m: &Self| match m.shard {
            _ if self.version != other.version => format!("Surfel {}", m.version),
            _ if self.splats != other.splats => format!("splats: {}", m.splats),
            _ if self.columns != other.columns => format!("columns: {}", m.columns.as_deref().unwrap_or("none")),
            Some([index, count]) if self.shard != other.shard => format!("--shard {index}/{count}"),
            None if self.shard != other.shard => "all of it".to_owned(),
            _ if self.inputs.len() != other.inputs.len() => format!("{} inputs", m.inputs.len()),
            _ => {
                let unlike = |(a, b)| a != b;
                let first = self.inputs.iter().zip(&other.inputs).position(unlike).unwrap_or(0);
                let Some(Stated { path, bytes, modified }) = m.inputs.get(first) else { return String::new() };
                let [seconds, nanos] = modified.unwrap_or_default();
                format!("{} of {bytes} bytes, changed at {seconds}.{nanos:09}", path.display())
            }
        };
        Some([words(self), words(other)])
    }
}

/// A folder that keeps what is done.
#[derive(Debug)]
pub(super) struct Kept {
    folder: PathBuf,
    /// Locked as long as a run uses the folder.
    _lock: File,
}

/// The folder that belongs to an output.
pub(super) fn folder_of(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(".resume");
    output.with_file_name(name)
}

impl Kept {
    /// The folder of an output, made where there is none.
    pub(super) fn open(output: &Path, manifest: &Manifest) -> Result<Self, IoError> {
        let folder = folder_of(output);
        let system = |source| IoError::System { path: folder.clone(), action: WRITE, source };
        fs::create_dir_all(&folder).map_err(system)?;
        let foreign = fs::read_dir(&folder).map_err(system)?.flatten().find(|entry| {
            let name = entry.file_name();
            !NAMES.iter().any(|own| name == *own || name == format!("{own}.new").as_str())
        });
        if let Some(found) = foreign {
            let what = format!("holds {}, which is no part of a conversion", found.file_name().display());
            let problem = Problem::new(what).help("rename the folder: its name is that of what --resume keeps");
            return Err(IoError::Invalid { path: folder, problem: Box::new(problem) });
        }
        let lock =
            OpenOptions::new().create(true).truncate(false).write(true).open(folder.join(LOCK)).map_err(system)?;
        if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
            return Err(system(io::Error::other("another run with --resume is writing it")));
        }
        let kept = Self { folder: folder.clone(), _lock: lock };
        match kept.load::<Manifest>(MANIFEST)? {
            None => kept.save(MANIFEST, manifest).map_err(system)?,
            Some(found) => {
                if let Some([found, expected]) = found.difference(manifest) {
                    let problem = Problem::new(format!("is of another conversion: {found}")).expected(expected);
                    let help = "go on with the command that began it, or delete this folder to start anew";
                    return Err(IoError::Invalid { path: folder, problem: Box::new(problem.help(help)) });
                }
            }
        }
        Ok(kept)
    }

    fn damaged(&self, what: String) -> IoError {
        let problem = Problem::new(what).help("delete this folder to start anew");
        IoError::Invalid { path: self.folder.clone(), problem: Box::new(problem) }
    }

    /// A state, if there is one.
    pub(super) fn load<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>, IoError> {
        match fs::read(self.folder.join(name)) {
            Ok(bytes) => {
                let state = serde_json::from_slice(&bytes);
                state.map(Some).map_err(|e| self.damaged(format!("has a damaged {name}: {e}")))
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(IoError::System { path: self.folder.join(name), action: WRITE, source }),
        }
    }

    /// Writes a state, whole or not at all.
    pub(super) fn save(&self, name: &str, state: &impl Serialize) -> io::Result<()> {
        let new = self.folder.join(format!("{name}.new"));
        let mut file = File::create(&new)?;
        file.write_all(&serde_json::to_vec(state)?)?;
        file.sync_all()?;
        drop(file);
        fs::rename(&new, self.folder.join(name))?;
        // Makes the name durable; not every system lets a folder be synced.
        let _ = File::open(&self.folder).and_then(|folder| folder.sync_all());
        Ok(())
    }

    /// A file of which so many bytes count.
    pub(super) fn file(&self, name: &str, bytes: u64) -> Result<File, Stop> {
        let mut options = OpenOptions::new();
        let file = options.create(true).truncate(false).read(true).write(true).open(self.folder.join(name))?;
        let there = file.metadata()?.len();
        if there < bytes {
            let what = format!("has {there} bytes in its file {name}, of {bytes} at least");
            return Err(Stop::Input(self.damaged(what)));
        }
        file.set_len(bytes)?;
        Ok(file)
    }

    /// Notes that all of the output is written, in so many bytes; what is left is to make it appear.
    pub(super) fn written<T: Serialize>(&self, bytes: u64, report: &T) -> io::Result<()> {
        self.save(WRITTEN, &(bytes, report))
    }

    /// What was reported of an output that has appeared, if it is this conversion's.
    pub(super) fn report_of<T: DeserializeOwned>(&self, output: &Path) -> Result<Option<T>, IoError> {
        let written = self.load::<(u64, T)>(WRITTEN)?;
        let bytes = fs::metadata(output).map(|found| found.len()).ok();
        Ok(written.filter(|(written, _)| Some(*written) == bytes).map(|(_, report)| report))
    }

    /// Removes the folder.
    pub(super) fn remove(self) {
        for name in NAMES {
            let _ = fs::remove_file(self.folder.join(name));
            let _ = fs::remove_file(self.folder.join(format!("{name}.new")));
        }
        let _ = fs::remove_dir(&self.folder);
    }
}
