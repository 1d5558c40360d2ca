//! What acts on tissue besides springs, cells, gravity and drives.

#[path = "../rigid/parts.rs"]
#[allow(dead_code)]
mod parts;
#[path = "../support/mod.rs"]
mod support;

mod absent;
mod drag;
mod fibres;
mod inelastic;
mod lips;
mod pressure;
mod sleep;
