//! A surface finer than the lattice that carries it.
//!
//! ```text
//! body        the organ on a grid of its own, as fine as the CT: which points are inside, how far from the border
//! knife       the cut sheet, at rest: it parts points of the body that the blade passed between
//! opening     the springs of the body that are left, followed from cut to cut
//! surface     marching cubes of the body, opened where the knife went (the same rules, on the fine grid)
//! hosts       for every vertex: the cell of the lattice that carries it, and the corners on its side of the cut
//! endings     vertices near the end of a cut, where both sides come together
//! carriage    once per frame: one trilinear interpolation per vertex; normals turn with the deformation
//! ```
//! Whatever the lattice does, the mesh is closed, manifold and oriented: it is that of [`super::Surface`] on the fine grid. The
//! springs of the lattice have the last word: points whose cells no spring joins any more are parted even where the sheet has a gap.
//! Pieces of the body without a particle of their own follow the nearest cell.
//!
//! Not guaranteed: that the two sides of a cut fit together to better than the curvature of the displacement over a cell.

mod bound;
mod carry;
mod endings;
mod host_cells;
mod hosts;
mod knife;
mod opening;
mod skin_normals;

use rayon::prelude::*;

pub(super) use self::bound::Bound;
use self::carry::{Carriage, Carried};
use self::endings::endings;
use self::hosts::{Host, Hosts};
use self::knife::Knife;
use self::opening::Opening;
use self::skin_normals::SkinNormals;
use super::care::{Care, RestMesh};
use super::extract::Loop;
use super::normals::Sheet;
use super::{Surface, SurfaceError};
use crate::cut::CutSheet;
use crate::geometry::{Grid, Matrix3, Point3, Vector3};
use crate::lattice::build::{BuildLatticeError, NO_ORGAN, build};
use crate::lattice::{Lattice, Topology};
use crate::surface::mesh::TriangleMesh;
use crate::volume::Volume;

/// An organ on a grid of its own, at rest.
#[derive(Debug, Clone)]
pub struct Body {
    /// A point of the grid is a particle when it is inside.
    points: Lattice,
    /// Values at the points of that lattice's grid, above zero inside.
    values: Vec<f32>,
}

impl Body {
    /// The body of a field: points above zero are inside. Values say where between two points the border lies.
    ///
    /// - `grid`: cubic cells in patient space \[mm\]; `values`: one per grid point, x fastest.
    ///
    /// # Errors
    /// If no value is above zero, the cells are not cubes, or there are more than 2^31 points.
    ///
    /// # Panics
    /// If there is not one value per grid point.
    pub fn new(grid: Grid, values: Vec<f32>) -> Result<Self, BuildLatticeError> {
        let inside = values.par_iter().map(|&value| if value > 0.0 { 0 } else { NO_ORGAN }).collect();
        let points = build(&Volume::from_vec(grid, inside))?;
        let shape = points.grid.shape;
        let first = grid.affine.index_of(points.grid.affine.origin());
        let first = [0, 1, 2].map(|axis| first[axis].round() as i64);
        let value_at = |point: usize| {
            let ijk = shape.ijk(point);
            let at = [0, 1, 2].map(|axis| first[axis] + ijk[axis] as i64);
            let within = (0..3).all(|axis| at[axis] >= 0 && at[axis] < grid.shape.dims()[axis] as i64);
            if within { values[grid.shape.linear(at.map(|i| i as usize))] } else { -1.0 }
        };
        let values = (0..shape.len()).into_par_iter().map(value_at).collect();
        Ok(Self { points, values })
    }

    /// Number of points inside.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Never: a body without a point inside is refused.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Distance of neighbouring points [mm].
    pub fn spacing(&self) -> f64 {
        self.points.pitch * 1e3
    }
}

/// What one extraction of a body leaves for the next, so that a further cut costs little more than what it touched.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    opening: Opening,
    normals: SkinNormals,
}

