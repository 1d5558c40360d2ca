//! Which surface particles are near each other: sorted into cells as wide as the search reaches.

use rayon::prelude::*;

use super::surface::{Member, Surface};
use super::{LATERAL, SKIN};
use crate::geometry::Vector3;
use crate::lattice::{Lattice, Topology};

/// Pairs whose gap exceeds the least one by more do not touch in the next step [pitches].
pub(super) const AHEAD: f64 = 0.5;
/// Pairs that were no farther apart at rest were neighbours, and may be as near as they were then [pitches].
const NEIGHBOURS_AT_REST: f64 = 3.5;
/// The common normal of two particles at rest is told by normals that differ by so much.
const APART: f64 = 1.0;
/// Cells are counted from here, so that numbers of 21 bits serve on both sides of the origin.
const FIRST_CELL: f64 = (1 << 20) as f64;
const LAST_CELL: f64 = ((1 << 21) - 1) as f64;

/// Two surface particles that may touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    /// Members of the surface, the lower one first.
    pub(super) ends: [u32; 2],
    /// The gap they must keep [m].
    pub(super) least: f64,
}

/// Pairs farther apart do not touch in the next step [pitches].
pub(super) fn reach() -> f64 {
    LATERAL.hypot(1.0 + AHEAD)
}

/// The direction along which two particles with these normals keep apart, from the first to the second.
pub(super) fn common_normal((a, from): (&Member, Vector3), (b, to): (&Member, Vector3)) -> Vector3 {
    (from * a.say - to * b.say).normalize()
}

/// All pairs that can come within reach while every particle moves by at most half of the skin, ascending.
///
/// - `place`: of each member now [m].
pub(super) fn near_pairs(surface: &Surface, lattice: &Lattice, topology: &Topology, place: &[Vector3]) -> Vec<Pair> {
    let radius = (reach() + SKIN) * lattice.pitch;
    let cell = |place: &Vector3| -> [u64; 3] {
        [0, 1, 2].map(|axis| ((place[axis] / radius).floor() + FIRST_CELL).clamp(1.0, LAST_CELL - 1.0) as u64)
    };
    let key = |[x, y, z]: [u64; 3]| (z << 21 | y) << 21 | x;
    let mut sorted: Vec<(u64, u32)> =
        place.par_iter().enumerate().map(|(member, place)| (key(cell(place)), member as u32)).collect();
    sorted.par_sort_unstable();
    let of = |first: usize| {
        let [x, y, z] = cell(&place[first]);
        let mut found = Vec::new();
        for (y, z) in (z - 1..=z + 1).flat_map(|z| (y - 1..=y + 1).map(move |y| (y, z))) {
            let (low, high) = (key([x - 1, y, z]), key([x + 1, y, z]));
            let start = sorted.partition_point(|&(key, _)| key < low);
            let row = sorted[start..].iter().take_while(|&&(key, _)| key <= high);
            found.extend(row.map(|&(_, second)| second).filter(|&second| {
                second as usize > first && (place[second as usize] - place[first]).norm_squared() <= radius * radius
            }));
        }
        found.sort_unstable();
        found.into_iter().filter_map(move |second| pair(surface, lattice, topology, [first as u32, second]))
    };
    (0..place.len()).into_par_iter().flat_map_iter(of).collect()
}

