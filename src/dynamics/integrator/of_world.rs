//! A world under an integrator other than its plain step: what is prescribed and what acts brought to it, and its outcome checked.

use rayon::prelude::*;

use super::backward_euler::BackwardEuler;
use super::bogacki_shampine::{BogackiShampine, TooManyParts};
use super::field::{Field, Real};
use super::newton::{Effort, Unsettled};
use super::precise_lattice::PreciseLattice;
use super::quasi_static::QuasiStatic;
use super::reach::radian;
use super::rk4::Rk4;
use super::verlet::Verlet;
use super::{Integrator, Mechanics, Method, Precision};
use crate::dynamics::drive::Drive;
use crate::dynamics::step_error::StepError;
use crate::dynamics::world::World;
use crate::geometry::Vector3;
use crate::lattice::layout::BLOCK_LEN;

/// Step of the volume viscosity, as a share of the world's: so small that it reads the rate itself, and far above what f32 cannot hold.
const INSTANT: f64 = 1e-6;

/// The integrator of a world and what it keeps from step to step.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct Integration {
    integrator: Integrator,
    /// Time that the fastest mode takes for a radian [s].
    radian: f64,
    single: Explicit<f32>,
    /// `None` while everything is f32.
    precise: Option<Box<Precise>>,
}

/// Buffers of the explicit methods; only those of the method in use are filled.
#[derive(Debug, Clone, Default)]
struct Explicit<R> {
    verlet: Verlet<R>,
    rk4: Rk4<R>,
    pair: BogackiShampine<R>,
}

impl<R: Real> Explicit<R> {
    fn advance<M: Mechanics<Real = R>>(
        &mut self,
        method: Method,
        mechanics: &mut M,
        [displacement, velocity]: [&mut Field<R>; 2],
        dt: f64,
        lengths: [f64; 2],
    ) -> Result<(), TooManyParts> {
        match method {
            Method::Verlet => self.verlet.advance(mechanics, displacement, velocity, dt),
            Method::Rk4 => self.rk4.advance(mechanics, displacement, velocity, dt),
            Method::BogackiShampine => {
                return self.pair.advance(mechanics, displacement, velocity, dt, lengths);
            }
            Method::SymplecticEuler => {
                super::symplectic_euler(mechanics, displacement, velocity, dt);
            }
            Method::BackwardEuler | Method::QuasiStatic => unreachable!("implicit methods have their own way"),
        }
        Ok(())
    }
}

/// The f64 state and what advances it.
#[derive(Debug, Clone)]
struct Precise {
    lattice: PreciseLattice,
    displacement: Field<f64>,
    velocity: Field<f64>,
    explicit: Explicit<f64>,
    backward: BackwardEuler,
    settled: QuasiStatic,
    severed: usize,
}

impl World {
    /// Goes on with another integrator from the next step on, see [`crate::dynamics::integrator`].
    ///
    /// # Panics
    /// If the world has rigid bodies that move, obstacles, or springs that relax, yield or tear, and the integrator is not the plain step in f32, or the tolerance
    /// is not positive. (Scenes are refused before.)
    pub fn set_integrator(&mut self, integrator: Integrator) {
        assert!(integrator.tolerance > 0.0 && integrator.tolerance.is_finite(), "a tolerance is a length");
        let plain = integrator.method == Method::SymplecticEuler && integrator.precision == Precision::Single;
        assert!(
            plain
                || (self.rigid.is_none()
                    && self.contact.is_none()
                    && self.self_contact.is_none()
                    && self.assembly.inelastic.is_none()),
            "only the plain step has rigid bodies, contact, relaxation, plasticity and tearing"
        );
        self.integration = (!plain).then(|| Box::new(Integration::new(self, integrator)));
        // Cells read velocities over the plain step again.
        let pitch = self.lattice.pitch;
        if let Some(cells) = &mut self.cells {
            cells.set_dt(pitch, self.dt);
        }
        if let Some(fibres) = &mut self.fibres {
            fibres.set_dt(pitch, self.dt);
        }
    }

    /// How the world goes on in time.
    pub fn integrator(&self) -> Integrator {
        self.integration.as_ref().map_or(Integrator::new(Method::SymplecticEuler), |own| own.integrator)
    }

    /// Displacement of every particle from rest in f64, lattice axes [m]; `None` while the state is f32 only. Shape `[particles]`.
    pub fn precise_displacements(&self) -> Option<Vec<Vector3>> {
        let precise = self.integration.as_ref()?.precise.as_ref()?;
        Some(self.per_particle(&precise.displacement))
    }

