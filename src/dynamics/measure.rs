//! Energy, momentum and volume of a state, in f64.

use rayon::prelude::*;

use super::world::World;
use crate::geometry::Vector3;
use crate::kernel::reference::{cell_fibre_energy, cell_volume_energy};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
use crate::lattice::{Lattice, Topology};

/// Particles whose contributions are summed before the partial sums are added in order: the same sum at any thread count.
const CHUNK: usize = 4_096;

/// Energy and momentum of the particles that have a mass and of the rigid bodies. Lattice axes, SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balance {
    /// Kinetic energy [J].
    pub kinetic: f64,
    /// Energy of the stretched springs (as far as they have not yielded, and with their Maxwell branches) and fibres and of the cells whose volume changed [J]. Below a Poisson's ratio of 1/4 the
    /// cells' share is negative.
    pub elastic: f64,
    /// Linear momentum [kg m/s].
    pub momentum: Vector3,
    /// Angular momentum about the lattice's first grid point [kg m^2/s].
    pub angular_momentum: Vector3,
}

/// Energy and momentum of a world now.
///
/// # Panics
/// Never: a living spring has two ends.
pub fn balance(world: &World) -> Balance {
    let lattice = world.lattice();
    let zero = Balance { kinetic: 0.0, elastic: 0.0, momentum: Vector3::zeros(), angular_momentum: Vector3::zeros() };
    let add = |a: Balance, b: Balance| Balance {
        kinetic: a.kinetic + b.kinetic,
        elastic: a.elastic + b.elastic,
        momentum: a.momentum + b.momentum,
        angular_momentum: a.angular_momentum + b.angular_momentum,
    };
    let of = |particle: u32| {
        let i = particle as usize;
        // A body keeps its own account: it has the spin of its voxels, and its particles' velocities are means over a step.
        let mass = if world.rigid_body_of(particle).is_some() { 0.0 } else { f64::from(world.mass()[i]) };
        let velocity = world.velocity(particle);
        let u = world.displacement(particle);
        let rest = Vector3::from(lattice.ijk(particle).map(|n| n as f64)) * lattice.pitch;
        let mut elastic = 0.0;
        for direction in (FIRST_FORWARD..NEIGHBOURS).filter(|d| world.topology().alive()[i] >> d & 1 == 1) {
            let other = lattice.neighbour(particle, direction).expect("a living spring has two ends");
            let along = Vector3::from(OFFSETS[direction].map(f64::from)) * lattice.pitch;
            let difference = world.displacement(other) - u;
            let length = (along + difference).norm();
            // l - L without cancellation: (l^2 - L^2) / (l + L).
            let stretch = difference.dot(&(2.0 * along + difference)) / (length + along.norm());
            elastic += world.spring_energy(particle, direction, stretch);
        }
        if let Some(term) = &world.assembly().volume {
            elastic += cell_volume_energy(lattice, world.topology(), term, particle, |p| world.displacement(p));
        }
        if let Some(term) = &world.assembly().fibres {
            elastic += cell_fibre_energy(lattice, world.topology(), term, particle, |p| world.displacement(p));
        }
        Balance {
            kinetic: 0.5 * mass * velocity.norm_squared(),
            elastic,
            momentum: mass * velocity,
            angular_momentum: mass * (rest + u).cross(&velocity),
        }
    };
    let numbers: Vec<u32> = (0..lattice.len() as u32).collect();
    let partial: Vec<Balance> =
        numbers.par_chunks(CHUNK).map(|chunk| chunk.iter().map(|&p| of(p)).fold(zero, add)).collect();
    let bodies = world.rigid_bodies().iter().map(|body| Balance {
        kinetic: body.kinetic_energy(),
        elastic: 0.0,
        momentum: body.momentum(),
        angular_momentum: body.centre().cross(&body.momentum()) + body.angular_momentum(),
    });
    partial.into_iter().chain(bodies).fold(zero, add)
}

/// Energy of the cells whose volume changed [J]: the share of the volume term in [`Balance::elastic`].
pub fn volume_energy(world: &World) -> f64 {
    let Some(term) = &world.assembly().volume else { return 0.0 };
    let of = |p: u32| cell_volume_energy(world.lattice(), world.topology(), term, p, |p| world.displacement(p));
    let numbers: Vec<u32> = (0..world.lattice().len() as u32).collect();
    let partial: Vec<f64> = numbers.par_chunks(CHUNK).map(|chunk| chunk.iter().map(|&p| of(p)).sum()).collect();
    partial.into_iter().sum()
}

/// Volume of the tissue in cells that no blade went through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellVolume {
    /// Sum over these cells now [m^3].
    pub now: f64,
    /// Sum over the same cells at rest [m^3].
    pub rest: f64,
    /// How many cells these are.
    pub cells: usize,
    /// How many of them are turned inside out.
    pub inverted: usize,
    /// The lowest corner of the first of those, in the order of the lattice.
    pub first_inverted: Option<u32>,
}

