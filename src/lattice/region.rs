//! Parts of the lattice by place or tissue: where an operation acts.
//!
//! Regions are read at rest: a particle keeps the regions it was born in, wherever it is moved later. In a lattice of cells
//! an organ has all corners of its cells, so organs that touch share those of their common wall.

use serde::{Deserialize, Serialize};

use super::Lattice;
use crate::geometry::{Point3, Vector3};

/// Particles this close outside a border still count as inside [mm], so that a border drawn exactly through a layer of
/// particles takes the whole layer: above the rounding of places 10 km from the origin (2e-9 mm), and a ten-thousandth
/// of the finest pitch a scene may ask for (0.01 mm).
const BORDER: f64 = 1e-6;

/// A set of particles, by rest place (RAS+ [mm]) or by organ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Region {
    /// Particles at most `radius` from `center`.
    Sphere {
        /// Centre, RAS+ [mm].
        #[serde(rename = "center_mm")]
        center: Point3,
        /// Radius [mm].
        #[serde(rename = "radius_mm")]
        radius: f64,
    },
    /// Particles inside an axis-aligned box, borders included.
    Box {
        /// Lowest corner, RAS+ [mm].
        #[serde(rename = "min_mm")]
        min: Point3,
        /// Highest corner, RAS+ [mm].
        #[serde(rename = "max_mm")]
        max: Point3,
    },
    /// Particles on the side of a plane its normal points to, the plane included.
    HalfSpace {
        /// Any point of the plane, RAS+ [mm].
        #[serde(rename = "point_mm")]
        point: Point3,
        /// Normal of any length.
        normal: Vector3,
    },
    /// Particles of one organ, or all corners of its cells: its index in the scene.
    Organ(usize),
    /// The `count` particles nearest to a point (ties by particle number).
    Nearest {
        /// The point, RAS+ [mm].
        #[serde(rename = "point_mm")]
        point: Point3,
        /// How many particles.
        count: usize,
    },
    /// Particles in every one of these regions.
    ///
    /// An empty list takes every particle; scenes refuse it.
    All(Vec<Region>),
    /// Particles in at least one of these regions.
    Any(Vec<Region>),
    /// Particles outside a region.
    Not(Box<Region>),
}

impl Region {
    /// Numbers of the particles in this region, ascending.
    ///
    /// Borders count as inside, to within a millionth of a millimetre. Takes O(particles) time for each region it is
    /// combined from. An organ the lattice does not have selects nothing, and so does anything compared with NaN.
    pub fn select(&self, lattice: &Lattice) -> Vec<u32> {
        let members = self.members(lattice);
        (0u32..).zip(&members).filter(|&(_, &member)| member).map(|(particle, _)| particle).collect()
    }

    /// For each of some places other than particles whether it belongs to the region; each has the organ it is part of.
    ///
    /// - `places` RAS+ [mm] and `organs`, by their index in the scene: one of each per place.
    ///
    /// # Panics
    /// If there are not as many organs as places.
    pub fn among(&self, places: &[Point3], organs: &[u8]) -> Vec<bool> {
        assert_eq!(places.len(), organs.len(), "one organ per place");
        let of_organ = |organ: usize| organs.iter().map(|&own| usize::from(own) == organ).collect();
        self.members_of(&Sites { count: places.len(), place: &|site| places[site], of_organ: &of_organ })
    }

    /// For each particle whether it belongs to the region.
    fn members(&self, lattice: &Lattice) -> Vec<bool> {
        let place = |particle: usize| lattice.grid.place(lattice.points[particle] as usize);
        let of_organ = |organ: usize| {
            let is_organ = |own: u8| own != super::FRINGE && usize::from(own) == organ;
            if !lattice.has_cells() {
                return lattice.organ.iter().map(|&own| is_organ(own)).collect();
            }
            let mut members = vec![false; lattice.len()];
            for particle in (0..lattice.len() as u32).filter(|&p| is_organ(lattice.cell_organ[p as usize])) {
                lattice.cell(particle).into_iter().flatten().for_each(|corner| members[corner as usize] = true);
            }
            members
        };
        self.members_of(&Sites { count: lattice.len(), place: &place, of_organ: &of_organ })
    }

