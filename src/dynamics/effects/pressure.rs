//! Pressure on the faces of cells that border on nothing or on a cut: a load that follows them as they move and turn.
//!
//! A face is the quad between a cell and an empty place beside it. With its corners at `x_1 .. x_4`, counter-clockwise as seen
//! from outside, it is the bilinear patch `x(s, t)` over `-1..1` squared, and a pressure `p` pushes corner `c` with
//!
//! ```text
//! f_c = -p int N_c  dx/ds x dx/dt  ds dt  =  -p (a x b  +  s_c / 3  a x d  +  t_c / 3  d x b)
//! a = (-x_1 + x_2 + x_3 - x_4) / 4     b = (-x_1 - x_2 + x_3 + x_4) / 4     d = (x_1 - x_2 + x_3 - x_4) / 4
//! ```
//!
//! with `(s_c, t_c) = (-1, -1), (1, -1), (1, 1), (-1, 1)`: a quarter each while the face is a parallelogram, and in sum always the
//! area vector times `p`. These are `p` times the derivatives of the volume that the patches enclose, so on a closed surface the
//! forces and their moments cancel to rounding however it is bent, and the work done is `p` times the volume gained.
//!
//! A face is chosen by where its middle is at rest, or because it looks at a cell that a given cut went through: those are the
//! lips of the cut. A face lets go for good when a spring between two of its corners is severed: they belong to pieces that
//! part.
//!
//! Only the surface is worked through, in f64. A follower load changes the stiffness of a corner by about `p h`, against some
//! `10 E h` of its springs: no step is shortened for it.
//!
//! Source: K. Schweizerhof and E. Ramm, "Displacement dependent pressure loads in nonlinear finite element analyses" (1984).

use std::collections::BTreeSet;

use rayon::prelude::*;

use crate::dynamics::World;
use crate::dynamics::drive::{Drive, Handle, Ramp};
use crate::dynamics::rigid::Bodies;
use crate::geometry::{Point3, Vector3};
use crate::lattice::build::NO_ORGAN;
use crate::lattice::layout::BlockLayout;
use crate::lattice::neighbours::direction_of;
use crate::lattice::region::Region;
use crate::lattice::{Lattice, NO_PARTICLE, SeveredSpring, Topology};

/// Corners of the face of a cell on the low and the high side of each axis, counter-clockwise seen from outside; corners of the
/// cell x fastest.
const CORNERS: [[[usize; 4]; 2]; 3] =
    [[[0, 4, 6, 2], [1, 3, 7, 5]], [[0, 1, 5, 4], [2, 6, 7, 3]], [[0, 2, 3, 1], [4, 5, 7, 6]]];
/// Faces that one task works through.
const CHUNK: usize = 256;

/// A face of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Face {
    /// Its corners, counter-clockwise seen from outside.
    pub corners: [u32; 4],
    /// The axis it stands across, and whether it is on the cell's high side.
    side: (u8, bool),
}

impl Face {
    /// Places of the corners relative to the first, at rest, in pitches.
    fn rest(self) -> [Vector3; 4] {
        let corners = CORNERS[usize::from(self.side.0)][usize::from(self.side.1)];
        let place = |corner: usize| Vector3::from([0, 1, 2].map(|axis| (corner >> axis & 1) as f64));
        corners.map(|corner| place(corner) - place(corners[0]))
    }

    /// All six springs between its corners live.
    fn is_whole(self, topology: &Topology) -> bool {
        let rest = self.rest().map(|place| [0, 1, 2].map(|axis| place[axis] as i32));
        let lives = |a: usize, b: usize| {
            let direction = direction_of([0, 1, 2].map(|axis| rest[b][axis] - rest[a][axis]));
            topology.alive()[self.corners[a] as usize] >> direction & 1 == 1
        };
        (0..4).all(|a| (a + 1..4).all(|b| lives(a, b)))
    }
}

