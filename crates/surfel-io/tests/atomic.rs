//! Tests of atomic writing.

use std::fs;
use std::io;
use std::path::PathBuf;
use surfel_io::{IoError, atomic};

/// A folder that is removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-io-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn names(&self) -> Vec<String> {
        fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn atomic_refuses_what_exists_unless_told_to_overwrite() {
    let folder = Folder::new("exists");
    let path = folder.0.join("a.txt");
    atomic::write(&path, false, |out| out.write_all(b"one")).unwrap();
    let error = atomic::write(&path, false, |out| out.write_all(b"two")).unwrap_err();
    assert!(matches!(error, IoError::Exists { .. }) && error.to_string().contains("`force`"), "{error}");
    assert_eq!(fs::read(&path).unwrap(), b"one");
    atomic::write(&path, true, |out| out.write_all(b"two")).unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"two");
    assert_eq!(folder.names(), ["a.txt"]);
}

#[test]
fn atomic_failure_leaves_the_old_file_and_nothing_else() {
    let folder = Folder::new("failure");
    let path = folder.0.join("a.txt");
    fs::write(&path, "old").unwrap();
    let error = atomic::write(&path, true, |out| {
        out.write_all(&[0; 1 << 20])?;
        Err(io::Error::other("no more"))
    });
    assert!(error.unwrap_err().to_string().ends_with("cannot write it: no more"));
    let panicked = std::panic::catch_unwind(|| atomic::write(&path, true, |_| panic!("in the middle")));
    assert!(panicked.is_err());
    assert_eq!((fs::read_to_string(&path).unwrap().as_str(), folder.names().len()), ("old", 1));
}

#[test]
fn atomic_another_writer_that_was_faster_wins() {
    let folder = Folder::new("race");
    let path = folder.0.join("a.txt");
    let result = atomic::write(&path, false, |out| {
        fs::write(&path, "theirs")?;
        out.write_all(b"ours")
    });
    assert!(matches!(result, Err(IoError::Exists { .. })));
    assert_eq!((fs::read_to_string(&path).unwrap().as_str(), folder.names().len()), ("theirs", 1));
}

#[test]
fn atomic_bad_targets_are_errors() {
    let folder = Folder::new("targets");
    assert!(atomic::write(&folder.0, true, |_| Ok(())).unwrap_err().to_string().contains("it is a folder"));
    assert!(atomic::write(&folder.0.join("no/such/a.txt"), true, |_| Ok(())).is_err());
}

#[cfg(unix)]
#[test]
fn atomic_follows_links_and_writes_devices_directly() {
    let folder = Folder::new("links");
    let (real, link) = (folder.0.join("real"), folder.0.join("link"));
    fs::write(&real, "old").unwrap();
    std::os::unix::fs::symlink(&real, &link).unwrap();
    atomic::write(&link, true, |out| out.write_all(b"new")).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(fs::read(&real).unwrap(), b"new");
    atomic::write("/dev/null".as_ref(), false, |out| out.write_all(b"gone")).unwrap();
    assert!(!fs::metadata("/dev/null").unwrap().is_file());
}

#[cfg(unix)]
#[test]
fn atomic_permissions_are_those_of_any_new_file_and_then_stay() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new("permissions");
    let mode = |path: &std::path::Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let (ours, plain) = (folder.0.join("ours"), folder.0.join("plain"));
    atomic::write(&ours, false, |out| out.write_all(b"one")).unwrap();
    fs::write(&plain, "one").unwrap();
    assert_eq!(mode(&ours), mode(&plain));
    fs::set_permissions(&ours, fs::Permissions::from_mode(0o640)).unwrap();
    atomic::write(&ours, true, |out| out.write_all(b"two")).unwrap();
    assert_eq!((mode(&ours), fs::read(&ours).unwrap().as_slice()), (0o640, &b"two"[..]));
}
