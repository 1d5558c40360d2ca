//! The scene as it is written in TOML: plain structs, one per table, nothing checked beyond types and key names.
//!
//! The doc comments of the keys are for users: they become the descriptions of the JSON schema, so each gives the
//! unit, the default and an example. What may be combined with what is checked in [`super::resolve`].

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Deserialize;

use super::resolved::{Model, PhantomKind};
use super::values::{ColorPoint, LabelList, Pair, Switch, Triple, some_table, table, tables};
use super::written_property::{Density, Written, YoungsModulus};
use crate::dynamics::integrator::Method;

/// A scene of yawara: which organs, which material, what is done to them, and when.
///
/// Lengths are millimetres in patient space, RAS+: x grows to the patient's right, y to the front, z to the head.
/// Everything else is SI: seconds, newtons, pascals, kilograms.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "yawara scene")]
pub(super) struct SceneFile {
    /// Largest error of the whole run, from 1e-6 to 0.5: how far particles are from where ever finer lattices and shorter steps
    /// would have them (root mean square over the tissue, at the worst frame), over the largest displacement. The program chooses
    /// integrator and step for it, and, unless `lattice.pitch` is given, the pitch too; it tries coarse lattices first, says what it
    /// chose and why, and at the end what it reached. Comes before all tables. Default: none; pitch and step are chosen for
    /// themselves. Example: `accuracy = 0.02`.
    #[schemars(extend("minimum" = 1e-6, "maximum" = 0.5))]
    pub(super) accuracy: Option<f64>,
    /// Leaves blocks of 16 x 8 x 8 grid points out of the step while they are at rest, and wakes them when something reaches
    /// them: true, or a table `[sleep]` with `tolerance` and `window`. `true` comes before all tables. Only with
    /// `time.integrator = "symplectic_euler"`. Default: false, every block is stepped. Example: `sleep = true`.
    pub(super) sleep: Option<Switch<Sleep>>,
    /// Where the voxels come from: files, or a phantom made by the program.
    #[serde(deserialize_with = "table")]
    pub(super) volume: Volume,
    /// How particles are laid over the voxels. Default: model "tissue" at the volume's own spacing.
    #[serde(default, deserialize_with = "table")]
    pub(super) lattice: Lattice,
    /// The organs to simulate, at least one, each in its own `[[organ]]` table. A voxel belongs to the first organ that
    /// selects it; voxels that no organ selects are left out.
    #[serde(deserialize_with = "tables")]
    #[schemars(length(min = 1))]
    pub(super) organ: Vec<Organ>,
    /// How long to simulate, how many frames to write, and with which step.
    #[serde(deserialize_with = "table")]
    pub(super) time: Time,
    /// Gravity. Default: none, for a CT shows organs that already hang in it.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) gravity: Option<Gravity>,
    /// Drag that slows all free motion. Default: none.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) drag: Option<Drag>,
    /// Regions held where they are, each in its own `[[fix]]` table. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) fix: Vec<Fix>,
    /// Sweeps of a blade, each in its own `[[cut]]` table. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) cut: Vec<Cut>,
    /// Regions pulled by a force or grabbed and moved, each in its own `[[pull]]` table. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) pull: Vec<Pull>,
    /// The same as `pull` under the other word: the direction is that of `force` or `path`. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) push: Vec<Pull>,
    /// Pressures on surfaces, each in its own `[[pressure]]` table; model "tissue" only. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) pressure: Vec<Pressure>,
    /// Rigid tools that tissue cannot enter, each in its own `[[tool]]` table. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) tool: Vec<Tool>,
    /// Planes that tissue stays on one side of, such as a table, each in its own `[[plane]]` table. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) plane: Vec<Plane>,
    /// Contact of soft tissue with bone. Default: none.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) contact: Option<Contact>,
    /// Contact of soft tissue with itself. Default: none; the lips of a cut may then pass through each other.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) self_contact: Option<SelfContact>,
    /// Ends of a fix, pull, push, pressure, tool or plane before the run ends, each in its own `[[release]]` table. Default: none.
    #[serde(default, deserialize_with = "tables")]
    pub(super) release: Vec<Release>,
}

