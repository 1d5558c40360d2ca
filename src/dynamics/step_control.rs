//! Keeps the step stable while the tissue deforms.
//!
//! The step of a run is chosen for the rest state ([`super::stable_dt`]). Stretched springs also resist sideways, sheared
//! ones turn together, and a cell's volume term grows with the area of its faces: all that shortens the stable step, for
//! springs alone down to [`Limits::promise`], for volume terms without end. The control bounds the limit of the
//! present shape particle by particle, and where the step is too long it divides the rest of the interval (a frame, or a
//! step the scene asked for) into more, equal steps; when the shape relaxes it takes fewer again.
//!
//! What is guaranteed, in units of `1/dt^2` so that the numbers add: the present limit is taken as the true one at
//! rest plus what the blocks of [`crate::kernel::tangent`] have gained since. The blocks alone are a rigorous bound for
//! any shape; that their gain bounds the gain of the whole is Weyl's inequality where stiffness is added, and an
//! approximation where springs turn against each other. Where the blocks are exact at rest (inside any uniform lattice)
//! both are the same. Besides, neighbours part by at most a quarter of a pitch in a step, as far as dividing goes. Not
//! counted: what dampers of fast springs add sideways, and the rest of the step before the shape
//! is looked at again, which is why that happens while there is still room. Should a step slip through all the same, the
//! world itself notices: by the check of every step what flies apart, by its alternation what dampers hold together
//! (`super::alternation`).
//!
//! Same world, same calls: same decisions, at any number of threads.

use rayon::prelude::*;

use super::effects::fibres::in_slots;
use super::parting::Parting;
use super::slot_constants::{SlotConstants, to_slots, with_law};
use super::stable_dt::{DampingTimes, Limits, SAFETY, damping_times, whole_moduli};
use super::step_error::StepError;
use super::world::World;
use crate::kernel::block::StepConstants;
use crate::kernel::halo::{HALO_LEN, Halo, gather_rows};
use crate::kernel::laws::Bits;
use crate::kernel::tangent::{CellTangents, TangentState, stiffest};
use crate::lattice::layout::BLOCK_LEN;

/// A step is left alone up to this share of the present limit; a new one is [`SAFETY`] of it.
const TOLERATED: f64 = 0.85;
/// `lambda` grows by at most about this much, relative, when neighbours part by one pitch: springs (an even stretch by
/// `s` adds 1.5 s) and cells (`|cof F|^2` grows with the fourth power).
const GROWTH: [f64; 2] = [2.0, 6.0];
/// A block is looked at again when its neighbours may have parted by so much since [pitches]: no sooner, no later.
const LOOK_AGAIN: [f64; 2] = [0.03, 0.15];
/// Neighbours that cannot have parted by so much in a step [pitches] are not compared: taking them to have parted costs a
/// tenth of a look, about what comparing would.
const NOT_COMPARED: f64 = 0.1 * LOOK_AGAIN[0];
/// Neighbours may part or meet by so much in a step [pitches]: what moves faster than its waves is resolved, or the
/// energy of a collapse would come out wrong.
const PARTING: f64 = 0.25;
/// A step divided into more parts than this is refused.
pub const MOST_PARTS: u64 = 64;

/// Watches a world and divides its steps.
pub struct StepControl {
    limits: Limits,
    stiffness: SlotConstants,
    inverse_mass: Vec<f32>,
    /// Damping over stiffness of each slot [s], as the integrator feels it; `None` when nothing damps.
    damping_time: Option<Vec<f32>>,
    /// Limit of the integrator over that of the plain step, and the rate of drag it has to resolve [1/s].
    reach: (f64, f64),
    /// Volume modulus of the whole cell above each slot [Pa].
    modulus: Option<Vec<f32>>,
    /// Fibres of the same cells [Pa^1/2].
    fibres: Option<[Vec<f32>; 3]>,
    /// Severed springs whose cells have been taken out.
    severed: usize,
    /// `4 / dt` of the stiffest particle of each block when it was last looked at [1/s]; empty before the first look.
    rate: Vec<f32>,
    parting: Parting,
    /// Blocks looked at so far.
    looked_at: u64,
    counts: StepCounts,
}

