//! Where blades went, in the rest shape of the tissue: what a surface finer than the lattice is opened by.
//!
//! ```text
//! every test of a blade    its edge where the test begins, between, and where it ends
//! every point of the edge  the cell of the deformed lattice that holds it, and its place in that cell
//! two edges in turn        quads between them, at rest
//! ```
//! Severed springs tell at the lattice's resolution what a blade parted; the sheet tells where it passed in between. It is
//! recorded where the blade meets tissue, and up to one cell beyond, so that it reaches through the skin; and only where
//! springs are severed about the same time, so that a blade that goes through an open cut again leaves nothing there.
//!
//! Not guaranteed: that every severed spring passes through the sheet. Where tissue is stretched over more than a few
//! pitches the sheet is left open; a surface must follow the springs first and the sheet second.

use std::collections::{HashMap, VecDeque};

use rayon::prelude::*;

use super::blade::{Piece, Sweep};
use super::crossing::{Bounds, Crossing, block_bounds};
use crate::geometry::{Matrix3, Point3, Vector3};
use crate::lattice::build::corners;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::{Lattice, NO_PARTICLE, neighbours};

/// Distance of the points along an edge, and of edges along a stroke [pitches]: cells are deformed little over half their
/// width.
const STEP: f64 = 0.5;
/// Edges nearer to each other than this at rest are one [pitches].
const SAME: f64 = 0.02;
/// A quad wider than this at rest joins places that do not belong together [pitches].
const WIDEST: f64 = 2.5;
/// How far beyond a cell a point still takes its place from it [cells].
const REACH: f64 = 1.0;
/// No place at rest.
const NOWHERE: u32 = u32::MAX;
/// A quad belongs to a cut when a spring within one cell of it is severed at most so many tests before or after: blades are
/// tested every eighth of a pitch, and springs reach over one.
const NEAR_TESTS: u64 = 32;
/// An edge is looked at this often within one test at most.
const MOST_EDGES: f64 = 4096.0;

/// The surface that blades have swept through the tissue, as it lies at rest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CutSheet {
    /// Corners of the quads at rest, RAS+ [mm]. Shape `[vertices, 3]`.
    pub vertices: Vec<[f32; 3]>,
    /// Corners of each quad, in order round it. Shape `[quads, 4]`.
    pub quads: Vec<[u32; 4]>,
    /// When the blade had passed each quad [s], ascending. Shape `[quads]`.
    pub times: Vec<f64>,
}

/// A sheet under way: with the edges at which it goes on.
#[derive(Debug, Clone, Default)]
pub(crate) struct SheetRecorder {
    sheet: CutSheet,
    open: Vec<Edge>,
    /// Number of the present test.
    test: u64,
    /// Quads no spring near was severed for yet: test, cell, corners.
    pending: VecDeque<(u64, [i64; 3], [u32; 4])>,
    /// Last test in which a spring was severed in each cell.
    severed: HashMap<[i64; 3], u64>,
}

/// Points of an edge with their vertices in the sheet.
#[derive(Debug, Clone)]
struct Edge {
    origin: Point3,
    side: Vector3,
    vertices: Vec<u32>,
}

/// Where the tissue is during a test: displacements x, y, z [m] at its beginning and end, block order, lattice axes.
#[derive(Clone, Copy)]
pub(crate) struct Tissue<'a> {
    pub(crate) lattice: &'a Lattice,
    pub(crate) layout: &'a BlockLayout,
    pub(crate) before: &'a [Vec<f32>; 3],
    pub(crate) now: &'a [Vec<f32>; 3],
}

impl SheetRecorder {
    pub(crate) fn sheet(&self) -> &CutSheet {
        &self.sheet
    }

    /// Goes on by one test of a blade, which ends at `time` [s] and finds these springs.
    pub(crate) fn record(&mut self, tissue: &Tissue<'_>, sweep: &Sweep, found: &[Crossing], time: f64) {
        self.test += 1;
        for crossing in found {
            let low = tissue.lattice.ijk(crossing.particle).map(|i| i as f64);
            let offset = neighbours::OFFSETS[usize::from(crossing.direction)].map(f64::from);
            let place = Vector3::from(low) + Vector3::from(offset) * f64::from(crossing.at);
            self.severed.insert(cell_of(place), self.test);
        }
        for piece in &sweep.pieces {
            self.record_piece(tissue, piece);
        }
        self.confirm(time);
    }