/// The faces of a lattice of cells that border on nothing and whose middle, at rest, lies in a region; an organ has those
/// of its own cells. In the order of the lattice. Nothing in a lattice without cells.
pub fn boundary_faces(lattice: &Lattice, region: &Region) -> Vec<Face> {
    if !lattice.has_cells() {
        return Vec::new();
    }
    let shape = lattice.grid.shape;
    let is_cell = |ijk: [usize; 3]| {
        let cell = lattice.particle_at[shape.linear(ijk)];
        cell != NO_PARTICLE && lattice.cell_organ[cell as usize] != NO_ORGAN
    };
    let (mut found, mut middles, mut organs) = (Vec::new(), Vec::new(), Vec::new());
    for cell in 0..lattice.len() as u32 {
        let Some(corners) = lattice.cell(cell) else { continue };
        let ijk = lattice.ijk(cell);
        for axis in 0..3 {
            for high in [false, true] {
                let mut beside = ijk;
                // The lattice has an empty layer around its cells.
                beside[axis] = if high { ijk[axis] + 1 } else { ijk[axis].wrapping_sub(1) };
                if beside[axis] < shape.dims()[axis] && is_cell(beside) {
                    continue;
                }
                let own = CORNERS[axis][usize::from(high)].map(|corner| corners[corner]);
                let sum: Vector3 = own.iter().map(|&corner| lattice.rest_place(corner).coords).sum();
                found.push(Face { corners: own, side: (axis as u8, high) });
                middles.push(Point3::from(sum / 4.0));
                organs.push(lattice.cell_organ[cell as usize]);
            }
        }
    }
    let chosen = region.among(&middles, &organs);
    found.into_iter().zip(chosen).filter(|&(_, chosen)| chosen).map(|(face, _)| face).collect()
}

/// The lips of a cut: the faces of whole cells that look at a cell in which one of some springs was severed. In the order of
/// the lattice. Nothing in a lattice without cells.
pub fn lip_faces(lattice: &Lattice, topology: &Topology, severed: &[SeveredSpring]) -> Vec<Face> {
    if !lattice.has_cells() {
        return Vec::new();
    }
    let shape = lattice.grid.shape;
    let cells_of = |spring: &SeveredSpring| lattice.cells_of_spring(spring.particle, usize::from(spring.direction));
    let cut: BTreeSet<u32> = severed.iter().flat_map(cells_of).collect();
    let mut found = Vec::new();
    for &cell in &cut {
        let ijk = lattice.ijk(cell);
        for axis in 0..3 {
            for high in [false, true] {
                // The cell beside it looks back.
                let mut beside = ijk;
                beside[axis] = if high { ijk[axis] + 1 } else { ijk[axis].wrapping_sub(1) };
                if beside[axis] >= shape.dims()[axis] {
                    continue;
                }
                let other = lattice.particle_at[shape.linear(beside)];
                if other == NO_PARTICLE || lattice.cell_organ[other as usize] == NO_ORGAN {
                    continue;
                }
                if let Some(corners) = topology.whole_cell(lattice, other) {
                    let own = CORNERS[axis][usize::from(!high)].map(|corner| corners[corner]);
                    found.push(Face { corners: own, side: (axis as u8, !high) });
                }
            }
        }
    }
    found
}

/// The forces of a pressure of 1 Pa on the corners of a patch [N/Pa], from their places [m].
fn unit_forces(place: [Vector3; 4]) -> [Vector3; 4] {
    let [one, two, three, four] = place;
    let a = (two - one + three - four) / 4.0;
    let b = (four - one + three - two) / 4.0;
    let d = (one - two + three - four) / 4.0;
    let (even, along_s, along_t) = (a.cross(&b), a.cross(&d) / 3.0, d.cross(&b) / 3.0);
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(s, t)| -(even + along_s * s + along_t * t))
}

/// Faces that a pressure acts on.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct PressedFaces {
    faces: Vec<Face>,
    /// [Pa]
    pub(in crate::dynamics) pressure: Ramp<f64>,
    /// Severed springs that have been looked at.
    severed: usize,
    /// Particles at the corners, ascending.
    particles: Vec<u32>,
    /// Face times 4 plus corner, particle by particle, and where each particle's begin.
    around: Vec<u32>,
    first: Vec<u32>,
    /// Forces of each face at 1 Pa [N/Pa].
    unit: Vec<[Vector3; 4]>,
}

