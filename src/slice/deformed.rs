//! From places in the deformed body back to rest: so that a slice can show the CT carried by the tissue.
//!
//! Every lattice cell whose eight corners hold particles is split into six tetrahedra about one body diagonal (Kuhn 1960).
//! Their edges are all springs of the lattice, so a tetrahedron with a severed spring is one that a blade went through: it is
//! left out, and the cut opens as a gap one to two pitches wide at most. Inside a tetrahedron the map is linear, hence
//! exact for any affine deformation, and of second order in the pitch otherwise.
//!
//! Tissue ends half-way between its particles and the fringe.
//! Where tissue overlaps itself (two lips pushed into each other), the cell with the lower number is shown.

use rayon::prelude::*;

use super::{Raster, SliceAxis};
use crate::geometry::{Matrix3, Point3, Vector3};
use crate::lattice::{FRINGE, Lattice, NO_PARTICLE, Topology, neighbours};

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
}

/// A tetrahedron that meets the plane: affine maps of (column, row) to barycentric and rest coordinates, and its pixels.
struct Piece {
    /// Barycentric coordinates of corners 1 to 3: `[constant, per column, per row]`.
    inside: [Vector3; 3],
    /// Rest place: the same form, RAS+ [mm].
    rest: [Vector3; 3],
    /// Corners that only carry the border of their neighbours' cells.
    fringe: [bool; 4],
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
        Self { lattice, topology, displacements }
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
        let particles = self.lattice.len();
        let chunks: Vec<Vec<Piece>> = (0..particles.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut pieces = Vec::new();
                for particle in chunk * CHUNK..particles.min((chunk + 1) * CHUNK) {
                    self.cell(raster, particle as u32, deformed, &mut pieces);
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

    /// Adds the tetrahedra of the cell whose lowest corner is this particle that meet the plane.
    fn cell(&self, raster: &Raster, particle: u32, deformed: bool, pieces: &mut Vec<Piece>) {
        let lattice = self.lattice;
        let shape = lattice.grid.shape;
        let [i, j, k] = lattice.ijk(particle);
        if i + 1 >= shape.nx || j + 1 >= shape.ny || k + 1 >= shape.nz {
            return;
        }
        let mut corners = [0; CORNERS];
        for (corner, found) in corners.iter_mut().enumerate() {
            *found = lattice.particle_at[shape.linear([i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)])];
            if *found == NO_PARTICLE {
                return;
            }
        }
        let axis = raster.plane.axis.index();
        let rest = corners.map(|corner| lattice.rest_place(corner));
        let place: [Point3; CORNERS] = std::array::from_fn(|corner| {
            let displacement = self.displacements[corners[corner] as usize].map(f64::from);
            if deformed { rest[corner] + Vector3::from(displacement) } else { rest[corner] }
        });
        let height = place.map(|place| place[axis] - raster.plane.at_mm);
        if height.iter().all(|&h| h > 0.0) || height.iter().all(|&h| h < 0.0) {
            return;
        }
        for tetrahedron in TETRAHEDRA {
            if deformed && self.is_severed(&corners, tetrahedron) {
                continue;
            }
            let fringe = tetrahedron.map(|c| lattice.organ[corners[c] as usize] == FRINGE);
            if fringe != [true; 4] {
                pieces.extend(Piece::new(raster, tetrahedron.map(|c| place[c]), tetrahedron.map(|c| rest[c]), fringe));
            }
        }
    }

    fn is_severed(&self, corners: &[u32; CORNERS], tetrahedron: [usize; 4]) -> bool {
        (0..4).any(|a| {
            (a + 1..4).any(|b| {
                let bit = |corner: usize, axis: usize| (corner >> axis & 1) as i32;
                let (from, to) = (tetrahedron[a], tetrahedron[b]);
                let direction = neighbours::direction_of([0, 1, 2].map(|axis| bit(to, axis) - bit(from, axis)));
                let particle = corners[from] as usize;
                // A pair without a spring at rest (two rigid particles, say) was never cut.
                let gone = self.lattice.springs[particle] & !self.topology.alive()[particle];
                gone & (1 << direction) != 0
            })
        })
    }
}

impl Piece {
    fn new(raster: &Raster, place: [Point3; 4], rest: [Point3; 4], fringe: [bool; 4]) -> Option<Self> {
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
        inside.iter().all(|v| v.iter().all(|x| x.is_finite())).then_some(Self { inside, rest, fringe, columns, rows })
    }

    fn rest(&self, column: usize, row: usize) -> Option<Point3> {
        let at = |[constant, per_column, per_row]: &[Vector3; 3]| {
            constant + per_column * column as f64 + per_row * row as f64
        };
        let [b, c, d]: [f64; 3] = at(&self.inside).into();
        let shares = [1.0 - b - c - d, b, c, d];
        // Tissue reaches half-way to the fringe; the share is continuous across tetrahedra, so the border is too.
        let tissue: f64 = (0..4).filter(|&corner| !self.fringe[corner]).map(|corner| shares[corner]).sum();
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
