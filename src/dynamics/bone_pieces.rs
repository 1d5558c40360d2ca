//! Bone that tissue is in contact with, as obstacles that each move as a whole.
//!
//! Rigid organs without a mass stay where they are but for grabs, which shift them, and holds, which have the last word. Organs
//! that the same grabs and holds take hold of make one obstacle, which goes where they go; all that no grab moves make another.

use std::collections::BTreeMap;

use super::drive::Handle;
use super::effects::contact::Shape;
use super::timeline::TimelineError;
use super::world::World;
use crate::lattice::Lattice;
use crate::lattice::region::Region;

/// Rigid organs that are one obstacle.
#[derive(Debug)]
pub(super) struct BonePiece {
    shape: Shape,
    /// One of its particles, when grabs move it.
    leader: Option<u32>,
    /// Once it is in a world.
    obstacle: Option<Handle>,
}

/// An operation that takes hold of particles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grip<'a> {
    pub(super) operation: &'a str,
    /// Ascending.
    pub(super) particles: &'a [u32],
    /// False for a hold.
    pub(super) moves: bool,
}

/// The pieces of some organs.
///
/// - `organs`: indices into the scene's organs;
/// - `grips`: every operation of the scene that holds or grabs.
///
/// # Errors
/// If a part of an organ that moves is taken hold of, or no voxel of any organ is left.
pub(super) fn bone_pieces(
    lattice: &Lattice,
    organs: &[usize],
    grips: &[Grip<'_>],
) -> Result<Vec<BonePiece>, TimelineError> {
    // Organs and a particle, by the numbers of the grips that move them.
    let mut moved_alike: BTreeMap<Vec<usize>, (Vec<usize>, Option<u32>)> = BTreeMap::new();
    for &organ in organs {
        let particles = Region::Organ(organ).select(lattice);
        let found_by = |grip: &Grip<'_>| particles.iter().filter(|p| grip.particles.binary_search(p).is_ok()).count();
        let mut movers: Vec<(usize, usize)> = grips.iter().map(found_by).enumerate().collect();
        movers.retain(|&(_, found)| found > 0);
        if !movers.iter().any(|&(number, _)| grips[number].moves) {
            movers.clear();
        }
        if let Some(&(number, found)) = movers.iter().find(|(_, found)| *found < particles.len()) {
            let (operation, particles) = (grips[number].operation.to_owned(), particles.len());
            return Err(TimelineError::BoneInPart { operation, organ, found, particles });
        }
        let leader = particles.first().copied().filter(|_| !movers.is_empty());
        let movers = movers.into_iter().map(|(number, _)| number).collect();
        let (alike, first) = moved_alike.entry(movers).or_default();
        alike.push(organ);
        *first = first.or(leader);
    }
    let piece = |(organs, leader): (Vec<usize>, Option<u32>)| {
        Some(BonePiece { shape: Shape::rigid_organs(lattice, &organs)?, leader, obstacle: None })
    };
    let pieces: Vec<BonePiece> = moved_alike.into_values().filter_map(piece).collect();
    if pieces.is_empty() { Err(TimelineError::NoBone) } else { Ok(pieces) }
}

impl BonePiece {
    /// Puts it into a world, where it is now.
    pub(super) fn add(&mut self, world: &mut World, name: &str, friction: f64) -> Handle {
        let handle = world.add_obstacle(name, self.shape.clone(), friction);
        self.obstacle = Some(handle);
        handle
    }

    /// Goes where grabs take it in the next step. To be called before every step, when the grabs know where they lead.
    pub(super) fn follow(&self, world: &mut World) {
        if let (Some(obstacle), Some(leader)) = (self.obstacle, self.leader) {
            world.move_obstacle_with(obstacle, leader);
        }
    }
}
