//! What moves or holds particles from outside: holds, grabs, forces and pressures.

use std::collections::hash_map::Entry;
use std::ops::{Add, Mul, Sub};

use super::effects::pressure::{PressedFaces, Pushed};
use super::world::World;
use crate::geometry::Vector3;
use crate::lattice::layout::BLOCK_LEN;

/// A hold, grab, force, pressure or obstacle of a [`World`], to change or release it later.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Handle(pub(super) usize);

/// One active hold, grab, force, pressure or obstacle. Slots are in block order, vectors in lattice axes and SI units.
#[derive(Debug, Clone)]
pub(super) enum Drive {
    /// Particles that stay where they are.
    Hold { slots: Vec<u32> },
    /// Particles that follow an offset from where they were grabbed.
    Grab { slots: Vec<u32>, start: Vec<[f32; 3]>, offset: Vector3 },
    /// Particles that share a force in proportion to their mass.
    Force { slots: Vec<u32>, force: Ramp<Vector3>, mass: f64 },
    /// Faces that are pressed.
    Pressure(Box<PressedFaces>),
    /// Something that particles may not enter.
    Obstacle { number: usize },
    /// Released; the number is not used again.
    Released,
}

/// A load over a step: it goes evenly from what it is at the start to what it is at the end.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Ramp<T> {
    pub(super) start: T,
    pub(super) end: T,
}

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>> Ramp<T> {
    /// What it is at a share of the step, 0 to 1.
    pub(super) fn at(&self, share: f64) -> T {
        self.start + (self.end - self.start) * share
    }
}

/// How many holds and grabs act on each slot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Claims {
    pub(super) holds: u16,
    pub(super) grabs: u16,
}

impl World {
    /// Holds particles where they are until released. One of a rigid body holds the whole body, which stops at once and goes
    /// on from rest. A particle that is both held and grabbed stays; when the hold ends, the grab takes it to its place in
    /// one step.
    ///
    /// # Panics
    /// If a particle is held more than 65 535 times at once.
    pub fn hold(&mut self, particles: &[u32]) -> Handle {
        let slots = self.slots_of(particles);
        for &slot in &slots {
            let holds = &mut self.claims.entry(slot).or_default().holds;
            *holds = holds.checked_add(1).expect("fewer than 65 536 holds");
            self.refresh(slot);
        }
        self.hold_bodies();
        self.add(Drive::Hold { slots })
    }

    /// Grabs particles: they keep their shape and follow [`World::move_grab`] until released. One of a rigid body takes the
    /// whole body along, which does not turn meanwhile. Of two grabs of a particle or body the later one moves it.
    ///
    /// # Panics
    /// If a particle is grabbed more than 65 535 times at once.
    pub fn grab(&mut self, particles: &[u32]) -> Handle {
        let slots = self.slots_of(particles);
        for &slot in &slots {
            let grabs = &mut self.claims.entry(slot).or_default().grabs;
            *grabs = grabs.checked_add(1).expect("fewer than 65 536 grabs");
            self.refresh(slot);
        }
        let start = slots.iter().map(|&slot| [0, 1, 2].map(|axis| self.displacement[axis][slot as usize])).collect();
        self.add(Drive::Grab { slots, start, offset: Vector3::zeros() })
    }

    /// Where the grabbed particles are to be after the next step, relative to where they were grabbed, RAS+ [mm].
    ///
    /// # Panics
    /// If the handle is not a grab's.
    pub fn move_grab(&mut self, handle: Handle, offset_mm: Vector3) {
        let local = self.to_lattice_axes(offset_mm * 1e-3);
        match &mut self.drives[handle.0] {
            Drive::Grab { offset, .. } => *offset = local,
            other => panic!("{handle:?} is {other:?}, not a grab"),
        }
    }

    /// Lets a force act on particles, shared in proportion to their mass; 0 until [`World::set_force`]. A rigid body feels
    /// its share at its particles among them, torque included.
    pub fn push(&mut self, particles: &[u32]) -> Handle {
        let mass = particles.iter().map(|&particle| f64::from(self.mass()[particle as usize])).sum();
        let slots = self.slots_of(particles);
        self.add(Drive::Force { slots, force: Ramp::default(), mass })
    }

    /// Sets the sum of a force over its particles, RAS+ [N].
    ///
    /// # Panics
    /// If the handle is not a force's.
    pub fn set_force(&mut self, handle: Handle, force: Vector3) {
        self.set_force_over_step(handle, [force; 2]);
    }

    /// The same for a force that goes evenly from one to the other in the course of a step, which is to be told before every
    /// step while it does. The plain step feels the first throughout, implicit methods the last.
    ///
    /// # Panics
    /// If the handle is not a force's.
    pub fn set_force_over_step(&mut self, handle: Handle, force: [Vector3; 2]) {
        let [start, end] = force.map(|force| self.to_lattice_axes(force));
        match &mut self.drives[handle.0] {
            Drive::Force { force, .. } => *force = Ramp { start, end },
            other => panic!("{handle:?} is {other:?}, not a force"),
        }
    }

