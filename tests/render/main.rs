//! Pictures: what is where, what hides what, how it is lit, and what is refused.

#[path = "../support/mod.rs"]
mod support;

mod bodies;
mod cubes;
mod light;
mod place;
mod refusals;
mod sections;
