//! The same work by another program, in turn with ours: on a machine that others use, only the ratio of neighbours in time
//! tells anything.

use std::process::Command;

use anyhow::{Context, bail};
use serde_json::{Value, json};

use super::super::super::messages::out;
use super::Measured;

/// The other program prints one JSON line with `particle_steps_per_s` and `mean_moved`.
pub(super) fn against(
    command: &str,
    pairs: u32,
    json: bool,
    run: impl Fn() -> anyhow::Result<Measured>,
) -> anyhow::Result<()> {
    let mut ratios = Vec::new();
    let [mut ours, mut theirs] = [Vec::new(), Vec::new()];
    let mut name = String::new();
    for _ in 0..pairs {
        let own = run()?;
        let other = run_other(command)?;
        let number = |key: &str| {
            other[key].as_f64().with_context(|| {
                format!("--against \"{command}\": its last line has no number \"{key}\"; it has to print one JSON object with it")
            })
        };
        let (rate, moved) = (number("particle_steps_per_s")?, number("mean_moved")?);
        name = other["peer"].as_str().unwrap_or("the other program").to_owned();
        // Sums of f32 over millions of particles, taken in another order; and who keeps places as f32, and not what is moved, knows
        // them to the last digit of the lattice's length.
        let tolerance = 1e-3 * own.mean_moved + f64::from(f32::EPSILON) * own.length;
        if (moved - own.mean_moved).abs() > tolerance {
            bail!(
                "--against \"{command}\" did other work: it moved particles by {moved:.6e} m on average, this program by \
                 {:.6e} m; give both the same n and steps",
                own.mean_moved
            );
        }
        ratios.push(own.particle_steps_per_s / rate);
        ours.push(own.particle_steps_per_s);
        theirs.push(rate);
    }
    let [ratio, own, other] = [&mut ratios, &mut ours, &mut theirs].map(|values| {
        values.sort_by(f64::total_cmp);
        [values[0], values[values.len() / 2], values[values.len() - 1]]
    });
    if json {
        let report = json!({
            "peer": name, "pairs": pairs, "ratio": ratio, "particle_steps_per_s": own, "peer_particle_steps_per_s": other,
        });
        return out(&report.to_string());
    }
    out(&format!(
        "{:.1} times as fast as {name} ({:.1} to {:.1} in {pairs} pairs run in turn): {:.1} and {:.1} million \
         particle-steps/s in the middle",
        ratio[1],
        ratio[0],
        ratio[2],
        own[1] * 1e-6,
        other[1] * 1e-6
    ))
}

fn run_other(command: &str) -> anyhow::Result<Value> {
    let mut words = command.split_whitespace();
    let program =
        words.next().context("--against is empty; give it a command, for example \"python peer.py --n 128\"")?;
    let output = Command::new(program)
        .args(words)
        .output()
        .with_context(|| format!("--against \"{command}\": {program} could not be started; check the path"))?;
    if !output.status.success() {
        bail!(
            "--against \"{command}\": ended with {}: {}",
            output.status,
            String::from_utf8_lossy(&output.stderr).trim()
        );
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().rev().find(|line| line.trim_start().starts_with('{'));
    line.and_then(|line| serde_json::from_str(line).ok()).with_context(|| {
        format!("--against \"{command}\": printed no line of JSON; it has to print particle_steps_per_s and mean_moved")
    })
}
