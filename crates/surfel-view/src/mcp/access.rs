//! Files that tools may read.

use std::path::{Path, PathBuf};

/// Folders and files that tools may read.
#[derive(Clone, Debug)]
pub(super) struct Access {
    /// Canonical paths of the folders and files that tools may read.
    roots: Vec<PathBuf>,
}

impl Access {
    /// Allows these files, and all files below these folders. If `roots` is empty, allows all files below the current
    /// folder.
    pub(super) fn new(roots: &[PathBuf]) -> Result<Self, String> {
        let current = [PathBuf::from(".")];
        let roots = if roots.is_empty() { &current[..] } else { roots };
        let canonical = |path: &PathBuf| {
            path.canonicalize()
                .map_err(|e| format!("{}: can't read it ({e}), expected a file or a folder", path.display()))
        };
        Ok(Self { roots: roots.iter().map(canonical).collect::<Result<_, _>>()? })
    }

    /// Returns the path as given if the file may be read, or else an error. The file's canonical path decides; for a
    /// link, this is the path of the link's target.
    pub(super) fn check(&self, path: &str) -> Result<PathBuf, String> {
        let name = path.escape_debug();
        let real = Path::new(path).canonicalize().map_err(|e| format!("{name}: can't read it: {e}"))?;
        if !self.roots.iter().any(|root| real.starts_with(root)) {
            let allowed: Vec<String> = self.roots.iter().map(|root| root.display().to_string()).collect();
            return Err(format!("{name}: only files in {} may be read", allowed.join(", ")));
        }
        Ok(path.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_outside_of_the_roots_are_refused() {
        let folder = std::env::temp_dir().join(format!("surfel-access-{}", std::process::id()));
        let inside = folder.join("inside");
        std::fs::create_dir_all(&inside).unwrap();
        let [scan, secret] = [inside.join("scan.ply"), folder.join("secret.ply")];
        [&scan, &secret].into_iter().for_each(|path| std::fs::write(path, "x").unwrap());
        let access = Access::new(std::slice::from_ref(&inside)).unwrap();
        let check = |path: &Path| access.check(path.to_str().unwrap());
        assert_eq!(check(&scan), Ok(scan.clone()));
        assert!(check(&secret).unwrap_err().contains("only files in"));
        assert!(check(&inside.join("../secret.ply")).is_err() && check(&inside.join("missing.ply")).is_err());
        #[cfg(unix)]
        {
            let link = inside.join("link.ply");
            std::os::unix::fs::symlink(&secret, &link).unwrap();
            assert!(check(&link).is_err(), "a link out of the folder");
        }
        assert!(Access::new(&[folder.join("missing")]).is_err());
        std::fs::remove_dir_all(folder).unwrap();
    }
}