/// Where the voxels come from: files (`image`, `labels` or both), or a `phantom`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Volume {
    /// CT image [HU]; a path relative to the scene file. May be left out when `labels` is given: surfaces are then
    /// smoother than voxels but know no gray values. Example: `image = "ct.nii.gz"`.
    pub(super) image: Option<PathBuf>,
    /// Label map on the grid of the image, 0 for background; a path relative to the scene file. May be left out when
    /// every organ is chosen by `hu`. Example: `labels = "segmentation.nii.gz"`.
    pub(super) labels: Option<PathBuf>,
    /// Text file with one `id <tab> name` per line, so that organs can say `label = "liver"`; a path relative to the
    /// scene file. A phantom needs none: its labels have names. Default: none. Example: `label_names = "labels.tsv"`.
    pub(super) label_names: Option<PathBuf>,
    /// Instead of files, a volume made by the program: "abdomen" (liver with vessels, kidney, spine, ribs, fat, skin),
    /// "cube" or "beam". Example: `phantom = "abdomen"`.
    pub(super) phantom: Option<PhantomKind>,
    /// Voxel spacing of the phantom [mm], from 0.5 to 10. Default: 3. Example: `spacing = 4.0`.
    #[schemars(extend("minimum" = 0.5, "maximum" = 10))]
    pub(super) spacing: Option<f64>,
    /// Seed of the phantom's noise and texture; the same seed gives the same voxels. Default: 1. Example: `seed = 7`.
    pub(super) seed: Option<u64>,
}

/// How particles are laid over the voxels.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Lattice {
    /// Which law joins the particles. "tissue": springs sized for a Young's modulus and a density. "paper": equal
    /// springs, dampers and masses, as Hattori and Kaneko describe. Default: "tissue". Example: `model = "paper"`.
    pub(super) model: Option<Model>,
    /// Distance of neighbouring particles [mm], from 0.01 to 100. Default: the volume's own spacing.
    /// Example: `pitch = 3.0`.
    #[schemars(extend("minimum" = 0.01, "maximum" = 100))]
    pub(super) pitch: Option<f64>,
}

