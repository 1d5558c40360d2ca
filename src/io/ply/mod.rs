//! PLY files: vertices with all their attributes, and triangles by index.
//!
//! Ours are binary little endian, in patient millimetres, RAS+, and say so in their comments. All organs go into one file,
//! one after the other; a comment per organ tells which vertices and triangles are its own. An attribute is written
//! when every organ with vertices has it.

mod read;
mod write;

pub use read::read_ply;
pub use write::write_ply;

const FORMAT: &str = "PLY";
