//! The organs of a run on the grid of their own volume, or a finer one: what a surface finer than the lattice is drawn from.

use rayon::prelude::*;

use crate::geometry::{Grid, GridShape};
use crate::lattice::build::BuildLatticeError;
use crate::scene::resolved::{Scene, VoxelSelection};
use crate::store::{InputFile, RunReader};
use crate::surface::field;
use crate::surface::fine::Body;
use crate::surface::interfaces::{MultiBody, OrganField, Partition};
use crate::surface::smooth::{Voxels, from_grey, from_mask};
use crate::volume::{CtVolume, LabelVolume, ResampleError, VoxelBox, grid_with_spacing};

use super::inputs::{InputError, Inputs, load_volume};
use super::meshes::HU_CONTRAST;
use super::organs::native_organs;
use super::prepare::PrepareError;

/// Voxels around an organ that its field is drawn with: smoothing reaches so far.
const MARGIN: usize = 4;
/// Where a voxel is another organ's, an organ chosen by HU has at most this share of it, below zero.
const LEAST_SHARE: f32 = 0.03;

/// Why the organs of a run cannot be taken from its volume again.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// The volume cannot be read any more.
    #[error("the volume of the run cannot be read again: {0}; put it back, or ask for the surface of the lattice")]
    Input(#[from] InputError),
    /// The volume is another one now.
    #[error(
        "{}: the file has changed since the run was made from it (SHA-256 {found}, the run has {expected}); put the old one \
         back, run the scene again, or ask for the surface of the lattice",
        path.display()
    )]
    Changed {
        /// The file.
        path: std::path::PathBuf,
        /// Its checksum now.
        found: String,
        /// The checksum in the run's manifest.
        expected: String,
    },
    /// The organs cannot be chosen.
    #[error(transparent)]
    Organs(#[from] PrepareError),
    /// The spacing asked for cannot be had.
    #[error("spacing of the surface: {0}")]
    Spacing(#[from] ResampleError),
    /// The points of its surface are so far apart that they miss an organ.
    #[error("organ `{organ}`: of points {spacing_mm} mm apart none lies in it; ask for a finer surface")]
    TooCoarse {
        /// The organ.
        organ: String,
        /// Distance of the points \[mm\].
        spacing_mm: f64,
    },
    /// Nothing is left of an organ.
    #[error("organ `{organ}`: {source}")]
    Body {
        /// The organ.
        organ: String,
        /// Why.
        source: BuildLatticeError,
    },
}

/// Where the surfaces of organs are sampled.
pub struct Bodies {
    inputs: Inputs,
    /// Organ number plus 1 of each voxel.
    organs: LabelVolume,
}

impl Bodies {
    /// Reads the volume of a run again and makes sure that it is the same.
    ///
    /// # Errors
    /// If it is missing, damaged, or not the one the run was made from.
    pub fn of_run(reader: &RunReader, scene: &Scene) -> Result<Self, BodyError> {
        let inputs = load_volume(&scene.volume)?;
        inputs.files.iter().try_for_each(|file| same_file(file, &reader.manifest().inputs))?;
        let organs = native_organs(scene, &inputs)?;
        Ok(Self { inputs, organs })
    }

    /// Shortest edge of a voxel [mm].
    pub fn spacing(&self) -> f64 {
        self.organs.grid().affine.spacing().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// The body of an organ, sampled at a spacing [mm].
    ///
    /// # Errors
    /// If the spacing is no length or too fine, or nothing is left of the organ.
    pub fn body(&self, scene: &Scene, organ: usize, spacing: f64, smooth: f32) -> Result<Body, BodyError> {
        let Drawn { part, organs, mut field } = self.draw(scene, organ, smooth)?;
        if !matches!(scene.organs[organ].voxels, VoxelSelection::Hu { .. }) {
            let number = organ as u16 + 1;
            field.par_iter_mut().zip(organs.as_slice()).for_each(|(value, &voxel)| {
                *value *= if voxel != number && voxel != 0 { 1.0 + field::WALL } else { 1.0 };
            });
        }
        let field = closed(&field, organs.shape(), &part, self.organs.shape());
        let grid = cubes(organs.grid(), spacing)?;
        let values = if grid == *organs.grid() {
            field
        } else {
            let field = CtVolume::from_vec(*organs.grid(), field);
            (0..grid.shape.len()).into_par_iter().map(|point| field.sample_cubic(grid.place(point), -1.0)).collect()
        };
        Body::new(grid, values).map_err(|source| missed(scene, organ, spacing, source))
    }

    /// All organs on one grid, sampled at a spacing \[mm\]: their walls lie where two fields are equal.
    ///
    /// # Errors
    /// If the spacing is no length or too fine, or nothing is left of an organ.
    pub fn together(&self, scene: &Scene, spacing: f64, smooth: f32) -> Result<MultiBody, BodyError> {
        let all = self.organs.bounding_box(|&voxel| voxel != 0);
        let nothing = |organ: usize, source| BodyError::Body { organ: scene.organs[organ].name.clone(), source };
        let all: VoxelBox = all.ok_or_else(|| nothing(0, BuildLatticeError::Empty))?;
        let voxels = self.organs.crop_repeating(&all, MARGIN);
        let grid = cubes(voxels.grid(), spacing)?;
        // Index among the voxels of every plane of points across each axis.
        let at: [Vec<f64>; 3] = std::array::from_fn(|axis| {
            let step = |i: usize| {
                let mut ijk = [0; 3];
                ijk[axis] = i.min(grid.shape.dims()[axis] - 1);
                voxels.grid().affine.index_of(grid.place(grid.shape.linear(ijk)))[axis]
            };
            (0..grid.shape.dims()[axis]).map(step).collect()
        });
        let fields = (0..scene.organs.len()).map(|organ| {
            let Drawn { part, organs, mut field } = self.draw(scene, organ, smooth)?;
            let number = organ as u16 + 1;
            if matches!(scene.organs[organ].voxels, VoxelSelection::Hu { .. }) {
                field.par_iter_mut().zip(organs.as_slice()).for_each(|(value, &voxel)| {
                    let share = *value / HU_CONTRAST;
                    *value = if voxel != number && voxel != 0 { share.min(-LEAST_SHARE) } else { share };
                });
            }
            let low = [0, 1, 2].map(|axis| part.min[axis] - all.min[axis]);
            if grid == *voxels.grid() {
                return Ok(OrganField { low, shape: organs.shape(), values: field });
            }
            // The points that have voxels of the part all round.
            let range = |axis: usize| {
                let (from, to) = (low[axis] as f64, (low[axis] + organs.shape().dims()[axis] - 1) as f64);
                let first = at[axis].partition_point(|&index| index < from);
                (first, at[axis].partition_point(|&index| index <= to).max(first))
            };
            let ranges = [range(0), range(1), range(2)];
            let low = ranges.map(|range| range.0);
            let [nx, ny, nz] = ranges.map(|range| range.1 - range.0);
            let shape = GridShape::new(nx, ny, nz);
            let volume = CtVolume::from_vec(*organs.grid(), field);
            let value = |point: usize| {
                let ijk = shape.ijk(point);
                let point = grid.shape.linear([0, 1, 2].map(|axis| ijk[axis] + low[axis]));
                volume.sample_cubic(grid.place(point), -1.0)
            };
            Ok(OrganField { low, shape, values: (0..shape.len()).into_par_iter().map(value).collect() })
        });
        let fields = fields.collect::<Result<Vec<_>, BodyError>>()?;
        let index = |point: usize| {
            let ijk = grid.shape.ijk(point);
            [0, 1, 2].map(|axis| at[axis][ijk[axis]])
        };
        let full = |point: usize| {
            let index = index(point);
            let nearest = [0, 1, 2].map(|axis| (index[axis].round() as usize).min(voxels.shape().dims()[axis] - 1));
            voxels.as_slice()[voxels.shape().linear(nearest)] != 0
        };
        // Organs that the volume cuts off are closed in a plane half a voxel beyond its outermost centres.
        let (within, beyond): (Vec<_>, Vec<_>) = (0..3)
            .map(|axis| {
                // From the plane at the low end.
                let from = |&index: &f64| index + all.min[axis] as f64 - MARGIN as f64 + 0.5;
                let (at, end) = (&at[axis], self.organs.shape().dims()[axis] as f64);
                let first = at.partition_point(|index| from(index) <= 0.0);
                let last = at.partition_point(|index| from(index) < end);
                let step = at.get(1).map_or(1.0, |next| next - at[0]);
                let farther = |near: f64| if near > 0.0 { ((step - near) / near).max(0.0) as f32 } else { 1.0 };
                let low = at.get(first).map_or(1.0, |index| farther(from(index)));
                let high = last.checked_sub(1).map_or(1.0, |last| farther(end - from(&at[last])));
                (first..last, [low, high])
            })
            .unzip();
        let ends = |list: Vec<std::ops::Range<usize>>| [0, 1, 2].map(|axis| list[axis].clone());
        let partition = Partition::new(grid.shape, fields, full);
        let partition = partition.ended(ends(within), [beyond[0], beyond[1], beyond[2]]);
        MultiBody::new(grid, &partition).map_err(|source| missed(scene, 0, spacing, source))
    }

    /// The field of an organ at the voxels around it.
    fn draw(&self, scene: &Scene, organ: usize, smooth: f32) -> Result<Drawn, BodyError> {
        let number = organ as u16 + 1;
        let name = || scene.organs[organ].name.clone();
        let part = self.organs.bounding_box(|&voxel| voxel == number);
        let part: VoxelBox = part.ok_or_else(|| BodyError::Body { organ: name(), source: BuildLatticeError::Empty })?;
        // An organ that the volume cuts off goes on beyond it, until its surface is closed there.
        let organs = self.organs.crop_repeating(&part, MARGIN);
        let image = self.inputs.image.as_ref().map(|image| image.crop_repeating(&part, MARGIN));
        let field: Vec<f32> = match (&scene.organs[organ].voxels, &image) {
            (VoxelSelection::Hu { min, max }, Some(image)) => {
                image.as_slice().iter().map(|&hu| (hu - min).min(max - hu)).collect()
            }
            (_, image) => {
                let member: Vec<bool> = organs.as_slice().iter().map(|&voxel| voxel == number).collect();
                let foreign: Vec<bool> = organs.as_slice().iter().map(|&voxel| voxel != number && voxel != 0).collect();
                let voxels = Voxels { shape: organs.shape(), organ: &member, foreign: &foreign };
                match image {
                    // Without smoothing the voxels are asked for, not what the CT makes of them.
                    Some(image) if smooth > 0.0 => from_grey(voxels, image.as_slice(), smooth),
                    _ => from_mask(voxels, smooth),
                }
            }
        };
        Ok(Drawn { part, organs, field })
    }
}

/// Why no point of an organ's surface lies in it: the organ has voxels, so the points are too far apart.
fn missed(scene: &Scene, organ: usize, spacing_mm: f64, source: BuildLatticeError) -> BodyError {
    let organ = scene.organs[organ].name.clone();
    match source {
        BuildLatticeError::Empty => BodyError::TooCoarse { organ, spacing_mm },
        source => BodyError::Body { organ, source },
    }
}

/// An organ as its voxels and the CT draw it.
struct Drawn {
    /// Its voxels.
    part: VoxelBox,
    /// These and [`MARGIN`] around: organ number plus 1.
    organs: LabelVolume,
    /// Above zero inside, one value for each of those.
    field: Vec<f32>,
}

/// A field that ends with the volume: beyond its border is the mirror image of what is inside, so that surfaces close half a voxel
/// beyond the outermost centres, in a plane.
fn closed(field: &[f32], shape: GridShape, part: &VoxelBox, volume: GridShape) -> Vec<f32> {
    let value = |point: usize| {
        let ijk = shape.ijk(point);
        let nearest = [0, 1, 2].map(|axis| {
            let (low, dims) = (part.min[axis], volume.dims()[axis]);
            ijk[axis].clamp(MARGIN.saturating_sub(low), (dims - 1 + MARGIN - low).min(shape.dims()[axis] - 1))
        });
        let value = field[shape.linear(nearest)];
        if nearest == ijk { value } else { -value.abs() }
    };
    (0..field.len()).into_par_iter().map(value).collect()
}

/// The same box in cubes of an edge [mm]; the grid itself when its voxels are such cubes.
fn cubes(grid: &Grid, edge: f64) -> Result<Grid, ResampleError> {
    /// Spacings that differ by less than this, relative, count as equal: headers store them as f32.
    const SAME: f64 = 1e-4;
    let same = grid.affine.spacing().iter().all(|spacing| (spacing / edge - 1.0).abs() < SAME);
    if same { Ok(*grid) } else { grid_with_spacing(grid, [edge; 3]) }
}

fn same_file(file: &InputFile, known: &[InputFile]) -> Result<(), BodyError> {
    match known.iter().find(|known| known.path == file.path) {
        Some(known) if known.sha256 != file.sha256 => Err(BodyError::Changed {
            path: file.path.clone(),
            found: file.sha256.clone(),
            expected: known.sha256.clone(),
        }),
        _ => Ok(()),
    }
}
