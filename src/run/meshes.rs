//! From stored frames back to surfaces: one closed mesh per organ, carried by the lattice. Where organs touch, each keeps its own
//! wall, set back by a few thousandths of a pitch, so that meshes of several organs stay manifold when vertices are welded.

use crate::cut::CutSheet;
use crate::dynamics::World;
use crate::dynamics::measure::organ_volume;
use crate::lattice::{Lattice, Topology};
use crate::scene::resolved::{self, Scene, VoxelSelection};
use crate::store::{ReadRunError, RunReader};
use crate::surface::care::Care;
use crate::surface::check::check;
use crate::surface::fine::{Body, FineSurface, Memory};
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};
use crate::surface::{Surface, SurfaceError, field};

use super::bodies::{Bodies, BodyError};
use super::interfaces::{Interfaces, SharedOrgans, SharedRegions};
use super::record::HU_ARRAY;

/// Passes of the binomial filter over an organ's membership at the lattice points, at a smoothing of 1.
const LATTICE_PASSES: f32 = field::SMOOTHING_PASSES as f32;
/// Contrast over which the border of an organ chosen by HU is drawn [HU].
pub(super) const HU_CONTRAST: f32 = 100.0;

/// Why the surfaces of a run cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshRunError {
    /// The run cannot be read.
    #[error(transparent)]
    Read(#[from] ReadRunError),
    /// The scene of the run cannot be understood.
    #[error("{}: not a resolved scene of this program's version; run the scene again", path.display())]
    Scene {
        /// Its `scene.json`.
        path: std::path::PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// A surface cannot be extracted.
    #[error("organ `{organ}`: {source}")]
    Surface {
        /// The organ.
        organ: String,
        /// Why.
        source: SurfaceError,
    },
    /// The organs cannot be drawn from their volume.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// No organ of this name.
    #[error("the run has no organ `{found}`; it has {}", expected.join(", "))]
    UnknownOrgan {
        /// The name asked for.
        found: String,
        /// The names there are.
        expected: Vec<String>,
    },
}

/// How fine the surfaces of a run are.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Resolution {
    /// As fine as the volume the run was made from.
    #[default]
    Volume,
    /// Sampled at this distance [mm].
    Spacing(f64),
    /// As fine as the lattice: needs nothing but the run.
    Lattice,
}

/// How the surfaces of a run are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshOptions {
    /// How fine they are.
    pub resolution: Resolution,
    /// Smoothing at rest, before anything is carried: 0 keeps the voxels' staircases, 1 takes them away. Organs chosen by HU are
    /// drawn through the values of the CT in any case.
    pub smooth: f32,
    /// Fewer or better triangles; only for surfaces finer than the lattice, and not for shared walls.
    pub care: MeshCare,
    /// Whose the walls between organs are.
    pub interfaces: Interfaces,
}

/// What is done to the triangles of each organ, once at rest; nothing by default. See [`crate::surface::care`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeshCare {
    /// Remove slivers.
    pub tidy: bool,
    /// Decimate to about this many triangles.
    pub triangles: Option<usize>,
    /// Stay within this distance of the full surface [mm].
    pub max_error_mm: Option<f64>,
}

impl MeshCare {
    fn of(&self, body: &Body) -> Option<Care> {
        let Self { tidy, triangles, max_error_mm } = *self;
        (*self != Self::default()).then(|| Care { spacing_mm: body.spacing(), tidy, triangles, max_error_mm })
    }
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self {
            resolution: Resolution::default(),
            smooth: 1.0,
            care: MeshCare::default(),
            interfaces: Interfaces::Separate,
        }
    }
}

/// Makes the meshes of a run's frames.
///
/// Meshes do not depend on which other organs are asked for. Topology is extracted once for every set of severed springs; each further frame only moves the vertices.
pub struct RunMesher {
    reader: RunReader,
    scene: Scene,
    /// Organs to mesh: index in the scene, and what their surface is drawn from.
    organs: Vec<(usize, Shape)>,
    care: MeshCare,
    /// Surfaces for this many severed springs and quads of the cut sheet.
    epoch: Option<([usize; 2], Vec<OrganSurface>)>,
    /// All organs at once, in place of the above.
    shared: Option<SharedOrgans>,
}