/// What stepping a schedule took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepCounts {
    /// Steps taken.
    pub steps: u64,
    /// Those that were shorter than planned.
    pub divided: u64,
    /// Most parts that a planned step was divided into, on average over its interval.
    pub most_parts: f64,
    /// Shortest step taken [s]; infinite before the first.
    pub shortest_dt: f64,
    /// How often the shape was looked at; looks at some of its blocks count as their share.
    pub looks: u64,
}

/// A stretch of time that is stepped in equal steps unless the shape asks for more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    until: f64,
    dt: f64,
    left: u64,
    begun: bool,
}

impl Interval {
    /// `steps` of `dt` [s] that end at `until` [s].
    pub fn new(until: f64, dt: f64, steps: u64) -> Self {
        Self { until, dt, left: steps, begun: false }
    }

    /// Where it ends [s].
    pub fn until(&self) -> f64 {
        self.until
    }
}

impl StepControl {
    /// Prepares the watch of a world; `limits` are those of its lattice and assembly.
    pub fn new(world: &World, limits: Limits) -> Self {
        let (lattice, assembly, layout) = (world.lattice(), world.assembly(), &world.layout);
        let inverse = |m: &f32| if *m > 0.0 { m.recip() } else { 0.0 };
        let damping_time = match damping_times(lattice, world.topology(), assembly) {
            DampingTimes::Same(0.0) => None,
            DampingTimes::Same(time) => Some(vec![time; layout.slots()]),
            DampingTimes::PerParticle(times) => Some(to_slots(layout, &times)),
        };
        let method = world.integrator().method;
        let damping_time = damping_time.map(|mut times| {
            times.iter_mut().for_each(|time| *time *= method.damper_share());
            times
        });
        let drag = method.resolved_drag(world.drag_rate());
        let volume = assembly.volume.as_ref();
        let modulus = volume.map(|volume| to_slots(layout, &whole_moduli(lattice, world.topology(), &volume.modulus)));
        Self {
            limits,
            stiffness: SlotConstants::new(layout, &assembly.instant_stiffness()),
            inverse_mass: to_slots(layout, &assembly.mass.iter().map(inverse).collect::<Vec<_>>()),
            reach: (method.reach(damping_time.is_some() || drag > 0.0), drag),
            damping_time,
            modulus,
            fibres: assembly.fibres.as_ref().map(|term| in_slots(lattice, layout, world.topology(), term)),
            severed: world.topology().severed().len(),
            rate: Vec::new(),
            parting: Parting::new(world),
            looked_at: 0,
            counts: StepCounts { steps: 0, divided: 0, most_parts: 1.0, shortest_dt: f64::INFINITY, looks: 0 },
        }
    }

    /// What it took so far.
    pub fn counts(&self) -> StepCounts {
        let blocks = self.parting.blocks() as u64;
        StepCounts { looks: self.looked_at.div_ceil(blocks.max(1)), ..self.counts }
    }

    /// Gives the world the step it is to take next; false when the interval is over. To be called before every step, and
    /// before what is applied to the world for that step.
    ///
    /// # Errors
    /// [`StepError::TooStiff`] if a step would have to be divided into more than [`MOST_PARTS`].
    pub fn plan(&mut self, world: &mut World, interval: &mut Interval) -> Result<bool, StepError> {
        if interval.left == 0 {
            return Ok(false);
        }
        if world.integrator().method.is_stable_at_any_step() {
            world.set_dt(interval.dt);
            return Ok(true);
        }
        // Fast motion is resolved as far as dividing goes; only what would be unstable is refused.
        let finest = interval.dt / (SAFETY * (MOST_PARTS as f64 - 1.0));
        let mut limit = self.limit(world, interval.dt);
        if self.modulus.is_none() {
            limit = limit.max(finest.min(self.limits.promise));
        }
        let limit = limit.min(self.parting_limit(world, interval.dt).max(finest));
        let begins = !std::mem::replace(&mut interval.begun, true);
        let dt = world.dt();
        let fits = dt <= TOLERATED * limit;
        let as_planned = dt == interval.dt;
        if fits && (as_planned || (!begins && dt >= TOLERATED * interval.dt)) {
            return Ok(true);
        }
        let remaining = interval.until - world.time();
        let longest = if interval.dt <= TOLERATED * limit { interval.dt } else { SAFETY * limit };
        let parts = interval.dt / longest;
        if parts > MOST_PARTS as f64 || !parts.is_finite() {
            return Err(world.too_stiff(limit, self.stiffest_particle(world), MOST_PARTS));
        }
        let steps = (remaining / longest - 1e-6).ceil().max(1.0) as u64;
        if begins && steps == interval.left {
            world.set_dt(interval.dt);
        } else if begins || !fits || steps < interval.left {
            world.set_dt(remaining / steps as f64);
            interval.left = steps;
        }
        Ok(true)
    }