    /// Velocity of every particle in f64, lattice axes [m/s]; `None` while the state is f32 only. Shape `[particles]`.
    pub fn precise_velocities(&self) -> Option<Vec<Vector3>> {
        let precise = self.integration.as_ref()?.precise.as_ref()?;
        Some(self.per_particle(&precise.velocity))
    }

    /// What a method took so far that finds out itself how much it needs; zero for all others.
    pub fn effort(&self) -> Effort {
        let Some(own) = &self.integration else { return Effort::default() };
        match (own.integrator.method, &own.precise) {
            (Method::BogackiShampine, None) => own.single.pair.effort(),
            (Method::BogackiShampine, Some(precise)) => precise.explicit.pair.effort(),
            (Method::BackwardEuler, Some(precise)) => precise.backward.effort(),
            (Method::QuasiStatic, Some(precise)) => precise.settled.effort(),
            _ => Effort::default(),
        }
    }

    fn per_particle(&self, field: &Field<f64>) -> Vec<Vector3> {
        let of = |&slot: &u32| Vector3::from([0, 1, 2].map(|axis| field[axis][slot as usize]));
        self.layout.slot.iter().map(of).collect()
    }

    /// Where the grabs of a step lead: calls back with every slot and its displacement at the end [m].
    fn each_grabbed(&self, mut aim: impl FnMut(usize, [f64; 3])) {
        for drive in &self.drives {
            let Drive::Grab { slots, start, offset } = drive else { continue };
            for (&slot, start) in slots.iter().zip(start) {
                if self.claims_on(slot).holds == 0 {
                    aim(slot as usize, [0, 1, 2].map(|axis| f64::from(start[axis]) + offset[axis]));
                }
            }
        }
    }

    /// Forces and pressures from outside at a share of the step and some places: calls back with slot and force [N]. True when they
    /// follow the places.
    fn each_load(
        &mut self,
        share: f64,
        place: impl Fn(usize) -> Vector3 + Sync,
        mut push: impl FnMut(usize, Vector3),
    ) -> bool {
        let mut follows = false;
        let Self { drives, lattice, topology, layout, assembly, .. } = self;
        for drive in drives {
            match drive {
                Drive::Hold { .. } | Drive::Grab { .. } | Drive::Obstacle { .. } | Drive::Released => {}
                Drive::Pressure(faces) => {
                    let pressure = faces.pressure.at(share);
                    follows |= pressure != 0.0;
                    let slot = |particle: u32| layout.slot[particle as usize] as usize;
                    faces.each(
                        lattice,
                        topology,
                        |particle| place(slot(particle)),
                        |particle, unit| {
                            push(slot(particle), unit * pressure);
                        },
                    );
                }
                Drive::Force { slots, force, mass } => {
                    let acceleration = force.at(share) / mass.max(f64::MIN_POSITIVE);
                    for &slot in slots.iter() {
                        let particle = layout.particle_of_slot(lattice, slot as usize).expect("driven particles");
                        push(slot as usize, acceleration * f64::from(assembly.mass[particle as usize]));
                    }
                }
            }
        }
        follows
    }
}

impl Mechanics for World {
    type Real = f32;

    fn accelerations(&mut self, share: f64, displacement: &Field<f32>, velocity: &Field<f32>, out: &mut Field<f32>) {
        self.kick_at(displacement, velocity, out);
        let place = |slot: usize| Vector3::from([0, 1, 2].map(|axis| f64::from(displacement[axis][slot])));
        let weights = std::mem::take(&mut self.dt_over_mass);
        self.each_load(share, place, |slot, force| {
            let kick = force * f64::from(weights[slot]);
            for axis in 0..3 {
                out[axis][slot] += kick[axis] as f32;
            }
        });
        let slowed = (self.drag_rate() * self.dt) as f32;
        if slowed > 0.0 {
            for axis in 0..3 {
                for ((out, velocity), weight) in out[axis].iter_mut().zip(&velocity[axis]).zip(&weights) {
                    *out -= if *weight > 0.0 { slowed * velocity } else { 0.0 };
                }
            }
        }
        self.dt_over_mass = weights;
    }

    fn unit(&self) -> f64 {
        self.dt
    }

    fn damped(&self) -> bool {
        self.springs.damped() || self.drag.is_some()
    }
}

impl Precise {
    fn of(world: &World) -> Self {
        let wide = |field: &Field<f32>| field.each_ref().map(|axis| axis.iter().copied().map(f64::from).collect());
        Self {
            lattice: PreciseLattice::of(world),
            displacement: wide(&world.displacement),
            velocity: wide(&world.velocity),
            explicit: Explicit::default(),
            backward: BackwardEuler::default(),
            settled: QuasiStatic::default(),
            severed: world.topology().severed().len(),
        }
    }

