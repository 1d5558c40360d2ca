//! Volumes in and out: NIfTI files of every kind, real and broken, and what the volume module makes of them.

mod broken;
mod builder;
mod corruption;
mod found;
mod real;
mod round_trip;
mod stress;
mod support;
mod written;
