//! Attributes and colours for the meshes of a run: the CT at rest, strain, speed, and what they look like.
//!
//! The CT is not kept in a run: it is read again from where the scene names it, and refused when it is no longer the one the
//! run was made from.

use std::path::PathBuf;

use super::inputs::{InputError, load_volume};
use super::interfaces::is_border_of;
use super::meshes::MeshRunError;
use crate::lattice::Lattice;
use crate::look::colormap::Colormap;
use crate::look::detail::Detail;
use crate::look::hu::{hu_at_rest, skin_reach};
use crate::look::paint::{self, ColorBy, Legend, Paint};
use crate::look::particles::at_rest;
use crate::look::rest::RestSurface;
use crate::look::strain::equivalent_strains;
use crate::look::transfer::{Capsule, HuSpread, TransferFunction, tissue_colors, window_of};
use crate::scene::resolved::{Look, Organ, Scene, VolumeSource};
use crate::store::{InputFile, ReadRunError, RunReader};
use crate::surface::mesh::OrganMesh;
use crate::volume::CtVolume;

/// Most frames that are looked at for the range of the colours of a run.
const FRAMES_FOR_RANGE: usize = 16;
/// Share of the particles of a frame whose strain or speed lies in the range of colours found for it: single particles beside
/// a blade would otherwise take all the colours.
const SHARE_IN_RANGE: f64 = 0.995;
/// CT numbers of a colour map where none are given \[HU\]: the window customary for the abdomen, 400 wide about 40.
const ABDOMEN_WINDOW: [f32; 2] = [-160.0, 240.0];

/// Attributes of vertices that are computed on demand; label and displacement are always there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Attributes {
    /// The CT at rest.
    pub hu: bool,
    /// Equivalent strain.
    pub strain: bool,
    /// Speed.
    pub speed: bool,
}

/// How the meshes of a run are painted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PaintOptions {
    /// What colours say; `None` gives vertices none, and each organ has its one colour.
    pub by: Option<ColorBy>,
    /// Values of the first and the last colour, in the unit of [`ColorBy::unit`]; `None` takes them from the run.
    pub range: Option<[f32; 2]>,
    /// Colour map; `None` takes the one that suits, and for HU the colours of tissue.
    pub colormap: Option<Colormap>,
    /// Strength of fine detail, 0 to 1, see [`crate::look::detail`].
    pub detail: f32,
    /// Attributes to fill in, besides the one that is painted.
    pub attributes: Attributes,
}

/// Why the meshes of a run cannot be painted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaintRunError {
    /// The run cannot be read.
    #[error(transparent)]
    Read(#[from] ReadRunError),
    /// Its scene cannot be understood.
    #[error(transparent)]
    Scene(#[from] MeshRunError),
    /// There is no CT in it.
    #[error(
        "{}: the run was made from labels alone, without a CT, so vertices have no HU; colour by organ, label, displacement, \
         strain or speed, or run a scene with volume.image",
        run.display()
    )]
    NoImage {
        /// The run.
        run: PathBuf,
    },
    /// The CT is gone or damaged.
    #[error(
        "the CT that HU are taken from cannot be read again: {0}; put it back, or colour by something else than HU"
    )]
    Input(#[from] InputError),
    /// The CT is not the one of the run.
    #[error(
        "{}: has changed since the run was made (SHA-256 {found}, the run has {expected}); put the old file back, run the \
         scene again, or colour by something else than HU",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// Its checksum now.
        found: String,
        /// That of the run.
        expected: String,
    },
    /// A range for what has no values.
    #[error("a range of {} to {} was given, but colours by {} have none; leave the range out", range[0], range[1], by.name())]
    NoRange {
        /// What colours say.
        by: ColorBy,
        /// The range given.
        range: [f32; 2],
    },
    /// A range that is none.
    #[error("a range of {} to {} cannot be coloured; give two finite numbers, the smaller first", range[0], range[1])]
    BadRange {
        /// The range given.
        range: [f32; 2],
    },
}