    /// Takes the pending quads that springs were severed for into the sheet, and gives up those that have waited long.
    fn confirm(&mut self, time: f64) {
        let near = |cell: [i64; 3], test: u64| {
            (0..27).any(|step| {
                let around = [0, 1, 2].map(|axis| cell[axis] + step / [1, 3, 9][axis] % 3 - 1);
                self.severed.get(&around).is_some_and(|&severed| severed.abs_diff(test) <= NEAR_TESTS)
            })
        };
        let (mut quads, mut waiting) = (Vec::new(), VecDeque::new());
        for (test, cell, quad) in self.pending.drain(..) {
            if near(cell, test) {
                quads.push(quad);
            } else if self.test - test < NEAR_TESTS {
                waiting.push_back((test, cell, quad));
            }
        }
        self.sheet.times.extend(quads.iter().map(|_| time));
        self.sheet.quads.append(&mut quads);
        self.pending = waiting;
    }

    fn record_piece(&mut self, tissue: &Tissue<'_>, piece: &Piece) {
        let pitch = tissue.lattice.pitch;
        let points = (piece.side.norm() / (STEP * pitch)).ceil().clamp(1.0, MOST_EDGES) as usize + 1;
        let cells = Cells::near(tissue, piece);
        let way = piece.stroke.norm() + cells.longest_move * (piece.during[1] - piece.during[0]);
        let edges = (way / (STEP * pitch)).ceil().clamp(1.0, MOST_EDGES) as usize;
        if cells.list.is_empty() {
            return;
        }
        let places = |edge: usize| -> Vec<Option<Vector3>> {
            let share = edge as f64 / edges as f64;
            let moved = cells.at(piece.during[0] + share * (piece.during[1] - piece.during[0]));
            let origin = piece.origin.coords + share * piece.stroke;
            let point = |n: usize| origin + piece.side * (n as f64 / (points - 1) as f64);
            (0..points).into_par_iter().map(|n| moved.rest_of(point(n))).collect()
        };
        let mut last = self.begin(tissue.lattice, piece, places(0));
        for edge in 1..=edges {
            let places = places(edge);
            if self.stays(tissue.lattice, &last, &places) {
                continue;
            }
            let vertices = self.add(tissue.lattice, &places);
            self.join(tissue.lattice, &last, &vertices);
            last = vertices;
        }
        self.open.push(Edge { origin: piece.origin + piece.stroke, side: piece.side, vertices: last });
    }

    /// Vertices of the edge a piece sets out from: those where the sheet ended, when they are there.
    fn begin(&mut self, lattice: &Lattice, piece: &Piece, places: Vec<Option<Vector3>>) -> Vec<u32> {
        let near = 1e-6 * lattice.pitch;
        let same = |edge: &Edge| {
            (edge.origin - piece.origin).norm() < near
                && (edge.side - piece.side).norm() < near
                && edge.vertices.len() == places.len()
        };
        if let Some(at) = self.open.iter().position(same) {
            let edge = self.open.remove(at);
            if self.stays(lattice, &edge.vertices, &places) {
                return edge.vertices;
            }
        }
        self.add(lattice, &places)
    }

    /// Whether an edge is where its vertices are already.
    fn stays(&self, lattice: &Lattice, vertices: &[u32], places: &[Option<Vector3>]) -> bool {
        vertices.iter().zip(places).all(|(&vertex, place)| match (vertex, place) {
            (NOWHERE, None) => true,
            (NOWHERE, Some(_)) | (_, None) => false,
            (vertex, Some(place)) => (self.index_of(lattice, vertex) - place).norm() < SAME,
        })
    }

    fn index_of(&self, lattice: &Lattice, vertex: u32) -> Vector3 {
        let place = self.sheet.vertices[vertex as usize].map(f64::from);
        lattice.grid.affine.index_of(Point3::from(place)).coords
    }

    fn add(&mut self, lattice: &Lattice, places: &[Option<Vector3>]) -> Vec<u32> {
        let vertices = &mut self.sheet.vertices;
        let mut add = |place: &Vector3| {
            let place: [f64; 3] = lattice.grid.affine.apply(Point3::from(*place)).into();
            vertices.push(place.map(|c| c as f32));
            vertices.len() as u32 - 1
        };
        places.iter().map(|place| place.as_ref().map_or(NOWHERE, &mut add)).collect()
    }

