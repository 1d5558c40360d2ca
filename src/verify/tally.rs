//! Gathers what several trials of one case come to.

use super::Finding;
use crate::dynamics::StepError;

/// The largest error, the steps, and whatever must not have happened.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub(super) error: f64,
    /// The trial with the largest error.
    pub(super) worst: String,
    pub(super) steps: u64,
    pub(super) trials: u64,
    /// Trials that ended in a refusal, as they should or may.
    pub(super) refused: u64,
    faults: Vec<String>,
}

impl Tally {
    /// Takes an error into account; one that is not a number is a fault.
    pub(super) fn error(&mut self, what: impl std::fmt::Display, error: f64) {
        if error.is_nan() {
            return self.fault(format!("{what}: the error is not a number"));
        }
        if error > self.error {
            self.error = error;
            self.worst = what.to_string();
        }
    }

    /// Something that must not happen.
    pub(super) fn fault(&mut self, what: String) {
        self.faults.push(what);
    }

    /// Notes a fault unless `holds`.
    pub(super) fn expect(&mut self, holds: bool, what: impl FnOnce() -> String) {
        if !holds {
            self.fault(what());
        }
    }

    /// A refusal, whose message has to name time, place and what to do, without a number that is none.
    pub(super) fn refusal(&mut self, what: impl std::fmt::Display, error: &StepError) {
        self.refused += 1;
        let text = error.to_string();
        let clear = ["t = ", " s ", " mm: "].iter().all(|part| text.contains(part))
            && ["lower the force", "ask for a smaller time.dt"].iter().any(|part| text.contains(part))
            && !text.contains("NaN");
        self.expect(clear, || format!("{what}: an unclear refusal: {text}"));
    }

    /// The finding; with faults, it tells these instead of what happened.
    pub(super) fn finding(self, allowed: f64, happened: String) -> Finding {
        let Self { error, steps, faults, .. } = self;
        if faults.is_empty() {
            return Finding { happened, error, allowed, steps };
        }
        let more = faults.len() - 1;
        let others = if more > 0 { format!("; and {more} more") } else { String::new() };
        Finding { happened: format!("{}{others}", faults[0]), error: f64::INFINITY, allowed, steps }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_breaks_the_promise_whatever_the_error() {
        let mut tally = Tally::default();
        tally.error("first", 0.5);
        tally.error("second", 0.25);
        assert!(!Tally { error: 0.5, ..Tally::default() }.finding(0.4, String::new()).passed());
        assert!(Tally { error: 0.5, ..Tally::default() }.finding(0.5, String::new()).passed());
        tally.expect(true, || unreachable!());
        tally.expect(false, || "the lamp is out".to_owned());
        tally.error("third", f64::NAN);
        let finding = tally.finding(1.0, "all is well".to_owned());
        assert!(!finding.passed());
        assert_eq!(finding.happened, "the lamp is out; and 1 more");
    }
}