/// What the surface of an organ is drawn from.
enum Shape {
    /// Values at the lattice points.
    Lattice(Vec<f32>),
    /// A finer grid, and what its last surface left for the next.
    Fine(Box<(Body, Memory)>),
}

/// The surface of an organ until the next cut.
enum OrganSurface {
    Lattice(Surface),
    Fine(FineSurface),
}

impl OrganSurface {
    fn carry(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> TriangleMesh {
        match self {
            Self::Lattice(surface) => surface.carry(lattice, displacements),
            Self::Fine(surface) => surface.carry(lattice, displacements),
        }
    }

    fn on_seam(&self) -> Vec<bool> {
        match self {
            Self::Lattice(surface) => surface.on_seam().collect(),
            Self::Fine(surface) => surface.on_seam().collect(),
        }
    }
}

impl RunMesher {
    /// What is done to the triangles of each organ.
    pub fn care(&self) -> MeshCare {
        self.care
    }

    /// Prepares the meshes of some organs of a run, or of all when none is named.
    ///
    /// # Errors
    /// If the run cannot be read, an organ's name is unknown, or the volume of the run is needed and not there any more.
    pub fn new(reader: RunReader, names: &[String], options: &MeshOptions) -> Result<Self, MeshRunError> {
        let scene = scene_of(&reader)?;
        let all = || scene.organs.iter().map(|organ| organ.name.clone()).collect::<Vec<_>>();
        if let Some(found) = names.iter().find(|name| !all().contains(name)) {
            return Err(MeshRunError::UnknownOrgan { found: found.clone(), expected: all() });
        }
        if options.interfaces == Interfaces::Shared {
            let shared = Some(SharedOrgans::new(&reader, &scene, names, options)?);
            return Ok(Self { reader, scene, organs: Vec::new(), care: options.care, epoch: None, shared });
        }
        let wanted =
            (0..scene.organs.len()).filter(|&organ| names.is_empty() || names.contains(&scene.organs[organ].name));
        let organs = match options.resolution {
            Resolution::Lattice => {
                let hu = hu_of(&reader, &scene)?;
                let mut fields = parted_fields(&scene, reader.lattice(), hu.as_deref(), options.smooth);
                wanted.map(|organ| (organ, Shape::Lattice(std::mem::take(&mut fields[organ])))).collect()
            }
            Resolution::Volume | Resolution::Spacing(_) => {
                let bodies = Bodies::of_run(&reader, &scene)?;
                let spacing = match options.resolution {
                    Resolution::Spacing(spacing) => spacing,
                    _ => bodies.spacing(),
                };
                let shape = |organ| {
                    let body = bodies.body(&scene, organ, spacing, options.smooth)?;
                    Ok((organ, Shape::Fine(Box::new((body, Memory::default())))))
                };
                wanted.map(shape).collect::<Result<_, MeshRunError>>()?
            }
        };
        Ok(Self { reader, scene, organs, care: options.care, epoch: None, shared: None })
    }

    /// The run.
    pub fn reader(&self) -> &RunReader {
        &self.reader
    }

    /// The scene of the run.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What lies behind and in front of each mesh given last; only for shared walls.
    pub fn regions(&self) -> Option<SharedRegions> {
        self.shared.as_ref().map(|shared| shared.regions(&self.scene))
    }

