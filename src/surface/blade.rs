//! Where the blade went: the place on every severed edge, and the plane it followed close to each particle.
//!
//! The surface only has vertices on lattice edges and faces. To end the skin where the blade met it, the severed springs of a
//! particle (up to 26, each with its place) are fitted by a plane: it tells how far the skin of this particle reaches
//! before the blade, also along edges that have no spring to sever. Springs severed by several blades that no plane
//! fits give no plane.

use rayon::prelude::*;

use super::junction::{LIP_CLEARANCE, LIP_SHIFT, NearBlade};
use crate::geometry::{Matrix3, Vector3};
use crate::lattice::{Lattice, SeveredSpring, neighbours};

/// Largest rms distance of a particle's severed places from their plane [pitches]: one blade with some curvature has less than
/// 0.05, two crossing blades more than 0.2.
const MISFIT: f64 = 0.1;

/// Smallest spread of the places across the plane's second direction [pitches, rms]: a row of places fixes no plane.
const SPREAD: f64 = 0.15;

/// Cosine between a blade's normal and an edge below which the blade runs along the edge.
const ALONG: f64 = 0.01;

/// The blade near one particle, relative to it: `normal . x = offset` [pitches along the grid axes].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BladePlane {
    normal: Vector3,
    offset: f64,
}

impl BladePlane {
    /// The same just on the particle's side of the blade, by steps along two axes, each with its direction, and up along the third.
    pub(crate) fn seen_along(&self, ways: [(usize, bool); 2]) -> NearBlade {
        let side = self.offset.signum();
        let rate = |(axis, upward): (usize, bool)| (side * self.normal[axis] * if upward { 1.0 } else { -1.0 }) as f32;
        let third = 3 - ways[0].0 - ways[1].0;
        NearBlade {
            normal: [rate(ways[0]), rate(ways[1]), rate((third, true))],
            offset: (self.offset.abs() as f32 - LIP_SHIFT).max(0.0),
        }
    }
}

/// Places of the blade on edges and near particles.
#[derive(Debug, Clone, Default)]
pub(crate) struct Blades {
    /// Severed axis springs: lower particle, axis, place from the lower end. Ascending.
    edges: Vec<((u32, u8), f32)>,
    /// Planes by particle, ascending.
    planes: Vec<(u32, BladePlane)>,
}

impl Blades {
    /// Collects the places of all severed springs.
    pub(crate) fn new(lattice: &Lattice, severed: &[SeveredSpring]) -> Self {
        let mut edges = Vec::new();
        let mut places = Vec::with_capacity(2 * severed.len());
        for spring in severed.iter().filter(|spring| spring.at.is_finite()) {
            let direction = usize::from(spring.direction);
            let offset = neighbours::OFFSETS[direction];
            if neighbours::family(direction) == 1 {
                let axis = offset.iter().position(|&o| o != 0).unwrap_or(0) as u8;
                edges.push(((spring.particle, axis), spring.at));
            }
            places.push((spring.particle, spring.direction, spring.at));
            if let Some(other) = lattice.neighbour(spring.particle, direction) {
                places.push((other, neighbours::opposite(direction) as u8, 1.0 - spring.at));
            }
        }
        edges.sort_unstable_by_key(|edge| edge.0);
        places.par_sort_unstable_by_key(|place| (place.0, place.1));
        let groups: Vec<&[(u32, u8, f32)]> = places.chunk_by(|a, b| a.0 == b.0).collect();
        let planes = groups.par_iter().filter_map(|group| Some((group[0].0, plane_through(group)?))).collect();
        let own = Self { edges, planes };
        let planes = groups
            .par_iter()
            .filter_map(|group| {
                let particle = group[0].0;
                let plane = own.plane(particle).copied().or_else(|| own.borrowed(lattice, group))?;
                Some((particle, plane))
            })
            .collect();
        Self { planes, ..own }
    }

    /// For a particle with too few severed springs: the plane of one it was severed from, where that fits its own places too.
    fn borrowed(&self, lattice: &Lattice, places: &[(u32, u8, f32)]) -> Option<BladePlane> {
        places.iter().find_map(|&(particle, direction, _)| {
            let other = lattice.neighbour(particle, usize::from(direction))?;
            let BladePlane { normal, offset } = *self.plane(other)?;
            let offset =
                offset + normal.dot(&Vector3::from(neighbours::OFFSETS[usize::from(direction)].map(f64::from)));
            let fits = |place: &(u32, u8, f32)| (normal.dot(&place_of(place)) - offset).abs() < MISFIT;
            places.iter().all(fits).then_some(BladePlane { normal, offset })
        })
    }

    /// Where the blade crossed the edge from a particle up along an axis, as a fraction from that particle.
    pub(crate) fn on_edge(&self, low: u32, axis: u8) -> Option<f32> {
        let at = self.edges.binary_search_by_key(&(low, axis), |edge| edge.0).ok()?;
        Some(self.edges[at].1)
    }

    fn plane(&self, particle: u32) -> Option<&BladePlane> {
        let at = self.planes.binary_search_by_key(&particle, |plane| plane.0).ok()?;
        Some(&self.planes[at].1)
    }

    /// A skin crossing `t` from a particle along an axis, drawn back to its side of the blade.
    pub(crate) fn limit(&self, particle: u32, axis: usize, upward: bool, t: f32) -> f32 {
        let Some(plane) = self.plane(particle) else { return t };
        let rate = plane.normal[axis] * if upward { 1.0 } else { -1.0 };
        let reach = plane.offset / rate;
        if reach >= 0.0 && reach < f64::from(t) { (reach as f32 - LIP_SHIFT).max(LIP_CLEARANCE) } else { t }
    }

