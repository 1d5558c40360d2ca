//! The program itself, run in an empty folder: help, exit codes, messages, and what it leaves on disk.

mod accuracy;
mod animated;
mod bad_input;
mod bad_output;
mod help;
mod interfaces;
mod moduli;
mod nasty;
mod paint;
mod render;
mod runs;
mod same_bits;
mod scene_facts;
mod study;
mod support;
mod whole_way;
