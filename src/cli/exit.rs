//! Exit codes, in one place.

use std::process::ExitCode;

/// Bad usage or input; clap uses the same for wrong arguments.
pub(super) const BAD_INPUT: u8 = 2;

/// How a command that did its work ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// Everything asked for was done: 0.
    Done,
    /// The work was finished, but a check failed (the state diverged, a mesh is open): 1.
    CheckFailed,
}

impl Outcome {
    pub(super) fn code(self) -> ExitCode {
        match self {
            Self::Done => ExitCode::SUCCESS,
            Self::CheckFailed => ExitCode::from(1),
        }
    }
}

/// True when the reader of our output went away, as `head` does: no error of ours.
pub(super) fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<std::io::Error>())
        .any(|cause| cause.kind() == std::io::ErrorKind::BrokenPipe)
}
