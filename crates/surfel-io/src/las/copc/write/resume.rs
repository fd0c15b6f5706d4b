//! Saved progress of a conversion, in a folder beside the output, from which another run can continue.
//!
//! Points, margins, chunks and upper nodes are in files that only grow. From time to time these files are synced to
//! disk, and then a short state file records their valid lengths. Anything that a killed run wrote after that is cut
//! off.

use super::CopcOptions;
use super::inputs::Stop;
use crate::error::ShowPath as _;
use crate::error::{IoError, Problem, WRITE};
use crate::las::copc::spill::{Changed, checksum};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Write};
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
/// All files of a resume folder in their order of removal: no state file outlives a file that it refers to.
const NAMES: [&str; 9] = [BUILT, SORTED, UPPER, CHUNKS, MARGINS, POINTS, MANIFEST, WRITTEN, LOCK];

/// Identity of an unfinished conversion.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
pub(super) struct Manifest {
    version: String,
    splats: bool,
    shard: Option<[u32; 2]>,
    columns: Option<String>,
    inputs: Vec<Stated>,
}

/// Path, size and time of an input when the conversion began.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct Stated {
    path: PathBuf,
    bytes: u64,
    /// Modification time: seconds and nanoseconds since 1970.
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

    /// Describes the first difference between two manifests: the value in `self`, then the value in `other`. Returns
    /// `None` if they are equal.
    fn difference(&self, other: &Self) -> Option<[String; 2]> {
        if self == other {
            return None;
        }
        let words = |m: &Self| match m.shard {
            _ if self.version != other.version => format!("Surfel {}", m.version),
            _ if self.splats != other.splats => format!("splats: {}", m.splats),
            _ if self.columns != other.columns => format!("columns: {}", m.columns.as_deref().unwrap_or("none")),
            Some([index, count]) if self.shard != other.shard => format!("`shard={index}/{count}`"),
            None if self.shard != other.shard => "all of it".to_owned(),
            _ if self.inputs.len() != other.inputs.len() => format!("{} inputs", m.inputs.len()),
            _ => {
                let unlike = |(a, b)| a != b;
                let first = self.inputs.iter().zip(&other.inputs).position(unlike).unwrap_or(0);
                let Some(Stated { path, bytes, modified }) = m.inputs.get(first) else { return String::new() };
                let [seconds, nanos] = modified.unwrap_or_default();
                format!("{} of {bytes} bytes, changed at {seconds}.{nanos:09}", path.shown())
            }
        };
        Some([words(self), words(other)])
    }
}

/// A resume folder, locked for this run.
#[derive(Debug)]
pub(super) struct ResumeFolder {
    folder: PathBuf,
    /// Lock file, locked as long as a run uses the folder.
    _lock: File,
}

/// Returns the path of an output's resume folder.
pub(super) fn folder_of(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(".resume");
    output.with_file_name(name)
}

