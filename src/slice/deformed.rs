//! From places in the deformed body back to rest: so that a slice can show the CT carried by the tissue.
//!
//! Every lattice cell is split into six tetrahedra about one body diagonal (Kuhn 1960), whose edges are all springs of the
//! lattice. Inside a tetrahedron the map is linear, hence exact for any affine deformation, and of second order in the pitch
//! otherwise.
//!
//! A tetrahedron that a blade went through, or that reaches beyond the last particle, is drawn once for each group of corners
//! that still holds together: its other corners are put where the deformation around the group would carry them, and tissue
//! ends half-way to them. So a closed cut is closed; the blade itself may have gone up to half a pitch beside the border that
//! is drawn. Cells of material end at their corners, particles that are voxels reach half a pitch beyond themselves.
//!
//! Where tissue overlaps itself (two lips pushed into each other), the cell with the lower number is shown.

use rayon::prelude::*;

use super::{Raster, SliceAxis};
use crate::geometry::{Matrix3, Point3, Vector3};
use crate::lattice::build::NO_ORGAN;
use crate::lattice::neighbours::{ALL_ALIVE, direction_of};
use crate::lattice::{Lattice, NO_PARTICLE, Topology};
use crate::surface::gradient::{AxisDisplacements, Gradients};

/// Offsets of a cell's corners, x fastest: corner `c` is at bits 0, 1 and 2 of `c`.
const CORNERS: usize = 8;
/// The six tetrahedra from corner 0 to corner 7, one per order of the three axes.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];
/// Rows of pixels that one task paints.
const BAND: usize = 16;
/// Cells that one task looks through.
const CHUNK: usize = 1 << 14;
/// Slack of the inside test [barycentric], so that a pixel on a shared face is in at least one tetrahedron.
const SLACK: f64 = 1e-9;

/// What a pixel of the deformed body shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Carried {
    /// Tissue whose rest place is this, RAS+ [mm].
    From(Point3),
    /// Nothing: tissue was here at rest and has moved away.
    Left,
    /// No simulated tissue, at rest or now.
    Elsewhere,
}

/// Rest places under the pixels of one slice.
#[derive(Debug, Clone, PartialEq)]
pub struct CarriedRaster {
    pixels: Vec<Carried>,
}

impl CarriedRaster {
    /// Asks a map for each pixel of a slice.
    pub fn from_fn(raster: &Raster, map: impl Fn(Point3) -> Carried + Sync) -> Self {
        let width = raster.width as usize;
        let pixel = |at: usize| map(raster.place((at % width) as u32, (at / width) as u32));
        Self { pixels: (0..raster.len()).into_par_iter().map(pixel).collect() }
    }

    /// The pixels, row by row from the upper left. Shape `[height, width]`.
    pub fn pixels(&self) -> &[Carried] {
        &self.pixels
    }
}

/// The inverse of a deformation of the lattice.
pub struct InverseMap<'a> {
    lattice: &'a Lattice,
    topology: &'a Topology,
    displacements: &'a [[f32; 3]],
    /// Deformation around each particle that lost a spring or never had all; index by [`InverseMap::gradient_at`].
    gradients: Vec<AxisDisplacements>,
    /// Index among the gradients of each particle, or `u32::MAX`.
    gradient_at: Vec<u32>,
}

/// The eight corners of a cell, x fastest.
struct Cell {
    /// [`NO_PARTICLE`] where there is none.
    particle: [u32; CORNERS],
    /// Rest places, RAS+ [mm].
    rest: [Point3; CORNERS],
}

/// A tetrahedron that meets the plane: affine maps of (column, row) to barycentric and rest coordinates, and its pixels.
struct Piece {
    /// Barycentric coordinates of corners 1 to 3: `[constant, per column, per row]`.
    inside: [Vector3; 3],
    /// Rest place: the same form, RAS+ [mm].
    rest: [Vector3; 3],
    /// Corners without tissue of this piece.
    beyond: [bool; 4],
    columns: [usize; 2],
    rows: [usize; 2],
}

