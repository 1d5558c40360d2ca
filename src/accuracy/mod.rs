//! `accuracy = 0.01` in a scene: the program chooses pitch, integrator and step, and says what it reached.
//!
//! ```text
//! probes (coarse lattices) ──► choice ──► run ──► judge ──► kept
//!                                ▲                  │
//!                                └──── again ◄──────┴────► missed
//! ```
//! **What is promised.** The error of a run is the root mean square over the soft tissue of how far its particles are from
//! where vanishing pitch and step would have them, at the worst of up to [`trial::INSTANTS`] frames, over the largest displacement
//! of any of them. The tissue is that of the scene without `accuracy`: a `damping_ratio` stands for the viscosity that it has at the
//! volume's own spacing. Where a scene names its pitch (or has model `paper`, whose constants belong to one), that lattice is
//! what it asks for, and the error is that of stepping alone.
//!
//! **How.** A lattice with twice the pitch costs a sixteenth. So the search begins with coarse ones ([`search`]): there longer against
//! shorter steps tell what stepping costs (`steps`), and what a finer lattice changes tells the power of the pitch that the error
//! follows (`space`). It goes on in short strides (`pitches`), as all lattices before the last cost together about as much as that one. Each run is judged by the coarser ones before it, or by one with other steps. All choices rest on counted
//! steps, never on a clock, so that the same scene makes the same choices on every machine. It takes a finer lattice to know what a
//! coarser one errs by: once a run is good enough, the coarser pitches that were passed over, which cost little beside it, are tried, and the
//! coarsest that keeps the bound as well is told, for scenes like it.
//!
//! **When it fails.** Half-spaces and blades that take in other particles at each pitch, contact and borders drawn in voxels converge
//! slowly or by leaps. When no lattice that can be paid for reaches the bound, the run is made at
//! the volume's own spacing, and the estimate and the pitch it would take are told.

mod pitches;
pub mod search;
mod space;
mod steps;
pub mod trial;

pub use search::{AccuracyError, Estimate, Search, Verdict};
pub use trial::{Choice, Collector, Trial};
