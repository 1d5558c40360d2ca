//! A scene after checking: every choice made, every unit SI, every place RAS+ [mm].
//!
//! A run directory keeps this form as JSON. Each key of the JSON ends in its unit (`youngs_modulus_pa`), a time without
//! end is `null`, and reading what was written gives the same scene bit for bit.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::property::{kept, kept_or_none};
use crate::dynamics::integrator::Method;
use crate::geometry::{Point3, Vector3};
use crate::lattice::region::Region;

pub use super::property::{Property, PropertyKind};

/// Everything a run needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Where the voxels come from.
    pub volume: VolumeSource,
    /// How particles are laid over them.
    pub lattice: LatticeSpec,
    /// Organs, in the order of the scene; a voxel belongs to the first that selects it. At least one, at most 255.
    pub organs: Vec<Organ>,
    /// Largest error that pitch and steps may make, over the largest displacement; `None` where the scene or the program's
    /// defaults choose them. See [`crate::accuracy`].
    #[serde(default)]
    pub accuracy: Option<f64>,
    /// Duration, frames and step.
    pub time: TimeSpec,
    /// Acceleration of every particle that is free to move, RAS+ [m/s^2].
    #[serde(rename = "gravity_m_per_s2")]
    pub gravity: Vector3,
    /// Velocities that are free die down like `exp(-drag t)` besides what forces do [1/s]; `None` without drag.
    #[serde(rename = "drag_per_s", default)]
    pub drag: Option<f64>,
    /// When blocks at rest are left out of the step; `None` where every block is stepped.
    #[serde(default)]
    pub sleep: Option<SleepSpec>,
    /// What happens when, by ascending [`Operation::from`]; at the same time in the order of the scene's text.
    pub operations: Vec<Operation>,
}

impl Scene {
    /// The same scene, of the same materials, on a lattice of another pitch: a damping ratio becomes the one that has the viscosity there
    /// that this one has here.
    ///
    /// - `own`: the pitch that the scene has by itself \[m\].
    pub fn at_pitch(&self, own: f64, pitch: f64) -> Self {
        let mut scene = self.clone();
        scene.lattice.pitch = Some(pitch);
        for organ in &mut scene.organs {
            if let Body::Tissue { damping: Damping::Ratio(ratio), .. } = &mut organ.body {
                *ratio *= own / pitch;
            }
        }
        scene
    }
}

/// When blocks at rest are left out of the step, see [`crate::dynamics::effects::sleep`].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SleepSpec {
    /// How far particles may be off for it [m]; `None` for a share of the pitch.
    #[serde(rename = "tolerance_m")]
    pub tolerance: Option<f64>,
    /// How long a block has to be at rest [s]; `None` for the time of a wave through the lattice.
    #[serde(rename = "window_s")]
    pub window: Option<f64>,
}

/// Where the voxels come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
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
        #[serde(rename = "spacing_mm")]
        spacing: f64,
        /// Seed of its noise and texture.
        seed: u64,
    },
}

/// The volumes the program can make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PhantomKind {
    /// Liver with vessels, kidney, spine, ribs, fat and skin.
    Abdomen,
    /// The paper's cube.
    Cube,
    /// A long square bar.
    Beam,
}

/// How particles are laid over the voxels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatticeSpec {
    /// Which law joins them.
    pub model: Model,
    /// Distance of neighbouring particles [m]; `None` takes the volume's own spacing.
    #[serde(rename = "pitch_m")]
    pub pitch: Option<f64>,
}

/// The two ways to turn voxels into springs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// One particle per voxel, equal springs: Hattori and Kaneko.
    Paper,
    /// Springs assembled by cells from Young's modulus and density.
    Tissue,
}

/// One organ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Organ {
    /// Its name, unique in the scene.
    pub name: String,
    /// Which voxels it takes.
    pub voxels: VoxelSelection,
    /// What it is made of.
    pub body: Body,
    /// Fibres that stiffen it along their direction; `None` without, and for all but deformable tissue.
    #[serde(default)]
    pub fibres: Option<Fibres>,
    /// What its springs do beyond elasticity.
    #[serde(default)]
    pub inelastic: Inelastic,
    /// Linear RGB in 0..=1.
    #[serde(rename = "color_linear_rgb")]
    pub color: [f32; 3],
    /// How its CT numbers become colours; `None` for the colours of its tissue over a window found in the CT.
    #[serde(default)]
    pub look: Option<Look>,
}

