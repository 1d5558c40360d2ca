//! Which runs a study makes, so that they fit into its time.
//!
//! What answers most comes first: two steps of each integrator at the scene's own pitch, with the reference that they are judged by, and
//! the finer ones as far as they are cheap; then the finest pitch, to which the others are compared, the other pitches, exact arithmetic, finer steps
//! of dear integrators, f64, and repeats. What does not fit is left out, and said: first the dearest integrator.

use std::cmp::Reverse;

use super::choice::{Arithmetic, Choice, METHODS, may_judge};
use super::ledger::{Pace, ProbeLine};
use crate::dynamics::integrator::Method;

/// Share of the budget for stepping; the rest goes to preparing, surfaces and pictures.
const STEPPING: f64 = 0.75;
/// Share of that for the first runs of the scene's own pitch.
const BASE: f64 = 0.6;
/// What could not be timed, and f64 that was not, is taken to be so much slower.
const UNTIMED: f64 = 10.0;
/// Cuts, contact and divided steps make a run longer than its first steps promise.
pub(super) const SLACK: f64 = 1.2;

/// What a study is asked to try.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How many times finer than the longest step of an integrator; see [`Choice::fineness`].
    pub finenesses: Vec<f64>,
    /// Pitches \[mm\]; `None` takes [`PITCHES`] times that of the scene.
    pub pitches_mm: Option<Vec<f64>>,
    /// Integrators.
    pub integrators: Vec<Method>,
    /// Numbers: the whole grid is made in the first that there is of [`Arithmetic::ALL`].
    pub arithmetic: Vec<Arithmetic>,
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

impl Options {
    /// Numbers of the grid; the others are there only for comparison.
    pub fn usual(&self) -> Arithmetic {
        Arithmetic::ALL.into_iter().find(|own| self.arithmetic.contains(own)).unwrap_or(Arithmetic::Fast)
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            finenesses: vec![1.0, 2.0, 4.0, 8.0],
            pitches_mm: None,
            integrators: METHODS.to_vec(),
            arithmetic: Arithmetic::ALL.to_vec(),
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
    pub judge: Method,
}

/// Plans a study. `None` when no pitch can be had, or none of the integrators may judge the others.
///
/// - `probes`: what steps of each pitch cost; those that failed are left out.
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
    let left = STEPPING * options.budget_seconds;
    let usual = options.usual();
    let mut finenesses = options.finenesses.clone();
    finenesses.sort_by(f64::total_cmp);
    finenesses.dedup();
    let (coarsest, most) = (*finenesses.first()?, *finenesses.last()?);
    let choice = |level: &ProbeLine, integrator: Method, fineness: f64| Choice {
        integrator,
        pitch_mm: level.pitch_mm,
        fineness,
        arithmetic: usual,
    };
    let at_base = |method: Method, fineness: f64| choice(base, method, fineness);
    // Two steps of each, and three of the one that judges, are the least that says anything; the dearest go first where there is no
    // time for them.
    let least =
        |method: Method| [coarsest, 2.0 * coarsest].map(|f| base.seconds(&at_base(method, f))).iter().sum::<f64>();
    let judge_of = |methods: &[Method]| {
        methods.iter().copied().filter(|&method| may_judge(method)).max_by_key(|method| method.order())
    };
    let least_of_all = |methods: &[Method]| {
        let third = judge_of(methods).map_or(0.0, |judge| base.seconds(&at_base(judge, 4.0 * coarsest)));
        third + methods.iter().map(|&method| least(method)).sum::<f64>()
    };
    let mut methods: Vec<Method> =
        METHODS.iter().copied().filter(|method| options.integrators.contains(method)).collect();
    let mut dropped = Vec::new();
    while least_of_all(&methods) > BASE * left {
        let may_go = |&method: &Method| {
            let others = methods.iter().any(|&other| other != method && may_judge(other));
            others && !known(&at_base(method, coarsest))
        };
        let dearest = methods.iter().copied().filter(may_go).max_by(|&a, &b| least(a).total_cmp(&least(b)));
        let Some(dearest) = dearest else { break };
        dropped.push(at_base(dearest, coarsest));
        methods.retain(|&method| method != dearest);
    }
    let judge = judge_of(&methods)?;
    let others = || methods.iter().copied().filter(|&method| method != judge);
    let mut planner = Planner {
        left,
        levels: &levels,
        known,
        plan: Plan { tasks: Vec::new(), left_out: Vec::new(), base_mm: base.pitch_mm, judge },
    };
    dropped.into_iter().for_each(|choice| planner.leave_out(choice));