    /// Takes over what was changed in the world from outside.
    fn follow(&mut self, world: &World) {
        self.lattice.follow(world);
        if self.severed < world.topology().severed().len() {
            self.severed = world.topology().severed().len();
            self.lattice.forget_step();
        }
        for (own, field) in [(&mut self.displacement, &world.displacement), (&mut self.velocity, &world.velocity)] {
            for axis in 0..3 {
                for (wide, &value) in own[axis].iter_mut().zip(&field[axis]) {
                    // As it was left, or told otherwise since.
                    if *wide as f32 != value {
                        *wide = value.into();
                    }
                }
            }
        }
    }
}

impl Integration {
    fn new(world: &World, integrator: Integrator) -> Self {
        let wide = integrator.precision == Precision::Double || integrator.method.is_stable_at_any_step();
        Self {
            integrator,
            radian: radian(world),
            single: Explicit::default(),
            precise: wide.then(|| Box::new(Precise::of(world))),
        }
    }

    /// Bytes held while stepping.
    pub(in crate::dynamics) fn bytes(&self, slots: usize) -> usize {
        let method = self.integrator.method;
        let implicit = method.is_stable_at_any_step();
        // Fields of three numbers.
        let fields = match method {
            Method::SymplecticEuler => 1,
            Method::Verlet => 2,
            Method::Rk4 | Method::BogackiShampine => 6,
            Method::BackwardEuler => 13,
            Method::QuasiStatic => 15,
        };
        match &self.precise {
            None => 12 * slots * fields,
            Some(precise) => {
                precise.lattice.bytes(implicit) + slots * (24 * (fields + 2) + if implicit { 48 } else { 0 })
            }
        }
    }

    /// One step of the world.
    pub(in crate::dynamics) fn step(&mut self, world: &mut World) -> Result<(), StepError> {
        if self.precise.is_some() {
            self.step_precise(world)?
        } else {
            self.step_single(world)?
        }
        let moved = self.integrator.method == Method::QuasiStatic;
        let mut fastest = std::mem::take(&mut world.next_fastest);
        if !moved {
            largest_squares(&world.velocity, &mut fastest);
        }
        // What is stable at any step may take neighbours further apart than others; that it is finite has been seen to.
        let sound = if self.integrator.method.is_stable_at_any_step() { Ok(()) } else { world.check(&fastest) };
        world.next_fastest = fastest;
        sound?;
        std::mem::swap(&mut world.fastest_squared, &mut world.next_fastest);
        world.steps += 1;
        Ok(())
    }

    fn step_single(&mut self, world: &mut World) -> Result<(), StepError> {
        let (dt, pitch) = (world.dt, world.lattice.pitch);
        if let Some(cells) = &mut world.cells {
            cells.set_dt(pitch, INSTANT * dt);
        }
        let mut displacement = std::mem::take(&mut world.displacement);
        let mut velocity = std::mem::take(&mut world.velocity);
        world.each_grabbed(|slot, target| {
            for axis in 0..3 {
                velocity[axis][slot] = ((target[axis] - f64::from(displacement[axis][slot])) / dt) as f32;
            }
        });
        let state = [&mut displacement, &mut velocity];
        let lengths = [self.integrator.tolerance, self.radian.min(dt)];
        let result = self.single.advance(self.integrator.method, world, state, dt, lengths);
        world.displacement = displacement;
        world.velocity = velocity;
        result.map_err(|too_many| self.too_many(world, &too_many))
    }

    fn step_precise(&mut self, world: &mut World) -> Result<(), StepError> {
        let mut precise = self.precise.take().expect("asked for");
        let result = self.advance_precise(&mut precise, world);
        for (own, field) in [(&precise.displacement, &mut world.displacement), (&precise.velocity, &mut world.velocity)]
        {
            for axis in 0..3 {
                field[axis].iter_mut().zip(&own[axis]).for_each(|(value, wide)| *value = *wide as f32);
            }
        }
        self.precise = Some(precise);
        result
    }

