//! From an organ map to a lattice: which grid points hold a particle, and which springs join them.

use std::sync::Arc;

use rayon::prelude::*;

use super::neighbours::{NEIGHBOURS, OFFSETS};
use super::{Lattice, NO_PARTICLE};
use crate::geometry::{Affine, Grid, GridShape, Vector3};
use crate::volume::Volume;

/// Marks a voxel that belongs to no organ in an [`OrganMap`].
pub const NO_ORGAN: u8 = u8::MAX;

/// Organ of each voxel: an index into the scene's organs, or [`NO_ORGAN`].
pub type OrganMap = Volume<u8>;

/// Why an organ map cannot become a lattice.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildLatticeError {
    /// The voxels are not cubes, so neighbouring particles would not be one pitch apart.
    #[error(
        "the organ map has voxels of {} x {} x {} mm whose axes are not orthogonal and equally long; \
         resample it to cubes first (set lattice.pitch, in mm)",
        spacing[0], spacing[1], spacing[2]
    )]
    NotCubic {
        /// Voxel spacing [mm].
        spacing: [f64; 3],
    },
    /// No voxel belongs to an organ.
    #[error("no voxel belongs to an organ, so the lattice would be empty; check the labels or HU ranges of the organs")]
    Empty,
    /// More grid points than 32-bit particle numbers can count.
    #[error(
        "the organs' bounding box holds {points} lattice points, more than the {limit} supported; choose a coarser lattice.pitch"
    )]
    TooLarge {
        /// Grid points of the bounding box.
        points: u128,
        /// Largest number supported.
        limit: u128,
    },
}

/// Largest number of lattice points: particle and slot numbers are 32 bits, and blocks round the box up.
const POINT_LIMIT: u128 = 1 << 31;
/// How far from cubic voxels may be, relative to their size: headers store spacings as f32.
const CUBIC_TOLERANCE: f64 = 1e-4;

/// Builds a lattice with one particle per organ voxel and springs between all neighbours (model `paper`); see
/// [`super::cells::build_cells`] for model `tissue`.
///
/// The lattice covers the organs' bounding box and one grid point around it. O(voxels).
///
/// # Errors
/// See [`BuildLatticeError`]; voxels have to be cubes.
pub fn build(organs: &OrganMap) -> Result<Lattice, BuildLatticeError> {
    let pitch_mm = cubic_spacing(&organs.grid().affine)?;
    let is_organ = |voxel: usize| organs.as_slice()[voxel] != NO_ORGAN;
    let (low, _, shape) = grid_around(organs.shape(), is_organ, 0)?;
    let first = Vector3::from([0, 1, 2].map(|axis| low[axis] as f64 - 1.0));
    let grid = Grid { shape, affine: organs.grid().affine.shifted(first) };

    let organ_at = |point: usize| {
        let [i, j, k] = shape.ijk(point);
        let voxel = [(i, low[0]), (j, low[1]), (k, low[2])].map(|(at, low)| (at + low).wrapping_sub(1));
        let inside = (0..3).all(|axis| voxel[axis] < organs.shape().dims()[axis]);
        if inside { organs.as_slice()[organs.shape().linear(voxel)] } else { NO_ORGAN }
    };
    let springs = |point: usize| {
        let ijk = shape.ijk(point);
        let joins = |&direction: &usize| {
            shape.neighbour(ijk, OFFSETS[direction]).is_some_and(|other| organ_at(other) != NO_ORGAN)
        };
        (0..NEIGHBOURS).filter(joins).fold(0, |bits, direction| bits | 1 << direction)
    };
    Ok(lattice_of(grid, pitch_mm, |point| organ_at(point) != NO_ORGAN, organ_at, springs))
}

/// Numbers the particles of a grid and joins them.
///
/// - `exists`, `organ`, `springs`: of a grid point; the last two are asked only where there is a particle.
pub(super) fn lattice_of(
    grid: Grid,
    pitch_mm: f64,
    exists: impl Fn(usize) -> bool + Sync + Send,
    organ: impl Fn(usize) -> u8 + Sync + Send,
    springs: impl Fn(usize) -> u32 + Sync + Send,
) -> Lattice {
    let exists: Vec<bool> = (0..grid.shape.len()).into_par_iter().map(exists).collect();
    let mut particle_at = vec![NO_PARTICLE; grid.shape.len()];
    let mut points = Vec::new();
    for (point, place) in particle_at.iter_mut().enumerate().filter(|(point, _)| exists[*point]) {
        *place = points.len() as u32;
        points.push(point as u32);
    }
    let organ = points.par_iter().map(|&point| organ(point as usize)).collect();
    let springs = Arc::new(points.par_iter().map(|&point| springs(point as usize)).collect());
    let (cell_organ, cell_fill) = (Vec::new(), Vec::new());
    Lattice { grid, pitch: pitch_mm * 1e-3, points, particle_at, organ, springs, cell_organ, cell_fill }
}