impl<'a> InverseMap<'a> {
    /// The map of a state: displacements from rest of each particle, RAS+ [mm], shape `[particles]`.
    ///
    /// # Panics
    /// If there is not one displacement per particle.
    pub fn new(lattice: &'a Lattice, topology: &'a Topology, displacements: &'a [[f32; 3]]) -> Self {
        assert_eq!(displacements.len(), lattice.len(), "one displacement per particle");
        let mut gradient_at = vec![u32::MAX; lattice.len()];
        let mut gradients = Vec::new();
        // No deformation can be told from places that are no numbers.
        if displacements.par_iter().all(|u| u.iter().all(|x| x.is_finite())) {
            let border: Vec<u32> = (0..lattice.len() as u32)
                .filter(|&p| {
                    // Cells end where their corners are; particles on their own reach half-way to where others would be.
                    let whole = if lattice.has_cells() { lattice.springs[p as usize] } else { ALL_ALIVE };
                    topology.alive()[p as usize] != whole
                })
                .collect();
            let (found, index) = Gradients::new(lattice, topology.alive(), &border);
            gradients = found.evaluate(lattice, displacements);
            border.iter().zip(index).for_each(|(&particle, at)| gradient_at[particle as usize] = at);
        }
        Self { lattice, topology, displacements, gradients, gradient_at }
    }

    /// Rest places under the pixels of a slice: O(cells + pixels), the same at any number of threads.
    pub fn carried(&self, raster: &Raster) -> CarriedRaster {
        let now = self.paint(raster, true);
        let then = self.paint(raster, false);
        let state = |(now, then): (Option<Point3>, Option<Point3>)| match (now, then) {
            (Some(rest), _) => Carried::From(rest),
            (None, Some(_)) => Carried::Left,
            (None, None) => Carried::Elsewhere,
        };
        CarriedRaster { pixels: now.into_par_iter().zip(then).map(state).collect() }
    }

