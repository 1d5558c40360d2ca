//! The stable step: where it ends, and that no scene gets beyond it.

use std::collections::BTreeSet;

use nalgebra::DMatrix;

use super::bodies::{
    ALL_MODELS, MODELS, Model, Organ, Random, Trial, alone, blob, block_of, centre, energy, largest, lattice,
    particles, pieces, rest_place, shake, springs, state,
};
use super::tally::Tally;
use super::{Case, Finding, Group};
use crate::cut::Blade;
use crate::dynamics::measure::balance;
use crate::dynamics::reference_world::ReferenceWorld;
use crate::dynamics::stable_dt::Limits;
use crate::dynamics::{StepError, World};
use crate::geometry::{Point3, Vector3};
use crate::kernel::reference::{spring_forces, volume_forces};
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Step, name, asked, run };
    vec![
        case(
            "stability-pair",
            "0.99 of the true limit holds for 20 000 steps; 1.01 of it is caught, with dampers and without",
            stability_pair,
        ),
        case(
            "random-scenes",
            "200 random scenes of materials, dampers, cuts, tools and forces never diverge with the step the program chooses",
            random_scenes,
        ),
        case(
            "every-cut",
            "a cut severs the springs that brute force finds, changes no momentum, lowers no limit, and parts what it parts",
            every_cut,
        ),
    ]
}

/// The largest stable step from the eigenvalues of stiffness and damping matrices, which are differences of the forces in
/// f64 [s].
///
/// Symplectic Euler with dampers read at the old velocity is stable while `M^-1 (dt^2 K + 2 dt C)` stays below 4.
fn true_limit(lattice: &Lattice, assembly: &Assembly, near: f64) -> f64 {
    let topology = Topology::new(lattice);
    let n = 3 * lattice.len();
    let still = vec![Vector3::zeros(); lattice.len()];
    let forces = |u: &[Vector3], v: &[Vector3]| -> Vec<Vector3> {
        let springs = spring_forces(lattice, &topology, assembly, u, v, near);
        let cells = volume_forces(lattice, &topology, assembly, u, v, near);
        springs.iter().zip(&cells).map(|(s, c)| s + c).collect()
    };
    // Scaled by the roots of both masses, so that it is symmetric.
    let matrix = |little: f64, of: &dyn Fn(&[Vector3]) -> Vec<Vector3>| {
        let root = |i: usize| f64::from(assembly.mass[i / 3]).sqrt();
        let mut matrix = DMatrix::zeros(n, n);
        for column in 0..n {
            let at = |by: f64| {
                let mut moved = still.clone();
                moved[column / 3][column % 3] = by;
                of(&moved)
            };
            let (up, down) = (at(little), at(-little));
            for row in 0..n {
                let force = (up[row / 3][row % 3] - down[row / 3][row % 3]) / (2.0 * little);
                matrix[(row, column)] = -force / (root(row) * root(column));
            }
        }
        0.5 * (&matrix + matrix.transpose())
    };
    let little = 1e-5 * lattice.pitch;
    let stiffness = matrix(little, &|u| forces(u, &still));
    let damping = matrix(little / near, &|v| forces(&still, v));
    let stable = |dt: f64| (&stiffness * (dt * dt) + &damping * (2.0 * dt)).symmetric_eigenvalues().max() < 4.0;
    let (mut low, mut high) = (0.5 * near, 2.0 * near);
    while high - low > 1e-7 * near {
        let middle = 0.5 * (low + high);
        *(if stable(middle) { &mut low } else { &mut high }) = middle;
    }
    low
}

/// 20 000 steps, or until one fails: how many, and how far places went [pitches].
fn many_steps<W>(
    world: &mut W,
    step: impl Fn(&mut W) -> Result<(), StepError>,
    farthest: impl Fn(&W) -> f64,
) -> (u64, Result<f64, StepError>) {
    let mut most = 0.0_f64;
    for count in 1..=20_000 {
        if let Err(error) = step(world) {
            return (count, Err(error));
        }
        if count % 20 == 0 {
            most = most.max(farthest(world));
        }
    }
    (20_000, Ok(most))
}

