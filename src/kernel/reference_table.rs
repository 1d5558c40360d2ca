//! Living springs and whole cells with their constants, looked up once for many steps of the oracle: finding them costs many
//! times what their forces do, and they only change when a spring is severed.

use super::reference::{cofactor, mean_gradient, shape_gradient};
use crate::geometry::{Matrix3, Vector3};
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS};
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;

/// The living springs of a lattice.
#[derive(Debug, Clone)]
pub struct LivingSprings {
    /// Along a spring of each direction at rest [m], and its length [m].
    rest: [(Vector3, f64); NEIGHBOURS],
    damped: bool,
    /// Where those of each particle begin, and where the last end. Shape `[particles + 1]`.
    first: Vec<usize>,
    springs: Vec<Spring>,
}

/// One of a particle's springs.
#[derive(Debug, Clone, Copy)]
struct Spring {
    other: u32,
    direction: u8,
    /// [N/m]
    stiffness: f64,
    /// [N s/m]; 0 without dampers.
    damping: f64,
}

impl LivingSprings {
    /// Those that are alive now.
    ///
    /// # Panics
    /// Never: a living spring has two ends.
    pub fn new(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> Self {
        let rest = OFFSETS.map(|offset| {
            let rest = Vector3::from(offset.map(f64::from)) * lattice.pitch;
            (rest, rest.norm())
        });
        let (mut first, mut springs) = (vec![0], Vec::new());
        for particle in 0..lattice.len() as u32 {
            let alive = topology.alive()[particle as usize];
            for direction in (0..NEIGHBOURS).filter(|d| alive >> d & 1 == 1) {
                springs.push(Spring {
                    other: lattice.neighbour(particle, direction).expect("a living spring has two ends"),
                    direction: direction as u8,
                    stiffness: assembly.stiffness.of(lattice, particle, direction),
                    damping: assembly.damping.as_ref().map_or(0.0, |all| all.of(lattice, particle, direction)),
                });
            }
            first.push(springs.len());
        }
        Self { rest, damped: assembly.damping.is_some(), first, springs }
    }

    /// Directions and other ends of a particle's springs, by direction.
    pub fn of(&self, particle: u32) -> impl Iterator<Item = (usize, u32)> + '_ {
        self.around(particle as usize).iter().map(|spring| (usize::from(spring.direction), spring.other))
    }

    fn around(&self, particle: usize) -> &[Spring] {
        &self.springs[self.first[particle]..self.first[particle + 1]]
    }

    /// See [`super::reference::spring_forces`].
    pub fn forces(&self, displacement: &[Vector3], velocity: &[Vector3], dt: f64) -> Vec<Vector3> {
        let mut forces = vec![Vector3::zeros(); displacement.len()];
        for (i, sum) in forces.iter_mut().enumerate() {
            for &Spring { other, direction, stiffness, damping } in self.around(i) {
                let (j, (rest, rest_length)) = (other as usize, self.rest[usize::from(direction)]);
                let d = rest + displacement[j] - displacement[i];
                let length = d.norm();
                if length == 0.0 {
                    continue;
                }
                let mut tension = stiffness * (length - rest_length);
                if self.damped {
                    let earlier = (d - dt * (velocity[j] - velocity[i])).norm();
                    tension += damping * (length - earlier) / dt;
                }
                *sum += tension * d / length;
            }
        }
        forces
    }
}

/// The whole cells of a lattice that have a volume term.
#[derive(Debug, Clone)]
pub struct VolumeCells {
    /// [m]
    pitch: f64,
    cells: Vec<VolumeCell>,
}

#[derive(Debug, Clone, Copy)]
struct VolumeCell {
    /// x fastest.
    corners: [u32; 8],
    /// [Pa]
    modulus: f64,
    /// [Pa s]; `None` without dampers.
    viscosity: Option<f64>,
}

impl VolumeCells {
    /// Those that are whole now.
    pub fn new(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> Self {
        let Some(term) = &assembly.volume else { return Self { pitch: lattice.pitch, cells: Vec::new() } };
        let cell = |cell: u32| {
            let modulus = f64::from(term.modulus[cell as usize]);
            let corners = topology.whole_cell(lattice, cell).filter(|_| modulus != 0.0)?;
            let viscosity = term.viscosity.as_ref().map(|viscosity| f64::from(viscosity[cell as usize]));
            Some(VolumeCell { corners, modulus, viscosity })
        };
        Self { pitch: lattice.pitch, cells: (0..lattice.len() as u32).filter_map(cell).collect() }
    }

    /// See [`super::reference::volume_forces`].
    pub fn forces(&self, displacement: &[Vector3], velocity: &[Vector3], dt: f64) -> Vec<Vector3> {
        let mut force = vec![Vector3::zeros(); displacement.len()];
        let h = self.pitch;
        for &VolumeCell { corners, modulus, viscosity } in &self.cells {
            let now = Matrix3::identity() + mean_gradient(h, |c| displacement[corners[c] as usize]);
            let change = now.determinant() - 1.0;
            let mut pressure = modulus * change;
            if modulus < 0.0 {
                pressure /= (1.0 + change * change).powi(2);
            }
            if let Some(viscosity) = viscosity {
                let earlier = now - dt * mean_gradient(h, |c| velocity[corners[c] as usize]);
                pressure += viscosity * (now.determinant() - earlier.determinant()) / dt;
            }
            let stress = pressure * h.powi(3) * cofactor(&now);
            for (c, &corner) in corners.iter().enumerate() {
                force[corner as usize] -= stress * shape_gradient(h, c);
            }
        }
        force
    }
}