    fn paint(&self, raster: &Raster, deformed: bool) -> Vec<Option<Point3>> {
        let points = self.lattice.grid.shape.len();
        let chunks: Vec<Vec<Piece>> = (0..points.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut pieces = Vec::new();
                for point in chunk * CHUNK..points.min((chunk + 1) * CHUNK) {
                    self.cell(raster, point, deformed, &mut pieces);
                }
                pieces
            })
            .collect();
        let pieces: Vec<Piece> = chunks.into_iter().flatten().collect();
        let width = raster.width as usize;
        let mut bands: Vec<Vec<u32>> = vec![Vec::new(); (raster.height as usize).div_ceil(BAND)];
        for (at, piece) in pieces.iter().enumerate() {
            for band in &mut bands[piece.rows[0] / BAND..=piece.rows[1] / BAND] {
                band.push(at as u32);
            }
        }
        let mut pixels = vec![None; raster.len()];
        pixels.par_chunks_mut(BAND * width).zip(&bands).enumerate().for_each(|(band, (pixels, found))| {
            let (first, count) = (band * BAND, pixels.len() / width);
            for piece in found.iter().map(|&at| &pieces[at as usize]) {
                for row in piece.rows[0].max(first)..=piece.rows[1].min(first + count - 1) {
                    for column in piece.columns[0]..=piece.columns[1] {
                        let pixel = &mut pixels[(row - first) * width + column];
                        if pixel.is_none() {
                            *pixel = piece.rest(column, row);
                        }
                    }
                }
            }
        });
        pixels
    }

    /// Adds the tetrahedra of the cell above this grid point that meet the plane.
    fn cell(&self, raster: &Raster, point: usize, deformed: bool, pieces: &mut Vec<Piece>) {
        let lattice = self.lattice;
        let shape = lattice.grid.shape;
        let [i, j, k] = shape.ijk(point);
        if i + 1 >= shape.nx || j + 1 >= shape.ny || k + 1 >= shape.nz || !self.has_tissue(point) {
            return;
        }
        let points: [usize; CORNERS] =
            std::array::from_fn(|c| shape.linear([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)]));
        let particle = points.map(|point| lattice.particle_at[point]);
        if particle.iter().all(|&p| p == NO_PARTICLE) {
            return;
        }
        let cell = Cell { particle, rest: points.map(|point| lattice.grid.place(point)) };
        let axis = raster.plane.axis.index();
        // Corners without a particle are put at most four pitches from one, the largest stretch of a gradient.
        let missing = particle.contains(&NO_PARTICLE) || deformed;
        let reach = if missing { 4.0 * 3.0_f64.sqrt() * lattice.pitch * 1e3 } else { 0.0 };
        let height = (0..CORNERS)
            .filter(|&c| particle[c] != NO_PARTICLE)
            .map(|c| self.place(&cell, c, deformed)[axis] - raster.plane.at_mm);
        let (low, high) = height.fold((f64::MAX, f64::MIN), |(low, high), h| (low.min(h), high.max(h)));
        if low > reach || high < -reach {
            return;
        }
        for tetrahedron in TETRAHEDRA {
            let parted = |a: usize, b: usize| deformed && self.is_severed(&cell, tetrahedron[a], tetrahedron[b]);
            let whole = tetrahedron.iter().all(|&c| particle[c] != NO_PARTICLE)
                && (0..4).all(|a| (a + 1..4).all(|b| !parted(a, b)));
            let rest = tetrahedron.map(|c| cell.rest[c]);
            if whole {
                let place = tetrahedron.map(|c| self.place(&cell, c, deformed));
                pieces.extend(Piece::new(raster, place, rest, [false; 4]));
                continue;
            }
            for group in self.groups(&cell, tetrahedron, parted).into_iter().filter(|&group| group != 0) {
                let place = |corner: usize| self.place_with(&cell, tetrahedron, group, corner, deformed, parted);
                if let [Some(a), Some(b), Some(c), Some(d)] = [place(0), place(1), place(2), place(3)] {
                    let beyond = [0, 1, 2, 3].map(|corner| group >> corner & 1 == 0);
                    pieces.extend(Piece::new(raster, [a, b, c, d], rest, beyond));
                }
            }
        }
    }

    /// Whether the cell above a grid point may hold tissue: in a lattice of cells, when it is one.
    fn has_tissue(&self, point: usize) -> bool {
        let lattice = self.lattice;
        !lattice.has_cells()
            || match lattice.particle_at[point] {
                NO_PARTICLE => false,
                particle => lattice.cell_organ[particle as usize] != NO_ORGAN,
            }
    }

    /// Place of a corner that holds a particle, RAS+ [mm].
    fn place(&self, cell: &Cell, corner: usize, deformed: bool) -> Point3 {
        if !deformed {
            return cell.rest[corner];
        }
        cell.rest[corner] + Vector3::from(self.displacements[cell.particle[corner] as usize].map(f64::from))
    }

    /// The groups of tissue corners of a tetrahedron that hold together, one bit per corner; 0 where there is none.
    fn groups(&self, cell: &Cell, tetrahedron: [usize; 4], parted: impl Fn(usize, usize) -> bool) -> [u8; 4] {
        let tissue = |corner: usize| cell.particle[tetrahedron[corner]] != NO_PARTICLE;
        // Group of each corner: the lowest corner it is joined to, over one or more others.
        let mut group = [0, 1, 2, 3];
        for _ in 0..3 {
            for a in 0..4 {
                for b in 0..4 {
                    if a != b && tissue(a) && tissue(b) && !parted(a, b) {
                        group[b] = group[b].min(group[a]);
                    }
                }
            }
        }
        [0, 1, 2, 3]
            .map(|first| (0..4).filter(|&c| tissue(c) && group[c] == first).fold(0, |bits, corner| bits | 1 << corner))
    }

    /// Where a group carries a corner of its tetrahedron: to its particle if the two hold together, else by the
    /// deformation around the group.
    fn place_with(
        &self,
        cell: &Cell,
        tetrahedron: [usize; 4],
        group: u8,
        corner: usize,
        deformed: bool,
        parted: impl Fn(usize, usize) -> bool,
    ) -> Option<Point3> {
        let at = tetrahedron[corner];
        if !deformed {
            return Some(cell.rest[at]);
        }
        let members = || (0..4).filter(move |&member| group >> member & 1 == 1);
        let own = group >> corner & 1 == 1;
        let joined = || cell.particle[at] != NO_PARTICLE && members().any(|member| !parted(member, corner));
        if own || joined() {
            return Some(self.place(cell, at, true));
        }
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for member in members() {
            let from = tetrahedron[member];
            let particle = cell.particle[from] as usize;
            let gradient = self.gradients.get(self.gradient_at[particle] as usize)?;
            sum += Vector3::from(self.displacements[particle].map(f64::from));
            for (axis, along) in gradient.iter().enumerate() {
                let step = (at >> axis & 1) as f64 - (from >> axis & 1) as f64;
                sum += step * Vector3::from(along.map(f64::from));
            }
            count += 1.0;
        }
        Some(cell.rest[at] + sum / count)
    }

    /// True when a blade went through the spring between two corners.
    fn is_severed(&self, cell: &Cell, from: usize, to: usize) -> bool {
        let [near, far] = [from, to].map(|corner| cell.particle[corner]);
        if near == NO_PARTICLE || far == NO_PARTICLE {
            return false;
        }
        let bit = |corner: usize, axis: usize| (corner >> axis & 1) as i32;
        let direction = direction_of([0, 1, 2].map(|axis| bit(to, axis) - bit(from, axis)));
        // A pair without a spring at rest (two rigid particles, say) was never cut.
        let gone = self.lattice.springs[near as usize] & !self.topology.alive()[near as usize];
        gone & (1 << direction) != 0
    }
}

