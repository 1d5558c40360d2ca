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
//! Where closed surfaces of the organs are given, they decide what is tissue, and the pieces only say which: see
//! [`InverseMap::carried_within`].
//!
//! Where tissue overlaps itself (two lips pushed into each other), whole tetrahedra come before parted ones, then the cell with
//! the lower number.

use std::borrow::Cow;
use std::collections::VecDeque;

use rayon::prelude::*;

use super::{Raster, Section};
use crate::geometry::{Matrix3, Point3, Vector3};
use crate::lattice::build::NO_ORGAN;
use crate::lattice::neighbours::{ALL_ALIVE, direction_of};
use crate::lattice::{Lattice, NO_PARTICLE, Topology};
use crate::surface::gradient::{AxisDisplacements, Gradients};
use crate::surface::hinged::Hinged;

/// Offsets of a cell's corners, x fastest: corner `c` is at bits 0, 1 and 2 of `c`.
const CORNERS: usize = 8;
/// The six tetrahedra from corner 0 to corner 7, one per order of the three axes.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];
/// Rows of pixels that one task paints.
const BAND: usize = 16;
/// Cells that one task looks through.
const CHUNK: usize = 1 << 14;
/// As much tissue as a whole tetrahedron has, but for rounding.
const WHOLE: f64 = 1.0 - 1e-6;
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
    values: Vec<f32>,
}

impl CarriedRaster {
    /// Asks a map for each pixel of a slice.
    pub fn from_fn(raster: &Raster, map: impl Fn(Point3) -> Carried + Sync) -> Self {
        let width = raster.width as usize;
        let pixel = |at: usize| map(raster.place((at % width) as u32, (at / width) as u32));
        Self { pixels: (0..raster.len()).into_par_iter().map(pixel).collect(), values: Vec::new() }
    }

    /// The pixels, row by row from the upper left. Shape `[height, width]`.
    pub fn pixels(&self) -> &[Carried] {
        &self.pixels
    }

    /// Values of the particles under the pixels, see [`InverseMap::with_values`]; NaN where there is no tissue. Shape
    /// `[height, width]`, or empty without values.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

/// The inverse of a deformation of the lattice.
pub struct InverseMap<'a> {
    lattice: &'a Lattice,
    topology: &'a Topology,
    displacements: Cow<'a, [[f32; 3]]>,
    /// Deformation around each particle that lost a spring or never had all; index by [`InverseMap::gradient_at`].
    gradients: Vec<AxisDisplacements>,
    /// Index among the gradients of each particle, or `u32::MAX`.
    gradient_at: Vec<u32>,
    /// A value per particle to carry along, or empty.
    values: &'a [f32],
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
    /// Carried value: the same form.
    value: Vector3,
    /// Corners without tissue of this piece.
    beyond: [bool; 4],
    columns: [usize; 2],
    rows: [usize; 2],
}

/// The tissue of a pixel.
#[derive(Debug, Clone, Copy)]
struct Hit {
    /// How much of it is tissue by the corners of its tetrahedron that hold together, up to 1.
    tissue: f64,
    rest: Point3,
    value: f32,
}

/// A tetrahedron to paint.
struct Corners {
    /// Places now, RAS+ [mm].
    place: [Point3; 4],
    /// Rest places, RAS+ [mm].
    rest: [Point3; 4],
    value: [f64; 4],
    beyond: [bool; 4],
}

/// Tissue ends half-way between a corner that holds it and one that does not.
const HALF_WAY: f64 = 0.5;

impl<'a> InverseMap<'a> {
    /// The map of a state: displacements from rest of each particle, RAS+ [mm], shape `[particles]`.
    ///
    /// # Panics
    /// If there is not one displacement per particle.
    pub fn new(lattice: &'a Lattice, topology: &'a Topology, displacements: &'a [[f32; 3]]) -> Self {
        assert_eq!(displacements.len(), lattice.len(), "one displacement per particle");
        let mut gradient_at = vec![u32::MAX; lattice.len()];
        let mut gradients = Vec::new();
        let mut drawn = Cow::Borrowed(displacements);
        // No deformation can be told from places that are no numbers.
        if displacements.par_iter().all(|u| u.iter().all(|x| x.is_finite())) {
            let border: Vec<u32> = (0..lattice.len() as u32)
                .filter(|&p| {
                    // Cells end where their corners are; particles on their own reach half-way to where others would be.
                    let whole = if lattice.has_cells() { lattice.springs[p as usize] } else { ALL_ALIVE };
                    topology.alive()[p as usize] != whole
                })
                .collect();
            drawn = Hinged::find(lattice, topology).steadied(lattice, displacements);
            let (found, index) = Gradients::new(lattice, topology.alive(), &border);
            gradients = found.evaluate(lattice, &drawn);
            border.iter().zip(index).for_each(|(&particle, at)| gradient_at[particle as usize] = at);
        }
        Self { lattice, topology, displacements: drawn, gradients, gradient_at, values: &[] }
    }

