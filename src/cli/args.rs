//! What can be asked of the program.

use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::run::meshes::DEFAULT_SMOOTHING;
use crate::slice::SliceAxis;

/// Turns a CT volume into a soft organ that can be pushed, pulled and cut, and gives back surfaces.
///
/// Places are in millimetres in patient space (RAS+: x to the patient's right, y to the front, z to the head); everything
/// else is SI.
#[derive(Debug, Parser)]
#[command(
    name = "yawara",
    version,
    after_help = "Example:\n  yawara demo -o outputs/demo\n\nExit codes: 0 done; 1 finished, but a check failed; 2 bad usage or input."
)]
pub(super) struct Arguments {
    /// Print errors, warnings and results only.
    #[arg(long, short, global = true)]
    pub(super) quiet: bool,
    /// Worker threads, 1 to 1024; results do not depend on their number [default: one per processor].
    #[arg(long, global = true, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    pub(super) threads: Option<usize>,
    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    Demo(DemoArguments),
    Run(RunArguments),
    Mesh(MeshArguments),
    Slice(SliceArguments),
    Volume(VolumeArguments),
    Phantom(PhantomArguments),
    Info(InfoArguments),
    Check(CheckArguments),
    Scene(SceneArguments),
    Verify(VerifyArguments),
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Print a completion script for a shell.
    #[command(after_help = "Example:\n  yawara completions bash > ~/.local/share/bash-completion/completions/yawara")]
    Completions {
        /// Which shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page of the program, or of one of its commands.
    #[command(after_help = "Examples:\n  yawara man | man -l -\n  yawara man mesh | man -l -")]
    Man {
        /// Command to explain, such as `mesh` [default: the program].
        command: Option<String>,
    },
}

/// Take an embedded phantom all the way: cut and pull its liver, and write run, meshes and slices.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara demo -o outputs/demo")]
pub(super) struct DemoArguments {
    /// Folder to write to; it must not exist or be empty, unless it holds an earlier demo and --overwrite is given.
    #[arg(long, short, default_value = "outputs/demo")]
    pub(super) output: PathBuf,
    /// Replace an earlier demo; other files in its folder stay.
    #[arg(long)]
    pub(super) overwrite: bool,
}

/// Simulate a scene into a run directory.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara run fixtures/scenes/fig3-cube.toml -o outputs/fig3")]
pub(super) struct RunArguments {
    /// Scene file (TOML); see `yawara scene --schema`.
    pub(super) scene: PathBuf,
    /// Run directory to write [default: outputs/ and the scene's name].
    #[arg(long, short)]
    pub(super) output: Option<PathBuf>,
    /// Replace an earlier run.
    #[arg(long)]
    pub(super) overwrite: bool,
}

/// Write the surfaces of a run as STL, PLY or GLB.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara mesh outputs/demo/run -o liver.stl --organ liver\n  \
                        yawara mesh outputs/demo/run -o liver.glb --frame all\n  \
                        yawara mesh outputs/demo/run -o 'liver_{frame}.ply' --frame all\n\n\
                        STL and PLY are in patient mm (RAS+), GLB in metres with +Y towards the head.")]
pub(super) struct MeshArguments {
    /// Run directory.
    pub(super) run: PathBuf,
    /// File to write: .stl, .ply or .glb; `{frame}` in its name stands for the number of each frame.
    #[arg(long, short)]
    pub(super) output: PathBuf,
    /// Which frame: a number from 0, `last`, or `all` (numbered files, or one animated GLB).
    #[arg(long, default_value = "last", value_name = "N|last|all", allow_negative_numbers = true)]
    pub(super) frame: FrameChoice,
    /// Organ to write, by its name in the scene; may be given several times [default: all].
    #[arg(long, value_name = "NAME")]
    pub(super) organ: Vec<String>,
    /// Passes of smoothing over the label map before the surface is drawn, 0 to 20; 0 keeps its staircases.
    #[arg(long, default_value_t = DEFAULT_SMOOTHING, value_name = "N",
          value_parser = RangedU64ValueParser::<usize>::new().range(0..=20))]
    pub(super) smooth: usize,
    /// Write STL as text.
    #[arg(long)]
    pub(super) ascii: bool,
}

/// Which frames of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameChoice {
    Number(usize),
    Last,
    All,
}

