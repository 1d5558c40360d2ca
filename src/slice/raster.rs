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
        let (min, max) = bounds(grid);
        let longest = axis.directions().map(|side| (max - min).dot(&side).abs()).into_iter().fold(0.0, f64::max);
        Self { axis, at_mm, pixel_mm: fitting_pixel(longest, grid) }
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
        let plane = Plane::across(axis, at_mm);
        Ok(Raster {
            plane,
            first,
            column: column * pixel_mm,
            row: row * pixel_mm,
            width: width as u32,
            height: height as u32,
        })
    }
}

/// A plane in patient space, with the side it is seen from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point of it, RAS+ [mm].
    pub point: Point3,
    /// Unit normal towards the viewer, RAS+.
    pub normal: Vector3,
    /// The patient axis it lies across, for those of [`SlicePlane`].
    pub axis: Option<SliceAxis>,
}

impl Plane {
    /// The plane across a patient axis, at this coordinate [mm], seen as [`SlicePlane`]s are.
    pub fn across(axis: SliceAxis, at_mm: f64) -> Self {
        let mut point = Point3::origin();
        point[axis.index()] = at_mm;
        let [column, row] = axis.directions();
        Self { point, normal: row.cross(&column), axis: Some(axis) }
    }

    /// Distance of a place from the plane, positive towards the viewer [mm].
    pub fn height(&self, place: Point3) -> f64 {
        match self.axis {
            // Exact for places in the plane, wherever the origin is.
            Some(axis) => (place[axis.index()] - self.point[axis.index()]) * self.normal[axis.index()],
            None => (place - self.point).dot(&self.normal),
        }
    }

    /// A place moved into the plane along its normal.
    pub(super) fn onto(&self, mut place: Point3) -> Point3 {
        match self.axis {
            Some(axis) => place[axis.index()] = self.point[axis.index()],
            None => place -= self.height(place) * self.normal,
        }
        place
    }
}

/// Where it lies: `z = 12.0 mm`, or a point and the normal.
impl fmt::Display for Plane {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(axis) = self.axis {
            return write!(f, "{axis} = {:.1} mm", self.point[axis.index()]);
        }
        let ([x, y, z], [nx, ny, nz]): ([f64; 3], [f64; 3]) = (self.point.into(), self.normal.into());
        write!(f, "({x:.1}, {y:.1}, {z:.1}) mm, normal ({nx:.2}, {ny:.2}, {nz:.2})")
    }
}

/// A plane in any direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObliquePlane {
    /// A point of it, RAS+ [mm].
    pub point: Point3,
    /// Towards the viewer, RAS+, of any length.
    pub normal: Vector3,
    /// What is up in the picture, RAS+; the part along the normal is dropped. `None`: the head, or the front in planes that
    /// look along the head within 26 degrees.
    pub up: Option<Vector3>,
    /// Edge of a pixel [mm]; `None` chooses as [`SlicePlane::fitting`] does.
    pub pixel_mm: Option<f64>,
}

impl ObliquePlane {
    /// The pixels that cover what the plane cuts out of a grid, voxel borders included.
    ///
    /// # Errors
    /// If normal and up do not span a plane, the plane misses the grid, or the pixel size is not positive or makes a picture
    /// of more than 2^26 pixels.
    pub fn raster(&self, grid: &Grid) -> Result<Raster, SliceError> {
        let unit = |v: Vector3| v.try_normalize(0.0).filter(|v| v.iter().all(|x| x.is_finite()));
        let refused = || SliceError::Directions { normal: self.normal.into(), up: self.up.map(Into::into) };
        if !self.point.iter().all(|x| x.is_finite()) {
            return Err(SliceError::Missed { point_mm: self.point.into(), normal: self.normal.into() });
        }
        let normal = unit(self.normal).ok_or_else(refused)?;
        let up = self.up.unwrap_or(if normal.z.abs() < 0.9 { Vector3::z() } else { Vector3::y() });
        let up = unit(up).ok_or_else(refused)?;
        let across = up - up.dot(&normal) * normal;
        // Within a thousandth of a radian of the normal nothing is up.
        let up = unit(across).filter(|_| across.norm() > 1e-3).ok_or_else(refused)?;
        let (row, column) = (-up, up.cross(&normal));
        let plane = Plane { point: self.point, normal, axis: None };

        let section = section(grid, &plane);
        let range = |direction: Vector3| {
            let along = section.iter().map(|corner| (corner - self.point).dot(&direction));
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
        };
        let ((left, right), (top, bottom)) = (range(column), range(row));
        if !(left <= right && top <= bottom) {
            return Err(SliceError::Missed { point_mm: self.point.into(), normal: self.normal.into() });
        }
        let pixel_mm = self.pixel_mm.unwrap_or_else(|| fitting_pixel((right - left).max(bottom - top), grid));
        if !(pixel_mm > 0.0 && pixel_mm.is_finite()) {
            return Err(SliceError::PixelSize { pixel_mm });
        }
        let count = |length: f64| (length / pixel_mm - 1e-6).ceil().max(1.0) as u64;
        let (width, height) = (count(right - left), count(bottom - top));
        if width.saturating_mul(height) > MOST_PIXELS {
            return Err(SliceError::TooLarge { pixel_mm, width, height, limit: MOST_PIXELS });
        }
        // What the last pixel covers beyond is shared between both sides.
        let start = |low: f64, high: f64, count: u64| 0.5 * (low + high - (count - 1) as f64 * pixel_mm);
        let first = self.point + start(left, right, width) * column + start(top, bottom, height) * row;
        Ok(Raster {
            plane,
            first,
            column: column * pixel_mm,
            row: row * pixel_mm,
            width: width as u32,
            height: height as u32,
        })
    }
}

