//! Whether a label map, or a volume of moduli or densities, lies on the voxels of the volume it belongs to.

use crate::geometry::{Grid, GridShape, Point3};

/// How far the voxels of two grids may lie apart and still count as the same [voxels]: far above the rounding of f32
/// headers and of programs that write an affine as text, far below anything a surface would show.
pub const SAME_GRID_TOLERANCE: f64 = 1e-3;

/// What is laid over the voxels of another volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overlay {
    /// A label map over its CT.
    Labels,
    /// Young's moduli over the volume of a scene.
    Moduli,
    /// Densities over the volume of a scene.
    Densities,
}

impl Overlay {
    fn name(self) -> &'static str {
        match self {
            Self::Labels => "the label map",
            Self::Moduli => "the volume of moduli",
            Self::Densities => "the volume of densities",
        }
    }

    fn under(self) -> &'static str {
        match self {
            Self::Labels => "the CT",
            Self::Moduli | Self::Densities => "the scene's volume",
        }
    }

    /// What to do about different numbers of voxels.
    fn mend_shape(self) -> &'static str {
        match self {
            Self::Labels => {
                "resample the labels to the CT's grid (nearest neighbour) or give the CT they were drawn on"
            }
            Self::Moduli => {
                "resample the moduli to the grid of the scene's image or labels (linear), or name the volume they were \
                 measured on in [volume]"
            }
            Self::Densities => {
                "resample the densities to the grid of the scene's image or labels (linear), or name the volume they \
                 belong to in [volume]"
            }
        }
    }

    /// What to do about other places.
    fn mend_place(self) -> &'static str {
        match self {
            Self::Labels => "resample the labels to the CT's grid or correct the affine of one of the files",
            Self::Moduli => {
                "resample the moduli to the grid of the scene's image or labels, or correct the affine of one of the files"
            }
            Self::Densities => {
                "resample the densities to the grid of the scene's image or labels, or correct the affine of one of the \
                 files"
            }
        }
    }
}

/// Why a volume does not lie on the voxels it belongs to.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GridMismatch {
    /// Different numbers of voxels.
    #[error("{} has {found} voxels, expected {expected} as {} has; {}", overlay.name(), overlay.under(), overlay.mend_shape())]
    Shape {
        /// What was laid over the other.
        overlay: Overlay,
        /// Its voxels.
        found: GridShape,
        /// Voxels of what lies under it.
        expected: GridShape,
    },
    /// The same numbers of voxels at other places.
    #[error(
        "voxel ({}, {}, {}) of {} lies at ({:.3}, {:.3}, {:.3}) mm, expected ({:.3}, {:.3}, {:.3}) mm as in {}: {voxels:.4} \
         voxels apart, more than {SAME_GRID_TOLERANCE} (axes {axes}); {}",
        voxel[0], voxel[1], voxel[2], overlay.name(), found.x, found.y, found.z, expected.x, expected.y, expected.z,
        overlay.under(), overlay.mend_place()
    )]
    Place {
        /// What was laid over the other.
        overlay: Overlay,
        /// The corner voxel that lies farthest off.
        voxel: [usize; 3],
        /// Its place by what was laid over, RAS+ [mm].
        found: Point3,
        /// Its place by what lies under it, RAS+ [mm].
        expected: Point3,
        /// The distance between the two, in voxels of what lies under (largest of the three axes).
        voxels: f64,
        /// Directions of the axes of both, such as "LAS and RAS".
        axes: String,
    },
}

/// Checks that one grid lies on the voxels of another: the same shape, and no voxel more than [`SAME_GRID_TOLERANCE`] off.
///
/// - `under`: the grid that is right; `over`: the grid of `overlay`, which the message speaks of.
///
/// The offset between two affine maps is itself affine, so its largest value is at one of the eight corners.
///
/// # Errors
/// [`GridMismatch`], with both shapes or with the corner that lies farthest off.
pub fn check_same_grid(under: &Grid, over: &Grid, overlay: Overlay) -> Result<(), GridMismatch> {
    if under.shape != over.shape {
        return Err(GridMismatch::Shape { overlay, found: over.shape, expected: under.shape });
    }
    let offset = |voxel: [usize; 3]| {
        let index = Point3::from(voxel.map(|x| x as f64));
        let found = over.affine.apply(index);
        (under.affine.index_of(found) - index).amax()
    };
    let last = under.shape.dims().map(|n| n.saturating_sub(1));
    let corners = (0..8).map(|corner| std::array::from_fn(|axis| if corner >> axis & 1 == 1 { last[axis] } else { 0 }));
    let worst = corners.map(|voxel| (voxel, offset(voxel))).max_by(|a, b| a.1.total_cmp(&b.1));
    match worst {
        Some((voxel, voxels)) if voxels > SAME_GRID_TOLERANCE => {
            let index = Point3::from(voxel.map(|x| x as f64));
            Err(GridMismatch::Place {
                overlay,
                voxel,
                found: over.affine.apply(index),
                expected: under.affine.apply(index),
                voxels,
                axes: format!("{} and {}", over.affine.axis_codes(), under.affine.axis_codes()),
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
        let labels_on = |spacing, origin| check_same_grid(&ct, &grid(spacing, origin), Overlay::Labels);
        assert_eq!(labels_on([2.0, 2.0, 2.0], [0.0019, 0.0, 0.0]), Ok(()));
        assert!(labels_on([2.0, 2.0, 2.0], [0.0021, 0.0, 0.0]).is_err());
        // A spacing off by 1e-5 is too much only because the far corner is 100 voxels away.
        assert_eq!(labels_on([2.000_019, 2.0, 2.0], [0.0; 3]), Ok(()));
        assert!(labels_on([2.000_021, 2.0, 2.0], [0.0; 3]).is_err());
    }

    #[test]
    fn messages_say_what_differs() {
        let ct = grid([2.0, 2.0, 2.0], [0.0; 3]);
        let mirrored = grid([-2.0, 2.0, 2.0], [200.0, 0.0, 0.0]);
        let other = Grid { shape: GridShape::new(101, 51, 12), affine: ct.affine.shifted(Vector3::zeros()) };
        for (overlay, own, others) in [
            (Overlay::Labels, ["the label map", "the CT", "resample the labels"], "moduli"),
            (Overlay::Moduli, ["the volume of moduli", "the scene's volume", "resample the moduli"], "label map"),
            (
                Overlay::Densities,
                ["the volume of densities", "the scene's volume", "resample the densities"],
                "label map",
            ),
        ] {
            let message = |grid: &Grid| check_same_grid(&ct, grid, overlay).unwrap_err().to_string();
            for (message, values) in [
                (message(&mirrored), ["LAS and RAS", "200.000", "100.0000 voxels"].as_slice()),
                (message(&other), &["101x51x12", "101x51x11"]),
            ] {
                for part in own.iter().chain(values) {
                    assert!(message.contains(part), "{part} is not in: {message}");
                }
                assert!(!message.contains(others), "{message}");
            }
        }
    }
}
