//! From volumes to a lattice that is ready to move: organs, pitch, materials, time step.

use crate::dynamics::World;
use crate::dynamics::stable_dt::{Limits, SAFETY};
use crate::geometry::Vector3;
use crate::lattice::build::{Border, BuildLatticeError, NO_ORGAN, OrganMap, build};
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;
use crate::material::paper::{self, PaperBody};
use crate::material::tissue::{self, Damping, TissueBody};
use crate::scene::resolved::{Body, Model, Scene, TimeSpec, VoxelSelection};
use crate::volume::{LabelVolume, ResampleError, Volume, grid_with_spacing, resample_labels};

use super::inputs::Inputs;

/// Spacings that differ by less than this, relative, count as equal: headers store them as f32.
const SAME_SPACING: f64 = 1e-4;

/// A step that was asked for is refused only after looking for the true limit as hard as a run of so many steps would.
const WORTH_REFUSING: f64 = 1e4;

/// Why a scene cannot be turned into a world.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PrepareError {
    /// An organ selects no voxel.
    #[error("organ `{organ}`: no voxel has {selection}; {hint}")]
    EmptyOrgan {
        /// Name of the organ.
        organ: String,
        /// What it asks for.
        selection: String,
        /// What the volume holds instead.
        hint: String,
    },
    /// Every organ is rigid.
    #[error("every organ is rigid, so nothing can deform; give at least one organ a material instead of rigid = true")]
    AllRigid,
    /// An organ that was there is lost at this pitch.
    #[error(
        "organ `{organ}`: none of its {voxels} voxels is left at a pitch of {pitch} mm; choose a finer lattice.pitch"
    )]
    LostOrgan {
        /// Name of the organ.
        organ: String,
        /// Voxels it has in the volume.
        voxels: usize,
        /// The pitch [mm].
        pitch: f64,
    },
    /// The lattice cannot be built.
    #[error(transparent)]
    Lattice(#[from] BuildLatticeError),
    /// The volume cannot be resampled to the pitch.
    #[error("lattice.pitch: {0}")]
    Pitch(#[from] ResampleError),
    /// The step asked for is not stable.
    #[error(
        "time.dt = {asked:e} s is not stable for these materials: the largest step that is, is {bound:.3e} s; ask for at \
         most {suggested:.2e} s, or leave time.dt out and let the program choose"
    )]
    UnstableStep {
        /// The step in the scene [s].
        asked: f64,
        /// The largest stable one [s].
        bound: f64,
        /// A rounded value below it [s].
        suggested: f64,
    },
}

/// A scene's lattice with its materials and its steps.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The rest state.
    pub lattice: Lattice,
    /// Masses and spring constants.
    pub assembly: Assembly,
    /// Steps and frames.
    pub schedule: Schedule,
}

/// Steps and frames of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Time step [s].
    pub dt: f64,
    /// The largest step that is stable near rest [s]; infinite when no spring limits it.
    pub stable_dt: f64,
    /// All limits of the rest state.
    pub limits: Limits,
    /// True when the scene asked for the step.
    pub asked: bool,
    /// Steps in all.
    pub steps: u64,
    /// Frames after the first.
    pub frames: u64,
}

impl Schedule {
    /// Chooses the step, or checks the one that is asked for; `sharpen` looks for the true limit as far as that pays in a
    /// run of so many steps.
    ///
    /// # Errors
    /// If the step asked for is larger than the stable one.
    pub fn new(
        time: &TimeSpec,
        at_rest: Limits,
        sharpen: impl Fn(Limits, f64) -> Limits,
    ) -> Result<Self, PrepareError> {
        let frames = time.frames as u64;
        let per_frame = time.duration / frames as f64;
        if let Some(asked) = time.dt {
            // Only a step between both limits needs the true one.
            let limits = if asked > at_rest.rest {
                sharpen(at_rest, WORTH_REFUSING.max(time.duration / asked))
            } else {
                at_rest
            };
            let stable_dt = limits.sharp;
            if asked > stable_dt {
                // Two digits, rounded down.
                let scale = 10_f64.powf(stable_dt.log10().floor() - 1.0);
                let suggested = (SAFETY * stable_dt / scale).floor() * scale;
                return Err(PrepareError::UnstableStep { asked, bound: stable_dt, suggested });
            }
            let steps = (time.duration / asked - 1e-6).ceil().max(1.0) as u64;
            return Ok(Self { dt: asked, stable_dt, limits, asked: true, steps, frames });
        }
        let steps_of = |limit: f64| (per_frame / (SAFETY * limit)).ceil().max(1.0);
        let limits = sharpen(at_rest, frames as f64 * steps_of(at_rest.rest));
        let steps_per_frame = steps_of(limits.sharp);
        let (dt, steps) = (per_frame / steps_per_frame, frames * steps_per_frame as u64);
        Ok(Self { dt, stable_dt: limits.sharp, limits, asked: false, steps, frames })
    }

    /// After how many steps a frame is due; frame 0 is the start.
    pub fn step_of_frame(&self, frame: u64) -> u64 {
        (u128::from(frame) * u128::from(self.steps) / u128::from(self.frames)) as u64
    }
}