    /// Takes note of a step just taken.
    pub fn stepped(&mut self, world: &World, interval: &mut Interval) {
        interval.left -= 1;
        let dt = world.dt();
        let short = if self.needs_no_look(world, interval.dt) { PARTING * dt / interval.dt } else { NOT_COMPARED };
        self.parting.stepped(world, short * world.lattice().pitch);
        self.counts.steps += 1;
        self.counts.shortest_dt = self.counts.shortest_dt.min(dt);
        if dt < interval.dt * (1.0 - 1e-6) {
            self.counts.divided += 1;
            self.counts.most_parts = self.counts.most_parts.max(interval.dt / dt);
        }
    }

    /// Springs alone never need less than promised.
    fn needs_no_look(&self, world: &World, planned: f64) -> bool {
        self.limits.rest.is_infinite()
            || (self.modulus.is_none() && planned <= TOLERATED * self.limits.promise && world.dt() == planned)
    }

    /// The largest stable step [s]; looks again at the blocks whose shape may have changed.
    fn limit(&mut self, world: &World, planned: f64) -> f64 {
        if self.needs_no_look(world, planned) {
            return self.limits.sharp;
        }
        let blocks = world.layout.blocks.len();
        let again: Vec<usize> = if self.rate.is_empty() {
            self.rate = vec![0.0; blocks];
            (0..blocks).collect()
        } else {
            (0..blocks).filter(|&block| self.parting.moved(block) >= self.allowed(world, block)).collect()
        };
        if !again.is_empty() {
            self.forget_severed_cells(world);
            let rates = self.stiffest_of(world, &again);
            for (&block, rate) in again.iter().zip(rates) {
                self.rate[block] = rate;
                self.parting.forget(block);
            }
            self.looked_at += again.len() as u64;
        }
        self.limit_of(4.0 / f64::from(self.rate.iter().copied().fold(0.0, f32::max)))
    }

    /// How far neighbours in a block may part until its share of the limit can have come down to the present step [m].
    fn allowed(&self, world: &World, block: usize) -> f64 {
        let Limits { rest, sharp, .. } = self.limits;
        let may_become = square(world.dt()) - square(sharp) + square(rest);
        let room = may_become / (f64::from(self.rate[block]) / 4.0).powi(2).max(f64::MIN_POSITIVE) - 1.0;
        let growth = GROWTH[usize::from(self.modulus.is_some())];
        (room / growth).clamp(LOOK_AGAIN[0], LOOK_AGAIN[1]) * world.lattice().pitch
    }

    /// The largest stable step for the world's present shape [s].
    pub fn look(&mut self, world: &World) -> f64 {
        let now = self.blocks_limit(world);
        self.limit_of(now)
    }

    /// The limit of a shape [s] from that of its blocks.
    fn limit_of(&self, now: f64) -> f64 {
        let Limits { rest, sharp, .. } = self.limits;
        1.0 / (square(sharp) + (square(now) - square(rest)).max(0.0)).sqrt()
    }

    /// The rigorous limit of the present shape, by the blocks alone [s].
    pub fn blocks_limit(&mut self, world: &World) -> f64 {
        self.forget_severed_cells(world);
        let all: Vec<usize> = (0..world.layout.blocks.len()).collect();
        4.0 / f64::from(self.stiffest_of(world, &all).into_iter().fold(0.0, f32::max))
    }

    /// The largest rate in each of some blocks.
    fn stiffest_of(&self, world: &World, blocks: &[usize]) -> Vec<f32> {
        let stiffest = |buffers: &mut Box<Buffers>, &block: &usize| {
            self.rates(world, block, buffers);
            buffers.rate.iter().copied().fold(0.0, f32::max)
        };
        blocks.par_iter().map_init(Buffers::new, stiffest).collect()
    }

