//! A study in sentences: a page of Markdown that says what each digit costs.

use std::fmt::{self, Write};

use super::choice::{Arithmetic, Choice, LONG_STEP, METHODS, TOLERANCE};
use super::findings::{Findings, Row, TimeOrder};
use super::ledger::Ledger;
use super::order::fit;
use super::pareto::cheapest;
use super::plan::Plan;
use super::plots::{ERROR_TIME, INTEGRATORS, ORDERS, PITCHES, SURFACES};
use crate::dynamics::integrator::Method;

/// Relative errors that are asked for.
const ASKED: [(f64, &str); 4] = [(0.1, "10 %"), (0.01, "1 %"), (1e-3, "0.1 %"), (1e-4, "0.01 %")];
/// Times that differ by less are not told apart.
const ALIKE: f64 = 1.1;

/// What the page says besides what was found.
pub struct Page<'a> {
    /// Name of the scene's file.
    pub scene: &'a str,
    /// What made the study.
    pub command: &'a str,
    /// Folder of the study, as it is given in commands.
    pub folder: &'a str,
    /// Threads and instruction set.
    pub machine: &'a str,
    /// Pictures that were written.
    pub pictures: &'a [&'static str],
    /// Instants that were compared.
    pub instants: usize,
    /// What the study was allowed to take \[s\].
    pub budget_seconds: f64,
}

/// Writes the page.
///
/// # Panics
/// Never: writing to a string does not fail.
pub fn markdown(page: &Page<'_>, findings: &Findings, plan: &Plan, ledger: &Ledger) -> String {
    let mut text = String::new();
    write_page(&mut text, page, findings, plan, ledger).expect("text");
    text
}

/// A share as percent, with two digits that count.
fn percent(share: f64) -> String {
    format!("{} %", two(100.0 * share))
}

/// Two digits that count.
fn two(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (1 - value.abs().log10().floor() as i32).max(0) as usize;
    if digits > 6 { format!("{value:.1e}") } else { format!("{value:.digits$}") }
}

fn seconds(value: f64) -> String {
    if value < 0.1 { format!("{} ms", two(1e3 * value)) } else { format!("{} s", two(value)) }
}

fn described(choice: &Choice) -> String {
    let Choice { integrator, pitch_mm, fineness, arithmetic } = choice;
    let longest = if integrator.is_stable_at_any_step() { "its longest step" } else { "its largest stable step" };
    let step = match choice.tolerance() {
        Some(tolerance) => format!("tolerance {} mm", two(1e3 * tolerance)),
        None if *fineness == 1.0 => longest.to_owned(),
        None if *fineness < 1.0 => format!("{} times {longest}", two(1.0 / fineness)),
        None => format!("1/{fineness} of {longest}"),
    };
    let numbers = if *arithmetic == Arithmetic::Fast { String::new() } else { format!(", {arithmetic}") };
    format!("{pitch_mm} mm, {}, {step}{numbers}", integrator.name())
}

