//! The run directory: what a simulation leaves on disk, readable without this program.
//!
//! ```text
//! run/
//!   manifest.json        who, when, from what, how far (see [`Manifest`])
//!   scene.toml           the scene as written, if there was one
//!   scene.json           the scene after checking
//!   log.txt              one line per event
//!   arrays.zarr/         Zarr version 3: bytes, Blosc (zstd after byte shuffle), CRC-32C
//!     lattice/           grid_shape [3] · affine [4, 4] index to RAS+ mm · pitch [1] m · points [n] linear grid index
//!                        ijk [n, 3] · rest [n, 3] mm · organ [n] · springs [n] one bit per direction
//!     extra/NAME         arrays the caller adds
//!     frames/            displacement [frames, n, 3] mm RAS+, one chunk per frame · time [frames] s
//!                        step [frames] · severed_count [frames]
//!     severed/           particle · direction · at · time, in the order of severing
//!     cuts/              where blades went, at rest: vertex [n, 3] mm RAS+ · quad [m, 4] · time [m] s, ascending
//!     series/NAME        growing lists of numbers
//! ```
//! The springs of frame `i` are those of `lattice/springs` less the first `severed_count[i]` of `severed/`; of the cuts it has
//! the quads whose time is not after its own.
//!
//! A run appears whole: [`RunWriter::create`] builds it under another name beside and renames it. Every file is written
//! under a temporary name, synced and renamed, and a frame counts only when the length of `displacement` says so, which
//! is written after all its parts. Whatever moment the program or the machine stops at, the frames before stay readable;
//! [`RunReader`] tells an interrupted run from a complete one.
//!
//! Not guaranteed: `log.txt` may end in a torn line; two writers on one run are not noticed; temporary files
//! (`.yawara-*.part`) of an interrupted write stay until the run is deleted.

mod array;
mod background;
mod codec;
mod error;
mod manifest;
mod place;
mod reader;
mod writer;

pub use background::BackgroundWriter;
pub use error::{ReadRunError, WriteRunError};
pub use manifest::{InputFile, Manifest, Program, Status};
pub use reader::{ExtraArray, Frame, RunReader, Series};
pub use writer::{Extra, ExtraValues, FrameData, RunHeader, RunWriter};

/// Name of the Zarr hierarchy inside a run.
const ARRAYS: &str = "arrays.zarr";
/// Everything a run holds at its top; overwriting deletes nothing else.
const TOP: [&str; 5] = ["manifest.json", "scene.toml", "scene.json", "log.txt", ARRAYS];
