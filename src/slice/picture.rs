//! Paints a slice: greys, tints, contours, letters and a scale bar.

use std::collections::BTreeMap;

use image::RgbImage;
use rayon::prelude::*;

use super::contour::contour;
use super::deformed::{Carried, CarriedRaster};
use super::sample::{nearest, trilinear};
use super::{Raster, SliceError};
use crate::geometry::Point3;
use crate::plot::canvas::{Canvas, Color, mix, srgb};
use crate::plot::legend::Legend;
use crate::surface::mesh::TriangleMesh;
use crate::volume::{CtVolume, LabelVolume};

/// Grey of a label without CT, and of unlabelled voxels.
const LABEL_GREY: [u8; 2] = [40, 150];
/// Brightness of what is not simulated, beside carried tissue.
const DIMMED: f64 = 0.4;
const INK: Color = [255, 236, 120];
const SHADE: Color = [0, 0, 0];

/// Which values are shown, from black to white: linear and exact, as in DICOM PS3.3 C.11.2.1.3.2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Value shown as middle grey [HU].
    pub center: f32,
    /// Range from black to white [HU].
    pub width: f32,
}

impl Window {
    /// Abdomen: -160 to 240 HU.
    pub const SOFT_TISSUE: Self = Self { center: 40.0, width: 400.0 };
    /// Bone: -500 to 1300 HU.
    pub const BONE: Self = Self { center: 400.0, width: 1800.0 };
    /// Lung: -1350 to 150 HU.
    pub const LUNG: Self = Self { center: -600.0, width: 1500.0 };

    /// The grey of a value; NaN is black.
    pub fn grey(self, value: f32) -> u8 {
        let share = (value - self.center) / self.width + 0.5;
        (255.0 * share.clamp(0.0, 1.0)).round() as u8
    }
}

/// How labelled voxels are coloured.
#[derive(Debug, Clone, PartialEq)]
pub struct Tint {
    /// Linear RGB in 0..=1 of each tinted label; other labels are left grey.
    pub colors: BTreeMap<u16, [f32; 3]>,
    /// From 0, all grey, to 1, all colour.
    pub alpha: f64,
}

/// What a slice shows. Volumes may lie on different grids; each is sampled in patient space.
#[derive(Clone, Copy)]
pub struct SlicePicture<'a> {
    /// The CT; without it, labels give the greys.
    pub ct: Option<&'a CtVolume>,
    /// The labels.
    pub labels: Option<&'a LabelVolume>,
    /// Which HU are black and white.
    pub window: Window,
    /// Colours of the labels; `None` leaves them grey.
    pub tint: Option<&'a Tint>,
    /// The deformation, mapped for the same raster; `None` shows rest. What is not simulated is dimmed, and what tissue has left
    /// is black.
    pub carried: Option<&'a CarriedRaster>,
    /// Meshes whose contour is drawn over, each in its colour, linear RGB in 0..=1.
    pub contours: &'a [(&'a TriangleMesh, [f32; 3])],
    /// Whether letters and the scale bar are drawn.
    pub annotate: bool,
}

impl<'a> SlicePicture<'a> {
    /// The CT at rest in the soft-tissue window, with letters and scale bar.
    pub fn of_ct(ct: &'a CtVolume) -> Self {
        let window = Window::SOFT_TISSUE;
        Self { ct: Some(ct), labels: None, window, tint: None, carried: None, contours: &[], annotate: true }
    }

    /// The labels at rest as greys, with letters and scale bar.
    pub fn of_labels(labels: &'a LabelVolume) -> Self {
        let window = Window::SOFT_TISSUE;
        Self { ct: None, labels: Some(labels), window, tint: None, carried: None, contours: &[], annotate: true }
    }

