//! Blades against brute force, what a cut may and may not change, and the order of a time line.

#[path = "../support/mod.rs"]
mod support;

mod halves;
mod moving;
mod oracle;
mod sweeps;
mod timeline;
