//! Where blades went, in the rest shape of the tissue: what a surface finer than the lattice is opened by.
//!
//! ```text
//! every test of a blade    its edge where the test begins, between, and where it ends
//! every point of the edge  the cell of the deformed lattice that holds it, and its place in that cell
//! two edges in turn        quads between them, at rest
//! ```
//! Severed springs tell at the lattice's resolution what a blade parted; the sheet tells where it passed in between. It is
//! recorded where the blade meets tissue, and up to two cells beyond, so that it reaches through the skin; and only where
//! springs are severed about the same time, so that a blade that goes through an open cut again leaves nothing there.
//!
//! Not guaranteed: that every severed spring passes through the sheet. Where tissue is stretched over more than a few
//! pitches the sheet is left open; a surface must follow the springs first and the sheet second.

use std::collections::{BTreeMap, VecDeque};

use rayon::prelude::*;

use super::blade::{Piece, Sweep};
use super::cells::{Cells, cell_of};
use super::crossing::Crossing;
use super::tissue::Tissue;
use crate::geometry::{CellMap, Point3, Vector3};
use crate::lattice::{Lattice, neighbours};

/// Distance of the points along an edge, and of edges along a stroke [pitches]: cells are deformed little over half their
/// width.
pub(super) const STEP: f64 = 0.5;
/// Edges nearer to each other than this at rest are one [pitches].
const SAME: f64 = 0.02;
/// A quad wider than this at rest joins places that do not belong together [pitches].
const WIDEST: f64 = 2.5;
/// A quad belongs to a cut when a spring within one cell of it is severed in the same test, or while the blade goes so far
/// [pitches]: springs reach over one, diagonals of cells over nearly two.
const NEAR: f64 = 4.0;
/// A piece that would need more points along its edge or its way through the tissue leaves no sheet.
const MOST_STEPS: i64 = 1 << 16;

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
    /// The present test.
    test: Test,
    /// Quads no spring near was severed for yet: test, cell, corners.
    pending: VecDeque<(Test, [i64; 3], [u32; 4])>,
    /// Last test in which a spring was severed in each cell.
    severed: CellMap<[i64; 3], Test>,
}

/// One test of a blade: the way of all blades through tissue before it and after it [pitches].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Test {
    number: u64,
    before: f64,
    after: f64,
}

impl Test {
    fn is_near(&self, other: &Self) -> bool {
        self.number == other.number || self.after.max(other.after) - self.before.min(other.before) <= NEAR
    }
}

/// Points of an edge, numbered from its beginning, that have a place at rest, by index coordinates of the lattice.
type Places = Vec<(i64, Vector3)>;
/// The same by their vertices in the sheet.
type Vertices = BTreeMap<i64, u32>;

/// An edge at the end of a test.
#[derive(Debug, Clone)]
struct Edge {
    origin: Point3,
    side: Vector3,
    vertices: Vertices,
}

impl SheetRecorder {
    pub(crate) fn sheet(&self) -> &CutSheet {
        &self.sheet
    }

