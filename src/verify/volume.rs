//! How much volume tissue loses when it is pressed, against its Poisson's ratio, and what keeping it costs.

use super::lattices::composite_at;
use super::{Case, Finding, Group};
use crate::dynamics::World;
use crate::dynamics::measure::cell_volume;
use crate::dynamics::stable_dt::{SAFETY, stable_dt};
use crate::geometry::Vector3;
use crate::lattice::Topology;
use crate::material::tissue::{Damping, TissueBody};

/// From what springs alone have to nearly incompressible.
const RATIOS: [f64; 4] = [0.25, 0.40, 0.45, 0.49];
/// Cells along each edge of the block.
const CELLS: usize = 6;
/// Edge of a cell [mm].
const PITCH_MM: f64 = 5.0;
const YOUNGS_MODULUS: f64 = 5e3;
/// Ten times the slowest swing of the block along itself, which dies down within two under [`DAMPING_RATIO`] [s].
const REST_AFTER: f64 = 0.3;
const DAMPING_RATIO: f64 = 0.5;
/// Small strain: what is of second order in it is taken out by pulling as well as pressing.
const SMALL_STRAIN: f64 = 1e-3;
/// What the plates take away from the height of the block.
const PRESSED: f64 = 0.2;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            group: Group::Solids,
            name: "volume-at-small-strain",
            asked: "a block pressed and pulled by a small even stress, free at its sides, changes its volume by (1 - 2 nu) \
                    times its strain, for nu = 0.25, 0.40, 0.45 and 0.49",
            run: at_small_strain,
        },
        Case {
            group: Group::Solids,
            name: "volume-when-pressed",
            asked: "a block pressed by 20 % between two glued plates loses less volume the nearer nu is to 1/2; the error is \
                    the largest loss relative to that of the Poisson's ratio before",
            run: when_pressed,
        },
    ]
}

/// The particles of the lowest or the highest layer.
type Layer = Vec<u32>;

/// A block of tissue with the step the program would choose, and its two ends along z.
fn block(poissons_ratio: f64) -> (World, [Layer; 2]) {
    let body = TissueBody {
        youngs_modulus: YOUNGS_MODULUS,
        poissons_ratio,
        density: 1060.0,
        damping: Damping::Ratio(DAMPING_RATIO),
    };
    let solid = composite_at(PITCH_MM, [CELLS; 3], &[body], |_| 0);
    let dt = SAFETY * stable_dt(&solid.lattice, &Topology::new(&solid.lattice), &solid.assembly);
    let ends = [solid.layer(2, 0), solid.layer(2, CELLS)];
    (solid.world(dt), ends)
}

/// Steps until the block has come to rest; false when it diverged.
fn settle(world: &mut World) -> bool {
    let end = world.time() + REST_AFTER;
    while world.time() < end {
        if world.step().is_err() {
            return false;
        }
    }
    true
}

/// Change of volume relative to rest.
fn change(world: &World) -> f64 {
    let volume = cell_volume(world.lattice(), world.topology(), |particle| world.displacement(particle));
    volume.change().unwrap_or(f64::NAN)
}

/// Mean strain between the ends.
fn strain(world: &World, [low, high]: &[Layer; 2]) -> f64 {
    let mean =
        |layer: &Layer| layer.iter().map(|&particle| world.displacement(particle).z).sum::<f64>() / layer.len() as f64;
    (mean(high) - mean(low)) / (CELLS as f64 * PITCH_MM * 1e-3)
}

fn at_small_strain() -> Finding {
    let area = (CELLS as f64 * PITCH_MM * 1e-3).powi(2);
    let force = YOUNGS_MODULUS * SMALL_STRAIN * area;
    let (mut error, mut steps, mut shown) = (0.0_f64, 0, Vec::new());
    for poissons_ratio in RATIOS {
        // Strain and change of volume, pulled less pressed.
        let (mut strains, mut changes) = (0.0, 0.0);
        for sign in [1.0, -1.0] {
            let (mut world, ends) = block(poissons_ratio);
            // Shared by mass, which in an end layer is in proportion to the area around each particle: an even stress.
            for (end, outward) in ends.iter().zip([-1.0, 1.0]) {
                let pull = world.push(end);
                world.set_force(pull, Vector3::z() * (sign * outward * force));
            }
            if !settle(&mut world) {
                error = f64::NAN;
            }
            strains += sign * strain(&world, &ends);
            changes += sign * change(&world);
            steps += world.steps();
        }
        let (found, expected) = (changes / strains, 1.0 - 2.0 * poissons_ratio);
        let off = (found / expected - 1.0).abs();
        // An error that is no number stays one.
        error = if off > error || off.is_nan() { off } else { error };
        shown.push(format!("{found:.4} at {poissons_ratio:.2} ({expected:.2})"));
    }
    let happened = format!("change of volume over strain, with the expected value: {}", shown.join(", "));
    Finding { happened, error, allowed: 1e-3, steps }
}

fn when_pressed() -> Finding {
    let (mut error, mut steps, mut shown) = (0.0_f64, 0, Vec::new());
    let mut before: Option<f64> = None;
    for poissons_ratio in RATIOS {
        let (mut world, [low, high]) = block(poissons_ratio);
        world.hold(&low);
        let plate = world.grab(&high);
        let height_mm = CELLS as f64 * PITCH_MM;
        let planned = (0.5 * REST_AFTER / world.dt()).ceil();
        let mut whole = true;
        for step in 1..=planned as u64 {
            world.move_grab(plate, Vector3::z() * (-PRESSED * height_mm * step as f64 / planned));
            whole &= world.step().is_ok();
        }
        whole &= settle(&mut world);
        let loss = if whole { -change(&world) } else { f64::NAN };
        if let Some(before) = before {
            let ratio = loss / before;
            error = if ratio > error || ratio.is_nan() { ratio } else { error };
        }
        before = Some(loss);
        steps += world.steps();
        shown.push(format!("{:.2} % at {poissons_ratio:.2} ({} steps)", 100.0 * loss, world.steps()));
    }
    let happened = format!("lost {} over {:.2} s", shown.join(", "), 1.5 * REST_AFTER);
    Finding { happened, error, allowed: 0.9, steps }
}
