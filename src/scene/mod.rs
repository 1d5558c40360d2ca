//! Scenes: what to simulate, in TOML.

pub mod resolved;
