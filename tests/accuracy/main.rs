//! `accuracy`: the bound that a scene asks for is kept, or said not to be.
//!
//! Every run is compared with a far finer one: on the same lattice where the scene names its pitch, on a lattice of a third of the
//! pitch where the program chose it.

mod scenes;

use std::path::Path;

use scenes::{Case, FIXED, FREE, LONG};
use yawara::accuracy::search::Told;
use yawara::accuracy::{AccuracyError, Choice, Estimate, Search, Trial, Verdict};
use yawara::dynamics::integrator::Method;
use yawara::run::inputs::{self, Inputs};
use yawara::run::label_lookup::Files;
use yawara::scene::resolved::{Model, Scene, needs_plain_step};
use yawara::study::plan::{Options, PITCHES};
use yawara::volume::Volume;

const METHODS: [Method; 3] = [Method::SymplecticEuler, Method::Verlet, Method::Rk4];
/// A reference on the same lattice has steps so much shorter, with the best integrator that the scene allows.
const SHORTER: f64 = 8.0;
/// A reference on a finer lattice has so much smaller a pitch,
const FINER: [f64; 2] = [3.0, 2.0];
/// the first that makes it no larger than this.
const MOST_PARTICLES: f64 = 2e4;

/// Edge of the voxels of all scenes, and so the pitch that a study starts from.
const VOXEL_MM: f64 = 10.0;

/// What came of a search, and what is true.
struct Found {
    trial: Trial,
    estimate: Estimate,
    kept: bool,
    /// A coarser choice that keeps the bound too.
    enough: Option<Choice>,
    /// Particles times force evaluations of all that was run to choose and judge it.
    spent: f64,
}

fn load(case: &Case) -> (Scene, Inputs) {
    let text = case.text();
    let (scene, _) = yawara::scene::parse(&text, Path::new(case.name), Path::new(""), &Files)
        .unwrap_or_else(|error| panic!("{}: {error:?}", case.name));
    let inputs = inputs::load(&scene).unwrap();
    (scene, inputs)
}

fn cost(trial: &Trial) -> f64 {
    let evaluations = trial.choice.method.evaluations().unwrap_or(1);
    (trial.len() as u64 * trial.steps * evaluations) as f64
}

fn run(choice: Choice, scene: &Scene, inputs: &Inputs) -> Trial {
    Trial::run(choice, scene, inputs, &mut |_| {}).unwrap()
}

/// Searches as the command line does, in memory.
fn find(scene: &Scene, inputs: &Inputs) -> Found {
    let mut search = Search::new(scene, inputs).unwrap().unwrap();
    let mut spent = 0.0;
    let mut tell = |told: &Told<'_>| {
        if let Told::Ended(trial) = told {
            spent += cost(trial);
        }
    };
    let mut choice = search.first(&mut tell).unwrap();
    loop {
        let run = match Trial::run(choice, scene, inputs, &mut |_| {}) {
            Ok(trial) => Ok(trial),
            Err(AccuracyError::Step(error)) => Err(error),
            Err(error) => panic!("{error}"),
        };
        if let Ok(trial) = &run {
            tell(&Told::Ended(trial));
        }
        let trial = run.as_ref().ok().cloned();
        let (estimate, kept, enough) = match search.judge(&choice, run, &mut tell).unwrap() {
            Verdict::Kept(estimate, enough) => (estimate, true, enough),
            Verdict::Missed(estimate, why) => {
                assert!(!why.is_empty());
                (estimate, false, None)
            }
            Verdict::Again(_, next) => {
                assert!(next != choice);
                choice = next;
                continue;
            }
            Verdict::Diverged(error) => panic!("{error}"),
        };
        return Found { trial: trial.unwrap(), estimate, kept, enough, spent };
    }
}

/// What a run is compared with.
fn reference(scene: &Scene, inputs: &Inputs, own: &Trial) -> Trial {
    let choice = if case_is_fixed(scene) {
        let plain = needs_plain_step(&scene.organs, &scene.operations, scene.sleep).is_some();
        let method = if plain { Method::SymplecticEuler } else { Method::Rk4 };
        Choice { method, fineness: SHORTER, ..own.choice }
    } else {
        let fits = |finer: &f64| own.len() as f64 * finer.powi(3) < MOST_PARTICLES;
        let finer = FINER.into_iter().find(fits).unwrap_or(FINER[1]);
        Choice { pitch_mm: own.choice.pitch_mm / finer, method: Method::SymplecticEuler, fineness: 1.0 }
    };
    run(choice, scene, inputs)
}

fn case_is_fixed(scene: &Scene) -> bool {
    scene.lattice.pitch.is_some() || scene.lattice.model == Model::Paper
}

/// The error of a run by its reference, relative: at most this, where the error falls at least with the pitch itself.
fn error(trial: &Trial, reference: &Trial) -> f64 {
    let same = trial.choice.pitch_mm == reference.choice.pitch_mm;
    let falls = if same { 1.0 } else { 1.0 / (1.0 - reference.choice.pitch_mm / trial.choice.pitch_mm) };
    falls * trial.distance(reference).unwrap().rms_mm / reference.largest_mm
}

fn row(case: &Case, found: &Found, error: f64) -> String {
    format!(
        "{:22} asked {:7.1e}, estimated {:7.1e}, true {error:7.1e}, {}; {}; in all {:.1} times its own cost",
        case.name,
        case.accuracy,
        found.estimate.error(),
        if found.kept { "kept" } else { "missed" },
        found.trial.choice,
        found.spent / cost(&found.trial)
    )
}