fn stability_pair() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let (mut diverged, mut alternated, mut latest, mut shares) = (0, 0, 0, Vec::new());
        for model in ALL_MODELS {
            for damping in [0.0, 0.02, 0.1, 0.3, 1.0] {
                let dims = if model == Model::Paper { [3, 3, 2] } else { [2, 1, 1] };
                let rest = Trial::new(block_of(model, 3.0, dims, damping));
                let limit = true_limit(rest.world.lattice(), rest.world.assembly(), rest.limits.sharp);
                shares.push(rest.limits.sharp / limit);
                let h = rest.world.lattice().pitch;
                for share in [0.99, 1.01] {
                    // Small: close to the limit even a thousandth of a pitch grows until it shifts the limit itself.
                    let mut world = rest.world.clone();
                    world.set_dt(share * limit);
                    shake(&mut world, 1e-4, 0.0, &mut Random::new(9));
                    let mut twin = ReferenceWorld::of(&world);
                    let norms = |of: &[Vector3]| largest(of.iter().map(|u| u.norm() / h));
                    let single = many_steps(&mut world, World::step, |world| norms(&state(world).0));
                    let double = many_steps(&mut twin, ReferenceWorld::step, |twin| norms(twin.displacement()));
                    for (precision, (steps, result)) in [("f32", single), ("f64", double)] {
                        let what = format!("{model}, damping ratio {damping}, {share} of the limit, {precision}");
                        tally.steps += steps;
                        tally.trials += 1;
                        match (result, share < 1.0) {
                            (Ok(farthest), true) => tally.error(&what, farthest),
                            (Err(error), true) => tally.fault(format!("{what}: {error}")),
                            (Ok(farthest), false) => {
                                tally.fault(format!("{what}: not caught in 20 000 steps, {farthest:.1e} pitches off"));
                            }
                            (Err(error), false) => {
                                let alternates = matches!(error, StepError::Alternates { .. });
                                *(if alternates { &mut alternated } else { &mut diverged }) += 1;
                                latest = latest.max(steps);
                                tally.refusal(&what, &error);
                                tally.expect(error.to_string().contains("times the stable one"), || {
                                    format!("{what}: {error}")
                                });
                                // Nothing but dampers keeps an unstable step from flying apart.
                                tally.expect(damping > 0.0 || !alternates, || format!("{what}: {error}"));
                            }
                        }
                    }
                }
            }
        }
        let lowest = shares.iter().copied().fold(f64::MAX, f64::min);
        tally.expect(largest(shares.iter().copied()) <= 1.0 + 1e-5, || {
            format!("the program's limit is too large: {shares:?}")
        });
        let half = tally.trials / 2;
        let happened = format!(
            "{} bodies (paper; tissue with Poisson's ratios 0, 0.25, 0.45; damping ratios 0 to 1; f32 and f64): below, places stay \
             within {:.1e} pitches in all; above, all {half} are caught within {latest} steps, {diverged} that fly apart and \
             {alternated} that alternate within bounds; the limit the program finds is {lowest:.3} of the true one or more",
            half, tally.error
        );
        tally.finding(0.1, happened)
    })
}

fn random_scenes() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let (mut divided, mut planned) = (0, 0);
        for seed in 0..200 {
            match random_scene(seed, &mut tally) {
                Ok((steps, asked)) => {
                    divided += u64::from(steps > asked);
                    planned += asked;
                    tally.steps += steps;
                }
                // Before it could diverge, with what would help.
                Err(error @ StepError::TooStiff { .. }) => tally.refusal(format!("scene {seed}"), &error),
                Err(error) => tally.fault(format!("scene {seed}: {error}")),
            }
        }
        let refused = tally.refused;
        tally.expect(divided > 20 && planned > 40_000, || format!("{divided} divided, {planned} steps: too tame"));
        tally.expect(refused <= 4, || format!("{refused} of 200 were refused"));
        let happened = format!(
            "none diverged; {refused} were refused before they could, for tools that squeeze nearly incompressible cells flat; \
             {divided} of 200 divided steps ({} steps for {planned}); left alone afterwards, energy rises by at \
             most {:.1} % (in {})",
            tally.steps,
            100.0 * tally.error,
            tally.worst
        );
        tally.finding(0.3, happened)
    })
}

