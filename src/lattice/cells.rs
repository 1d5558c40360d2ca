//! The lattice of model `tissue`: every voxel is a cell of material, and the particles are its corners.
//!
//! So borders and interfaces of organs lie on faces of cells, exactly, and a voxel that is partly tissue (at the border of
//! an organ on a coarse lattice) is a cell that is partly filled. Which organ a particle belongs to, in the eyes of the
//! surface, follows from the cells around it:
//!
//! - at least half tissue: the organ with the largest share, the earlier one on a tie;
//! - else none ([`FRINGE`]): the particle lies beyond the border that is drawn;
//! - but a cell none of whose corners would belong to its organ (in a part one voxel thin) takes all its corners.

use rayon::prelude::*;

use super::build::{BuildLatticeError, NO_ORGAN, OrganMap, cubic_spacing, grid_around, lattice_of};
use super::neighbours::{NEIGHBOURS, OFFSETS};
use super::{FRINGE, Lattice, NO_PARTICLE};
use crate::geometry::{Grid, GridShape, Vector3};
use crate::volume::Volume;

/// Cells with less tissue than this are left out.
pub const LEAST_FILL: f32 = 0.01;

/// Builds the lattice whose cells are the voxels of an organ map.
///
/// - `fill`: how much of each voxel is tissue, 0 to 1, on the grid of the map; all of it when `None`. Voxels with less than
///   [`LEAST_FILL`] are left out.
///
/// The lattice covers the organs' bounding box and one grid point around it. O(voxels).
///
/// # Errors
/// See [`BuildLatticeError`].
///
/// # Panics
/// If `fill` has another shape than the map.
pub fn build_cells(organs: &OrganMap, fill: Option<&Volume<f32>>) -> Result<Lattice, BuildLatticeError> {
    let pitch_mm = cubic_spacing(&organs.grid().affine)?;
    if let Some(fill) = fill {
        assert_eq!(fill.shape(), organs.shape(), "one fill per voxel");
    }
    let fill_of = |voxel: usize| fill.map_or(1.0, |fill| fill.as_slice()[voxel].clamp(0.0, 1.0));
    let is_cell = |voxel: usize| organs.as_slice()[voxel] != NO_ORGAN && fill_of(voxel) >= LEAST_FILL;
    // One more grid point than voxels along each axis, and one around; the first is a corner of a voxel outside.
    let (low, voxels, shape) = grid_around(organs.shape(), is_cell, 1)?;
    let first = Vector3::from([0, 1, 2].map(|axis| low[axis] as f64 - 1.5));
    let grid = Grid { shape, affine: organs.grid().affine.shifted(first) };

    // The cell above grid point (i, j, k) is voxel (i, j, k) - 1 of the bounding box.
    let mut organ_of_cell = vec![NO_ORGAN; shape.len()];
    let mut fill_of_cell = vec![0.0; shape.len()];
    let planes =
        organ_of_cell.par_chunks_mut(shape.nx * shape.ny).zip(fill_of_cell.par_chunks_mut(shape.nx * shape.ny));
    planes.enumerate().filter(|(k, _)| (1..=voxels[2]).contains(k)).for_each(|(k, (organ, fill))| {
        for j in 1..=voxels[1] {
            for i in 1..=voxels[0] {
                let voxel = organs.shape().linear([low[0] + i - 1, low[1] + j - 1, low[2] + k - 1]);
                if is_cell(voxel) {
                    organ[j * shape.nx + i] = organs.as_slice()[voxel];
                    fill[j * shape.nx + i] = fill_of(voxel);
                }
            }
        }
    });

    let exists = |point: usize| cells_around(shape, point).any(|cell| organ_of_cell[cell] != NO_ORGAN);
    let organ_at: Vec<u8> = owners(shape, &organ_of_cell, &fill_of_cell);
    let springs = |point: usize| {
        let ijk = shape.ijk(point);
        (0..NEIGHBOURS)
            .filter(|&direction| {
                cells_of_spring(shape, ijk, OFFSETS[direction]).any(|cell| organ_of_cell[cell] != NO_ORGAN)
            })
            .fold(0, |bits, direction| bits | 1 << direction)
    };
    let mut lattice = lattice_of(grid, pitch_mm, exists, |point| organ_at[point], springs);
    lattice.cell_organ = lattice.points.iter().map(|&point| organ_of_cell[point as usize]).collect();
    lattice.cell_fill = lattice.points.iter().map(|&point| fill_of_cell[point as usize]).collect();
    Ok(lattice)
}