/// One organ: which voxels, and what it is made of.
///
/// Model "tissue" takes a `material` by name, or the numbers `youngs_modulus`, `poissons_ratio`, `density` and one of
/// `damping_ratio` and `viscosity`, and `fibres`; a number given beside a material replaces that of the material. Model "paper" takes
/// `stiffness`, `damping` and `mass`. Both take `relaxation`, `plasticity` and `tear_strain`. An organ with `rigid = true` takes none of them but `density`, or the density of a
/// `material`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Organ {
    /// Name of the organ, unique in the scene; regions and files refer to it. Example: `name = "liver"`.
    pub(super) name: String,
    /// Voxels with this label: a number from 1 to 65535, a name, or a list of them. A label belongs to one organ only.
    /// Either `label` or `hu` is needed. Example: `label = 5`, `label = "liver"` or `label = ["rib_left_7", 65]`.
    pub(super) label: Option<LabelList>,
    /// Voxels whose CT number lies between these two, borders included [HU]. Either `label` or `hu` is needed.
    /// Example: `hu = [0, 120]`.
    pub(super) hu: Option<Pair>,
    /// Bone: particles that do not deform. With a `density` (or a `material`, of which only the density is taken) the
    /// organ moves freely as one rigid body; without, it stays where it is unless an operation moves it. Default: false.
    /// Example: `rigid = true`.
    #[serde(default)]
    pub(super) rigid: bool,
    /// A tissue by name, which gives Young's modulus, Poisson's ratio and density; the keys below replace one number
    /// each. One of aorta, bladder, bone, bowel, brain, cartilage, fat, gallbladder, heart, kidney, liver, lung, muscle,
    /// pancreas, skin, spleen, stomach, thyroid and trabecular_bone; model "tissue", or rigid. Default: none, and
    /// `youngs_modulus` and `density` are needed. Example: `material = "liver"`.
    pub(super) material: Option<String>,
    /// Young's modulus [Pa], above 0; model "tissue" only. A number, a map from CT numbers, or a volume of moduli on the
    /// grid of the image or labels. Default: that of `material`; without one it is needed. Liver is about 5 kPa.
    /// Example: `youngs_modulus = 5e3`, `youngs_modulus = { hu = [[-100, 2e3], [0, 5e3], [100, 2e4]] }` or
    /// `youngs_modulus = { file = "stiffness.nii.gz" }`.
    pub(super) youngs_modulus: Option<Written<YoungsModulus>>,
    /// Poisson's ratio, from 0 to 0.49; model "tissue" only. Default: that of `material` (0.45 for soft tissue), without
    /// one 0.25, which is what springs alone have and costs nothing extra. Any other value adds a volume term to every
    /// cell, and the nearer to 1/2, the smaller the time step: at 0.49 it is half that at 0.45 without
    /// dampers and a quarter with a damping_ratio of 0.2. Below 0.25 the term is negative, which is sound at small strain
    /// only. Example: `poissons_ratio = 0.45`.
    #[schemars(extend("minimum" = 0, "maximum" = 0.49))]
    pub(super) poissons_ratio: Option<f64>,
    /// Density [kg/m^3], above 0; model "tissue", or rigid. A number, a map from CT numbers (points, or a published one by
    /// its name), or a volume of densities on the grid of the image or labels. Default: that of `material`; without one
    /// it is needed unless the organ is rigid.
    /// Example: `density = 1060`, `density = { hu = [[-100, 930], [0, 1000], [100, 1100]] }`,
    /// `density = { hu = "schneider_2000" }` or `density = { file = "density.nii.gz" }`.
    pub(super) density: Option<Written<Density>>,
    /// Damping relative to critical at the lattice's own frequency, sqrt(youngs_modulus / density) / pitch; 0 or more,
    /// model "tissue" only. Another pitch damps the same motion differently; `viscosity`, given instead, does not. Where
    /// `accuracy` or a study tries other pitches, it stands for the viscosity that it has at the scene's own.
    /// Default: 0.1, unless `viscosity` is given. Example: `damping_ratio = 0.2`.
    #[schemars(extend("minimum" = 0))]
    pub(super) damping_ratio: Option<f64>,
    /// Viscosity of a slowly pulled bar [Pa s], 0 or more, instead of `damping_ratio`: stress is youngs_modulus times
    /// strain plus this times the rate of strain, the same material at every pitch; model "tissue" only. Default: none,
    /// `damping_ratio` holds. Example: `viscosity = 5`.
    #[schemars(extend("minimum" = 0))]
    pub(super) viscosity: Option<f64>,
    /// Fibres of one direction that stiffen the organ when it is drawn out along them; model "tissue" only. Default: none.
    /// Example: `fibres = { direction = [0, 0, 1], modulus = 2e4 }`.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) fibres: Option<Fibres>,
    /// A part of its tension that the organ lets go in time, beside what lasts: it is stiffer against fast motion. Default: none.
    /// Example: `relaxation = { ratio = 0.5, time = 0.2 }`.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) relaxation: Option<Relaxation>,
    /// Strain beyond which the organ stays deformed. Default: none. Example: `plasticity = { yield_strain = 0.1 }`.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) plasticity: Option<Plasticity>,
    /// Strain at which its springs tear, from 0.001 to 10: a property of the tissue at a pitch. Default: nothing tears.
    /// Example: `tear_strain = 0.4`.
    #[schemars(extend("minimum" = 1e-3, "maximum" = 10))]
    pub(super) tear_strain: Option<f64>,
    /// Spring constant [N/m], above 0; model "paper" only, no default. Example: `stiffness = 10`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) stiffness: Option<f64>,
    /// Dashpot constant of a spring [N s/m], 0 or more; model "paper" only, no default. The damper of the paper belongs
    /// to one time step and is this divided by it. Example: `damping = 0.01`.
    #[schemars(extend("minimum" = 0))]
    pub(super) damping: Option<f64>,
    /// Mass of one particle [kg], above 0; model "paper" only, no default. Example: `mass = 3e-5`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) mass: Option<f64>,
    /// Colour of surfaces, sRGB as `#rrggbb`. Default: a colour that goes with the name (liver, kidney, bone, ...) or
    /// else with the place in the list. Example: `color = "#8c3b2e"`.
    #[schemars(regex(pattern = "^#[0-9a-fA-F]{6}$"))]
    pub(super) color: Option<String>,
    /// How the CT inside the organ becomes colour where surfaces show it, on faces of cuts above all. Needs a CT image or a
    /// phantom. Default: shades of the organ's colour that go with its name, over a window found in its own CT numbers.
    /// Example: `look = { window = [0, 130] }`, or with colours of your own,
    /// `look = { colors = [[-100, "#e3c878"], [50, "#8c3b2e"], [180, "#f2b49c"]] }`.
    #[serde(default, deserialize_with = "some_table")]
    pub(super) look: Option<Look>,
}

