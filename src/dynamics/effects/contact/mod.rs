//! Contact of soft tissue with rigid obstacles, with Coulomb friction.
//!
//! # What touches what
//!
//! Obstacles are tools that follow a path ([`Shape::sphere`], [`Shape::capsule`], [`Shape::block`], [`Shape::mesh`]), planes
//! ([`Shape::plane`]) and rigid organs that stay or go where they are grabbed ([`Shape::rigid_organs`]). What they keep out is the
//! soft particles that are free to move: held and grabbed ones go where they are told, and free rigid bodies feel no obstacle.
//! A particle is a point: an obstacle narrower than two pitches can slip between particles.
//!
//! # One step
//!
//! Contact is an impulse, given after all forces of a step and before its drift. A particle whose place after the drift would
//! lie inside an obstacle gets the least change of velocity that ends it on the surface instead, where the obstacle will be
//! by then: an inelastic impact. The tangential velocity relative to the obstacle shrinks by at most the coefficient of
//! friction times the normal change, and never turns round: Bridson, Fedkiw and Anderson, "Robust treatment of collisions,
//! contact and friction for cloth animation", SIGGRAPH 2002, after Coulomb. So a particle that is outside before a step is
//! outside after it, no stiffness of contact has to be chosen, and the stable step stays what it was. Only where
//! obstacles close in on each other with tissue between is there no such place, and the last one added wins.
//!
//! On a curved surface the push follows the normal where the particle ends and not where it met the surface, so contact
//! without friction may give energy in the fourth order of the way per step over the radius; on planes it never does.
//!
//! A particle that is inside already, because a tool appeared in tissue or a hold ended there, is led out at
//! [`PUSH_OUT_SPEED`] and not shot out.
//!
//! # Cost
//!
//! Every obstacle keeps for each block of the lattice how far its particles were from the obstacle when they were last looked
//! at, less what block and obstacle have moved since. Only where that is used up are particles looked at: one number per block
//! and obstacle in every step, and a distance per particle of the blocks that touch.
//!
//! Same world, same calls: same bits, at any number of threads.

pub(crate) mod closest_triangle;
mod distance_field;
mod mesh_distance;
mod placed;
mod response;
mod shapes;
mod touch;
mod voxel_distance;

pub use mesh_distance::{MeshShapeError, SPACING_OF_PITCH, ToolMesh};
pub use response::PUSH_OUT_SPEED;
pub use shapes::Shape;

use self::placed::Placed;
use super::super::drive::{Drive, Handle};
use super::super::world::World;
use crate::geometry::Vector3;
use crate::lattice::layout::BLOCK_LEN;
use crate::material::RigidKind;

/// All obstacles of a world.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct Contact {
    /// In the order they were added; those taken away keep their account.
    obstacles: Vec<Placed>,
    /// One bit for each slot: a soft particle is there.
    soft: Vec<u16>,
    /// Blocks whose particles were looked at, summed over all steps.
    looks: u64,
}

/// What an obstacle has felt so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleFacts<'a> {
    /// Its name.
    pub name: &'a str,
    /// Force of the tissue on it in the last step, RAS+ [N].
    pub force: Vector3,
    /// The same summed over time since it was added, RAS+ [N s].
    pub impulse: Vector3,
}

impl World {
    /// Adds an obstacle that stands still until [`World::move_obstacle`]; [`World::release`] takes it away.
    ///
    /// - `friction`: Coulomb's coefficient, 0 or more.
    ///
    /// # Panics
    /// If `friction` is negative or not finite, or the world has another integrator than the plain step.
    pub fn add_obstacle(&mut self, name: &str, shape: Shape, friction: f64) -> Handle {
        assert!(friction >= 0.0 && friction.is_finite(), "friction is 0 or more");
        assert!(self.integration.is_none(), "only the plain step has contact");
        let placed = Placed::new(name, shape, friction, &self.lattice, self.layout.blocks.len());
        let mut contact = self.contact.take().unwrap_or_else(|| Box::new(self.no_obstacles()));
        contact.obstacles.push(placed);
        let number = contact.obstacles.len() - 1;
        self.contact = Some(contact);
        self.add(Drive::Obstacle { number })
    }

    /// Where an obstacle is to be after the next step, relative to where its shape says, RAS+ [mm].
    ///
    /// # Panics
    /// If the handle is not an obstacle's.
    pub fn move_obstacle(&mut self, handle: Handle, offset_mm: Vector3) {
        let target = self.to_lattice_axes(offset_mm * 1e-3);
        self.placed_mut(handle).target = target;
    }

