//! What the user reads: results on standard output, everything else on standard error.

use std::fmt::Display;
use std::io::{self, IsTerminal, Write};

use anyhow::Context;

/// Prints messages, unless asked to be quiet. Errors and warnings are never silenced.
#[derive(Debug, Clone, Copy)]
pub(super) struct Messages {
    quiet: bool,
}

impl Messages {
    pub(super) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// True when a progress bar may be drawn.
    pub(super) fn shows_progress(&self) -> bool {
        !self.quiet && io::stderr().is_terminal()
    }

    /// What is going on.
    pub(super) fn note(&self, text: impl Display) {
        if !self.quiet {
            // Nothing can be done when standard error is gone.
            let _ = writeln!(io::stderr(), "{text}");
        }
    }

    /// Something that was done, but is probably not meant.
    pub(super) fn warning(&self, text: impl Display) {
        let _ = writeln!(io::stderr(), "warning: {text}");
    }

    /// Why nothing more is done, with its causes.
    pub(super) fn error(&self, error: &anyhow::Error) {
        let mut text = error.to_string();
        for cause in error.chain().skip(1) {
            let cause = cause.to_string();
            // Many messages already end with their cause.
            if !text.contains(&cause) {
                text.push_str(": ");
                text.push_str(&cause);
            }
        }
        let _ = writeln!(io::stderr(), "error: {text}");
    }
}

/// Writes to standard output.
pub(super) fn out(text: &str) -> anyhow::Result<()> {
    write_out(text).context("standard output: could not be written")
}

fn write_out(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    if !text.ends_with('\n') {
        stdout.write_all(b"\n")?;
    }
    stdout.flush()
}
