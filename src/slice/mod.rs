//! A plane of a volume, at rest or carried by the deformed lattice, as a picture.
//!
//! ```text
//! raster     the pixels of a plane in patient space
//! contour    where the plane cuts the closed surfaces of the organs
//! section    which organ's surface holds each pixel
//! deformed   where the tissue of each pixel was at rest
//! picture    greys of the CT there, colours, lines, letters and bars
//! montage    several of them in one
//! ```
//!
//! Planes follow the patient's axes whatever way the voxels lie, or any direction ([`ObliquePlane`]). The view is the radiological one and does not change:
//! - across x (sagittal): front at the left, head at the top;
//! - across y (coronal): the patient's right at the left of the picture, head at the top;
//! - across z (axial): the patient's right at the left of the picture, front at the top.
//!
//! Letters at the borders say so in every picture. Values between voxels are trilinear, labels nearest; outside the volume is black.
//! Pixels are point samples: a picture much coarser than the voxels leaves voxels out.

pub mod contour;
pub mod deformed;
pub mod montage;
mod picture;
mod raster;
mod sample;
mod section;

pub use picture::{Organs, Overlay, SlicePicture, Tint, Window};
pub use raster::{ObliquePlane, Plane, Raster, SliceAxis, SlicePlane};
pub use section::Section;

/// Why a slice was not drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SliceError {
    /// The plane misses the volume.
    #[error("a slice across {axis} at {at_mm} mm misses the volume, which reaches from {min_mm} to {max_mm} mm")]
    Outside {
        /// The axis across which the plane lies.
        axis: SliceAxis,
        /// Where [mm].
        at_mm: f64,
        /// The volume's lowest coordinate [mm].
        min_mm: f64,
        /// The volume's highest coordinate [mm].
        max_mm: f64,
    },
    /// An oblique plane misses the volume.
    #[error(
        "the plane through {} mm across {} misses the volume; take a point inside it",
        triple(point_mm),
        triple(normal)
    )]
    Missed {
        /// A point of the plane, RAS+ [mm].
        point_mm: [f64; 3],
        /// Its normal.
        normal: [f64; 3],
    },
    /// Normal and up do not span a plane.
    #[error(
        "a plane with normal {} and up {} has no direction; give a normal that is not zero, and another direction for up",
        triple(normal), up.map_or("the default".to_owned(), |up| triple(&up))
    )]
    Directions {
        /// The normal.
        normal: [f64; 3],
        /// What was to be up.
        up: Option<[f64; 3]>,
    },
    /// A pixel has no usable size.
    #[error("a pixel of {pixel_mm} mm cannot be drawn; give a size above 0, such as the volume's spacing")]
    PixelSize {
        /// Edge of a pixel [mm].
        pixel_mm: f64,
    },
    /// More pixels than a picture should have.
    #[error("pixels of {pixel_mm} mm make {width} x {height} of them, more than {limit}; take larger pixels")]
    TooLarge {
        /// Edge of a pixel [mm].
        pixel_mm: f64,
        /// Pixels per row.
        width: u64,
        /// Rows.
        height: u64,
        /// The most a picture may have.
        limit: u64,
    },
    /// The window cannot be applied.
    #[error("a window of width {width} around {center} shows nothing; give a finite centre and a width above 0")]
    Window {
        /// Value shown as middle grey.
        center: f32,
        /// Range from black to white.
        width: f32,
    },
    /// There is nothing to sample.
    #[error("a slice needs a CT volume or a label volume; neither was given")]
    NoVolume,
    /// The map from deformed to rest space was made for another plane.
    #[error("the deformation was mapped for {found} pixels, the slice has {expected}; map it for the same plane")]
    CarriedSize {
        /// Pixels of the map.
        found: usize,
        /// Pixels of the slice.
        expected: usize,
    },
}

fn triple([x, y, z]: &[f64; 3]) -> String {
    format!("({x}, {y}, {z})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_hold_their_values() {
        let cases = [
            (
                SliceError::Outside { axis: SliceAxis::X, at_mm: 12.5, min_mm: -3.0, max_mm: 4.0 }.to_string(),
                vec!["across x at 12.5 mm", "-3 to 4 mm"],
            ),
            (
                SliceError::Missed { point_mm: [1.5, 2.0, 3.0], normal: [0.0, 1.0, 0.0] }.to_string(),
                vec!["(1.5, 2, 3) mm", "(0, 1, 0)"],
            ),
            (
                SliceError::Directions { normal: [0.0; 3], up: Some([0.0, 2.0, 0.0]) }.to_string(),
                vec!["normal (0, 0, 0)", "up (0, 2, 0)"],
            ),
            (SliceError::PixelSize { pixel_mm: -1.0 }.to_string(), vec!["-1 mm"]),
            (
                SliceError::TooLarge { pixel_mm: 0.001, width: 10, height: 20, limit: 5 }.to_string(),
                vec!["0.001 mm", "10 x 20", "more than 5"],
            ),
            (SliceError::Window { center: 40.0, width: 0.0 }.to_string(), vec!["width 0 around 40"]),
            (SliceError::NoVolume.to_string(), vec!["neither"]),
            (SliceError::CarriedSize { found: 3, expected: 4 }.to_string(), vec!["3 pixels", "has 4"]),
        ];
        for (message, parts) in cases {
            for part in parts {
                assert!(message.contains(part), "'{message}' lacks '{part}'");
            }
        }
    }
}