/// Fills in attributes and colours of the meshes of a run.
pub struct Painter {
    options: PaintOptions,
    organs: Vec<OrganLook>,
    ct: Option<CtVolume>,
    legend: Option<Legend>,
}

/// What an organ looks like.
struct OrganLook {
    name: String,
    tissue: Option<Tissue>,
    detail: Detail,
}

/// What its CT numbers look like.
struct Tissue {
    transfer: TransferFunction,
    capsule: Capsule,
}

impl Painter {
    /// Reads what painting needs: the CT for HU, and some frames of the run for the range of colours where none is given.
    ///
    /// # Errors
    /// See [`PaintRunError`].
    pub fn new(reader: &RunReader, scene: &Scene, options: PaintOptions) -> Result<Self, PaintRunError> {
        if let (Some(by @ (ColorBy::Organ | ColorBy::Label)), Some(range)) = (options.by, options.range) {
            return Err(PaintRunError::NoRange { by, range });
        }
        if let Some(range) = options.range.filter(|[low, high]| !(low.is_finite() && high.is_finite() && low < high)) {
            return Err(PaintRunError::BadRange { range });
        }
        let needs_ct = options.attributes.hu || options.by == Some(ColorBy::Hu);
        let ct = needs_ct.then(|| load_ct(reader, scene)).transpose()?;
        let by_tissue = options.by == Some(ColorBy::Hu) && options.colormap.is_none();
        let organs = scene.organs.iter().enumerate().map(|(number, organ)| OrganLook {
            name: organ.name.clone(),
            tissue: ct
                .as_ref()
                .filter(|_| by_tissue)
                .map(|ct| tissue_of(organ, number as u8, options.range, ct, reader.lattice())),
            detail: Detail::of_organ(&organ.name),
        });
        let organs = organs.collect();
        let legend = match options.by {
            None | Some(ColorBy::Organ | ColorBy::Label) => None,
            Some(ColorBy::Hu) => options.colormap.map(|colormap| Legend {
                by: ColorBy::Hu,
                range: options.range.unwrap_or(ABDOMEN_WINDOW),
                colormap,
            }),
            Some(by) => {
                let range = options.range.map_or_else(|| range_of(reader, by), Ok)?;
                Some(Legend { by, range, colormap: options.colormap.unwrap_or_default() })
            }
        };
        Ok(Self { options, organs, ct, legend })
    }

    /// The range and colours of what is painted; `None` for organs, labels and the colours of tissue.
    pub fn legend(&self) -> Option<&Legend> {
        self.legend.as_ref()
    }

