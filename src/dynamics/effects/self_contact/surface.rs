//! The surface of soft tissue: its particles, their normals at rest and now, and how far beyond them it lies.

use std::collections::{BTreeSet, HashMap};

use rayon::prelude::*;

use crate::geometry::{Matrix3, Vector3};
use crate::lattice::layout::BlockLayout;
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS, direction_of, family, opposite};
use crate::lattice::{FRINGE, Lattice, Topology};
use crate::material::{Assembly, RigidKind};

/// The sum of the directions a particle lacks is at least so long, else it has no outside: a flat face has 9, an edge of a cube
/// 8.5, a corner 6.9, a single lost spring 1.
const LEAST_SUM: f64 = 2.5;
/// Neighbours whose own normals lie within this cosine of a particle's count for its normal: the steps of an oblique surface do, the
/// sides of an edge do not.
const ALIKE: f64 = 0.8;
/// Lacking neighbours within this cosine of the normal tell how far the surface is.
const AHEAD: f64 = 0.5;
/// Keeps the moments of neighbours that lie in a plane or line invertible; relative to their sum.
const REGULAR: f64 = 1e-6;

/// A surface particle. Lengths are in pitches.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Member {
    pub(super) particle: u32,
    pub(super) slot: u32,
    /// Its grid point.
    pub(super) ijk: [i32; 3],
    /// Outward unit vector at rest.
    pub(super) normal: Vector3,
    /// From it to the surface along the normal.
    pub(super) thickness: f64,
    /// Inverse of the second moments of the neighbours it is joined to.
    inverse: Matrix3,
}

impl Member {
    /// Place at rest [pitches].
    pub(super) fn rest(&self) -> Vector3 {
        Vector3::from(self.ijk.map(f64::from))
    }
}

/// All surface particles of the organs that may touch, ascending.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    members: Vec<Member>,
    /// Whether a particle may touch.
    takes_part: Vec<bool>,
    /// Of a particle its severed springs and where they were, 0 at itself and 1 at the other end.
    severed: HashMap<u32, Vec<(u8, f32)>>,
    /// How many severed springs are known.
    known: usize,
}

impl Surface {
    pub(super) fn new(
        lattice: &Lattice,
        topology: &Topology,
        layout: &BlockLayout,
        assembly: &Assembly,
        organs: &[usize],
    ) -> Self {
        let kind = assembly.rigid.as_ref().map(|parts| parts.kind());
        let chosen = |particle: u32| organs.contains(&usize::from(lattice.organ[particle as usize]));
        let takes_part = |particle: u32| {
            let soft = kind.is_none_or(|kind| kind[particle as usize] == RigidKind::Soft);
            let own = || {
                if lattice.organ[particle as usize] != FRINGE {
                    return chosen(particle);
                }
                let springs = lattice.springs[particle as usize];
                joined(lattice, springs, particle).any(|(_, other)| chosen(other))
            };
            soft && assembly.mass[particle as usize] > 0.0 && own()
        };
        let takes_part = (0..lattice.len() as u32).into_par_iter().map(takes_part).collect();
        let mut surface = Self { members: Vec::new(), takes_part, severed: HashMap::new(), known: 0 };
        surface.note_severed(lattice, topology);
        let all = (0..lattice.len() as u32).into_par_iter();
        surface.members = all.filter_map(|particle| surface.member(lattice, topology, layout, particle)).collect();
        surface
    }

    pub(super) fn len(&self) -> usize {
        self.members.len()
    }

    pub(super) fn members(&self) -> &[Member] {
        &self.members
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Member>() * self.members.len()
            + self.takes_part.len()
            + self.severed.values().map(|list| 32 + 8 * list.len()).sum::<usize>()
    }

    /// Brings the surface up to date with what was severed; false when nothing was.
    pub(super) fn follow(&mut self, lattice: &Lattice, topology: &Topology, layout: &BlockLayout) -> bool {
        let ends = self.note_severed(lattice, topology);
        if ends.is_empty() {
            return false;
        }
        // A normal takes in those of the neighbours.
        let mut changed = ends.clone();
        changed.extend(
            ends.iter().flat_map(|&end| (0..NEIGHBOURS).filter_map(move |direction| lattice.neighbour(end, direction))),
        );
        let changed: Vec<u32> = changed.into_iter().collect();
        let found: Vec<Member> =
            changed.par_iter().filter_map(|&particle| self.member(lattice, topology, layout, particle)).collect();
        let kept = std::mem::take(&mut self.members);
        let mut merged: Vec<Member> =
            kept.into_iter().filter(|member| changed.binary_search(&member.particle).is_err()).chain(found).collect();
        merged.sort_by_key(|member| member.particle);
        self.members = merged;
        true
    }

    /// Takes note of newly severed springs; their ends.
    fn note_severed(&mut self, lattice: &Lattice, topology: &Topology) -> BTreeSet<u32> {
        let mut ends = BTreeSet::new();
        for spring in &topology.severed()[self.known..] {
            let direction = usize::from(spring.direction);
            let far = lattice.neighbour(spring.particle, direction).expect("a severed spring had two ends");
            self.severed.entry(spring.particle).or_default().push((spring.direction, spring.at));
            self.severed.entry(far).or_default().push((opposite(direction) as u8, 1.0 - spring.at));
            ends.extend([spring.particle, far]);
        }
        self.known = topology.severed().len();
        ends
    }

