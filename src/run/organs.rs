//! Which organ each voxel belongs to, at the pitch of the scene.

use super::inputs::Inputs;
use super::prepare::PrepareError;
use crate::geometry::Grid;
use crate::lattice::build::{BuildLatticeError, NO_ORGAN, OrganMap};
use crate::scene::resolved::{Model, Scene, VoxelSelection};
use crate::volume::{LabelVolume, Volume, grid_with_spacing, label_shares, resample_labels};

/// Spacings that differ by less than this, relative, count as equal: headers store them as f32.
const SAME_SPACING: f64 = 1e-4;

/// The organs of a scene on cubes of its pitch, cropped to them.
pub(super) struct Organs {
    /// Organ of each voxel. Where several meet in a voxel of model `tissue`, the one that fills most of it.
    pub(super) map: OrganMap,
    /// How much of each voxel is tissue, 0 to 1; all of it when `None`.
    pub(super) fill: Option<Volume<f32>>,
    /// Organ number plus 1 of each voxel of the scene's volume.
    pub(super) native: LabelVolume,
}

/// Spacing of a scene's volume: the pitch it has unless the scene names one [mm]. `None` without a volume.
pub(crate) fn own_pitch_mm(inputs: &Inputs) -> Option<f64> {
    let grid = inputs.labels.as_ref().map(LabelVolume::grid).or(inputs.image.as_ref().map(|image| image.grid()))?;
    Some(pitch_of(&grid.affine.spacing()))
}

/// The pitch of voxels: the edge of a cube of their volume.
fn pitch_of(spacing: &[f64; 3]) -> f64 {
    spacing.iter().product::<f64>().cbrt()
}

/// The box of voxels that a scene's organs fill; `None` where they have another shape.
///
/// # Errors
/// If an organ selects no voxel.
pub(crate) fn filled_box(scene: &Scene, inputs: &Inputs) -> Result<Option<Grid>, PrepareError> {
    let native = native_organs(scene, inputs)?;
    let filled = native.as_slice().iter().filter(|&&organ| organ != 0).count();
    let part = native.bounding_box(|&organ| organ != 0).filter(|part| part.shape().len() == filled);
    Ok(part.map(|part| *native.crop(&part).grid()))
}

/// Whether a box of so many voxels is a whole number of cells long along every axis.
pub(crate) fn whole_cells(voxels: [usize; 3], spacing: [f64; 3], pitch: f64) -> bool {
    (0..3).all(|axis| {
        let cells = voxels[axis] as f64 * spacing[axis] / pitch;
        (cells - cells.round()).abs() < SAME_SPACING
    })
}

/// Chooses the voxels of every organ and brings them to the scene's pitch.
pub(super) fn organs(scene: &Scene, inputs: &Inputs) -> Result<Organs, PrepareError> {
    let native = native_organs(scene, inputs)?;
    let spacing = native.grid().affine.spacing();
    let pitch = scene.lattice.pitch.map_or(pitch_of(&spacing), |pitch| pitch * 1e3);
    let same = spacing.iter().all(|s| (s / pitch - 1.0).abs() < SAME_SPACING);
    let cropped = match native.bounding_box(|&organ| organ != 0) {
        // Cells of another pitch begin where the organs do if these are whole numbers of them long.
        Some(part) if !same && whole_cells(part.shape().dims(), spacing, pitch) => native.crop(&part),
        Some(part) => native.crop(&part.grown([1; 3], native.shape())),
        None => return Err(BuildLatticeError::Empty.into()),
    };
    let grid = || grid_with_spacing(cropped.grid(), [pitch; 3]);
    let (at_pitch, fill) = match scene.lattice.model {
        _ if same => (cropped, None),
        Model::Paper => (resample_labels(&cropped, &grid()?), None),
        Model::Tissue => {
            let (labels, fill) = label_shares(&cropped, &grid()?);
            (labels, Some(fill))
        }
    };
    let mut left = vec![false; scene.organs.len() + 1];
    at_pitch.as_slice().iter().for_each(|&organ| left[usize::from(organ)] = true);
    if let Some(lost) = (0..scene.organs.len()).find(|&organ| !left[organ + 1]) {
        let voxels = voxels_of(&native, lost as u16 + 1);
        return Err(PrepareError::LostOrgan { organ: scene.organs[lost].name.clone(), voxels, pitch });
    }
    let organs = at_pitch.as_slice().iter().map(|&organ| if organ == 0 { NO_ORGAN } else { organ as u8 - 1 }).collect();
    Ok(Organs { map: Volume::from_vec(*at_pitch.grid(), organs), fill, native })
}

