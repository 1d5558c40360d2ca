//! Fewer and better triangles, without a crack.
//!
//! ```text
//! tidy       edges much shorter than the spacing shrink to a point, edges turn where that opens the smallest angle
//! decimate   edges shrink in the order of the error that costs (quadrics), down to a count or up to a distance
//! parents    every vertex that is left names the original vertex whose carrier moves it
//! ```
//! A change is made only when the surface stays a closed manifold (link condition), no triangle turns over or becomes a worse sliver,
//! every part keeps its volume within 0.4 %, and the features hold: rims, where a cut meets the skin, shrink only along themselves; faces of cuts and rims keep
//! places they had, so the lips of a cut stay as far apart as they were; a new place on the skin keeps clear of every other vertex.
//!
//! Not guaranteed: that triangles keep apart in space (where a cut bends, its lips are thinned each on its own).
//! The answer does not depend on the thread count: changes are made one after the other.
//!
//! # Source
//! Garland and Heckbert, Surface simplification using quadric error metrics, 1997; Dey, Edelsbrunner, Guha and Nekhayev, Topology
//! preserving edge contraction, 1999; Lindstrom and Turk, Fast and memory efficient polygonal simplification, 1998 (volume).

mod clearance;
mod collapse;
mod features;
mod flip;
mod halves;
mod origin;
mod quadric;
mod shape;
mod volumes;

use rayon::prelude::*;

use crate::surface::normals::Sheet;
use collapse::{Order, Worker};
use halves::NONE;

/// Edges below this share of the spacing shrink when a mesh is tidied: marching cubes leaves them beside grid points.
pub const TIDY_BELOW: f64 = 0.3;

/// New places keep this share of the spacing from other vertices: what the lips of a cut have between them.
const CLEARANCE: f64 = 0.001;

/// A closed mesh at rest.
#[derive(Debug, Clone, Copy)]
pub struct RestMesh<'a> {
    /// Vertices, RAS+ [mm]. Shape `[vertices, 3]`.
    pub positions: &'a [[f64; 3]],
    /// Corners of each triangle, counter-clockwise seen from outside. Shape `[triangles, 3]`.
    pub triangles: &'a [[u32; 3]],
    /// Where each vertex lies, or empty for skin throughout. Shape `[vertices]`.
    pub sheets: &'a [Sheet],
    /// Organ of each vertex, or empty for one organ. Edges between organs stay. Shape `[vertices]`.
    pub organs: &'a [u8],
}

impl RestMesh<'_> {
    fn sheet(&self, vertex: u32) -> Sheet {
        self.sheets.get(vertex as usize).copied().unwrap_or_default()
    }

    fn organ(&self, vertex: u32) -> u8 {
        self.organs.get(vertex as usize).copied().unwrap_or_default()
    }
}

/// What is asked for. Nothing changes when all is `None` or false.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Care {
    /// Spacing of the grid the surface was drawn on [mm].
    pub spacing_mm: f64,
    /// Remove slivers.
    pub tidy: bool,
    /// Stop decimating at this many triangles. Without `max_error_mm` nothing else stops it but features and topology.
    pub triangles: Option<usize>,
    /// Stay within this distance of the original, both ways \[mm\] (see [`Care::apply`]).
    pub max_error_mm: Option<f64>,
}

/// A mesh after care.
#[derive(Debug, Clone, PartialEq)]
pub struct CaredMesh {
    /// Vertices, RAS+ [mm]; all are used.
    pub positions: Vec<[f64; 3]>,
    /// Corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// For every vertex the original one it came from: of the same sheet and organ, and near.
    pub parents: Vec<u32>,
}