    // The scene's own pitch: as fine as the time allows, the finest for reference.
    let mut ladder = [&finenesses[..], &[2.0 * most]].concat();
    let first: Vec<Choice> = others()
        .flat_map(|method| finenesses.iter().take(2).map(move |&fineness| (method, fineness)))
        .map(|(method, fineness)| at_base(method, fineness))
        .collect();
    let of_others: f64 = first.iter().map(|choice| base.seconds(choice)).sum();
    let of_judge = |ladder: &[f64]| ladder.iter().map(|&f| base.seconds(&at_base(judge, f))).sum::<f64>();
    while let [.., _, _, fineness] = ladder[..]
        && of_judge(&ladder) + of_others > BASE * planner.left
        && !known(&at_base(judge, fineness))
    {
        ladder.pop();
        planner.leave_out(at_base(judge, fineness));
    }
    let reference = *ladder.last()?;
    for &fineness in &ladder {
        planner.must(at_base(judge, fineness), fineness == reference);
    }
    first.into_iter().for_each(|choice| planner.must(choice, false));
    // Finer steps of the others, the cheapest first, as long as there is enough left for other pitches.
    let mut finer: Vec<Choice> = others()
        .flat_map(|method| finenesses.iter().skip(2).map(move |&fineness| (method, fineness)))
        .map(|(method, fineness)| at_base(method, fineness))
        .collect();
    planner.cheapest_first(&mut finer);
    let kept = (1.0 - BASE) * left;
    let mut later = Vec::new();
    for choice in finer {
        if known(&choice) || planner.seconds(&choice) <= planner.left - kept {
            planner.must(choice, false);
        } else {
            later.push(choice);
        }
    }
    // The pitch that others are compared with.
    if finest.pitch_mm < base.pitch_mm {
        for fineness in [coarsest, 2.0 * coarsest] {
            planner.take(choice(finest, judge, fineness), fineness > coarsest);
        }
    }
    for level in levels.iter().filter(|level| level.pitch_mm != base.pitch_mm && level.pitch_mm != finest.pitch_mm) {
        for &fineness in &ladder {
            planner.take(choice(level, judge, fineness), fineness == reference);
        }
        let mut grid: Vec<Choice> = others()
            .flat_map(|method| finenesses.iter().map(move |&fineness| (method, fineness)))
            .map(|(method, fineness)| choice(level, method, fineness))
            .collect();
        planner.cheapest_first(&mut grid);
        grid.into_iter().for_each(|choice| planner.take(choice, false));
    }
    // Implicit methods compute in f64 in any case.
    let explicit = || methods.iter().copied().filter(|method| !method.is_stable_at_any_step());
    if usual != Arithmetic::Exact && options.arithmetic.contains(&Arithmetic::Exact) {
        explicit().for_each(|method| {
            planner.take(at_base(method, coarsest).in_arithmetic(Arithmetic::Exact), false);
        });
    }
    later.into_iter().for_each(|choice| planner.take(choice, false));
    if usual != Arithmetic::Double && options.arithmetic.contains(&Arithmetic::Double) {
        explicit().filter(|&method| may_judge(method)).for_each(|method| {
            planner.take(at_base(method, coarsest).in_arithmetic(Arithmetic::Double), false);
        });
    }
    planner.repeat(options.repeats);
    // Whatever was there first, the order is the same: that in which a table is read.
    planner.plan.tasks.sort_by_key(|task| {
        let Choice { integrator, pitch_mm, fineness, arithmetic } = task.choice;
        let pitch = (pitch_mm != base.pitch_mm, pitch_mm != finest.pitch_mm, Reverse(pitch_mm.to_bits()));
        let method = METHODS.iter().position(|&method| method == integrator);
        (arithmetic, pitch, method, fineness.to_bits())
    });
    Some(planner.plan)
}

