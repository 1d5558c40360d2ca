//! Whether a label map and a CT lie on the same voxels.

use crate::geometry::{Grid, GridShape, Point3};

/// How far the voxels of two grids may lie apart and still count as the same [voxels]: far above the rounding of f32
/// headers and of programs that write an affine as text, far below anything a surface would show.
pub const SAME_GRID_TOLERANCE: f64 = 1e-3;

/// Why a label map does not lie on the voxels of a CT.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GridMismatch {
    /// Different numbers of voxels.
    #[error(
        "the label map has {found} voxels, expected {expected} as the CT has; resample the labels to the CT's grid \
         (nearest neighbour) or give the CT they were drawn on"
    )]
    Shape {
        /// Voxels of the label map.
        found: GridShape,
        /// Voxels of the CT.
        expected: GridShape,
    },
    /// The same numbers of voxels at other places.
    #[error(
        "voxel ({}, {}, {}) of the label map lies at ({:.3}, {:.3}, {:.3}) mm, expected ({:.3}, {:.3}, {:.3}) mm as in \
         the CT: {voxels:.4} voxels apart, more than {SAME_GRID_TOLERANCE} (axes {axes}); resample the labels to the CT's grid or correct the affine of one of the files",
        voxel[0], voxel[1], voxel[2], found.x, found.y, found.z, expected.x, expected.y, expected.z
    )]
    Place {
        /// The corner voxel that lies farthest off.
        voxel: [usize; 3],
        /// Its place by the label map, RAS+ [mm].
        found: Point3,
        /// Its place by the CT, RAS+ [mm].
        expected: Point3,
        /// The distance between the two, in voxels of the CT (largest of the three axes).
        voxels: f64,
        /// Directions of the axes of both, such as "LAS and RAS".
        axes: String,
    },
}

/// Checks that labels lie on the voxels of a CT: the same shape, and no voxel more than [`SAME_GRID_TOLERANCE`] off.
///
/// The offset between two affine maps is itself affine, so its largest value is at one of the eight corners.
///
/// # Errors
/// [`GridMismatch`], with both shapes or with the corner that lies farthest off.
pub fn check_same_grid(ct: &Grid, labels: &Grid) -> Result<(), GridMismatch> {
    if ct.shape != labels.shape {
        return Err(GridMismatch::Shape { found: labels.shape, expected: ct.shape });
    }
    let offset = |voxel: [usize; 3]| {
        let index = Point3::from(voxel.map(|x| x as f64));
        let found = labels.affine.apply(index);
        (ct.affine.index_of(found) - index).amax()
    };
    let last = ct.shape.dims().map(|n| n.saturating_sub(1));
    let corners = (0..8).map(|corner| std::array::from_fn(|axis| if corner >> axis & 1 == 1 { last[axis] } else { 0 }));
    let worst = corners.map(|voxel| (voxel, offset(voxel))).max_by(|a, b| a.1.total_cmp(&b.1));
    match worst {
        Some((voxel, voxels)) if voxels > SAME_GRID_TOLERANCE => {
            let index = Point3::from(voxel.map(|x| x as f64));
            Err(GridMismatch::Place {
                voxel,
                found: labels.affine.apply(index),
                expected: ct.affine.apply(index),
                voxels,
                axes: format!("{} and {}", labels.affine.axis_codes(), ct.affine.axis_codes()),
            })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Vector3};

    fn grid(spacing: [f64; 3], origin: [f64; 3]) -> Grid {
        Grid { shape: GridShape::new(101, 51, 11), affine: Affine::from_spacing(spacing, origin).unwrap() }
    }

    #[test]
    fn the_tolerance_is_a_thousandth_of_a_voxel() {
        let ct = grid([2.0, 2.0, 2.0], [0.0; 3]);
        assert_eq!(check_same_grid(&ct, &grid([2.0, 2.0, 2.0], [0.0019, 0.0, 0.0])), Ok(()));
        assert!(check_same_grid(&ct, &grid([2.0, 2.0, 2.0], [0.0021, 0.0, 0.0])).is_err());
        // A spacing off by 1e-5 is too much only because the far corner is 100 voxels away.
        assert_eq!(check_same_grid(&ct, &grid([2.000_019, 2.0, 2.0], [0.0; 3])), Ok(()));
        assert!(check_same_grid(&ct, &grid([2.000_021, 2.0, 2.0], [0.0; 3])).is_err());
    }

    #[test]
    fn messages_say_what_differs() {
        let ct = grid([2.0, 2.0, 2.0], [0.0; 3]);
        let message = check_same_grid(&ct, &grid([-2.0, 2.0, 2.0], [200.0, 0.0, 0.0])).unwrap_err().to_string();
        for part in ["LAS and RAS", "200.000", "100.0000 voxels"] {
            assert!(message.contains(part), "{part} is not in: {message}");
        }
        let other = Grid { shape: GridShape::new(101, 51, 12), affine: ct.affine.shifted(Vector3::zeros()) };
        let message = check_same_grid(&ct, &other).unwrap_err().to_string();
        assert!(message.contains("101x51x12") && message.contains("101x51x11"), "{message}");
    }
}