/// Why a mesh cannot be cared for.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CareError {
    /// A triangle is not one.
    #[error("triangle {triangle} has corners {corners:?}; expected three different ones of {vertices} vertices")]
    BadTriangle {
        /// Number of the triangle.
        triangle: usize,
        /// Its corners.
        corners: [u32; 3],
        /// Vertices there are.
        vertices: usize,
    },
    /// An edge has not two triangles that run along it in opposite directions.
    #[error(
        "edge {} - {} has {triangles} triangles; expected two that agree about their outside: see what `yawara check` says of the mesh",
        edge[0],
        edge[1]
    )]
    NotClosed {
        /// Ends of the edge.
        edge: [u32; 2],
        /// Triangles at it.
        triangles: usize,
    },
    /// The triangles at a vertex form more than one fan.
    #[error("parts of the surface meet in vertex {vertex} alone; give each a vertex of its own")]
    NotManifold {
        /// Number of the vertex.
        vertex: u32,
    },
    /// Half-edge numbers are 32 bits wide.
    #[error("{found} triangles; at most {} can be cared for: take a coarser pitch", u32::MAX / 3)]
    TooManyTriangles {
        /// Triangles given.
        found: usize,
    },
    /// An attribute does not fit the vertices.
    #[error("{found} {what} for {vertices} vertices; expected one each, or none at all")]
    AttributeLength {
        /// "sheets" or "organs".
        what: &'static str,
        /// How many were given.
        found: usize,
        /// Vertices there are.
        vertices: usize,
    },
    /// A place is not finite.
    #[error("vertex {vertex} lies at {found:?} mm; expected finite coordinates")]
    NotFinite {
        /// Number of the vertex.
        vertex: usize,
        /// Its place.
        found: [f64; 3],
    },
    /// The spacing or the distance allowed is not a length.
    #[error("{what} is {found} mm; expected a length above 0 mm")]
    NotALength {
        /// What was given.
        what: &'static str,
        /// Its value.
        found: f64,
    },
}

impl Care {
    /// Carries out what is asked for.
    ///
    /// The count may not be reached: features, topology, shape or the distance forbid what is left. The distance is held at original
    /// vertices and centres of triangles (to the new surface) and at 15 places of each new triangle (to the original), with a fifth to
    /// spare for what lies between.
    ///
    /// # Errors
    /// If the mesh is not closed, manifold and oriented, has places that are not finite or attributes of another length, or a length is not
    /// above zero.
    pub fn apply(&self, mesh: RestMesh<'_>) -> Result<CaredMesh, CareError> {
        self.refuse(mesh)?;
        let mut worker = Worker::new(mesh, CLEARANCE * self.spacing_mm, self.max_error_mm)?;
        if self.tidy {
            worker.collapse(Order::Shortest { below: TIDY_BELOW * self.spacing_mm });
            worker.flip(self.spacing_mm);
        }
        if self.triangles.is_some() || self.max_error_mm.is_some() {
            worker.collapse(Order::Error { triangles: self.triangles.unwrap_or(0) });
            if self.tidy {
                worker.flip(self.spacing_mm);
            }
        }
        Ok(worker.finish())
    }

    fn refuse(&self, mesh: RestMesh<'_>) -> Result<(), CareError> {
        let vertices = mesh.positions.len();
        for (what, found) in [("sheets", mesh.sheets.len()), ("organs", mesh.organs.len())] {
            if found != 0 && found != vertices {
                return Err(CareError::AttributeLength { what, found, vertices });
            }
        }
        let finite = |place: &[f64; 3]| place.iter().all(|c| c.is_finite());
        if let Some(vertex) = mesh.positions.iter().position(|place| !finite(place)) {
            return Err(CareError::NotFinite { vertex, found: mesh.positions[vertex] });
        }
        let lengths = [("the spacing", Some(self.spacing_mm)), ("the largest error", self.max_error_mm)];
        for (what, length) in lengths {
            if let Some(found) = length.filter(|length| !(length.is_finite() && *length > 0.0)) {
                return Err(CareError::NotALength { what, found });
            }
        }
        Ok(())
    }
}

impl Worker<'_> {
    /// Numbers what is left afresh, in the order of the original.
    fn finish(self) -> CaredMesh {
        let mut number = vec![NONE; self.places.len()];
        let mut kept = Vec::new();
        for vertex in 0..self.places.len() as u32 {
            if self.halves.used(vertex) {
                number[vertex as usize] = kept.len() as u32;
                kept.push(vertex);
            }
        }
        let parent = |&v: &u32| self.origin.nearest(self.parents[v as usize], self.places[v as usize]);
        let triangles = (0..self.halves.len() / 3).map(|t| self.halves.corners(t)).filter(|t| t[0] != NONE);
        CaredMesh {
            positions: kept.iter().map(|&v| self.places[v as usize].into()).collect(),
            triangles: triangles.map(|t| t.map(|v| number[v as usize])).collect(),
            parents: kept.par_iter().map(parent).collect(),
        }
    }
}