    /// Time [s] and meshes of a frame, one per organ, in the order of the scene; one per wall where they are shared.
    ///
    /// # Errors
    /// If the frame cannot be read.
    ///
    /// # Panics
    /// Never: surfaces are extracted before they are used.
    pub fn frame(&mut self, number: usize) -> Result<(f64, Vec<OrganMesh>), MeshRunError> {
        let frame = self.reader.frame(number)?;
        let cuts = self.reader.cut_sheet(number)?;
        if let Some(shared) = &mut self.shared {
            let meshes = shared.meshes(self.reader.lattice(), &self.scene, &frame, &cuts)?;
            return Ok((frame.time_s, meshes));
        }
        let parted = [frame.topology.severed().len(), cuts.quads.len()];
        if self.epoch.as_ref().is_none_or(|(known, _)| *known != parted) {
            let surfaces = self.extract(&frame.topology, &cuts)?;
            self.epoch = Some((parted, surfaces));
        }
        let (_, surfaces) = self.epoch.as_ref().expect("extracted above");
        let meshes = self
            .organs
            .iter()
            .zip(surfaces)
            .map(|((organ, _), surface)| {
                let organ = &self.scene.organs[*organ];
                let mut mesh = surface.carry(self.reader.lattice(), &frame.displacements_mm);
                mesh.labels = vec![label_of(&organ.voxels); mesh.positions.len()];
                OrganMesh { name: organ.name.clone(), color: organ.color, finish: finish_of(&organ.body), mesh }
            })
            .collect();
        Ok((frame.time_s, meshes))
    }

    /// Whether each vertex of the meshes given last lies on a face of a cut; one list per organ, empty before the first frame.
    pub fn on_cut(&self) -> Vec<Vec<bool>> {
        if let Some(shared) = &self.shared {
            return shared.on_cut().to_vec();
        }
        self.epoch.iter().flat_map(|(_, surfaces)| surfaces.iter().map(OrganSurface::on_seam)).collect()
    }

    fn extract(&mut self, topology: &Topology, cuts: &CutSheet) -> Result<Vec<OrganSurface>, MeshRunError> {
        let Self { reader, scene, care, organs, .. } = self;
        let lattice: &Lattice = reader.lattice();
        let surface = |(organ, shape): &mut (usize, Shape)| {
            match shape {
                Shape::Lattice(values) => Surface::extract(lattice, topology, values).map(OrganSurface::Lattice),
                Shape::Fine(fine) => {
                    let (body, memory) = &mut **fine;
                    let care = care.of(body);
                    FineSurface::extract_after(body, lattice, topology, cuts, care.as_ref(), memory)
                        .map(OrganSurface::Fine)
                }
            }
            .map_err(|source| MeshRunError::Surface { organ: scene.organs[*organ].name.clone(), source })
        };
        organs.iter_mut().map(surface).collect()
    }
}

/// HU at the points of a run's lattice, when an organ was chosen by them.
pub(super) fn hu_of(reader: &RunReader, scene: &Scene) -> Result<Option<Vec<f32>>, MeshRunError> {
    let by_hu = scene.organs.iter().any(is_by_hu);
    Ok(by_hu.then(|| reader.extra_f32(HU_ARRAY)).transpose()?.map(|hu| hu.values))
}

fn is_by_hu(organ: &resolved::Organ) -> bool {
    matches!(organ.voxels, VoxelSelection::Hu { .. })
}

/// What the surface of every organ is drawn from, see [`field`]. `hu`: the CT at the lattice points, for organs chosen by HU.
pub(super) fn fields_of(scene: &Scene, lattice: &Lattice, hu: Option<&[f32]>, smooth: f32) -> Vec<Vec<f32>> {
    let field = |organ: usize| match (&scene.organs[organ].voxels, hu) {
        (VoxelSelection::Hu { min, max }, Some(hu)) => {
            field::from_hu(lattice, organ as u8, hu, [*min, *max], HU_CONTRAST)
        }
        _ => field::smoothed(lattice, organ as u8, (smooth * LATTICE_PASSES).round() as usize),
    };
    (0..scene.organs.len()).map(field).collect()
}

/// The same for organs drawn one by one: walls of two organs lie in one place, then each stands back a little.
fn parted_fields(scene: &Scene, lattice: &Lattice, hu: Option<&[f32]>, smooth: f32) -> Vec<Vec<f32>> {
    let mut fields = fields_of(scene, lattice, hu, smooth);
    // Fields of HU measure something else than shares do, and have no common zero with them.
    if !scene.organs.iter().any(is_by_hu) {
        field::join_walls(lattice, &mut fields);
    }
    fields.iter_mut().enumerate().for_each(|(organ, field)| field::part_walls(lattice, organ as u8, field));
    fields
}

/// Volume of a soft organ now against rest, by two measures that agree but for cut cells and a rounded skin.
#[derive(Debug, Clone, PartialEq)]
pub struct OrganVolume {
    /// The organ.
    pub name: String,
    /// Change of its whole cells relative to the same cells at rest; `None` when none is whole.
    pub by_cells: Option<f64>,
    /// What its closed surface encloses at rest and now [mL].
    pub enclosed_ml: [f64; 2],
}

impl OrganVolume {
    /// Change of what the surface encloses, relative to rest; `None` when it encloses nothing at rest.
    pub fn by_surface(&self) -> Option<f64> {
        let [rest, now] = self.enclosed_ml;
        (rest > 0.0).then(|| now / rest - 1.0)
    }
}

/// One line.
impl std::fmt::Display for OrganVolume {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |share: Option<f64>, none: &str| {
            share.map_or(format!("none ({none})"), |share| format!("{:+.3} %", 100.0 * share))
        };
        write!(
            f,
            "volume of `{}` in the last frame: by cells {}, by surface {}",
            self.name,
            percent(self.by_cells, "no cell is whole"),
            percent(self.by_surface(), "it encloses nothing"),
        )?;
        let [rest, now] = self.enclosed_ml;
        if rest > 0.0 { write!(f, " ({rest:.2} to {now:.2} mL)") } else { Ok(()) }
    }
}