/// Fibres of one direction. Pulled along them, the organ has the Young's modulus `youngs_modulus` + `modulus`; pressed, or
/// pulled across them, it is as without: they buckle.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Fibres {
    /// Their direction at rest, RAS+; its length does not matter. Example: `direction = [0, 0, 1]`.
    pub(super) direction: Triple,
    /// What they add to Young's modulus along them [Pa], above 0; the stable step becomes shorter as with a stiffer organ.
    /// They do not damp. Example: `modulus = 2e4`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) modulus: f64,
}

/// A Maxwell branch beside every spring (standard linear solid): stretched and held, the organ pulls with
/// `1 + ratio exp(-t / time)` times what it pulls with in the end.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Relaxation {
    /// Stiffness of the branch over that of the springs, from 0.001 to 1000; the stable step becomes shorter as with an organ
    /// `1 + ratio` times as stiff. Example: `ratio = 0.5`.
    #[schemars(extend("minimum" = 1e-3, "maximum" = 1e3))]
    pub(super) ratio: f64,
    /// In which its tension falls to 1/e [s], above 0. Example: `time = 0.2`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) time: f64,
}

/// How an organ yields: the strain of a spring beyond `yield_strain`, in tension or under pressure, stays when it is let go.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Plasticity {
    /// Elastic strain of a spring beyond which it yields, from 0.0001 to 0.5. Example: `yield_strain = 0.1`.
    #[schemars(extend("minimum" = 1e-4, "maximum" = 0.5))]
    pub(super) yield_strain: f64,
    /// In which what is beyond falls to 1/e [s], 0 or more. Default: 0, at once. Example: `time = 0.05`.
    #[schemars(extend("minimum" = 0))]
    pub(super) time: Option<f64>,
}

/// How CT numbers become colours: one of these keys.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("minProperties" = 1, "maxProperties" = 1))]
pub(super) struct Look {
    /// The CT numbers [HU] of the darkest and of the brightest shade of the organ. Example: `look = { window = [0, 130] }`.
    pub(super) window: Option<Pair>,
    /// Colours at CT numbers: points [HU, "#rrggbb"] by ascending HU, at least two, sRGB; straight between them (in Oklab,
    /// where equal steps look equal), constant beyond the ends.
    /// Example: `look = { colors = [[0, "#4a1f18"], [120, "#f2b49c"]] }`.
    #[schemars(length(min = 2))]
    pub(super) colors: Option<Vec<ColorPoint>>,
}

