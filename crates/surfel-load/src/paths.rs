//! Paths in scene files, which are absolute in memory and relative in written files.

use crate::Error;
use crate::options::STDIN;
use std::path::{Component, Path, PathBuf};
use surfel_io::IoError;
use surfel_io::{ShowPath as _, ShownPath};
use surfel_model::SceneFile;

/// True if the path is `-`, which stands for stdin.
pub fn is_stdin(path: &Path) -> bool {
    path.as_os_str() == STDIN
}

/// Returns the name of an input for messages: its path, or `stdin` for `-`.
pub fn display(path: &Path) -> ShownPath<'_> {
    if is_stdin(path) { Path::new("stdin").shown() } else { path.shown() }
}

/// Makes a path absolute without accessing the disk.
///
/// # Errors
/// [`Error::Io`] if the path is empty or the current folder no longer exists.
pub fn absolute(path: &Path) -> Result<PathBuf, Error> {
    let action = "find where it is";
    let failed = |source| IoError::System { path: path.to_path_buf(), action, source }.into();
    match std::path::absolute(path) {
        // WebAssembly in a browser has no folders.
        Err(e) if e.kind() == std::io::ErrorKind::Unsupported => Ok(path.to_path_buf()),
        found => found.map_err(failed),
    }
}

/// Calls `change` with each path in a scene file, except `-` for stdin.
///
/// # Errors
/// The first [`Error`] that `change` returns.
pub fn for_each(file: &mut SceneFile, mut change: impl FnMut(&mut PathBuf) -> Result<(), Error>) -> Result<(), Error> {
    let objects = file.objects.iter_mut().flat_map(|o| {
        let convert = &mut o.convert;
        [&mut o.splats, &mut o.mesh, &mut convert.texture.file, &mut convert.colormap_file, &mut convert.labels]
    });
    let paths = objects.chain([&mut file.matcap]).flatten();
    paths.filter(|path| !is_stdin(path)).try_for_each(&mut change)
}

/// Returns a scene file with its absolute paths made relative to `folder`, which must exist.
///
/// # Errors
/// The signature allows an [`Error`], but none occurs.
pub fn relative_to(folder: &Path, file: &SceneFile) -> Result<SceneFile, Error> {
    let mut file = file.clone();
    for_each(&mut file, |path| {
        *path = relative(path, folder);
        Ok(())
    })?;
    Ok(file)
}

/// Returns the relative path from `folder` to an absolute path, with slashes. Returns the path itself if no relative
/// path exists, such as between two drives.
///
/// Symbolic links in both folders are resolved first, because `..` after a link leads to the parent of the link's
/// target.
pub fn relative(path: &Path, folder: &Path) -> PathBuf {
    let real = |folder: &Path| std::fs::canonicalize(folder).or_else(|_| std::path::absolute(folder));
    let (Some(parent), Some(name), Ok(folder)) = (path.parent(), path.file_name(), real(folder)) else {
        return path.to_path_buf();
    };
    let Ok(parent) = real(parent) else { return path.to_path_buf() };
    let parts = |path: &Path| path.components().map(|c| c.as_os_str().to_owned()).collect::<Vec<_>>();
    let (from, to) = (parts(&folder), parts(&parent));
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let rooted = |path: &Path| matches!(path.components().next(), Some(Component::Prefix(_)));
    if common == 0 && (rooted(&folder) || rooted(&parent)) {
        return path.to_path_buf();
    }
    let up = std::iter::repeat_n("..".into(), from.len() - common);
    let steps = up.chain(to.into_iter().skip(common)).chain([name.to_owned()]);
    let mut text = std::ffi::OsString::new();
    for step in steps {
        if !text.is_empty() {
            text.push("/");
        }
        text.push(step);
    }
    // This is the only relative path that could be confused with stdin.
    if text == *"-" { PathBuf::from("./-") } else { PathBuf::from(text) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_paths_lead_from_the_folder_to_the_file() {
        let root = std::env::temp_dir().join(format!("surfel-paths-{}", std::process::id()));
        std::fs::create_dir_all(root.join("a/b")).unwrap();
        std::fs::create_dir_all(root.join("c")).unwrap();
        for (path, folder, expected) in [
            ("a/x.ply", "a", "x.ply"),
            ("a/b/x.ply", "a", "b/x.ply"),
            ("a/x.ply", "a/b", "../x.ply"),
            ("c/x.ply", "a/b", "../../c/x.ply"),
            ("a/-", "a", "./-"),
        ] {
            assert_eq!(relative(&root.join(path), &root.join(folder)), Path::new(expected), "{path} from {folder}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(root.join("a/b"), root.join("link")).unwrap();
            let way = relative(&root.join("c/x.ply"), &root.join("link"));
            assert_eq!(way, Path::new("../../c/x.ply"), "out of where the link leads");
        }
        std::fs::remove_dir_all(&root).unwrap();
    }
}
