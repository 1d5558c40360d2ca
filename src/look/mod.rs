//! Colour: from values to linear RGB.
//!
//! ```text
//! rest        a carried mesh taken back to rest: places, directions into the tissue, distance from the skin
//! hu          the CT there: faces of cuts show the inside of the organ
//! particles   values of particles there: strain, velocity
//! strain      equivalent strain of each particle
//! transfer    CT numbers to the colours of an organ
//! colormap    values to colours
//! detail      what no CT resolves
//! paint       attributes of a mesh to its colours
//! ```

pub mod colormap;
pub mod detail;
pub mod hu;
pub mod paint;
pub mod particles;
pub mod rest;
pub mod strain;
pub mod transfer;
