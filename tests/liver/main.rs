//! A real liver under gravity settles to the same sag at every pitch.

use std::path::PathBuf;

use yawara::dynamics::measure::balance;
use yawara::dynamics::timeline::Timeline;
use yawara::geometry::Vector3;
use yawara::run::inputs;
use yawara::run::label_lookup::Files;
use yawara::run::prepare::prepare;

/// Lets a scene settle, stopping dead whenever the kinetic energy has passed a peak (Day 1965; Cundall
/// 1976). Gives the mean displacement by mass along -z [mm], the largest one [mm], and the steps.
fn sag(scene: &yawara::scene::resolved::Scene) -> (f64, f64, u64) {
    let inputs = inputs::load(scene).expect("the volumes are there");
    let prepared = prepare(scene, &inputs).expect("a good scene");
    let mut timeline = Timeline::new(&scene.operations, &prepared.lattice).expect("regions");
    let mut world = prepared.into_world(scene);
    let (mut before, mut highest, mut settled) = (0.0, 0.0_f64, false);
    let sunk = |world: &yawara::dynamics::World| {
        let mass: Vec<f64> = world.mass().iter().map(|&mass| f64::from(mass)).collect();
        let sum: f64 = (0..mass.len()).map(|p| -mass[p] * world.displacement(p as u32).z).sum();
        1e3 * sum / mass.iter().sum::<f64>()
    };
    while !settled && world.steps() < 60_000 {
        timeline.advance(&mut world);
        for _ in 0..10 {
            world.step().unwrap_or_else(|error| panic!("{error}"));
        }
        let kinetic = balance(&world).kinetic;
        if kinetic < before {
            (0..world.lattice().len() as u32).for_each(|p| world.set_velocity(p, Vector3::zeros()));
            highest = highest.max(before);
            // What still moves is a thousandth of the way.
            settled = before < 1e-6 * highest;
            before = 0.0;
        } else {
            before = kinetic;
        }
    }
    assert!(settled, "still moving after {} steps", world.steps());
    let largest = (0..world.lattice().len() as u32).map(|p| world.displacement(p).norm()).fold(0.0, f64::max);
    (sunk(&world), 1e3 * largest, world.steps())
}

/// Pitches from which the limit is found [mm].
const PITCHES: [f64; 5] = [18.0, 12.0, 9.0, 6.0, 4.5];

#[test]
fn a_liver_sags_alike_at_every_pitch() {
    let Some(sags) = sags(&PITCHES) else { return };
    let limit = limit_of(&sags);
    for (pitch, sag) in PITCHES.iter().zip(sags).skip(3) {
        is_near(limit, *pitch, sag);
    }
}

#[test]
#[ignore = "takes as long as all other pitches five times"]
fn the_voxels_of_the_label_map_sag_alike_too() {
    // At 3 mm the cells are whole voxels; coarser ones are partly filled at the border.
    let Some(sags) = sags(&[PITCHES.as_slice(), &[3.0]].concat()) else { return };
    is_near(limit_of(&sags[..PITCHES.len()]), 3.0, sags[PITCHES.len()]);
}

/// By how much the liver sinks on average at some pitches [mm]; `None` without the data.
fn sags(pitches: &[f64]) -> Option<Vec<f64>> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let path = root.join("fixtures/scenes/liver-sag.toml");
    let data = std::env::var_os("YAWARA_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    if !data.join("ct-abdomen-3mm").is_dir() {
        eprintln!("SKIPPED: no ct-abdomen-3mm in {}; set YAWARA_DATA", data.display());
        return None;
    }
    // The scene names its data beside the checkout; here they may be elsewhere.
    let text = std::fs::read_to_string(&path).unwrap().replace("../../../shared/data", &data.display().to_string());
    let folder = tempfile::tempdir().unwrap();
    let moved = folder.path().join("liver-sag.toml");
    std::fs::write(&moved, text).unwrap();
    let (mut scene, _) = yawara::scene::load(&moved, &Files).unwrap();
    let sag_at = |&pitch: &f64| {
        scene.lattice.pitch = Some(pitch * 1e-3);
        let (mean, largest, steps) = sag(&scene);
        println!(
            "pitch {pitch} mm: the liver sinks by {mean:.4} mm on average, {largest:.3} mm at most, {steps} steps"
        );
        mean
    };
    Some(pitches.iter().map(sag_at).collect())
}

/// What the sags at [`PITCHES`] tend to [mm].
fn limit_of(sags: &[f64]) -> f64 {
    let (limit, order, misfit) = fit(&PITCHES, sags);
    println!("from 18 to 4.5 mm: sag = {limit:.4} mm + c pitch^{order:.2}, within {:.1} %", 100.0 * misfit);
    assert!((0.8..2.5).contains(&order) && misfit < 0.01, "order {order}, misfit {misfit}");
    limit
}

fn is_near(limit: f64, pitch: f64, sag: f64) {
    let off = sag / limit - 1.0;
    println!("pitch {pitch} mm: {:+.1} % from that limit", 100.0 * off);
    assert!(off.abs() < 0.06, "pitch {pitch}: {sag} mm of {limit} mm");
}

/// `limit + c pitch^order` through all sags by least squares (the order with the smallest largest misfit), and the largest misfit relative to the limit.
fn fit(pitches: &[f64], sags: &[f64]) -> (f64, f64, f64) {
    let count = pitches.len() as f64;
    let at_order = |order: f64| {
        let powers: Vec<f64> = pitches.iter().map(|pitch| pitch.powf(order)).collect();
        let (mean_x, mean_y) = (powers.iter().sum::<f64>() / count, sags.iter().sum::<f64>() / count);
        let covariance: f64 = powers.iter().zip(sags).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
        let slope = covariance / powers.iter().map(|x| (x - mean_x).powi(2)).sum::<f64>();
        let limit = mean_y - slope * mean_x;
        let misfits = powers.iter().zip(sags).map(|(x, y)| ((limit + slope * x - y) / limit).abs());
        (limit, order, misfits.fold(0.0, f64::max))
    };
    (5..60).map(|n| at_order(0.05 * f64::from(n))).min_by(|a, b| a.2.total_cmp(&b.2)).expect("orders to try")
}
