//! Blocks of one material in air: the paper's cube and a beam. No noise, no partial volume: every voxel is in or out.

use super::{BLOCK_HU, Phantom, PhantomError, label};
use crate::geometry::{Affine, Grid, GridShape};
use crate::volume::Volume;

/// Voxels of air on every side.
const MARGIN: usize = 2;
/// Most voxels along an edge.
pub(super) const LONGEST: usize = 1024;
/// Most voxels of a phantom, air included: 1.6 GB of HU and labels.
pub(super) const MOST_VOXELS: usize = 1 << 28;

/// A block of the given number of voxels along each axis, its centre at the origin.
pub(super) fn block(
    voxels: [usize; 3],
    spacing: f64,
    organ: u16,
    names: &'static [(u16, &'static str)],
) -> Result<Phantom, PhantomError> {
    if let Some(&found) = voxels.iter().find(|n| !(1..=LONGEST).contains(*n)) {
        return Err(PhantomError::BadCount { found, most: LONGEST });
    }
    let dims = voxels.map(|n| n + 2 * MARGIN);
    let total: usize = dims.iter().product();
    if total > MOST_VOXELS {
        return Err(PhantomError::TooLarge { voxels: total, most: MOST_VOXELS });
    }
    let origin = dims.map(|n| -0.5 * (n - 1) as f64 * spacing);
    let affine = Affine::from_spacing([spacing; 3], origin).expect("the spacing was checked");
    let grid = Grid { shape: GridShape::new(dims[0], dims[1], dims[2]), affine };
    let inside = |at: usize| {
        let ijk = grid.shape.ijk(at);
        (0..3).all(|axis| (MARGIN..MARGIN + voxels[axis]).contains(&ijk[axis]))
    };
    let labels: Vec<u16> = (0..total).map(|at| if inside(at) { organ } else { label::AIR }).collect();
    let image = labels.iter().map(|&l| if l == organ { BLOCK_HU } else { -1000.0 }).collect();
    Ok(Phantom { image: Volume::from_vec(grid, image), labels: Volume::from_vec(grid, labels), names })
}
