//! Where a run goes: what may be there before, and how the new run takes its place.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::error::WriteRunError;
use super::{TOP, manifest};
use crate::io::atomic;

/// Says whether a run must be replaced at `path`, or why nothing may be written there.
pub(super) fn check(path: &Path, overwrite: bool) -> Result<bool, WriteRunError> {
    let owned = || path.to_path_buf();
    let entries = match fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) => {
            return match error.kind() {
                io::ErrorKind::NotFound => Ok(false),
                io::ErrorKind::NotADirectory => Err(WriteRunError::NotAFolder { path: owned() }),
                _ => Err(WriteRunError::io(path, error)),
            };
        }
    };
    let mut names = Vec::new();
    for entry in entries {
        names.push(entry.map_err(|e| WriteRunError::io(path, e))?.file_name().to_string_lossy().into_owned());
    }
    names.sort_unstable();
    if names.is_empty() {
        return Ok(false);
    }
    if !overwrite {
        return Err(WriteRunError::Exists { path: owned() });
    }
    if !is_run(path) {
        return Err(WriteRunError::NotARun { path: owned() });
    }
    // Leftovers of interrupted writes are ours too.
    let ours =
        |name: &String| TOP.contains(&name.as_str()) || (name.starts_with(".yawara-") && name.ends_with(".part"));
    match names.into_iter().find(|name| !ours(name)) {
        Some(found) => Err(WriteRunError::ForeignFile { path: owned(), found }),
        None => Ok(true),
    }
}

fn is_run(path: &Path) -> bool {
    let manifest = fs::read(path.join("manifest.json")).ok();
    let json: Option<serde_json::Value> = manifest.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    json.is_some_and(|json| json["format"] == manifest::FORMAT)
}

fn parent(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    }
}

/// A new folder beside `path`, removed when dropped, with the permissions of an ordinary folder.
pub(super) fn beside(path: &Path) -> Result<TempDir, WriteRunError> {
    let parent = parent(path);
    fs::create_dir_all(&parent).map_err(|e| WriteRunError::io(&parent, e))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".yawara-").suffix(".part");
    #[cfg(unix)]
    let all = std::os::unix::fs::PermissionsExt::from_mode(0o777);
    #[cfg(unix)]
    builder.permissions(all);
    builder.tempdir_in(&parent).map_err(|e| WriteRunError::io(&parent, e))
}

/// Renames a finished folder to `path`, after moving away the run that `occupied` it.
pub(super) fn install(building: TempDir, path: &Path, occupied: bool) -> Result<(), WriteRunError> {
    let at = |e| WriteRunError::io(path, e);
    if occupied {
        let old = beside(path)?;
        let kept = old.path().join("run");
        fs::rename(path, &kept).map_err(at)?;
        if let Err(error) = fs::rename(building.path(), path) {
            // Put the old run back; if even that fails it must not be deleted with its temporary folder.
            if fs::rename(&kept, path).is_err() {
                let _ = old.keep();
            }
            return Err(at(error));
        }
    } else {
        // An empty folder may be there; not every system renames over it.
        if path.exists() {
            fs::remove_dir(path).map_err(at)?;
        }
        fs::rename(building.path(), path).map_err(at)?;
    }
    // The name is gone; nothing is left to remove.
    let _ = building.keep();
    let parent = parent(path);
    atomic::sync_folder(&parent).map_err(|e| WriteRunError::io(&parent, e))
}
