//! Blocks at rest are left out of the step until something reaches them.
//!
//! A block falls asleep, its velocities set to 0 and its places kept,
//!
//! - at once, when every velocity in it is exactly 0: nothing acts there, and leaving it out changes no bit;
//! - at the end of a window of time, when neither it nor a neighbour went further in the window than a tolerance, and it would not
//!   still get that far. It went `sum of max |v| dt`, which no particle's path exceeds and no swing's reach. It gets to where its
//!   particles would be if their largest distance from where they were a window ago went on to change by the same share in each
//!   window, `d q / (1 - q)` with `q` the share of the last two; what does not shrink is taken for ten thousand windows.
//!   It carries no part of a free rigid body, and nothing drives it: no grab, force or pressure.
//!
//! It wakes when a neighbour went the tolerance since it last woke its neighbours, when something gives one of its particles a
//! velocity (a grab, a force, an obstacle, other tissue), when a spring near it is severed, when a hold or grab of one of its
//! particles begins or ends, and when gravity changes.
//!
//! What is lost: a sleeping block stands still while its surroundings move by less than the tolerance, and what its own motion
//! had left is less than that. Both are displacements of the size of the tolerance; there is no bound on what they make of an
//! unstable equilibrium (a column about to buckle), which waits for a push of that size, or of loose ends of cut tissue. Energy
//! is only ever taken: the kinetic energy of what falls asleep. A vibration whose period is more than four windows looks like
//! rest near its turning points, so the window should be no shorter than a quarter of the slowest period that matters; see
//! [`World::slowest_wave`].
//!
//! Same world, same calls: same blocks asleep, at any number of threads.

use rayon::prelude::*;

use crate::dynamics::World;
use crate::dynamics::drive::Drive;
use crate::dynamics::springs::block_of;
use crate::geometry::Vector3;
use crate::lattice::layout::{BLOCK_LEN, NO_BLOCK};
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS};

/// Motion that does not die down goes on for so many windows.
const MOST_WINDOWS: f64 = 1e4;

/// When blocks fall asleep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sleep {
    /// How far a particle may be off because blocks sleep, near enough [m].
    pub tolerance: f64,
    /// How long a block is watched [s].
    pub window: f64,
}

/// What sleep spared a world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SleepCounts {
    /// Blocks that sleep now.
    pub asleep: u64,
    /// All blocks.
    pub blocks: u64,
    /// Blocks left out so far, summed over steps.
    pub left_out: u64,
    /// Blocks of all steps.
    pub of: u64,
}

/// Which blocks of a world sleep, and how far the others went.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct Sleepers {
    sleep: Sleep,
    asleep: Vec<bool>,
    watch: Vec<Watch>,
    /// Displacement x, y, z of each slot when the window began, or when it fell asleep [m].
    began_at: [Vec<f32>; 3],
    /// Time since the window began [s].
    elapsed: f64,
    counts: SleepCounts,
    /// What a step finds, kept for its memory: blocks that fall asleep, and that wake their neighbours.
    falls: Vec<usize>,
    noticed: Vec<usize>,
    /// What the end of a window finds of each block, the same: how far it got [m], and whether it is driven.
    reached: Vec<f64>,
    driven: Vec<bool>,
}

/// How far the particles of a block went [m].
#[derive(Debug, Clone, Copy)]
struct Watch {
    /// The fastest one in the last step.
    step: f64,
    /// The fastest one of each step of this window.
    way: f64,
    /// The same since the block last woke its neighbours.
    unnoticed: f64,
    /// The farthest one from where it was a window before, at the end of the last window; infinite when it woke since.
    reached: f64,
    /// A part of a free rigid body, which is moved by what its particles feel.
    rigid: bool,
}

impl Watch {
    const WOKEN: Self = Self { step: 0.0, way: 0.0, unnoticed: 0.0, reached: f64::INFINITY, rigid: false };