    /// Particles the blade came near, and those next to them, ascending.
    pub(crate) fn particles(&self, lattice: &Lattice, alive: &[u32]) -> Vec<u32> {
        let linked = |particle: u32| {
            let living = (0..neighbours::NEIGHBOURS).filter(move |d| alive[particle as usize] >> d & 1 == 1);
            living.filter_map(move |direction| lattice.neighbour(particle, direction)).chain([particle])
        };
        let mut particles: Vec<u32> = self.planes.par_iter().flat_map_iter(|plane| linked(plane.0)).collect();
        particles.par_sort_unstable();
        particles.dedup();
        particles
    }

    /// The plane of the blade near a particle, or that of a particle it is linked with, when both lie on one side of it.
    pub(crate) fn near(&self, lattice: &Lattice, alive: &[u32], particle: u32) -> Option<BladePlane> {
        let own = self.plane(particle).copied();
        own.or_else(|| {
            let living = (0..neighbours::NEIGHBOURS).filter(|direction| alive[particle as usize] >> direction & 1 == 1);
            let mut living: Vec<usize> = living.collect();
            living.sort_by_key(|&direction| neighbours::family(direction));
            living.into_iter().find_map(|direction| {
                let BladePlane { normal, offset } = *self.plane(lattice.neighbour(particle, direction)?)?;
                let shifted = offset + normal.dot(&Vector3::from(neighbours::OFFSETS[direction].map(f64::from)));
                (shifted * offset > 0.0).then_some(BladePlane { normal, offset: shifted })
            })
        })
    }

    /// How far the blade moves along `axis` per step up along `across`, near the two ends of an edge; 0 where it is unknown
    /// or runs along the edge.
    pub(crate) fn slope(&self, ends: [u32; 2], axis: usize, across: usize) -> f32 {
        let facing = |plane: &BladePlane| plane.normal * plane.normal[axis].signum();
        let normal: Vector3 = ends.iter().filter_map(|&end| self.plane(end)).map(facing).sum();
        if normal[axis] > ALONG * normal.norm() { (-normal[across] / normal[axis]) as f32 } else { 0.0 }
    }
}

/// Severed place relative to its particle [pitches].
fn place_of(&(_, direction, at): &(u32, u8, f32)) -> Vector3 {
    Vector3::from(neighbours::OFFSETS[usize::from(direction)].map(f64::from)) * f64::from(at)
}

/// The plane of least squared distance through the severed places of one particle.
fn plane_through(places: &[(u32, u8, f32)]) -> Option<BladePlane> {
    let points = || places.iter().map(place_of);
    let count = places.len() as f64;
    if places.len() < 3 {
        return None;
    }
    let middle = points().sum::<Vector3>() / count;
    let spread: Matrix3 =
        points().map(|point| (point - middle) * (point - middle).transpose()).sum::<Matrix3>() / count;
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let fits = eigen.eigenvalues[order[0]] <= MISFIT * MISFIT && eigen.eigenvalues[order[1]] >= SPREAD * SPREAD;
    let normal = eigen.eigenvectors.column(order[0]).into_owned();
    fits.then(|| BladePlane { normal, offset: normal.dot(&middle) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn severed_by(normal: Vector3, offset: f64) -> Vec<(u32, u8, f32)> {
        (0..neighbours::NEIGHBOURS)
            .filter_map(|direction| {
                let rate = Vector3::from(neighbours::OFFSETS[direction].map(f64::from)).dot(&normal);
                let at = offset / rate;
                (0.0..1.0).contains(&at).then_some((7, direction as u8, at as f32))
            })
            .collect()
    }

    #[test]
    fn a_plane_blade_is_found_again() {
        for (normal, offset) in [(Vector3::x(), 0.4), (Vector3::new(1.0, 0.4, -0.2), 0.3), (Vector3::repeat(1.0), 0.5)]
        {
            let (normal, offset) = (normal.normalize(), offset / normal.norm());
            let found = plane_through(&severed_by(normal, offset)).unwrap();
            assert!((found.normal * found.offset - normal * offset).norm() < 1e-6, "{found:?}");
            let blades = Blades { edges: Vec::new(), planes: vec![(7, found)] };
            let reach = (offset / normal.x) as f32;
            assert!((blades.limit(7, 0, true, 0.9) - (reach - LIP_SHIFT)).abs() < 1e-5);
            assert_eq!(blades.limit(7, 0, false, 0.9), 0.9, "the blade lies on the other side");
            assert_eq!(blades.limit(6, 0, true, 0.9), 0.9, "no blade near that particle");
            assert!((f64::from(blades.slope([7, 7], 0, 1)) + normal.y / normal.x).abs() < 1e-6);
        }
    }

    #[test]
    fn crossing_blades_and_rows_of_places_give_no_plane() {
        let mut two = severed_by(Vector3::x(), 0.5);
        two.extend(severed_by(Vector3::y(), 0.4));
        assert_eq!(plane_through(&two), None);
        let row: Vec<_> = severed_by(Vector3::x(), 0.5).into_iter().take(3).collect();
        assert_eq!(row.len(), 3);
        assert_eq!(plane_through(&row), None);
    }
}
