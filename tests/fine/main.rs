//! Surfaces finer than the lattice that carries them.

#[path = "../support/mod.rs"]
mod support;

mod bodies;
mod carrying;
mod cuts;
mod hinges;
mod organs;
mod rims;
mod shared;
