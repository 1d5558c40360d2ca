//! What can be asked of the program.

use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use clap::{Args, Parser, Subcommand, ValueEnum};

use super::paint::PaintArguments;
use super::surface::SurfaceArguments;
use crate::kernel::dispatch::InstructionSet;
use crate::look::colormap::Colormap;
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
    Render(super::render_arguments::RenderArguments),
    Volume(VolumeArguments),
    Phantom(PhantomArguments),
    Info(InfoArguments),
    Check(CheckArguments),
    Scene(SceneArguments),
    Verify(VerifyArguments),
    Study(super::study::StudyArguments),
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

/// Write the surfaces of a run as STL, PLY, GLB, glTF, OBJ or VTP, or its lattice as VTU.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara mesh outputs/demo/run -o liver.stl --organ liver\n  \
                        yawara mesh outputs/demo/run -o liver.glb --frame all\n  \
                        yawara mesh outputs/demo/run -o 'liver_{frame}.vtp' --frame all\n  \
                        yawara mesh outputs/demo/run -o lattice.vtu\n\n\
                        GLB and glTF are in metres with +Y towards the head, all others in patient mm (RAS+). The extension \
                        .vtu chooses the lattice in place of the surfaces: its cells with organ, fill, strain and severed \
                        springs. A sequence of .vtp or .vtu comes with a .pvd that tells ParaView the times.")]
pub(super) struct MeshArguments {
    /// Run directory.
    pub(super) run: PathBuf,
    /// File to write: .stl, .ply, .glb, .gltf (with .bin), .obj (with .mtl) or .vtp, or .vtu for the lattice; `{frame}` in its
    /// name stands for the number of each frame.
    #[arg(long, short)]
    pub(super) output: PathBuf,
    /// Which frame: a number from 0, `last`, or `all` (numbered files, or one animated GLB or glTF).
    #[arg(long, default_value = "last", value_name = "N|last|all", allow_negative_numbers = true)]
    pub(super) frame: FrameChoice,
    /// Organ to write, by its name in the scene; may be given several times [default: all].
    #[arg(long, value_name = "NAME")]
    pub(super) organ: Vec<String>,
    #[command(flatten)]
    pub(super) surface: SurfaceArguments,
    /// Write STL as text.
    #[arg(long)]
    pub(super) ascii: bool,
    /// Write GLB or glTF with 16-bit positions and 8-bit normals; tells how far vertices lie from their place at most.
    #[arg(long, conflicts_with = "ascii")]
    pub(super) quantize: bool,
    /// Double the vertices on sharp edges, such as the rims of cuts, with a normal for either side: crisp in viewers; the mesh is then
    /// closed by the places of its vertices, not by their numbers.
    #[arg(long, conflicts_with = "ascii")]
    pub(super) crisp: bool,
    /// How an animated GLB or glTF holds its frames.
    #[arg(long, value_enum, default_value_t = AnimationChoice::Step)]
    pub(super) animation: AnimationChoice,
    #[command(flatten)]
    pub(super) paint: PaintArguments,
}

/// How an animation holds its frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum AnimationChoice {
    /// A mesh for each frame, shown in its turn: right in every viewer, with all attributes.
    Step,
    /// Morph targets of one mesh between cuts: smooth, and smaller for many frames; right in three.js and Blender, not in f3d.
    Morph,
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
                        yawara slice outputs/demo/run -o cut.png --axis z --at 0 --frame last\n  \
                        yawara slice outputs/demo/run -o moved.png --axis z --at 0 --color displacement --tint 0.6\n  \
                        yawara slice outputs/demo/run -o all.png --axis z --montage 4x2 --from -60 --to 60\n  \
                        yawara slice outputs/demo/run -o 'cut_{frame}.png' --axis z --at 0 --frame all\n  \
                        yawara slice outputs/demo/run -o cut.apng --axis z --at 0 --frame all --slow 10\n  \
                        yawara slice ct.nii.gz -o oblique.png --point 40,20,0 --normal 1,1,0\n\n\
                        Axial slices are seen from the feet, coronal ones from the front: the patient's right is on the \
                        left of the picture. Sagittal slices are seen from the left.")]
