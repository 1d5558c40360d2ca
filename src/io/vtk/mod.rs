//! VTK XML files, which ParaView, PyVista and 3D Slicer open: surfaces (`.vtp`), lattices (`.vtu`), and the list of a
//! sequence with its times (`.pvd`).
//!
//! Arrays are appended raw, little endian, with 64-bit lengths; nothing is compressed, so that writing is as fast as the disk.
//! Units stand in the arrays' names (`displacement_mm`), units and space in the field data too, beside the time
//! (`TimeValue` [s]) and the names of the organs. Places are patient millimetres, RAS+.

mod appended;
mod collection;
mod lattice;
mod surface;

pub use collection::write_pvd;
pub use lattice::{LatticeState, write_vtu};
pub use surface::{Regions, write_vtp, write_vtp_borders};

/// Text as XML holds it between tags and in attributes.
fn escape(text: &str) -> String {
    let entity = |c: char| match c {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        '>' => "&gt;".to_owned(),
        '"' => "&quot;".to_owned(),
        // What XML 1.0 cannot hold at all.
        c if c.is_control() => "?".to_owned(),
        c => c.to_string(),
    };
    text.chars().map(entity).collect()
}