    /// `4 / dt` of each slot's own limit `dt`.
    fn rates(&self, world: &World, block: usize, buffers: &mut Buffers) {
        let (neighbours, rows) = (&world.layout.neighbours[block], world.layout.rows[block]);
        let Buffers { displacement, constants, modulus, fibres, cells, rate } = buffers;
        for axis in 0..3 {
            gather_rows(&world.displacement[axis], neighbours, rows, &mut displacement[axis]);
        }
        self.stiffness.gather(neighbours, rows, constants);
        if let Some(values) = &self.modulus {
            gather_rows(values, neighbours, rows, modulus);
        }
        let fibres = match &self.fibres {
            None => None,
            Some(root) => {
                let halos = fibres.get_or_insert_with(|| Box::new([[0.0; HALO_LEN]; 3]));
                root.iter()
                    .zip(halos.iter_mut())
                    .for_each(|(values, halo)| gather_rows(values, neighbours, rows, halo));
                Some(halos.each_ref())
            }
        };
        let step = StepConstants::new(world.lattice().pitch, world.dt(), [0.0; 3]);
        let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
        let state = TangentState {
            displacement: displacement.each_ref(),
            inverse_mass: self.inverse_mass[slots.clone()].try_into().expect("whole blocks"),
            modulus: self.modulus.is_some().then_some(&*modulus),
            fibres,
            pitch: step.pitch,
            rest_length: step.rest_length,
        };
        let alive = Bits { alive: world.living_springs(block) };
        with_law!(&self.stiffness, &*constants, |law| stiffest(law, alive, state, cells, rate));
        // a dt^2 + 2 b dt = 4 with b = tau a.
        match &self.damping_time {
            None => rate.iter_mut().for_each(|a| *a = (4.0 * *a).sqrt()),
            Some(times) => {
                for (a, &time) in rate.iter_mut().zip(&times[slots]) {
                    let b = time * *a;
                    *a = b + (b * b + 4.0 * *a).sqrt();
                }
            }
        }
        if self.reach != (1.0, 0.0) {
            let (reach, drag) = self.reach;
            rate.iter_mut().for_each(|a| *a = (f64::from(*a) / reach + 4.0 * drag) as f32);
        }
    }

    /// The step in which the fastest neighbours part by [`PARTING`] [s]; infinite while that is more than planned.
    fn parting_limit(&self, world: &World, planned: f64) -> f64 {
        let most = PARTING * world.lattice().pitch;
        let slow = most / planned;
        let speed = self.parting.fastest(world, slow);
        if speed <= slow { f64::INFINITY } else { most / speed }
    }

    fn stiffest_particle(&self, world: &World) -> u32 {
        let of_block = |buffers: &mut Box<Buffers>, block: usize| {
            self.rates(world, block, buffers);
            let (slot, rate) =
                buffers.rate.iter().copied().enumerate().fold((0, -1.0), |a, b| if b.1 > a.1 { b } else { a });
            (block * BLOCK_LEN + slot, rate)
        };
        let all: Vec<(usize, f32)> =
            (0..world.layout.blocks.len()).into_par_iter().map_init(Buffers::new, of_block).collect();
        let (slot, _) = all.into_iter().fold((0, -1.0), |a, b| if b.1 > a.1 { b } else { a });
        world.layout.particle_of_slot(world.lattice(), slot).unwrap_or(0)
    }

    /// A cell with a severed spring has no volume term and no fibres.
    fn forget_severed_cells(&mut self, world: &World) {
        let severed = world.topology().severed();
        let lattice = world.lattice();
        for values in self.modulus.iter_mut().chain(self.fibres.iter_mut().flatten()) {
            for spring in &severed[self.severed..] {
                for cell in lattice.cells_of_spring(spring.particle, usize::from(spring.direction)) {
                    values[world.layout.slot[cell as usize] as usize] = 0.0;
                }
            }
        }
        self.severed = severed.len();
    }
}

/// `1 / dt^2`, which adds.
fn square(dt: f64) -> f64 {
    (1.0 / dt).powi(2)
}

struct Buffers {
    displacement: [Halo; 3],
    constants: Halo,
    modulus: Halo,
    /// Only where there are fibres.
    fibres: Option<Box<[Halo; 3]>>,
    cells: CellTangents,
    rate: [f32; BLOCK_LEN],
}

impl Buffers {
    fn new() -> Box<Self> {
        let zeros = [0.0; HALO_LEN];
        Box::new(Self {
            displacement: [zeros; 3],
            constants: zeros,
            modulus: zeros,
            fibres: None,
            cells: CellTangents::default(),
            rate: [0.0; BLOCK_LEN],
        })
    }
}