    fn wake(&mut self) {
        *self = Self { unnoticed: self.unnoticed, rigid: self.rigid, ..Self::WOKEN };
    }

    /// How far it would still get after a window in which it got so far.
    fn still_goes(&self, reached: f64) -> f64 {
        if self.reached.is_infinite() {
            return f64::INFINITY;
        }
        let share = reached / self.reached.max(f64::MIN_POSITIVE);
        let windows = if share < 1.0 { (share / (1.0 - share)).min(MOST_WINDOWS) } else { MOST_WINDOWS };
        reached * windows
    }
}

impl Sleepers {
    /// Which blocks are left out of the step.
    pub(in crate::dynamics) fn asleep(&self) -> &[bool] {
        &self.asleep
    }

    /// Bytes held.
    pub(in crate::dynamics) fn bytes(&self) -> usize {
        let places: usize = self.began_at.iter().map(Vec::len).sum();
        self.watch.len() * (size_of::<Watch>() + 3 * size_of::<u64>() + 2 * size_of::<bool>()) + 4 * places
    }

    fn wake(&mut self, block: usize) {
        if std::mem::replace(&mut self.asleep[block], false) {
            self.watch[block].wake();
        }
    }

    fn wake_around(&mut self, neighbours: &[u32; 27]) {
        for &other in neighbours.iter().filter(|&&other| other != NO_BLOCK) {
            self.wake(other as usize);
        }
    }
}

impl World {
    /// Lets blocks at rest sleep, or all be stepped (`None`, as it begins). Takes part in the plain step only; other integrators step
    /// every block.
    ///
    /// # Panics
    /// If tolerance or window are not above 0.
    pub fn set_sleep(&mut self, sleep: Option<Sleep>) {
        self.sleepers = sleep.map(|sleep| {
            assert!(sleep.tolerance > 0.0 && sleep.window > 0.0, "a tolerance and a window above 0");
            let blocks = self.layout.blocks.len();
            let watch =
                |block| Watch { rigid: self.rigid.as_ref().is_some_and(|rigid| rigid.is_in(block)), ..Watch::WOKEN };
            Box::new(Sleepers {
                sleep,
                asleep: vec![false; blocks],
                watch: (0..blocks).map(watch).collect(),
                began_at: self.displacement.clone(),
                elapsed: 0.0,
                counts: SleepCounts { blocks: blocks as u64, ..SleepCounts::default() },
                falls: Vec::with_capacity(blocks),
                noticed: Vec::with_capacity(blocks),
                reached: Vec::with_capacity(blocks),
                driven: vec![false; blocks],
            })
        });
    }

    /// When blocks sleep, and what that spared so far; `None` where all are stepped.
    pub fn sleep(&self) -> Option<(Sleep, SleepCounts)> {
        let sleepers = self.sleepers.as_deref()?;
        let asleep = sleepers.asleep.iter().filter(|&&asleep| asleep).count() as u64;
        Some((sleepers.sleep, SleepCounts { asleep, ..sleepers.counts }))
    }

