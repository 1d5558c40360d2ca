//! The surface of severed lattices: its topology, its motion, its measures.

mod care;
mod carry;
mod cells;
mod crossing;
mod cuts;
mod fuzz;
mod interfaces;
mod measures;
mod normals;
mod support;
mod walls;