/// How long, how many frames, which step.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Time {
    /// Simulated time [s], above 0. Needed unless `steps` is given. Example: `duration = 0.4`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) duration: Option<f64>,
    /// Number of time steps, instead of `duration`; needs `dt`. Example: `steps = 100`.
    #[schemars(extend("minimum" = 1))]
    pub(super) steps: Option<u64>,
    /// Frames to write after the first, which shows rest; evenly spaced in time, from 1 to 100000, and not more than
    /// there are steps. Default: 30, or one per step where that is less. Example: `frames = 40`.
    #[schemars(extend("minimum" = 1, "maximum" = 100_000))]
    pub(super) frames: Option<u64>,
    /// Time step [s], above 0. Default: chosen by the program so that the run is stable. Example: `dt = 1e-4`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) dt: Option<f64>,
    /// How the scene goes on in time. Default: "symplectic_euler", the plain step, the only one with rigid bodies that move and
    /// with obstacles. "verlet" is of order 2 and "rk4" of order 4; "bogacki_shampine" divides its steps until each keeps a
    /// tolerance; "backward_euler" is stable at any step and damps what is fast; "quasi_static" knows no motion, only the
    /// settled shape at each step. Example: `integrator = "verlet"`.
    pub(super) integrator: Option<Method>,
    /// Largest error of a place [mm], above 0: per step of "bogacki_shampine", and where the iteration of
    /// "backward_euler" and "quasi_static" ends. Default: 1e-5. Example: `tolerance = 1e-4`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) tolerance: Option<f64>,
    /// Computes forces with true square roots and nothing fused: the same bits on every instruction set, but slower (see
    /// `yawara bench effects`). Without it the last bits belong to the machine's instruction set; results are the same at any
    /// number of threads either way. Default: false. Example: `exact = true`.
    #[serde(default)]
    pub(super) exact: bool,
}

/// Gravity.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Gravity {
    /// Acceleration of every particle that is free to move, RAS+ [m/s^2]. On the back, as in most CT scans, down is -y.
    /// Example: `acceleration = [0, -9.81, 0]`.
    pub(super) acceleration: Triple,
}

/// Drag in proportion to mass.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Drag {
    /// Velocities of all that is free to move, soft tissue and rigid bodies, die down like exp(-rate t) besides what forces
    /// do to them [1/s], above 0. A fall ends at gravity over rate; a rest shape stays what it is and is reached
    /// soonest with twice the angular frequency of the slowest swing. Example: `rate = 2.0`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) rate: f64,
}

/// When blocks at rest are left out of the step.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Sleep {
    /// How far particles may be off because blocks sleep, near enough [mm], above 0: a block sleeps while it and its surroundings
    /// move by less. Default: a hundredth of the pitch. Example: `tolerance = 0.05`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) tolerance: Option<f64>,
    /// How long a block has to be at rest before it sleeps, twice in a row [s], above 0. Shorter than a quarter of the period in which
    /// the body swings, it also sleeps where it turns. Default: the time in which a shear wave crosses the longest side of the
    /// lattice. Example: `window = 0.1`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) window: Option<f64>,
}

/// A region held where it is.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Fix {
    /// Name for messages and for `[[release]]`. Default: "fix 1", "fix 2", ... Example: `name = "ligament"`.
    pub(super) name: Option<String>,
    /// Which particles. Example: `region = { half_space = { point = [0, 0, 40], normal = [0, 0, 1] } }`.
    pub(super) region: Region,
    /// Begins [s], 0 or more. Default: 0. Example: `from = 0.1`.
    #[schemars(extend("minimum" = 0))]
    pub(super) from: Option<f64>,
    /// Ends [s], after `from`. Default: the end of the run. Example: `to = 0.3`.
    pub(super) to: Option<f64>,
}

