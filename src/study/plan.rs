//! Which runs a study makes, so that they fit into its time.
//!
//! What answers most comes first: the steps of the scene's own pitch with their reference, then the finest pitch, to which the others
//! are compared, coarser pitches, exact arithmetic, and repeats. What does not fit is left out, and said.

use super::choice::{Choice, METHODS, Method};
use super::ledger::ProbeLine;

/// Share of the budget for stepping; the rest goes to preparing, surfaces and pictures.
const STEPPING: f64 = 0.75;
/// Share of that for the first runs of the scene's own pitch.
const BASE: f64 = 0.6;
/// Cuts, contact and divided steps make a run longer than its first steps promise.
pub(super) const SLACK: f64 = 1.2;

/// What a study is asked to try.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How many times finer than the largest stable step; see [`Choice::fineness`].
    pub finenesses: Vec<f64>,
    /// Pitches \[mm\]; `None` takes [`PITCHES`] times that of the scene.
    pub pitches_mm: Option<Vec<f64>>,
    /// Names of integrators.
    pub integrators: Vec<String>,
    /// Fast arithmetic, exact, or both.
    pub exact: Vec<bool>,
    /// Resolutions of surfaces \[mm\]; `None` takes the lattice and [`RESOLUTIONS`] times the voxels of the volume.
    pub resolutions_mm: Option<Vec<f64>>,
    /// How often each choice is run, to time it.
    pub repeats: usize,
    /// At so many instants runs are compared, evenly spaced, the last at the end.
    pub instants: usize,
    /// What all of it may take \[s\].
    pub budget_seconds: f64,
}

/// Pitches that are tried, in pitches of the scene; the last is what the others are compared with.
pub const PITCHES: [f64; 4] = [2.0, 1.5, 1.0, 0.75];
/// Spacings of surfaces that are tried, in edges of a voxel.
pub const RESOLUTIONS: [f64; 3] = [2.0, 1.0, 0.5];

impl Default for Options {
    fn default() -> Self {
        Self {
            finenesses: vec![1.0, 2.0, 4.0, 8.0],
            pitches_mm: None,
            integrators: vec![METHODS[0].name().to_owned()],
            exact: vec![false, true],
            resolutions_mm: None,
            repeats: 3,
            instants: 4,
            budget_seconds: 600.0,
        }
    }
}

/// Runs of one choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// The choice.
    pub choice: Choice,
    /// How often it is run.
    pub repeats: usize,
    /// True when it is there only to judge others by.
    pub reference: bool,
    /// What one run is estimated to take \[s\].
    pub seconds: f64,
}

/// A choice, or repeats of one, that did not fit.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// The choice.
    pub choice: Choice,
    /// What one run is estimated to take \[s\].
    pub seconds: f64,
}

/// What a study does.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Runs, in the order in which they are made in each round.
    pub tasks: Vec<Task>,
    /// What did not fit.
    pub left_out: Vec<LeftOut>,
    /// The pitch whose steps are looked at most closely: the scene's own, or the nearest there is \[mm\].
    pub base_mm: f64,
    /// The integrator that others are judged by.
    pub judge: &'static Method,
}

