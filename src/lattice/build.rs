//! From an organ map to a lattice: which grid points hold a particle, and which springs join them.

use rayon::prelude::*;

use super::neighbours::{NEIGHBOURS, OFFSETS};
use super::{FRINGE, Lattice, NO_PARTICLE};
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

/// How the border of an organ is treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Border {
    /// One particle per organ voxel and nothing else; springs between all neighbours (model `paper`).
    Voxels,
    /// The cells between particles are the material. Cells at the border are partly filled, and their outer corners
    /// become [`FRINGE`] particles (model `tissue`).
    Cells,
}

/// Builds the lattice of an organ map whose voxels are cubes.
///
/// - `rigid`: for each organ, whether it does not deform. Cells need at least one corner that does.
///
/// The lattice covers the organs' bounding box and one grid point around it. O(voxels).
///
/// # Errors
/// See [`BuildLatticeError`].
pub fn build(organs: &OrganMap, border: Border, rigid: &[bool]) -> Result<Lattice, BuildLatticeError> {
    let affine = organs.grid().affine;
    let pitch_mm = cubic_spacing(&affine)?;
    let (low, high) = bounding_box(organs).ok_or(BuildLatticeError::Empty)?;
    let dims = [0, 1, 2].map(|axis| high[axis] - low[axis] + 3);
    let points: u128 = dims.iter().map(|&d| d as u128).product();
    if points > POINT_LIMIT {
        return Err(BuildLatticeError::TooLarge { points, limit: POINT_LIMIT });
    }
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    let first = Vector3::from([0, 1, 2].map(|axis| low[axis] as f64 - 1.0));
    let grid = Grid { shape, affine: affine.shifted(first) };

    // Organ of each lattice point: the cropped map with one empty layer around it.
    let source = organs.as_slice();
    let mut organ_at = vec![NO_ORGAN; shape.len()];
    organ_at.par_chunks_mut(shape.nx * shape.ny).enumerate().for_each(|(k, plane)| {
        if k == 0 || k == shape.nz - 1 {
            return;
        }
        for j in 1..shape.ny - 1 {
            let from = organs.shape().linear([low[0], low[1] + j - 1, low[2] + k - 1]);
            let count = shape.nx - 2;
            plane[j * shape.nx + 1..][..count].copy_from_slice(&source[from..from + count]);
        }
    });

    let deforms = |organ: u8| organ != NO_ORGAN && !rigid[usize::from(organ)];
    let soft_cell = match border {
        Border::Voxels => Vec::new(),
        Border::Cells => soft_cells(shape, &organ_at, deforms),
    };
    let exists = |ijk: [usize; 3]| {
        organ_at[shape.linear(ijk)] != NO_ORGAN
            || (border == Border::Cells && cells_around(shape, ijk).any(|cell| soft_cell[cell]))
    };

    let mut particle_at = vec![NO_PARTICLE; shape.len()];
    let mut points = Vec::new();
    let mut organ = Vec::new();
    for (linear, place) in particle_at.iter_mut().enumerate() {
        if exists(shape.ijk(linear)) {
            *place = points.len() as u32;
            points.push(linear as u32);
            organ.push(match organ_at[linear] {
                NO_ORGAN => FRINGE,
                organ => organ,
            });
        }
    }

    let springs = points
        .par_iter()
        .map(|&point| {
            let ijk = shape.ijk(point as usize);
            let mut bits = 0;
            for (direction, &offset) in OFFSETS.iter().enumerate().take(NEIGHBOURS) {
                let Some(other) = shape.neighbour(ijk, offset) else { continue };
                if particle_at[other] == NO_PARTICLE {
                    continue;
                }
                let both_organs = organ_at[point as usize] != NO_ORGAN && organ_at[other] != NO_ORGAN;
                if both_organs || cells_of_spring(shape, ijk, offset).any(|cell| soft_cell[cell]) {
                    bits |= 1 << direction;
                }
            }
            bits
        })
        .collect();

    Ok(Lattice { grid, pitch: pitch_mm * 1e-3, points, particle_at, organ, springs })
}

/// Edge of the cubic voxels [mm].
fn cubic_spacing(affine: &Affine) -> Result<f64, BuildLatticeError> {
    let spacing = affine.spacing();
    let mean = spacing.iter().sum::<f64>() / 3.0;
    let gram = affine.linear().transpose() * affine.linear() / (mean * mean);
    let off = (gram - nalgebra::Matrix3::identity()).abs().max();
    if off <= CUBIC_TOLERANCE { Ok(mean) } else { Err(BuildLatticeError::NotCubic { spacing }) }
}

/// First and last voxel (i, j, k) that belongs to an organ, along each axis.
fn bounding_box(organs: &OrganMap) -> Option<([usize; 3], [usize; 3])> {
    let shape = organs.shape();
    let mut low = [usize::MAX; 3];
    let mut high = [0; 3];
    for (row, values) in organs.as_slice().chunks_exact(shape.nx.max(1)).enumerate() {
        let Some(first) = values.iter().position(|&o| o != NO_ORGAN) else { continue };
        let last = values.iter().rposition(|&o| o != NO_ORGAN).unwrap_or(first);
        for (axis, (a, b)) in
            [(first, last), (row % shape.ny, row % shape.ny), (row / shape.ny, row / shape.ny)].into_iter().enumerate()
        {
            low[axis] = low[axis].min(a);
            high[axis] = high[axis].max(b);
        }
    }
    (low[0] != usize::MAX).then_some((low, high))
}

