//! OBJ files: what nearly every program opens. An object and a material (`.mtl`, beside it) for each organ, normals, and
//! colours of vertices as `v x y z r g b`, which is in wide use though no part of the format.
//!
//! Ours are in patient millimetres, RAS+, and say so in a comment. Colours are sRGB, in both files, as readers take them to
//! be. Labels, displacements and what else a vertex has are lost: PLY, glTF and VTK keep them.
//!
//! Not guaranteed: that a file cut short is noticed. The format has no end, and a part of a file is a file.

mod read;
mod write;

pub use read::read_obj;
pub use write::write_obj;

const FORMAT: &str = "OBJ";
