//! Small lattices with severed springs.

#[path = "../support/random.rs"]
mod random;

pub(crate) use random::Random;

use yawara::geometry::{Affine, Grid, GridShape, Point3, Vector3};
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS, direction_of};
use yawara::lattice::{Lattice, NO_PARTICLE, SeveredSpring, Topology};
use yawara::surface::Surface;
use yawara::surface::check::{MeshReport, check};
use yawara::surface::field;

/// A lattice with a particle at every grid point where `mask` says so, all neighbours linked, organ 0.
pub(crate) fn lattice_on(grid: Grid, mask: impl Fn([usize; 3]) -> bool) -> Lattice {
    let shape = grid.shape;
    let mut particle_at = vec![NO_PARTICLE; shape.len()];
    let mut points = Vec::new();
    for (point, slot) in particle_at.iter_mut().enumerate() {
        if mask(shape.ijk(point)) {
            *slot = points.len() as u32;
            points.push(point as u32);
        }
    }
    let springs: Vec<u32> = points
        .iter()
        .map(|&point| {
            let linked = |d: &usize| {
                let other = shape.neighbour(shape.ijk(point as usize), OFFSETS[*d]);
                other.is_some_and(|other| particle_at[other] != NO_PARTICLE)
            };
            (0..NEIGHBOURS).filter(linked).fold(0, |bits, d| bits | 1 << d)
        })
        .collect();
    let pitch = grid.affine.spacing()[0] * 1e-3;
    let organ = vec![0; points.len()];
    Lattice {
        grid,
        pitch,
        points,
        particle_at,
        organ,
        springs: springs.into(),
        cell_organ: Vec::new(),
        cell_fill: Vec::new(),
    }
}

/// Axes along x, y, z with a pitch of 1 mm and the origin at 0.
pub(crate) fn unit_grid(nx: usize, ny: usize, nz: usize) -> Grid {
    Grid { shape: GridShape::new(nx, ny, nz), affine: Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap() }
}

pub(crate) fn lattice(nx: usize, ny: usize, nz: usize, mask: impl Fn([usize; 3]) -> bool) -> Lattice {
    lattice_on(unit_grid(nx, ny, nz), mask)
}

/// Every living spring: its lower particle and forward direction.
pub(crate) fn springs(lattice: &Lattice) -> Vec<(u32, usize)> {
    (0..lattice.len() as u32)
        .flat_map(|p| (FIRST_FORWARD..NEIGHBOURS).map(move |d| (p, d)))
        .filter(|&(p, d)| lattice.springs[p as usize] >> d & 1 == 1)
        .collect()
}

pub(crate) fn sever(lattice: &Lattice, topology: &mut Topology, particle: u32, direction: usize, at: f32) -> bool {
    topology.sever(lattice, SeveredSpring { particle, direction: direction as u8, at, time: 0.0 })
}

/// Severs the spring between two grid points.
pub(crate) fn sever_between(
    lattice: &Lattice,
    topology: &mut Topology,
    one: [usize; 3],
    two: [usize; 3],
    at: f32,
) -> bool {
    let offset = [0, 1, 2].map(|axis| two[axis] as i32 - one[axis] as i32);
    let particle = lattice.particle_at[lattice.grid.shape.linear(one)];
    sever(lattice, topology, particle, direction_of(offset), at)
}

/// Severs every spring that crosses the part of a plane where `within` holds, at the place of the crossing.
/// The plane is given in index space.
pub(crate) fn cut_plane(
    lattice: &Lattice,
    topology: &mut Topology,
    point: Vector3,
    normal: Vector3,
    within: impl Fn(Point3) -> bool,
) -> usize {
    let mut count = 0;
    for (particle, direction) in springs(lattice) {
        let from = Vector3::from(lattice.ijk(particle).map(|i| i as f64));
        let step = Vector3::from(OFFSETS[direction].map(f64::from));
        let (side, rate) = ((from - point).dot(&normal), step.dot(&normal));
        let at = -side / rate;
        if (0.0..1.0).contains(&at)
            && within(Point3::from(from + step * at))
            && sever(lattice, topology, particle, direction, at as f32)
        {
            count += 1;
        }
    }
    count
}

pub(crate) fn extract(lattice: &Lattice, topology: &Topology) -> Surface {
    Surface::extract(lattice, topology, &field::binary(lattice, 0)).unwrap()
}

pub(crate) fn report(lattice: &Lattice, topology: &Topology) -> MeshReport {
    check(&extract(lattice, topology).at_rest(lattice))
}

/// A body inside a ball of `radius` round the middle of the grid.
pub(crate) fn ball(n: usize, radius: f64) -> impl Fn([usize; 3]) -> bool {
    let middle = (n as f64 - 1.0) / 2.0;
    move |ijk| ijk.iter().map(|&i| (i as f64 - middle).powi(2)).sum::<f64>() <= radius * radius
}