    /// Fills in the attributes and colours of a frame's meshes.
    ///
    /// - `on_cut`: for each mesh, whether each vertex lies on a face of a cut.
    ///
    /// # Errors
    /// If the frame cannot be read.
    ///
    /// # Panics
    /// If meshes and flags do not belong together, or a mesh is of no organ of the scene.
    pub fn paint(
        &self,
        reader: &RunReader,
        frame: usize,
        meshes: &mut [OrganMesh],
        on_cut: &[Vec<bool>],
    ) -> Result<(), PaintRunError> {
        assert_eq!(meshes.len(), on_cut.len(), "one list of flags per mesh");
        let Attributes { hu, strain, speed } = self.options.attributes;
        let lattice = reader.lattice();
        let by = self.options.by;
        let strains = (strain || by == Some(ColorBy::Strain)).then(|| strains(reader, frame)).transpose()?;
        let velocities = (speed || by == Some(ColorBy::Speed)).then(|| velocities(reader, frame)).transpose()?;
        let hu = hu || by == Some(ColorBy::Hu);
        let detailed = by.is_some() && self.options.detail > 0.0;
        let reach = self.ct.as_ref().map_or(0.0, skin_reach);
        for (organ, on_cut) in meshes.iter_mut().zip(on_cut) {
            let is_of = |look: &&OrganLook| is_border_of(&organ.name, &look.name);
            let look = self.organs.iter().find(is_of).expect("an organ of the scene");
            let mesh = &mut organ.mesh;
            if hu || strains.is_some() || velocities.is_some() || detailed {
                let rest = RestSurface::new(mesh, on_cut, reach);
                if let Some(ct) = self.ct.as_ref().filter(|_| hu) {
                    mesh.hu = hu_at_rest(ct, &rest);
                }
                if let Some(strains) = &strains {
                    mesh.strains = at_rest(lattice, strains, &rest).into_iter().map(|[strain]| strain).collect();
                }
                if let Some(velocities) = &velocities {
                    mesh.speeds = at_rest(lattice, velocities, &rest).into_iter().map(paint::length).collect();
                }
                if let Some(paint) = self.paint_of(look, organ.color, on_cut) {
                    mesh.colors = paint::colors(mesh, paint);
                    if detailed {
                        let mut colors = std::mem::take(&mut mesh.colors);
                        paint::add_detail(&mut colors, &rest, mesh, look.detail, self.options.detail);
                        mesh.colors = colors;
                    }
                }
            } else if let Some(paint) = self.paint_of(look, organ.color, on_cut) {
                mesh.colors = paint::colors(mesh, paint);
            }
        }
        Ok(())
    }

    fn paint_of<'a>(&self, look: &'a OrganLook, color: [f32; 3], on_cut: &'a [bool]) -> Option<Paint<'a>> {
        Some(match (self.options.by?, self.legend, &look.tissue) {
            (_, Some(legend), _) => Paint::Scale(legend),
            (ColorBy::Label, ..) => Paint::Labels,
            (_, _, Some(Tissue { transfer, capsule })) => Paint::Tissue { transfer, capsule: *capsule, on_cut },
            _ => Paint::Flat(color),
        })
    }
}

/// The CT of a run, after checking that it is the one the run was made from.
fn load_ct(reader: &RunReader, scene: &Scene) -> Result<CtVolume, PaintRunError> {
    let no_image = || PaintRunError::NoImage { run: reader.path().to_path_buf() };
    let source = match &scene.volume {
        VolumeSource::Files { image: None, .. } => return Err(no_image()),
        // The labels have done their work.
        VolumeSource::Files { image, .. } => VolumeSource::Files { image: image.clone(), labels: None },
        phantom @ VolumeSource::Phantom { .. } => phantom.clone(),
    };
    let inputs = load_volume(&source)?;
    for InputFile { path, sha256: found, .. } in inputs.files {
        let known = reader.manifest().inputs.iter().find(|file| file.path == path);
        if let Some(expected) = known.map(|file| file.sha256.clone()).filter(|expected| *expected != found) {
            return Err(PaintRunError::Changed { path, found, expected });
        }
    }
    inputs.image.ok_or_else(no_image)
}

/// The colours of an organ's CT numbers, its own or those of its tissue over a window, and its skin.
fn tissue_of(organ: &Organ, number: u8, range: Option<[f32; 2]>, ct: &CtVolume, lattice: &Lattice) -> Tissue {
    let own = (0..lattice.len() as u32).filter(|&particle| lattice.organ[particle as usize] == number);
    let values = own.map(|particle| ct.sample(lattice.rest_place(particle), f32::NAN));
    let spread = HuSpread::of(values);
    let found = spread.map_or(ABDOMEN_WINDOW, |spread| window_of(&organ.name, spread));
    let (window, transfer) = match (range, &organ.look) {
        (None, Some(Look::Colors(points))) => {
            let points: Vec<_> = points.iter().map(|point| (point.hu, point.color)).collect();
            (found, TransferFunction::new(&points))
        }
        (range, look) => {
            let window = match (range, look) {
                (Some(window), _) => window,
                (None, Some(Look::Window(window))) => *window,
                _ => found,
            };
            (window, tissue_colors(&organ.name, organ.color, window))
        }
    };
    let middle = 0.5 * (window[0] + window[1]);
    Tissue { transfer, capsule: Capsule { median: spread.map_or(middle, |spread| spread.median), window } }
}

