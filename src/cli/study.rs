//! `yawara study`: what accuracy costs in time.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use super::exit::Outcome;
use super::messages::{Messages, out};
use super::progress;
use super::source::Source;
use crate::dynamics::integrator::Method;
use crate::io::atomic::write_file;
use crate::kernel::dispatch::InstructionSet;
use crate::run::inputs;
use crate::run::label_lookup::Files;
use crate::scene::resolved::{Scene, needs_plain_step};
use crate::study::choice::{Arithmetic, arithmetic_for, may_judge, methods_for};
use crate::study::ledger::FILE;
use crate::study::plan::{Options, Plan};
use crate::study::report::{Page, markdown};
use crate::study::sweep::{Progress, RUNS, Study};
use crate::study::{html, judge, plots, surfaces, tables};

/// What is written beside plots.
const TEXTS: [&str; 4] = ["report.md", "report.html", "results.csv", "results.json"];

/// Find out what accuracy costs in time: run a scene with other integrators, steps, pitches and arithmetic, and measure errors.
///
/// Writes results.csv, results.json, plots (PNG), and report.md and report.html, which say in sentences what each digit costs. An interrupted study
/// goes on where it was; every run is kept as a run directory.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara study fixtures/scenes/liver-ct.toml -o outputs/study --budget 10\n  \
                        yawara study my.toml -o outputs/study --pitches 4,3,2 --steps 1,2,4")]
pub(super) struct StudyArguments {
    /// Scene file (TOML).
    scene: PathBuf,
    /// Folder to write to; one that holds the same study is gone on with.
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Time the study may take [min].
    #[arg(long, default_value_t = 10.0, value_name = "MINUTES", value_parser = positive)]
    budget: f64,
    /// Steps to try: how many times shorter than the longest that the integrator takes at the pitch.
    ///
    /// That is its own largest stable step, or 20 steps of the plain one for backward_euler, which is stable at any; bogacki_shampine chooses its
    /// steps itself, and its tolerance is divided by the cube.
    #[arg(long, default_value = "1,2,4,8", value_name = "LIST", value_delimiter = ',', value_parser = positive)]
    steps: Vec<f64>,
    /// Pitches to try [mm]; all are compared with the finest [default: 2, 1.5, 1 and 0.75 times that of the scene].
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = positive)]
    pitches: Option<Vec<f64>>,
    /// Integrators to try: symplectic_euler, verlet, rk4, bogacki_shampine, backward_euler [default: all that the scene can be stepped with].
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    integrators: Option<Vec<String>>,
    /// Arithmetic to try: fast, exact (true square roots), double (f64) [default: all that the scene can be stepped in].
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = arithmetic)]
    arithmetic: Option<Vec<Arithmetic>>,
    /// Resolutions of the surface to try [mm] [default: the lattice, and 2, 1 and 1/2 times the voxels].
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = positive)]
    resolutions: Option<Vec<f64>>,
    /// How often each choice is run, to time it.
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=100))]
    repeats: u8,
    /// Begin anew: what an earlier study left in the folder is removed.
    #[arg(long)]
    overwrite: bool,
}

/// Reads a number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|x: &f64| *x > 0.0 && x.is_finite());
    number.ok_or_else(|| format!("`{text}` is not a number above 0"))
}

/// Reads the name of an arithmetic.
fn arithmetic(text: &str) -> Result<Arithmetic, String> {
    let named = Arithmetic::ALL.into_iter().find(|arithmetic| arithmetic.name() == text.trim());
    named.ok_or_else(|| format!("`{}` is no arithmetic; expected `fast`, `exact` or `double`", text.trim()))
}

impl StudyArguments {
    fn options(&self, scene: &Scene) -> anyhow::Result<Options> {
        let reason = needs_plain_step(&scene.organs, &scene.operations, scene.sleep)
            .map_or_else(String::new, |what| format!(" for this scene, which has {what}"));
        Ok(Options {
            finenesses: self.steps.clone(),
            pitches_mm: self.pitches.clone(),
            integrators: self.methods(methods_for(scene), &reason)?,
            arithmetic: self.numbers(arithmetic_for(scene), &reason)?,
            resolutions_mm: self.resolutions.clone(),
            repeats: usize::from(self.repeats),
            budget_seconds: 60.0 * self.budget,
            ..Options::default()
        })
    }

