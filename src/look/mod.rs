//! Colour: from values to linear RGB.

pub mod colormap;