    /// Goes on by one test of a blade, which ends at `time` [s] and finds these springs.
    pub(crate) fn record(&mut self, tissue: &Tissue<'_>, sweep: &Sweep, found: &[Crossing], time: f64) {
        let pieces: Vec<(Cells<'_>, &Piece)> =
            sweep.pieces.iter().map(|piece| (Cells::near(tissue, piece), piece)).collect();
        let way = |(cells, piece): &(Cells<'_>, &Piece)| cells.way(piece) / tissue.lattice.pitch;
        let Test { number, after, .. } = self.test;
        let longest = pieces.iter().map(way).fold(0.0, f64::max);
        self.test = Test { number: number + 1, before: after, after: after + longest };
        let mut severed_in: Option<[[i64; 3]; 2]> = None;
        for crossing in found {
            let low = tissue.lattice.ijk(crossing.particle).map(|i| i as f64);
            let offset = neighbours::OFFSETS[usize::from(crossing.direction)].map(f64::from);
            let place = Vector3::from(low) + Vector3::from(offset) * f64::from(crossing.at);
            let cell = cell_of(place);
            self.severed.insert(cell, self.test);
            let [low, high] = severed_in.get_or_insert([cell; 2]);
            for axis in 0..3 {
                low[axis] = low[axis].min(cell[axis]);
                high[axis] = high[axis].max(cell[axis]);
            }
        }
        for (cells, piece) in &pieces {
            self.record_piece(cells, piece);
        }
        self.confirm(time, severed_in);
    }

    /// Takes the pending quads that springs were severed for into the sheet, and gives up those that have waited long.
    ///
    /// - `severed_in`: box of the cells in which springs were severed in this test; for a quad that waited before, none was
    ///   severed near enough in any test but this one.
    fn confirm(&mut self, time: f64, severed_in: Option<[[i64; 3]; 2]>) {
        let Self { sheet, test: present, pending, severed, .. } = self;
        let near = |cell: [i64; 3], test: Test| {
            (0..27).any(|step| {
                let around = [0, 1, 2].map(|axis| cell[axis] + step / [1, 3, 9][axis] % 3 - 1);
                severed.get(&around).is_some_and(|severed| severed.is_near(&test))
            })
        };
        let beside_fresh = |cell: [i64; 3]| {
            severed_in.is_some_and(|[low, high]| (0..3).all(|d| low[d] - 1 <= cell[d] && cell[d] <= high[d] + 1))
        };
        pending.retain(|&(test, cell, quad)| {
            let confirmed = (test.number == present.number || beside_fresh(cell)) && near(cell, test);
            if confirmed {
                sheet.quads.push(quad);
                sheet.times.push(time);
            }
            !confirmed && present.is_near(&test)
        });
    }

    fn record_piece(&mut self, cells: &Cells<'_>, piece: &Piece) {
        let lattice = cells.lattice();
        let steps = |length: f64| (length / (STEP * lattice.pitch)).ceil().max(1.0);
        let (points, edges) = (steps(piece.side.norm()), steps(cells.way(piece)));
        let Some([along, across]) = cells.shares(piece) else { return };
        let range = |share: [f64; 2], steps: f64| [(share[0] * steps).floor() as i64, (share[1] * steps).ceil() as i64];
        let (along, across) = (range(along, points), range(across, edges));
        if [along, across].iter().any(|range| range[1] - range[0] > MOST_STEPS) {
            return;
        }
        let places = |edge: i64| -> Places {
            let share = edge as f64 / edges;
            let moment = piece.during[0] + share * (piece.during[1] - piece.during[0]);
            let origin = piece.origin.coords + share * piece.stroke;
            let place = |n: i64| Some((n, cells.rest_of(origin + piece.side * (n as f64 / points), moment)?));
            (along[0]..=along[1]).into_par_iter().filter_map(place).collect()
        };
        let first = places(across[0]);
        let mut last = if across[0] == 0 { self.begin(lattice, piece, &first) } else { self.add(lattice, &first) };
        for edge in across[0] + 1..=across[1] {
            let places = places(edge);
            if self.stays(lattice, &last, &places) {
                continue;
            }
            let vertices = self.add(lattice, &places);
            self.join(lattice, &last, &vertices);
            last = vertices;
        }
        if across[1] as f64 >= edges {
            self.open.push(Edge { origin: piece.origin + piece.stroke, side: piece.side, vertices: last });
        }
    }

    /// Vertices of the edge a piece sets out from: those where the sheet ended, when they are there.
    fn begin(&mut self, lattice: &Lattice, piece: &Piece, places: &Places) -> Vertices {
        let near = 1e-6 * lattice.pitch;
        let same = |edge: &Edge| (edge.origin - piece.origin).norm() < near && (edge.side - piece.side).norm() < near;
        if let Some(at) = self.open.iter().position(same) {
            let edge = self.open.remove(at);
            if self.stays(lattice, &edge.vertices, places) {
                return edge.vertices;
            }
        }
        self.add(lattice, places)
    }

    /// Whether an edge is where its vertices are already.
    fn stays(&self, lattice: &Lattice, vertices: &Vertices, places: &Places) -> bool {
        vertices.len() == places.len()
            && places.iter().all(|(n, place)| {
                let vertex = vertices.get(n);
                vertex.is_some_and(|&vertex| (self.index_of(lattice, vertex) - place).norm() < SAME)
            })
    }

    fn index_of(&self, lattice: &Lattice, vertex: u32) -> Vector3 {
        let place = self.sheet.vertices[vertex as usize].map(f64::from);
        lattice.grid.affine.index_of(Point3::from(place)).coords
    }

    fn add(&mut self, lattice: &Lattice, places: &Places) -> Vertices {
        let vertices = &mut self.sheet.vertices;
        let add = |(n, place): &(i64, Vector3)| {
            let place: [f64; 3] = lattice.grid.affine.apply(Point3::from(*place)).into();
            vertices.push(place.map(|c| c as f32));
            (*n, vertices.len() as u32 - 1)
        };
        places.iter().map(add).collect()
    }

    /// Quads between two edges.
    fn join(&mut self, lattice: &Lattice, before: &Vertices, after: &Vertices) {
        for (n, &first) in before {
            let next = n + 1;
            let (Some(&second), Some(&third), Some(&fourth)) = (before.get(&next), after.get(&next), after.get(n))
            else {
                continue;
            };
            let quad = [first, second, third, fourth];
            let places = quad.map(|vertex| self.index_of(lattice, vertex));
            if [[0, 2], [1, 3], [0, 3], [1, 2]].iter().all(|&[a, b]| (places[a] - places[b]).norm() < WIDEST) {
                let middle = places.iter().sum::<Vector3>() / 4.0;
                self.pending.push_back((self.test, cell_of(middle), quad));
            }
        }
    }
}
