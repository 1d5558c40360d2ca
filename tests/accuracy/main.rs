//! `accuracy`: the bound that a scene asks for is kept, or said not to be.
//!
//! Every run is compared with a far finer one: on the same lattice where the scene names its pitch, on a lattice of half the
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
use yawara::volume::Volume;

const METHODS: [Method; 3] = [Method::SymplecticEuler, Method::Verlet, Method::Rk4];
/// A reference on the same lattice has steps so much shorter, with the best integrator that the scene allows.
const SHORTER: f64 = 8.0;
/// A reference on a finer lattice has so much smaller a pitch.
const FINER: f64 = 2.0;

/// What came of a search, and what is true.
struct Found {
    trial: Trial,
    estimate: Estimate,
    kept: bool,
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
    let mut search = Search::new(scene, inputs).unwrap();
    let mut spent = 0.0;
    let mut tell = |told: &Told<'_>| {
        if let Told::Ended(trial) = told {
            spent += cost(trial);
        }
    };
    let mut choice = search.first(&mut tell).unwrap();
    loop {
        let trial = match Trial::run(choice, scene, inputs, &mut |_| {}) {
            Ok(trial) => trial,
            Err(AccuracyError::Step(error)) => {
                choice = search.in_place_of(&choice, &mut tell).unwrap().unwrap_or_else(|| panic!("{error}"));
                continue;
            }
            Err(error) => panic!("{error}"),
        };
        tell(&Told::Ended(&trial));
        let (estimate, kept) = match search.judge(trial.clone(), &mut tell).unwrap() {
            Verdict::Kept(estimate) => (estimate, true),
            Verdict::Missed(estimate, why) => {
                assert!(!why.is_empty());
                (estimate, false)
            }
            Verdict::Again(_, next) => {
                assert!(next != choice);
                choice = next;
                continue;
            }
        };
        return Found { trial, estimate, kept, spent };
    }
}

/// What a run is compared with.
fn reference(scene: &Scene, inputs: &Inputs, own: Choice) -> Trial {
    let choice = if case_is_fixed(scene) {
        let plain = needs_plain_step(&scene.organs, &scene.operations).is_some();
        let method = if plain { Method::SymplecticEuler } else { Method::Rk4 };
        Choice { method, fineness: SHORTER, ..own }
    } else {
        Choice { pitch_mm: own.pitch_mm / FINER, method: Method::SymplecticEuler, fineness: 1.0 }
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

/// Of scenes that were not seen while the search was made, 19 in 20 keep their bound, and none is off by more than twice that.
fn keeps_its_promise(cases: &[Case]) {
    let (mut promised, mut broken) = (0, 0);
    for case in cases {
        let (scene, inputs) = load(case);
        let found = find(&scene, &inputs);
        let error = error(&found.trial, &reference(&scene, &inputs, found.trial.choice));
        let row = row(case, &found, error);
        println!("{row}");
        if found.kept {
            promised += 1;
            broken += usize::from(error > case.accuracy);
            assert!(error <= 2.0 * case.accuracy, "{row}");
        }
    }
    assert!(20 * broken <= cases.len(), "{broken} of {promised} promises broken");
    assert!(5 * promised >= 4 * cases.len(), "{promised} of {} promised", cases.len());
}

#[test]
fn steps_keep_their_promise() {
    keeps_its_promise(FIXED);
}

#[test]
fn pitches_keep_their_promise() {
    keeps_its_promise(FREE);
}

/// Two voxels to the edge have no coarser lattice, so that nothing tells the error of theirs.
#[test]
fn too_few_voxels_are_no_ground_to_judge_by() {
    let (scene, mut inputs) = load(FREE.iter().find(|case| case.name == "heavy, free").unwrap());
    let labels = inputs.labels.take().unwrap();
    let shape = labels.grid().shape;
    let low = |place: usize| shape.ijk(place).iter().all(|&index| index < 4);
    let few = labels.as_slice().iter().enumerate().map(|(place, &label)| if low(place) { label } else { 0 }).collect();
    inputs.labels = Some(Volume::from_vec(*labels.grid(), few));
    let found = find(&scene, &inputs);
    assert!(!found.kept && found.estimate.pitch.is_none(), "{:?}", found.estimate);
    assert_eq!((found.trial.choice.pitch_mm, found.trial.len()), (10.0, 27));
}

/// Run by name: `cargo test --test accuracy price -- --ignored --nocapture`. Longer scenes, and for all of them the cheapest
/// choice that there is.
#[test]
#[ignore = "a measurement"]
fn price_of_a_promise() {
    keeps_its_promise(LONG);
    let (mut dear, mut all) = (0, 0);
    for case in FIXED.iter().chain(FREE).chain(LONG) {
        let (scene, inputs) = load(case);
        let found = find(&scene, &inputs);
        let reference = reference(&scene, &inputs, found.trial.choice);
        let own = found.trial.choice;
        let plain = needs_plain_step(&scene.organs, &scene.operations).is_some();
        let choices: Vec<Choice> = if case_is_fixed(&scene) {
            let methods = if plain { &METHODS[..1] } else { &METHODS };
            let steps = [1.0, 1.4, 2.0, 2.8, 4.0, 8.0, 16.0];
            let choice = |&method| steps.map(|fineness| Choice { method, fineness, ..own });
            methods.iter().flat_map(choice).collect()
        } else {
            let coarser = [4.0 / 3.0, 1.5, 2.0, 3.0].map(|share| Choice { pitch_mm: share * own.pitch_mm, ..own });
            coarser.into_iter().chain([own]).collect()
        };
        let mut tried: Vec<(f64, Choice)> = Vec::new();
        for choice in choices {
            let Ok(trial) = Trial::run(choice, &scene, &inputs, &mut |_| {}) else { continue };
            if error(&trial, &reference) <= case.accuracy {
                tried.push((cost(&trial), choice));
            }
        }
        let best = tried.iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let own_cost = cost(&found.trial);
        if let Some((least, best)) = best.filter(|_| found.kept) {
            println!("{:22} {:.1} times the cost of {best}", case.name, own_cost / least);
            all += 1;
            dear += usize::from(own_cost > 3.0 * least);
        }
    }
    println!("{dear} of {all} cost more than three times the best");
}
