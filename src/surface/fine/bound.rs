//! Any vertices on a fine grid, carried by a coarser lattice.

use super::carry::{Carriage, Carried};
use super::hosts::Hosts;
use super::knife::Knife;
use super::{Frame, Memory, bound};
use crate::cut::CutSheet;
use crate::lattice::{Lattice, Topology};
use crate::surface::SurfaceError;

/// Vertices at rest, bound to a lattice.
#[derive(Debug, Clone)]
pub(in crate::surface) struct Bound {
    /// Rest places, RAS+ [mm].
    pub(in crate::surface) rest: Vec<[f64; 3]>,
    carriage: Carriage,
}

impl Bound {
    /// Opens a fine lattice where blades went, draws on it, and binds what was drawn.
    ///
    /// - `memory`: that of the last time, or a new one.
    /// - `draw`: from the springs of the fine lattice that are left: what it likes, the rest place of each vertex [mm], a point of the
    ///   fine lattice on its inside and on its side of every cut, and the vertices where cuts end, ascending.
    pub(in crate::surface) fn draw<T>(
        fine: &Lattice,
        (lattice, topology, cuts): (&Lattice, &Topology, &CutSheet),
        memory: &mut Memory,
        draw: impl FnOnce(&Topology) -> Result<(T, Vec<[f64; 3]>, [Vec<u32>; 2]), SurfaceError>,
    ) -> Result<(T, Self), SurfaceError> {
        let knife = Knife::new(cuts, &lattice.grid.affine);
        let hosts = Hosts::new(lattice, topology, &knife);
        let frame = Frame::new(lattice, fine);
        let cut = memory.opening.open(fine, (lattice, topology, cuts), &knife, &hosts, &frame);
        let (drawn, rest, [anchors, ends]) = draw(&cut)?;
        let carriage = bound(fine, (lattice, topology), &hosts, &frame, &rest, (&anchors, &ends));
        Ok((drawn, Self { rest, carriage }))
    }

    /// Places and displacements of the vertices, RAS+ [mm].
    pub(in crate::surface) fn carry(
        &self,
        lattice: &Lattice,
        displacements: &[[f32; 3]],
        positions: &mut Vec<[f32; 3]>,
        moved: &mut Vec<[f32; 3]>,
    ) {
        positions.resize(self.rest.len(), [0.0; 3]);
        moved.resize(self.rest.len(), [0.0; 3]);
        let normals = vec![[0.0; 3]; self.rest.len()];
        let carried = Carried { positions, moved, normals: &mut normals.clone() };
        self.carriage.carry(lattice, displacements, &self.rest, &normals, carried);
    }
}
