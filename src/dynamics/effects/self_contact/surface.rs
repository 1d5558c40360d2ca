//! The surface of soft tissue: its particles, their normals at rest and now, and how far beyond them it lies.

use std::collections::{BTreeSet, HashMap};
use std::sync::LazyLock;

use arrayvec::ArrayVec;
use rayon::prelude::*;

use crate::geometry::{Matrix3, Vector3};
use crate::lattice::layout::BlockLayout;
use crate::lattice::neighbours::{ALL_ALIVE, NEIGHBOURS, OFFSETS, direction_of, family, opposite};
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
/// How much normals around a particle agree with its own, as the mean cosine, at an edge (0.80 at that of a cube) and where all may
/// count as one side (0.90 beside that edge).
const AGREEMENT: [f64; 2] = [0.8, 0.88];
/// Neighbours that lack no more springs than this lie on a flat side and not at its edge: on a flat side it is 9, at an edge 15.
const FLAT: u32 = 10;
/// Sides that meet at an edge look the way of its own normal at least by this cosine.
const MEETS: f64 = 0.3;
/// Most sides that meet at a corner.
const SIDES: usize = 3;
/// The say of an edge or corner in a common normal: on one that meets a flat side, the side decides.
const LEAST_SAY: f64 = 0.01;
/// Keeps the moments of neighbours that lie in a plane or line invertible; relative to their sum.
const REGULAR: f64 = 1e-6;