/// What of a scene only the plain step has, in words; `None` when every integrator will do.
pub fn needs_plain_step(organs: &[Organ], operations: &[Operation], sleep: Option<SleepSpec>) -> Option<String> {
    let obstacle = operations.iter().find_map(|operation| match operation.action {
        Action::Tool { .. } => Some(format!("tool {}", operation.name)),
        Action::Plane { .. } => Some(format!("plane {}", operation.name)),
        Action::Bone { .. } => Some("contact.bone".to_owned()),
        Action::SelfContact { .. } => Some("self_contact".to_owned()),
        _ => None,
    });
    let free = organs.iter().find(|organ| matches!(organ.body, Body::Rigid { density: Some(_) }));
    let free = free.map(|organ| format!("organ {} that is rigid and moves", organ.name));
    let flowing = organs.iter().find(|organ| organ.inelastic != Inelastic::default());
    let flowing = flowing.map(|organ| format!("organ {} that relaxes, yields or tears", organ.name));
    obstacle.or(free).or(flowing).or(sleep.map(|_| "sleep".to_owned()))
}

/// Fibres of one direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fibres {
    /// Unit vector along them at rest, RAS+.
    pub direction: Vector3,
    /// What they add to Young's modulus along them [Pa].
    #[serde(rename = "modulus_pa")]
    pub modulus: f64,
}

/// What an organ's springs do beyond elasticity; nothing by default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inelastic {
    /// Tension that is let go in time.
    pub relaxation: Option<Relaxation>,
    /// Strain that stays.
    pub plasticity: Option<Plasticity>,
    /// Strain at which springs tear.
    pub tear_strain: Option<f64>,
}

/// A standard linear solid's second branch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Relaxation {
    /// Its stiffness over that of the springs.
    pub ratio: f64,
    /// In which its tension falls to `1 / e` [s].
    #[serde(rename = "time_s")]
    pub time: f64,
}

/// Yielding.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plasticity {
    /// Elastic strain beyond which springs yield.
    pub yield_strain: f64,
    /// In which what exceeds it falls to `1 / e` [s]; 0 for at once.
    #[serde(rename = "time_s")]
    pub time: f64,
}

/// How CT numbers become colours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Look {
    /// The colours of the tissue from the lowest to the highest of these \[HU\].
    #[serde(rename = "window_hu")]
    Window([f32; 2]),
    /// Colours at CT numbers, ascending, at least two.
    Colors(Vec<LookColor>),
}

/// A colour of a CT number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LookColor {
    /// CT number \[HU\].
    pub hu: f32,
    /// Linear RGB in 0..=1.
    #[serde(rename = "color_linear_rgb")]
    pub color: [f32; 3],
}

/// Which voxels an organ takes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum VoxelSelection {
    /// Voxels with one of these labels, ascending; no label belongs to two organs.
    Labels(Vec<u16>),
    /// Voxels whose value lies in a range, borders included [HU].
    Hu {
        /// Lowest value [HU].
        #[serde(rename = "min_hu")]
        min: f32,
        /// Highest value [HU].
        #[serde(rename = "max_hu")]
        max: f32,
    },
}

/// What an organ is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Body {
    /// Equal springs and dampers (model `paper`).
    Paper {
        /// Spring constant [N/m].
        #[serde(rename = "stiffness_n_per_m")]
        stiffness: f64,
        /// Dashpot constant [N s/m]; the paper's per-step damper is `damping / dt`.
        #[serde(rename = "damping_n_s_per_m")]
        damping: f64,
        /// Mass of a particle [kg].
        #[serde(rename = "mass_kg")]
        mass: f64,
    },
    /// Isotropic elastic tissue (model `tissue`).
    Tissue {
        /// Young's modulus [Pa].
        #[serde(rename = "youngs_modulus_pa")]
        youngs_modulus: Property,
        /// Poisson's ratio, from 0 to 0.49.
        poissons_ratio: f64,
        /// Density [kg/m^3].
        #[serde(rename = "density_kg_per_m3", deserialize_with = "kept")]
        density: Property,
        /// How motion dies out.
        damping: Damping,
    },
    /// Bone: particles that do not deform.
    Rigid {
        /// Density of a body that moves freely as a whole [kg/m^3]; `None` for one that stays where it is unless an
        /// operation moves it.
        #[serde(rename = "density_kg_per_m3", deserialize_with = "kept_or_none")]
        density: Option<Property>,
    },
}

