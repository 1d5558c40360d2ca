//! Paints a slice: greys, tints, contours, letters and a scale bar.

use std::collections::BTreeMap;

use image::RgbImage;
use rayon::prelude::*;

use super::contour::contour;
use super::deformed::{Carried, CarriedRaster};
use super::sample::{nearest, trilinear};
use super::{Raster, Section, SliceError};
use crate::geometry::Point3;
use crate::plot::canvas::{Align, Canvas, Color, mix, srgb};
use crate::plot::color_bar::ColorBar;
use crate::plot::legend::{Legend, text_height};
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

/// The organs of a slice, coloured up to their surfaces.
#[derive(Clone, Copy)]
pub struct Organs<'a> {
    /// Which organ holds each pixel.
    pub section: &'a Section,
    /// Name and colour, linear RGB in 0..=1, of each organ of the section.
    pub list: &'a [(&'a str, [f32; 3])],
    /// From 0, all grey, to 1, all colour.
    pub alpha: f64,
}

/// Values over the CT, where tissue carries them.
#[derive(Clone, Copy)]
pub struct Overlay<'a> {
    /// Colours and range of the values of [`CarriedRaster::values`]; drawn beside the picture's other marks.
    pub bar: &'a ColorBar,
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
    /// The organs by their surfaces; they take the place of the tint. Several are named beside the picture.
    pub organs: Option<Organs<'a>>,
    /// Values over the tissue; they take the place of both.
    pub overlay: Option<Overlay<'a>>,
    /// The deformation, mapped for the same raster; `None` shows rest. What is not simulated is dimmed, and what tissue has left
    /// is black.
    pub carried: Option<&'a CarriedRaster>,
    /// Meshes whose contour is drawn over, each in its colour, linear RGB in 0..=1.
    pub contours: &'a [(&'a TriangleMesh, [f32; 3])],
    /// A second line under the plane's place, such as frame and time; may be empty.
    pub title: &'a str,
    /// Whether letters, title, scale bar, names and colour bar are drawn.
    pub annotate: bool,
}

impl<'a> SlicePicture<'a> {
    /// The CT at rest in the soft-tissue window, with letters and scale bar.
    pub fn of_ct(ct: &'a CtVolume) -> Self {
        Self { ct: Some(ct), ..Self::EMPTY }
    }

    /// The labels at rest as greys, with letters and scale bar.
    pub fn of_labels(labels: &'a LabelVolume) -> Self {
        Self { labels: Some(labels), ..Self::EMPTY }
    }

    const EMPTY: Self = Self {
        ct: None,
        labels: None,
        window: Window::SOFT_TISSUE,
        tint: None,
        organs: None,
        overlay: None,
        carried: None,
        contours: &[],
        title: "",
        annotate: true,
    };