    /// Ends a hold, grab, force or pressure, or takes an obstacle away. The particles go on from their present place and velocity; anchored
    /// rigid organs stop.
    pub fn release(&mut self, handle: Handle) {
        match std::mem::replace(&mut self.drives[handle.0], Drive::Released) {
            Drive::Hold { slots } => {
                for slot in slots {
                    self.drop_claim(slot, |claims| claims.holds -= 1);
                }
                self.hold_bodies();
            }
            Drive::Grab { slots, .. } => {
                for slot in slots {
                    self.drop_claim(slot, |claims| claims.grabs -= 1);
                }
            }
            Drive::Obstacle { number } => self.remove_obstacle(number),
            Drive::Force { .. } | Drive::Pressure(_) | Drive::Released => {}
        }
    }

    /// True while a hold keeps a particle where it is.
    pub(crate) fn is_held(&self, particle: u32) -> bool {
        self.claims_on(self.layout.slot[particle as usize]).holds > 0
    }

    /// How many holds and grabs act on a slot.
    pub(super) fn claims_on(&self, slot: u32) -> Claims {
        self.claims.get(&slot).copied().unwrap_or_default()
    }

    /// Where a slot will be after the next step that only holds and grabs move: displacement in lattice axes [m].
    pub(super) fn led_to(&self, slot: u32) -> Vector3 {
        let by_grab = |drive: &Drive| match drive {
            Drive::Grab { slots, start, offset } => {
                let at = slots.iter().position(|&grabbed| grabbed == slot)?;
                Some(Vector3::from(start[at].map(f64::from)) + offset)
            }
            _ => None,
        };
        let claims = self.claims_on(slot);
        let led = if claims.holds == 0 && claims.grabs > 0 { self.drives.iter().rev().find_map(by_grab) } else { None };
        led.unwrap_or_else(|| [0, 1, 2].map(|axis| f64::from(self.displacement[axis][slot as usize])).into())
    }

    fn drop_claim(&mut self, slot: u32, drop: impl Fn(&mut Claims)) {
        if let Entry::Occupied(mut claims) = self.claims.entry(slot) {
            drop(claims.get_mut());
            if *claims.get() == Claims::default() {
                claims.remove();
            }
        }
        self.refresh(slot);
    }

    pub(super) fn add(&mut self, drive: Drive) -> Handle {
        self.drives.push(drive);
        Handle(self.drives.len() - 1)
    }

    fn slots_of(&self, particles: &[u32]) -> Vec<u32> {
        particles.iter().map(|&particle| self.layout.slot[particle as usize]).collect()
    }

    /// Sets velocities so that the drift of this step brings grabs to their places, and adds the forces.
    ///
    /// `fastest` is the largest squared speed of each block, raised by what is driven.
    pub(super) fn apply_drives(&mut self, fastest: &mut [f32]) {
        let dt = self.dt();
        let Self { drives, claims, velocity, displacement, dt_over_mass, .. } = self;
        let Self { rigid, layout, lattice, topology, assembly, .. } = self;
        for drive in drives {
            match drive {
                Drive::Hold { .. } | Drive::Obstacle { .. } | Drive::Released => {}
                Drive::Grab { slots, start, offset } => {
                    for (&slot, start) in slots.iter().zip(start) {
                        if claims.get(&slot).is_some_and(|claims| claims.holds > 0) {
                            continue;
                        }
                        let slot = slot as usize;
                        let wanted = [0, 1, 2].map(|axis| {
                            let target = f64::from(start[axis]) + offset[axis];
                            (target - f64::from(displacement[axis][slot])) / dt
                        });
                        if let Some(rigid) = rigid
                            && let Some(body) = rigid.of_slot(slot as u32)
                        {
                            // The same for all its particles, to rounding.
                            rigid.drive(body, wanted.into());
                            continue;
                        }
                        for axis in 0..3 {
                            velocity[axis][slot] = wanted[axis] as f32;
                        }
                        raise(&mut fastest[slot / BLOCK_LEN], slot, velocity);
                    }
                }
                Drive::Pressure(faces) => {
                    let rigid = rigid.as_deref_mut();
                    let world = Pushed { lattice, topology, layout, displacement, velocity, dt_over_mass, rigid };
                    faces.push(dt, world, |slot, velocity| raise(&mut fastest[slot / BLOCK_LEN], slot, velocity));
                }
                Drive::Force { slots, force, mass } => {
                    // Shared by mass, so every particle is accelerated alike.
                    let kick = force.start * (dt / mass.max(f64::MIN_POSITIVE));
                    for &slot in slots.iter() {
                        if let Some(rigid) = rigid
                            && let Some(body) = rigid.of_slot(slot)
                        {
                            let particle = layout.particle_of_slot(lattice, slot as usize).expect("driven particles");
                            let mass = f64::from(assembly.mass[particle as usize]);
                            rigid.push(body, kick * mass, lattice, particle);
                            continue;
                        }
                        let slot = slot as usize;
                        if dt_over_mass[slot] > 0.0 {
                            for axis in 0..3 {
                                velocity[axis][slot] += kick[axis] as f32;
                            }
                            raise(&mut fastest[slot / BLOCK_LEN], slot, velocity);
                        }
                    }
                }
            }
        }
    }
}

/// Raises the largest squared speed of a block to that of one of its slots; a speed that is not finite counts as infinite.
pub(super) fn raise(fastest: &mut f32, slot: usize, velocity: &[Vec<f32>; 3]) {
    let squared: f32 = velocity.iter().map(|v| v[slot] * v[slot]).sum();
    *fastest = fastest.max(if squared < f32::MAX { squared } else { f32::INFINITY });
}