/// What a step does with the impulse of a pressure.
pub(in crate::dynamics) struct Pushed<'a> {
    pub(in crate::dynamics) lattice: &'a Lattice,
    pub(in crate::dynamics) topology: &'a Topology,
    pub(in crate::dynamics) layout: &'a BlockLayout,
    pub(in crate::dynamics) displacement: &'a [Vec<f32>; 3],
    pub(in crate::dynamics) velocity: &'a mut [Vec<f32>; 3],
    pub(in crate::dynamics) dt_over_mass: &'a [f32],
    pub(in crate::dynamics) rigid: Option<&'a mut Bodies>,
}

impl PressedFaces {
    /// Particles at the corners, ascending.
    pub(in crate::dynamics) fn particles(&self) -> &[u32] {
        &self.particles
    }

    fn new(faces: &[Face]) -> Self {
        let mut pressed = Self {
            faces: faces.to_vec(),
            pressure: Ramp::default(),
            severed: 0,
            particles: Vec::new(),
            around: Vec::new(),
            first: Vec::new(),
            unit: Vec::new(),
        };
        pressed.index();
        pressed
    }

    /// Which corners of which faces each particle is.
    fn index(&mut self) {
        let corners = self.faces.iter().flat_map(|face| face.corners);
        let mut all: Vec<(u32, u32)> = corners.zip(0..).collect();
        all.sort_unstable();
        self.around = all.iter().map(|&(_, place)| place).collect();
        self.particles = all.iter().map(|&(particle, _)| particle).collect();
        self.particles.dedup();
        let begin = |particle: &u32| all.partition_point(|(other, _)| other < particle) as u32;
        self.first = self.particles.iter().map(begin).chain([all.len() as u32]).collect();
        self.unit = vec![[Vector3::zeros(); 4]; self.faces.len()];
    }

    /// Gives every corner its impulse of one step; reports the slots of free particles it moved.
    pub(in crate::dynamics) fn push(
        &mut self,
        dt: f64,
        world: Pushed<'_>,
        mut moved: impl FnMut(usize, &[Vec<f32>; 3]),
    ) {
        let Pushed { lattice, topology, layout, displacement, velocity, dt_over_mass, mut rigid } = world;
        let slot = |particle: u32| layout.slot[particle as usize] as usize;
        let place = |particle: u32| {
            let slot = slot(particle);
            Vector3::from([0, 1, 2].map(|axis| f64::from(displacement[axis][slot])))
        };
        let pressure = self.pressure.start;
        self.each(lattice, topology, place, |particle, sum| {
            let (impulse, slot) = (sum * (pressure * dt), slot(particle));
            if let Some(rigid) = &mut rigid
                && let Some(body) = rigid.of_slot(slot as u32)
            {
                rigid.push(body, impulse, lattice, particle);
                return;
            }
            if dt_over_mass[slot] > 0.0 {
                let kick = impulse * (f64::from(dt_over_mass[slot]) / dt);
                for axis in 0..3 {
                    velocity[axis][slot] += kick[axis] as f32;
                }
                moved(slot, velocity);
            }
        });
    }

    /// Calls back with the force of 1 Pa on every corner [N/Pa]; not at all while the pressure is 0.
    ///
    /// - `place`: displacement of a particle [m].
    pub(in crate::dynamics) fn each(
        &mut self,
        lattice: &Lattice,
        topology: &Topology,
        place: impl Fn(u32) -> Vector3 + Sync,
        mut push: impl FnMut(u32, Vector3),
    ) {
        if topology.severed().len() > self.severed {
            self.severed = topology.severed().len();
            let before = self.faces.len();
            self.faces.retain(|face| face.is_whole(topology));
            if self.faces.len() < before {
                self.index();
            }
        }
        if self.pressure == Ramp::default() {
            return;
        }
        self.unit.par_iter_mut().zip(&self.faces).with_min_len(CHUNK).for_each(|(unit, face)| {
            let rest = face.rest();
            *unit = unit_forces(std::array::from_fn(|c| rest[c] * lattice.pitch + place(face.corners[c])));
        });
        for (index, &particle) in self.particles.iter().enumerate() {
            let own = &self.around[self.first[index] as usize..self.first[index + 1] as usize];
            let sum: Vector3 = own.iter().map(|&place| self.unit[place as usize / 4][place as usize % 4]).sum();
            push(particle, sum);
        }
    }
}