/// For each grid point whether the cell above it (towards +x, +y, +z) has a corner that deforms.
fn soft_cells(shape: GridShape, organ_at: &[u8], deforms: impl Fn(u8) -> bool + Sync) -> Vec<bool> {
    (0..shape.len())
        .into_par_iter()
        .map(|linear| {
            let [i, j, k] = shape.ijk(linear);
            i + 1 < shape.nx
                && j + 1 < shape.ny
                && k + 1 < shape.nz
                && corners(shape, linear).into_iter().any(|corner| deforms(organ_at[corner]))
        })
        .collect()
}

/// The eight grid points of the cell above a grid point, x fastest.
pub(crate) fn corners(shape: GridShape, cell: usize) -> [usize; 8] {
    std::array::from_fn(|c| cell + (c & 1) + (c >> 1 & 1) * shape.nx + (c >> 2) * shape.nx * shape.ny)
}

/// The up to eight cells that have this grid point as a corner, by the grid point below them.
fn cells_around(shape: GridShape, ijk: [usize; 3]) -> impl Iterator<Item = usize> {
    (0..8_usize).filter_map(move |c| {
        let back = [c & 1, c >> 1 & 1, c >> 2];
        (0..3).all(|axis| ijk[axis] >= back[axis]).then(|| shape.linear([0, 1, 2].map(|a| ijk[a] - back[a])))
    })
}

/// The cells that share the spring from `ijk` along `offset` (4, 2 or 1 of them inside the grid).
fn cells_of_spring(shape: GridShape, ijk: [usize; 3], offset: [i32; 3]) -> impl Iterator<Item = usize> {
    (0..8_i32).filter_map(move |c| {
        let side = [c & 1, c >> 1 & 1, c >> 2];
        let mut cell = [0; 3];
        for axis in 0..3 {
            // Along the spring the cell is the one it crosses; across it, both sides.
            let below = match offset[axis] {
                0 => side[axis],
                _ if side[axis] == 1 => return None,
                -1 => 1,
                _ => 0,
            };
            cell[axis] = ijk[axis].checked_sub(below as usize)?;
        }
        Some(shape.linear(cell))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::neighbours::{ALL_ALIVE, family, opposite};

    fn map(shape: GridShape, inside: impl Fn([usize; 3]) -> u8) -> OrganMap {
        let grid = Grid { shape, affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        Volume::from_vec(grid, (0..shape.len()).map(|l| inside(shape.ijk(l))).collect())
    }

    #[test]
    fn a_full_cube_has_the_springs_of_its_formula() {
        let n = 5;
        let cube = map(GridShape::new(n, n, n), |_| 0);
        let lattice = build(&cube, Border::Voxels, &[false]).unwrap();
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
        let blob = map(GridShape::new(6, 7, 8), |[i, j, k]| match (i * 7 + j * 5 + k * 3) % 4 {
            0 => NO_ORGAN,
            1 => 1,
            _ => 0,
        });
        for border in [Border::Voxels, Border::Cells] {
            let lattice = build(&blob, border, &[false, true]).unwrap();
            for particle in 0..lattice.len() as u32 {
                for direction in 0..NEIGHBOURS {
                    if lattice.springs[particle as usize] >> direction & 1 == 1 {
                        let other = lattice.neighbour(particle, direction).expect("both ends exist");
                        assert_eq!(lattice.springs[other as usize] >> opposite(direction) & 1, 1);
                    }
                }
            }
        }
    }

    #[test]
    fn one_voxel_of_tissue_gets_a_fringe_of_26() {
        let voxel = map(GridShape::new(3, 3, 3), |ijk| if ijk == [1, 1, 1] { 0 } else { NO_ORGAN });
        let lattice = build(&voxel, Border::Cells, &[false]).unwrap();
        assert_eq!(lattice.len(), 27);
        assert_eq!(lattice.organ.iter().filter(|&&o| o == FRINGE).count(), 26);
        // Eight cells of 28 springs; shared ones counted once: 54 face, 72 face-diagonal, 32 body-diagonal springs.
        let mut families = [0; 3];
        for bits in &lattice.springs {
            (0..NEIGHBOURS).filter(|d| bits >> d & 1 == 1).for_each(|d| families[family(d) - 1] += 1);
        }
        assert_eq!(families.map(|count| count / 2), [54, 72, 32]);
        assert_eq!(build(&voxel, Border::Voxels, &[false]).unwrap().spring_count(), 0);
    }

    #[test]
    fn bone_alone_has_no_fringe() {
        let bone = map(GridShape::new(4, 4, 4), |_| 0);
        let lattice = build(&bone, Border::Cells, &[true]).unwrap();
        assert_eq!(lattice.len(), 64);
    }

    #[test]
    fn unusable_maps_are_refused() {
        let empty = map(GridShape::new(2, 2, 2), |_| NO_ORGAN);
        assert_eq!(build(&empty, Border::Voxels, &[]).unwrap_err(), BuildLatticeError::Empty);
        let affine = Affine::from_spacing([1.0, 1.0, 2.5], [0.0; 3]).unwrap();
        let flat = Volume::from_vec(Grid { shape: GridShape::new(1, 1, 1), affine }, vec![0]);
        let error = build(&flat, Border::Voxels, &[false]).unwrap_err();
        assert!(error.to_string().contains("2.5"), "{error}");
    }
}