impl Piece {
    fn new(raster: &Raster, place: [Point3; 4], rest: [Point3; 4], beyond: [bool; 4]) -> Option<Self> {
        let axis: SliceAxis = raster.plane.axis;
        let height = place.map(|p| p[axis.index()] - raster.plane.at_mm);
        // The box of the section: corners in the plane and crossings of edges.
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut include = |point: Point3| {
            for (part, at) in raster.pixel_of(point).into_iter().enumerate() {
                low[part] = low[part].min(at);
                high[part] = high[part].max(at);
            }
        };
        for a in 0..4 {
            for b in a + 1..4 {
                if (height[a] <= 0.0 && height[b] >= 0.0) || (height[a] >= 0.0 && height[b] <= 0.0) {
                    let share = if height[a] == height[b] { 0.0 } else { height[a] / (height[a] - height[b]) };
                    include(place[a] + share * (place[b] - place[a]));
                    if height[a] == height[b] {
                        include(place[b]);
                    }
                }
            }
        }
        let range = |part: usize, count: u32| {
            // A hair more than the box, for pixels on its border.
            let (low, high) =
                ((low[part] - 1e-6).ceil().max(0.0), (high[part] + 1e-6).floor().min(f64::from(count) - 1.0));
            (low <= high).then_some([low as usize, high as usize])
        };
        let (columns, rows) = (range(0, raster.width)?, range(1, raster.height)?);
        let edges = |corners: &[Point3; 4]| {
            Matrix3::from_columns(&[corners[1] - corners[0], corners[2] - corners[0], corners[3] - corners[0]])
        };
        // A tetrahedron pressed flat has no inside.
        let inverse = edges(&place).try_inverse()?;
        let inside = [inverse * (raster.first - place[0]), inverse * raster.column, inverse * raster.row];
        let back = edges(&rest);
        let [constant, column, row] = inside.map(|barycentric| back * barycentric);
        let rest = [rest[0].coords + constant, column, row];
        inside.iter().all(|v| v.iter().all(|x| x.is_finite())).then_some(Self { inside, rest, beyond, columns, rows })
    }

    fn rest(&self, column: usize, row: usize) -> Option<Point3> {
        let at = |[constant, per_column, per_row]: &[Vector3; 3]| {
            constant + per_column * column as f64 + per_row * row as f64
        };
        let [b, c, d]: [f64; 3] = at(&self.inside).into();
        let shares = [1.0 - b - c - d, b, c, d];
        // Tissue reaches half-way to a corner beyond; the share is continuous across tetrahedra, so the border is too.
        let tissue: f64 = (0..4).filter(|&corner| !self.beyond[corner]).map(|corner| shares[corner]).sum();
        let inside = shares.iter().all(|&share| share >= -SLACK) && tissue >= 0.5;
        inside.then(|| Point3::from(at(&self.rest)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tetrahedra_fill_the_cell_and_follow_springs() {
        let corner = |c: usize| Vector3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64);
        let volume = |[a, b, c, d]: [usize; 4]| {
            Matrix3::from_columns(&[corner(b) - corner(a), corner(c) - corner(a), corner(d) - corner(a)]).determinant()
                / 6.0
        };
        assert!(TETRAHEDRA.iter().all(|&t| (volume(t).abs() - 1.0 / 6.0).abs() < 1e-15));
        let signs: f64 = TETRAHEDRA.iter().map(|&t| volume(t)).sum();
        assert!((signs.abs() - 1.0).abs() < 1e-15, "all six turn the same way");
    }
}
