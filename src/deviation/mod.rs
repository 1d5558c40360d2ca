//! How far particles of one run are from where another run has them, and what that says of pitches never tried.

pub mod pitch_law;

use rayon::prelude::*;

use crate::geometry::{Point3, Vector3};
use crate::lattice::{FRINGE, Lattice, NO_PARTICLE, Topology};
use crate::scene::resolved::{Body, Scene};

/// A coordinate this close to a plane of the grid lies in it \[pitches\].
const IN_PLANE: f64 = 1e-6;

/// Distances of particles from where a reference has them, at one instant.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Deviation {
    /// The largest \[mm\].
    pub max_mm: f64,
    /// 99 of 100 particles are at most so far off \[mm\].
    pub most_mm: f64,
    /// Root of the mean square over the tissue \[mm\]: each particle counts by the tissue it stands for.
    pub rms_mm: f64,
    /// Particles that were compared.
    pub points: usize,
    /// Particles of the tissue for which the finer lattice has no whole cell, beside a cut or at the border.
    pub left_out: usize,
}

/// Two sizes of an error.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Sizes {
    /// Of the particle that is off most \[mm\].
    pub max_mm: f64,
    /// Root of the mean square over the tissue \[mm\].
    pub rms_mm: f64,
}

impl Deviation {
    /// Of a list of distances \[mm\], each with the volume it stands for.
    fn of(found: Vec<(f64, f64)>, left_out: usize) -> Self {
        let points = found.len();
        if points == 0 {
            return Self { max_mm: f64::NAN, most_mm: f64::NAN, rms_mm: f64::NAN, points, left_out };
        }
        let volume: f64 = found.iter().map(|(_, volume)| volume).sum();
        let squares: f64 = found.iter().map(|(distance, volume)| distance * distance * volume).sum();
        let mut distances: Vec<f64> = found.into_iter().map(|(distance, _)| distance).collect();
        let rank = (points * 99).div_ceil(100).max(1) - 1;
        let (_, &mut most_mm, _) = distances.select_nth_unstable_by(rank, f64::total_cmp);
        let max_mm = distances.iter().copied().fold(0.0, f64::max);
        Self { max_mm, most_mm, rms_mm: (squares / volume).sqrt(), points, left_out }
    }

    /// The larger of each part: of two instants the worse.
    pub fn worse(self, other: Self) -> Self {
        Self {
            max_mm: self.max_mm.max(other.max_mm),
            most_mm: self.most_mm.max(other.most_mm),
            rms_mm: self.rms_mm.max(other.rms_mm),
            points: self.points.min(other.points),
            left_out: self.left_out.max(other.left_out),
        }
    }
}

/// Particles that are judged: those inside tissue that deforms, not the fringe around it, not bone.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Their numbers, ascending.
    particles: Vec<u32>,
    /// How much tissue each stands for \[cells\]: an eighth of every cell around it. So lattices of different pitch are judged over the
    /// same tissue, and not more by its faces the coarser they are.
    volumes: Vec<f64>,
}

impl Judged {
    /// Of a scene's lattice.
    pub fn of(lattice: &Lattice, scene: &Scene) -> Self {
        let soft = |organ: u8| {
            organ != FRINGE
                && scene.organs.get(usize::from(organ)).is_some_and(|organ| !matches!(organ.body, Body::Rigid { .. }))
        };
        let volume = |particle: u32| {
            let cells = lattice.cells_around(particle).map(|cell| cell as usize);
            let tissue = cells.filter(|&cell| soft(lattice.cell_organ[cell]));
            tissue.map(|cell| f64::from(lattice.cell_fill[cell]) / 8.0).sum::<f64>()
        };
        let judged = (0..lattice.len() as u32).filter(|&particle| soft(lattice.organ[particle as usize]));
        let (particles, volumes) =
            judged.map(|particle| (particle, if lattice.has_cells() { volume(particle) } else { 1.0 })).unzip();
        Self { particles, volumes }
    }

    /// The largest displacement of any of them \[mm\].
    ///
    /// - `displacement`: of a particle \[mm\].
    pub fn largest(&self, displacement: impl Fn(u32) -> Vector3) -> f64 {
        self.particles.iter().map(|&particle| displacement(particle).norm()).fold(0.0, f64::max)
    }

    /// Deviation on one lattice.
    ///
    /// - `found`, `expected`: displacements \[mm\], shape `[particles]`.
    pub fn on_one_lattice(&self, found: &[Vector3], expected: &[Vector3]) -> Deviation {
        let distance = |particle: u32| Some((found[particle as usize] - expected[particle as usize]).norm());
        self.deviation(distance)
    }

    /// Deviation of a coarser lattice's particles from where a finer lattice carries their places at rest, trilinearly between the
    /// eight particles of its cell there. Cells with a severed spring carry nothing: they lie on both sides of a cut.
    ///
    /// - `coarse`: the lattice whose particles these are, with their displacements \[mm\].
    /// - `fine`: the other one in the same axes, with its springs and displacements \[mm\].
    pub fn between_lattices(
        &self,
        (coarse, found): (&Lattice, &[Vector3]),
        (fine, topology, expected): (&Lattice, &Topology, &[Vector3]),
    ) -> Deviation {
        self.deviation(|particle| {
            let (corners, weights) = host(fine, topology, coarse.rest_place(particle))?;
            let carried: Vector3 = corners.iter().zip(weights).map(|(&c, weight)| expected[c as usize] * weight).sum();
            Some((found[particle as usize] - carried).norm())
        })
    }

