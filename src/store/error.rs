//! What can go wrong with a run directory, and what to do about it.

use std::io;
use std::path::{Path, PathBuf};

use crate::lattice::ReplayError;

/// Why a run directory, or a part of it, could not be written. What was written before stays valid.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteRunError {
    /// Something is there already.
    #[error("{}: exists and is not empty; choose another folder, or overwrite the run in it (--overwrite)", path.display())]
    Exists {
        /// The run directory asked for.
        path: PathBuf,
    },
    /// Overwriting was asked for, but the folder holds something else.
    #[error("{}: not a yawara run (no usable manifest.json), so it is not overwritten; choose another folder", path.display())]
    NotARun {
        /// The run directory asked for.
        path: PathBuf,
    },
    /// Overwriting would delete files that no run writes.
    #[error("{}: holds {found:?}, which is not part of a run and would be deleted; move it away or choose another folder", path.display())]
    ForeignFile {
        /// The run directory asked for.
        path: PathBuf,
        /// Name of the file.
        found: String,
    },
    /// A file is where the folder should be.
    #[error("{}: is a file, but a run is a folder; choose another path", path.display())]
    NotAFolder {
        /// The run directory asked for.
        path: PathBuf,
    },
    /// The disk is full.
    #[error("{}: the disk is full; free some space or choose a folder on another disk (earlier frames stay valid)", path.display())]
    DiskFull {
        /// The file that did not fit.
        path: PathBuf,
    },
    /// No permission.
    #[error("{}: not writable ({source}); choose another folder or change its permissions", path.display())]
    NotWritable {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Any other error of the system.
    #[error("{}: could not be written", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// An array has the wrong length.
    #[error("{name}: {found} values given, expected {expected}")]
    WrongLength {
        /// Which array.
        name: String,
        /// Values given.
        found: usize,
        /// Values expected.
        expected: usize,
    },
    /// A displacement is NaN or infinite.
    #[error("frame {frame}: the displacement of particle {particle} is not finite; the frame was not written")]
    NotFinite {
        /// Number the frame would have had.
        frame: usize,
        /// First such particle.
        particle: usize,
    },
    /// A value of a series is NaN or infinite.
    #[error("series `{name}`: value {row} is {value}, expected a finite number; nothing of it was written")]
    SeriesNotFinite {
        /// Name of the series.
        name: String,
        /// Row it would have had.
        row: usize,
        /// The value.
        value: f64,
    },
    /// The list of severed springs no longer begins with the springs of the frame before.
    #[error(
        "frame {frame}: {found} severed springs given, but the frame before had {before} and springs do not grow back"
    )]
    SeveredChanged {
        /// Number the frame would have had.
        frame: usize,
        /// Springs given.
        found: usize,
        /// Springs of the frame before.
        before: usize,
    },
    /// Cuts are taken back.
    #[error("a cut sheet of {found} quads given, but there were {before} already and cuts do not heal")]
    SheetChanged {
        /// Quads given.
        found: usize,
        /// Quads given before.
        before: usize,
    },
    /// A vertex of a cut sheet is NaN or infinite.
    #[error("vertex {vertex} of the cut sheet is not finite; the state has diverged")]
    SheetNotFinite {
        /// Number of the vertex.
        vertex: usize,
    },
    /// The run was given up when something could not be written, which was told then.
    #[error("{}: the run was given up after an error before; frames committed until then stay valid", path.display())]
    GivenUp {
        /// The run directory.
        path: PathBuf,
    },
    /// A name that cannot be a folder everywhere.
    #[error("{name:?} cannot name a series or an array; use 1 to 64 of a-z, 0-9 and _")]
    BadName {
        /// The name given.
        name: String,
    },
    /// A series was continued in another unit.
    #[error("series {name:?} was begun in {before:?} and cannot be continued in {found:?}")]
    UnitChanged {
        /// Name of the series.
        name: String,
        /// Its unit so far.
        before: String,
        /// The unit given.
        found: String,
    },
    /// More particles than a chunk can hold.
    #[error("{particles} particles are too many for one run; at most {most} can be stored")]
    TooManyParticles {
        /// Particles of the lattice.
        particles: usize,
        /// Most that fit.
        most: usize,
    },
}

impl WriteRunError {
    /// Sorts an error of the system by who can act on it.
    pub(super) fn io(path: &Path, source: io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::DiskFull { path },
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => Self::NotWritable { path, source },
            _ => Self::Io { path, source },
        }
    }
}

/// Why a run, or a part of it, could not be read. Other parts may still be readable.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadRunError {
    /// There is no run at this path.
    #[error("{}: not a yawara run (no manifest.json); give the folder that `run -o` wrote", path.display())]
    NotARun {
        /// The path given.
        path: PathBuf,
    },
    /// Written by a newer program.
    #[error("{}: format version {found} is unknown (this program reads version {known}); use the yawara that wrote it", path.display())]
    UnknownVersion {
        /// The manifest.
        path: PathBuf,
        /// Version found.
        found: u32,
        /// Version this program reads.
        known: u32,
    },
    /// A JSON file does not hold what it should.
    #[error("{}: {message}; the file was changed or damaged, so take it from a copy or run the scene again", path.display())]
    BadJson {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column where known.
        message: String,
    },
    /// A chunk of an array is torn or its checksum does not match.
    #[error("{}: damaged: {message}; other frames may be whole, so choose another frame or run the scene again", path.display())]
    Damaged {
        /// The chunk's file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// Two parts of a run do not belong together.
    #[error("{}: {message}; parts of different runs were mixed, or a file was changed: run the scene again", path.display())]
    Inconsistent {
        /// The file or array.
        path: PathBuf,
        /// What does not fit, with both values.
        message: String,
    },
    /// A frame that is not there.
    #[error("{}: frame {asked} asked for, but the run has {frames} (numbered from 0)", path.display())]
    NoSuchFrame {
        /// The run.
        path: PathBuf,
        /// Frame asked for.
        asked: usize,
        /// Frames that are there.
        frames: usize,
    },
    /// A series or extra array that is not there.
    #[error("{}: no such array; there are: {}", path.display(), known.join(", "))]
    NoSuchArray {
        /// Where it would be.
        path: PathBuf,
        /// What is there.
        known: Vec<String>,
    },
    /// The severed springs do not fit the lattice.
    #[error("{}: {source}", path.display())]
    BadSevered {
        /// Folder of the severed springs.
        path: PathBuf,
        /// Which one, and why.
        source: ReplayError,
    },
    /// Any error of the system.
    #[error("{}: could not be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}
