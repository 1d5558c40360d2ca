//! The organs of a run with shared walls: every wall once, between the two organs that share it.

use super::bodies::Bodies;
use super::meshes::{MeshOptions, MeshRunError, Resolution, fields_of, finish_of, hu_of, label_of};
use crate::cut::CutSheet;
use crate::lattice::Lattice;
use crate::scene::resolved::Scene;
use crate::store::{Frame, RunReader};
use crate::surface::SurfaceError;
use crate::surface::fine::Memory;
use crate::surface::interfaces::{Interface, MultiBody, MultiSurface, OUTSIDE, Partition};
use crate::surface::mesh::{Finish, OrganMesh};

/// Whose the walls between organs are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interfaces {
    /// Each organ has a closed mesh of its own.
    #[default]
    Separate,
    /// Every wall is drawn once, with an organ on either side: one mesh per pair, named `liver|gallbladder` or `liver|outside`.
    Shared,
}

/// What lies on the two sides of shared walls.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SharedRegions {
    /// Names of all regions: the outside, then every organ of the scene.
    pub names: Vec<String>,
    /// For each mesh the regions behind and in front of it, as places among the names.
    pub sides: Vec<[u16; 2]>,
}

/// What stands behind the bar in the name of a border to nothing.
const NOTHING: &str = "outside";

/// Name of the mesh of a border: the organ behind it, and the one in front.
fn name_of(scene: &Scene, interface: &Interface) -> String {
    let name = |organ: u8| scene.organs.get(usize::from(organ)).map_or(NOTHING, |organ| organ.name.as_str());
    format!("{}|{}", name(interface.inside), name(interface.outside))
}

/// Whether a mesh is that of an organ, or of a border with that organ behind it.
pub(super) fn is_border_of(mesh: &str, organ: &str) -> bool {
    mesh.strip_prefix(organ).is_some_and(|rest| rest.is_empty() || rest.starts_with('|'))
}

/// What the borders are drawn from.
enum Shape {
    /// Organs at the lattice points.
    Lattice(Partition),
    /// A finer grid, and what its last surface left for the next.
    Fine(Box<(MultiBody, Memory)>),
}

/// All organs of a run, and which of them are asked for.
pub(super) struct SharedOrgans {
    shape: Shape,
    wanted: Vec<bool>,
    /// Surface for this many severed springs and quads of the cut sheet.
    epoch: Option<([usize; 2], MultiSurface)>,
    /// Behind and in front of each mesh given last.
    pairs: Vec<[u8; 2]>,
    on_cut: Vec<Vec<bool>>,
}

impl SharedOrgans {
    /// - `names`: organs whose borders are asked for; all when none is named.
    pub(super) fn new(
        reader: &RunReader,
        scene: &Scene,
        names: &[String],
        options: &MeshOptions,
    ) -> Result<Self, MeshRunError> {
        let shape = match options.resolution {
            Resolution::Lattice => {
                let hu = hu_of(reader, scene)?;
                let fields = fields_of(scene, reader.lattice(), hu.as_deref(), options.smooth);
                Shape::Lattice(Partition::of_lattice(reader.lattice(), fields))
            }
            Resolution::Volume | Resolution::Spacing(_) => {
                let bodies = Bodies::of_run(reader, scene)?;
                let spacing = match options.resolution {
                    Resolution::Spacing(spacing) => spacing,
                    _ => bodies.spacing(),
                };
                let body = bodies.together(scene, spacing, options.smooth)?;
                Shape::Fine(Box::new((body, Memory::default())))
            }
        };
        let wanted = scene.organs.iter().map(|organ| names.is_empty() || names.contains(&organ.name)).collect();
        Ok(Self { shape, wanted, epoch: None, pairs: Vec::new(), on_cut: Vec::new() })
    }

    /// The borders of the organs asked for, in the order of the scene.
    pub(super) fn meshes(
        &mut self,
        lattice: &Lattice,
        scene: &Scene,
        frame: &Frame,
        cuts: &CutSheet,
    ) -> Result<Vec<OrganMesh>, MeshRunError> {
        let parted = [frame.topology.severed().len(), cuts.quads.len()];
        let surface = match self.epoch.take() {
            Some((known, surface)) if known == parted => surface,
            _ => self.extract(lattice, frame, cuts).map_err(|source| {
                let names: Vec<&str> = scene.organs.iter().map(|organ| organ.name.as_str()).collect();
                MeshRunError::Surface { organ: names.join("`, `"), source }
            })?,
        };
        let is_wanted = |organ: u8| self.wanted.get(usize::from(organ)).copied().unwrap_or(false);
        let mut interfaces = surface.carry(lattice, &frame.displacements_mm).interfaces();
        interfaces.retain(|interface| is_wanted(interface.inside) || is_wanted(interface.outside));
        self.epoch = Some((parted, surface));
        self.pairs = interfaces.iter().map(|interface| [interface.inside, interface.outside]).collect();
        self.on_cut = interfaces.iter_mut().map(|interface| std::mem::take(&mut interface.on_cut)).collect();
        let mesh = |mut interface: Interface| {
            let name = name_of(scene, &interface);
            let organ = &scene.organs[usize::from(interface.inside)];
            let beyond = scene.organs.get(usize::from(interface.outside));
            let color = beyond.map_or(organ.color, |beyond| {
                [0, 1, 2].map(|channel| f32::midpoint(organ.color[channel], beyond.color[channel]))
            });
            let finish = if beyond.is_some() { Finish::Wet } else { finish_of(&organ.body) };
            interface.mesh.labels = vec![label_of(&organ.voxels); interface.mesh.positions.len()];
            OrganMesh { name, color, finish, mesh: interface.mesh }
        };
        Ok(interfaces.into_iter().map(mesh).collect())
    }

    /// What lies on the two sides of each mesh given last.
    pub(super) fn regions(&self, scene: &Scene) -> SharedRegions {
        let names = std::iter::once(NOTHING).chain(scene.organs.iter().map(|organ| organ.name.as_str()));
        let region = |label: u8| if label == OUTSIDE { 0 } else { u16::from(label) + 1 };
        let sides = self.pairs.iter().map(|pair| pair.map(region)).collect();
        SharedRegions { names: names.map(str::to_owned).collect(), sides }
    }

    /// Whether each vertex of the meshes given last lies on a face of a cut.
    pub(super) fn on_cut(&self) -> &[Vec<bool>] {
        &self.on_cut
    }

    fn extract(&mut self, lattice: &Lattice, frame: &Frame, cuts: &CutSheet) -> Result<MultiSurface, SurfaceError> {
        match &mut self.shape {
            Shape::Lattice(partition) => MultiSurface::extract(lattice, &frame.topology, partition),
            Shape::Fine(fine) => {
                let (body, memory) = &mut **fine;
                MultiSurface::extract_fine_after(body, lattice, &frame.topology, cuts, memory)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_belong_to_the_organ_behind_them() {
        assert!(is_border_of("liver", "liver") && is_border_of("liver|outside", "liver"));
        assert!(!is_border_of("liver_2|outside", "liver") && !is_border_of("gallbladder|liver", "liver"));
    }
}
