//! Energy, momentum and volume of a state, in f64.

use rayon::prelude::*;

use super::world::World;
use crate::geometry::Vector3;
use crate::kernel::reference::cell_volume_energy;
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
use crate::lattice::{FRINGE, Lattice, Topology};

/// Particles whose contributions are summed before the partial sums are added in order: the same sum at any thread count.
const CHUNK: usize = 65_536;

/// Energy and momentum of the particles that have a mass. Lattice axes, SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balance {
    /// Kinetic energy [J].
    pub kinetic: f64,
    /// Energy of the stretched springs and of the cells whose volume changed [J]. Below a Poisson's ratio of 1/4 the
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
        let mass = f64::from(world.mass()[i]);
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
            elastic += 0.5 * world.assembly().stiffness.of(lattice, particle, direction) * stretch * stretch;
        }
        if let Some(term) = &world.assembly().volume {
            elastic += cell_volume_energy(lattice, world.topology(), term, particle, |p| world.displacement(p));
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
    partial.into_iter().fold(zero, add)
}

/// Energy of the cells whose volume changed [J]: the share of the volume term in [`Balance::elastic`].
pub fn volume_energy(world: &World) -> f64 {
    let Some(term) = &world.assembly().volume else { return 0.0 };
    let of = |p: u32| cell_volume_energy(world.lattice(), world.topology(), term, p, |p| world.displacement(p));
    let numbers: Vec<u32> = (0..world.lattice().len() as u32).collect();
    let partial: Vec<f64> = numbers.par_chunks(CHUNK).map(|chunk| chunk.iter().map(|&p| of(p)).sum()).collect();
    partial.into_iter().sum()
}

/// Volume of the cells that the surface encloses and no blade went through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellVolume {
    /// Sum over these cells now [m^3].
    pub now: f64,
    /// Sum over the same cells at rest [m^3].
    pub rest: f64,
    /// How many of them are turned inside out.
    pub inverted: usize,
}

/// Volume of the cells whose eight corners belong to organs and whose springs are all alive.
///
/// - `displacement` [m], any orthonormal axes of the lattice's handedness: shape `[particles, 3]`, here as a function.
/// - A cell's volume is that of its trilinear image, exactly (six tetrahedra round a body diagonal differ from it by the
///   warp of the faces; the mean of both splittings of every face does not).
pub fn cell_volume(lattice: &Lattice, topology: &Topology, displacement: impl Fn(u32) -> Vector3 + Sync) -> CellVolume {
    let h = lattice.pitch;
    let of = |particle: u32| -> Option<f64> {
        let corner = topology.whole_cell(lattice, particle)?;
        if corner.iter().any(|&p| lattice.organ[p as usize] == FRINGE) {
            return None;
        }
        let place: [Vector3; 8] = std::array::from_fn(|c| {
            Vector3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64) * h + displacement(corner[c])
        });
        Some(hexahedron_volume(&place))
    };
    let numbers: Vec<u32> = (0..lattice.len() as u32).collect();
    let partial: Vec<(f64, usize, usize)> = numbers
        .par_chunks(CHUNK)
        .map(|chunk| {
            chunk.iter().filter_map(|&particle| of(particle)).fold((0.0, 0, 0), |(sum, count, inverted), volume| {
                (sum + volume, count + 1, inverted + usize::from(volume <= 0.0))
            })
        })
        .collect();
    let (now, count, inverted) = partial.into_iter().fold((0.0, 0, 0), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2));
    CellVolume { now, rest: count as f64 * h.powi(3), inverted }
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