/// Builds the lattice of a scene and chooses its time step.
///
/// # Errors
/// See [`PrepareError`].
pub fn prepare(scene: &Scene, inputs: &Inputs) -> Result<Prepared, PrepareError> {
    let soft = |body: &Body| !matches!(body, Body::Rigid);
    if !scene.organs.iter().any(|organ| soft(&organ.body)) {
        return Err(PrepareError::AllRigid);
    }
    let organs = organ_map(scene, inputs)?;
    let border = match scene.lattice.model {
        Model::Paper => Border::Voxels,
        Model::Tissue => Border::Cells,
    };
    let rigid: Vec<bool> = scene.organs.iter().map(|organ| !soft(&organ.body)).collect();
    let lattice = build(&organs, border, &rigid)?;
    let assembly = assemble(scene, &lattice);
    let topology = Topology::new(&lattice);
    let at_rest = Limits::at_rest(&lattice, &topology, &assembly);
    let sharpen = |limits: Limits, steps: f64| limits.sharpen(&lattice, &topology, &assembly, steps);
    let schedule = Schedule::new(&scene.time, at_rest, sharpen)?;
    Ok(Prepared { lattice, assembly, schedule })
}

impl Prepared {
    /// The lattice at rest, under the scene's gravity.
    pub fn into_world(self, gravity: Vector3) -> World {
        let mut world = World::new(self.lattice, self.assembly, self.schedule.dt);
        world.set_gravity(gravity);
        world
    }
}

/// Masses and spring constants by the scene's model.
fn assemble(scene: &Scene, lattice: &Lattice) -> Assembly {
    match scene.lattice.model {
        Model::Paper => {
            let bodies: Vec<Option<PaperBody>> = scene
                .organs
                .iter()
                .map(|organ| match organ.body {
                    Body::Paper { stiffness, damping, mass } => Some(PaperBody { stiffness, damping, mass }),
                    Body::Tissue { .. } | Body::Rigid => None,
                })
                .collect();
            paper::assemble(lattice, &bodies)
        }
        Model::Tissue => {
            let bodies: Vec<Option<TissueBody>> = scene
                .organs
                .iter()
                .map(|organ| match organ.body {
                    Body::Tissue { youngs_modulus, density, damping_ratio } => Some(TissueBody {
                        youngs_modulus,
                        poissons_ratio: 0.25,
                        density,
                        damping: Damping::Ratio(damping_ratio),
                    }),
                    Body::Paper { .. } | Body::Rigid => None,
                })
                .collect();
            tissue::assemble(lattice, &bodies)
        }
    }
}

/// Organ of each point of a cubic grid at the scene's pitch, cropped to the organs.
fn organ_map(scene: &Scene, inputs: &Inputs) -> Result<OrganMap, PrepareError> {
    let native = native_organs(scene, inputs)?;
    let spacing = native.grid().affine.spacing();
    let mean = spacing.iter().product::<f64>().cbrt();
    let pitch = scene.lattice.pitch.map_or(mean, |pitch| pitch * 1e3);
    let same = spacing.iter().all(|s| (s / pitch - 1.0).abs() < SAME_SPACING);
    let cropped = match native.bounding_box(|&organ| organ != 0) {
        Some(part) => native.crop(&part.grown([1; 3], native.shape())),
        None => return Err(BuildLatticeError::Empty.into()),
    };
    let at_pitch =
        if same { cropped } else { resample_labels(&cropped, &grid_with_spacing(cropped.grid(), [pitch; 3])?) };
    let mut left = vec![false; scene.organs.len() + 1];
    at_pitch.as_slice().iter().for_each(|&organ| left[usize::from(organ)] = true);
    if let Some(lost) = (0..scene.organs.len()).find(|&organ| !left[organ + 1]) {
        let voxels = cropped_count(&native, lost as u16 + 1);
        return Err(PrepareError::LostOrgan { organ: scene.organs[lost].name.clone(), voxels, pitch });
    }
    let organs = at_pitch.as_slice().iter().map(|&organ| if organ == 0 { NO_ORGAN } else { organ as u8 - 1 }).collect();
    Ok(Volume::from_vec(*at_pitch.grid(), organs))
}

fn cropped_count(organs: &LabelVolume, organ: u16) -> usize {
    organs.as_slice().iter().filter(|&&o| o == organ).count()
}

/// Organ number plus 1 of each voxel of the scene's volume; 0 where there is none.
fn native_organs(scene: &Scene, inputs: &Inputs) -> Result<LabelVolume, PrepareError> {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn schedule(time: &TimeSpec, stable: f64) -> Result<Schedule, PrepareError> {
        Schedule::new(time, Limits { promise: 0.6 * stable, rest: 0.9 * stable, sharp: 0.9 * stable }, |limits, _| {
            Limits { sharp: stable, ..limits }
        })
    }

    #[test]
    fn the_step_divides_a_frame() {
        let time = TimeSpec { duration: 0.4, frames: 40, dt: None };
        let schedule = schedule(&time, 3.3e-4).unwrap();
        assert!(schedule.dt <= SAFETY * 3.3e-4);
        assert_eq!(schedule.steps % 40, 0);
        assert!((schedule.dt * schedule.steps as f64 - 0.4).abs() < 1e-12);
        assert_eq!(schedule.step_of_frame(40), schedule.steps);
        assert_eq!(schedule.step_of_frame(0), 0);
    }

    #[test]
    fn an_unstable_step_is_refused_with_one_that_works() {
        let time = TimeSpec { duration: 0.4, frames: 40, dt: Some(1e-3) };
        let error = schedule(&time, 3.3e-4).unwrap_err();
        let PrepareError::UnstableStep { suggested, .. } = error else { panic!("{error}") };
        assert!(schedule(&TimeSpec { dt: Some(suggested), ..time }, 3.3e-4).is_ok());
        assert!(error.to_string().contains("3.300e-4"), "{error}");
    }

    #[test]
    fn a_given_step_is_kept() {
        let time = TimeSpec { duration: 0.1, frames: 7, dt: Some(1e-3) };
        let schedule = schedule(&time, 2e-3).unwrap();
        assert_eq!((schedule.dt, schedule.steps), (1e-3, 100));
        assert_eq!(schedule.step_of_frame(7), 100);
    }
}