impl ResumeFolder {
    /// Opens an output's resume folder, or creates one that other users can't write to. Returns an error if the folder
    /// is unsafe, in use by another run, or of another conversion.
    pub(super) fn open(output: &Path, manifest: &Manifest) -> Result<Self, IoError> {
        let folder = folder_of(output);
        let system = |source| IoError::System { path: folder.clone(), action: WRITE, source };
        make_private(&folder).map_err(system)?;
        if let Some(what) = unsafe_content(&folder).map_err(system)? {
            let problem = Problem::new(what).help("rename or delete it: its name is that of what `resume` keeps");
            return Err(IoError::Invalid { path: folder, problem: Box::new(problem) });
        }
        let lock = open_own(&folder.join(LOCK), OpenOptions::new().create(true).truncate(false).write(true));
        let lock = lock.map_err(system)?;
        if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
            return Err(system(io::Error::other("another run with `resume` is writing it")));
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

    /// Converts a conversion's error: reports the folder as damaged if its files have changed since they were written.
    pub(super) fn blamed(&self, error: IoError) -> IoError {
        match error {
            IoError::System { source, .. } if source.get_ref().and_then(|e| e.downcast_ref::<Changed>()).is_some() => {
                self.damaged(format!("has changed: {source}"))
            }
            error => error,
        }
    }

    /// Reads a state file, if there is one, and verifies its checksum.
    pub(super) fn load<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>, IoError> {
        let system = |source| IoError::System { path: self.folder.join(name), action: WRITE, source };
        let mut bytes = Vec::new();
        match open_own(&self.folder.join(name), OpenOptions::new().read(true)) {
            Ok(mut file) => file.read_to_end(&mut bytes).map_err(system)?,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(system(source)),
        };
        let end = bytes.iter().rposition(|b| *b == b'\n').unwrap_or(bytes.len());
        let (json, sum) = bytes.split_at(end);
        if sum != sum_line(json).as_bytes() {
            return Err(self.damaged(format!("has a changed or damaged {name}")));
        }
        let state = serde_json::from_slice(json);
        state.map(Some).map_err(|e| self.damaged(format!("has a damaged {name}: {e}")))
    }

    /// Writes a state file with its checksum, atomically.
    pub(super) fn save(&self, name: &str, state: &impl Serialize) -> io::Result<()> {
        let new = self.folder.join(format!("{name}.new"));
        match fs::remove_file(&new) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let mut file = open_own(&new, OpenOptions::new().create_new(true).write(true))?;
        let json = serde_json::to_vec(state)?;
        file.write_all(&json)?;
        file.write_all(sum_line(&json).as_bytes())?;
        file.sync_all()?;
        drop(file);
        fs::rename(&new, self.folder.join(name))?;
        // Makes the rename durable; not every system can sync a folder.
        let _ = File::open(&self.folder).and_then(|folder| folder.sync_all());
        Ok(())
    }

    /// Opens a data file of the folder, or creates it, and cuts it off after its `bytes` valid bytes. Returns an error
    /// if the file is shorter.
    pub(super) fn file(&self, name: &str, bytes: u64) -> Result<File, Stop> {
        let mut options = OpenOptions::new();
        let options = options.create(true).truncate(false).read(true).write(true);
        let file = open_own(&self.folder.join(name), options)?;
        let there = file.metadata()?.len();
        if there < bytes {
            let what = format!("has {there} bytes in its file {name}, of {bytes} at least");
            return Err(Stop::Input(self.damaged(what)));
        }
        file.set_len(bytes)?;
        Ok(file)
    }

    /// Records that the whole output, of `bytes` bytes, is written; the only step left is to rename it.
    pub(super) fn written<T: Serialize>(&self, bytes: u64, report: &T) -> io::Result<()> {
        self.save(WRITTEN, &(bytes, report))
    }

    /// Returns the report of an output that already exists, if this conversion wrote it, judging from its size; else
    /// `None`.
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

/// Returns the line that follows a state: its checksum.
fn sum_line(json: &[u8]) -> String {
    format!("\n{:08x}", checksum(json))
}

/// Creates a folder that only its owner can use, unless it exists.
fn make_private(folder: &Path) -> io::Result<()> {
    #[cfg(unix)]
    let builder = {
        let mut builder = fs::DirBuilder::new();
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        builder
    };
    #[cfg(not(unix))]
    let builder = fs::DirBuilder::new();
    match builder.create(folder) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        made => made,
    }
}

/// Describes why a folder is unsafe to resume in, if it is. Links are unsafe because this program would write through
/// them; so are files or folders that other users own or can write to.
fn unsafe_content(folder: &Path) -> io::Result<Option<String>> {
    let found = fs::symlink_metadata(folder)?;
    if !found.is_dir() {
        return Ok(Some("is a link or a file, expected a folder".to_owned()));
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        // The expected owner is that of a file made here: some file systems report another owner than the process's
        // own.
        let made =
            tempfile::tempfile_in(folder.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(".".as_ref()))?;
        if made.metadata()?.uid() != found.uid() {
            return Ok(Some("belongs to another user".to_owned()));
        }
        if found.mode() & 0o022 != 0 {
            return Ok(Some("can be written to by other users".to_owned()));
        }
    }
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let shown = Path::new(&name).shown();
        if !NAMES.iter().any(|own| name == *own || name == format!("{own}.new").as_str()) {
            return Ok(Some(format!("holds {shown}, which is no part of a conversion")));
        }
        if !is_own(&fs::symlink_metadata(entry.path())?) {
            return Ok(Some(format!("holds {shown}, which is a link or no file")));
        }
    }
    Ok(None)
}

/// True if a path is a regular file without other hard links.
fn is_own(found: &fs::Metadata) -> bool {
    #[cfg(unix)]
    let is_linked = std::os::unix::fs::MetadataExt::nlink(found) > 1;
    #[cfg(not(unix))]
    let is_linked = false;
    found.is_file() && !is_linked
}

/// Opens a file of the folder; a link is an error.
fn open_own(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, rustix::fs::OFlags::NOFOLLOW.bits() as i32);
    let file = options.open(path)?;
    match is_own(&file.metadata()?) {
        true => Ok(file),
        false => Err(io::Error::other(format!("{} is a link or no file", path.shown()))),
    }
}