impl Body {
    /// What is known of a property; `None` where the body takes no such thing.
    pub fn property(&self, kind: PropertyKind) -> Option<&Property> {
        match (self, kind) {
            (Self::Tissue { youngs_modulus, .. }, PropertyKind::YoungsModulus) => Some(youngs_modulus),
            (Self::Tissue { density, .. }, PropertyKind::Density) => Some(density),
            (Self::Rigid { density }, PropertyKind::Density) => density.as_ref(),
            (Self::Rigid { .. }, PropertyKind::YoungsModulus) | (Self::Paper { .. }, _) => None,
        }
    }
}

/// Damping in proportion to stiffness, given in one of two ways.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Damping {
    /// Relative to critical at the lattice's own frequency `sqrt(E / density) / pitch`.
    Ratio(f64),
    /// Viscosity of a slowly pulled bar [Pa s].
    #[serde(rename = "viscosity_pa_s")]
    Viscosity(f64),
}

/// Duration, frames and step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeSpec {
    /// Simulated time [s].
    #[serde(rename = "duration_s")]
    pub duration: f64,
    /// Frames written after the first (which shows rest), evenly spaced.
    pub frames: usize,
    /// Time step [s]; `None` lets the program choose a stable one.
    #[serde(rename = "dt_s")]
    pub dt: Option<f64>,
    /// How the scene goes on in time.
    #[serde(default)]
    pub integrator: Method,
    /// Tolerance of an integrator that has one [m]; `None` takes the program's.
    #[serde(rename = "tolerance_m", default)]
    pub tolerance: Option<f64>,
    /// Whether forces are computed with the same bits on every instruction set.
    #[serde(default)]
    pub exact: bool,
}

/// One entry of the time line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Operation {
    /// Its name in messages; unique in the scene.
    pub name: String,
    /// Begins [s].
    #[serde(rename = "from_s")]
    pub from: f64,
    /// Ends [s]; infinite when it lasts to the end of the run.
    #[serde(rename = "until_s", with = "null_is_endless")]
    pub until: f64,
    /// What it does.
    pub action: Action,
}

/// What an operation does between `from` and `until`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
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
        #[serde(rename = "force_n")]
        force: Vector3,
        /// Time over which the force grows linearly from zero [s].
        #[serde(rename = "ramp_s")]
        ramp: f64,
    },
    /// Presses on faces of cells, following them.
    Pressure {
        /// Which faces.
        on: Pressed,
        /// Inwards where it is positive [Pa].
        #[serde(rename = "pressure_pa")]
        pressure: f64,
        /// Time over which the pressure grows linearly from zero [s].
        #[serde(rename = "ramp_s")]
        ramp: f64,
    },
    /// Grabs a region and moves it along a path, then holds it until the operation ends.
    Grab {
        /// Which particles.
        region: Region,
        /// Displacements from where the region was grabbed, the first one zero, RAS+ [mm]; straight between, at
        /// constant speed.
        #[serde(rename = "path_mm")]
        path: Vec<Vector3>,
        /// When the end of the path is reached [s].
        #[serde(rename = "arrive_s")]
        arrive: f64,
    },
    /// Sweeps the edge of a blade and severs every spring it goes through.
    Cut {
        /// The edge: a polyline of at least two points, RAS+ [mm].
        #[serde(rename = "blade_mm")]
        blade: Vec<Point3>,
        /// Offsets added to every point of `blade`, at least two, RAS+ [mm]: the edge starts at `blade + path[0]` when
        /// the operation begins and is at `blade + path.last()` when it ends; straight between, at constant speed.
        #[serde(rename = "path_mm")]
        path: Vec<Vector3>,
    },
    /// A rigid body that soft tissue cannot enter.
    Tool {
        /// Its shape.
        shape: ToolShape,
        /// Offsets added to its shape, RAS+ [mm]; straight between, at constant speed. One that stands still has one.
        #[serde(rename = "path_mm")]
        path: Vec<Vector3>,
        /// When the end of the path is reached [s].
        #[serde(rename = "arrive_s")]
        arrive: f64,
        /// Coulomb's coefficient.
        friction: f64,
    },
    /// A plane that soft tissue stays on one side of.
    Plane {
        /// Any point of it, RAS+ [mm].
        #[serde(rename = "point_mm")]
        point: Point3,
        /// Direction to the side where tissue stays, of any length.
        normal: Vector3,
        /// Coulomb's coefficient.
        friction: f64,
    },
    /// Rigid organs that stay where they are, which soft tissue cannot enter.
    Bone {
        /// Indices of these organs.
        organs: Vec<usize>,
        /// Coulomb's coefficient.
        friction: f64,
    },
    /// Soft tissue that cannot pass through itself.
    SelfContact {
        /// Indices of the organs that take part.
        organs: Vec<usize>,
        /// Coulomb's coefficient.
        friction: f64,
    },
}

