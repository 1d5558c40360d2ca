//! Files that appear whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, IntoInnerError, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::syncing_file::SyncingFile;

/// Writes a file through `write`, under a temporary name in the same folder, then renames it into place.
///
/// A reader never sees half a file: on any error the temporary file is removed and what was at `path` before stays.
/// Missing parent folders are made.
///
/// # Errors
/// Whatever `write` returns, or the operating system's error while creating, flushing, syncing or renaming.
pub fn write_file<E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<SyncingFile>) -> Result<(), E>,
) -> Result<(), E> {
    let (file, temporary) = beside(path)?.into_parts();
    let mut writer = BufWriter::with_capacity(1 << 20, SyncingFile::new(file));
    write(&mut writer)?;
    writer.into_inner().map_err(IntoInnerError::into_error)?.finish()?;
    temporary.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Makes a folder and its parents, if they are not there.
///
/// # Errors
/// The operating system's error; if a file is in the way, one that names it.
pub fn make_folder(folder: &Path) -> io::Result<()> {
    std::fs::create_dir_all(folder).map_err(|error| match folder.ancestors().find(|part| part.is_file()) {
        // The system says "File exists" or "Not a directory", and not of what.
        Some(file) => {
            io::Error::new(io::ErrorKind::NotADirectory, format!("{} is a file, not a folder", file.display()))
        }
        None => error,
    })
}

/// Writes small files that belong together, each whole or not at all, and makes their names durable.
///
/// All are written before the first is synced, and all are synced before the first is renamed: a journalling file system
/// commits them together, where one [`write_file`] after the other waits for a commit each.
///
/// # Errors
/// The path at fault, and the operating system's error while creating, writing, syncing or renaming. Files that were not
/// renamed yet stay as they were before.
pub fn write_files(files: &[(PathBuf, Vec<u8>)]) -> Result<(), (PathBuf, io::Error)> {
    let at = |path: &Path| {
        let path = path.to_path_buf();
        move |error: io::Error| (path, error)
    };
    let mut written = Vec::with_capacity(files.len());
    for (path, bytes) in files {
        let mut temporary = beside(path).map_err(at(path))?;
        temporary.write_all(bytes).map_err(at(path))?;
        written.push((path, temporary));
    }
    for (path, temporary) in &written {
        temporary.as_file().sync_all().map_err(at(path))?;
    }
    for (path, temporary) in written {
        temporary.persist(path).map_err(|error| at(path)(error.error))?;
    }
    let mut folders: Vec<&Path> = files.iter().map(|(path, _)| folder_of(path)).collect();
    folders.sort_unstable();
    folders.dedup();
    folders.into_iter().try_for_each(|folder| sync_folder(folder).map_err(at(folder)))
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A temporary file in the folder of `path`, which is made where it is missing.
fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let folder = folder_of(path);
    make_folder(folder)?;
    tempfile::Builder::new().prefix(".yawara-").suffix(".part").make_in(folder, |path| {
        // Not tempfile's own 0600: the result is a plain file that obeys the umask.
        File::options().read(true).write(true).create_new(true).open(path)
    })
}

/// Makes the names in a folder durable: after it returns, a renamed file survives a power cut. Does nothing where folders
/// cannot be opened (Windows).
///
/// # Errors
/// The operating system's error while opening or syncing the folder.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(folder: &Path) -> Vec<String> {
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.stl");
        write_file::<io::Error>(&path, |w| w.write_all(b"old")).unwrap();
        let failed = write_file::<io::Error>(&path, |w| {
            w.write_all(b"new")?;
            Err(io::Error::other("disk on fire"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "disk on fire");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(entries(folder.path()), ["mesh.stl"]);
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("notes.txt");
        std::fs::write(&file, "x").unwrap();
        for path in [file.join("mesh.stl"), file.join("a/b/mesh.stl")] {
            let error = write_file::<io::Error>(&path, |w| w.write_all(b"x")).unwrap_err();
            assert_eq!(error.to_string(), format!("{} is a file, not a folder", file.display()));
        }
    }

    #[test]
    fn files_written_together_appear_together_or_name_the_one_at_fault() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        write_files(&[(path("a"), b"1".to_vec()), (path("b/c"), b"2".to_vec())]).unwrap();
        assert_eq!(std::fs::read(path("b/c")).unwrap(), b"2");
        // A folder cannot be made below a file.
        let (at, _) = write_files(&[(path("a"), b"3".to_vec()), (path("a/d"), b"4".to_vec())]).unwrap_err();
        assert_eq!(at, path("a/d"));
        assert_eq!(std::fs::read(path("a")).unwrap(), b"1");
        assert_eq!(entries(folder.path()).len(), 2, "no temporary file stays");
    }

    #[test]
    fn missing_folders_are_made() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/c.txt");
        write_file::<io::Error>(&path, |w| w.write_all(b"x")).unwrap();
        assert_eq!(std::fs::read(path).unwrap(), b"x");
    }
}