    fn methods(&self, known: &[Method], reason: &str) -> anyhow::Result<Vec<Method>> {
        let Some(names) = &self.integrators else { return Ok(known.to_vec()) };
        let listed =
            |methods: &mut dyn Iterator<Item = &Method>| methods.map(|m| m.name()).collect::<Vec<_>>().join(", ");
        let mut methods = Vec::new();
        for name in names {
            let Some(&method) = known.iter().find(|method| method.name() == *name) else {
                bail!("--integrators: there is no `{name}`{reason}; there is {}", listed(&mut known.iter()));
            };
            methods.push(method);
        }
        if !methods.iter().any(|&method| may_judge(method)) {
            bail!(
                "--integrators: {} cannot be judged by itself, for it chooses its own steps or iterations; add one of {}",
                names.join(", "),
                listed(&mut known.iter().filter(|&&method| may_judge(method)))
            );
        }
        Ok(methods)
    }

    fn numbers(&self, known: &[Arithmetic], reason: &str) -> anyhow::Result<Vec<Arithmetic>> {
        let Some(asked) = &self.arithmetic else { return Ok(known.to_vec()) };
        if let Some(unknown) = asked.iter().find(|arithmetic| !known.contains(arithmetic)) {
            bail!("--arithmetic: there is no `{unknown}`{reason}; there is {}", joined(known));
        }
        Ok(asked.clone())
    }

    /// The command as it can be typed again.
    fn command(&self) -> String {
        let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let mut command = format!(
            "yawara study {} -o {} --budget {} --steps {} --repeats {}",
            self.scene.display(),
            self.output.display(),
            self.budget,
            list(&self.steps),
            self.repeats
        );
        if let Some(pitches) = &self.pitches {
            command.push_str(&format!(" --pitches {}", list(pitches)));
        }
        if let Some(integrators) = &self.integrators {
            command.push_str(&format!(" --integrators {}", integrators.join(",")));
        }
        if let Some(arithmetic) = &self.arithmetic {
            command.push_str(&format!(" --arithmetic {}", joined(arithmetic)));
        }
        if let Some(resolutions) = &self.resolutions {
            command.push_str(&format!(" --resolutions {}", list(resolutions)));
        }
        command
    }
}

fn joined(arithmetic: &[Arithmetic]) -> String {
    arithmetic.iter().map(|own| own.name()).collect::<Vec<_>>().join(",")
}

