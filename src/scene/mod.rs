//! Scenes: what to simulate, in TOML.
//!
//! ```text
//! text ──► Source (places) ──► schema (types) ──► resolve (checks, SI units, defaults) ──► resolved::Scene
//! ```
//! [`load`] reads a file, [`parse`] a text. Either gives a [`resolved::Scene`] with warnings, or every problem found,
//! each with file, line, column, key, value and what was expected. Syntax errors, unknown keys and values of the wrong
//! type stop the reading, so they come alone.
//!
//! Not promised: that the files a scene names exist, that its organs have voxels, that its regions hold particles, or
//! that a given `dt` is stable. Those who open, build and step say so.

mod bodies;
mod checks;
pub(crate) mod color;
mod diagnostics;
mod inelastic;
mod json_schema;
mod look;
mod obstacles;
mod operations;
mod organs;
mod problem;
mod property;
mod regions;
mod resolve;
pub mod resolved;
mod schema;
mod values;
mod written_property;

use std::fmt;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Deserialize;

pub use diagnostics::{Located, Place};
pub use json_schema::json_schema;
pub use problem::{Caution, Problem};
pub use resolve::LabelLookup;
use resolved::Scene;

/// Something that can be run but is probably not meant, and where it stands.
pub type Warning = Located<Caution>;

/// The scene that `yawara demo` runs: the phantom's liver, held at the back, cut from the front, one lip pulled.
pub const QUICKSTART: &str = include_str!("../../fixtures/scenes/quickstart.toml");

/// Longest scene that is read [bytes]; a longer file is no scene but a volume given in its place.
const MAX_BYTES: u64 = 4 << 20;

/// Why there is no scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file cannot be read, or holds no UTF-8 text.
    #[error("{}: could not read the scene; expected a TOML text file", path.display())]
    Read {
        /// The scene file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is too long to be a scene.
    #[error("{}: more than {limit} bytes, too long for a scene; expected a TOML text file", path.display())]
    TooLong {
        /// The scene file.
        path: PathBuf,
        /// Most bytes of a scene.
        limit: u64,
    },
    /// Something in the scene is wrong; at least one problem.
    #[error("{}", Several(problems))]
    Invalid {
        /// All problems found, in the order of the text.
        problems: Vec<Located<Problem>>,
    },
}

struct Several<'p>(&'p [Located<Problem>]);

impl fmt::Display for Several<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, problem) in self.0.iter().enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            write!(f, "{problem}")?;
        }
        Ok(())
    }
}

/// Reads and checks a scene file. Relative paths in it count from its folder; the scene holds them made absolute, so
/// that it can be kept and read from elsewhere.
///
/// # Errors
/// If the file cannot be read, or with everything that is wrong in it.
pub fn load(path: &Path, label_names: &dyn LabelLookup) -> Result<(Scene, Vec<Warning>), SceneError> {
    let failed = |source| SceneError::Read { path: path.to_owned(), source };
    let mut text = String::new();
    let file = std::fs::File::open(path).map_err(failed)?;
    let read = file.take(MAX_BYTES + 1).read_to_string(&mut text);
    // Checked first: the cut at the limit can itself break a character.
    if read.as_ref().map_or_else(|_| path.metadata().is_ok_and(|m| m.len() > MAX_BYTES), |&n| n as u64 > MAX_BYTES) {
        return Err(SceneError::TooLong { path: path.to_owned(), limit: MAX_BYTES });
    }
    read.map_err(failed)?;
    let absolute = std::path::absolute(path).map_err(failed)?;
    let folder = absolute.parent().unwrap_or(Path::new(""));
    parse(&text, path, folder, label_names)
}

/// Checks a scene given as text. `file` is the name shown in messages; relative paths count from `folder`.
///
/// # Errors
/// With everything that is wrong in the scene.
pub fn parse(
    text: &str,
    file: &Path,
    folder: &Path,
    label_names: &dyn LabelLookup,
) -> Result<(Scene, Vec<Warning>), SceneError> {
    let invalid = |problems| SceneError::Invalid { problems };
    let source = diagnostics::Source::parse(text, file).map_err(invalid)?;
    let written =
        schema::SceneFile::deserialize(source.document()).map_err(|error| invalid(vec![source.error(&error)]))?;
    resolve::resolve(&written, &source, folder, label_names).map_err(invalid)
}