/// A closed surface of a body, and what moves each of its vertices.
///
/// Vertex numbers and triangles stay the same until the next extraction, which is needed only after a cut.
#[derive(Debug, Clone)]
pub struct FineSurface {
    /// Rest places, RAS+ [mm].
    rest: Vec<[f64; 3]>,
    /// Unit normals at rest.
    normals: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    on_seam: Vec<bool>,
    /// Centres of loops with the vertices of each loop, whose mean they follow.
    centres: Vec<Loop>,
    carriage: Carriage,
}

impl FineSurface {
    /// Extracts the surface of a body as blades have left it, and binds it to the lattice.
    ///
    /// - `topology`, `cuts`: the springs of the lattice and the cut sheet at the same moment.
    ///
    /// # Errors
    /// If the surface would need more than 2^32 vertices or triangles.
    pub fn extract(body: &Body, lattice: &Lattice, topology: &Topology, cuts: &CutSheet) -> Result<Self, SurfaceError> {
        Self::extract_after(body, lattice, topology, cuts, None, &mut Memory::default())
    }

    /// The same after a further cut, with fewer or better triangles if asked for, see [`super::care`].
    ///
    /// - `memory`: that of the last extraction of this body from this lattice, or a new one. The surface does not depend on it.
    ///
    /// # Errors
    /// As [`FineSurface::extract`], or if a length of `care` is not above zero.
    pub fn extract_after(
        body: &Body,
        lattice: &Lattice,
        topology: &Topology,
        cuts: &CutSheet,
        care: Option<&Care>,
        memory: &mut Memory,
    ) -> Result<Self, SurfaceError> {
        let knife = Knife::new(cuts, &lattice.grid.affine);
        let hosts = Hosts::new(lattice, topology, &knife);
        let frame = Frame::new(lattice, &body.points);
        let fine = &body.points;
        let cut = memory.opening.open(fine, (lattice, topology, cuts), &knife, &hosts, &frame);
        let surface = Surface::extract_places(fine, &cut, &body.values)?;
        let mut rest: Vec<[f64; 3]> = surface.rest_places().collect();
        let at_rest: Vec<[f32; 3]> = rest.iter().map(|place| place.map(|c| c as f32)).collect();
        let mut sheets: Vec<Sheet> = surface.sheets().collect();
        let mut on_seam: Vec<bool> = surface.on_seam().collect();
        let mut of_triangles = surface.normals(&at_rest);
        let mut anchors = surface.anchors();
        let mut ends = surface.ends_of_cuts();
        let mut layers = surface.vertex_layers().to_vec();
        let (mut triangles, mut centres) = surface.into_triangles_and_centres();
        if let Some(care) = care {
            let mesh = RestMesh { positions: &rest, triangles: &triangles, sheets: &sheets, organs: &[] };
            let cared = care.apply(mesh)?;
            // A vertex takes from its parent what does not follow from its place; what is left of a loop is carried like the rest.
            sheets = cared.parents.iter().map(|&parent| sheets[parent as usize]).collect();
            on_seam = cared.parents.iter().map(|&parent| on_seam[parent as usize]).collect();
            of_triangles = cared.parents.iter().map(|&parent| of_triangles[parent as usize]).collect();
            anchors = cared.parents.iter().map(|&parent| anchors[parent as usize]).collect();
            let left = (0..).zip(&cared.parents).filter(|(_, parent)| ends.binary_search(parent).is_ok());
            ends = left.map(|(vertex, _)| vertex).collect();
            (rest, triangles, centres) = (cared.positions, cared.triangles, Vec::new());
            layers.clear();
        }
        let normals = memory.normals.update(body, &sheets, &layers, &rest, &of_triangles)?;
        let carriage = bound(fine, (lattice, topology), &hosts, &frame, &rest, (&anchors, &ends));
        Ok(Self { rest, normals, triangles, on_seam, centres, carriage })
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.rest.len()
    }

    /// Corners of each triangle, counter-clockwise seen from outside in RAS+.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Rest place of each vertex, RAS+ [mm].
    pub fn rest_places(&self) -> &[[f64; 3]] {
        &self.rest
    }