/// Edge of the cubic voxels [mm].
pub(super) fn cubic_spacing(affine: &Affine) -> Result<f64, BuildLatticeError> {
    let spacing = affine.spacing();
    let mean = spacing.iter().sum::<f64>() / 3.0;
    let gram = affine.linear().transpose() * affine.linear() / (mean * mean);
    let off = (gram - nalgebra::Matrix3::identity()).abs().max();
    if off <= CUBIC_TOLERANCE { Ok(mean) } else { Err(BuildLatticeError::NotCubic { spacing }) }
}

/// First wanted voxel, wanted voxels along each axis, and the grid around them: `more` grid points than voxels along each
/// axis, and one layer around.
pub(super) fn grid_around(
    voxels: GridShape,
    wanted: impl Fn(usize) -> bool,
    more: usize,
) -> Result<([usize; 3], [usize; 3], GridShape), BuildLatticeError> {
    let (low, high) = bounding_box(voxels, wanted).ok_or(BuildLatticeError::Empty)?;
    let count = [0, 1, 2].map(|axis| high[axis] - low[axis] + 1);
    let dims = count.map(|count| count + more + 2);
    let points: u128 = dims.iter().map(|&d| d as u128).product();
    if points > POINT_LIMIT {
        return Err(BuildLatticeError::TooLarge { points, limit: POINT_LIMIT });
    }
    Ok((low, count, GridShape::new(dims[0], dims[1], dims[2])))
}

/// First and last wanted voxel (i, j, k) along each axis.
fn bounding_box(shape: GridShape, wanted: impl Fn(usize) -> bool) -> Option<([usize; 3], [usize; 3])> {
    let mut low = [usize::MAX; 3];
    let mut high = [0; 3];
    for row in 0..shape.ny * shape.nz {
        let start = row * shape.nx;
        let Some(first) = (0..shape.nx).find(|&i| wanted(start + i)) else { continue };
        let last = (0..shape.nx).rfind(|&i| wanted(start + i)).unwrap_or(first);
        for (axis, (a, b)) in
            [(first, last), (row % shape.ny, row % shape.ny), (row / shape.ny, row / shape.ny)].into_iter().enumerate()
        {
            low[axis] = low[axis].min(a);
            high[axis] = high[axis].max(b);
        }
    }
    (low[0] != usize::MAX).then_some((low, high))
}

/// The eight grid points of the cell above a grid point, x fastest.
pub(crate) fn corners(shape: GridShape, cell: usize) -> [usize; 8] {
    std::array::from_fn(|c| cell + (c & 1) + (c >> 1 & 1) * shape.nx + (c >> 2) * shape.nx * shape.ny)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::neighbours::{ALL_ALIVE, opposite};

    fn map(shape: GridShape, inside: impl Fn([usize; 3]) -> u8) -> OrganMap {
        let grid = Grid { shape, affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        Volume::from_vec(grid, (0..shape.len()).map(|l| inside(shape.ijk(l))).collect())
    }

    #[test]
    fn a_full_cube_has_the_springs_of_its_formula() {
        let n = 5;
        let lattice = build(&map(GridShape::new(n, n, n), |_| 0)).unwrap();
        assert_eq!(lattice.len(), n * n * n);
        assert_eq!(lattice.pitch, 2e-3);
        // Faces, face diagonals, body diagonals of an n-cube of points.
        let expected = 3 * n * n * (n - 1) + 6 * n * (n - 1) * (n - 1) + 4 * (n - 1).pow(3);
        assert_eq!(lattice.spring_count(), expected);
        let middle = lattice.particle_at[lattice.grid.shape.linear([3, 3, 3])];
        assert_eq!(lattice.springs[middle as usize], ALL_ALIVE);
        assert_eq!(lattice.rest_place(0), crate::geometry::Point3::new(0.0, 0.0, 0.0));
    }

    #[test]
    fn springs_are_symmetric_and_join_particles() {
        let lattice = build(&map(GridShape::new(6, 7, 8), |[i, j, k]| match (i * 7 + j * 5 + k * 3) % 4 {
            0 => NO_ORGAN,
            1 => 1,
            _ => 0,
        }))
        .unwrap();
        for particle in 0..lattice.len() as u32 {
            for direction in (0..NEIGHBOURS).filter(|d| lattice.springs[particle as usize] >> d & 1 == 1) {
                let other = lattice.neighbour(particle, direction).expect("both ends exist");
                assert_eq!(lattice.springs[other as usize] >> opposite(direction) & 1, 1);
            }
        }
    }

    #[test]
    fn unusable_maps_are_refused() {
        let empty = map(GridShape::new(2, 2, 2), |_| NO_ORGAN);
        assert_eq!(build(&empty).unwrap_err(), BuildLatticeError::Empty);
        let affine = Affine::from_spacing([1.0, 1.0, 2.5], [0.0; 3]).unwrap();
        let flat = Volume::from_vec(Grid { shape: GridShape::new(1, 1, 1), affine }, vec![0]);
        let error = build(&flat).unwrap_err();
        assert!(error.to_string().contains("2.5"), "{error}");
    }
}
