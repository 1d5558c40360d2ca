//! From attributes of vertices to their colours.

use rayon::prelude::*;

use super::colormap::{Colormap, label_color};
use super::detail::{AMPLITUDE, Detail};
use super::rest::RestSurface;
use super::transfer::{Capsule, TransferFunction};
use crate::surface::mesh::TriangleMesh;

/// What the colour of a vertex says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ColorBy {
    /// Which organ it belongs to, in the organ's colour.
    Organ,
    /// The CT there: tissue in its own colours, by the organ's transfer function.
    Hu,
    /// Its label.
    Label,
    /// How far it is from rest \[mm\].
    Displacement,
    /// Equivalent strain of the tissue, see [`super::strain`].
    Strain,
    /// How fast it moves \[mm/s\].
    Speed,
}

impl ColorBy {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Organ, Self::Hu, Self::Label, Self::Displacement, Self::Strain, Self::Speed];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Organ => "organ",
            Self::Hu => "hu",
            Self::Label => "label",
            Self::Displacement => "displacement",
            Self::Strain => "strain",
            Self::Speed => "speed",
        }
    }

    /// Unit of its values; empty for those without.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Hu => "HU",
            Self::Displacement => "mm",
            Self::Speed => "mm/s",
            Self::Organ | Self::Label | Self::Strain => "",
        }
    }
}

/// A range of values and its colours, as a legend shows them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Legend {
    /// What the values are.
    pub by: ColorBy,
    /// The values with the first and the last colour, in the unit of [`ColorBy::unit`].
    pub range: [f32; 2],
    /// The colours between.
    pub colormap: Colormap,
}

impl Legend {
    /// Linear RGB in 0..=1 of a value; beyond the range the colour of its end.
    pub fn rgb(&self, value: f32) -> [f32; 3] {
        let [low, high] = self.range;
        self.colormap.rgb((value - low) / (high - low))
    }
}

/// "displacement, 0 to 25 mm, viridis"
impl std::fmt::Display for Legend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [low, high] = self.range;
        let name = if self.by == ColorBy::Strain { "equivalent strain" } else { self.by.name() };
        let blank = if self.by.unit().is_empty() { "" } else { " " };
        write!(f, "{name}, {low} to {high}{blank}{}, {}", self.by.unit(), self.colormap)
    }
}

/// How the vertices of one organ are coloured.
#[derive(Debug, Clone, Copy)]
pub enum Paint<'a> {
    /// All alike, in this linear RGB.
    Flat([f32; 3]),
    /// By their labels.
    Labels,
    /// By the CT, through the organ's transfer function; whole contrast on the faces of cuts, through the capsule elsewhere.
    Tissue {
        /// Colours of CT numbers.
        transfer: &'a TransferFunction,
        /// The skin.
        capsule: Capsule,
        /// Whether each vertex lies on a face of a cut.
        on_cut: &'a [bool],
    },
    /// By an attribute, through a colour map.
    Scale(Legend),
}

/// Colours of all vertices of a mesh, linear RGB in 0..=1. Shape `[vertices, 3]`.
///
/// # Panics
/// If the mesh lacks the attribute.
pub fn colors(mesh: &TriangleMesh, paint: Paint<'_>) -> Vec<[f32; 3]> {
    let vertices = mesh.positions.len();
    let each = |color: &(dyn Fn(usize) -> [f32; 3] + Sync)| (0..vertices).into_par_iter().map(color).collect();
    let needed = |length: usize| assert_eq!(length, vertices, "the attribute is there for every vertex");
    match paint {
        Paint::Flat(color) => vec![color; vertices],
        Paint::Labels => {
            needed(mesh.labels.len());
            each(&|vertex| label_color(mesh.labels[vertex]))
        }
        Paint::Tissue { transfer, capsule, on_cut } => {
            needed(mesh.hu.len());
            needed(on_cut.len());
            each(&|vertex| {
                let hu = mesh.hu[vertex];
                transfer.rgb(if on_cut[vertex] { hu } else { capsule.hu(hu) })
            })
        }
        Paint::Scale(legend) => match legend.by {
            ColorBy::Hu => {
                needed(mesh.hu.len());
                each(&|vertex| legend.rgb(mesh.hu[vertex]))
            }
            ColorBy::Displacement => {
                needed(mesh.displacements.len());
                each(&|vertex| legend.rgb(length(mesh.displacements[vertex])))
            }
            ColorBy::Strain => {
                needed(mesh.strains.len());
                each(&|vertex| legend.rgb(mesh.strains[vertex]))
            }
            ColorBy::Speed => {
                needed(mesh.speeds.len());
                each(&|vertex| legend.rgb(mesh.speeds[vertex]))
            }
            ColorBy::Label | ColorBy::Organ => {
                needed(mesh.labels.len());
                each(&|vertex| legend.rgb(f32::from(mesh.labels[vertex])))
            }
        },
    }
}

/// Lightens and darkens colours by fine detail of the tissue.
///
/// - `strength`: 0 to 1; at 1 the linear colour changes by up to [`AMPLITUDE`].
///
/// # Panics
/// If there is not one colour per vertex of the surface.
pub fn add_detail(colors: &mut [[f32; 3]], surface: &RestSurface, mesh: &TriangleMesh, detail: Detail, strength: f32) {
    assert_eq!(colors.len(), surface.len(), "one colour per vertex");
    let edge = typical_edge(surface, &mesh.triangles);
    colors.par_iter_mut().zip(surface.places()).for_each(|(color, &place)| {
        let factor = 1.0 + AMPLITUDE * strength * detail.at(place, edge);
        *color = color.map(|channel| (channel * factor).clamp(0.0, 1.0));
    });
}

/// Root mean square of the edges of some triangles at rest \[mm\]; infinite for a mesh without any.
fn typical_edge(surface: &RestSurface, triangles: &[[u32; 3]]) -> f64 {
    const MOST: usize = 4096;
    let some = triangles.iter().step_by(triangles.len() / MOST + 1);
    let (mut sum, mut count) = (0.0, 0_u32);
    for &[a, b, c] in some {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            sum += (surface.places()[to as usize] - surface.places()[from as usize]).norm_squared();
            count += 1;
        }
    }
    if count == 0 { f64::INFINITY } else { (sum / f64::from(count)).sqrt() }
}

/// Length of a vector.
pub(crate) fn length(vector: [f32; 3]) -> f32 {
    vector.iter().map(|part| part * part).sum::<f32>().sqrt()
}
