//! `yawara bench`: speed of the parts that matter.

mod care;
mod carry;
mod cut;
mod effects;
mod lattice;
mod render;
mod scene;
mod surface;
mod write;

use super::args::BenchCommand;
use super::exit::Outcome;

pub(super) fn bench(command: &BenchCommand) -> anyhow::Result<Outcome> {
    match command {
        BenchCommand::Lattice(arguments) => lattice::lattice(arguments),
        BenchCommand::Effects(arguments) => effects::effects(arguments),
        BenchCommand::Scene(arguments) => scene::scene(arguments),
        BenchCommand::Surface(arguments) => surface::surface(arguments),
        BenchCommand::Care(arguments) => care::care(arguments),
        BenchCommand::Carry(arguments) => carry::carry(arguments),
        BenchCommand::Cut(arguments) => cut::cut(arguments),
        BenchCommand::Render(arguments) => render::render(arguments),
        BenchCommand::Write(arguments) => write::write(arguments),
    }?;
    Ok(Outcome::Done)
}
