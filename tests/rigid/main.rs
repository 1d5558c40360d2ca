//! Rigid parts that move: alone, joined to tissue, driven and cut.

#[path = "../support/mod.rs"]
mod support;

mod cut;
mod driven;
mod joined;
mod parts;
mod spinning;
