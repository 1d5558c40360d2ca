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

    /// Deviation of a coarser lattice's particles from where a finer one carries their places at rest.
    ///
    /// - `coarse`: the lattice whose particles these are, with their displacements \[mm\].
    /// - `fine`: the other one, in the same axes.
    pub fn between_lattices(&self, (coarse, found): (&Lattice, &[Vector3]), fine: Carrier<'_>) -> Deviation {
        self.deviation(|particle| {
            Some((found[particle as usize] - fine.displacement(coarse.rest_place(particle))?).norm())
        })
    }

    /// Deviation from the limit of vanishing pitch, which is continued place by place from the finest of some runs through coarser
    /// ones: what the finest is off by lies the same way as what they are off from it (Richardson). So an error that points against
    /// that of the finest is not taken for larger than it is.
    ///
    /// - `coarse`: the lattice whose particles are judged, with their displacements \[mm\].
    /// - `finest`, `coarser`: the runs, in the same axes, and what each of the latter tells.
    /// - `unknown_mm`: the error of the finest where no coarser one carries a place: it may lie any way.
    pub(crate) fn against_limit(
        &self,
        (coarse, found): (&Lattice, &[Vector3]),
        finest: Carrier<'_>,
        coarser: &[(Carrier<'_>, Witness)],
        unknown_mm: f64,
    ) -> Deviation {
        self.deviation(|particle| {
            let place = coarse.rest_place(particle);
            let there = finest.displacement(place)?;
            let seen = found[particle as usize] - there;
            let (mut error, mut square) = (Vector3::zeros(), 0.0);
            let (mut weights, mut squared_weights) = (0.0, 0.0);
            for (carrier, Witness { weight, share }) in coarser {
                let Some(moved) = carrier.displacement(place) else { continue };
                let told = (moved - there) * *share;
                error += told * *weight;
                square += told.norm_squared() * weight;
                weights += weight;
                squared_weights += weight * weight;
            }
            if weights == 0.0 {
                return Some(seen.norm() + unknown_mm);
            }
            error /= weights;
            // What runs that disagree leave open, the standard error of their mean, may lie any way too.
            let others = (weights * weights / squared_weights - 1.0).max(1.0);
            let open = ((square / weights - error.norm_squared()).max(0.0) / others).sqrt();
            Some((seen + error).norm() + open)
        })
    }

    /// Of the particles for which a distance \[mm\] is known.
    fn deviation(&self, distance: impl Fn(u32) -> Option<f64> + Sync) -> Deviation {
        let judged = self.particles.par_iter().zip(&self.volumes);
        let found: Vec<_> = judged.filter_map(|(&particle, &volume)| Some((distance(particle)?, volume))).collect();
        let left_out = self.particles.len() - found.len();
        Deviation::of(found, left_out)
    }
}

/// What a coarser run tells of the error of a finer one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Witness {
    /// What it is worth beside others.
    pub(crate) weight: f64,
    /// The error of the finer run over how far the coarser one is from it.
    pub(crate) share: f64,
}

/// A lattice with the displacements of its particles, which carries places between them.
#[derive(Debug, Clone, Copy)]
pub struct Carrier<'a> {
    /// Where particles are at rest.
    pub lattice: &'a Lattice,
    /// Its springs.
    pub topology: &'a Topology,
    /// \[mm\], shape `[particles]`.
    pub displacements: &'a [Vector3],
}

impl Carrier<'_> {
    /// Displacement of a place at rest \[mm\], trilinearly between the eight particles of its cell. `None` where no cell is whole:
    /// one with a severed spring carries nothing, as it lies on both sides of a cut.
    pub fn displacement(&self, place: Point3) -> Option<Vector3> {
        let (corners, weights) = host(self.lattice, self.topology, place)?;
        Some(corners.iter().zip(weights).map(|(&corner, weight)| self.displacements[corner as usize] * weight).sum())
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
        let same = all.between_lattices(
            (&coarse, &found),
            Carrier { lattice: &fine, topology: &whole, displacements: &expected },
        );
        assert!(same.max_mm < 1e-6 && same.left_out == 0 && same.points == coarse.len(), "{same:?}");
        let [found, expected] = [displaced(&coarse, by), displaced(&fine, by)];
        let same = all.between_lattices(
            (&coarse, &found),
            Carrier { lattice: &fine, topology: &whole, displacements: &expected },
        );
        assert!(same.max_mm < 1e-6, "{same:?}");
        // A shift by (3, 4, 0) mm in one run.
        let shifted: Vec<Vector3> = found.iter().map(|u| u + Vector3::new(3.0, 4.0, 0.0)).collect();
        let off = all.between_lattices(
            (&coarse, &shifted),
            Carrier { lattice: &fine, topology: &whole, displacements: &expected },
        );
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
        let some = all.between_lattices(
            (&coarse, &found),
            Carrier { lattice: &fine, topology: &topology, displacements: &expected },
        );
        assert!(some.left_out > 0 && some.points + some.left_out == coarse.len(), "{some:?}");
    }

    #[test]
    fn errors_that_point_against_each_other_do_not_add_up() {
        let lattices = [6.0, 4.0, 3.0].map(cube);
        let springs = lattices.each_ref().map(Topology::new);
        // Of second order in the pitch, larger towards one face.
        let error = |h: f64, p: Point3| Vector3::new(0.02 * h * h * p.x, 0.0, -0.01 * h * h);
        let by = |p: Point3| Vector3::new(0.3 * p.y, 1.0, 0.1 * p.z);
        let pitches = [6.0, 4.0, 3.0];
        let moved: [Vec<Vector3>; 3] =
            std::array::from_fn(|n| displaced(&lattices[n], |p| by(p) + error(pitches[n], p)));
        let carrier =
            |n: usize| Carrier { lattice: &lattices[n], topology: &springs[n], displacements: moved[n].as_slice() };
        let told = |n: usize, order: f64| {
            let power = (3.0 / pitches[n]).powf(order);
            (carrier(n), Witness { weight: (1.0 - power).powi(2), share: power / (1.0 - power) })
        };
        let (coarse, all) = (&lattices[0], all(&lattices[0]));
        let limit = displaced(coarse, by);
        let off = |found: &[Vector3], coarser: &[(Carrier<'_>, Witness)]| {
            all.against_limit((coarse, found), carrier(2), coarser, 0.4).rms_mm
        };
        for sign in [1.0, -1.0, 0.0] {
            let found = displaced(coarse, |p| by(p) + error(6.0, p) * sign);
            let truth = all.on_one_lattice(&found, &limit).rms_mm;
            let known = off(&found, &[told(0, 2.0), told(1, 2.0)]);
            assert!((known - truth).abs() < 1e-6, "{sign}: {known} for {truth}");
            // By too low an order the finest run seems worse than it is, and so does all that errs the same way or not at all.
            assert!(off(&found, &[told(0, 1.2), told(1, 1.2)]) > truth || sign < 0.0, "{sign}");
            let unknown = all.between_lattices((coarse, &found), carrier(2)).rms_mm;
            // Where nothing is told, the error of the finest is added to every distance.
            let added = off(&found, &[]);
            let bounds = unknown.hypot(0.4) - 1e-9..=unknown + 0.4 + 1e-9;
            assert!(bounds.contains(&added), "{sign}: {added}, {bounds:?}");
        }
    }

    #[test]
    fn the_99th_of_a_hundred() {
        let deviation = Deviation::of((1..=200).map(|distance| (f64::from(distance), 1.0)).collect(), 3);
        assert_eq!((deviation.most_mm, deviation.max_mm, deviation.points, deviation.left_out), (198.0, 200.0, 200, 3));
    }
}