/// Volumes of the soft organs of a world as it is now, in the order of the scene, by the surfaces a [`RunMesher`] gives.
///
/// - `hu`: the CT at the lattice points, needed for organs chosen by HU.
///
/// # Errors
/// If a surface cannot be extracted.
pub fn organ_volumes(world: &World, scene: &Scene, hu: Option<&[f32]>) -> Result<Vec<OrganVolume>, MeshRunError> {
    let (lattice, topology) = (world.lattice(), world.topology());
    let whole = Topology::new(lattice);
    let moved = world.displacements_mm();
    let fields = parted_fields(scene, lattice, hu, 1.0);
    let soft = |organ: &usize| !matches!(scene.organs[*organ].body, resolved::Body::Rigid { .. });
    (0..scene.organs.len())
        .filter(soft)
        .map(|organ| {
            let name = scene.organs[organ].name.clone();
            let extract = |topology: &Topology| {
                Surface::extract(lattice, topology, &fields[organ])
                    .map_err(|source| MeshRunError::Surface { organ: name.clone(), source })
            };
            let at_rest = extract(&whole)?;
            let rest = check(&at_rest.at_rest(lattice)).volume_ml();
            let surface = if topology.severed().is_empty() { at_rest } else { extract(topology)? };
            let now = check(&surface.carry(lattice, &moved)).volume_ml();
            let cells = organ_volume(lattice, topology, organ as u8, |particle| world.displacement(particle));
            Ok(OrganVolume { name, by_cells: cells.change(), enclosed_ml: [rest, now] })
        })
        .collect()
}

/// The resolved scene that a run was made from.
///
/// # Errors
/// If it is not one that this version understands.
pub fn scene_of(reader: &RunReader) -> Result<Scene, MeshRunError> {
    serde_json::from_value(reader.scene().clone())
        .map_err(|source| MeshRunError::Scene { path: reader.path().join("scene.json"), source })
}

/// Bone is dry, everything soft is wet.
pub(super) fn finish_of(body: &resolved::Body) -> Finish {
    if matches!(body, resolved::Body::Rigid { .. }) { Finish::Dry } else { Finish::Wet }
}

/// The label that stands for an organ's tissue in files: its first, or 1 when it was chosen by HU.
pub(super) fn label_of(voxels: &VoxelSelection) -> u16 {
    match voxels {
        VoxelSelection::Labels(labels) => labels.first().copied().unwrap_or(1),
        VoxelSelection::Hu { .. } => 1,
    }
}