impl ProbeLine {
    /// Estimated time of a run of this pitch \[s\]: between the finenesses that were timed by a power of the fineness, beyond them in
    /// proportion to it. Exact arithmetic goes as fast as fast where it was not timed; f64, and an integrator that could not be timed, take
    /// ten times as long as the rest.
    pub fn seconds(&self, choice: &Choice) -> f64 {
        let own = |pace: &&Pace| pace.choice.integrator == choice.integrator;
        let same = |pace: &&Pace| own(pace) && pace.choice.arithmetic == choice.arithmetic;
        let in_f32 = |pace: &&Pace| pace.choice.arithmetic != Arithmetic::Double;
        let points = |paces: Vec<&Pace>, times: f64| -> Vec<[f64; 2]> {
            paces.into_iter().map(|pace| [pace.choice.fineness, times * pace.seconds]).collect()
        };
        let in_f64 = if choice.arithmetic == Arithmetic::Double { UNTIMED } else { 1.0 };
        let mut points = [
            points(self.paces.iter().filter(same).collect(), 1.0),
            points(self.paces.iter().filter(own).filter(in_f32).collect(), in_f64),
            points(self.paces.iter().collect(), UNTIMED),
        ]
        .into_iter()
        .find(|points| !points.is_empty())
        .unwrap_or_default();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let fineness = choice.fineness;
        let above = points.iter().position(|point| point[0] >= fineness);
        let stepping = match (above, points.last()) {
            (_, None) => 0.0,
            (None, Some([last, seconds])) => seconds * fineness / last,
            (Some(0), _) => points[0][1] * fineness / points[0][0],
            (Some(n), _) => {
                let ([a, slow], [b, fast]) = (points[n - 1], points[n]);
                slow * (fast / slow.max(f64::MIN_POSITIVE)).powf((fineness / a).ln() / (b / a).ln())
            }
        };
        SLACK * stepping + self.other_seconds
    }
}

struct Planner<'a> {
    /// Time that is not planned yet \[s\].
    left: f64,
    levels: &'a [&'a ProbeLine],
    known: &'a dyn Fn(&Choice) -> bool,
    plan: Plan,
}

