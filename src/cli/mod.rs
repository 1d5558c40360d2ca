//! The command line: the only place that prints or exits.
//!
//! One file per subcommand. Results go to standard output, messages and progress to standard error; progress only on a
//! terminal.

mod accuracy;
mod args;
mod bench;
mod check;
mod demo;
mod examine;
mod exit;
mod facts;
mod info;
mod mesh;
mod messages;
mod paint;
mod phantom;
mod pictures;
mod progress;
mod render;
mod render_arguments;
mod run;
mod scene;
mod scene_facts;
mod slice;
mod source;
mod study;
mod surface;
mod verify;
mod volume;

use std::process::ExitCode;

use anyhow::Context;
use clap::{CommandFactory, Parser};

use args::{Arguments, Command};
use exit::Outcome;
use messages::{Messages, out};

use crate::kernel::dispatch::InstructionSet;

/// Parses the command line, does what it asks, and gives the exit code: see [`exit`](self).
pub fn main() -> ExitCode {
    // clap prints help and usage errors itself, with codes 0 and 2.
    let arguments = Arguments::parse();
    let messages = Messages::new(arguments.quiet);
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
        if let Err(error) = pool {
            messages.error(&anyhow::Error::new(error).context("could not start the worker threads"));
            return ExitCode::from(exit::BAD_INPUT);
        }
    }
    if let Err(problem) = InstructionSet::asked_for() {
        messages.error(&anyhow::Error::msg(problem));
        return ExitCode::from(exit::BAD_INPUT);
    }
    match dispatch(arguments.command, &messages) {
        Ok(outcome) => outcome.code(),
        Err(error) if exit::is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            messages.error(&error);
            ExitCode::from(exit::BAD_INPUT)
        }
    }
}

fn dispatch(command: Command, messages: &Messages) -> anyhow::Result<Outcome> {
    match command {
        Command::Demo(arguments) => demo::demo(&arguments, messages),
        Command::Run(arguments) => run::run(&arguments, messages),
        Command::Mesh(arguments) => mesh::mesh(&arguments, messages),
        Command::Slice(arguments) => slice::slice(&arguments, messages),
        Command::Render(arguments) => render::render(&arguments, messages),
        Command::Study(arguments) => study::study(&arguments, messages),
        Command::Verify(arguments) => verify::verify(&arguments, messages),
        Command::Volume(arguments) => volume::volume(&arguments, messages),
        Command::Phantom(arguments) => phantom::phantom(&arguments),
        Command::Info(arguments) => info::info(&arguments, messages),
        Command::Check(arguments) => check::check(&arguments, messages),
        Command::Scene(arguments) => scene::scene(&arguments, messages),
        Command::Bench(arguments) => bench::bench(&arguments),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "yawara", &mut script);
            out(&String::from_utf8_lossy(&script))?;
            Ok(Outcome::Done)
        }
        Command::Man { command } => {
            let mut program = Arguments::command();
            // Gives every subcommand its full name and the global options.
            program.build();
            let page_of = match command {
                Some(name) => program.find_subcommand(&name).cloned().with_context(|| {
                    let known: Vec<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
                    format!("there is no command `{name}`; there are {}", known.join(", "))
                })?,
                None => program,
            };
            let mut page = Vec::new();
            clap_mangen::Man::new(page_of).render(&mut page)?;
            out(&String::from_utf8_lossy(&page))?;
            Ok(Outcome::Done)
        }
    }
}