fn strains(reader: &RunReader, frame: usize) -> Result<Vec<[f32; 1]>, ReadRunError> {
    let displacements = reader.displacements_mm(frame)?;
    let strains = equivalent_strains(reader.lattice(), &reader.topology(frame)?, &displacements);
    Ok(strains.into_iter().map(|strain| [strain]).collect())
}

/// Mean velocity of each particle since the frame before, RAS+ \[mm/s\]; zero in the first frame.
fn velocities(reader: &RunReader, frame: usize) -> Result<Vec<[f32; 3]>, ReadRunError> {
    let now = reader.displacements_mm(frame)?;
    let Some(before) = frame.checked_sub(1) else { return Ok(vec![[0.0; 3]; now.len()]) };
    let elapsed = reader.times()[frame] - reader.times()[before];
    let rate = if elapsed > 0.0 { 1.0 / elapsed } else { 0.0 };
    let before = reader.displacements_mm(before)?;
    let velocity = |(now, before): (&[f32; 3], &[f32; 3])| {
        [0, 1, 2].map(|axis| ((f64::from(now[axis]) - f64::from(before[axis])) * rate) as f32)
    };
    Ok(now.iter().zip(&before).map(velocity).collect())
}

/// From 0 to a round number that holds nearly all values of a run; see [`FRAMES_FOR_RANGE`] and [`SHARE_IN_RANGE`].
fn range_of(reader: &RunReader, by: ColorBy) -> Result<[f32; 2], ReadRunError> {
    let frames = reader.frames();
    let looked_at = frames.min(FRAMES_FOR_RANGE);
    let mut highest = 0.0_f32;
    for number in 0..looked_at {
        // Evenly spaced, the last among them.
        let frame = (number + 1) * frames / looked_at - 1;
        let mut values: Vec<f32> = match by {
            ColorBy::Strain => strains(reader, frame)?.into_iter().map(|[strain]| strain).collect(),
            ColorBy::Speed => velocities(reader, frame)?.into_iter().map(paint::length).collect(),
            _ => reader.displacements_mm(frame)?.into_iter().map(paint::length).collect(),
        };
        values.retain(|value| value.is_finite());
        let Some(last) = values.len().checked_sub(1) else { continue };
        let share = if by == ColorBy::Displacement { 1.0 } else { SHARE_IN_RANGE };
        let (_, value, _) = values.select_nth_unstable_by((last as f64 * share) as usize, f32::total_cmp);
        highest = highest.max(*value);
    }
    Ok([0.0, round_up(highest)])
}

/// The next of 1, 1.5, 2, 3, 5, 7 times a power of ten; 1 for 0, so that a run in which nothing moves has a range.
fn round_up(value: f32) -> f32 {
    let value = f64::from(value);
    if !(value.is_finite() && value > 1e-12) {
        return 1.0;
    }
    let power = 10_f64.powi(value.log10().floor() as i32);
    let step = [1.0, 1.5, 2.0, 3.0, 5.0, 7.0].into_iter().find(|step| value <= step * power * (1.0 + 1e-6));
    (step.unwrap_or(10.0) * power) as f32
}

#[cfg(test)]
mod tests {
    use super::round_up;

    #[test]
    fn ranges_end_on_round_numbers() {
        let found = [0.0, 0.012, 0.7, 1.0, 1.2, 4.9, 7.1, 99.0, 1e5, f32::NAN].map(round_up);
        assert_eq!(found, [1.0, 0.015, 0.7, 1.0, 1.5, 5.0, 10.0, 100.0, 1e5, 1.0]);
    }
}