/// The pair that two members are, unless springs join them.
fn pair(surface: &Surface, lattice: &Lattice, topology: &Topology, ends: [u32; 2]) -> Option<Pair> {
    let [a, b] = ends.map(|end| &surface.members()[end as usize]);
    if Surface::are_joined(topology, a, b) {
        return None;
    }
    let mut least = (a.thickness + b.thickness).min(1.0);
    let way = b.rest() - a.rest();
    if way.norm_squared() <= NEIGHBOURS_AT_REST * NEIGHBOURS_AT_REST && (a.normal - b.normal).norm() > APART {
        least = least.min(way.dot(&common_normal((a, a.normal), (b, b.normal))));
    }
    Some(Pair { ends, least: least * lattice.pitch })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::World;
    use crate::dynamics::effects::self_contact::touch::places;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::lattice::SeveredSpring;
    use crate::lattice::build::{NO_ORGAN, build};
    use crate::material::paper::{PaperBody, assemble};
    use crate::splitmix::SplitMix;
    use crate::volume::Volume;

    /// Every pair compared with every other.
    fn all_pairs(surface: &Surface, lattice: &Lattice, topology: &Topology, place: &[Vector3]) -> Vec<Pair> {
        let radius = (reach() + SKIN) * lattice.pitch;
        let count = place.len();
        let all = (0..count).flat_map(|first| (first + 1..count).map(move |second| [first, second]));
        all.filter(|&[a, b]| (place[b] - place[a]).norm_squared() <= radius * radius)
            .filter_map(|ends| pair(surface, lattice, topology, ends.map(|end| end as u32)))
            .collect()
    }

    /// Random blobs, cut in places and thrown into disorder, also far from where they were.
    #[test]
    fn cells_find_every_pair() {
        let mut found = 0;
        for seed in 0..40 {
            let mut random = SplitMix::new(seed);
            let shape = GridShape::new(9, 8, 7);
            let grid = Grid { shape, affine: Affine::from_spacing([2.0; 3], [5.0, 0.0, -3.0]).unwrap() };
            let organs = (0..shape.len()).map(|_| if random.unit() < 0.8 { 0 } else { NO_ORGAN }).collect();
            let lattice = build(&Volume::from_vec(grid, organs)).unwrap();
            let assembly = assemble(&lattice, &[Some(PaperBody { stiffness: 10.0, damping: 0.0, mass: 1e-5 })]);
            let mut world = World::new(lattice, assembly, 1e-4);
            let far = if seed % 3 == 0 { 1e6 } else { 0.0 };
            for particle in 0..world.lattice().len() as u32 {
                let u = Vector3::from([0; 3].map(|_| random.unit() - 0.5)) * 4e-3;
                world.set_displacement(particle, u + Vector3::new(0.0, -far, 0.0));
                for direction in 13..26 {
                    let severed = SeveredSpring { particle, direction, at: 0.3, time: 0.0 };
                    if random.unit() < 0.3 && world.topology().alive()[particle as usize] >> direction & 1 == 1 {
                        world.sever([severed]);
                    }
                }
            }
            let surface = Surface::new(&world.lattice, &world.topology, &world.layout, &world.assembly, &[0]);
            let place = places(&surface, &world);
            let pairs = near_pairs(&surface, &world.lattice, &world.topology, &place);
            assert_eq!(pairs, all_pairs(&surface, &world.lattice, &world.topology, &place), "seed {seed}");
            found += pairs.len();
        }
        assert!(found > 10_000, "only {found} pairs");
    }

    /// Springs severed one lot after another leave the surface that all of them at once do.
    #[test]
    fn a_surface_follows_its_cuts() {
        let shape = GridShape::new(8, 7, 6);
        let grid = Grid { shape, affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        let lattice = build(&Volume::from_vec(grid, vec![0; shape.len()])).unwrap();
        let assembly = assemble(&lattice, &[Some(PaperBody { stiffness: 10.0, damping: 0.0, mass: 1e-5 })]);
        let mut world = World::new(lattice, assembly, 1e-4);
        let of = |world: &World| Surface::new(&world.lattice, &world.topology, &world.layout, &world.assembly, &[0]);
        let mut followed = of(&world);
        let whole = followed.particles();
        assert!(!followed.follow(&world.lattice, &world.topology, &world.layout));
        let mut random = SplitMix::new(5);
        for _ in 0..30 {
            let particle = (random.unit() * world.lattice().len() as f64) as u32;
            let before = world.topology().severed().len();
            for direction in 13..26_u8 {
                if world.topology().alive()[particle as usize] >> direction & 1 == 1 {
                    world.sever([SeveredSpring { particle, direction, at: random.unit() as f32, time: 0.0 }]);
                }
            }
            let changed = world.topology().severed().len() > before;
            assert_eq!(followed.follow(&world.lattice, &world.topology, &world.layout), changed);
            assert_eq!(followed.members(), of(&world).members());
        }
        assert!(followed.particles() > whole + 5, "{} {whole}", followed.particles());
    }
}