/// A surface particle, as seen from one side: at an edge, a corner and the rim of a cut there are several of the same particle. Lengths
/// are in pitches.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Member {
    pub(super) particle: u32,
    pub(super) slot: u32,
    /// Its grid point.
    pub(super) ijk: [i32; 3],
    /// Outward unit vector at rest.
    pub(super) normal: Vector3,
    /// Its say in a common normal, 0 to 1.
    pub(super) say: f64,
    /// From it to the surface along the normal.
    pub(super) thickness: f64,
    /// Directions of the neighbours that turn its normal: those on the same side, which lie along the surface.
    around: u32,
    /// Inverse of their second moments.
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
        let of = |particle| surface.members_of((lattice, topology, layout), particle);
        surface.members = all.flat_map_iter(of).collect();
        surface
    }

    /// How many particles there are.
    pub(super) fn particles(&self) -> usize {
        self.members.chunk_by(|a, b| a.particle == b.particle).count()
    }

    /// The first member that is the same particle.
    pub(super) fn first_of_particle(&self, member: usize) -> usize {
        let particle = self.members[member].particle;
        let before = self.members[..member].iter().rev();
        member - before.take_while(|other| other.particle == particle).count()
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
        let of = |&particle: &u32| self.members_of((lattice, topology, layout), particle);
        let found: Vec<Member> = changed.par_iter().flat_map_iter(of).collect();
        let kept = std::mem::take(&mut self.members);
        let mut merged: Vec<Member> =
            kept.into_iter().filter(|member| changed.binary_search(&member.particle).is_err()).chain(found).collect();
        // Those of one particle stay in their order.
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

    /// The surface particles that a particle is: none, one, or one for each side that meets there.
    fn members_of(
        &self,
        (lattice, topology, layout): (&Lattice, &Topology, &BlockLayout),
        particle: u32,
    ) -> ArrayVec<Member, { 2 * SIDES }> {
        let mut found = ArrayVec::new();
        if !self.takes_part[particle as usize] {
            return found;
        }
        let member = |side: Side, (normal, say): (Vector3, f64)| {
            let around = along_surface(lattice, topology, particle, side, normal);
            let mut moments = Matrix3::zeros();
            for direction in directions(around) {
                moments += offset(direction) * offset(direction).transpose();
            }
            moments += Matrix3::identity() * (REGULAR * moments.trace()).max(REGULAR);
            Some(Member {
                particle,
                slot: layout.slot[particle as usize],
                ijk: lattice.ijk(particle).map(|index| index as i32),
                normal,
                say,
                thickness: self.thickness(lattice, lacking(lattice, topology, particle, side), particle, normal),
                around,
                inverse: moments.try_inverse()?,
            })
        };
        for side in [Side::Border, Side::Cut, Side::Both] {
            if side != Side::Both || found.is_empty() {
                let normals = normals(lattice, topology, particle, side);
                found.extend(normals.into_iter().filter_map(|normal| member(side, normal)));
            }
        }
        found
    }

    /// How far the surface lies beyond a particle along its normal: the mean of what its lacking springs tell [pitches].
    fn thickness(&self, lattice: &Lattice, lacking: u32, particle: u32, normal: Vector3) -> f64 {
        let severed = self.severed.get(&particle).map_or(&[][..], Vec::as_slice);
        let border = if lattice.has_cells() { 0.0 } else { 0.5 };
        let ahead = |direction: usize| offset(direction).dot(&normal);
        let faces = directions(lacking).filter(|&direction| family(direction) == 1);
        let at_border = faces.filter(|&direction| lattice.springs[particle as usize] >> direction & 1 == 0);
        let at_border = at_border.map(|direction| (direction, border));
        let cut = severed.iter().map(|&(direction, at)| (usize::from(direction), f64::from(at)));
        let cut = cut.filter(|&(direction, _)| lacking >> direction & 1 == 1);
        let (mut sum, mut count) = (0.0, 0.0);
        for (direction, at) in at_border.chain(cut) {
            if ahead(direction) > AHEAD * offset(direction).norm() {
                sum += at * ahead(direction);
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { border }
    }

    /// The outward unit normal of a member now; zero where the tissue around it is crushed flat.
    ///
    /// - `displacement`: of each slot [m].
    pub(super) fn normal_now(
        &self,
        member: &Member,
        (lattice, layout): (&Lattice, &BlockLayout),
        displacement: &[Vec<f32>; 3],
    ) -> Vector3 {
        let moved = |slot: usize| Vector3::from([0, 1, 2].map(|axis| f64::from(displacement[axis][slot])));
        let own = moved(member.slot as usize);
        let mut products = Matrix3::zeros();
        for (direction, other) in joined(lattice, member.around, member.particle) {
            products += (moved(layout.slot[other as usize] as usize) - own) * offset(direction).transpose();
        }
        let deformation = Matrix3::identity() + products * member.inverse / lattice.pitch;
        let [x, y, z] = [0, 1, 2].map(|axis| deformation.column(axis).into_owned());
        let turned = y.cross(&z) * member.normal.x + z.cross(&x) * member.normal.y + x.cross(&y) * member.normal.z;
        let length = turned.norm();
        if length > 1e-3 { turned / length } else { Vector3::zeros() }
    }

    /// Whether a living spring joins two particles, or two over a particle between.
    pub(super) fn are_joined(topology: &Topology, a: &Member, b: &Member) -> bool {
        if a.particle == b.particle {
            return true;
        }
        let way = [0, 1, 2].map(|axis| b.ijk[axis] - a.ijk[axis]);
        if farthest(way) > 2 {
            return false;
        }
        let [from, to] = [a, b].map(|end| topology.alive()[end.particle as usize]);
        if farthest(way) == 1 && from >> direction_of(way) & 1 == 1 {
            return true;
        }
        let Between { directions: between, back } = &BETWEEN[place_of(way)];
        directions(from & between).any(|direction| to >> back[direction] & 1 == 1)
    }
}

/// The particles that neighbour both a particle and another, at most two steps away.
struct Between {
    /// In which directions they lie, a bit each.
    directions: u32,
    /// And in which from the other, by these directions.
    back: [u8; NEIGHBOURS],
}

/// By [`place_of`] the way to the other. Each end of a spring knows whether it lives, so that the particle between need not be found.
static BETWEEN: LazyLock<Vec<Between>> = LazyLock::new(|| {
    let along = || -2..=2_i32;
    let ways = along().flat_map(|z| along().flat_map(move |y| along().map(move |x| [x, y, z])));
    let of = |way: [i32; 3]| {
        let mut between = Between { directions: 0, back: [0; NEIGHBOURS] };
        for (direction, offset) in OFFSETS.iter().enumerate() {
            let back = [0, 1, 2].map(|axis| offset[axis] - way[axis]);
            if farthest(back) == 1 {
                between.directions |= 1 << direction;
                between.back[direction] = direction_of(back) as u8;
            }
        }
        between
    };
    ways.map(of).collect()
});

fn place_of([x, y, z]: [i32; 3]) -> usize {
    (((z + 2) * 5 + y + 2) * 5 + x + 2) as usize
}

/// Steps along the axis that takes most.
fn farthest(way: [i32; 3]) -> i32 {
    way.iter().map(|part| part.abs()).max().unwrap_or(0)
}

/// Which lacking springs make a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    /// Those that never were.
    Border,
    /// Those that were severed.
    Cut,
    /// All of them, where neither alone makes one.
    Both,
}

/// The springs that a particle lacks on a side.
fn lacking(lattice: &Lattice, topology: &Topology, particle: u32, side: Side) -> u32 {
    let (rest, alive) = (lattice.springs[particle as usize], topology.alive()[particle as usize]);
    let bits = match side {
        Side::Border => !rest,
        Side::Cut => rest & !alive,
        Side::Both => !alive,
    };
    bits & ALL_ALIVE
}

/// The outward unit normals of a particle on a side, each with its say in a common normal: where all around it is much alike one,
/// smoothed; at an edge or corner those of the flat sides that meet there, or where there are none its own.
fn normals(lattice: &Lattice, topology: &Topology, particle: u32, side: Side) -> ArrayVec<(Vector3, f64), SIDES> {
    let mut found = ArrayVec::new();
    let Some(own) = outward(lacking(lattice, topology, particle, side)) else { return found };
    let (mut sum, mut agreement, mut count) = (own, 1.0, 1.0);
    let mut sides = ArrayVec::<Vector3, SIDES>::new();
    for (_, other) in joined(lattice, topology.alive()[particle as usize], particle) {
        let lacking = lacking(lattice, topology, other, side);
        let Some(normal) = outward(lacking) else { continue };
        let alike = normal.dot(&own);
        agreement += alike;
        count += 1.0;
        if alike > ALIKE {
            sum += normal;
        }
        if lacking.count_ones() <= FLAT && alike > MEETS {
            match sides.iter_mut().find(|side| side.normalize().dot(&normal) > ALIKE) {
                Some(side) => *side += normal,
                // A fourth side is left out.
                None => drop(sides.try_push(normal)),
            }
        }
    }
    let [edge, flat] = AGREEMENT;
    let agreement = agreement / count;
    if agreement < flat && sides.len() > 1 {
        found.extend(sides.into_iter().map(|side| (side.normalize(), 1.0)));
    } else {
        found.push((sum.normalize(), ((agreement - edge) / (flat - edge)).clamp(LEAST_SAY, 1.0)));
    }
    found
}

/// Directions of the joined neighbours on the same side that look the same way; of all joined ones where those do not span a surface.
fn along_surface(lattice: &Lattice, topology: &Topology, particle: u32, side: Side, normal: Vector3) -> u32 {
    let alive = topology.alive()[particle as usize];
    let alike = |&(_, other): &(usize, u32)| {
        outward(lacking(lattice, topology, other, side)).is_some_and(|other| other.dot(&normal) > AHEAD)
    };
    let around = joined(lattice, alive, particle).filter(alike).fold(0, |bits, (direction, _)| bits | 1 << direction);
    let spans = |a: usize, b: usize| offset(a).cross(&offset(b)).dot(&normal).abs() > 0.5;
    let spans = directions(around).any(|a| directions(around).any(|b| spans(a, b)));
    if spans { around } else { alive }
}

/// The direction to where these springs are lacking; `None` where no face neighbour is, or they lie on all sides.
fn outward(lacking: u32) -> Option<Vector3> {
    let lacks_face = directions(lacking).any(|direction| family(direction) == 1);
    let sum: Vector3 = directions(lacking).map(offset).sum();
    let length = sum.norm();
    (lacks_face && length >= LEAST_SUM).then(|| sum / length)
}

/// Directions of the bits that are set.
fn directions(bits: u32) -> impl Iterator<Item = usize> {
    let mut left = bits & ALL_ALIVE;
    std::iter::from_fn(move || {
        let next = (left != 0).then(|| left.trailing_zeros() as usize);
        left &= left.wrapping_sub(1);
        next
    })
}

/// [pitches]
fn offset(direction: usize) -> Vector3 {
    Vector3::from(OFFSETS[direction].map(f64::from))
}

/// Springs among the given bits of a particle: direction and other end.
fn joined(lattice: &Lattice, alive: u32, particle: u32) -> impl Iterator<Item = (usize, u32)> {
    directions(alive).filter_map(move |direction| Some((direction, lattice.neighbour(particle, direction)?)))
}