    fn members_of(&self, sites: &Sites<'_>) -> Vec<bool> {
        match self {
            Self::Sphere { center, radius } => {
                let reach = radius + BORDER;
                sites.by_place(|place| (place - center).norm_squared() <= reach * reach)
            }
            Self::Box { min, max } => sites.by_place(|place| {
                (0..3).all(|axis| place[axis] >= min[axis] - BORDER && place[axis] <= max[axis] + BORDER)
            }),
            Self::HalfSpace { point, normal } => {
                let normal = normal / normal.norm();
                sites.by_place(|place| normal.dot(&(place - point)) >= -BORDER)
            }
            Self::Organ(organ) => (sites.of_organ)(*organ),
            Self::Nearest { point, count } => sites.nearest(point, *count),
            Self::All(regions) => sites.combine(regions, true, |a, b| a && b),
            Self::Any(regions) => sites.combine(regions, false, |a, b| a || b),
            Self::Not(region) => region.members_of(sites).into_iter().map(|member| !member).collect(),
        }
    }
}

/// What a region selects from.
struct Sites<'a> {
    count: usize,
    /// Rest place of each, RAS+ [mm].
    place: &'a dyn Fn(usize) -> Point3,
    /// For each whether it belongs to an organ.
    of_organ: &'a dyn Fn(usize) -> Vec<bool>,
}