    /// Where an obstacle is to be after the next step: as far from where its shape says as this particle will be from rest. For
    /// rigid organs without a mass, which only holds and grabs move; to be called before every step, after
    /// [`World::move_grab`].
    ///
    /// # Panics
    /// If the handle is not an obstacle's.
    pub fn move_obstacle_with(&mut self, handle: Handle, particle: u32) {
        let target = self.led_to(self.layout.slot[particle as usize]);
        self.placed_mut(handle).target = target;
    }

    /// Puts an obstacle somewhere at once, without the speed of going there; relative to where its shape says, RAS+ [mm].
    ///
    /// # Panics
    /// If the handle is not an obstacle's.
    pub fn place_obstacle(&mut self, handle: Handle, offset_mm: Vector3) {
        let offset = self.to_lattice_axes(offset_mm * 1e-3);
        let placed = self.placed_mut(handle);
        (placed.offset, placed.target) = (offset, offset);
        placed.forget();
    }

    /// Force of the tissue on an obstacle in the last step, RAS+ [N]; zero once it is taken away.
    ///
    /// # Panics
    /// If the handle is not an obstacle's, or it has been released.
    pub fn tool_force(&self, handle: Handle) -> Vector3 {
        self.facts_of(self.placed(handle)).force
    }

    /// Impulse of the tissue on an obstacle since it was added, RAS+ [N s]: the mean force between two moments is the
    /// difference over the time between.
    ///
    /// # Panics
    /// If the handle is not an obstacle's, or it has been released.
    pub fn tool_impulse(&self, handle: Handle) -> Vector3 {
        self.facts_of(self.placed(handle)).impulse
    }

    /// All obstacles there have been, in the order they were added.
    pub fn obstacles(&self) -> impl Iterator<Item = ObstacleFacts<'_>> {
        self.contact.iter().flat_map(|contact| &contact.obstacles).map(|placed| self.facts_of(placed))
    }

    /// Blocks of the lattice whose particles were compared with obstacles, summed over all steps: what contact has cost.
    pub fn contact_looks(&self) -> u64 {
        self.contact.as_ref().map_or(0, |contact| contact.looks)
    }

    fn facts_of<'a>(&self, placed: &'a Placed) -> ObstacleFacts<'a> {
        let [force, impulse] = [placed.force, placed.impulse].map(|vector| self.to_patient_axes(vector));
        ObstacleFacts { name: &placed.name, force, impulse }
    }

    /// Takes an obstacle away; what it felt stays known.
    pub(in crate::dynamics) fn remove_obstacle(&mut self, number: usize) {
        if let Some(contact) = &mut self.contact {
            contact.obstacles[number].remove();
        }
    }

    /// After a particle was put somewhere: what is known of its block no longer holds.
    pub(in crate::dynamics) fn forget_clearance(&mut self, slot: u32) {
        if let Some(contact) = &mut self.self_contact {
            contact.forget();
        }
        if let Some(contact) = &mut self.contact {
            let block = slot as usize / BLOCK_LEN;
            for placed in contact.obstacles.iter_mut().filter(|placed| placed.present) {
                placed.clearance[block] = f32::NEG_INFINITY;
            }
        }
    }

    fn number_of(&self, handle: Handle) -> usize {
        match &self.drives[handle.0] {
            Drive::Obstacle { number } => *number,
            other => panic!("{handle:?} is {other:?}, not an obstacle"),
        }
    }

    fn placed(&self, handle: Handle) -> &Placed {
        let number = self.number_of(handle);
        &self.contact.as_ref().expect("obstacles are kept").obstacles[number]
    }

    fn placed_mut(&mut self, handle: Handle) -> &mut Placed {
        let number = self.number_of(handle);
        &mut self.contact.as_mut().expect("obstacles are kept").obstacles[number]
    }

    fn no_obstacles(&self) -> Contact {
        let kind = self.assembly.rigid.as_ref().map(|parts| parts.kind());
        let mut soft = vec![0_u16; self.layout.slots() / 16];
        for (particle, &slot) in self.layout.slot.iter().enumerate() {
            let is_soft = kind.is_none_or(|kind| kind[particle] == RigidKind::Soft);
            if is_soft && self.assembly.mass[particle] > 0.0 {
                soft[slot as usize / 16] |= 1 << (slot % 16);
            }
        }
        Contact { obstacles: Vec::new(), soft, looks: 0 }
    }
}

impl Contact {
    /// Bytes held, distances sampled for meshes and bone included.
    pub(in crate::dynamics) fn bytes(&self) -> usize {
        2 * self.soft.len() + self.obstacles.iter().map(Placed::bytes).sum::<usize>()
    }
}