impl std::str::FromStr for FrameChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "last" => Ok(Self::Last),
            "all" => Ok(Self::All),
            number => number
                .parse()
                .map(Self::Number)
                .map_err(|_| format!("`{number}` is not a frame; expected a number from 0, `last` or `all`")),
        }
    }
}

/// Draw a slice of a volume or a run as PNG.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara slice ct.nii.gz -o axial.png --axis z --at 0\n  \
                        yawara slice outputs/demo/run -o cut.png --axis z --at 0 --frame last\n\n\
                        Axial slices are seen from the feet, coronal ones from the front: the patient's right is on the \
                        left of the picture. Sagittal slices are seen from the left.")]
pub(super) struct SliceArguments {
    /// NIfTI volume, an image or a label map, or run directory.
    pub(super) source: PathBuf,
    /// PNG file to write.
    #[arg(long, short)]
    pub(super) output: PathBuf,
    /// Axis across the slice: x sagittal, y coronal, z axial.
    #[arg(long, value_enum)]
    pub(super) axis: AxisChoice,
    /// Coordinate of the slice on that axis, RAS+ [mm].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub(super) at: f64,
    /// Edge of a pixel [mm] [default: so that the longer side has about 800, and no voxel is left out].
    #[arg(long, value_name = "MM")]
    pub(super) pixel: Option<f64>,
    /// Value shown as middle grey [HU].
    #[arg(long, default_value_t = 40.0, value_name = "HU", allow_negative_numbers = true)]
    pub(super) level: f32,
    /// Range of values from black to white [HU].
    #[arg(long, default_value_t = 400.0, value_name = "HU")]
    pub(super) window: f32,
    /// Label map to tint an image with, on any grid (a run brings its own).
    #[arg(long, value_name = "FILE")]
    pub(super) labels: Option<PathBuf>,
    /// Strength of the tint, from 0 (grey) to 1.
    #[arg(long, default_value_t = 0.25, value_name = "SHARE")]
    pub(super) tint: f64,
    /// Frame of a run: a number from 0, or `last`.
    #[arg(long, default_value = "last", value_name = "N|last", allow_negative_numbers = true)]
    pub(super) frame: FrameChoice,
    /// Show the volume at rest, not carried by the deformation of the run.
    #[arg(long)]
    pub(super) rest: bool,
    /// Leave out the contours of the surfaces.
    #[arg(long)]
    pub(super) no_contour: bool,
    /// Leave out letters and scale bar.
    #[arg(long)]
    pub(super) plain: bool,
}

/// A patient axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum AxisChoice {
    X,
    Y,
    Z,
}

impl From<AxisChoice> for SliceAxis {
    fn from(axis: AxisChoice) -> Self {
        match axis {
            AxisChoice::X => Self::X,
            AxisChoice::Y => Self::Y,
            AxisChoice::Z => Self::Z,
        }
    }
}

/// Plot the volume of a run's tissue over its frames, by cells and by surface (PNG and CSV).
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara volume outputs/fig3 -o outputs/fig4.png\n\n\
                        Each organ in percent of rest. By cells: the sum over its cells no blade went through, against the \
                        same cells at rest. By surface: what its closed surface encloses, against frame 0.")]
pub(super) struct VolumeArguments {
    /// Run directory.
    pub(super) run: PathBuf,
    /// PNG file to write; the numbers go to the same name with .csv.
    #[arg(long, short)]
    pub(super) output: PathBuf,
    /// Organ to measure, by its name in the scene; may be given several times [default: all that deform].
    #[arg(long, value_name = "NAME")]
    pub(super) organ: Vec<String>,
    /// Print JSON: every frame of both measures, and the cells that are inside out.
    #[arg(long)]
    pub(super) json: bool,
}

/// Write an embedded phantom as NIfTI: ct.nii.gz, labels.nii.gz and labels.tsv.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara phantom -o outputs/phantom --spacing 2")]
pub(super) struct PhantomArguments {
    /// Folder to write to.
    #[arg(long, short, default_value = "outputs/phantom")]
    pub(super) output: PathBuf,
    /// Which phantom.
    #[arg(long, value_enum, default_value_t = KindChoice::Abdomen)]
    pub(super) kind: KindChoice,
    /// Voxel spacing [mm].
    #[arg(long, default_value_t = 3.0, value_name = "MM")]
    pub(super) spacing: f64,
    /// Seed of noise and texture.
    #[arg(long, default_value_t = 1)]
    pub(super) seed: u64,
    /// Replace an earlier phantom in the folder.
    #[arg(long)]
    pub(super) overwrite: bool,
}

