//! All organs of a lattice in one surface: every wall between two of them is drawn once and belongs to both.
//!
//! ```text
//! partition   every grid point belongs to one organ or to none; fields tell where between two points the border lies
//! face        how walls run across a face between two cells: contours, and nodes where three or more labels meet
//! cell        contours closed into sheets; those that meet in a line share one centre
//! draw        every cell, then the vertices with what carries them
//! mesh        a frame: closed mesh of an organ, or one mesh per wall
//! ```
//! What holds, whatever was severed:
//! - Every triangle lies between two organs, or an organ and the outside. The triangles that name an organ form its border: closed and
//!   oriented. So the volumes of the organs add up to that of their union, exactly.
//! - Along every edge each organ has two sheets or none: walls meet in lines without gap or overlap, also where they meet the skin.
//! - The border of an organ is a manifold but for single points at which it touches itself, always centres of cells;
//!   [`MultiMesh::organ_mesh`] has one vertex there for each side.
//! - Where a blade went the lips are borders to the outside, as they are in [`super::Surface`]: the same edges open, the same rims.
//!   A cut along a wall parts the two organs; it ends where the wall goes on.
//!
//! Not guaranteed: that triangles keep apart in space where walls of several organs, a cut and the skin meet in one cell.
//!
//! # Source
//! Wu and Sullivan, Multiple material marching cubes algorithm, 2003. Differs: springs and organ order decide ambiguous faces, equal
//! labels in a face are joined before a node is made, and cuts open gaps.

mod cell;
mod draw;
mod face;
mod mesh;
mod partition;

use self::draw::{Drawn, Knot, draw};
pub use self::face::OUTSIDE;
pub use self::mesh::{Interface, MultiMesh};
pub use self::partition::{OrganField, Partition};
use super::SurfaceError;
use super::embed::{Embedding, Vertex};
use super::extract::add_gradients;
use super::fine::{Bound, Memory};
use super::normals::Sheet;
use crate::cut::CutSheet;
use crate::geometry::{Grid, GridShape};
use crate::lattice::build::{BuildLatticeError, build};
use crate::lattice::{Lattice, Topology};
use crate::volume::Volume;

/// Organs on a grid of their own, at rest: what a surface finer than the lattice is drawn from.
#[derive(Debug, Clone)]
pub struct MultiBody {
    /// A point of the grid is a particle when it belongs to an organ.
    points: Lattice,
    /// On the grid of that lattice.
    partition: Partition,
}

impl MultiBody {
    /// The organs of a partition.
    ///
    /// - `grid`: that of the partition, cubic cells in patient space \[mm\].
    ///
    /// # Errors
    /// If no point belongs to an organ, the cells are not cubes, or there are more than 2^31 points.
    ///
    /// # Panics
    /// If the partition is one of another shape.
    pub fn new(grid: Grid, partition: &Partition) -> Result<Self, BuildLatticeError> {
        assert_eq!(partition.shape(), grid.shape, "the partition of the grid");
        let points = build(&Volume::from_vec(grid, partition.labels().to_vec()))?;
        let first = grid.affine.index_of(points.grid.affine.origin());
        let partition = partition.part([0, 1, 2].map(|axis| first[axis].round() as i64), points.grid.shape);
        Ok(Self { points, partition })
    }

    /// Points along each axis.
    pub fn shape(&self) -> GridShape {
        self.points.grid.shape
    }
}

/// What moves the vertices.
#[derive(Debug, Clone)]
enum Motion {
    /// The particles at the ends of their edges.
    Lattice(Embedding),
    /// The cells of a coarser lattice.
    Fine(Bound),
}

/// The borders of all organs, each drawn once, and what moves each of their vertices.
///
/// Vertex numbers and triangles stay the same until the next extraction, which is needed only after a cut.
#[derive(Debug, Clone)]
pub struct MultiSurface {
    motion: Motion,
    /// Vertices where borders meet, which follow others.
    knots: Vec<Knot>,
    triangles: Vec<[u32; 3]>,
    sides: Vec<[u8; 2]>,
    sheets: Vec<Sheet>,
    /// Vertices at which an organ may touch itself, ascending.
    cones: Vec<u32>,
}