/// One scene: 12 frames in which everything acts, 12 in which nothing does. Steps taken and planned.
fn random_scene(seed: u64, tally: &mut Tally) -> Result<(u64, u64), StepError> {
    let mut random = Random::new(7000 + seed);
    let dims = [0; 3].map(|_| 2 + (random.next() % 3) as usize);
    let fill = 0.6 + 0.4 * random.unit();
    let contrast = 10_f64.powf(4.0 * random.unit() - 2.0);
    let damping = if seed.is_multiple_of(4) { 0.0 } else { random.unit() };
    let model = match seed % 4 {
        0 | 2 => Model::Paper,
        1 => Model::Tissue(0.25),
        _ => Model::Tissue(0.25 + 0.24 * random.unit()),
    };
    let map = blob(3.0, dims, fill, &mut random);
    let organs = [1.0, contrast].map(|stiffness| Organ { stiffness, mass: 1.0, damping });
    let mut trial = Trial::new(lattice(model, &map, &organs));
    if trial.limits.sharp.is_infinite() {
        return Ok((0, 0));
    }
    let world = &mut trial.world;
    let (h, dt) = (world.lattice().pitch, world.dt());
    let half: Vec<u32> = particles(world).into_iter().filter(|_| random.unit() < 0.5).collect();
    let (held, driven) = half.split_at(half.len() / 2);
    if seed.is_multiple_of(3) {
        world.hold(held);
    }
    // A tool: up to half a pitch in a step of the softest waves, to and fro over three pitches.
    let grab = (seed % 5 < 2 && !driven.is_empty()).then(|| world.grab(driven));
    let push = (seed % 5 == 2).then(|| world.push(driven));
    let (way, turns) = (random.vector() * 3.0 * h * random.unit(), 30.0 + 200.0 * random.unit());
    let mass: f64 = world.mass().iter().map(|&m| f64::from(m)).sum();
    // What a wave would carry over in the time of a few steps.
    let force = random.vector() * mass * 0.02 * random.unit() * h / (dt * dt);
    let middle = centre(world) + random.vector() * 0.3 * h;
    let edge = vec![Point3::from(middle - Vector3::y() * 0.1), Point3::from(middle + Vector3::y() * 0.1)];
    let mut blade = (seed % 4 == 1).then(|| Blade::new(edge, &[Vector3::z() * -0.05, Vector3::z() * 0.05]));
    let acts = |world: &mut World| {
        let steps = world.time() / dt;
        if let Some(grab) = grab {
            world.move_grab(grab, way * ((steps + world.dt() / dt) / turns).sin() * 1e3);
        }
        if let Some(push) = push {
            world.set_force(push, force * if steps < 60.0 { 1.0 } else { 0.0 });
        }
        if steps > 30.0
            && let Some(blade) = blade.take()
        {
            world.cut(&blade.sweep(0.0, blade.path_length()));
        }
    };
    trial.run(12, acts)?;
    if let Some(grab) = grab {
        trial.world.release(grab);
    }
    let before = energy(&trial.world);
    trial.run(12, |_| {})?;
    let floor = 1e-12 * mass * (h / dt).powi(2);
    tally.error(
        format!("scene {seed}: {model}, damping ratio {damping:.1}"),
        (energy(&trial.world) - before) / (before + floor),
    );
    Ok((trial.steps, 240))
}

/// The segment from `a` to `b` meets the parallelogram, grown by a margin on all sides [same unit].
fn meets(a: Vector3, b: Vector3, [corner, side, stroke]: [Vector3; 3], margin: f64) -> bool {
    let normal = side.cross(&stroke).normalize();
    let (from, to) = ((a - corner).dot(&normal), (b - corner).dot(&normal));
    let nearest = if (from > 0.0) != (to > 0.0) { 0.0 } else { from.abs().min(to.abs()) };
    let share = if from == to { 0.5 } else { (from / (from - to)).clamp(0.0, 1.0) };
    let foot = a + (b - a) * share - corner;
    // Coordinates along side and stroke, which need not be at right angles.
    let (s, t) = (foot.cross(&stroke).dot(&normal), side.cross(&foot).dot(&normal));
    let area = side.cross(&stroke).dot(&normal);
    let within = |value: f64, reach: f64| (-reach..=area + reach).contains(&value);
    // A spring nearly in the plane meets it over a stretch: then a margin counts only when it grows.
    let through = if margin >= 0.0 { nearest <= margin } else { from.abs().min(to.abs()) >= -margin && nearest == 0.0 };
    through && within(s, margin * stroke.norm()) && within(t, margin * side.norm())
}