impl CellVolume {
    /// Change of volume relative to rest; `None` when no cell counts.
    pub fn change(&self) -> Option<f64> {
        (self.cells > 0).then(|| self.now / self.rest - 1.0)
    }
}

/// Volume of the tissue in cells whose springs are all alive.
///
/// - `displacement` [m], any orthonormal axes of the lattice's handedness: shape `[particles, 3]`, here as a function.
/// - A cell's volume is that of its trilinear image, exactly (six tetrahedra round a body diagonal differ from it by the
///   warp of the faces; the mean of both splittings of every face does not).
pub fn cell_volume(lattice: &Lattice, topology: &Topology, displacement: impl Fn(u32) -> Vector3 + Sync) -> CellVolume {
    cell_volume_of(lattice, topology, None, displacement)
}

/// The same for the cells of one organ: those made of it, or, where voxels are particles, between eight of its own.
pub fn organ_volume(
    lattice: &Lattice,
    topology: &Topology,
    organ: u8,
    displacement: impl Fn(u32) -> Vector3 + Sync,
) -> CellVolume {
    cell_volume_of(lattice, topology, Some(organ), displacement)
}

fn cell_volume_of(
    lattice: &Lattice,
    topology: &Topology,
    organ: Option<u8>,
    displacement: impl Fn(u32) -> Vector3 + Sync,
) -> CellVolume {
    let h = lattice.pitch;
    // Volume of its tissue now and at rest.
    let of = |particle: u32| -> Option<(f64, f64)> {
        let corner = topology.whole_cell(lattice, particle)?;
        let counts = match organ {
            None => true,
            Some(organ) if lattice.has_cells() => lattice.cell_organ[particle as usize] == organ,
            Some(organ) => corner.iter().all(|&p| lattice.organ[p as usize] == organ),
        };
        let fill = lattice.cell_fill.get(particle as usize).map_or(1.0, |&fill| f64::from(fill));
        if !counts {
            return None;
        }
        let place: [Vector3; 8] = std::array::from_fn(|c| {
            Vector3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64) * h + displacement(corner[c])
        });
        Some((fill * hexahedron_volume(&place), fill * h.powi(3)))
    };
    let numbers: Vec<u32> = (0..lattice.len() as u32).collect();
    let none = CellVolume { now: 0.0, rest: 0.0, cells: 0, inverted: 0, first_inverted: None };
    let partial: Vec<CellVolume> = numbers
        .par_chunks(CHUNK)
        .map(|chunk| {
            let volumes = chunk.iter().filter_map(|&particle| Some((particle, of(particle)?)));
            volumes.fold(none, |sum, (particle, (now, rest))| CellVolume {
                now: sum.now + now,
                rest: sum.rest + rest,
                cells: sum.cells + 1,
                inverted: sum.inverted + usize::from(now <= 0.0),
                first_inverted: sum.first_inverted.or((now <= 0.0).then_some(particle)),
            })
        })
        .collect();
    partial.into_iter().fold(none, |a, b| CellVolume {
        now: a.now + b.now,
        rest: a.rest + b.rest,
        cells: a.cells + b.cells,
        inverted: a.inverted + b.inverted,
        first_inverted: a.first_inverted.or(b.first_inverted),
    })
}

/// Volume of the trilinear image of the unit cube, corners x fastest.
///
/// Each face contributes the flux of `x / 3`, integrated exactly over its bilinear patch: a quarter-weighted sum of the
/// triangles of both splittings.
fn hexahedron_volume(corner: &[Vector3; 8]) -> f64 {
    // Corners of each face, counter-clockwise seen from outside.
    const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triple = |a: usize, b: usize, c: usize| corner[a].dot(&corner[b].cross(&corner[c]));
    FACES
        .iter()
        .map(|&[a, b, c, d]| (triple(a, b, c) + triple(a, c, d) + triple(a, b, d) + triple(b, c, d)) / 12.0)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(map: impl Fn(Vector3) -> Vector3) -> [Vector3; 8] {
        std::array::from_fn(|c| map(Vector3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64)))
    }

    #[test]
    fn volumes_of_hexahedra() {
        assert!((hexahedron_volume(&cube(|p| p)) - 1.0).abs() < 1e-15);
        assert!((hexahedron_volume(&cube(|p| p + Vector3::new(7.0, -3.0, 2.0))) - 1.0).abs() < 1e-12);
        assert!((hexahedron_volume(&cube(|p| Vector3::new(-p.x, p.y, 2.0 * p.z))) + 2.0).abs() < 1e-14);
        // x + a y z has Jacobian 1 everywhere although its faces warp; x (1 + a y z) integrates to 1 + a / 4.
        assert!((hexahedron_volume(&cube(|p| Vector3::new(p.x + 0.7 * p.y * p.z, p.y, p.z))) - 1.0).abs() < 1e-14);
        let bulge = cube(|p| Vector3::new(p.x * (1.0 + 0.4 * p.y * p.z), p.y, p.z));
        assert!((hexahedron_volume(&bulge) - 1.1).abs() < 1e-14);
    }
}