impl Action {
    /// Whether it is something that soft tissue cannot enter.
    pub fn is_obstacle(&self) -> bool {
        matches!(self, Self::Tool { .. } | Self::Plane { .. } | Self::Bone { .. })
    }
}

/// The shape of a tool, where it stands before it is moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ToolShape {
    /// A ball.
    Sphere {
        /// Centre, RAS+ [mm].
        #[serde(rename = "center_mm")]
        center: Point3,
        /// Radius [mm].
        #[serde(rename = "radius_mm")]
        radius: f64,
    },
    /// All places at most a radius from a line.
    Capsule {
        /// One end of the line, RAS+ [mm].
        #[serde(rename = "from_mm")]
        from: Point3,
        /// The other end, RAS+ [mm].
        #[serde(rename = "to_mm")]
        to: Point3,
        /// Radius [mm].
        #[serde(rename = "radius_mm")]
        radius: f64,
    },
    /// A box along the axes.
    Box {
        /// Lowest corner, RAS+ [mm].
        #[serde(rename = "min_mm")]
        min: Point3,
        /// Highest corner, RAS+ [mm].
        #[serde(rename = "max_mm")]
        max: Point3,
    },
    /// The inside of a closed triangle mesh [mm, RAS+].
    Mesh {
        /// STL file.
        file: PathBuf,
    },
}

/// Faces that are pressed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Pressed {
    /// Those that border on nothing and whose middle, at rest, lies in a region.
    Border(Region),
    /// The lips of a cut, by the name of the operation.
    LipsOf(String),
}

