//! One step of contact of tissue with itself: who is near, who touches, what they do to each other.

use rayon::prelude::*;

use super::response::{Body, Contact, respond};
use super::search::{AHEAD, Pair, common_normal, near_pairs, reach};
use super::surface::{Member, Surface};
use super::{LATERAL, PUSH_OUT_SPEED, SKIN, SelfContact};
use crate::dynamics::drive::raise;
use crate::dynamics::world::World;
use crate::geometry::Vector3;
use crate::lattice::layout::BLOCK_LEN;

/// Two particles look at each other when their normals are at more than about 105 degrees: sides at right angles do not, which meet
/// at edges and not along a surface.
const FACING: f64 = -0.25;
/// And each looks along the common normal within this cosine.
const ALONG: f64 = 0.5;
/// What overlaps by more does not count as touching [pitches].
const DEEPEST: f64 = 1.0;
/// Overlap up to this is rounding, and left alone until something else touches [pitches].
const ROUNDING: f64 = 1e-5;
/// Pairs that will be this far from touching are solved for too, as impulses to others may bring them together [pitches].
const NEARLY: f64 = 0.05;
/// Overlap that only may not grow [pitches]: normals turn as tissue deforms, and leading out what comes of that would do work.
const SLACK: f64 = 0.1;
/// Share of a deeper overlap that is led out in a step.
const LED_OUT: f64 = 0.1;
/// While particles have moved less than this since nothing touched, nothing will [pitches].
const UNMOVED: f64 = 1e-6;
/// Marks what has no number.
const NONE: u32 = u32::MAX;

impl World {
    /// After the kick and all that drives, before obstacles: gives surface particles velocities that keep tissue out of tissue.
    ///
    /// `fastest` is the largest squared speed of each block, raised by what is pushed.
    pub(in crate::dynamics) fn touch_itself(&mut self, fastest: &mut [f32]) {
        let Some(mut contact) = self.self_contact.take() else { return };
        contact.touch(self, fastest);
        self.self_contact = Some(contact);
    }

    /// After the drift: how far surface particles may have come from where they were.
    pub(in crate::dynamics) fn note_moves_of_surface(&mut self) {
        let Some(mut contact) = self.self_contact.take() else { return };
        let way = self.longest_move();
        contact.moved += way;
        contact.unseen += way;
        self.self_contact = Some(contact);
    }
}

/// Places of the members now, lattice axes [m].
pub(super) fn places(surface: &Surface, world: &World) -> Vec<Vector3> {
    let pitch = world.lattice.pitch;
    let place = |member: &Member| member.rest() * pitch + moved(&world.displacement, member.slot);
    surface.members().par_iter().with_min_len(1024).map(place).collect()
}

fn moved(field: &[Vec<f32>; 3], slot: u32) -> Vector3 {
    Vector3::from([0, 1, 2].map(|axis| f64::from(field[axis][slot as usize])))
}

impl SelfContact {
    fn touch(&mut self, world: &mut World, fastest: &mut [f32]) {
        let pitch = world.lattice.pitch;
        if self.surface.follow(&world.lattice, &world.topology, &world.layout) {
            self.forget();
        }
        let way = f64::from(fastest.iter().copied().fold(0.0, f32::max)).sqrt() * world.dt;
        if self.touching == 0 && self.unseen + way < UNMOVED * pitch {
            return;
        }
        self.touching = 0;
        self.keep_pairs(world);
        if self.pairs.is_empty() {
            return;
        }
        self.looks += self.pairs.len() as u64;
        self.unseen = 0.0;
        let (mut contacts, members) = self.contacts(world);
        let due = |contact: &Contact| {
            let [a, b] = contact.ends.map(|end| moved(&world.velocity, members[end].0));
            (b - a).dot(&contact.normal) - contact.parting < -ROUNDING * pitch / world.dt
        };
        if !contacts.iter().any(due) {
            return;
        }
        let mut bodies: Vec<Body> = members
            .iter()
            .map(|&(slot, weight)| Body { weight, velocity: moved(&world.velocity, slot), pushed: false })
            .collect();
        self.touching = respond(&mut bodies, &mut contacts, self.friction, pitch / world.dt);
        for (&(slot, weight), body) in members.iter().zip(&bodies) {
            if body.pushed && weight > 0.0 {
                let slot = slot as usize;
                for axis in 0..3 {
                    world.velocity[axis][slot] = body.velocity[axis] as f32;
                }
                raise(&mut fastest[slot / BLOCK_LEN], slot, &world.velocity);
            }
        }
    }

