//! Lattices with bone in them.

use yawara::dynamics::{RigidBody, World};
use yawara::geometry::Vector3;
use yawara::lattice::Lattice;
use yawara::lattice::build::OrganMap;
use yawara::lattice::cells::build_cells;
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{CellValues, TissueBody, assemble_varied};
use yawara::material::{Assembly, RigidKind, RigidParts};

use crate::support::*;

/// Density of bone [kg/m^3].
pub(crate) const BONE: f64 = 1900.0;

/// Makes the particles of some organs of a lattice of voxels rigid: free ones of bone, or anchored.
pub(crate) fn with_bone(
    (lattice, mut assembly): (Lattice, Assembly),
    kind: impl Fn(u8) -> RigidKind,
) -> (Lattice, Assembly) {
    let kinds: Vec<RigidKind> = lattice.organ.iter().map(|&organ| kind(organ)).collect();
    for (mass, kind) in assembly.mass.iter_mut().zip(&kinds) {
        match kind {
            RigidKind::Soft => {}
            RigidKind::Anchored => *mass = 0.0,
            RigidKind::Free => *mass = (BONE * lattice.pitch.powi(3)) as f32,
        }
    }
    assembly.rigid = RigidParts::new(kinds);
    (lattice, assembly)
}

/// Organ 0 is soft, organ 1 free bone, organ 2 anchored bone.
pub(crate) fn usual(organ: u8) -> RigidKind {
    [RigidKind::Soft, RigidKind::Free, RigidKind::Anchored][usize::from(organ)]
}

pub(crate) fn paper_bone(map: &OrganMap, soft: PaperBody) -> (Lattice, Assembly) {
    with_bone(paper_lattice(map, &[Some(soft), None, None]), usual)
}

pub(crate) fn tissue_bone(map: &OrganMap, soft: TissueBody) -> (Lattice, Assembly) {
    tissue_with_bone_of(BONE, map, soft)
}

/// The same with bone of another density [kg/m^3].
pub(crate) fn tissue_with_bone_of(density: f64, map: &OrganMap, soft: TissueBody) -> (Lattice, Assembly) {
    let lattice = build_cells(map, None).unwrap();
    let uniform = |_| CellValues::default();
    let assembly = assemble_varied(&lattice, &[Some(soft), None, None], &[None, Some(density), None], uniform);
    (lattice, assembly)
}

/// A block of bone and nothing else, stepped by `dt`.
pub(crate) fn bone(dims: [usize; 3], dt: f64) -> World {
    let (lattice, assembly) = paper_bone(&organ_map(dims, |_| 1), PAPER);
    World::new(lattice, assembly, dt)
}

/// Soft tissue with a tilted bar of bone through its middle, both ends inside.
pub(crate) fn bar_in_tissue() -> OrganMap {
    organ_map([14, 9, 9], |[i, j, k]| {
        u8::from((3..11).contains(&i) && (i / 3 + 1..i / 3 + 4).contains(&j) && (3..6).contains(&k))
    })
}

/// The largest change of any distance between a body's particles [m], by pairs with its first, middle and last.
pub(crate) fn distortion(world: &World, body: &RigidBody) -> f64 {
    let (rest, now) = (rest_places(world), places(world));
    let particles = body.particles();
    let ends = [particles[0], particles[particles.len() / 2], particles[particles.len() - 1]];
    let change = |a: u32, b: u32| {
        let (a, b) = (a as usize, b as usize);
        ((now[a] - now[b]).norm() - (rest[a] - rest[b]).norm()).abs()
    };
    particles.iter().flat_map(|&p| ends.map(|end| change(p, end))).fold(0.0, f64::max)
}

/// Largest component of a vector relative to a scale.
pub(crate) fn relative(difference: Vector3, scale: f64) -> f64 {
    difference.norm() / scale
}