fn write_page(text: &mut String, page: &Page<'_>, findings: &Findings, plan: &Plan, ledger: &Ledger) -> fmt::Result {
    let largest = findings.largest_mm;
    writeln!(text, "# What accuracy costs: {}\n", page.scene)?;
    writeln!(text, "Written by `{}` (yawara {}; {}).\n", page.command, env!("CARGO_PKG_VERSION"), page.machine)?;

    writeln!(text, "## In short\n")?;
    for sentence in summary(findings) {
        writeln!(text, "- {sentence}")?;
    }
    cheapest_choices(text, findings)?;

    writeln!(text, "\n## How it was measured\n")?;
    writeln!(
        text,
        "Every choice of integrator, step, pitch and arithmetic ran in turn with the others, round after round; times are the \
         shortest of its repeats, of stepping alone (reading, assembling and writing are the same whatever the step). Runs are \
         compared at {} evenly spaced instants; the worst counts. Particles of the fringe around the tissue and of bone are left out.\n\n\
         *Relative error* is a distance over the largest displacement of any particle at any instant, here {} mm; *rms* is the root \
         of the mean square over the tissue, *max* the particle that is off most, *99 %* what 99 of 100 particles keep to.\n\n\
         Steps count from the largest stable one of each integrator itself; {} of the plain one stand for the longest step of \
         `backward_euler`, which is stable at any. `bogacki_shampine` divides its steps by their error: its finenesses ask for a \
         tolerance of {TOLERANCE:e} pitches over their cube, and the step told is the mean one.\n",
        page.instants,
        two(largest),
        LONG_STEP
    )?;
    let name = |extrapolated: bool| {
        if extrapolated { "the limit of vanishing steps (Richardson), from its finest runs" } else { "its finest run" }
    };
    for level in &findings.levels {
        let doubt = level.doubt.map_or("in unknown doubt: one run alone".to_owned(), |doubt| {
            format!(
                "in doubt by {} (rms) and {} (max)",
                percent(doubt.rms_mm / largest),
                percent(doubt.max_mm / largest)
            )
        });
        writeln!(
            text,
            "- {} mm ({} particles) is judged by `{}`: {}, which is {doubt}.",
            level.pitch_mm,
            level.particles,
            findings.judge.name(),
            name(level.extrapolated)
        )?;
    }
    writeln!(text, "\nErrors less than ten times the doubt about their reference are marked `?`: not resolved.")?;
    if findings.cuts_differ {
        writeln!(
            text,
            "\nThe scene has cuts. A spring is severed where the blade meets it, and that differs a little from step to step: \
             particles beside the cut then jump from one lip to the other, and *max* says more about these few than about the \
             tissue. The root mean square and the 99 % are robust. Between pitches, particles are compared by their place at rest, and \
             places in cells that were cut are left out."
        )?;
    }

    steps(text, page, findings)?;
    pitches(text, page, findings)?;
    surfaces(text, page, ledger)?;
    arithmetic(text, findings, ledger)?;
    if page.pictures.contains(&ERROR_TIME) {
        writeln!(text, "\n## All choices\n\n![Error against time]({ERROR_TIME})\n")?;
        writeln!(
            text,
            "The ringed choices are worth their time: they are better by 2 % or more than all that are faster. All numbers are in `results.csv` and \
             `results.json`; each run is a run directory, so `yawara render {}/runs/{} -o picture.png` shows one.",
            page.folder,
            findings.rows.first().map_or(String::new(), |row| row.choice.key())
        )?;
    }
    left_out(text, page, findings, plan, ledger)
}