    /// Looks for candidates again where particles have moved too far.
    fn keep_pairs(&mut self, world: &World) {
        let pitch = world.lattice.pitch;
        let members = self.surface.members();
        let farthest = 0.5 * SKIN * pitch;
        if self.found_at.len() == members.len() {
            if self.moved <= farthest {
                return;
            }
            // The bound may be far above what happened: what flies or swings as a whole does not part.
            let change = |(member, then): (&Member, &[f32; 3])| {
                moved(&world.displacement, member.slot) - Vector3::from(then.map(f64::from))
            };
            let changes: Vec<Vector3> = members.iter().zip(&self.found_at).map(change).collect();
            let mean = changes.iter().sum::<Vector3>() / changes.len().max(1) as f64;
            self.moved = changes.iter().map(|change| (change - mean).norm()).fold(0.0, f64::max);
            if self.moved <= farthest {
                return;
            }
        }
        self.pairs = near_pairs(&self.surface, &world.lattice, &world.topology, &places(&self.surface, world));
        self.found_at =
            members.iter().map(|member| [0, 1, 2].map(|axis| world.displacement[axis][member.slot as usize])).collect();
        self.moved = 0.0;
        self.searches += 1;
    }

    /// The pairs that touch or nearly will, and the slots and weights of their particles.
    fn contacts(&self, world: &World) -> (Vec<Contact>, Vec<(u32, f64)>) {
        let (pitch, dt) = (world.lattice.pitch, world.dt);
        let members = self.surface.members();
        let farthest = reach() * pitch;
        let way = |ends: [u32; 2]| {
            let [a, b] = ends.map(|end| &members[end as usize]);
            (b.rest() - a.rest()) * pitch + (moved(&world.displacement, b.slot) - moved(&world.displacement, a.slot))
        };
        let is_free = |end: u32| world.dt_over_mass[members[end as usize].slot as usize] > 0.0;
        let near = |pair: &&Pair| {
            way(pair.ends).norm_squared() <= farthest * farthest && (is_free(pair.ends[0]) || is_free(pair.ends[1]))
        };
        let near: Vec<Pair> = self.pairs.par_iter().with_min_len(4096).filter(near).copied().collect();
        // Members that are near others, and their normals; and the particles that they are.
        let mut members_near = Numbering::new(members.len());
        let mut particles_near = Numbering::new(members.len());
        for end in near.iter().flat_map(|pair| pair.ends) {
            members_near.add(end as usize);
            particles_near.add(self.surface.first_of_particle(end as usize));
        }
        let lattice = (&world.lattice, &world.layout);
        let normal = |&end: &usize| self.surface.normal_now(&members[end], lattice, &world.displacement);
        let normals: Vec<Vector3> = members_near.numbered.par_iter().with_min_len(256).map(normal).collect();
        let contact = |pair: &Pair| {
            let [from, to] = pair.ends.map(|end| normals[members_near.of(end as usize)]);
            if from.dot(&to) > FACING || from == Vector3::zeros() || to == Vector3::zeros() {
                return None;
            }
            let [a, b] = pair.ends.map(|end| &members[end as usize]);
            let normal = common_normal((a, from), (b, to));
            if from.dot(&normal) < ALONG || to.dot(&normal) > -ALONG {
                return None;
            }
            let way = way(pair.ends);
            let gap = way.dot(&normal);
            let free = gap - pair.least;
            let across = (way - normal * gap).norm();
            if across > LATERAL * pitch || gap < -DEEPEST * pitch || free > AHEAD * pitch {
                return None;
            }
            let deeper = (-free - SLACK * pitch).max(0.0);
            let parting = if free >= 0.0 { -free / dt } else { (LED_OUT * deeper / dt).min(PUSH_OUT_SPEED) };
            let relative = moved(&world.velocity, b.slot) - moved(&world.velocity, a.slot);
            let ends = pair.ends.map(|end| particles_near.of(self.surface.first_of_particle(end as usize)));
            let nearly = relative.dot(&normal) - parting < NEARLY * pitch / dt;
            nearly.then_some(Contact { ends, normal, parting, push: 0.0, drag: Vector3::zeros() })
        };
        let contacts = near.par_iter().with_min_len(2048).filter_map(contact).collect();
        let body = |&end: &usize| {
            let slot = members[end].slot;
            (slot, f64::from(world.dt_over_mass[slot as usize]))
        };
        (contacts, particles_near.numbered.iter().map(body).collect())
    }
}

/// Numbers some of many things in the order they are met.
struct Numbering {
    number: Vec<u32>,
    numbered: Vec<usize>,
}

impl Numbering {
    fn new(things: usize) -> Self {
        Self { number: vec![NONE; things], numbered: Vec::new() }
    }

    fn add(&mut self, thing: usize) {
        if self.number[thing] == NONE {
            self.number[thing] = self.numbered.len() as u32;
            self.numbered.push(thing);
        }
    }

    /// Of one that was added.
    fn of(&self, thing: usize) -> usize {
        self.number[thing] as usize
    }
}