    /// The time that shear waves take through the longest extent of the lattice, on average over its particles [s]: a quarter of the
    /// slowest period of a block held at one end. 0 without springs.
    ///
    /// The speed of a shear wave in a lattice of springs `k` of rest lengths `L` and directions `e` is
    /// `c^2 = sum k L^2 e_x^2 e_y^2 / 2 m`, here the mean over the three pairs of axes.
    pub fn slowest_wave(&self) -> f64 {
        let (lattice, assembly) = (&self.lattice, &self.assembly);
        let slowness = |particle: u32| {
            let mass = f64::from(assembly.mass[particle as usize]);
            let alive = self.topology.alive()[particle as usize];
            let stiff: f64 = (0..NEIGHBOURS)
                .filter(|direction| alive >> direction & 1 == 1)
                .map(|direction| {
                    let rest = Vector3::from(OFFSETS[direction].map(f64::from));
                    let squares = rest.component_mul(&rest) / rest.norm_squared();
                    let pairs = squares.x * squares.y + squares.y * squares.z + squares.z * squares.x;
                    assembly.stiffness.of(lattice, particle, direction) * rest.norm_squared() * pairs / 3.0
                })
                .sum();
            if mass > 0.0 && stiff > 0.0 { Some((2.0 * mass / stiff).sqrt()) } else { None }
        };
        // In the order of particles: the same sum at any thread count.
        let slowness: Vec<f64> = (0..lattice.len() as u32).into_par_iter().filter_map(slowness).collect();
        if slowness.is_empty() {
            return 0.0;
        }
        let ends = lattice.points.iter().fold([[usize::MAX, 0]; 3], |ends, &point| {
            let ijk = lattice.grid.shape.ijk(point as usize);
            [0, 1, 2].map(|axis| [ends[axis][0].min(ijk[axis]), ends[axis][1].max(ijk[axis])])
        });
        let longest = ends.iter().map(|[first, last]| last - first + 1).max().unwrap_or(0);
        longest as f64 * slowness.iter().sum::<f64>() / slowness.len() as f64
    }

    /// Something happened to a slot's particle that its block has to answer.
    pub(in crate::dynamics) fn wake(&mut self, slot: u32) {
        if let Some(sleepers) = &mut self.sleepers {
            sleepers.wake(slot as usize / BLOCK_LEN);
        }
    }

    /// The same, and the blocks around it.
    pub(in crate::dynamics) fn wake_around(&mut self, slot: u32) {
        if let Some(sleepers) = &mut self.sleepers {
            sleepers.wake_around(&self.layout.neighbours[slot as usize / BLOCK_LEN]);
        }
    }

    /// The same for all blocks.
    pub(in crate::dynamics) fn wake_all(&mut self) {
        if let Some(sleepers) = &mut self.sleepers {
            (0..sleepers.asleep.len()).for_each(|block| sleepers.wake(block));
        }
    }

    /// New places of the blocks that do not sleep, and of those that something moved; then who wakes and who falls asleep.
    pub(in crate::dynamics) fn drift_awake(&mut self, mut sleepers: Box<Sleepers>) {
        for (block, fastest) in self.fastest_squared.iter().enumerate() {
            if *fastest > 0.0 {
                sleepers.wake(block);
            }
        }
        let sleeping = sleepers.asleep.iter().filter(|&&asleep| asleep).count() as u64;
        sleepers.counts.left_out += sleeping;
        sleepers.counts.of += sleepers.counts.blocks;
        let dt = self.dt;
        let [x, y, z] = self.displacement.each_mut().map(|axis| axis.par_chunks_exact_mut(BLOCK_LEN));
        let velocity = &self.velocity;
        let blocks = (x, y, z).into_par_iter().zip(&sleepers.asleep).zip(&mut sleepers.watch).enumerate();
        blocks.with_min_len(4).for_each(|(block, (((x, y, z), asleep), watch))| {
            watch.step = 0.0;
            if !asleep {
                let speed = drift_block([x, y, z], velocity.each_ref().map(|axis| block_of(axis, block)), dt as f32);
                watch.step = speed * dt;
            }
        });
        self.settle_sleep(&mut sleepers);
        self.sleepers = Some(sleepers);
    }

    fn settle_sleep(&mut self, sleepers: &mut Sleepers) {
        let Sleep { tolerance, window } = sleepers.sleep;
        sleepers.elapsed += self.dt;
        let ends = sleepers.elapsed >= window;
        let [mut falls, mut noticed] = [&mut sleepers.falls, &mut sleepers.noticed].map(std::mem::take);
        for (block, (watch, asleep)) in sleepers.watch.iter_mut().zip(&sleepers.asleep).enumerate() {
            watch.way += watch.step;
            watch.unnoticed += watch.step;
            if watch.unnoticed > tolerance {
                watch.unnoticed = 0.0;
                noticed.push(block);
            }
            if !asleep && !watch.rigid && watch.step == 0.0 {
                falls.push(block);
            }
        }
        if ends {
            sleepers.elapsed = 0.0;
            self.end_window(sleepers, &mut falls);
        }
        for block in falls.drain(..) {
            sleepers.asleep[block] = true;
            let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
            let both = self.velocity.iter_mut().chain(self.next_velocity.iter_mut().filter(|axis| !axis.is_empty()));
            both.for_each(|axis| axis[slots.clone()].fill(0.0));
        }
        for block in noticed.drain(..) {
            sleepers.wake_around(&self.layout.neighbours[block]);
        }
        (sleepers.falls, sleepers.noticed) = (falls, noticed);
    }