/// Share of every grid point that one organ fills: the mean fill of the eight cells around it, 0 to 1. Shape `[grid points]`.
///
/// # Panics
/// If the lattice has no cells.
pub fn shares(lattice: &Lattice, organ: u8) -> Vec<f32> {
    assert!(lattice.has_cells(), "shares are those of cells");
    let shape = lattice.grid.shape;
    (0..shape.len())
        .into_par_iter()
        .map(|point| {
            let filled = cells_around(shape, point).map(|cell| match lattice.particle_at[cell] {
                NO_PARTICLE => 0.0,
                particle if lattice.cell_organ[particle as usize] != organ => 0.0,
                particle => lattice.cell_fill[particle as usize],
            });
            filled.sum::<f32>() / 8.0
        })
        .collect()
}

/// Organ of each grid point, or [`FRINGE`].
fn owners(shape: GridShape, organ_of_cell: &[u8], fill_of_cell: &[f32]) -> Vec<u8> {
    let by_share: Vec<u8> = (0..shape.len())
        .into_par_iter()
        .map(|point| {
            let mut shares = [(FRINGE, 0.0_f32); 8];
            let mut total = 0.0;
            for cell in cells_around(shape, point).filter(|&cell| organ_of_cell[cell] != NO_ORGAN) {
                let organ = organ_of_cell[cell];
                let known = shares.iter().position(|share| [organ, FRINGE].contains(&share.0)).unwrap_or(7);
                shares[known] = (organ, shares[known].1 + fill_of_cell[cell]);
                total += fill_of_cell[cell];
            }
            if total < 4.0 {
                return FRINGE;
            }
            // The earlier organ on a tie.
            shares
                .iter()
                .fold((FRINGE, 0.0), |best, &(organ, share)| {
                    if share > best.1 || (share == best.1 && organ < best.0) { (organ, share) } else { best }
                })
                .0
        })
        .collect();
    // What a thin cell claims, decided by the shares alone, so that the order of the cells does not matter; the lowest
    // organ that claims a point gets it.
    let claims: Vec<u8> = (0..shape.len())
        .into_par_iter()
        .map(|point| {
            let thin = |cell: usize| {
                let organ = organ_of_cell[cell];
                organ != NO_ORGAN && super::build::corners(shape, cell).iter().all(|&corner| by_share[corner] != organ)
            };
            cells_around(shape, point)
                .filter(|&cell| thin(cell))
                .map(|cell| organ_of_cell[cell])
                .min()
                .unwrap_or(FRINGE)
        })
        .collect();
    by_share.into_iter().zip(claims).map(|(organ, claim)| if claim == FRINGE { organ } else { claim }).collect()
}

/// The up to eight cells that have this grid point as a corner, by the grid point below them.
pub(crate) fn cells_around(shape: GridShape, point: usize) -> impl Iterator<Item = usize> {
    let ijk = shape.ijk(point);
    (0..8_usize).filter_map(move |c| {
        let back = [c & 1, c >> 1 & 1, c >> 2];
        (0..3).all(|axis| ijk[axis] >= back[axis]).then(|| shape.linear([0, 1, 2].map(|axis| ijk[axis] - back[axis])))
    })
}

