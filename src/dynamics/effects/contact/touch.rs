//! One step of contact: which blocks are near enough, what happens to their particles, what obstacles feel.

use rayon::prelude::*;

use super::Contact;
use super::placed::Placed;
use super::response::{Particle, respond};
use crate::dynamics::world::World;
use crate::geometry::Vector3;
use crate::lattice::layout::{BLOCK, BLOCK_LEN, BlockLayout};

/// Clearances are f32: moves count for this much more, so that rounding never makes them too large.
const ROUNDED: f64 = 1.0001;

/// The velocities of a block that some obstacle may touch.
struct Job<'a> {
    block: usize,
    velocity: [&'a mut [f32]; 3],
}

/// What came of it.
struct Touched {
    block: usize,
    /// On its particles, by each obstacle [kg m/s].
    impulses: Vec<Vector3>,
    /// How far its particles are from each obstacle that was looked at [m].
    clearance: Vec<(usize, f64)>,
    /// Farther than its speed said it was moved [m].
    pushed: f64,
    /// Largest squared speed of the particles that were touched [m^2/s^2].
    fastest_squared: f32,
}

/// What every block is looked at with.
struct Scene<'a> {
    obstacles: &'a [Placed],
    soft: &'a [u16],
    displacement: [&'a [f32]; 3],
    dt_over_mass: &'a [f32],
    layout: &'a BlockLayout,
    pitch: f64,
    dt: f64,
}

impl World {
    /// After the kick and all that drives: gives particles velocities that keep them out of obstacles.
    ///
    /// `fastest` is the largest squared speed of each block, raised by what is pushed.
    pub(in crate::dynamics) fn touch_obstacles(&mut self, fastest: &mut [f32]) {
        let Some(mut contact) = self.contact.take() else { return };
        contact.touch(self, fastest);
        self.contact = Some(contact);
    }
}

impl Contact {
    fn touch(&mut self, world: &mut World, fastest: &mut [f32]) {
        let (dt, pitch) = (world.dt(), world.lattice.pitch);
        let Self { obstacles, soft, looks } = self;
        if obstacles.iter().all(|obstacle| !obstacle.present) {
            return;
        }
        let near = near_blocks(obstacles, fastest, dt);
        let velocity = world.velocity.each_mut().map(|part| part.chunks_exact_mut(BLOCK_LEN));
        let [x, y, z] = velocity;
        let of_block = x.zip(y).zip(z).enumerate();
        let jobs: Vec<Job<'_>> = of_block
            .filter(|(block, _)| near[*block])
            .map(|(block, ((x, y), z))| Job { block, velocity: [x, y, z] })
            .collect();
        *looks += jobs.len() as u64;
        let scene = Scene {
            obstacles,
            soft,
            displacement: world.displacement.each_ref().map(Vec::as_slice),
            dt_over_mass: &world.dt_over_mass,
            layout: &world.layout,
            pitch,
            dt,
        };
        let touched: Vec<Touched> = jobs.into_par_iter().map(|job| scene.look(job)).collect();
        let mut impulses = vec![Vector3::zeros(); obstacles.len()];
        // In the order of blocks: the same sums at any number of threads.
        for Touched { block, impulses: own, clearance, pushed, fastest_squared } in touched {
            impulses.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            fastest[block] = fastest[block].max(fastest_squared);
            for obstacle in obstacles.iter_mut().filter(|obstacle| obstacle.present) {
                let least = f64::from(obstacle.clearance[block]) - obstacle.steepness() * pushed * ROUNDED;
                obstacle.clearance[block] = least as f32;
            }
            for (number, least) in clearance {
                obstacles[number].clearance[block] = least as f32;
            }
        }
        for (obstacle, impulse) in obstacles.iter_mut().zip(impulses) {
            if obstacle.present {
                obstacle.force = -impulse / dt;
                obstacle.impulse -= impulse;
                obstacle.offset = obstacle.target;
            }
        }
    }
}

/// Takes from every clearance what block and obstacle may move in this step; which blocks have to be looked at.
fn near_blocks(obstacles: &mut [Placed], fastest: &[f32], dt: f64) -> Vec<bool> {
    let way: Vec<f64> = fastest.iter().map(|&squared| f64::from(squared).sqrt() * dt).collect();
    let mut near = vec![false; fastest.len()];
    for obstacle in obstacles.iter_mut().filter(|obstacle| obstacle.present) {
        let (steepness, moved) = (obstacle.steepness() * ROUNDED, (obstacle.target - obstacle.offset).norm());
        for ((clearance, way), near) in obstacle.clearance.iter_mut().zip(&way).zip(&mut near) {
            *clearance = (f64::from(*clearance) - steepness * (way + moved)) as f32;
            *near |= !is_clear(*clearance);
        }
    }
    near
}

/// A block with this clearance cannot touch; one that is not a number may.
fn is_clear(clearance: f32) -> bool {
    clearance > 0.0
}

impl Scene<'_> {
    fn look(&self, Job { block, velocity }: Job<'_>) -> Touched {
        let Self { obstacles, dt, pitch, .. } = *self;
        let looked_at = |placed: &Placed| placed.present && !is_clear(placed.clearance[block]);
        let mut clearance: Vec<(usize, f64)> = (0..obstacles.len())
            .filter(|&number| looked_at(&obstacles[number]))
            .map(|number| (number, f64::INFINITY))
            .collect();
        let mut impulses = vec![Vector3::zeros(); obstacles.len()];
        let mut changes = vec![Vector3::zeros(); obstacles.len()];
        let (mut pushed, mut fastest_squared) = (0.0_f64, 0.0_f32);
        let corner = self.layout.corner(block);
        for row in 0..BLOCK_LEN / BLOCK[0] {
            let mut left = self.soft[block * (BLOCK_LEN / BLOCK[0]) + row];
            while left != 0 {
                let i = left.trailing_zeros() as usize;
                left &= left - 1;
                let inside = row * BLOCK[0] + i;
                let slot = block * BLOCK_LEN + inside;
                let within = [i, row % BLOCK[1], row / BLOCK[1]];
                let of = |axis: usize| {
                    (corner[axis] + within[axis] as i64) as f64 * pitch + f64::from(self.displacement[axis][slot])
                };
                let place = Vector3::new(of(0), of(1), of(2));
                let own = Vector3::from([0, 1, 2].map(|axis| f64::from(velocity[axis][inside])));
                let mut target = place + own * dt;
                let value = |number: usize, target: Vector3| obstacles[number].value(target, obstacles[number].target);
                let weight = f64::from(self.dt_over_mass[slot]);
                let inside_one = weight > 0.0 && clearance.iter().any(|&(number, _)| value(number, target) < 0.0);
                if inside_one {
                    changes.fill(Vector3::zeros());
                    let found = respond(Particle { place, velocity: own }, obstacles, (dt, pitch), &mut changes);
                    let mut squared = 0.0;
                    for axis in 0..3 {
                        let part = found[axis] as f32;
                        velocity[axis][inside] = part;
                        squared += part * part;
                    }
                    fastest_squared = fastest_squared.max(if squared < f32::MAX { squared } else { f32::INFINITY });
                    pushed = pushed.max((found - own).norm() * dt);
                    target = place + found * dt;
                    impulses.iter_mut().zip(&changes).for_each(|(sum, change)| *sum += change * (dt / weight));
                }
                for (number, least) in &mut clearance {
                    *least = least.min(value(*number, target));
                }
            }
        }
        Touched { block, impulses, clearance, pushed, fastest_squared }
    }
}