/// What a stranger should know first.
fn summary(findings: &Findings) -> Vec<String> {
    let largest = findings.largest_mm;
    let mut sentences = Vec::new();
    let base = findings.levels.iter().find(|level| level.pitch_mm == findings.base_mm);
    let of_base = |row: &&Row| row.choice.pitch_mm == findings.base_mm && !row.reference;
    let rows: Vec<&Row> = findings.rows.iter().filter(of_base).collect();
    if let Some((row, error)) = rows.first().and_then(|row| Some((row, row.time_error?))) {
        sentences.push(format!(
            "At the scene's pitch of {} mm the largest stable step of {} ({}, {} steps, {}) is off by {} (rms; {} for the \
             particle that is off most) of the largest displacement, {} mm.",
            findings.base_mm,
            row.choice.integrator.name(),
            seconds(row.dt_s),
            row.steps,
            seconds(row.least_seconds()),
            percent(error.rms_mm / largest),
            percent(error.max_mm / largest),
            two(largest)
        ));
    }
    sentences.extend(cheapest_integrators(findings));
    let orders = base.map_or(&[][..], |level| &level.time_orders);
    let named = |order: &TimeOrder| {
        let theory = order.integrator.order().unwrap_or(0);
        format!("{} {:.2} ({theory} in theory)", order.integrator.name(), order.law.slope)
    };
    if !orders.is_empty() {
        sentences.push(format!(
            "Errors of the step go with these powers of it: {}.",
            orders.iter().map(named).collect::<Vec<_>>().join(", ")
        ));
    }
    let digits: Vec<String> = orders
        .iter()
        .filter_map(|&TimeOrder { integrator, .. }| {
            let own = |row: &&&Row| {
                row.shows_order && row.choice.integrator == integrator && row.choice.arithmetic == findings.usual
            };
            let points: Vec<[f64; 2]> =
                rows.iter().filter(own).filter_map(|row| Some([row.time_error?.rms_mm, row.least_seconds()])).collect();
            let cost = fit(&points)?;
            Some(format!("{} {}", integrator.name(), two(10_f64.powf(-cost.slope))))
        })
        .collect();
    if !digits.is_empty() {
        sentences.push(format!("A digit more costs so many times the time: {}.", digits.join(", ")));
    }
    let space = base.and_then(|level| level.space_error);
    if let (Some(space), Some(law)) = (space, findings.space_law) {
        let finest = findings.levels.last().map_or(0.0, |level| level.pitch_mm);
        let how = if law.found {
            format!(
                "if it goes with the power {:.2} of the pitch, as {} pitches seen against {finest} mm suggest",
                law.order, law.pitches
            )
        } else {
            format!(
                "if it goes with the power {:.1} of the pitch, which the pitches of this study do not show",
                law.order
            )
        };
        sentences.push(format!(
            "The pitch of {} mm is off by {} (rms), {how}.",
            findings.base_mm,
            percent(space.rms_mm / largest)
        ));
        if let Some(time) = rows.first().and_then(|row| row.time_error) {
            sentences.push(if space.rms_mm > 2.0 * time.rms_mm {
                format!(
                    "So the pitch decides, not the step: its error is {} times that of the largest stable step, and finer \
                     steps at this pitch are time wasted.",
                    two(space.rms_mm / time.rms_mm)
                )
            } else if time.rms_mm > 2.0 * space.rms_mm {
                "So the step decides: finer steps come before finer pitches.".to_owned()
            } else {
                "Step and pitch are off by about as much: both have to be refined together.".to_owned()
            });
        }
    } else {
        sentences.push("What the pitch costs was not measured: there is but one.".to_owned());
    }
    if findings.rows.iter().all(|row| row.same_bits) {
        sentences.push("All repeats of a run came to the same bits.".to_owned());
    } else {
        sentences.push("**Repeats of a run came to different bits: that is a bug, please report it.**".to_owned());
    }
    sentences
}

/// Which integrator is the cheapest for each error asked for, by the step alone at the scene's pitch.
fn cheapest_integrators(findings: &Findings) -> Option<String> {
    let of_grid = |row: &&Row| {
        row.choice.pitch_mm == findings.base_mm && row.choice.arithmetic == findings.usual && !row.reference
    };
    let rows: Vec<&Row> = findings.rows.iter().filter(of_grid).collect();
    let error = |row: &Row| row.time_error.map_or(f64::NAN, |error| error.rms_mm / findings.largest_mm);
    let least = |integrator: Method, asked: f64| {
        let own = rows.iter().filter(|row| row.choice.integrator == integrator && error(row) <= asked);
        own.min_by(|a, b| a.least_seconds().total_cmp(&b.least_seconds())).copied()
    };
    let tried = METHODS.iter().filter(|&&method| rows.iter().any(|row| row.choice.integrator == method)).count();
    if tried < 2 {
        return None;
    }
    let answer = |(asked, name): (f64, &str)| {
        let mut best: Vec<&Row> = METHODS.iter().filter_map(|&integrator| least(integrator, asked)).collect();
        best.sort_by(|a, b| a.least_seconds().total_cmp(&b.least_seconds()));
        let Some(first) = best.first() else { return format!("{name}: none of the grid") };
        let alike = best[1..].iter().filter(|row| row.least_seconds() < ALIKE * first.least_seconds());
        let alike: Vec<&str> = alike.map(|row| row.choice.integrator.name()).collect();
        let alike = if alike.is_empty() { String::new() } else { format!("; as fast: {}", alike.join(", ")) };
        let unsure = if first.time_resolved { "" } else { " ?" };
        let is_off = percent(error(first));
        format!(
            "{name}: {} ({}, off by {is_off}{unsure}{alike})",
            first.choice.integrator.name(),
            seconds(first.least_seconds())
        )
    };
    Some(format!(
        "By the step alone, the cheapest integrator at {} mm for an error (rms) of {}.",
        findings.base_mm,
        ASKED.map(answer).join(", of ")
    ))
}