    /// Carries a value of each particle along, linear in every tetrahedron and apart on both sides of a cut. Shape `[particles]`.
    ///
    /// # Panics
    /// If there is not one value per particle.
    #[must_use]
    pub fn with_values(self, values: &'a [f32]) -> Self {
        assert_eq!(values.len(), self.lattice.len(), "one value per particle");
        Self { values, ..self }
    }

    /// Rest places under the pixels of a slice: O(cells + pixels), the same at any number of threads.
    pub fn carried(&self, raster: &Raster) -> CarriedRaster {
        let now = self.paint(raster, true, HALF_WAY);
        let then = self.paint(raster, false, HALF_WAY);
        let state = |(now, then): (&Option<Hit>, Option<Hit>)| match (now, then) {
            (Some(hit), _) => Carried::From(hit.rest),
            (None, Some(_)) => Carried::Left,
            (None, None) => Carried::Elsewhere,
        };
        CarriedRaster { pixels: now.par_iter().zip(then).map(state).collect(), values: self.values_of(&now) }
    }

    /// Rest places under the pixels of a slice whose tissue is what closed surfaces hold, now and at rest: cuts open and organs
    /// end exactly where the surfaces do.
    ///
    /// Where a surface reaches beyond all tetrahedra (by less than a pitch: it is smooth, and lips lie where the blade
    /// went) the nearest pixel inside is carried on without strain. O(cells + pixels), the same at any number of threads.
    ///
    /// # Panics
    /// If the sections were made for other rasters.
    pub fn carried_within(&self, raster: &Raster, now: &Section, then: &Section) -> CarriedRaster {
        assert!([now, then].iter().all(|section| section.len() == raster.len()), "sections of the same raster");
        let mut hits = self.paint(raster, true, 0.0);
        hits.par_iter_mut().enumerate().for_each(|(pixel, hit)| {
            if now.organ(pixel).is_none() {
                *hit = None;
            }
        });
        carry_on(&mut hits, raster, now);
        let state = |(pixel, hit): (usize, &Option<Hit>)| match (hit, now.organ(pixel).or(then.organ(pixel))) {
            (Some(hit), _) => Carried::From(hit.rest),
            (None, Some(_)) => Carried::Left,
            (None, None) => Carried::Elsewhere,
        };
        CarriedRaster { pixels: hits.par_iter().enumerate().map(state).collect(), values: self.values_of(&hits) }
    }

    fn values_of(&self, hits: &[Option<Hit>]) -> Vec<f32> {
        if self.values.is_empty() {
            return Vec::new();
        }
        hits.iter().map(|hit| hit.map_or(f32::NAN, |hit| hit.value)).collect()
    }