    /// Quads between two edges.
    fn join(&mut self, lattice: &Lattice, before: &[u32], after: &[u32]) {
        for (before, after) in before.windows(2).zip(after.windows(2)) {
            let quad = [before[0], before[1], after[1], after[0]];
            if quad.contains(&NOWHERE) {
                continue;
            }
            let places = quad.map(|vertex| self.index_of(lattice, vertex));
            if [[0, 2], [1, 3], [0, 3], [1, 2]].iter().all(|&[a, b]| (places[a] - places[b]).norm() < WIDEST) {
                let middle = places.iter().sum::<Vector3>() / 4.0;
                self.pending.push_back((self.test, cell_of(middle), quad));
            }
        }
    }
}

fn cell_of(index: Vector3) -> [i64; 3] {
    [0, 1, 2].map(|axis| index[axis].floor() as i64)
}

/// The cells a piece of a sweep may meet.
struct Cells<'a> {
    tissue: &'a Tissue<'a>,
    /// Lowest corner (i, j, k) and the particles of the corners, x fastest.
    list: Vec<([usize; 3], [u32; 8])>,
    /// Largest distance that one of their corners moves during the whole test [m].
    longest_move: f64,
}

impl<'a> Cells<'a> {
    fn near(tissue: &'a Tissue<'a>, piece: &Piece) -> Self {
        let Tissue { lattice, layout, .. } = *tissue;
        let reach = Bounds::of(piece, 2.0 * lattice.pitch);
        let list: Vec<_> = (0..layout.blocks.len())
            .into_par_iter()
            .flat_map_iter(|block| {
                let at = |moment| block_bounds(lattice, layout, moment, block);
                let near = reach.meets(&at(tissue.before).joined(at(tissue.now)));
                let slots = if near { block * BLOCK_LEN..(block + 1) * BLOCK_LEN } else { 0..0 };
                slots.filter_map(move |slot| {
                    let low = layout.particle_of_slot(lattice, slot)?;
                    let ijk = lattice.ijk(low);
                    let dims = lattice.grid.shape.dims();
                    if (0..3).any(|axis| ijk[axis] + 1 >= dims[axis]) {
                        return None;
                    }
                    let corners = corners(lattice.grid.shape, lattice.points[low as usize] as usize)
                        .map(|point| lattice.particle_at[point]);
                    (!corners.contains(&NO_PARTICLE)).then_some((ijk, corners))
                })
            })
            .collect();
        let cells = Self { tissue, list, longest_move: 0.0 };
        let meets = |&(ijk, corners): &([usize; 3], [u32; 8])| {
            let mut bounds = Bounds::EMPTY;
            for share in [0.0, 1.0] {
                cells.corner_places(ijk, corners, share).into_iter().for_each(|place| bounds.include(place));
            }
            reach.meets(&bounds)
        };
        let list: Vec<_> = cells.list.par_iter().copied().filter(meets).collect();
        let moved = |&particle: &u32| (cells.displacement(particle, 1.0) - cells.displacement(particle, 0.0)).norm();
        let longest_move = list.iter().flat_map(|(_, corners)| corners).map(moved).fold(0.0, f64::max);
        Self { list, longest_move, ..cells }
    }

    /// Displacement of a particle at a share of the test [m].
    fn displacement(&self, particle: u32, share: f64) -> Vector3 {
        let slot = self.tissue.layout.slot[particle as usize] as usize;
        let [before, now] = [self.tissue.before, self.tissue.now]
            .map(|moment| Vector3::from([0, 1, 2].map(|axis| f64::from(moment[axis][slot]))));
        before + (now - before) * share
    }

    fn corner_places(&self, ijk: [usize; 3], corners: [u32; 8], share: f64) -> [Vector3; 8] {
        std::array::from_fn(|corner| {
            let index = [0, 1, 2].map(|axis| (ijk[axis] + (corner >> axis & 1)) as f64);
            Vector3::from(index) * self.tissue.lattice.pitch + self.displacement(corners[corner], share)
        })
    }

    /// The cells as they are at a share of the test.
    fn at(&self, share: f64) -> MovedCells {
        let cells = self.list.par_iter().map(|&(ijk, corners)| {
            let places = self.corner_places(ijk, corners, share);
            let mut bounds = Bounds::EMPTY;
            places.iter().for_each(|&place| bounds.include(place));
            MovedCell { low: Vector3::from(ijk.map(|i| i as f64)), places, bounds }
        });
        MovedCells { cells: cells.collect(), pitch: self.tissue.lattice.pitch }
    }
}