/// The cheapest choice for each error asked for.
fn cheapest_choices(text: &mut String, findings: &Findings) -> fmt::Result {
    // Other numbers are there only for comparison.
    let grid = || findings.rows.iter().filter(|row| !row.reference && row.choice.arithmetic == findings.usual);
    type Measure = fn(&Row) -> Option<f64>;
    let of_step = |row: &Row| row.time_error.map(|error| error.rms_mm);
    let own: [(&str, bool, Measure); 4] = [
        ("step alone, rms", true, |row| row.time_error.map(|error| error.rms_mm)),
        ("step alone, max", true, |row| row.time_error.map(|error| error.max_mm)),
        ("step and pitch, rms", false, |row| row.error.map(|error| error.rms_mm)),
        ("step and pitch, max", false, |row| row.error.map(|error| error.max_mm)),
    ];
    writeln!(text, "\nThe cheapest choice for an error of at most\n")?;
    writeln!(text, "| of | {} |\n|---|---|---|---|---|", ASKED.map(|(_, name)| name).join(" | "))?;
    for (name, at_base, measure) in own {
        // Of the step alone, pitches cannot be compared: the scene's is kept.
        let rows: Vec<&Row> = grid().filter(|row| !at_base || row.choice.pitch_mm == findings.base_mm).collect();
        let points: Vec<[f64; 2]> = rows
            .iter()
            .map(|row| [row.least_seconds(), measure(row).map_or(f64::NAN, |error| error / findings.largest_mm)])
            .collect();
        if points.iter().all(|point| !point[1].is_finite()) {
            continue;
        }
        let best = points.iter().map(|point| point[1]).filter(|e| e.is_finite()).fold(f64::INFINITY, f64::min);
        let cells = ASKED.map(|(asked, _)| match cheapest(&points, asked) {
            Some(n) => {
                let unsure = if at_base && of_step(rows[n]).is_some() && !rows[n].time_resolved { " ?" } else { "" };
                format!("{}: {}{unsure}", described(&rows[n].choice), seconds(points[n][0]))
            }
            None => format!("none of the grid (best {})", percent(best)),
        });
        writeln!(text, "| {name} | {} |", cells.join(" | "))?;
    }
    Ok(())
}

fn steps(text: &mut String, page: &Page<'_>, findings: &Findings) -> fmt::Result {
    let largest = findings.largest_mm;
    writeln!(
        text,
        "\n## The step\n\nRuns against the reference of their own lattice, relative; volume and energy against its finest run.\n"
    )?;
    writeln!(
        text,
        "| choice | step | steps | time (median) | rms | 99 % | max | volume | energy | surface at the end, mean and Hausdorff [mm] |"
    )?;
    writeln!(text, "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")?;
    for row in &findings.rows {
        let Row { choice, dt_s, steps, time_error, time_resolved, volume_error, energy_error, surface, .. } = row;
        let mark = if *time_resolved { "" } else { " ?" };
        let [rms, most, max] = match time_error {
            Some(e) => [e.rms_mm, e.most_mm, e.max_mm].map(|mm| format!("{}{mark}", percent(mm / largest))),
            None => ["-", "-", "-"].map(str::to_owned),
        };
        let share = |value: &Option<f64>| value.map_or("-".to_owned(), percent);
        let surface = surface.map_or("-".to_owned(), |s| format!("{}, {}", two(s.mean_mm), two(s.hausdorff_mm)));
        let reference = if row.reference { " (reference)" } else { "" };
        let divided = if row.divided > 0 { format!(" ({} divided)", row.divided) } else { String::new() };
        writeln!(
            text,
            "| {}{reference} | {} | {steps}{divided} | {} ({}) | {rms} | {most} | {max} | {} | {} | {surface} |",
            described(choice),
            seconds(*dt_s),
            seconds(row.least_seconds()),
            seconds(row.median_seconds()),
            share(volume_error),
            share(energy_error),
        )?;
    }
    for (name, picture) in [("Error of the step against time", INTEGRATORS), ("Error of the step", ORDERS)] {
        if page.pictures.contains(&picture) {
            writeln!(text, "\n![{name}]({picture})")?;
        }
    }
    writeln!(text, "\nObserved orders, of errors clear of the doubt and steps that were not divided:\n")?;
    writeln!(text, "| pitch [mm] | {} |", METHODS.iter().map(|method| method.name()).collect::<Vec<_>>().join(" | "))?;
    writeln!(text, "|---:|{}", "---:|".repeat(METHODS.len()))?;
    let theory = METHODS.iter().map(|method| method.order().map_or("-".to_owned(), |order| order.to_string()));
    writeln!(text, "| in theory | {} |", theory.collect::<Vec<_>>().join(" | "))?;
    for level in &findings.levels {
        let of = |&method: &Method| {
            let order = level.time_orders.iter().find(|order| order.integrator == method);
            order.map_or("-".to_owned(), |order| format!("{:.2}", order.law.slope))
        };
        writeln!(text, "| {} | {} |", level.pitch_mm, METHODS.iter().map(of).collect::<Vec<_>>().join(" | "))?;
    }
    Ok(())
}