/// Plans a study. `None` when no pitch can be had, or no integrator is known.
///
/// - `probes`: what a step of each pitch costs; those that failed are left out.
/// - `known`: whether a choice has been run already; such a one stays.
pub fn plan(
    probes: &[ProbeLine],
    options: &Options,
    scene_pitch_mm: f64,
    known: &dyn Fn(&Choice) -> bool,
) -> Option<Plan> {
    let levels: Vec<&ProbeLine> = probes.iter().filter(|probe| probe.failed.is_none()).collect();
    let away = |level: &ProbeLine| (level.pitch_mm / scene_pitch_mm).ln().abs();
    let base = *levels.iter().min_by(|a, b| away(a).total_cmp(&away(b)))?;
    let finest = *levels.iter().min_by(|a, b| a.pitch_mm.total_cmp(&b.pitch_mm))?;
    let mut methods: Vec<&Method> =
        options.integrators.iter().filter_map(|name| METHODS.iter().find(|method| method.name() == *name)).collect();
    let left = STEPPING * options.budget_seconds;
    // Fast where it is asked for, or what is asked for.
    let usual = !options.exact.contains(&false);
    let mut finenesses = options.finenesses.clone();
    finenesses.sort_by(f64::total_cmp);
    finenesses.dedup();
    let (coarsest, most) = (*finenesses.first()?, *finenesses.last()?);
    // Two steps of each are the least that says anything; the dearest go first where there is no time for them.
    let mut dropped = Vec::new();
    methods.sort_by_key(|method| method.evaluations);
    while let [_, .., dearest] = methods[..]
        && methods.iter().map(|method| cost(base, method, coarsest) + cost(base, method, 2.0 * coarsest)).sum::<f64>()
            > BASE * left
        && !known(&choice(base, dearest, coarsest, usual))
    {
        dropped.push(dearest);
        methods.pop();
    }
    let judge = *methods.iter().rev().max_by(|a, b| a.order.total_cmp(&b.order))?;
    let mut planner =
        Planner { left, known, plan: Plan { tasks: Vec::new(), left_out: Vec::new(), base_mm: base.pitch_mm, judge } };
    dropped.into_iter().for_each(|method| planner.leave_out(base, method, coarsest, usual));

    // The scene's own pitch: as fine as the time allows, the finest for reference.
    let mut ladder = [&finenesses[..], &[2.0 * most]].concat();
    let total = |ladder: &[f64]| {
        let of = |method: &&Method| ladder.iter().map(|&fineness| cost(base, method, fineness)).sum::<f64>();
        methods.iter().map(of).sum::<f64>()
    };
    while let [.., _, _, fineness] = ladder[..]
        && total(&ladder) > BASE * planner.left
        && !known(&choice(base, judge, fineness, usual))
    {
        ladder.pop();
        planner.leave_out(base, judge, fineness, usual);
    }
    let reference = *ladder.last()?;
    for &fineness in &ladder {
        for &method in methods.iter().filter(|method| fineness < reference || ***method == *judge) {
            planner.take(base, method, fineness, usual, fineness == reference, true);
        }
    }
    // The pitch that others are compared with.
    if finest.pitch_mm < base.pitch_mm {
        for fineness in [coarsest, 2.0 * coarsest] {
            planner.take(finest, judge, fineness, usual, fineness > coarsest, false);
        }
    }
    for level in levels.iter().filter(|level| level.pitch_mm != base.pitch_mm && level.pitch_mm != finest.pitch_mm) {
        for &fineness in &ladder {
            for &method in methods.iter().filter(|method| fineness < reference || ***method == *judge) {
                planner.take(level, method, fineness, usual, fineness == reference, false);
            }
        }
    }
    if options.exact.contains(&!usual) {
        methods.iter().for_each(|method| planner.take(base, method, coarsest, true, false, false));
    }
    // The cheapest first, so that as many as possible are repeated.
    let mut order: Vec<usize> = (0..planner.plan.tasks.len()).filter(|&n| !planner.plan.tasks[n].reference).collect();
    order.sort_by(|&a, &b| planner.plan.tasks[a].seconds.total_cmp(&planner.plan.tasks[b].seconds));
    for _ in 1..options.repeats {
        for &number in &order {
            let task = &mut planner.plan.tasks[number];
            if task.seconds <= planner.left {
                planner.left -= task.seconds;
                task.repeats += 1;
            }
        }
    }
    Some(planner.plan)
}

/// Time of a run \[s\].
fn cost(level: &ProbeLine, method: &Method, fineness: f64) -> f64 {
    let steps = level.steps as f64 * fineness * method.evaluations as f64;
    SLACK * steps * level.step_seconds + level.other_seconds
}

fn choice(level: &ProbeLine, method: &Method, fineness: f64, exact: bool) -> Choice {
    Choice { integrator: method.name().to_owned(), pitch_mm: level.pitch_mm, fineness, exact }
}

struct Planner<'a> {
    /// Time that is not planned yet \[s\].
    left: f64,
    known: &'a dyn Fn(&Choice) -> bool,
    plan: Plan,
}