impl World {
    /// Lets a pressure act on faces (see [`boundary_faces`], [`lip_faces`]), inwards where it is positive; 0 until [`World::set_pressure`]. What is held
    /// or grabbed does not feel it; a rigid body does, torque included.
    pub fn press(&mut self, faces: &[Face]) -> Handle {
        self.add(Drive::Pressure(Box::new(PressedFaces::new(faces))))
    }

    /// Lets a pressure act on other faces from the next step on.
    ///
    /// # Panics
    /// If the handle is not a pressure's.
    pub fn press_instead(&mut self, handle: Handle, faces: &[Face]) {
        match &mut self.drives[handle.0] {
            Drive::Pressure(pressed) => {
                **pressed = PressedFaces { pressure: pressed.pressure, ..PressedFaces::new(faces) };
            }
            other => panic!("{handle:?} is {other:?}, not a pressure"),
        }
    }

    /// Changes a pressure from the next step on [Pa].
    ///
    /// # Panics
    /// If the handle is not a pressure's.
    pub fn set_pressure(&mut self, handle: Handle, pressure: f64) {
        self.set_pressure_over_step(handle, [pressure; 2]);
    }

    /// The same for a pressure that goes evenly from one to the other in the course of a step, which is to be told before every
    /// step while it does. The plain step feels the first throughout, implicit methods the last.
    ///
    /// # Panics
    /// If the handle is not a pressure's.
    pub fn set_pressure_over_step(&mut self, handle: Handle, [start, end]: [f64; 2]) {
        match &mut self.drives[handle.0] {
            Drive::Pressure(faces) => faces.pressure = Ramp { start, end },
            other => panic!("{handle:?} is {other:?}, not a pressure"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Derivatives of the volume under a patch, of the closed surface of a bent cube.
    #[test]
    fn a_closed_surface_has_the_gradient_of_its_volume() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        let mut corner: [Vector3; 8] = std::array::from_fn(|c| {
            Vector3::from([0, 1, 2].map(|axis| (c >> axis & 1) as f64 + 0.6 * random())) + Vector3::repeat(3.0)
        });
        let faces: Vec<[usize; 4]> = CORNERS.into_iter().flatten().collect();
        let volume = |corner: &[Vector3; 8]| -> f64 {
            let triple = |a: usize, b: usize, c: usize| corner[a].dot(&corner[b].cross(&corner[c]));
            let of_face =
                |&[a, b, c, d]: &[usize; 4]| triple(a, b, c) + triple(a, c, d) + triple(a, b, d) + triple(b, c, d);
            faces.iter().map(of_face).sum::<f64>() / 12.0
        };
        let mut force = [Vector3::zeros(); 8];
        for face in &faces {
            for (unit, &c) in unit_forces(face.map(|c| corner[c])).iter().zip(face) {
                force[c] += unit;
            }
        }
        let sum: Vector3 = force.iter().sum();
        let torque: Vector3 = force.iter().zip(&corner).map(|(force, place)| place.cross(force)).sum();
        assert!(sum.norm() < 1e-14 && torque.norm() < 1e-13, "{sum} {torque}");
        for c in 0..8 {
            for axis in 0..3 {
                let start = corner[c][axis];
                let mut at = |offset: f64| {
                    corner[c][axis] = start + offset;
                    volume(&corner)
                };
                let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
                corner[c][axis] = start;
                // Linear in each coordinate of a corner.
                assert!((force[c][axis] + slope).abs() < 1e-11, "{} {slope}", force[c][axis]);
            }
        }
    }
}