/// The cells that a spring from `ijk` along `offset` is part of (4, 2 or 1 of them inside the grid).
pub(crate) fn cells_of_spring(shape: GridShape, ijk: [usize; 3], offset: [i32; 3]) -> impl Iterator<Item = usize> {
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
    use crate::geometry::Affine;
    use crate::lattice::neighbours::{ALL_ALIVE, family, opposite};

    fn map(shape: GridShape, inside: impl Fn([usize; 3]) -> u8) -> OrganMap {
        let grid = Grid { shape, affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        Volume::from_vec(grid, (0..shape.len()).map(|l| inside(shape.ijk(l))).collect())
    }

    #[test]
    fn one_voxel_is_one_cell() {
        let lattice =
            build_cells(&map(GridShape::new(3, 3, 3), |ijk| if ijk == [1, 1, 1] { 0 } else { NO_ORGAN }), None);
        let lattice = lattice.unwrap();
        assert_eq!(lattice.len(), 8);
        assert_eq!(lattice.rest_place(0), crate::geometry::Point3::new(1.0, 1.0, 1.0), "its lowest corner");
        assert_eq!(lattice.organ, [0; 8], "nothing else would draw it");
        let mut families = [0; 3];
        for bits in lattice.springs.iter() {
            (0..NEIGHBOURS).filter(|d| bits >> d & 1 == 1).for_each(|d| families[family(d) - 1] += 1);
        }
        assert_eq!(families.map(|count| count / 2), [12, 12, 4]);
        assert_eq!(lattice.cell_organ.iter().filter(|&&organ| organ == 0).count(), 1);
        assert_eq!(lattice.cell_organ[0], 0, "the cell is the one above its lowest corner");
    }

    #[test]
    fn a_block_has_a_corner_layer_more_and_blunt_edges() {
        let n = 4;
        let lattice = build_cells(&map(GridShape::new(n, n, n), |_| 0), None).unwrap();
        assert_eq!(lattice.len(), (n + 1).pow(3));
        assert_eq!(lattice.springs[lattice.particle_at[lattice.grid.shape.linear([3, 3, 3])] as usize], ALL_ALIVE);
        // Points on faces are half tissue and belong to it; those on edges (1/4) and corners (1/8) lie beyond the border.
        let fringe = lattice.organ.iter().filter(|&&organ| organ == FRINGE).count();
        assert_eq!(fringe, 12 * (n - 1) + 8);
    }

    #[test]
    fn thin_parts_stay_and_the_earlier_organ_takes_the_wall() {
        // Organ 1 is one voxel thick between two blocks of organ 0.
        let sandwich = build_cells(&map(GridShape::new(7, 4, 4), |[i, ..]| u8::from(i == 3)), None).unwrap();
        let of_layer = |i: usize| sandwich.organ[sandwich.particle_at[sandwich.grid.shape.linear([i, 3, 3])] as usize];
        assert_eq!([3, 4, 5, 6].map(of_layer), [0, 1, 1, 0], "the sheet keeps both its faces");
        let halves = build_cells(&map(GridShape::new(6, 4, 4), |[i, ..]| u8::from(i >= 3)), None).unwrap();
        let of_layer = |i: usize| halves.organ[halves.particle_at[halves.grid.shape.linear([i, 3, 3])] as usize];
        assert_eq!([3, 4, 5].map(of_layer), [0, 0, 1]);
    }

    #[test]
    fn springs_are_symmetric_and_join_particles() {
        let blob = map(GridShape::new(6, 7, 8), |[i, j, k]| match (i * 7 + j * 5 + k * 3) % 4 {
            0 => NO_ORGAN,
            1 => 1,
            _ => 0,
        });
        let lattice = build_cells(&blob, None).unwrap();
        for particle in 0..lattice.len() as u32 {
            for direction in (0..NEIGHBOURS).filter(|d| lattice.springs[particle as usize] >> d & 1 == 1) {
                let other = lattice.neighbour(particle, direction).expect("both ends exist");
                assert_eq!(lattice.springs[other as usize] >> opposite(direction) & 1, 1);
            }
        }
    }

    #[test]
    fn organs_a_voxel_apart_are_not_joined() {
        let lattice =
            build_cells(&map(GridShape::new(5, 2, 2), |[i, ..]| if i == 2 { NO_ORGAN } else { 0 }), None).unwrap();
        let layer = |particle: u32| lattice.ijk(particle)[0];
        for particle in (0..lattice.len() as u32).filter(|&p| layer(p) == 3) {
            for direction in (0..NEIGHBOURS).filter(|d| lattice.springs[particle as usize] >> d & 1 == 1) {
                assert!(layer(lattice.neighbour(particle, direction).unwrap()) <= 3);
            }
        }
    }

    #[test]
    fn fill_is_kept_and_traces_are_left_out() {
        let organs = map(GridShape::new(3, 1, 1), |_| 0);
        let fill = Volume::from_vec(*organs.grid(), vec![1.0, 0.25, 0.001]);
        let lattice = build_cells(&organs, Some(&fill)).unwrap();
        let cells: Vec<f32> = lattice.cell_fill.iter().copied().filter(|&fill| fill > 0.0).collect();
        assert_eq!(cells, [1.0, 0.25]);
        assert_eq!(lattice.len(), 12);
        let nothing = Volume::from_vec(*organs.grid(), vec![0.0; 3]);
        assert_eq!(build_cells(&organs, Some(&nothing)).unwrap_err(), BuildLatticeError::Empty);
    }
}