    /// The blocks that fall asleep at the end of a window, and where the next begins.
    fn end_window(&self, sleepers: &mut Sleepers, falls: &mut Vec<usize>) {
        let Sleepers { sleep: Sleep { tolerance, .. }, watch, asleep, began_at, reached, driven, .. } = sleepers;
        let [x, y, z] = began_at.each_mut().map(|axis| axis.par_chunks_exact_mut(BLOCK_LEN));
        let reaches = |(block, (x, y, z))| {
            if asleep[block] {
                return 0.0;
            }
            distance([x, y, z], self.displacement.each_ref().map(|axis| block_of(axis, block)))
        };
        (x, y, z).into_par_iter().enumerate().map(reaches).collect_into_vec(reached);
        driven.fill(false);
        let mut drives = |slot: u32| driven[slot as usize / BLOCK_LEN] = true;
        for drive in &self.drives {
            match drive {
                Drive::Force { slots, .. } | Drive::Grab { slots, .. } => slots.iter().copied().for_each(&mut drives),
                Drive::Pressure(faces) => {
                    faces.particles().iter().for_each(|&particle| drives(self.layout.slot[particle as usize]));
                }
                Drive::Hold { .. } | Drive::Obstacle { .. } | Drive::Released => {}
            }
        }
        falls.extend((0..watch.len()).filter(|&block| {
            let around = self.layout.neighbours[block].iter().filter(|&&other| other != NO_BLOCK);
            !asleep[block]
                && !watch[block].rigid
                && !driven[block]
                && watch[block].still_goes(reached[block]) <= *tolerance
                && around.map(|&other| other as usize).all(|other| asleep[other] || watch[other].way <= *tolerance)
        }));
        for (watch, reached) in watch.iter_mut().zip(reached) {
            watch.reached = *reached;
            watch.way = 0.0;
        }
    }
}

/// Moves the places of a block by its velocities; its largest speed [m/s], above 0 where any velocity is not 0.
fn drift_block(displacement: [&mut [f32]; 3], velocity: [&[f32; BLOCK_LEN]; 3], dt: f32) -> f64 {
    let mut squared = [0.0_f32; BLOCK_LEN];
    let mut any = 0;
    for (displacement, velocity) in displacement.into_iter().zip(velocity) {
        for ((u, v), squared) in displacement.iter_mut().zip(velocity).zip(&mut squared) {
            *u += dt * v;
            *squared += v * v;
            any |= v.abs().to_bits();
        }
    }
    let fastest = f64::from(squared.into_iter().fold(0.0, f32::max)).sqrt();
    // Squares of what is very slow are 0.
    if any == 0 { 0.0 } else { fastest.max(f64::from(f32::MIN_POSITIVE)) }
}

/// The largest distance of places from those a window before, which become these [m].
fn distance(before: [&mut [f32]; 3], now: [&[f32; BLOCK_LEN]; 3]) -> f64 {
    let mut squared = [0.0_f32; BLOCK_LEN];
    for (before, now) in before.into_iter().zip(now) {
        for ((before, now), squared) in before.iter_mut().zip(now).zip(&mut squared) {
            *squared += (now - *before).powi(2);
            *before = *now;
        }
    }
    f64::from(squared.into_iter().fold(0.0, f32::max)).sqrt()
}