    /// Draws the picture, one pixel of it per pixel of the raster, in sRGB.
    ///
    /// # Errors
    /// If there is no volume, the window is empty or not finite, or the deformation was mapped for another raster.
    pub fn draw(&self, raster: &Raster) -> Result<RgbImage, SliceError> {
        let Window { center, width } = self.window;
        if !(center.is_finite() && width.is_finite() && width > 0.0) {
            return Err(SliceError::Window { center, width });
        }
        if self.ct.is_none() && self.labels.is_none() {
            return Err(SliceError::NoVolume);
        }
        if let Some(carried) = self.carried
            && carried.pixels().len() != raster.len()
        {
            return Err(SliceError::CarriedSize { found: carried.pixels().len(), expected: raster.len() });
        }
        let tints: BTreeMap<u16, Color> = match self.tint {
            Some(tint) => tint.colors.iter().map(|(&label, &color)| (label, srgb(color))).collect(),
            None => BTreeMap::new(),
        };
        let mut canvas = Canvas::new(raster.width, raster.height, SHADE);
        let columns = raster.width as usize;
        canvas.picture.par_chunks_mut(3 * columns).enumerate().for_each(|(row, pixels)| {
            for (column, pixel) in pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let place = raster.place(column as u32, row as u32);
                *pixel = match self.carried.map(|carried| carried.pixels()[row * columns + column]) {
                    None => self.color(place, &tints),
                    Some(Carried::From(rest)) => self.color(rest, &tints),
                    Some(Carried::Left) => SHADE,
                    Some(Carried::Elsewhere) => mix(SHADE, self.color(place, &BTreeMap::new()), DIMMED),
                };
            }
        });
        for (mesh, color) in self.contours {
            let axis = raster.plane.axis;
            // Canvas places are corners of pixels, raster places their middles.
            let place = |p: Point3| raster.pixel_of(p).map(|at| at + 0.5);
            let segments: Vec<_> =
                contour(mesh, axis, raster.plane.at_mm).into_iter().map(|ends| ends.map(place)).collect();
            canvas.lines(&segments, 1.4, srgb(*color), 1.0);
        }
        if self.annotate {
            annotate(&mut canvas, raster);
        }
        Ok(canvas.picture)
    }

    /// The colour of a place at rest.
    fn color(&self, place: Point3, tints: &BTreeMap<u16, Color>) -> Color {
        let label = self.labels.and_then(|labels| nearest(labels, place));
        let grey = match (self.ct, label) {
            (Some(ct), _) => trilinear(ct, place).map_or(0, |value| self.window.grey(value)),
            (None, Some(label)) => LABEL_GREY[usize::from(label != 0)],
            (None, None) => 0,
        };
        match label.and_then(|label| tints.get(&label)) {
            Some(&color) => mix([grey; 3], tinted(color, grey), self.tint.map_or(0.0, |tint| tint.alpha)),
            None => [grey; 3],
        }
    }
}

/// A colour as dark as the grey it stands for, so that structure shows through the tint.
fn tinted(color: Color, grey: u8) -> Color {
    mix(color, mix(SHADE, color, f64::from(grey) / 160.0), 0.6)
}

/// Draws the letters of the sides, where the plane is, and a scale bar.
fn annotate(canvas: &mut Canvas, raster: &Raster) {
    let caption = format!("{} = {:.1} mm", raster.plane.axis, raster.plane.at_mm);
    let (letters, pixel_mm) = (raster.plane.axis.letters(), raster.plane.pixel_mm);
    Legend { letters, caption: &caption, pixel_mm, ink: INK, shade: SHADE }.draw(canvas);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::slice::{SliceAxis, SlicePlane};

    #[test]
    fn the_window_is_linear_between_its_ends() {
        let window = Window::SOFT_TISSUE;
        assert_eq!(
            [-1000.0, -160.0, -60.0, 40.0, 140.0, 240.0, 3000.0].map(|v| window.grey(v)),
            [0, 0, 64, 128, 191, 255, 255]
        );
        assert_eq!(window.grey(f32::NAN), 0);
    }

    #[test]
    fn wrong_requests_are_refused() {
        let grid = Grid { shape: GridShape::new(4, 4, 4), affine: Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap() };
        let ct = CtVolume::from_vec(grid, vec![0.0; 64]);
        let raster = SlicePlane { axis: SliceAxis::Z, at_mm: 1.0, pixel_mm: 1.0 }.raster(&grid).unwrap();
        let picture = SlicePicture::of_ct(&ct);
        let narrow = SlicePicture { window: Window { center: 0.0, width: 0.0 }, ..picture };
        assert!(matches!(narrow.draw(&raster), Err(SliceError::Window { .. })));
        assert_eq!(SlicePicture { ct: None, ..picture }.draw(&raster).unwrap_err(), SliceError::NoVolume);
        let other = SlicePlane { axis: SliceAxis::Z, at_mm: 1.0, pixel_mm: 0.5 }.raster(&grid).unwrap();
        let carried = CarriedRaster::from_fn(&other, Carried::From);
        let found = SlicePicture { carried: Some(&carried), ..picture }.draw(&raster).unwrap_err();
        assert_eq!(found, SliceError::CarriedSize { found: 64, expected: 16 });
    }

    #[test]
    fn left_tissue_is_black_and_what_is_not_simulated_is_dimmed() {
        let grid = Grid { shape: GridShape::new(3, 1, 1), affine: Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap() };
        let ct = CtVolume::from_vec(grid, vec![240.0, 240.0, 40.0]);
        let raster = SlicePlane { axis: SliceAxis::Z, at_mm: 0.0, pixel_mm: 1.0 }.raster(&grid).unwrap();
        let carried = CarriedRaster::from_fn(&raster, |place| match place.x {
            x if x < 0.5 => Carried::Left,
            x if x < 1.5 => Carried::From(Point3::new(2.0, 0.0, 0.0)),
            _ => Carried::Elsewhere,
        });
        let picture = SlicePicture { carried: Some(&carried), annotate: false, ..SlicePicture::of_ct(&ct) };
        let drawn = picture.draw(&raster).unwrap();
        // Columns run from the patient's right, the highest x.
        assert_eq!([0, 1, 2].map(|x| drawn.get_pixel(x, 0)[0]), [51, 128, 0]);
    }
}