/// Of scenes, 19 in 20 keep their bound, and none is off by more than twice that.
fn keeps_its_promise(cases: &[Case]) {
    let (mut promised, mut broken) = (0, 0);
    for case in cases {
        let (scene, inputs) = load(case);
        let found = find(&scene, &inputs);
        let reference = reference(&scene, &inputs, &found.trial);
        let error = error(&found.trial, &reference);
        let row = row(case, &found, error);
        println!("{row}");
        if found.kept {
            promised += 1;
            broken += usize::from(error > case.accuracy);
            assert!(error <= 2.0 * case.accuracy, "{row}");
        }
        if let Some(enough) = found.enough {
            let enough_run = run(enough, &scene, &inputs);
            // A part of its pitch may be one at which a box is not whole, and be no reference.
            let error = self::error(&enough_run, &reference);
            println!("{:22} {enough} would have been enough: true {error:7.1e}", "");
            assert!(error <= 1.5 * case.accuracy, "{row}: {enough}: {error}");
        }
    }
    assert!(20 * broken <= cases.len(), "{broken} of {promised} promises broken");
    assert!(4 * promised >= 3 * cases.len(), "{promised} of {} promised", cases.len());
}

#[test]
fn steps_keep_their_promise() {
    keeps_its_promise(FIXED);
}

#[test]
fn pitches_keep_their_promise() {
    keeps_its_promise(FREE);
}

/// A load that came with the next step would be late by a part of one: an error of first order whatever the integrator.
#[test]
fn what_comes_between_two_frames_costs_no_order() {
    let loads = "[[push]]\nregion = { half_space = { point = [0, 0, 29.9], normal = [0, 0, 1] } }\nforce = [0.1, 0, -0.3]\n\
                 from = 0.0213\nto = 0.0871\n";
    let case = Case { name: "between frames", loads, ..*FIXED.iter().find(|case| case.name == "squeezed").unwrap() };
    let (scene, inputs) = load(&case);
    let way = |fineness: f64| run(Choice { pitch_mm: 10.0, method: Method::Verlet, fineness }, &scene, &inputs);
    let [first, second, third] = [1.0, 2.0, 4.0].map(way);
    let ratio = first.distance(&second).unwrap().rms_mm / second.distance(&third).unwrap().rms_mm;
    assert!((ratio - 4.0).abs() < 0.4, "{ratio}");
}

/// One voxel has too few coarser lattices, so that nothing tells the error of its own.
#[test]
fn too_few_voxels_are_no_ground_to_judge_by() {
    let (scene, mut inputs) = load(FREE.iter().find(|case| case.name == "heavy, free").unwrap());
    let labels = inputs.labels.take().unwrap();
    let shape = labels.grid().shape;
    let low = |place: usize| shape.ijk(place).iter().all(|&index| index < 3);
    let few = labels.as_slice().iter().enumerate().map(|(place, &label)| if low(place) { label } else { 0 }).collect();
    inputs.labels = Some(Volume::from_vec(*labels.grid(), few));
    let found = find(&scene, &inputs);
    assert!(!found.kept && found.estimate.pitch.is_none(), "{:?}", found.estimate);
    assert_eq!((found.trial.choice.pitch_mm, found.trial.len()), (10.0, 8));
}

/// What a study of a scene tries by itself: at a named pitch all integrators and steps, else all pitches too.
fn studied(scene: &Scene, own: Choice) -> Vec<Choice> {
    let plain = needs_plain_step(&scene.organs, &scene.operations, scene.sleep).is_some();
    let methods = if plain { &METHODS[..1] } else { &METHODS };
    let pitches =
        if case_is_fixed(scene) { vec![own.pitch_mm] } else { PITCHES.map(|share| share * VOXEL_MM).to_vec() };
    let finenesses = Options::default().finenesses;
    let mut all = Vec::new();
    for pitch_mm in pitches {
        for &method in methods {
            all.extend(finenesses.iter().map(|&fineness| Choice { pitch_mm, method, fineness }));
        }
    }
    all
}

/// Run by name: `cargo test --test accuracy price -- --ignored --nocapture`. Longer scenes, and for all of them the cheapest
/// choice that a study would find.
#[test]
#[ignore = "a measurement"]
fn price_of_a_promise() {
    keeps_its_promise(LONG);
    let (mut dear, mut all) = (0, 0);
    for case in FIXED.iter().chain(FREE).chain(LONG) {
        let (scene, inputs) = load(case);
        let found = find(&scene, &inputs);
        let own = found.trial.choice;
        let least_own = found.enough.unwrap_or(own);
        let choices = studied(&scene, own);
        let finest = choices.iter().copied().chain([own]).min_by(|a, b| a.pitch_mm.total_cmp(&b.pitch_mm));
        let reference = reference(&scene, &inputs, &run(finest.unwrap_or(own), &scene, &inputs));
        let keeps = |trial: &Trial| error(trial, &reference) <= case.accuracy;
        let tried = choices.into_iter().filter_map(|choice| Trial::run(choice, &scene, &inputs, &mut |_| {}).ok());
        let kept = tried.filter(keeps).map(|trial| (cost(&trial), trial.choice));
        let best = kept.min_by(|a, b| a.0.total_cmp(&b.0));
        let own_cost = cost(&run(least_own, &scene, &inputs));
        match best.filter(|_| found.kept) {
            Some((least, best)) => {
                let (share, spent) = (own_cost / least, found.spent / least);
                println!(
                    "{:22} {least_own}: {share:.1} times the cost of {best}, {spent:.1} times with trials",
                    case.name
                );
                all += 1;
                dear += usize::from(share > 3.0);
            }
            None => println!("{:22} {own}: {}, nothing that a study tries keeps the bound", case.name, found.kept),
        }
    }
    println!("{dear} of {all} cost more than three times the best");
}