fn every_cut() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let (mut severed, mut parted) = (0, 0);
        for model in MODELS {
            for seed in 0..16 {
                let mut random = Random::new(100 + seed);
                let damping = if seed.is_multiple_of(2) { 0.3 } else { 0.0 };
                let map = blob(3.0, [8, 5, 5], if seed < 8 { 1.0 } else { 0.7 }, &mut random);
                let organs = [1.0, 10.0].map(|stiffness| Organ { stiffness, mass: 1.0, damping });
                let mut trial = Trial::new(lattice(model, &map, &organs));
                let h = trial.world.lattice().pitch;
                shake(&mut trial.world, if seed % 4 < 2 { 0.0 } else { 0.2 }, 0.1, &mut random);
                // Two of three blades go right through.
                let reach = if seed % 3 < 2 { 60.0 * h } else { 4.0 * h };
                let (side, stroke) = (random.vector(), random.vector());
                let (side, stroke) = (side.normalize() * reach, stroke.normalize() * reach);
                let middle = centre(&trial.world) + random.vector() * h;
                let corner = middle - 0.5 * (side + stroke);
                let ends = [corner, corner + side].map(Point3::from);
                let blade = Blade::new(ends.to_vec(), &[Vector3::zeros(), stroke]);
                let what = format!("{model}, blade {seed}");
                severed += one_cut(&what, &mut trial.world, &blade, [corner, side, stroke], &mut tally);
                parted += u64::from(separate(&what, &trial, &mut random, &mut tally));
                tally.steps += 40;
                tally.trials += 1;
            }
        }
        tally.expect(severed > 2000 && parted > 10, || format!("{severed} springs, {parted} parted: too tame"));
        let happened = format!(
            "{} blades severed {severed} springs, those and only those that they go through; {} springs differ from brute \
             force, places, velocities and limits were kept, and in the {parted} bodies that fell apart no piece felt another",
            tally.trials, tally.error
        );
        tally.finding(0.0, happened)
    })
}

/// Cuts, and checks everything that can be seen at once; returns how many springs were severed.
fn one_cut(what: &str, world: &mut World, blade: &Blade, quad: [Vector3; 3], tally: &mut Tally) -> usize {
    // Nearer to a border than this, either answer is right [m].
    let margin = 1e-5 * world.lattice().pitch;
    let place = |p: u32| rest_place(world, p) + world.displacement(p);
    let (mut must, mut may) = (BTreeSet::new(), BTreeSet::new());
    for (a, direction, b) in springs(world.lattice(), world.topology()) {
        if meets(place(a), place(b), quad, -margin) {
            must.insert((a, direction));
        }
        if meets(place(a), place(b), quad, margin) {
            may.insert((a, direction));
        }
    }
    let limits = |world: &World| Limits::at_rest(world.lattice(), world.topology(), world.assembly());
    let (before, bounds, old) = (balance(world), limits(world), state(world));
    let count = world.cut(&blade.sweep(0.0, blade.path_length()));
    let found: BTreeSet<(u32, usize)> =
        world.topology().severed().iter().map(|spring| (spring.particle, usize::from(spring.direction))).collect();
    let wrong = must.difference(&found).count() + found.difference(&may).count();
    tally.error(what, wrong as f64);
    let (after, now) = (balance(world), limits(world));
    tally.expect(count == found.len(), || format!("{what}: {count} springs reported, {} severed", found.len()));
    tally.expect(state(world) == old, || format!("{what}: places or velocities changed"));
    tally.expect(after.momentum == before.momentum && after.angular_momentum == before.angular_momentum, || {
        format!("{what}: momentum changed")
    });
    tally.expect(now.promise >= bounds.promise && now.rest >= bounds.rest, || {
        format!("{what}: the stable step fell from {bounds:?} to {now:?}")
    });
    count
}

/// Two worlds that differ in one piece only are the same in all others, bit for bit; false when nothing fell apart.
fn separate(what: &str, trial: &Trial, random: &mut Random, tally: &mut Tally) -> bool {
    let piece = pieces(&trial.world);
    let Some(&first) = piece.iter().find(|&&low| low != piece[0]) else { return false };
    let mut here = trial.world.clone();
    let mut there = trial.world.clone();
    let (h, dt) = (here.lattice().pitch, here.dt());
    for p in particles(&here) {
        // The guard of a scene would divide steps of a shaken body; here a shorter one will do.
        if piece[p as usize] == first {
            there.set_displacement(p, random.vector() * 0.2 * h);
            there.set_velocity(p, random.vector() * 0.1);
        }
    }
    for world in [&mut here, &mut there] {
        world.set_dt(0.5 * dt);
        if let Some(error) = (0..20).find_map(|_| world.step().err()) {
            tally.fault(format!("{what}: {error}"));
        }
    }
    let same = particles(&here)
        .into_iter()
        .filter(|&p| piece[p as usize] != first)
        .all(|p| here.displacement(p) == there.displacement(p) && here.velocity(p) == there.velocity(p));
    tally.expect(same, || format!("{what}: a piece felt another one across the cut"));
    true
}