    /// Of the particles for which a distance is known.
    fn deviation(&self, distance: impl Fn(u32) -> Option<f64> + Sync) -> Deviation {
        let judged = self.particles.par_iter().zip(&self.volumes);
        let found: Vec<_> = judged.filter_map(|(&particle, &volume)| Some((distance(particle)?, volume))).collect();
        let left_out = self.particles.len() - found.len();
        Deviation::of(found, left_out)
    }
}

/// The whole cell around a place at rest \[mm, RAS+\]: its corners, x fastest, and their trilinear weights. A place in the wall of two
/// cells takes the one that is whole.
fn host(lattice: &Lattice, topology: &Topology, place: Point3) -> Option<([u32; 8], [f64; 8])> {
    let index = lattice.grid.affine.index_of(place);
    let low = [0, 1, 2].map(|axis| (index[axis] + IN_PLANE).floor());
    let share = [0, 1, 2].map(|axis| (index[axis] - low[axis]).max(0.0));
    let dims = lattice.grid.shape.dims();
    (0..8_usize).find_map(|other| {
        let steps_back = [other & 1, other >> 1 & 1, other >> 2];
        if (0..3).any(|axis| steps_back[axis] == 1 && share[axis] > IN_PLANE) {
            return None;
        }
        let corner = [0, 1, 2].map(|axis| low[axis] - steps_back[axis] as f64);
        if (0..3).any(|axis| corner[axis] < 0.0 || corner[axis] + 1.0 >= dims[axis] as f64) {
            return None;
        }
        let particle = lattice.particle_at[lattice.grid.shape.linear(corner.map(|c| c as usize))];
        let corners = (particle != NO_PARTICLE).then(|| topology.whole_cell(lattice, particle))??;
        let part = [0, 1, 2].map(|axis| share[axis] + steps_back[axis] as f64);
        let weight = |n: usize| {
            (0..3).map(|axis| if n >> axis & 1 == 1 { part[axis] } else { 1.0 - part[axis] }).product::<f64>()
        };
        Some((corners, std::array::from_fn(weight)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::lattice::SeveredSpring;
    use crate::lattice::cells::build_cells;
    use crate::lattice::neighbours::FIRST_FORWARD;
    use crate::volume::Volume;

    /// A cube of 12 mm in cells of this edge.
    fn cube(edge: f64) -> Lattice {
        let cells = (12.0 / edge).round() as usize;
        let shape = GridShape::new(cells, cells, cells);
        let affine = Affine::from_spacing([edge; 3], [0.5 * edge; 3]).unwrap();
        build_cells(&Volume::from_vec(Grid { shape, affine }, vec![0; shape.len()]), None).unwrap()
    }

    /// All particles, each for as much tissue.
    fn all(lattice: &Lattice) -> Judged {
        Judged { particles: (0..lattice.len() as u32).collect(), volumes: vec![1.0; lattice.len()] }
    }

    fn displaced(lattice: &Lattice, by: impl Fn(Point3) -> Vector3) -> Vec<Vector3> {
        (0..lattice.len() as u32).map(|particle| by(lattice.rest_place(particle))).collect()
    }

    #[test]
    fn what_is_trilinear_is_carried_exactly() {
        let (coarse, fine) = (cube(4.0), cube(3.0));
        let whole = Topology::new(&fine);
        let by = |p: Point3| Vector3::new(0.1 * p.x * p.y, 0.2 * p.z - 1.0, 0.05 * p.x * p.y * p.z);
        let all = all(&coarse);
        // Trilinear in every cell: compared in a field that is linear, with a twist that is bilinear along the axes.
        let linear = |p: Point3| Vector3::new(0.1 * p.x - 0.3 * p.y, 0.2 * p.z - 1.0, 0.05 * p.x);
        let [found, expected] = [displaced(&coarse, linear), displaced(&fine, linear)];
        let same = all.between_lattices((&coarse, &found), (&fine, &whole, &expected));
        assert!(same.max_mm < 1e-6 && same.left_out == 0 && same.points == coarse.len(), "{same:?}");
        let [found, expected] = [displaced(&coarse, by), displaced(&fine, by)];
        let same = all.between_lattices((&coarse, &found), (&fine, &whole, &expected));
        assert!(same.max_mm < 1e-6, "{same:?}");
        // A shift by (3, 4, 0) mm in one run.
        let shifted: Vec<Vector3> = found.iter().map(|u| u + Vector3::new(3.0, 4.0, 0.0)).collect();
        let off = all.between_lattices((&coarse, &shifted), (&fine, &whole, &expected));
        for value in [off.max_mm, off.most_mm, off.rms_mm] {
            assert!((value - 5.0).abs() < 1e-6, "{off:?}");
        }
    }

    #[test]
    fn cells_that_were_cut_carry_nothing() {
        let (coarse, fine) = (cube(4.0), cube(3.0));
        let mut topology = Topology::new(&fine);
        let particle = (0..fine.len() as u32).find(|&p| fine.ijk(p) == [1, 1, 1]).unwrap();
        let direction = FIRST_FORWARD as u8;
        assert!(topology.sever(&fine, SeveredSpring { particle, direction, at: 0.5, time: 0.0 }));
        let all = all(&coarse);
        let [found, expected] = [&coarse, &fine].map(|lattice| displaced(lattice, |_| Vector3::zeros()));
        let some = all.between_lattices((&coarse, &found), (&fine, &topology, &expected));
        assert!(some.left_out > 0 && some.points + some.left_out == coarse.len(), "{some:?}");
    }

    #[test]
    fn the_99th_of_a_hundred() {
        let deviation = Deviation::of((1..=200).map(|distance| (f64::from(distance), 1.0)).collect(), 3);
        assert_eq!((deviation.most_mm, deviation.max_mm, deviation.points, deviation.left_out), (198.0, 200.0, 200, 3));
    }
}