    /// Whether each vertex lies on a face of a cut (its rim included) rather than on the skin.
    pub fn on_seam(&self) -> impl ExactSizeIterator<Item = bool> + '_ {
        self.on_seam.iter().copied()
    }

    /// The surface moved by displacements of the particles, RAS+ [mm], in the order of the lattice.
    ///
    /// Positions, normals and displacements are filled in.
    ///
    /// # Panics
    /// If there is not one displacement per particle of the lattice the surface was bound to.
    pub fn carry(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> TriangleMesh {
        let mut mesh = TriangleMesh { triangles: self.triangles.clone(), ..TriangleMesh::default() };
        self.carry_into(lattice, displacements, &mut mesh);
        mesh
    }

    /// The same into a mesh whose lists are used again; its triangles stay as they are.
    ///
    /// # Panics
    /// As [`FineSurface::carry`].
    pub fn carry_into(&self, lattice: &Lattice, displacements: &[[f32; 3]], mesh: &mut TriangleMesh) {
        let TriangleMesh { positions, displacements: moved, normals, .. } = mesh;
        for list in [&mut *positions, &mut *moved, &mut *normals] {
            list.resize(self.rest.len(), [0.0; 3]);
        }
        let carried = Carried { positions, moved, normals };
        self.carriage.carry(lattice, displacements, &self.rest, &self.normals, carried);
        for (centre, ring) in &self.centres {
            let at = *centre as usize;
            let mean = [0, 1, 2].map(|axis| {
                ring.iter().map(|&vertex| f64::from(moved[vertex as usize][axis])).sum::<f64>() / ring.len() as f64
            });
            moved[at] = mean.map(|c| c as f32);
            positions[at] = [0, 1, 2].map(|axis| (self.rest[at][axis] + mean[axis]) as f32);
        }
    }
}

/// From the indices of the fine grid to those of the lattice and back.
#[derive(Clone, Copy)]
struct Frame {
    linear: Matrix3,
    offset: Vector3,
    inverse: Matrix3,
}

impl Frame {
    fn new(lattice: &Lattice, fine: &Lattice) -> Self {
        let offset = lattice.grid.affine.index_of(fine.grid.affine.origin()).coords;
        let axis = |axis: Vector3| lattice.grid.affine.index_vector_of(fine.grid.affine.apply_vector(axis));
        let linear = Matrix3::from_columns(&[axis(Vector3::x()), axis(Vector3::y()), axis(Vector3::z())]);
        // Both grids are invertible, so their quotient is.
        Self { linear, offset, inverse: linear.try_inverse().unwrap_or_else(Matrix3::identity) }
    }

    fn to_fine(self, index: Vector3) -> Vector3 {
        self.inverse * (index - self.offset)
    }

    fn to_lattice(self, index: Vector3) -> Vector3 {
        self.linear * index + self.offset
    }

    /// Index in the lattice of a point of the body.
    fn place_of(&self, fine: &Lattice, point: u32) -> Vector3 {
        self.to_lattice(Vector3::from(fine.ijk(point).map(|i| i as f64)))
    }
}

/// Binds vertices to the lattice: by their rest places [mm], the points of the body on their inside, and which of them lie where cuts
/// end.
fn bound(
    fine: &Lattice,
    (lattice, topology): (&Lattice, &Topology),
    hosts: &Hosts<'_>,
    frame: &Frame,
    rest: &[[f64; 3]],
    (anchors, ends): (&[u32], &[u32]),
) -> Carriage {
    let places: Vec<Vector3> =
        rest.par_iter().map(|&place| lattice.grid.affine.index_of(Point3::from(place)).coords).collect();
    let inside = anchors.par_iter().map(|&anchor| frame.place_of(fine, anchor));
    let hosts_of: Vec<Host> =
        inside.zip(&places).map(|(inside, &vertex)| hosts.host_of_vertex(inside, vertex)).collect();
    let endings = endings(hosts, &hosts_of, &places, ends);
    Carriage::bind(lattice, topology, hosts, &hosts_of, &places, &endings)
}
