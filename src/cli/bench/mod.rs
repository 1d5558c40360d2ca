//! `yawara bench`: speed of the parts that matter.

mod lattice;
mod render;
mod surface;

use super::args::BenchCommand;
use super::exit::Outcome;

pub(super) fn bench(command: &BenchCommand) -> anyhow::Result<Outcome> {
    match command {
        BenchCommand::Lattice(arguments) => lattice::lattice(arguments),
        BenchCommand::Surface(arguments) => surface::surface(arguments),
        BenchCommand::Render(arguments) => render::render(arguments),
    }?;
    Ok(Outcome::Done)
}