    fn advance_precise(&mut self, precise: &mut Precise, world: &mut World) -> Result<(), StepError> {
        let dt = world.dt;
        let Integrator { method, tolerance, .. } = self.integrator;
        precise.follow(world);
        let Precise { lattice, displacement, velocity, explicit, backward, settled, .. } = precise;
        world.each_grabbed(|slot, target| {
            for axis in 0..3 {
                velocity[axis][slot] = (target[axis] - displacement[axis][slot]) / dt;
            }
        });
        match method {
            Method::BackwardEuler => {
                load(world, 1.0, lattice, displacement);
                let done = backward.advance(lattice, displacement, velocity, dt, tolerance);
                done.map_err(|unsettled| self.unsettled(world, &unsettled))
            }
            Method::QuasiStatic => {
                let before = displacement.clone();
                let done = settled.advance(lattice, displacement, velocity, dt, tolerance, |lattice, places| {
                    load(world, 1.0, lattice, places)
                });
                // How far things went, for what follows moving tissue.
                let mut moved = before;
                for axis in 0..3 {
                    moved[axis].iter_mut().zip(&displacement[axis]).for_each(|(then, now)| *then = (now - *then) / dt);
                }
                largest_squares(&moved, &mut world.next_fastest);
                done.map_err(|unsettled| self.unsettled(world, &unsettled))
            }
            _ => {
                let mut loaded = Loaded { world, lattice };
                let lengths = [tolerance, self.radian.min(dt)];
                let done = explicit.advance(method, &mut loaded, [displacement, velocity], dt, lengths);
                done.map_err(|too_many| self.too_many(world, &too_many))
            }
        }
    }

    fn too_many(&self, world: &World, too_many: &TooManyParts) -> StepError {
        let (place, _) = fastest(world);
        StepError::TooFine {
            time: world.time(),
            place,
            tolerance: self.integrator.tolerance * 1e3,
            part: too_many.part,
            most_parts: too_many.most_parts,
        }
    }

    fn unsettled(&self, world: &World, unsettled: &Unsettled) -> StepError {
        let particle = world.layout.particle_of_slot(&world.lattice, unsettled.slot).unwrap_or(0);
        StepError::Unsettled {
            time: world.time() + world.dt,
            place: world.lattice.rest_place(particle),
            step: unsettled.step * 1e3,
            tolerance: self.integrator.tolerance * 1e3,
            iterations: unsettled.iterations,
            hint: if self.integrator.method == Method::QuasiStatic {
                "something may be held by nothing (fix a region of every piece that a load acts on), or the tissue collapses under \
                 its load: lower it, or let it come on in more steps with a smaller time.dt"
            } else {
                "the tissue collapses within one step: ask for a smaller time.dt, or for a time.tolerance above what rounding \
                 allows"
            },
        }
    }
}

/// A precise lattice under the loads of its world.
struct Loaded<'a> {
    world: &'a mut World,
    lattice: &'a mut PreciseLattice,
}

impl Mechanics for Loaded<'_> {
    type Real = f64;

    fn accelerations(&mut self, share: f64, displacement: &Field<f64>, velocity: &Field<f64>, out: &mut Field<f64>) {
        load(self.world, share, self.lattice, displacement);
        self.lattice.accelerations(share, displacement, velocity, out);
    }

    fn unit(&self) -> f64 {
        self.lattice.unit()
    }

    fn damped(&self) -> bool {
        self.lattice.damped()
    }
}

/// Takes the loads of the world at a share of the step and some places; true when they follow the places.
fn load(world: &mut World, share: f64, lattice: &mut PreciseLattice, displacement: &Field<f64>) -> bool {
    for axis in &mut lattice.load {
        axis.fill(0.0);
    }
    let place = |slot: usize| Vector3::from([0, 1, 2].map(|axis| displacement[axis][slot]));
    world.each_load(share, place, |slot, force| {
        for axis in 0..3 {
            lattice.load[axis][slot] += force[axis];
        }
    })
}

/// The largest squared speed of each block, infinite when one is not finite.
fn largest_squares<R: Real>(velocity: &Field<R>, fastest: &mut [f32]) {
    fastest.par_iter_mut().enumerate().for_each(|(block, fastest)| {
        let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
        let squared = |slot: usize| -> f64 { (0..3).map(|axis| velocity[axis][slot].wide().powi(2)).sum() };
        // A comparison that a NaN fails.
        let counted = |squared: f64| if squared < f64::from(f32::MAX) { squared as f32 } else { f32::INFINITY };
        *fastest = slots.map(|slot| counted(squared(slot))).fold(0.0, f32::max);
    });
}

/// Rest place and speed of the fastest particle.
fn fastest(world: &World) -> (crate::geometry::Point3, f64) {
    let speed = |particle: u32| {
        let speed = world.velocity(particle).norm();
        if speed.is_nan() { f64::INFINITY } else { speed }
    };
    let all = (0..world.lattice.len() as u32).map(|particle| (speed(particle), particle));
    let (speed, particle) = all.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
    (world.lattice.rest_place(particle), speed)
}
