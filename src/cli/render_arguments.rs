//! What can be asked of `yawara render`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::args::FrameChoice;
use super::paint::PaintArguments;
use super::surface::SurfaceArguments;
use crate::render::camera::Direction;
use crate::render::{Background, ClipPlane};
use crate::scene::color;

/// Draw a run or a mesh as PNG: shaded surfaces, the lattice's voxels, or sections.
///
/// Every frame of a run is framed alike: around the frames asked for, or around this one, the first and the last.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  yawara render outputs/demo/run -o liver.png --organ liver\n  \
                        yawara render outputs/demo/run -o 'liver_{frame}.png' --frame all --view anterior\n  \
                        yawara render outputs/demo/run -o liver.apng --frame all --slow 10\n  \
                        yawara render outputs/fig3 -o cubes.png --style voxels --plain\n  \
                        yawara render liver.stl -o section.png --clip 0,40,0,0,1,0\n\n\
                        In the anterior view the patient's right is on the left of the picture; from above and below the \
                        front is up. Letters name the sides; directions between axes get several.")]
pub(super) struct RenderArguments {
    /// Run directory, or mesh (.stl, .ply, .glb).
    pub(super) source: PathBuf,
    /// PNG file to write; `{frame}` in its name stands for the number of each frame. A name that ends in .apng is an animated PNG of all
    /// frames, in a loop.
    #[arg(long, short)]
    pub(super) output: PathBuf,
    /// Which frame of a run or an animation: a number from 0, `last`, or `all` (numbered files, or one .apng).
    #[arg(long, default_value = "last", value_name = "N|last|all", allow_negative_numbers = true)]
    pub(super) frame: FrameChoice,
    /// How many times slower than life an animation (.apng) plays: each frame is shown for this times the time [s] to the next one.
    #[arg(long, default_value_t = 1.0, value_name = "X", allow_negative_numbers = true)]
    pub(super) slow: f64,
    /// Organ to draw, by its name; may be given several times [default: all].
    #[arg(long, value_name = "NAME")]
    pub(super) organ: Vec<String>,
    /// What is drawn.
    #[arg(long, value_enum, default_value_t = StyleChoice::Surface)]
    pub(super) style: StyleChoice,
    /// Where the eye is.
    #[arg(long, value_enum, default_value_t = ViewChoice::ThreeQuarter)]
    pub(super) view: ViewChoice,
    /// Angle of the eye round the patient, in place of the view's: 0 in front, 90 at the left [degrees].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub(super) azimuth: Option<f64>,
    /// Angle of the eye above the horizon, in place of the view's: 90 over the head [degrees].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub(super) elevation: Option<f64>,
    /// Magnification, 0.02 to 50; at 1 everything is in the picture.
    #[arg(long, default_value_t = 1.0, value_name = "X")]
    pub(super) zoom: f64,
    /// Place in the middle of the picture, RAS+ [mm] [default: the middle of what is drawn].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = numbers::<3>)]
    pub(super) center: Option<[f64; 3]>,
    /// Parallel rays: the scale bar holds at every depth.
    #[arg(long)]
    pub(super) orthographic: bool,
    /// Plane through P across N, RAS+ [mm]: what lies on N's side is taken away, and the section is filled.
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ", allow_hyphen_values = true, value_parser = numbers::<6>)]
    pub(super) clip: Option<[f64; 6]>,
    /// Width and height of the picture [px], sides from 16 to 8192.
    #[arg(long, default_value = "1280x960", value_name = "WxH", value_parser = size)]
    pub(super) size: [u32; 2],
    /// What lies behind: gradient, white, black, transparent (without letters), or #rrggbb.
    #[arg(long, default_value = "gradient", value_name = "COLOUR", value_parser = background)]
    pub(super) background: Background,
    /// Do not darken creases.
    #[arg(long)]
    pub(super) no_occlusion: bool,
    #[command(flatten)]
    pub(super) surface: SurfaceArguments,
    #[command(flatten)]
    pub(super) paint: PaintArguments,
    /// Leave out letters and scale bar.
    #[arg(long)]
    pub(super) plain: bool,
}

impl RenderArguments {
    pub(super) fn direction(&self) -> Direction {
        let view = Direction::from(self.view);
        Direction { azimuth: self.azimuth.unwrap_or(view.azimuth), elevation: self.elevation.unwrap_or(view.elevation) }
    }

    pub(super) fn clip_plane(&self) -> Option<ClipPlane> {
        self.clip.map(|[x, y, z, nx, ny, nz]| ClipPlane { point: [x, y, z], normal: [nx, ny, nz] })
    }
}

/// What is drawn of an organ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum StyleChoice {
    /// Its surface.
    Surface,
    /// The cells or particles of a run's lattice as cubes; cells that a blade went through are left out.
    Voxels,
    /// Its surface with the edges of its triangles.
    Wireframe,
}

/// A named direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ViewChoice {
    /// From the front, the right and above.
    ThreeQuarter,
    /// From the front, the left and above.
    ThreeQuarterLeft,
    /// From the front, the right and below.
    ThreeQuarterBelow,
    /// From the front.
    Anterior,
    /// From behind.
    Posterior,
    /// From the patient's left.
    Left,
    /// From the patient's right.
    Right,
    /// From the head.
    Superior,
    /// From the feet.
    Inferior,
}

impl From<ViewChoice> for Direction {
    fn from(view: ViewChoice) -> Self {
        match view {
            ViewChoice::ThreeQuarter => Self::THREE_QUARTER,
            ViewChoice::ThreeQuarterLeft => Self::THREE_QUARTER_LEFT,
            ViewChoice::ThreeQuarterBelow => Self::THREE_QUARTER_BELOW,
            ViewChoice::Anterior => Self::ANTERIOR,
            ViewChoice::Posterior => Self::POSTERIOR,
            ViewChoice::Left => Self::LEFT,
            ViewChoice::Right => Self::RIGHT,
            ViewChoice::Superior => Self::SUPERIOR,
            ViewChoice::Inferior => Self::INFERIOR,
        }
    }
}

/// `WxH` in pixels; which sizes can be drawn, the renderer knows.
pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let sides =
        text.split_once(['x', 'X']).and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    sides.ok_or_else(|| format!("`{text}` is not a size; expected width and height in pixels, as in 1920x1080"))
}

fn background(text: &str) -> Result<Background, String> {
    match text {
        "gradient" => Ok(Background::Gradient),
        "white" => Ok(Background::Plain([1.0; 3])),
        "black" => Ok(Background::Plain([0.0; 3])),
        "transparent" => Ok(Background::Transparent),
        other => color::parse(other).map(Background::Plain).ok_or_else(|| {
            format!("`{other}` is not a background; expected gradient, white, black, transparent or #rrggbb")
        }),
    }
}

/// As many numbers as are wanted, with commas between them.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parts: Vec<f64> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    let whole = parts.len() == text.split(',').count();
    <[f64; N]>::try_from(parts)
        .ok()
        .filter(|numbers| whole && numbers.iter().all(|number| number.is_finite()))
        .ok_or_else(|| format!("`{text}` is not {N} finite numbers with commas between them"))
}