fn pitches(text: &mut String, page: &Page<'_>, findings: &Findings) -> fmt::Result {
    let Some(law) = findings.space_law else { return Ok(()) };
    let largest = findings.largest_mm;
    let finest = findings.levels.last().map_or(0.0, |level| level.pitch_mm);
    writeln!(
        text,
        "\n## The pitch\n\nReferences of the pitches against that of {finest} mm, at the particles of the coarser lattice.\n"
    )?;
    writeln!(
        text,
        "| pitch [mm] | particles | seen, rms | seen, 99 % | seen, max | places left out | estimated error, rms | max |"
    )?;
    writeln!(text, "|---:|---:|---:|---:|---:|---:|---:|---:|")?;
    for level in &findings.levels {
        let seen = level.from_finest.map_or(["-", "-", "-", "-"].map(str::to_owned), |d| {
            let [rms, most, max] = [d.rms_mm, d.most_mm, d.max_mm].map(|mm| percent(mm / largest));
            [rms, most, max, format!("{} of {}", d.left_out, d.left_out + d.points)]
        });
        let [rms, max] = level
            .space_error
            .map_or(["-", "-"].map(str::to_owned), |s| [s.rms_mm, s.max_mm].map(|mm| percent(mm / largest)));
        writeln!(text, "| {} | {} | {} | {rms} | {max} |", level.pitch_mm, level.particles, seen.join(" | "))?;
    }
    let order = if law.found {
        format!("with `q = {:.2}`, fitted to {} pitches", law.order, law.pitches)
    } else {
        format!("with `q = {:.1}`, assumed: these pitches show no power", law.order)
    };
    writeln!(
        text,
        "\nThe finest pitch has an error of its own. The estimate is `c h^q` where `c (h^q - H^q)` is seen against the finest pitch \
         `H`, {order}."
    )?;
    if page.pictures.contains(&PITCHES) {
        writeln!(text, "\n![Error of the pitch]({PITCHES})")?;
    }
    Ok(())
}

fn surfaces(text: &mut String, page: &Page<'_>, ledger: &Ledger) -> fmt::Result {
    let lines: Vec<_> = ledger.surfaces().collect();
    let Some(reference) = lines.iter().find(|line| line.distance.is_none()) else { return Ok(()) };
    writeln!(
        text,
        "\n## The surface\n\nSurfaces of the soft organs at the end of `{}`, against one sampled at {} mm ({} triangles); \
         `yawara mesh {}/runs/{} -o surface.ply --resolution MM` draws them. Times are of one frame from what is on disk.\n",
        reference.run, reference.resolution, reference.triangles, page.folder, reference.run
    )?;
    writeln!(text, "| resolution [mm] | triangles | time | mean distance [mm] | Hausdorff [mm] | volume |")?;
    writeln!(text, "|---:|---:|---:|---:|---:|---:|")?;
    for line in &lines {
        let Some(distance) = line.distance else { continue };
        writeln!(
            text,
            "| {} | {} | {} | {} | {} | {:+.3} % |",
            line.resolution,
            line.triangles,
            seconds(line.seconds),
            two(distance.mean_mm),
            two(distance.hausdorff_mm),
            100.0 * (line.volume_ml / reference.volume_ml - 1.0)
        )?;
    }
    if page.pictures.contains(&SURFACES) {
        writeln!(text, "\n![Distance of surfaces]({SURFACES})")?;
    }
    Ok(())
}