/// A sweep of a blade: every spring the edge goes through is severed.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Cut {
    /// Name for messages. Default: "cut 1", "cut 2", ... Example: `name = "incision"`.
    pub(super) name: Option<String>,
    /// The edge of the blade: at least two points joined by straight lines [mm].
    /// Example: `blade = [[-60, 0, 0], [60, 0, 0]]`.
    #[schemars(length(min = 2))]
    pub(super) blade: Vec<Triple>,
    /// How the edge moves: at least two offsets [mm] added to every point of `blade`, straight between and at constant
    /// speed. `[[0, 80, 0], [0, 0, 0]]` starts 80 mm in front of where the blade is drawn and ends where it is drawn.
    /// Example: `path = [[0, 80, 0], [0, 0, 0]]`.
    #[schemars(length(min = 2))]
    pub(super) path: Vec<Triple>,
    /// When the edge leaves the first place of its path [s], 0 or more. Default: 0. Example: `from = 0.05`.
    #[schemars(extend("minimum" = 0))]
    pub(super) from: Option<f64>,
    /// When the edge reaches the end of its path [s], after `from`. Example: `to = 0.15`.
    pub(super) to: f64,
}

/// A region pulled or pushed: by a `force`, or grabbed and moved along a `path`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Pull {
    /// Name for messages and for `[[release]]`. Default: "pull 1", "push 1", ... Example: `name = "clamp"`.
    pub(super) name: Option<String>,
    /// Which particles. Example: `region = { sphere = { center = [10, -40, 0], radius = 12 } }`.
    pub(super) region: Region,
    /// Total force on the region, RAS+ [N], shared in proportion to mass. Either `force` or `path` is needed.
    /// Example: `force = [0, -3, 0]`.
    pub(super) force: Option<Triple>,
    /// Time over which the force grows from zero [s], 0 or more; with `force` only. Default: 0. Example: `ramp = 0.02`.
    #[schemars(extend("minimum" = 0))]
    pub(super) ramp: Option<f64>,
    /// Grabs the region and moves it: displacements from where it was grabbed [mm], the first one zero, straight
    /// between and at constant speed. Held at the last one until the run ends or a `[[release]]` says so. Either
    /// `force` or `path` is needed. Example: `path = [[0, 0, 0], [0, -20, 0]]`.
    #[schemars(length(min = 2))]
    pub(super) path: Option<Vec<Triple>>,
    /// Begins [s], 0 or more. Default: 0. Example: `from = 0.15`.
    #[schemars(extend("minimum" = 0))]
    pub(super) from: Option<f64>,
    /// With `force`: when it ends; with `path`: when the end of the path is reached [s]; after `from`. Default: the end
    /// of the run. Example: `to = 0.4`.
    pub(super) to: Option<f64>,
}

/// A pressure on faces of cells, at right angles to them as they move and turn: on those that border on nothing in a `region`, or
/// on the lips of a `cut`, which it opens. A face that is cut itself lets go.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Pressure {
    /// Name for messages and for `[[release]]`. Default: "pressure 1", "pressure 2", ... Example: `name = "blood"`.
    pub(super) name: Option<String>,
    /// Which faces: those that border on nothing and whose middle, at rest, lies in the region; of an organ those of its own
    /// cells. A region around a hollow takes the faces that look into it. Either `region` or `cut` is needed.
    /// Example: `region = { sphere = { center = [0, 0, 0], radius = 12 } }`.
    pub(super) region: Option<Region>,
    /// Name of a cut: the faces of the cells beside those it went through, as far as it has come. Either `region` or `cut` is
    /// needed. Example: `cut = "incision"`.
    pub(super) cut: Option<String>,
    /// Pressure [Pa], not 0: positive pushes into the tissue, negative sucks. 1 mmHg is 133 Pa. Example: `pressure = 2e3`.
    pub(super) pressure: f64,
    /// Time over which the pressure grows from zero [s], 0 or more. Default: 0. Example: `ramp = 0.02`.
    #[schemars(extend("minimum" = 0))]
    pub(super) ramp: Option<f64>,
    /// Begins [s], 0 or more. Default: 0. Example: `from = 0.1`.
    #[schemars(extend("minimum" = 0))]
    pub(super) from: Option<f64>,
    /// Ends [s], after `from`. Default: the end of the run. Example: `to = 0.3`.
    pub(super) to: Option<f64>,
}