impl Sites<'_> {
    fn by_place(&self, inside: impl Fn(Point3) -> bool) -> Vec<bool> {
        (0..self.count).map(|site| inside((self.place)(site))).collect()
    }

    /// Selects the `count` smallest distances; equal distances go to the lower number.
    fn nearest(&self, point: &Point3, count: usize) -> Vec<bool> {
        let mut order: Vec<(f64, u32)> =
            (0..self.count).map(|site| ((self.place)(site) - point).norm_squared()).zip(0u32..).collect();
        if count < order.len() {
            order.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            order.truncate(count);
        }
        let mut members = vec![false; self.count];
        for (_, site) in order {
            members[site as usize] = true;
        }
        members
    }

    fn combine(&self, regions: &[Region], start: bool, join: impl Fn(bool, bool) -> bool) -> Vec<bool> {
        let mut members = vec![start; self.count];
        for region in regions {
            for (member, other) in members.iter_mut().zip(region.members_of(self)) {
                *member = join(*member, other);
            }
        }
        members
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::lattice::{FRINGE, NO_PARTICLE};

    /// 4 x 3 x 2 grid points 2 mm apart from (10, 20, 30), without the last one: particles 0 to 22.
    /// Columns i = 0 and 1 are organ 0, i = 2 is organ 1, i = 3 is fringe.
    fn lattice() -> Lattice {
        let shape = GridShape::new(4, 3, 2);
        let grid = Grid { shape, affine: Affine::from_spacing([2.0; 3], [10.0, 20.0, 30.0]).unwrap() };
        let points: Vec<u32> = (0..shape.len() as u32 - 1).collect();
        let mut particle_at = points.clone();
        particle_at.push(NO_PARTICLE);
        let organ = points.iter().map(|point| [0, 0, 1, FRINGE][*point as usize % 4]).collect();
        let (springs, cell_organ, cell_fill) = (vec![0; points.len()], Vec::new(), Vec::new());
        Lattice { grid, pitch: 0.002, springs: springs.into(), points, particle_at, organ, cell_organ, cell_fill }
    }

    fn sphere(center: [f64; 3], radius: f64) -> Region {
        Region::Sphere { center: center.into(), radius }
    }

    #[test]
    fn a_sphere_takes_its_border() {
        let lattice = lattice();
        // Particle 5 is (1, 1, 0) at (12, 22, 30); its face neighbours are 1, 4, 6, 9 and, above, 17.
        assert_eq!(sphere([12.0, 22.0, 30.0], 2.0).select(&lattice), [1, 4, 5, 6, 9, 17]);
        assert_eq!(sphere([12.0, 22.0, 30.0], 1.99).select(&lattice), [5]);
        assert_eq!(sphere([0.0, 0.0, 0.0], 5.0).select(&lattice), [0u32; 0]);
    }

    #[test]
    fn a_box_takes_its_border_and_may_be_flat() {
        let lattice = lattice();
        let layer = Region::Box { min: Point3::new(9.0, 22.0, 30.0), max: Point3::new(17.0, 22.0, 30.0) };
        assert_eq!(layer.select(&lattice), [4, 5, 6, 7]);
    }

    #[test]
    fn a_half_space_takes_the_side_of_its_normal_whatever_its_length() {
        let lattice = lattice();
        for length in [1e-3, 1.0, 1e3] {
            let right = Region::HalfSpace { point: [14.0, -5.0, 7.0].into(), normal: Vector3::x() * length };
            assert_eq!(right.select(&lattice), [2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22]);
        }
        // An oblique plane through particle 0 and its diagonal neighbours, which rounding puts on either side.
        let oblique = Region::HalfSpace { point: [10.0, 20.0, 30.0].into(), normal: Vector3::new(-0.1, -0.1, -0.1) };
        assert_eq!(oblique.select(&lattice), [0]);
    }

    #[test]
    fn an_organ_leaves_the_fringe_out_and_places_take_it_in() {
        let lattice = lattice();
        assert_eq!(Region::Organ(1).select(&lattice), [2, 6, 10, 14, 18, 22]);
        assert_eq!(Region::Organ(usize::from(FRINGE)).select(&lattice), [0u32; 0]);
        assert_eq!(sphere([16.0, 20.0, 30.0], 0.5).select(&lattice), [3]);
        let not_tissue = Region::Not(Box::new(Region::Any(vec![Region::Organ(0), Region::Organ(1)])));
        assert_eq!(not_tissue.select(&lattice), [3, 7, 11, 15, 19]);
    }

    #[test]
    fn the_nearest_are_counted_with_ties_by_number() {
        let lattice = lattice();
        let nearest = |point: [f64; 3], count| Region::Nearest { point: point.into(), count }.select(&lattice);
        assert_eq!(nearest([15.9, 20.1, 29.0], 1), [3]);
        // Between particles 0, 1, 4 and 5 all four are equally near.
        assert_eq!(nearest([11.0, 21.0, 30.0], 3), [0, 1, 4]);
        assert_eq!(nearest([11.0, 21.0, 30.0], 0), [0u32; 0]);
        assert_eq!(nearest([11.0, 21.0, 30.0], 1000), (0..23).collect::<Vec<u32>>());
    }

    #[test]
    fn combinations_follow_the_laws_of_sets() {
        let lattice = lattice();
        let (a, b) = (sphere([12.0, 22.0, 30.0], 3.0), Region::Organ(1));
        let not = |region: &Region| Region::Not(Box::new(region.clone()));
        let all = Region::All(vec![a.clone(), b.clone()]);
        let any = Region::Any(vec![a.clone(), b.clone()]);
        assert_eq!(all.select(&lattice), [2, 6, 10, 18]);
        assert_eq!(not(&all).select(&lattice), Region::Any(vec![not(&a), not(&b)]).select(&lattice));
        assert_eq!(not(&any).select(&lattice), Region::All(vec![not(&a), not(&b)]).select(&lattice));
        assert_eq!(not(&not(&a)).select(&lattice), a.select(&lattice));
        assert_eq!(Region::All(vec![]).select(&lattice).len(), lattice.len());
        assert!(Region::Any(vec![]).select(&lattice).is_empty());
    }
}
