//! Where the pixels of a slice lie in the patient.

use std::fmt;

use super::SliceError;
use crate::geometry::{Grid, Point3, Vector3};

/// The most pixels of a slice: a picture of 8192 x 8192.
const MOST_PIXELS: u64 = 1 << 26;

/// The patient axis a slice lies across.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SliceAxis {
    /// Right-left: sagittal slices.
    X,
    /// Front-back: coronal slices.
    Y,
    /// Head-foot: axial slices.
    Z,
}

impl SliceAxis {
    /// The axis as a coordinate number: 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Directions in which columns and rows of the picture grow, RAS+.
    fn directions(self) -> [Vector3; 2] {
        match self {
            Self::X => [-Vector3::y(), -Vector3::z()],
            Self::Y => [-Vector3::x(), -Vector3::z()],
            Self::Z => [-Vector3::x(), -Vector3::y()],
        }
    }

    /// Letters at the left, right, top and bottom of the picture: the side of the patient that lies there.
    pub(super) fn letters(self) -> [&'static str; 4] {
        match self {
            Self::X => ["A", "P", "S", "I"],
            Self::Y => ["R", "L", "S", "I"],
            Self::Z => ["R", "L", "A", "P"],
        }
    }
}

impl fmt::Display for SliceAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(["x", "y", "z"][self.index()])
    }
}

/// A plane across a patient axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlicePlane {
    /// The axis it lies across.
    pub axis: SliceAxis,
    /// Its coordinate on that axis, RAS+ [mm].
    pub at_mm: f64,
    /// Edge of a pixel [mm].
    pub pixel_mm: f64,
}

impl SlicePlane {
    /// A plane with pixels that make a picture worth looking at: about 800 of them along the longer side of the grid, more where
    /// they would be coarser than its finest voxels and leave some out.
    pub fn fitting(axis: SliceAxis, at_mm: f64, grid: &Grid) -> Self {
        const LONGER_SIDE: f64 = 800.0;
        let (min, max) = bounds(grid);
        let longest = axis.directions().map(|side| (max - min).dot(&side).abs()).into_iter().fold(0.0, f64::max);
        let finest = grid.affine.spacing().into_iter().fold(f64::INFINITY, f64::min);
        Self { axis, at_mm, pixel_mm: (longest / LONGER_SIDE).min(finest) }
    }

    /// The pixels that cover a grid, voxel borders included.
    ///
    /// # Errors
    /// If the plane misses the grid, or the pixel size is not positive or makes a picture of more than 2^26 pixels.
    pub fn raster(&self, grid: &Grid) -> Result<Raster, SliceError> {
        let Self { axis, at_mm, pixel_mm } = *self;
        if !(pixel_mm > 0.0 && pixel_mm.is_finite()) {
            return Err(SliceError::PixelSize { pixel_mm });
        }
        let (min, max) = bounds(grid);
        let (min_mm, max_mm) = (min[axis.index()], max[axis.index()]);
        if !(min_mm..=max_mm).contains(&at_mm) {
            return Err(SliceError::Outside { axis, at_mm, min_mm, max_mm });
        }
        let [column, row] = axis.directions();
        // Rounding of the bounds must not add a pixel.
        let count = |direction: Vector3| (((max - min).dot(&direction).abs() / pixel_mm) - 1e-6).ceil().max(1.0) as u64;
        let (width, height) = (count(column), count(row));
        if width.saturating_mul(height) > MOST_PIXELS {
            return Err(SliceError::TooLarge { pixel_mm, width, height, limit: MOST_PIXELS });
        }
        // Columns and rows run against the patient axes: the picture begins at their highest coordinates. What the last
        // pixel covers beyond the grid is shared between both sides.
        let slack = |direction: Vector3, count: u64| {
            direction * (0.5 * ((max - min).dot(&direction).abs() - count as f64 * pixel_mm))
        };
        let mut corner = Point3::from(max.coords) + slack(column, width) + slack(row, height);
        corner[axis.index()] = at_mm;
        let first = corner + 0.5 * pixel_mm * (column + row);
        Ok(Raster {
            plane: *self,
            first,
            column: column * pixel_mm,
            row: row * pixel_mm,
            width: width as u32,
            height: height as u32,
        })
    }
}