struct MovedCell {
    /// Index of the lowest corner.
    low: Vector3,
    /// Corners, x fastest [m].
    places: [Vector3; 8],
    bounds: Bounds,
}

struct MovedCells {
    cells: Vec<MovedCell>,
    pitch: f64,
}

impl MovedCells {
    /// Index at rest of what is at a place now [m]: from the first cell that holds it, else from the nearest within reach.
    fn rest_of(&self, place: Vector3) -> Option<Vector3> {
        let holds = |cell: &MovedCell, margin: f64| cell.bounds.holds(place, margin);
        let inside =
            self.cells.iter().filter(|cell| holds(cell, 0.0)).find_map(|cell| {
                cell.local(place).filter(|local| outside(local) <= 1e-9).map(|local| cell.low + local)
            });
        inside.or_else(|| {
            let near = self.cells.iter().filter(|cell| holds(cell, REACH * self.pitch));
            let found = near.filter_map(|cell| Some((cell, cell.local(place)?)));
            let (cell, local) = found.min_by(|(_, a), (_, b)| outside(a).total_cmp(&outside(b)))?;
            (outside(&local) <= REACH).then(|| cell.low + local)
        })
    }
}

/// How far local coordinates lie outside their cell.
fn outside(local: &Vector3) -> f64 {
    local.iter().map(|&x| (-x).max(x - 1.0)).fold(f64::MIN, f64::max)
}

impl MovedCell {
    /// Local coordinates of a place by Newton's method on the trilinear map; `None` where the cell is too deformed for it.
    fn local(&self, place: Vector3) -> Option<Vector3> {
        const STEPS: usize = 12;
        let size = (self.places[7] - self.places[0]).norm();
        let mut local = Vector3::repeat(0.5);
        for _ in 0..STEPS {
            let (value, gradient) = trilinear(&self.places, local);
            let error = place - value;
            if error.norm() <= 1e-9 * size {
                return Some(local);
            }
            local += gradient.try_inverse()? * error;
            // Beyond this the map is not the cell's any more.
            local = local.map(|x| x.clamp(-1.0 - REACH, 2.0 + REACH));
        }
        None
    }
}

/// Value and gradient of the trilinear map of eight corners, x fastest.
fn trilinear(corners: &[Vector3; 8], local: Vector3) -> (Vector3, Matrix3) {
    let (mut value, mut gradient) = (Vector3::zeros(), Matrix3::zeros());
    for (corner, place) in corners.iter().enumerate() {
        let up = [0, 1, 2].map(|axis| corner >> axis & 1 == 1);
        let weight = [0, 1, 2].map(|axis| if up[axis] { local[axis] } else { 1.0 - local[axis] });
        let slope = up.map(|up| if up { 1.0 } else { -1.0 });
        value += place * (weight[0] * weight[1] * weight[2]);
        let row = Vector3::new(
            slope[0] * weight[1] * weight[2],
            weight[0] * slope[1] * weight[2],
            weight[0] * weight[1] * slope[2],
        );
        gradient += place * row.transpose();
    }
    (value, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deformed_cell_is_inverted() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.9, 2.0).into_inner();
        let shape = |x: Vector3| turn * (x + Vector3::new(0.1 * x.y * x.z, 0.3 * x.x, -0.2 * x.x * x.y));
        let places: [Vector3; 8] =
            std::array::from_fn(|corner| shape(Vector3::from([0, 1, 2].map(|axis| (corner >> axis & 1) as f64))));
        let mut bounds = Bounds::EMPTY;
        places.iter().for_each(|&place| bounds.include(place));
        let low = Vector3::new(3.0, 4.0, 5.0);
        let cells = MovedCells { cells: vec![MovedCell { low, places, bounds }], pitch: 1.0 };
        for local in [Vector3::new(0.1, 0.7, 0.4), Vector3::new(1.3, 0.2, -0.1)] {
            let (place, _) = trilinear(&places, local);
            let found = cells.rest_of(place).unwrap();
            assert!((found - low - local).norm() < 1e-8, "{found}");
        }
        assert_eq!(cells.rest_of(Vector3::repeat(9.0)), None);
    }
}
