//! The list of a sequence of files with their times.

use std::io::{self, Write};
use std::path::Path;

use super::escape;
use crate::io::atomic;

/// Writes a `.pvd`, by which ParaView opens a sequence as one animation.
/// - `frames`: time [s] and file of each, relative to the folder of `path`.
///
/// # Errors
/// If the file cannot be written.
pub fn write_pvd(path: &Path, frames: &[(f64, String)]) -> io::Result<()> {
    atomic::write_file(path, |out| {
        out.write_all(
            b"<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n",
        )?;
        out.write_all(b"<!-- timestep in s -->\n<Collection>\n")?;
        for (time, file) in frames {
            writeln!(out, "<DataSet timestep=\"{time}\" part=\"0\" file=\"{}\"/>", escape(file))?;
        }
        out.write_all(b"</Collection>\n</VTKFile>\n")
    })
}