/// Lowest and highest patient coordinates of a grid's voxels, borders included [mm].
fn bounds(grid: &Grid) -> (Point3, Point3) {
    let [nx, ny, nz] = grid.shape.dims().map(|n| n as f64 - 0.5);
    let corners = (0..8).map(|corner| {
        let pick = |bit: usize, high: f64| if corner >> bit & 1 == 1 { high } else { -0.5 };
        grid.affine.apply(Point3::new(pick(0, nx), pick(1, ny), pick(2, nz)))
    });
    let start = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    corners.fold(start, |(min, max), corner| (min.inf(&corner), max.sup(&corner)))
}

/// The pixels of a slice in patient space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Raster {
    /// The plane they lie in.
    pub plane: SlicePlane,
    /// Middle of the first pixel (upper left), RAS+ [mm].
    pub first: Point3,
    /// From a pixel to the next in its row, RAS+ [mm].
    pub column: Vector3,
    /// From a pixel to the one below, RAS+ [mm].
    pub row: Vector3,
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Raster {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// True when there is no pixel (never, for a raster of [`SlicePlane::raster`]).
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Middle of a pixel, RAS+ [mm].
    pub fn place(&self, x: u32, y: u32) -> Point3 {
        self.first + f64::from(x) * self.column + f64::from(y) * self.row
    }

    /// Column and row of a place, with fractions; whole numbers are the middles of pixels. The part across the plane is dropped.
    pub fn pixel_of(&self, place: Point3) -> [f64; 2] {
        let offset = place - self.first;
        [self.column, self.row].map(|step| offset.dot(&step) / step.norm_squared())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, GridShape};

    fn grid() -> Grid {
        let affine = Affine::from_spacing([-1.0, 2.0, 3.0], [10.0, 20.0, 30.0]).unwrap();
        Grid { shape: GridShape::new(10, 20, 30), affine }
    }

    #[test]
    fn pixels_cover_the_voxels_and_know_their_place() {
        let raster = SlicePlane { axis: SliceAxis::Z, at_mm: 33.0, pixel_mm: 1.0 }.raster(&grid()).unwrap();
        assert_eq!((raster.width, raster.height), (10, 40));
        // x from 0.5 to 10.5 and y from 19 to 59: the first pixel is the patient's front right.
        assert_eq!(raster.place(0, 0), Point3::new(10.0, 58.5, 33.0));
        assert_eq!(raster.pixel_of(Point3::new(8.0, 50.0, 77.0)), [2.0, 8.5]);
    }

    #[test]
    fn what_the_last_pixel_covers_beyond_is_shared() {
        let raster = SlicePlane { axis: SliceAxis::Y, at_mm: 20.0, pixel_mm: 4.0 }.raster(&grid()).unwrap();
        assert_eq!((raster.width, raster.height), (3, 23));
        // 12 mm of pixels over x from 0.5 to 10.5: one more on each side.
        assert_eq!(raster.place(0, 0).x, 11.5 - 2.0);
    }

    #[test]
    fn planes_outside_and_absurd_pixels_are_refused() {
        let plane = |at_mm, pixel_mm| SlicePlane { axis: SliceAxis::X, at_mm, pixel_mm }.raster(&grid());
        assert_eq!(
            plane(11.0, 1.0),
            Err(SliceError::Outside { axis: SliceAxis::X, at_mm: 11.0, min_mm: 0.5, max_mm: 10.5 })
        );
        assert!(matches!(plane(f64::NAN, 1.0), Err(SliceError::Outside { .. })));
        assert!(matches!(plane(1.0, 0.0), Err(SliceError::PixelSize { .. })));
        assert!(matches!(plane(1.0, 1e-4), Err(SliceError::TooLarge { .. })));
        assert!(matches!(plane(1.0, 1e-300), Err(SliceError::TooLarge { .. })));
    }
}