/// A rigid tool: soft tissue cannot enter it, and it moves whatever happens.
///
/// Tissue is met at its particles, so a tool should be wider than two pitches of the lattice. Bone that moves feels no tool.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Tool {
    /// Name for messages and for `[[release]]`. Default: "tool 1", "tool 2", ... Example: `name = "probe"`.
    pub(super) name: Option<String>,
    /// Its shape. Example: `shape = { sphere = { center = [0, 0, 40], radius = 10 } }`.
    pub(super) shape: ToolShape,
    /// How it moves, without turning: offsets [mm] added to its shape, at least two, straight between and at constant speed.
    /// It stays at the last one. Default: it stands still. Example: `path = [[0, 0, 0], [0, -20, 0]]`.
    #[schemars(length(min = 2))]
    pub(super) path: Option<Vec<Triple>>,
    /// Appears [s], 0 or more. Tissue that is inside then is led out slowly. Default: 0. Example: `from = 0.1`.
    #[schemars(extend("minimum" = 0))]
    pub(super) from: Option<f64>,
    /// With `path`: when its end is reached; without: when the tool is taken away [s]; after `from`. Default: the end of the
    /// run. Example: `to = 0.3`.
    pub(super) to: Option<f64>,
    /// Coefficient of friction of tissue on it (Coulomb), 0 or more. Default: 0. Example: `friction = 0.2`.
    #[schemars(extend("minimum" = 0))]
    pub(super) friction: Option<f64>,
}

/// The shape of a tool: exactly one of these keys.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum ToolShape {
    /// A ball. Example: `{ sphere = { center = [0, 0, 40], radius = 10 } }`.
    #[serde(deserialize_with = "table")]
    Sphere(Sphere),
    /// A rod with round ends. Example: `{ capsule = { from = [0, 0, 40], to = [0, 60, 90], radius = 4 } }`.
    #[serde(deserialize_with = "table")]
    Capsule(Capsule),
    /// A box along the axes. Example: `{ box = { min = [-10, -10, 30], max = [10, 10, 50] } }`.
    #[serde(deserialize_with = "table")]
    Box(Corners),
    /// A closed triangle mesh. Example: `{ mesh = { file = "tool.stl" } }`.
    #[serde(deserialize_with = "table")]
    Mesh(MeshFile),
}

/// A rod with round ends.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Capsule {
    /// One end of its axis, RAS+ [mm]. Example: `from = [0, 0, 40]`.
    pub(super) from: Triple,
    /// The other end, RAS+ [mm]. Example: `to = [0, 60, 90]`.
    pub(super) to: Triple,
    /// Radius [mm], above 0. Example: `radius = 4`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) radius: f64,
}

/// A triangle mesh in a file.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct MeshFile {
    /// STL file, RAS+ [mm], closed and with its normals outward; a path relative to the scene file. Distances to it are sampled
    /// every quarter of a pitch, or as finely as two million samples allow. Example: `file = "tool.stl"`.
    pub(super) file: PathBuf,
}

/// A plane that tissue stays on one side of: a table, a bed, a wall.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Plane {
    /// Name for messages and for `[[release]]`. Default: "plane 1", "plane 2", ... Example: `name = "table"`.
    pub(super) name: Option<String>,
    /// Any point of the plane, RAS+ [mm]. Example: `point = [0, -60, 0]`.
    pub(super) point: Triple,
    /// Direction to the side where tissue stays; its length does not matter. Example: `normal = [0, 1, 0]`.
    pub(super) normal: Triple,
    /// Coefficient of friction of tissue on it (Coulomb), 0 or more. Default: 0. Example: `friction = 0.3`.
    #[schemars(extend("minimum" = 0))]
    pub(super) friction: Option<f64>,
}

/// Contact of soft tissue with bone.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Contact {
    /// Soft tissue cannot enter rigid organs that stay where they are (`rigid = true` without a density) or go, as wholes, where
    /// a `pull` with a path takes them. Default: false.
    /// Example: `bone = true`.
    #[serde(default)]
    pub(super) bone: bool,
    /// Coefficient of friction of tissue on bone (Coulomb), 0 or more. Default: 0. Example: `friction = 0.1`.
    #[schemars(extend("minimum" = 0))]
    pub(super) friction: Option<f64>,
}