pub(super) struct SliceArguments {
    /// NIfTI volume, an image or a label map, or run directory.
    pub(super) source: PathBuf,
    /// PNG file to write; `{frame}` in its name stands for the number of each frame. A name that ends in .apng is an animated PNG of all
    /// frames, in a loop.
    #[arg(long, short)]
    pub(super) output: PathBuf,
    /// Axis across the slice: x sagittal, y coronal, z axial.
    #[arg(long, value_enum, required_unless_present = "point")]
    pub(super) axis: Option<AxisChoice>,
    /// Coordinate of the slice on that axis, RAS+ [mm]; given several times, the slices stand side by side.
    #[arg(long, value_name = "MM", allow_negative_numbers = true, required_unless_present_any = ["point", "from"])]
    pub(super) at: Vec<f64>,
    /// Many slices in one picture, this many side by side and above each other; with --from and --to.
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = columns_rows, requires = "from", conflicts_with = "at")]
    pub(super) montage: Option<[usize; 2]>,
    /// Coordinate of the first slice of a montage [mm].
    #[arg(long, value_name = "MM", allow_negative_numbers = true, requires = "to", requires = "montage")]
    pub(super) from: Option<f64>,
    /// Coordinate of the last slice of a montage [mm].
    #[arg(long, value_name = "MM", allow_negative_numbers = true, requires = "from")]
    pub(super) to: Option<f64>,
    /// A point of an oblique slice, RAS+ [mm]; with --normal, instead of --axis and --at.
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true, requires = "normal")]
    #[arg(conflicts_with_all = ["axis", "at", "from"])]
    pub(super) point: Option<[f64; 3]>,
    /// Direction from an oblique slice towards the viewer, RAS+.
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true, requires = "point")]
    pub(super) normal: Option<[f64; 3]>,
    /// What is up in an oblique slice, RAS+ [default: the head, or the front in slices nearly across the body].
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true, requires = "point")]
    pub(super) up: Option<[f64; 3]>,
    /// What the colours over the grey CT of a run show.
    #[arg(long, value_enum, default_value_t = SliceColor::Organ)]
    pub(super) color: SliceColor,
    /// Values at the ends of the colour bar, in its unit [default: 0 to the largest of the frames].
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    pub(super) range: Option<[f32; 2]>,
    /// Colour map: grey, viridis, inferno or coolwarm.
    #[arg(long, default_value_t = Colormap::Viridis, value_name = "NAME")]
    pub(super) colormap: Colormap,
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
    /// Frame of a run: a number from 0, `last`, or `all` (one picture each, with {frame} in the name, or one .apng).
    #[arg(long, default_value = "last", value_name = "N|last|all", allow_negative_numbers = true)]
    pub(super) frame: FrameChoice,
    /// How many times slower than life an animation (.apng) plays: each frame is shown for this times the time [s] to the next one.
    #[arg(long, default_value_t = 1.0, value_name = "X", allow_negative_numbers = true)]
    pub(super) slow: f64,
    /// Show the volume at rest, not carried by the deformation of the run.
    #[arg(long)]
    pub(super) rest: bool,
    /// Leave out the contours of the surfaces.
    #[arg(long)]
    pub(super) no_contour: bool,
    /// Leave out letters, title, scale bar, names and colour bar.
    #[arg(long)]
    pub(super) plain: bool,
}

/// What the colours of a slice show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum SliceColor {
    /// The organs, up to their surfaces, each in its colour.
    Organ,
    /// Nothing: the grey CT alone.
    Hu,
    /// Every label of the label map.
    Label,
    /// How far the tissue has moved from rest [mm].
    Displacement,
    /// Equivalent strain of the tissue.
    Strain,
}

/// Reads `X,Y,Z`.
fn triple(text: &str) -> Result<[f64; 3], String> {
    let parts: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    parts.and_then(|parts| parts.try_into().ok()).ok_or_else(|| "expected three numbers, such as 10,-20,30".to_owned())
}

/// Reads `LOW,HIGH`.
fn range(text: &str) -> Result<[f32; 2], String> {
    let ends = text.split_once(',').and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]));
    let usable = |&[low, high]: &[f32; 2]| low < high && low.is_finite() && high.is_finite();
    ends.filter(usable).ok_or_else(|| "expected two numbers, the lower one first, such as 0,25".to_owned())
}