    /// The surface particle that a particle is, if it is one.
    fn member(&self, lattice: &Lattice, topology: &Topology, layout: &BlockLayout, particle: u32) -> Option<Member> {
        if !self.takes_part[particle as usize] {
            return None;
        }
        let alive = topology.alive()[particle as usize];
        let own = outward(alive)?;
        let mut sum = own;
        for (_, other) in joined(lattice, alive, particle) {
            if let Some(normal) = outward(topology.alive()[other as usize])
                && normal.dot(&own) > ALIKE
            {
                sum += normal;
            }
        }
        let normal = sum.normalize();
        let mut moments = Matrix3::zeros();
        for direction in directions(alive) {
            moments += offset(direction) * offset(direction).transpose();
        }
        moments += Matrix3::identity() * (REGULAR * moments.trace()).max(REGULAR);
        Some(Member {
            particle,
            slot: layout.slot[particle as usize],
            ijk: lattice.ijk(particle).map(|index| index as i32),
            normal,
            thickness: self.thickness(lattice, alive, particle, normal),
            inverse: moments.try_inverse()?,
        })
    }

    /// How far the surface lies beyond a particle: the nearest way to it that its lacking springs tell [pitches].
    fn thickness(&self, lattice: &Lattice, alive: u32, particle: u32, normal: Vector3) -> f64 {
        let severed = self.severed.get(&particle).map_or(&[][..], Vec::as_slice);
        let border = if lattice.has_cells() { 0.0 } else { 0.5 };
        let ahead = |direction: usize| offset(direction).dot(&normal);
        let faces = directions(!alive).filter(|&direction| family(direction) == 1);
        let at_border = faces.filter(|&direction| lattice.springs[particle as usize] >> direction & 1 == 0);
        let at_border = at_border.map(|direction| (direction, border));
        let cut = severed.iter().map(|&(direction, at)| (usize::from(direction), f64::from(at)));
        let near = at_border
            .chain(cut)
            .filter(|&(direction, _)| ahead(direction) > AHEAD * offset(direction).norm())
            .map(|(direction, at)| at * ahead(direction))
            .fold(f64::INFINITY, f64::min);
        if near.is_finite() { near.clamp(0.0, 1.0) } else { border }
    }

    /// The outward unit normal of a member now; zero where the tissue around it is crushed flat.
    ///
    /// - `displacement`: of each slot [m].
    pub(super) fn normal_now(
        &self,
        member: &Member,
        (lattice, topology, layout): (&Lattice, &Topology, &BlockLayout),
        displacement: &[Vec<f32>; 3],
    ) -> Vector3 {
        let moved = |slot: usize| Vector3::from([0, 1, 2].map(|axis| f64::from(displacement[axis][slot])));
        let own = moved(member.slot as usize);
        let mut products = Matrix3::zeros();
        for (direction, other) in joined(lattice, topology.alive()[member.particle as usize], member.particle) {
            products += (moved(layout.slot[other as usize] as usize) - own) * offset(direction).transpose();
        }
        let deformation = Matrix3::identity() + products * member.inverse / lattice.pitch;
        let [x, y, z] = [0, 1, 2].map(|axis| deformation.column(axis).into_owned());
        let turned = y.cross(&z) * member.normal.x + z.cross(&x) * member.normal.y + x.cross(&y) * member.normal.z;
        let length = turned.norm();
        if length > 1e-3 { turned / length } else { Vector3::zeros() }
    }

    /// Whether a living spring joins two particles, or two over a particle between.
    pub(super) fn are_joined(lattice: &Lattice, topology: &Topology, a: &Member, b: &Member) -> bool {
        let way = [0, 1, 2].map(|axis| b.ijk[axis] - a.ijk[axis]);
        let reach = |way: [i32; 3]| way.iter().map(|part| part.abs()).max().unwrap_or(0);
        if reach(way) > 2 {
            return false;
        }
        let alive = topology.alive()[a.particle as usize];
        if reach(way) == 1 && alive >> direction_of(way) & 1 == 1 {
            return true;
        }
        joined(lattice, alive, a.particle).any(|(direction, between)| {
            let rest = [0, 1, 2].map(|axis| way[axis] - OFFSETS[direction][axis]);
            reach(rest) == 1 && topology.alive()[between as usize] >> direction_of(rest) & 1 == 1
        })
    }
}

/// The direction out of the tissue at a particle with these living springs; `None` where it is not on the surface, or has no side.
fn outward(alive: u32) -> Option<Vector3> {
    let lacks_face = directions(!alive).any(|direction| family(direction) == 1);
    let sum: Vector3 = directions(!alive).map(offset).sum();
    let length = sum.norm();
    (lacks_face && length >= LEAST_SUM).then(|| sum / length)
}

/// Directions of the bits that are set.
fn directions(bits: u32) -> impl Iterator<Item = usize> {
    (0..NEIGHBOURS).filter(move |direction| bits >> direction & 1 == 1)
}

/// [pitches]
fn offset(direction: usize) -> Vector3 {
    Vector3::from(OFFSETS[direction].map(f64::from))
}

/// Springs among the given bits of a particle: direction and other end.
fn joined(lattice: &Lattice, alive: u32, particle: u32) -> impl Iterator<Item = (usize, u32)> {
    directions(alive).filter_map(move |direction| Some((direction, lattice.neighbour(particle, direction)?)))
}