/// A phantom.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum KindChoice {
    /// Liver with vessels, kidneys, spine, ribs, fat and skin.
    Abdomen,
    /// A cube.
    Cube,
    /// A long square bar.
    Beam,
}

/// Tell what a volume, a scene, a mesh or a run holds.
///
/// Of a scene: size, memory, materials as assembled, stable step, effects, and how long a run will take; for that it is stepped
/// for about 0.3 s. Nothing is written.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara info ct.nii.gz\n  yawara info fixtures/scenes/quickstart.toml --json\n  \
                        yawara info --materials")]
pub(super) struct InfoArguments {
    /// NIfTI volume, scene (TOML), mesh or run directory.
    #[arg(required_unless_present = "materials")]
    pub(super) path: Option<PathBuf>,
    /// Tell which tissues scenes know by name (`material = "liver"`), their constants, and where these come from.
    #[arg(long, conflicts_with = "path")]
    pub(super) materials: bool,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Check that meshes are closed, manifold and oriented; exit code 1 when one is not.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara check liver.stl\n  yawara check outputs/demo/run --json")]
pub(super) struct CheckArguments {
    /// Mesh (.stl, .ply, .glb) or run directory (the surfaces of every frame).
    pub(super) path: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Check a scene, or print the JSON schema of scenes.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara scene my.toml\n  yawara scene --schema > scene.schema.json")]
pub(super) struct SceneArguments {
    /// Scene to check; prints it resolved, in SI units, as JSON.
    #[arg(required_unless_present = "schema")]
    pub(super) scene: Option<PathBuf>,
    /// Print the JSON schema.
    #[arg(long, conflicts_with = "scene")]
    pub(super) schema: bool,
}

/// Try out what the program promises: solids, waves and free bodies against known answers, and hard cases.
///
/// Takes some minutes; exit code 1 when a promise is broken.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara verify -o promises.md\n  yawara verify --only flattened")]
pub(super) struct VerifyArguments {
    /// Only cases whose name contains this.
    #[arg(long, value_name = "TEXT")]
    pub(super) only: Option<String>,
    /// Tell the names of the cases and what they ask, and do nothing.
    #[arg(long)]
    pub(super) list: bool,
    /// Also write the findings as a Markdown page.
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Measure speed; the last line of --json is one JSON object.
#[derive(Debug, Subcommand)]
#[command(after_help = "Example:\n  yawara bench lattice --n 128 --steps 20")]
pub(super) enum BenchCommand {
    /// Steps of a full cube of particles: mass 1, spacing 1, stiffness 10, no damper, dt 0.01, stretched by 0.1 % along x.
    Lattice(BenchLatticeArguments),
    /// The surface of a bumpy ball, f = 0.7 - |p| + 0.08 sin 20x sin 20y sin 20z over [-1, 1]^3, with normals.
    Surface(BenchSurfaceArguments),
    /// The same surface tidied and decimated.
    Care(BenchCareArguments),
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench lattice --n 128 --steps 20 --json")]
pub(super) struct BenchLatticeArguments {
    /// Particles along each edge, 2 to 800.
    #[arg(long, default_value_t = 128)]
    pub(super) n: usize,
    /// Steps to time, at least 1.
    #[arg(long, default_value_t = 20)]
    pub(super) steps: u32,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench surface --n 256")]
pub(super) struct BenchSurfaceArguments {
    /// Grid points along each edge, 2 to 1024.
    #[arg(long, default_value_t = 256)]
    pub(super) n: usize,
    /// Values of another field: raw little-endian f32, n^3 of them, x fastest; the surface is where they pass through 0.
    #[arg(long, value_name = "FILE")]
    pub(super) raw: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench care --n 412 --percent 10")]
pub(super) struct BenchCareArguments {
    /// Grid points along each edge, 2 to 1024; 412 give a million triangles.
    #[arg(long, default_value_t = 412)]
    pub(super) n: usize,
    /// Percentage of the triangles to keep, 1 to 100.
    #[arg(long, default_value_t = 10)]
    pub(super) percent: usize,
    /// Tidy slivers first.
    #[arg(long)]
    pub(super) tidy: bool,
    /// Largest distance from the original, in spacings of the grid.
    #[arg(long, value_name = "SPACINGS")]
    pub(super) max_error: Option<f64>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}
