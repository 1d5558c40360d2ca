//! A scene after checking: every choice made, every unit SI, every place RAS+ [mm].

use std::path::PathBuf;

use crate::geometry::{Point3, Vector3};
use crate::lattice::region::Region;

/// Everything a run needs to know.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Where the voxels come from.
    pub volume: VolumeSource,
    /// How particles are laid over them.
    pub lattice: LatticeSpec,
    /// Organs, in the order of the scene; a voxel belongs to the first that selects it.
    pub organs: Vec<Organ>,
    /// Duration, frames and step.
    pub time: TimeSpec,
    /// Acceleration of every particle that is free to move, RAS+ [m/s^2].
    pub gravity: Vector3,
    /// What happens when.
    pub operations: Vec<Operation>,
}

/// Where the voxels come from.
#[derive(Debug, Clone, PartialEq)]
pub enum VolumeSource {
    /// Files on disk; at least one of the two.
    Files {
        /// CT image [HU].
        image: Option<PathBuf>,
        /// Label map.
        labels: Option<PathBuf>,
    },
    /// A volume made by the program itself.
    Phantom {
        /// Which one.
        kind: PhantomKind,
        /// Voxel spacing [mm].
        spacing: f64,
        /// Seed of its noise and texture.
        seed: u64,
    },
}

/// The volumes the program can make.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PhantomKind {
    /// Liver with vessels, kidney, spine, ribs, fat and skin.
    Abdomen,
    /// The paper's cube.
    Cube,
    /// A long square bar.
    Beam,
}

/// How particles are laid over the voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatticeSpec {
    /// Which law joins them.
    pub model: Model,
    /// Distance of neighbouring particles [m]; `None` takes the volume's own spacing.
    pub pitch: Option<f64>,
}

/// The two ways to turn voxels into springs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// One particle per voxel, equal springs: Hattori and Kaneko.
    Paper,
    /// Springs assembled by cells from Young's modulus and density.
    Tissue,
}

/// One organ.
#[derive(Debug, Clone, PartialEq)]
pub struct Organ {
    /// Its name, unique in the scene.
    pub name: String,
    /// Which voxels it takes.
    pub voxels: VoxelSelection,
    /// What it is made of.
    pub body: Body,
    /// Linear RGB in 0..=1.
    pub color: [f32; 3],
}

/// Which voxels an organ takes.
#[derive(Debug, Clone, PartialEq)]
pub enum VoxelSelection {
    /// Voxels with one of these labels.
    Labels(Vec<u16>),
    /// Voxels whose value lies in a range, borders included [HU].
    Hu {
        /// Lowest value [HU].
        min: f32,
        /// Highest value [HU].
        max: f32,
    },
}

/// What an organ is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Body {
    /// Equal springs and dampers (model `paper`).
    Paper {
        /// Spring constant [N/m].
        stiffness: f64,
        /// Dashpot constant [N s/m]; the paper's per-step damper is `damping / dt`.
        damping: f64,
        /// Mass of a particle [kg].
        mass: f64,
    },
    /// Isotropic elastic tissue with Poisson's ratio 1/4 (model `tissue`).
    Tissue {
        /// Young's modulus [Pa].
        youngs_modulus: f64,
        /// Density [kg/m^3].
        density: f64,
        /// Damping relative to critical at the lattice's own frequency `sqrt(E / density) / pitch`.
        damping_ratio: f64,
    },
    /// Bone: particles that do not deform; they move only when an operation moves them.
    Rigid,
}

/// Duration, frames and step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeSpec {
    /// Simulated time [s].
    pub duration: f64,
    /// Frames written after the first (which shows rest), evenly spaced.
    pub frames: usize,
    /// Time step [s]; `None` lets the program choose a stable one.
    pub dt: Option<f64>,
}

/// One entry of the time line.
#[derive(Debug, Clone, PartialEq)]
pub struct Operation {
    /// Its name in messages; unique in the scene.
    pub name: String,
    /// Begins [s].
    pub from: f64,
    /// Ends [s]; infinite when it lasts to the end of the run.
    pub until: f64,
    /// What it does.
    pub action: Action,
}

/// What an operation does between `from` and `until`.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Holds a region where it is.
    Fix {
        /// Which particles.
        region: Region,
    },
    /// Pushes or pulls: an external force shared by the region's particles in proportion to their mass.
    Force {
        /// Which particles.
        region: Region,
        /// Sum over the region, RAS+ [N].
        force: Vector3,
        /// Time over which the force grows linearly from zero [s].
        ramp: f64,
    },
    /// Grabs a region and moves it along a path, then holds it until the operation ends.
    Grab {
        /// Which particles.
        region: Region,
        /// Displacements from where the region was grabbed, RAS+ [mm]; straight between, at constant speed.
        path: Vec<Vector3>,
        /// When the end of the path is reached [s].
        arrive: f64,
    },
    /// Sweeps the edge of a blade and severs every spring it goes through.
    Cut {
        /// The edge: a polyline of at least two points, RAS+ [mm].
        blade: Vec<Point3>,
        /// Offsets of the edge from where it is drawn, RAS+ [mm]; straight between, at constant speed.
        path: Vec<Vector3>,
    },
}