fn arithmetic(text: &mut String, findings: &Findings, ledger: &Ledger) -> fmt::Result {
    let largest = findings.largest_mm;
    let pairs: Vec<(&Row, &Row)> = findings
        .rows
        .iter()
        .filter_map(|row| {
            let choice = row.choice.in_arithmetic(findings.usual);
            let usual = findings.rows.iter().find(|other| other.choice == choice && row.choice != choice)?;
            Some((usual, row))
        })
        .collect();
    if pairs.is_empty() && ledger.rounding().is_none() {
        return Ok(());
    }
    writeln!(text, "\n## Rounding\n")?;
    for (usual, other) in pairs {
        let (Some(a), Some(b), Some(apart)) = (usual.time_error, other.time_error, other.from_usual) else { continue };
        let Choice { integrator, arithmetic, .. } = other.choice;
        // The plain step in f64 reads dampers otherwise.
        let note = if arithmetic == Arithmetic::Double && integrator == Method::SymplecticEuler {
            "; in f64 dampers read the rate of length itself, otherwise the difference of two lengths, which differs by an error of first order"
        } else {
            ""
        };
        writeln!(
            text,
            "- {}: {arithmetic} takes {} times the time of {}, ends {} (rms) and {} (max) of the largest displacement from it, and its \
             error (rms) is {} instead of {}{note}.",
            described(&usual.choice),
            two(other.least_seconds() / usual.least_seconds()),
            findings.usual,
            percent(apart.rms_mm / largest),
            percent(apart.max_mm / largest),
            percent(b.rms_mm / largest),
            percent(a.rms_mm / largest)
        )?;
    }
    if let Some(rounding) = ledger.rounding() {
        writeln!(
            text,
            "- From the last state of `{}` on, {} steps in f32 and in f64 (springs, holds, gravity and drag alone) end {} (rms) \
             and {} (max) of the largest displacement apart, while particles move by up to {} mm; f64, written plainly, takes {} times as long.",
            rounding.run,
            rounding.steps,
            percent(rounding.rms_mm / largest),
            percent(rounding.max_mm / largest),
            two(rounding.moved_mm),
            two(rounding.times_slower)
        )?;
    }
    Ok(())
}

fn left_out(text: &mut String, page: &Page<'_>, findings: &Findings, plan: &Plan, ledger: &Ledger) -> fmt::Result {
    let skipped: Vec<_> = ledger.skipped(page.budget_seconds).collect();
    let lost: Vec<&String> = ledger.probes().filter_map(|probe| probe.failed.as_ref()).collect();
    if plan.left_out.is_empty() && findings.failed.is_empty() && skipped.is_empty() && lost.is_empty() {
        return Ok(());
    }
    writeln!(text, "\n## What is missing\n")?;
    for left in &plan.left_out {
        writeln!(
            text,
            "- {}: a run would take about {}, more than the budget of {} leaves.",
            described(&left.choice),
            seconds(left.seconds),
            seconds(page.budget_seconds)
        )?;
    }
    for line in skipped.iter().filter(|line| line.repeat == 0) {
        writeln!(
            text,
            "- {}: not run, for it would take about {} and the time was up.",
            described(&line.choice),
            seconds(line.seconds)
        )?;
    }
    let repeats = skipped.iter().filter(|line| line.repeat > 0).count();
    if repeats > 0 {
        writeln!(text, "- {repeats} repeats, for the time was up: the shortest times are those of fewer runs.")?;
    }
    for (choice, why) in &findings.failed {
        writeln!(text, "- {}: {why}", described(choice))?;
    }
    for why in lost {
        writeln!(text, "- {why}")?;
    }
    writeln!(text, "\nMore time (`--budget MINUTES`) goes on from here.")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_two_digits_that_count() {
        assert_eq!([0.0123, 1.26, 45.6, 4560.0, 1e-9].map(two), ["0.012", "1.3", "46", "4560", "1.0e-9"]);
        assert_eq!(percent(0.00123), "0.12 %");
        assert_eq!([0.0123, 12.3].map(seconds), ["12 ms", "12 s"]);
    }
}