impl Planner<'_> {
    fn leave_out(&mut self, level: &ProbeLine, method: &Method, fineness: f64, exact: bool) {
        let choice = choice(level, method, fineness, exact);
        self.plan.left_out.push(LeftOut { choice, seconds: cost(level, method, fineness) });
    }

    /// Plans a run if there is time, or in any case.
    fn take(&mut self, level: &ProbeLine, method: &Method, fineness: f64, exact: bool, reference: bool, always: bool) {
        let seconds = cost(level, method, fineness);
        let choice = choice(level, method, fineness, exact);
        if !always && seconds > self.left && !(self.known)(&choice) {
            return self.leave_out(level, method, fineness, exact);
        }
        self.left -= seconds;
        self.plan.tasks.push(Task { choice, repeats: 1, reference, seconds });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn probe(pitch_mm: f64, step_seconds: f64) -> ProbeLine {
        ProbeLine { pitch_mm, particles: 1000, steps: 100, step_seconds, other_seconds: 0.1, failed: None }
    }

    #[test]
    fn a_plan_keeps_to_its_time_and_says_what_it_leaves_out() {
        let probes = [probe(6.0, 1e-3), probe(3.0, 1e-2), probe(2.25, 4e-2)];
        let total = |plan: &Plan| plan.tasks.iter().map(|task| task.seconds * task.repeats as f64).sum::<f64>();
        let mut before = 0;
        for budget_seconds in [10.0, 60.0, 600.0] {
            let plan = plan(&probes, &Options { budget_seconds, ..Options::default() }, 3.0, &|_| false).unwrap();
            assert_eq!(plan.base_mm, 3.0);
            assert!(total(&plan) <= budget_seconds, "{} of {budget_seconds}", total(&plan));
            let asked = plan.tasks.len() + plan.left_out.len();
            assert_eq!(asked, 5 + 2 + plan.tasks.iter().filter(|task| task.choice.pitch_mm == 6.0).count() + 1);
            assert!(plan.tasks.len() > before, "more time, more runs");
            before = plan.tasks.len();
        }
        let all = plan(&probes, &Options { budget_seconds: 1e4, ..Options::default() }, 3.0, &|_| false).unwrap();
        assert!(all.left_out.is_empty());
        let reference = |pitch: f64| {
            let of = all.tasks.iter().filter(|task| task.reference && task.choice.pitch_mm == pitch);
            of.map(|task| task.choice.fineness).collect::<Vec<_>>()
        };
        assert_eq!([reference(3.0), reference(2.25), reference(6.0)], [vec![16.0], vec![2.0], vec![16.0]]);
        assert!(all.tasks.iter().all(|task| task.repeats == if task.reference { 1 } else { 3 }));
    }

    #[test]
    fn dear_integrators_are_left_out_where_there_is_no_time_for_them() {
        let integrators: Vec<String> = METHODS.iter().map(|method| method.name().to_owned()).collect();
        let judge = |budget_seconds: f64| {
            let options = Options { integrators: integrators.clone(), budget_seconds, ..Options::default() };
            let plan = plan(&[probe(3.0, 1e-2)], &options, 3.0, &|_| false).unwrap();
            assert!(plan.tasks.iter().filter(|task| task.choice.integrator == plan.judge.name()).count() >= 2);
            let named = |name: &String| {
                plan.tasks
                    .iter()
                    .map(|task| &task.choice)
                    .chain(plan.left_out.iter().map(|left| &left.choice))
                    .any(|choice| choice.integrator == *name)
            };
            assert!(integrators.iter().all(named), "{plan:?}");
            plan.judge.name()
        };
        assert_eq!([judge(1.0), judge(1e4)], ["symplectic_euler", "rk4"]);
    }

    #[test]
    fn what_was_run_stays() {
        let probes = [probe(3.0, 1e-2), probe(2.25, 4e-2)];
        let options = Options { budget_seconds: 10.0, ..Options::default() };
        let short = plan(&probes, &options, 3.0, &|_| false).unwrap();
        assert!(short.left_out.len() > 3, "{short:?}");
        let kept = plan(&probes, &options, 3.0, &|_| true).unwrap();
        assert!(kept.left_out.is_empty(), "{kept:?}");
    }

    #[test]
    fn pitches_that_failed_are_not_planned() {
        let lost = ProbeLine { failed: Some("no voxel is left".into()), ..probe(9.0, 1e-3) };
        assert_eq!(plan(std::slice::from_ref(&lost), &Options::default(), 3.0, &|_| false), None);
        let plan = plan(&[lost, probe(3.0, 1e-3)], &Options::default(), 3.0, &|_| false).unwrap();
        assert!(plan.tasks.iter().all(|task| task.choice.pitch_mm == 3.0));
    }
}
