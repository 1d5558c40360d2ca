//! From the lattice to a surface: extraction, carrying, checking.

pub mod mesh;