fn voxels_of(organs: &LabelVolume, organ: u16) -> usize {
    organs.as_slice().iter().filter(|&&o| o == organ).count()
}

/// Organ number plus 1 of each voxel of the scene's volume; 0 where there is none.
pub(super) fn native_organs(scene: &Scene, inputs: &Inputs) -> Result<LabelVolume, PrepareError> {
    let grid = match (&inputs.labels, &inputs.image) {
        (Some(labels), _) => *labels.grid(),
        (None, Some(image)) => *image.grid(),
        (None, None) => return Err(BuildLatticeError::Empty.into()),
    };
    let mut organs = vec![0_u16; grid.shape.len()];
    for (number, organ) in scene.organs.iter().enumerate() {
        let mut found = false;
        let mut take = |place: usize| {
            found = true;
            // The first organ that selects a voxel keeps it.
            if organs[place] == 0 {
                organs[place] = number as u16 + 1;
            }
        };
        match (&organ.voxels, &inputs.labels, &inputs.image) {
            (VoxelSelection::Labels(wanted), Some(labels), _) => {
                let mut selected = vec![false; 1 << 16];
                wanted.iter().for_each(|&label| selected[usize::from(label)] = true);
                let voxels = labels.as_slice().iter().enumerate();
                voxels.filter(|(_, label)| selected[usize::from(**label)]).for_each(|(place, _)| take(place));
            }
            (VoxelSelection::Hu { min, max }, _, Some(image)) => {
                let voxels = image.as_slice().iter().enumerate();
                voxels.filter(|(_, hu)| (*min..=*max).contains(*hu)).for_each(|(place, _)| take(place));
            }
            _ => {}
        }
        if !found {
            return Err(empty_organ(&organ.name, &organ.voxels, inputs));
        }
    }
    Ok(Volume::from_vec(grid, organs))
}

fn empty_organ(organ: &str, voxels: &VoxelSelection, inputs: &Inputs) -> PrepareError {
    let (selection, hint) = match voxels {
        VoxelSelection::Labels(wanted) => {
            let hint = inputs.labels.as_ref().map_or_else(
                || "the scene has no label map: set volume.labels".to_owned(),
                |labels| {
                    let mut present: Vec<u16> =
                        labels.label_summaries().iter().map(|s| s.label).filter(|&label| label != 0).collect();
                    let more = present.len().saturating_sub(20);
                    present.truncate(20);
                    let list = present.iter().map(u16::to_string).collect::<Vec<_>>().join(", ");
                    let tail = if more > 0 { format!(" and {more} more") } else { String::new() };
                    format!("the label map holds {list}{tail}")
                },
            );
            (format!("label {}", wanted.iter().map(u16::to_string).collect::<Vec<_>>().join(", ")), hint)
        }
        VoxelSelection::Hu { min, max } => {
            let hint = inputs.image.as_ref().map_or_else(
                || "the scene has no image: set volume.image".to_owned(),
                |image| {
                    let range = image.statistics();
                    format!("the image holds {} to {} HU", range.min, range.max)
                },
            );
            (format!("a value from {min} to {max} HU"), hint)
        }
    };
    PrepareError::EmptyOrgan { organ: organ.to_owned(), selection, hint }
}