impl MultiSurface {
    /// Draws the organs of a lattice.
    ///
    /// # Errors
    /// If the partition is not one of the lattice's grid, or the surface would need more than 2^32 vertices or triangles.
    pub fn extract(lattice: &Lattice, topology: &Topology, partition: &Partition) -> Result<Self, SurfaceError> {
        let mut drawn = draw(lattice, topology, partition)?;
        add_gradients(&mut drawn.embedding, lattice, topology);
        let embedding = std::mem::take(&mut drawn.embedding);
        let sheets = embedding.vertices.iter().map(Vertex::shown_on).collect();
        Ok(Self::of(drawn, Motion::Lattice(embedding), sheets))
    }

    /// Draws organs on a grid of their own, as blades have left them, and binds their borders to the lattice.
    ///
    /// - `topology`, `cuts`: the springs of the lattice and the cut sheet at the same moment.
    ///
    /// # Errors
    /// If the surface would need more than 2^32 vertices or triangles.
    pub fn extract_fine(
        body: &MultiBody,
        lattice: &Lattice,
        topology: &Topology,
        cuts: &CutSheet,
    ) -> Result<Self, SurfaceError> {
        Self::extract_fine_after(body, lattice, topology, cuts, &mut Memory::default())
    }

    /// The same after a further cut.
    ///
    /// - `memory`: that of the last extraction of this body from this lattice, or a new one. The surface does not depend on it.
    ///
    /// # Errors
    /// As [`MultiSurface::extract_fine`].
    pub fn extract_fine_after(
        body: &MultiBody,
        lattice: &Lattice,
        topology: &Topology,
        cuts: &CutSheet,
        memory: &mut Memory,
    ) -> Result<Self, SurfaceError> {
        let fine = &body.points;
        let (drawn, bound) = Bound::draw(fine, (lattice, topology, cuts), memory, |cut| {
            let drawn = draw(fine, cut, &body.partition)?;
            let rest = drawn.embedding.vertices.iter().map(|vertex| vertex.rest).collect();
            let mut anchors = drawn.embedding.anchors();
            for knot in &drawn.knots {
                anchors[knot.vertex as usize] = anchors[knot.sources[0].0 as usize];
            }
            let ends = drawn.embedding.ends_of_cuts();
            Ok((drawn, rest, [anchors, ends]))
        })?;
        let sheets = drawn.embedding.vertices.iter().map(Vertex::shown_on).collect();
        Ok(Self::of(drawn, Motion::Fine(bound), sheets))
    }

    fn of(drawn: Drawn, motion: Motion, sheets: Vec<Sheet>) -> Self {
        let Drawn { knots, triangles, sides, cones, .. } = drawn;
        Self { motion, knots, triangles, sides, sheets, cones }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.sheets.len()
    }

    /// Corners of each triangle, counter-clockwise seen from in front of it in RAS+.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Organ behind each triangle and organ in front of it, or [`OUTSIDE`]; the smaller number first.
    pub fn sides(&self) -> &[[u8; 2]] {
        &self.sides
    }

    /// The borders moved by displacements of the particles, RAS+ [mm], in the order of the lattice.
    ///
    /// # Panics
    /// If there is not one displacement per particle of the lattice that carries the surface.
    pub fn carry(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> MultiMesh<'_> {
        assert_eq!(displacements.len(), lattice.len(), "one displacement per particle");
        let (mut positions, mut moved) = (Vec::new(), Vec::new());
        match &self.motion {
            Motion::Lattice(embedding) => embedding.carry(lattice, displacements, &mut positions, &mut moved),
            Motion::Fine(bound) => bound.carry(lattice, displacements, &mut positions, &mut moved),
        }
        for Knot { vertex, sources } in &self.knots {
            let at = *vertex as usize;
            let mut mean = [0.0_f64; 3];
            for &(source, weight) in sources {
                for axis in 0..3 {
                    mean[axis] += f64::from(weight) * f64::from(moved[source as usize][axis]);
                }
            }
            let rest = match &self.motion {
                Motion::Lattice(embedding) => embedding.vertices[at].rest,
                Motion::Fine(bound) => bound.rest[at],
            };
            moved[at] = mean.map(|c| c as f32);
            positions[at] = [0, 1, 2].map(|axis| (rest[axis] + mean[axis]) as f32);
        }
        MultiMesh { surface: self, positions, displacements: moved }
    }

    /// The borders at rest.
    pub fn at_rest(&self, lattice: &Lattice) -> MultiMesh<'_> {
        self.carry(lattice, &vec![[0.0; 3]; lattice.len()])
    }
}