    /// Draws the picture, one pixel of it per pixel of the raster, in sRGB.
    ///
    /// # Errors
    /// If there is no volume, the window is empty or not finite, or deformation or organs belong to another raster.
    pub fn draw(&self, raster: &Raster) -> Result<RgbImage, SliceError> {
        let Window { center, width } = self.window;
        if !(center.is_finite() && width.is_finite() && width > 0.0) {
            return Err(SliceError::Window { center, width });
        }
        if self.ct.is_none() && self.labels.is_none() {
            return Err(SliceError::NoVolume);
        }
        let sizes =
            [self.carried.map(|carried| carried.pixels().len()), self.organs.map(|organs| organs.section.len())];
        if let Some(found) = sizes.into_iter().flatten().find(|&size| size != raster.len()) {
            return Err(SliceError::CarriedSize { found, expected: raster.len() });
        }
        let tints: BTreeMap<u16, Color> = match self.tint {
            Some(tint) => tint.colors.iter().map(|(&label, &color)| (label, srgb(color))).collect(),
            None => BTreeMap::new(),
        };
        let mut canvas = Canvas::new(raster.width, raster.height, SHADE);
        let columns = raster.width as usize;
        canvas.picture.par_chunks_mut(3 * columns).enumerate().for_each(|(row, pixels)| {
            for (column, pixel) in pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let (at, place) = (row * columns + column, raster.place(column as u32, row as u32));
                *pixel = match self.carried.map(|carried| carried.pixels()[at]) {
                    None => self.color(at, place, &tints),
                    Some(Carried::From(rest)) => self.color(at, rest, &tints),
                    Some(Carried::Left) => SHADE,
                    Some(Carried::Elsewhere) => mix(SHADE, [self.grey(place); 3], DIMMED),
                };
            }
        });
        for (mesh, color) in self.contours {
            // Canvas places are corners of pixels, raster places their middles.
            let place = |p: Point3| raster.pixel_of(p).map(|at| at + 0.5);
            let segments: Vec<_> = contour(mesh, &raster.plane).into_iter().map(|ends| ends.map(place)).collect();
            canvas.lines(&segments, 1.4, srgb(*color), 1.0);
        }
        if self.annotate {
            annotate(&mut canvas, raster);
            self.legends(&mut canvas);
        }
        Ok(canvas.picture)
    }

    /// The grey of a place at rest.
    fn grey(&self, place: Point3) -> u8 {
        match (self.ct, self.labels) {
            (Some(ct), _) => trilinear(ct, place).map_or(0, |value| self.window.grey(value)),
            (None, Some(labels)) => nearest(labels, place).map_or(0, |label| LABEL_GREY[usize::from(label != 0)]),
            (None, None) => 0,
        }
    }

    /// The colour of a pixel that shows a place at rest.
    fn color(&self, pixel: usize, place: Point3, tints: &BTreeMap<u16, Color>) -> Color {
        let grey = self.grey(place);
        if let Some(overlay) = self.overlay {
            let value = self.carried.and_then(|carried| carried.values().get(pixel)).filter(|value| !value.is_nan());
            let over = |&value: &f32| mix([grey; 3], tinted(srgb(overlay.bar.rgb(value)), grey), overlay.alpha);
            return value.map_or([grey; 3], over);
        }
        if let Some(organs) = self.organs {
            let color = organs.section.organ(pixel).and_then(|organ| organs.list.get(organ)).map(|organ| srgb(organ.1));
            return color.map_or([grey; 3], |color| mix([grey; 3], tinted(color, grey), organs.alpha));
        }
        match self.labels.and_then(|labels| tints.get(&nearest(labels, place)?)) {
            Some(&color) => mix([grey; 3], tinted(color, grey), self.tint.map_or(0.0, |tint| tint.alpha)),
            None => [grey; 3],
        }
    }

    /// Title, colour bar and the names of several organs.
    fn legends(&self, canvas: &mut Canvas) {
        let [width, height] = canvas.size();
        let Some(text) = text_height(canvas) else { return };
        let (margin, small) = (0.4 * text, 0.75 * text);
        canvas.outlined(self.title, [margin, margin + 1.5 * text], small, Align::Left, [INK, SHADE]);
        if let Some(organs) = self.organs.filter(|organs| organs.list.len() > 1) {
            for (at, &(name, color)) in organs.list.iter().enumerate() {
                let y = margin + (0.5 + 1.1 * at as f64) * small;
                canvas.fill([width - margin - small, y - 0.35 * small], [width - margin, y + 0.35 * small], SHADE, 1.0);
                let inner = [
                    [width - margin - small + 1.0, y - 0.35 * small + 1.0],
                    [width - margin - 1.0, y + 0.35 * small - 1.0],
                ];
                canvas.fill(inner[0], inner[1], srgb(color), 1.0);
                canvas.outlined(name, [width - margin - 1.4 * small, y], small, Align::Right, [INK, SHADE]);
            }
        }
        if let Some(overlay) = self.overlay {
            let (top, size) = (0.62 * height, [0.8 * text, 0.3 * height]);
            overlay.bar.draw(canvas, [margin, top], size, small, [INK, SHADE]);
        }
    }
}

/// A colour as dark as the grey it stands for, so that structure shows through the tint.
fn tinted(color: Color, grey: u8) -> Color {
    mix(color, mix(SHADE, color, f64::from(grey) / 160.0), 0.6)
}

/// Draws the letters of the sides, where the plane is, and a scale bar.
fn annotate(canvas: &mut Canvas, raster: &Raster) {
    let (letters, caption) = (raster.letters(), raster.plane.to_string());
    let letters = [0, 1, 2, 3].map(|side| letters[side].as_str());
    Legend { letters, caption: &caption, pixel_mm: raster.pixel_mm(), ink: INK, shade: SHADE }.draw(canvas);
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