    /// The piece with most tissue at each pixel, where that is at least `least`.
    fn paint(&self, raster: &Raster, deformed: bool, least: f64) -> Vec<Option<Hit>> {
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
                        if pixel.is_none_or(|hit: Hit| hit.tissue < WHOLE)
                            && let Some(hit) = piece.hit(column, row, least)
                            && pixel.is_none_or(|best| hit.tissue > best.tissue)
                        {
                            *pixel = Some(hit);
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
        // Corners without a particle are put at most four pitches from one, the largest stretch of a gradient.
        let missing = particle.contains(&NO_PARTICLE) || deformed;
        let reach = if missing { 4.0 * 3.0_f64.sqrt() * lattice.pitch * 1e3 } else { 0.0 };
        let height = (0..CORNERS)
            .filter(|&c| particle[c] != NO_PARTICLE)
            .map(|c| raster.plane.height(self.place(&cell, c, deformed)));
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
                let value = tetrahedron.map(|c| self.value(&cell, c));
                pieces.extend(Piece::new(raster, Corners { place, rest, value, beyond: [false; 4] }));
                continue;
            }
            for group in self.groups(&cell, tetrahedron, parted).into_iter().filter(|&group| group != 0) {
                let place = |corner: usize| self.place_with(&cell, tetrahedron, group, corner, deformed, parted);
                if let [Some(a), Some(b), Some(c), Some(d)] = [place(0), place(1), place(2), place(3)] {
                    let beyond = [0, 1, 2, 3].map(|corner| group >> corner & 1 == 0);
                    let value = self.values_with(&cell, tetrahedron, beyond);
                    pieces.extend(Piece::new(raster, Corners { place: [a, b, c, d], rest, value, beyond }));
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

    /// Carried value of a corner that holds a particle.
    fn value(&self, cell: &Cell, corner: usize) -> f64 {
        self.values.get(cell.particle[corner] as usize).map_or(0.0, |&value| f64::from(value))
    }

    /// Carried values of a group's corners, and their mean at the corners beyond.
    fn values_with(&self, cell: &Cell, tetrahedron: [usize; 4], beyond: [bool; 4]) -> [f64; 4] {
        let own = || (0..4).filter(|&corner| !beyond[corner]).map(|corner| self.value(cell, tetrahedron[corner]));
        let mean = own().sum::<f64>() / own().count() as f64;
        [0, 1, 2, 3].map(|corner| if beyond[corner] { mean } else { self.value(cell, tetrahedron[corner]) })
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
    fn new(raster: &Raster, Corners { place, rest, value, beyond }: Corners) -> Option<Self> {
        let height = place.map(|p| raster.plane.height(p));
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
        let steps = Vector3::new(value[1], value[2], value[3]) - Vector3::repeat(value[0]);
        let along = inside.map(|barycentric| steps.dot(&barycentric));
        let value = Vector3::new(value[0] + along[0], along[1], along[2]);
        let rest = [rest[0].coords + constant, column, row];
        inside.iter().all(|v| v.iter().all(|x| x.is_finite())).then_some(Self {
            inside,
            rest,
            value,
            beyond,
            columns,
            rows,
        })
    }

    fn hit(&self, column: usize, row: usize, least: f64) -> Option<Hit> {
        let (column, row) = (column as f64, row as f64);
        let at = |[constant, per_column, per_row]: &[Vector3; 3]| constant + per_column * column + per_row * row;
        let [b, c, d]: [f64; 3] = at(&self.inside).into();
        let shares = [1.0 - b - c - d, b, c, d];
        // The share of tissue is continuous across tetrahedra, so the border is too.
        let tissue: f64 = (0..4).filter(|&corner| !self.beyond[corner]).map(|corner| shares[corner]).sum();
        let inside = shares.iter().all(|&share| share >= -SLACK) && tissue >= least;
        let value = || (self.value[0] + self.value[1] * column + self.value[2] * row) as f32;
        inside.then(|| Hit { tissue, rest: Point3::from(at(&self.rest)), value: value() })
    }
}

/// Gives the pixels of a section that have no tissue that of the nearest one in the same organ, by steps to the four pixels
/// around, moved on by as much as lies between them.
fn carry_on(hits: &mut [Option<Hit>], raster: &Raster, section: &Section) {
    let (width, height) = (raster.width as usize, raster.height as usize);
    let around = |pixel: usize| {
        let (column, row) = (pixel % width, pixel / width);
        [
            (column > 0).then(|| (pixel - 1, -raster.column)),
            (column + 1 < width).then(|| (pixel + 1, raster.column)),
            (row > 0).then(|| (pixel - width, -raster.row)),
            (row + 1 < height).then(|| (pixel + width, raster.row)),
        ]
    };
    let bare = |hits: &[Option<Hit>], pixel: usize| hits[pixel].is_none() && section.organ(pixel).is_some();
    let known = |hits: &[Option<Hit>], pixel: usize| hits[pixel].is_some();
    let at_border =
        |pixel: &usize| known(hits, *pixel) && around(*pixel).into_iter().flatten().any(|(other, _)| bare(hits, other));
    let mut queue: VecDeque<usize> = (0..hits.len()).filter(at_border).collect();
    while let Some(pixel) = queue.pop_front() {
        let Some(hit) = hits[pixel] else { continue };
        for (other, step) in around(pixel).into_iter().flatten() {
            if hits[other].is_none() && section.organ(other).is_some() && section.organ(other) == section.organ(pixel) {
                hits[other] = Some(Hit { rest: hit.rest + step, ..hit });
                queue.push_back(other);
            }
        }
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
