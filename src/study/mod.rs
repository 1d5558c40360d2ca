//! What accuracy costs in time, for any scene.
//!
//! ```text
//! probe ──► plan ──► sweep ──► ledger ──► judge ──► plots, tables, report
//! (a few     (what    (runs in   (a line     (errors)
//!  steps)     fits)    turn)      each)
//! ```
//! A choice is an integrator, a step or tolerance, a pitch and an arithmetic ([`choice`]). Every choice is run some times, in turn with the
//! others, so that a noisy machine does not decide ([`sweep`]); its first run is kept as a run directory. What a run took is
//! written down at once ([`ledger`]), and an interrupted study goes on from there. Errors are distances from a finer reference,
//! whose own doubt is known ([`reference`](mod@reference), [`judge`](mod@judge)).
//!
//! Nothing here prints; nothing is decided that a scene would notice.

pub mod choice;
pub mod findings;
pub mod html;
pub mod judge;
pub mod ledger;
pub mod order;
pub mod pareto;
pub mod plan;
pub mod plots;
pub mod probe;
pub mod reference;
pub mod report;
pub mod rounding;
pub mod surface_distance;
pub mod surfaces;
pub mod sweep;
pub mod tables;