/// Contact of soft tissue with itself: the lips of a cut, organs that nothing joins, a flap and what it is folded onto. The table
/// may be empty.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct SelfContact {
    /// Names of the organs that take part; others pass through them and through each other. Default: all that are not rigid.
    /// Example: `organs = ["liver", "stomach"]`.
    #[schemars(length(min = 1))]
    pub(super) organs: Option<Vec<String>>,
    /// Coefficient of friction of tissue on tissue (Coulomb), 0 or more. Default: 0. Example: `friction = 0.1`.
    #[schemars(extend("minimum" = 0))]
    pub(super) friction: Option<f64>,
}

/// Ends a fix, pull, push or pressure, or takes a tool or plane away.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Release {
    /// Name of the fix, pull, push, pressure, tool or plane that ends. Example: `of = "clamp"`.
    pub(super) of: String,
    /// When [s], after it began. Example: `at = 0.3`.
    pub(super) at: f64,
}

/// A set of particles: exactly one of these keys. Places are those at rest; borders count as inside.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Region {
    /// Particles at most `radius` from `center`. Example: `{ sphere = { center = [10, -40, 0], radius = 12 } }`.
    #[serde(deserialize_with = "table")]
    Sphere(Sphere),
    /// Particles in a box along the axes. Example: `{ box = { min = [-10, -10, -10], max = [10, 10, 10] } }`.
    #[serde(deserialize_with = "table")]
    Box(Corners),
    /// Particles on the side of a plane that its normal points to.
    /// Example: `{ half_space = { point = [0, 0, 40], normal = [0, 0, 1] } }`.
    #[serde(deserialize_with = "table")]
    HalfSpace(HalfSpace),
    /// Particles of one organ, by its name in this scene. Example: `{ organ = "liver" }`.
    Organ(String),
    /// The particles nearest to a point. Example: `{ nearest = { point = [10, -40, 0], count = 20 } }`.
    #[serde(deserialize_with = "table")]
    Nearest(Nearest),
    /// Particles in every one of these regions. Example: `{ all = [{ organ = "liver" }, { sphere = ... }] }`.
    All(Vec<Region>),
    /// Particles in at least one of these regions. Example: `{ any = [{ organ = "rib" }, { organ = "spine" }] }`.
    Any(Vec<Region>),
    /// Particles outside this region. Example: `{ not = { organ = "liver" } }`.
    Not(Box<Region>),
}

/// A sphere.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Sphere {
    /// Centre, RAS+ [mm]. Example: `center = [10, -40, 0]`.
    pub(super) center: Triple,
    /// Radius [mm], above 0. Example: `radius = 12`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(super) radius: f64,
}

/// A box along the axes.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Corners {
    /// Corner with the smallest coordinates, RAS+ [mm]. Example: `min = [-10, -10, -10]`.
    pub(super) min: Triple,
    /// Corner with the largest coordinates, RAS+ [mm]. Example: `max = [10, 10, 10]`.
    pub(super) max: Triple,
}

/// One side of a plane.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct HalfSpace {
    /// Any point of the plane, RAS+ [mm]. Example: `point = [0, 0, 40]`.
    pub(super) point: Triple,
    /// Direction into the region; its length does not matter. Example: `normal = [0, 0, 1]`.
    pub(super) normal: Triple,
}

/// The particles nearest to a point.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Nearest {
    /// The point, RAS+ [mm]. Example: `point = [10, -40, 0]`.
    pub(super) point: Triple,
    /// How many particles, 1 or more. Default: 1. Example: `count = 20`.
    #[serde(default = "one")]
    #[schemars(extend("minimum" = 1))]
    pub(super) count: u64,
}

fn one() -> u64 {
    1
}
