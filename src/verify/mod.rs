//! What the program promises, tried out: solids and waves against answers known in advance, and hard cases that must end in a
//! right answer or in a clear refusal.
//!
//! Every [`Case`] says what is asked, does it, and reports a [`Finding`] with its largest error and what is allowed. The same
//! cases are the tests of the library and the page that `yawara verify` writes.

mod bodies;
mod free;
mod hard;
mod lattices;
mod report;
mod solids;
mod statics;
mod step;
mod tally;
mod volume;
mod waves;

pub use report::markdown;

/// One promise and how to try it out.
#[derive(Clone, Copy)]
pub struct Case {
    /// Which part of the page it belongs to.
    pub group: Group,
    /// Its name: lower case, words joined by hyphens.
    pub name: &'static str,
    /// What is asked, in a sentence without a full stop.
    pub asked: &'static str,
    /// Does it. Takes from milliseconds to some seconds on two cores.
    pub run: fn() -> Finding,
}

/// Parts of the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// Elastic constants, bars and beams.
    Solids,
    /// Frequencies and wave speeds.
    Waves,
    /// Momentum, energy, rotation.
    Free,
    /// The largest stable step.
    Step,
    /// States and scenes that break other programs.
    Hard,
}

impl Group {
    /// Heading of its part of the page.
    pub fn title(self) -> &'static str {
        match self {
            Self::Solids => "Solids at rest",
            Self::Waves => "Waves and vibrations",
            Self::Free => "Free bodies",
            Self::Step => "The stable step",
            Self::Hard => "Hard cases",
        }
    }
}

/// What came of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What happened, with figures and units.
    pub happened: String,
    /// The largest error, in the measure that `happened` names.
    pub error: f64,
    /// The largest error that is allowed.
    pub allowed: f64,
    /// Time steps taken in all; 0 for what is solved and not stepped.
    pub steps: u64,
}

impl Finding {
    /// Whether the promise is kept. An error that is not a number breaks it.
    pub fn passed(&self) -> bool {
        self.error <= self.allowed
    }
}

/// All cases, in the order of the page.
pub fn cases() -> Vec<Case> {
    [solids::cases(), volume::cases(), waves::cases(), free::cases(), step::cases(), hard::cases()].concat()
}