/// JSON has no infinity: a time without end is written as `null`.
mod null_is_endless {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(until: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        until.is_finite().then_some(*until).serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        let region = Region::Any(vec![
            Region::Sphere { center: Point3::new(0.1 + 0.2, -1e-300, 5e300), radius: 1.0 / 3.0 },
            Region::Not(Box::new(Region::All(vec![
                Region::Organ(3),
                Region::Box { min: Point3::origin(), max: Point3::new(1.0, 2.0, 3.0) },
                Region::Nearest { point: Point3::new(1.0, 2.0, 3.0), count: 7 },
            ]))),
            Region::HalfSpace { point: Point3::origin(), normal: Vector3::z() },
        ]);
        let paper = Body::Paper { stiffness: 0.1, damping: 0.7e-3, mass: 1e-5 };
        let tissue = |youngs_modulus, density, damping| Body::Tissue {
            youngs_modulus,
            poissons_ratio: 0.1 + 0.2,
            density,
            damping,
        };
        let map = |values: [f64; 2]| Property::FromHu(vec![[-100.0, values[0]], [0.1 + 0.2, values[1]]]);
        let file = |name: &str| Property::FromFile(name.into());
        let constant = tissue(Property::Constant(5e3), Property::Constant(1060.0), Damping::Ratio(0.1));
        let mapped = tissue(map([2e3, 1e5 / 3.0]), file("/data/density.nii.gz"), Damping::Viscosity(0.7));
        let measured = tissue(file("/data/e.nii.gz"), map([900.0, 1e3 / 0.9]), Damping::Viscosity(0.0));
        let labels = |label| VoxelSelection::Labels(vec![label]);
        let color = [0.1, 0.2, 1.0 / 3.0];
        let organ = |name: &str, voxels, body| Organ {
            name: name.into(),
            voxels,
            body,
            fibres: None,
            inelastic: Inelastic::default(),
            color,
            look: None,
        };
        let colors = Look::Colors(vec![LookColor { hu: -0.1, color }, LookColor { hu: 1e3 / 3.0, color }]);
        let tool =
            |shape| Action::Tool { shape, path: vec![Vector3::zeros(), Vector3::x()], arrive: 0.1, friction: 0.7 };
        let actions = [
            Action::Fix { region: region.clone() },
            Action::Force { region: region.clone(), force: Vector3::new(0.0, -3.1, 0.0), ramp: 0.02 },
            Action::Grab {
                region: region.clone(),
                path: vec![Vector3::zeros(), Vector3::new(0.0, -20.0, 0.3)],
                arrive: 0.4,
            },
            Action::Cut { blade: vec![Point3::origin(); 2], path: vec![Vector3::x(), Vector3::y()] },
            Action::Pressure { on: Pressed::Border(region), pressure: 1e3 / 3.0, ramp: 0.02 },
            Action::Pressure { on: Pressed::LipsOf("cut".into()), pressure: -0.1, ramp: 0.0 },
            tool(ToolShape::Sphere { center: Point3::new(0.1, 0.2, 1.0 / 3.0), radius: 0.1 + 0.2 }),
            tool(ToolShape::Capsule { from: Point3::origin(), to: Point3::new(0.1, -0.7, 3.0), radius: 4.0 }),
            tool(ToolShape::Box { min: Point3::origin(), max: Point3::new(1.0, 2.0, 0.1 + 0.2) }),
            tool(ToolShape::Mesh { file: "/data/tool.stl".into() }),
            Action::Plane {
                point: Point3::new(0.0, 0.1, 0.0),
                normal: Vector3::new(0.0, 1.0 / 3.0, 1.0),
                friction: 0.3,
            },
            Action::Bone { organs: vec![2, 3], friction: 0.1 + 0.2 },
            Action::SelfContact { organs: vec![0, 1], friction: 0.1 + 0.2 },
        ];
        Scene {
            volume: VolumeSource::Files { image: Some("a/ct.nii.gz".into()), labels: None },
            lattice: LatticeSpec { model: Model::Tissue, pitch: Some(0.003) },
            organs: vec![
                organ("a", VoxelSelection::Labels(vec![1, 65535]), paper),
                organ("b", VoxelSelection::Hu { min: -0.1, max: 120.3 }, constant),
                Organ {
                    look: Some(Look::Window([-0.1, 1e2 / 3.0])),
                    ..organ("c", labels(7), Body::Rigid { density: None })
                },
                Organ {
                    look: Some(colors),
                    ..organ("d", labels(8), Body::Rigid { density: Some(Property::Constant(1920.0)) })
                },
                Organ {
                    fibres: Some(Fibres { direction: Vector3::new(0.6, 0.0, 0.8), modulus: 1e5 / 3.0 }),
                    inelastic: Inelastic {
                        relaxation: Some(Relaxation { ratio: 1.0 / 3.0, time: 0.1 }),
                        plasticity: Some(Plasticity { yield_strain: 0.07, time: 0.0 }),
                        tear_strain: Some(0.35),
                    },
                    ..organ("e", labels(9), mapped)
                },
                organ("f", labels(10), measured),
            ],
            accuracy: Some(0.1 + 0.2),
            time: TimeSpec {
                duration: 0.4,
                frames: 40,
                dt: None,
                integrator: Method::SymplecticEuler,
                tolerance: None,
                exact: false,
            },
            gravity: Vector3::new(0.0, 0.0, -9.81),
            drag: Some(0.3),
            sleep: Some(SleepSpec { tolerance: Some(0.1 + 0.2), window: None }),
            operations: actions
                .into_iter()
                .zip([f64::INFINITY, 0.1 + 0.2, 1e9].into_iter().cycle())
                .map(|(action, until)| Operation { name: format!("{until}"), from: 0.1, until, action })
                .collect(),
        }
    }