/// Reads `COLUMNSxROWS`.
fn columns_rows(text: &str) -> Result<[usize; 2], String> {
    let counts = text.split_once('x').and_then(|(columns, rows)| Some([columns.parse().ok()?, rows.parse().ok()?]));
    let usable = |counts: &[usize; 2]| counts.iter().all(|count| (1..=64).contains(count));
    counts.filter(usable).ok_or_else(|| "expected columns and rows from 1 to 64, such as 4x3".to_owned())
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
    /// Mesh (.stl, .ply, .glb, .gltf, .obj) or run directory (the surfaces of every frame).
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
    /// What each effect of a scene costs: alone, and in the usual company, in turn with a bare lattice.
    Effects(BenchEffectsArguments),
    /// How far from real time a scene is, and where the time of its steps goes; no frame is measured or written.
    Scene(BenchSceneArguments),
    /// The surface of a bumpy ball, f = 0.7 - |p| + 0.08 sin 20x sin 20y sin 20z over [-1, 1]^3, with normals.
    Surface(BenchSurfaceArguments),
    /// The same ball carried by a lattice of three times its spacing: places and normals of one frame after another.
    Carry(BenchCarryArguments),
    /// The same ball while a blade goes through it: its surface after each step of the blade, following the cut and at once.
    Cut(BenchCutArguments),
    /// Writing mesh files: a ball with every attribute, each format against the same bytes written raw.
    Write(BenchWriteArguments),
    /// A picture of a bumpy ball, all but reading and writing files.
    Render(BenchRenderArguments),
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
    /// What joins the particles: "bare", equal springs; or "everything", dampers, two organs in slabs, and a cut every 24
    /// particles.
    #[arg(long, value_enum, default_value = "bare")]
    pub(super) law: BenchLaw,
    /// The particles of a scene's organs at its pitch instead of a cube; materials are those of --law.
    #[arg(long, value_name = "SCENE")]
    pub(super) scene: Option<PathBuf>,
    /// Nothing fused, true square roots: the same bits on every instruction set.
    #[arg(long)]
    pub(super) exact: bool,
    /// Instruction set: baseline, neon (ARM), avx2 or avx512 (x86-64). Default: the best this machine has.
    #[arg(long, value_name = "SET")]
    pub(super) instructions: Option<InstructionSet>,
    /// A command that does the same work and prints one line of JSON with `particle_steps_per_s` and `mean_moved`; both run
    /// in turn and the ratio is printed.
    #[arg(long, value_name = "COMMAND", conflicts_with = "scaling")]
    pub(super) against: Option<String>,
    /// How often both run, with --against.
    #[arg(long, default_value_t = 5, requires = "against")]
    pub(super) pairs: u32,
    /// Measures cubes from 1e5 to 5e7 particles on one and on all threads instead, and writes a plot and a table into this
    /// folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scene", "json"])]
    pub(super) scaling: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench effects --n 64 -o outputs/effects")]
pub(super) struct BenchEffectsArguments {
    /// Cells along each edge of the cube, 6 to 120.
    #[arg(long, default_value_t = 80)]
    pub(super) n: usize,
    /// How often every case takes its turn.
    #[arg(long, default_value_t = 7)]
    pub(super) rounds: usize,
    /// Writes effects.csv and effects.png into this folder. Default: nothing is written.
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench scene fixtures/scenes/liver-ct.toml --pitch 3 --pitch 2")]
pub(super) struct BenchSceneArguments {
    /// Scene file (TOML).
    pub(super) scene: PathBuf,
    /// Pitch in place of the scene's [mm]; may be given several times.
    #[arg(long = "pitch", value_name = "MM")]
    pub(super) pitches: Vec<f64>,
    /// How often the scene is stepped through; the quickest run counts.
    #[arg(long, default_value_t = 3)]
    pub(super) runs: usize,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// What joins the particles of `yawara bench lattice`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum BenchLaw {
    /// Equal springs.
    Bare,
    /// Dampers, two organs, cuts.
    Everything,
}

impl BenchLaw {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Bare => "bare",
            Self::Everything => "everything",
        }
    }
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
#[command(after_help = "Example:\n  yawara bench carry --n 256")]
pub(super) struct BenchCarryArguments {
    /// Grid points of the surface along each edge, 8 to 1024.
    #[arg(long, default_value_t = 256)]
    pub(super) n: usize,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench cut --n 256")]
pub(super) struct BenchCutArguments {
    /// Grid points of the surface along each edge, 8 to 1024.
    #[arg(long, default_value_t = 256)]
    pub(super) n: usize,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench render --triangles 1000000 --size 1920x1080")]
pub(super) struct BenchRenderArguments {
    /// Triangles of the ball, about; 1000 to 20000000.
    #[arg(long, default_value_t = 1_000_000)]
    pub(super) triangles: usize,
    /// Width and height of the picture [px], sides from 16 to 8192.
    #[arg(long, default_value = "1920x1080", value_name = "WxH", value_parser = super::render_arguments::size)]
    pub(super) size: [u32; 2],
    /// Write the picture, too (PNG).
    #[arg(long, short, value_name = "FILE")]
    pub(super) output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  yawara bench write --triangles 1000000 --folder /tmp")]
pub(super) struct BenchWriteArguments {
    /// Triangles of the mesh, about; 100 to 100 million.
    #[arg(long, default_value_t = 1_000_000, value_name = "N",
          value_parser = RangedU64ValueParser::<usize>::new().range(100..=100_000_000))]
    pub(super) triangles: usize,
    /// Folder for the temporary files [default: the system's].
    #[arg(long, value_name = "FOLDER")]
    pub(super) folder: Option<PathBuf>,
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
