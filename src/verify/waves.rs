//! Waves and vibrations of stepped lattices against the exact dispersion relation and against beam theory.

use std::f64::consts::{PI, TAU};

use super::lattices::{MATERIAL, bar};
use super::{Case, Finding, Group};
use crate::dynamics::stable_dt::stable_dt;
use crate::geometry::Vector3;
use crate::lattice::Topology;
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS};
use crate::material::tissue::TissueBody;

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Waves, name, asked, run };
    vec![
        case("p-wave", "a pressure wave 12 cells long has the speed of the exact dispersion relation", p_wave),
        case("s-wave", "so has a shear wave", s_wave),
        case("bending-frequency", "a clamped beam swings at its first bending frequency, 8 cells across", bending),
    ]
}

fn p_wave() -> Finding {
    wave(0)
}

fn s_wave() -> Finding {
    wave(1)
}

/// A plane wave along x that moves particles along an axis, in the middle of a block whose border it has not heard of yet.
fn wave(axis: usize) -> Finding {
    const LENGTH: usize = 12;
    // Further from every face than the fastest wave goes in the time of the measurement.
    const MIDDLE: usize = 24;
    let (mut worst, mut texts, mut steps) = (0.0_f64, Vec::new(), 0);
    for nu in [0.1, 0.25, 0.45] {
        let body = TissueBody { poissons_ratio: nu, ..MATERIAL };
        let solid = bar([2 * MIDDLE; 3], body);
        let h = solid.lattice.pitch;
        let middle = solid.lattice.particle_at[solid.lattice.grid.shape.linear([MIDDLE + 1; 3])];
        let wavenumber = TAU / LENGTH as f64;
        // Squared frequency of the lattice in continuous time, spring by spring; a cell feels the mean of its four edges.
        let springs: f64 = (0..NEIGHBOURS)
            .map(|direction| {
                let offset = Vector3::from(OFFSETS[direction].map(f64::from));
                let share = (offset[axis] / offset.norm()).powi(2);
                solid.assembly.stiffness.of(&solid.lattice, middle, direction)
                    * share
                    * (1.0 - (wavenumber * offset.x).cos())
            })
            .sum();
        let cells = if axis == 0 { 2.0 * body.volume_modulus() * h * (1.0 - wavenumber.cos()) } else { 0.0 };
        let expected = (springs + cells) / (body.density * h.powi(3));

        let speed_of_sound = {
            let mu = body.spring_modulus() / 2.5;
            ((body.volume_modulus() + 3.0 * mu) / body.density).sqrt()
        };
        // The volume term is not in this bound; half of the time a pressure wave needs for a cell is safe for both.
        let limit = stable_dt(&solid.lattice, &Topology::new(&solid.lattice), &solid.assembly);
        let dt = (0.5 * limit).min(0.3 * h / speed_of_sound);
        let places: Vec<f64> = (0..solid.lattice.len() as u32).map(|p| solid.place(p).x).collect();
        let mut world = solid.world(dt);
        for (p, x) in places.iter().enumerate() {
            let mut u = Vector3::zeros();
            u[axis] = 1e-3 * h * (wavenumber * (x / h - MIDDLE as f64)).cos();
            world.set_displacement(p as u32, u);
        }
        // The border's news comes at the speed of sound, with forerunners.
        let count = (0.5 * MIDDLE as f64 * h / (speed_of_sound * dt)) as usize;
        let mut heard = vec![world.displacement(middle)[axis]];
        for _ in 0..count {
            world.step().expect("a small wave");
            heard.push(world.displacement(middle)[axis]);
        }
        steps += count as u64;
        // Of a single frequency: u(n + 1) + u(n - 1) = 2 cos(w dt) u(n), and symplectic Euler turns w^2 into 2 - 2 cos(w dt).
        let (mut cross, mut square) = (0.0, 0.0);
        for triple in heard.windows(3) {
            cross += triple[1] * (triple[0] - 2.0 * triple[1] + triple[2]);
            square += triple[1] * triple[1];
        }
        let found = -cross / square / (dt * dt);
        let error = (found / expected).sqrt() - 1.0;
        worst = worst.max(error.abs());
        let speed = |square: f64| square.sqrt() / (wavenumber / h);
        texts.push(format!("nu {nu}: {:.4} m/s of {:.4} m/s", speed(found), speed(expected)));
    }
    Finding { happened: texts.join("; "), error: worst, allowed: 1e-3, steps }
}

fn bending() -> Finding {
    const ACROSS: usize = 8;
    const SLENDERNESS: usize = 10;
    let solid = bar([SLENDERNESS * ACROSS, ACROSS, ACROSS], MATERIAL);
    let h = solid.lattice.pitch;
    let (length, side) = (SLENDERNESS as f64 * ACROSS as f64 * h, ACROSS as f64 * h);
    let clamped = solid.layer(0, 0);
    let tip = solid.layer(0, SLENDERNESS * ACROSS)[ACROSS * (ACROSS + 1) / 2];
    let places: Vec<Vector3> = (0..solid.lattice.len() as u32).map(|p| solid.place(p)).collect();
    let limit = stable_dt(&solid.lattice, &Topology::new(&solid.lattice), &solid.assembly);
    let mut world = solid.world(0.95 * limit);
    world.hold(&clamped);
    // The first shape of a clamped beam, with cross-sections that stay at right angles to it.
    const ROOT: f64 = 1.875_104_069;
    let shape = |x: f64| {
        let (b, s) = (ROOT * x / length, (ROOT.cosh() + ROOT.cos()) / (ROOT.sinh() + ROOT.sin()));
        let value = b.cosh() - b.cos() - s * (b.sinh() - b.sin());
        let slope = (b.sinh() + b.sin() - s * (b.cosh() - b.cos())) * ROOT / length;
        (0.5 * value, 0.5 * slope)
    };
    let amplitude = 0.1 * h;
    for (p, place) in places.iter().enumerate() {
        let (deflection, slope) = shape(place.x);
        let along = -(place.z - 0.5 * side) * slope;
        world.set_displacement(p as u32, Vector3::new(along, 0.0, deflection) * amplitude);
    }
    let (mut crossings, mut before) = (Vec::new(), world.displacement(tip).z);
    while crossings.len() < 2 && world.steps() < 200_000 {
        world.step().expect("a small swing");
        let now = world.displacement(tip).z;
        if before * now < 0.0 {
            crossings.push(world.time() - world.dt() * now / (now - before));
        }
        before = now;
    }
    let found = match crossings[..] {
        [first, second] => 0.5 / (second - first),
        _ => f64::NAN,
    };
    // Euler and Bernoulli's, corrected for shear (Dunkerley) and for the inertia of turning cross-sections (Rayleigh).
    let speed = (MATERIAL.youngs_modulus / MATERIAL.density).sqrt();
    let bending = ROOT * ROOT * speed * side / (12.0_f64.sqrt() * length * length);
    let kappa: f64 = 10.0 * 1.25 / (12.0 + 11.0 * 0.25);
    let shear = 0.5 * PI / length * (kappa / 2.5).sqrt() * speed;
    let turning = 4.65 * side * side / (12.0 * length * length);
    let expected = 1.0 / (1.0 / bending.powi(2) + 1.0 / shear.powi(2)).sqrt() / (1.0 + turning).sqrt() / TAU;
    Finding {
        happened: format!(
            "{found:.4} Hz of {expected:.4} Hz of Timoshenko's beam, clamped at one end, 1 : {SLENDERNESS}"
        ),
        error: (found / expected - 1.0).abs(),
        allowed: 0.02,
        steps: world.steps(),
    }
}