pub(super) fn study(arguments: &StudyArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    match Source::of(&arguments.scene)? {
        Source::Scene | Source::Volume => {}
        other => return Err(other.refuse(&arguments.scene, "a scene (TOML)")),
    }
    let (scene, warnings) = crate::scene::load(&arguments.scene, &Files)?;
    let options = arguments.options(&scene)?;
    warnings.iter().for_each(|warning| messages.warning(warning));
    if let Some(dt) = scene.time.dt {
        messages.note(format_args!(
            "the scene asks for steps of {dt:e} s; the study counts from the longest step of each integrator and pitch instead (--steps)"
        ));
    }
    let folder = &arguments.output;
    make_room(folder, arguments.overwrite)?;
    let inputs = inputs::load(&scene)?;
    let mut study = Study::open(&scene, &inputs, folder, options)?;
    let mut plan = study.plan()?;
    run(&mut study, &plan, messages)?;
    // Runs tell better than the probe what fits.
    for _ in 0..2 {
        let better = study.plan()?;
        let more = better.tasks.iter().any(|task| !study.ledger().has(&task.choice, task.repeats - 1));
        if better.left_out.len() < plan.left_out.len() && more {
            messages.note("it goes faster than the probe promised: there is time for more");
            run(&mut study, &better, messages)?;
        }
        plan = better;
    }
    for left in &plan.left_out {
        messages.note(format_args!("left out, about {:.0} s: {}", left.seconds, left.choice.key()));
    }
    if let Some(first) = plan.tasks.first() {
        messages.note("measuring surfaces");
        surfaces::measure(&mut study, &first.choice)?;
    }
    messages.note("comparing runs");
    let Some(findings) = judge::judge(&study, &plan)? else {
        bail!("{}: no run came to its end; see {FILE} there for why", folder.display());
    };
    let lines: Vec<_> = study.ledger().surfaces().collect();
    let pictures = plots::write(&findings, &lines, folder)?;
    let name = arguments.scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let page = Page {
        scene: &name,
        command: &arguments.command(),
        folder: &folder.display().to_string(),
        machine: &format!("{}{} threads, {}", processor(), rayon::current_num_threads(), InstructionSet::best().name()),
        pictures: &pictures,
        instants: study.options().instants,
        budget_seconds: study.options().budget_seconds,
    };
    let json = serde_json::to_string_pretty(&tables::json(&findings, &plan, study.ledger()))?;
    let report = markdown(&page, &findings, &plan, study.ledger());
    let html = html::page(&report, |name| fs::read(folder.join(name)).ok());
    let texts = [report, html, tables::csv(&findings), json];
    for (name, text) in TEXTS.iter().zip(texts) {
        write_text(&folder.join(name), &text)?;
    }
    messages.note(format_args!("{:.0} s in all", study.spent()));
    let written = TEXTS.into_iter().chain(pictures);
    out(&written.map(|name| folder.join(name).display().to_string()).collect::<Vec<_>>().join("\n"))?;
    let sound = findings.failed.is_empty() && findings.rows.iter().all(|row| row.same_bits);
    Ok(if sound { Outcome::Done } else { Outcome::CheckFailed })
}

/// Makes the runs of a plan, with progress.
fn run(study: &mut Study<'_>, plan: &Plan, messages: &Messages) -> anyhow::Result<()> {
    let runs = plan.tasks.iter().map(|task| task.repeats as u64).sum();
    let bar = progress::bar(messages, "runs", runs);
    study.run(plan, &mut |progress| match progress {
        Progress::Planned { runs, known } => {
            bar.inc(*known as u64);
            let text = match known {
                0 => format!("{runs} runs planned"),
                _ => format!("going on with the study: {known} of {runs} runs are there"),
            };
            bar.suspend(|| messages.note(text));
        }
        Progress::Begins(choice) => bar.set_message(choice.key()),
        Progress::Ended => bar.inc(1),
    })?;
    bar.finish_and_clear();
    Ok(())
}

/// Name of the processor, where the system tells it, and a comma.
fn processor() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or(String::new(), |(_, name)| format!("{}, ", name.trim()))
}

fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    write_file(path, |file| std::io::Write::write_all(file, text.as_bytes()))
        .with_context(|| format!("{}: could not be written", path.display()))
}

/// Refuses a folder that holds something else than a study, and empties one that is to be begun anew.
fn make_room(folder: &Path, overwrite: bool) -> anyhow::Result<()> {
    if folder.exists() && !folder.is_dir() {
        bail!("{}: is a file; give a folder to write to", folder.display());
    }
    let unreadable = || format!("{}: could not be read", folder.display());
    if !folder.is_dir() || folder.read_dir().with_context(unreadable)?.next().is_none() {
        return Ok(());
    }
    if !folder.join(FILE).is_file() {
        bail!("{}: holds something else than a study (no {FILE} in it); choose another folder", folder.display());
    }
    if !overwrite {
        return Ok(());
    }
    let files = TEXTS.into_iter().chain(plots::ALL).chain([FILE]).map(|name| folder.join(name));
    for file in files.filter(|file| file.exists()) {
        fs::remove_file(&file).with_context(|| format!("{}: could not be removed", file.display()))?;
    }
    let runs = folder.join(RUNS);
    if runs.is_dir() {
        fs::remove_dir_all(&runs).with_context(|| format!("{}: could not be removed", runs.display()))?;
    }
    Ok(())
}