impl Planner<'_> {
    fn seconds(&self, choice: &Choice) -> f64 {
        let level = self.levels.iter().find(|level| level.pitch_mm == choice.pitch_mm);
        level.map_or(f64::INFINITY, |level| level.seconds(choice))
    }

    fn cheapest_first(&self, choices: &mut [Choice]) {
        choices.sort_by(|a, b| self.seconds(a).total_cmp(&self.seconds(b)));
    }

    fn leave_out(&mut self, choice: Choice) {
        let seconds = self.seconds(&choice);
        self.plan.left_out.push(LeftOut { choice, seconds });
    }

    /// Plans a run.
    fn must(&mut self, choice: Choice, reference: bool) {
        let seconds = self.seconds(&choice);
        self.left -= seconds;
        self.plan.tasks.push(Task { choice, repeats: 1, reference, seconds });
    }

    /// Plans a run if there is time for it, or if it is there.
    fn take(&mut self, choice: Choice, reference: bool) {
        if self.seconds(&choice) <= self.left || (self.known)(&choice) {
            self.must(choice, reference);
        } else {
            self.leave_out(choice);
        }
    }

    /// Repeats runs, the cheapest first, so that as many as possible are repeated.
    fn repeat(&mut self, repeats: usize) {
        let mut order: Vec<usize> = (0..self.plan.tasks.len()).filter(|&n| !self.plan.tasks[n].reference).collect();
        order.sort_by(|&a, &b| self.plan.tasks[a].seconds.total_cmp(&self.plan.tasks[b].seconds));
        for _ in 1..repeats {
            for &number in &order {
                let task = &mut self.plan.tasks[number];
                if task.seconds <= self.left {
                    self.left -= task.seconds;
                    task.repeats += 1;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of the plain method takes so long; the others are as dear as they are.
    fn probe(pitch_mm: f64, step_seconds: f64) -> ProbeLine {
        let pace = |integrator, fineness: f64, arithmetic, times: f64| Pace {
            choice: Choice { integrator, pitch_mm, fineness, arithmetic },
            seconds: 100.0 * step_seconds * times,
        };
        let fast = |integrator, fineness, times| pace(integrator, fineness, Arithmetic::Fast, times);
        let paces = vec![
            fast(Method::SymplecticEuler, 1.0, 1.0),
            fast(Method::Verlet, 1.0, 1.1),
            fast(Method::Rk4, 1.0, 3.3),
            fast(Method::BogackiShampine, 1.0, 5.0),
            fast(Method::BogackiShampine, 8.0, 10.0),
            fast(Method::BackwardEuler, 1.0, 30.0),
            fast(Method::BackwardEuler, 8.0, 90.0),
            pace(Method::SymplecticEuler, 1.0, Arithmetic::Double, 10.0),
        ];
        ProbeLine { pitch_mm, particles: 1000, paces, untimed: Vec::new(), other_seconds: 0.1, failed: None }
    }

    fn plain_alone() -> Options {
        let arithmetic = vec![Arithmetic::Fast, Arithmetic::Exact];
        Options { integrators: vec![Method::SymplecticEuler], arithmetic, ..Options::default() }
    }

    fn total(plan: &Plan) -> f64 {
        plan.tasks.iter().map(|task| task.seconds * task.repeats as f64).sum()
    }

    #[test]
    fn a_plan_keeps_to_its_time_and_says_what_it_leaves_out() {
        let probes = [probe(6.0, 1e-3), probe(3.0, 1e-2), probe(2.25, 4e-2)];
        let mut before = 0;
        for budget_seconds in [10.0, 60.0, 600.0] {
            let plan = plan(&probes, &Options { budget_seconds, ..plain_alone() }, 3.0, &|_| false).unwrap();
            assert_eq!(plan.base_mm, 3.0);
            assert!(total(&plan) <= budget_seconds, "{} of {budget_seconds}", total(&plan));
            let asked = plan.tasks.len() + plan.left_out.len();
            assert_eq!(asked, 5 + 2 + plan.tasks.iter().filter(|task| task.choice.pitch_mm == 6.0).count() + 1);
            assert!(plan.tasks.len() > before, "more time, more runs");
            before = plan.tasks.len();
        }
        let all = plan(&probes, &Options { budget_seconds: 1e4, ..plain_alone() }, 3.0, &|_| false).unwrap();
        assert!(all.left_out.is_empty());
        let reference = |pitch: f64| {
            let of = all.tasks.iter().filter(|task| task.reference && task.choice.pitch_mm == pitch);
            of.map(|task| task.choice.fineness).collect::<Vec<_>>()
        };
        assert_eq!([reference(3.0), reference(2.25), reference(6.0)], [vec![16.0], vec![2.0], vec![16.0]]);
        assert!(all.tasks.iter().all(|task| task.repeats == if task.reference { 1 } else { 3 }));
    }

    #[test]
    fn the_dearest_integrator_is_the_first_to_go() {
        let probes = [probe(3.0, 1e-2)];
        let mut tried = Vec::new();
        for budget_seconds in [5.0, 20.0, 70.0, 130.0, 600.0, 1e4] {
            let plan = plan(&probes, &Options { budget_seconds, ..Options::default() }, 3.0, &|_| false).unwrap();
            assert!(total(&plan) <= budget_seconds || budget_seconds < 10.0, "{} of {budget_seconds}", total(&plan));
            let usual = |task: &&Task| task.choice.arithmetic == Arithmetic::Fast;
            let mut methods: Vec<Method> = plan.tasks.iter().filter(usual).map(|task| task.choice.integrator).collect();
            methods.dedup();
            // In the order of the table, and of each what says something: the others are judged, and the judge has a ladder.
            assert_eq!(methods, METHODS[..methods.len()]);
            for &method in &methods {
                let steps = plan.tasks.iter().filter(|task| task.choice.integrator == method && usual(task)).count();
                assert!(steps >= 2, "{method:?} at {budget_seconds} s: {steps}");
            }
            assert!(may_judge(plan.judge) && methods.iter().all(|&m| !may_judge(m) || m.order() <= plan.judge.order()));
            // What was not planned is said.
            let named = |method: &&Method| {
                let left = plan.left_out.iter().any(|left| left.choice.integrator == **method);
                methods.contains(method) || left
            };
            assert!(METHODS.iter().all(|method| named(&method)), "{plan:?}");
            tried.push(methods.len());
        }
        assert!(tried.is_sorted() && tried[0] < 3 && tried[5] == METHODS.len(), "{tried:?}");
    }

    #[test]
    fn nobody_is_judged_by_an_integrator_that_chooses_its_steps() {
        let alone = Options {
            integrators: vec![Method::BogackiShampine, Method::BackwardEuler],
            budget_seconds: 1e5,
            ..Options::default()
        };
        assert_eq!(plan(&[probe(3.0, 1e-2)], &alone, 3.0, &|_| false), None);
        let with_plain =
            Options { integrators: [&alone.integrators[..], &[Method::SymplecticEuler]].concat(), ..alone };
        let plan = plan(&[probe(3.0, 1e-2)], &with_plain, 3.0, &|_| false).unwrap();
        assert_eq!(plan.judge, Method::SymplecticEuler);
        assert!(plan.tasks.iter().filter(|task| task.reference).all(|task| task.choice.integrator == plan.judge));
    }

    #[test]
    fn f64_comes_last_and_only_of_what_would_be_f32() {
        for (budget_seconds, exact, double) in [(40.0, None, 0), (1e4, Some(4), 3)] {
            let options = Options { budget_seconds, ..Options::default() };
            let plan = plan(&[probe(3.0, 1e-2)], &options, 3.0, &|_| false).unwrap();
            let of = |arithmetic| plan.tasks.iter().filter(move |task| task.choice.arithmetic == arithmetic).count();
            assert_eq!(of(Arithmetic::Double), double, "{plan:?}");
            assert!(exact.is_none_or(|exact| of(Arithmetic::Exact) == exact));
            // Of every integrator that is tried, in f32 and might judge, f64 is planned or its lack is said.
            let said = plan.left_out.iter().filter(|left| left.choice.arithmetic == Arithmetic::Double).count();
            let tried = plan.tasks.iter().map(|task| &task.choice).filter(|choice| {
                (choice.fineness, choice.arithmetic) == (1.0, Arithmetic::Fast) && may_judge(choice.integrator)
            });
            assert_eq!(said + double, tried.count());
            let last = plan.tasks.last().unwrap().choice.arithmetic;
            assert_eq!(last == Arithmetic::Double, double > 0);
        }
    }

    #[test]
    fn what_lies_between_two_that_were_timed_lies_between_them() {
        let level = ProbeLine { other_seconds: 0.0, ..probe(3.0, 1e-2) };
        let of = |integrator, fineness, arithmetic| {
            level.seconds(&Choice { integrator, pitch_mm: 3.0, fineness, arithmetic }) / SLACK
        };
        let near = |found: f64, expected: f64| (found / expected - 1.0).abs() < 1e-12;
        assert!(near(of(Method::Verlet, 16.0, Arithmetic::Fast), 17.6));
        assert!(near(of(Method::Verlet, 2.0, Arithmetic::Exact), 2.2), "as fast as others");
        assert!(near(of(Method::SymplecticEuler, 1.0, Arithmetic::Double), 10.0));
        assert!(near(of(Method::SymplecticEuler, 1.0, Arithmetic::Exact), 1.0));
        assert!(near(of(Method::Rk4, 1.0, Arithmetic::Double), 33.0));
        // 30 at 1 and 90 at 8.
        assert!(near(of(Method::BackwardEuler, 8_f64.sqrt(), Arithmetic::Fast), 30.0 * 3_f64.sqrt()));
        assert!(near(of(Method::BackwardEuler, 16.0, Arithmetic::Fast), 180.0));
        assert!(near(of(Method::BackwardEuler, 0.5, Arithmetic::Fast), 15.0));
    }

    #[test]
    fn what_was_run_stays() {
        let probes = [probe(3.0, 1e-2), probe(2.25, 4e-2)];
        for options in [plain_alone(), Options::default()] {
            let options = Options { budget_seconds: 10.0, ..options };
            let short = plan(&probes, &options, 3.0, &|_| false).unwrap();
            assert!(short.left_out.len() > 3, "{short:?}");
            let kept = plan(&probes, &options, 3.0, &|_| true).unwrap();
            assert!(kept.left_out.is_empty(), "{kept:?}");
        }
    }

    #[test]
    fn pitches_that_failed_are_not_planned() {
        let lost = ProbeLine { failed: Some("no voxel is left".into()), ..probe(9.0, 1e-3) };
        assert_eq!(plan(std::slice::from_ref(&lost), &Options::default(), 3.0, &|_| false), None);
        let plan = plan(&[lost, probe(3.0, 1e-3)], &Options::default(), 3.0, &|_| false).unwrap();
        assert!(plan.tasks.iter().all(|task| task.choice.pitch_mm == 3.0));
    }
}