    #[test]
    fn json_gives_the_same_scene_back() {
        let files = scene();
        let volume = VolumeSource::Phantom { kind: PhantomKind::Abdomen, spacing: 4.1, seed: u64::MAX };
        let phantom = Scene { volume, ..files.clone() };
        for scene in [files, phantom] {
            let text = serde_json::to_string_pretty(&scene).unwrap();
            assert_eq!(serde_json::from_str::<Scene>(&text).unwrap(), scene, "{text}");
        }
    }

    #[test]
    fn json_names_its_units_and_has_null_for_no_end() {
        let value = serde_json::to_value(scene()).unwrap();
        assert_eq!(value["lattice"]["pitch_m"], 0.003);
        let tissue = |organ: usize| &value["organs"][organ]["body"]["tissue"];
        assert_eq!(tissue(1)["youngs_modulus_pa"]["constant"], 5e3);
        assert_eq!(tissue(1)["damping"]["ratio"], 0.1);
        assert_eq!(tissue(4)["youngs_modulus_pa"]["from_hu"][0][1], 2e3);
        assert_eq!(tissue(4)["damping"]["viscosity_pa_s"], 0.7);
        assert_eq!(tissue(5)["youngs_modulus_pa"]["from_file"], "/data/e.nii.gz");
        assert_eq!(tissue(1)["density_kg_per_m3"]["constant"], 1060.0);
        assert_eq!(tissue(4)["density_kg_per_m3"]["from_file"], "/data/density.nii.gz");
        assert_eq!(tissue(5)["density_kg_per_m3"]["from_hu"][0][1], 900.0);
        assert_eq!(value["organs"][3]["body"]["rigid"]["density_kg_per_m3"]["constant"], 1920.0);
        assert!(value["organs"][2]["body"]["rigid"]["density_kg_per_m3"].is_null());
        assert_eq!(value["organs"][2]["look"]["window_hu"][0], -0.1_f32);
        assert_eq!(value["organs"][3]["look"]["colors"][1]["color_linear_rgb"][0], 0.1_f32);
        assert_eq!(value["organs"][0]["voxels"]["labels"][1], 65535);
        assert_eq!(value["organs"][4]["fibres"]["modulus_pa"], 1e5 / 3.0);
        assert_eq!(value["organs"][4]["inelastic"]["relaxation"]["time_s"], 0.1);
        assert_eq!(value["drag_per_s"], 0.3);
        assert!(value["operations"][0]["until_s"].is_null());
        let region = &value["operations"][0]["action"]["fix"]["region"];
        assert_eq!(region["any"][0]["sphere"]["center_mm"][0], 0.1 + 0.2);
        assert_eq!(value["operations"][3]["action"]["cut"]["path_mm"][0][0], 1.0);
        let tool = |operation: usize| &value["operations"][operation]["action"]["tool"];
        assert_eq!(tool(6)["shape"]["sphere"]["radius_mm"], 0.1 + 0.2);
        assert_eq!((&tool(7)["arrive_s"], &tool(7)["path_mm"][1][0]), (&0.1.into(), &1.0.into()));
        assert_eq!(value["operations"][10]["action"]["plane"]["point_mm"][1], 0.1);
    }

    /// Runs written while a density was always a number.
    #[test]
    fn a_density_without_a_tag_is_constant() {
        let scene = scene();
        let mut value = serde_json::to_value(&scene).unwrap();
        value["organs"][1]["body"]["tissue"]["density_kg_per_m3"] = 1060.0.into();
        value["organs"][3]["body"]["rigid"]["density_kg_per_m3"] = 1920.0.into();
        assert_eq!(serde_json::from_value::<Scene>(value).unwrap(), scene);
    }

    proptest::proptest! {
        #[test]
        fn every_finite_number_survives_json(bits: u64, pitch: f64) {
            let duration = f64::from_bits(bits);
            proptest::prop_assume!(duration.is_finite());
            let scene = Scene {
                lattice: LatticeSpec { model: Model::Paper, pitch: Some(pitch) },
                time: TimeSpec { duration, frames: 1, dt: None, integrator: Method::SymplecticEuler, tolerance: None, exact: false },
                ..scene()
            };
            let text = serde_json::to_string(&scene).unwrap();
            proptest::prop_assert_eq!(serde_json::from_str::<Scene>(&text).unwrap(), scene);
        }
    }
}