/// Corners of what a plane cuts out of a grid's box, in no order; empty where it misses.
fn section(grid: &Grid, plane: &Plane) -> Vec<Point3> {
    let dims = grid.shape.dims().map(|n| n as f64 - 0.5);
    let corner = |bits: usize| {
        grid.affine.apply(Point3::from([0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { dims[axis] } else { -0.5 })))
    };
    let edges = (0..8usize).flat_map(|from| (0..3).map(move |axis| (from, from | 1 << axis)));
    edges
        .filter(|(from, to)| from != to)
        .filter_map(|(from, to)| {
            let (from, to) = (corner(from), corner(to));
            let (below, above) = (plane.height(from), plane.height(to));
            ((below <= 0.0) != (above <= 0.0)).then(|| from + (to - from) * (below / (below - above)))
        })
        .collect()
}

/// A pixel with which the longer side of a picture has about 800 of them, and never coarser than the finest voxels.
fn fitting_pixel(longest_mm: f64, grid: &Grid) -> f64 {
    const LONGER_SIDE: f64 = 800.0;
    let finest = grid.affine.spacing().into_iter().fold(f64::INFINITY, f64::min);
    (longest_mm / LONGER_SIDE).min(finest)
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
    pub plane: Plane,
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

    /// Edge of a pixel [mm].
    pub fn pixel_mm(&self) -> f64 {
        self.column.norm()
    }

    /// Letters at the left, right, top and bottom of the picture: the side of the patient that lies there. Oblique directions
    /// have one for each axis they follow within 75 degrees, the nearest first.
    pub(super) fn letters(&self) -> [String; 4] {
        [-self.column, self.column, -self.row, self.row].map(|direction| {
            let direction = direction / direction.norm();
            let mut axes = [0, 1, 2];
            axes.sort_by(|&a, &b| direction[b].abs().total_cmp(&direction[a].abs()));
            let letter = |axis: usize| ["LR", "PA", "IS"][axis].as_bytes()[usize::from(direction[axis] > 0.0)] as char;
            axes.into_iter().filter(|&axis| direction[axis].abs() > 0.26).map(letter).collect()
        })
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
    fn oblique_planes_along_the_axes_are_those_across_them() {
        for (axis, normal) in
            [(SliceAxis::X, -Vector3::x()), (SliceAxis::Y, Vector3::y()), (SliceAxis::Z, -Vector3::z())]
        {
            let across = SlicePlane { axis, at_mm: 33.0 - 27.0 * f64::from(axis == SliceAxis::X), pixel_mm: 0.5 };
            let across = across.raster(&grid()).unwrap();
            let oblique =
                ObliquePlane { point: across.plane.point, normal: 7.0 * normal, up: None, pixel_mm: Some(0.5) };
            let oblique = oblique.raster(&grid()).unwrap();
            assert_eq!((oblique.width, oblique.height), (across.width, across.height), "{axis}");
            assert!((oblique.place(3, 5) - across.place(3, 5)).norm() < 1e-9, "{axis}");
            assert_eq!(oblique.letters(), across.letters());
            assert!((oblique.plane.normal - across.plane.normal).norm() < 1e-15);
        }
    }

    #[test]
    fn oblique_planes_hold_their_point_and_say_their_sides() {
        let point = Point3::new(5.0, 40.0, 75.0);
        let plane = ObliquePlane { point, normal: Vector3::new(-1.0, 1.0, 0.0), up: None, pixel_mm: Some(0.5) };
        let raster = plane.raster(&grid()).unwrap();
        let [x, y] = raster.pixel_of(point);
        assert!((raster.first + x * raster.column + y * raster.row - point).norm() < 1e-9);
        // Seen from the front left: the right front lies at the left of the picture.
        assert_eq!(raster.letters(), ["RA", "LP", "S", "I"]);
        // The box is 10 mm wide along x: the plane cuts a strip of 10 sqrt 2 out of it, 90 mm high.
        assert_eq!((raster.width, raster.height), (29, 180));
        let refused = |plane: ObliquePlane| plane.raster(&grid()).unwrap_err();
        assert!(matches!(refused(ObliquePlane { normal: Vector3::zeros(), ..plane }), SliceError::Directions { .. }));
        let up = Some(Vector3::new(2.0, -2.0, 0.0));
        assert!(matches!(refused(ObliquePlane { up, ..plane }), SliceError::Directions { .. }));
        let point = Point3::new(90.0, 40.0, 75.0);
        assert!(matches!(refused(ObliquePlane { point, ..plane }), SliceError::Missed { .. }));
        assert!(matches!(refused(ObliquePlane { pixel_mm: Some(1e-5), ..plane }), SliceError::TooLarge { .. }));
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
