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
use super::bounds::Bounds;
use super::crossing::Crossing;
use super::tissue::{Tissue, slots_of};
use crate::geometry::{CellMap, Matrix3, Point3, Vector3};
use crate::lattice::build::corners;
use crate::lattice::layout::BLOCK_LEN;
use crate::lattice::{Lattice, NO_PARTICLE, neighbours};

/// Distance of the points along an edge, and of edges along a stroke [pitches]: cells are deformed little over half their
/// width.
const STEP: f64 = 0.5;
/// Edges nearer to each other than this at rest are one [pitches].
const SAME: f64 = 0.02;
/// A quad wider than this at rest joins places that do not belong together [pitches].
const WIDEST: f64 = 2.5;
/// How far beyond a cell a point still takes its place from it [cells]: the skin of an organ whose voxels are particles lies up
/// to a diagonal beyond the last cell.
const REACH: f64 = 2.0;
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
        for crossing in found {
            let low = tissue.lattice.ijk(crossing.particle).map(|i| i as f64);
            let offset = neighbours::OFFSETS[usize::from(crossing.direction)].map(f64::from);
            let place = Vector3::from(low) + Vector3::from(offset) * f64::from(crossing.at);
            self.severed.insert(cell_of(place), self.test);
        }
        for (cells, piece) in &pieces {
            self.record_piece(cells, piece);
        }
        self.confirm(time);
    }

    /// Takes the pending quads that springs were severed for into the sheet, and gives up those that have waited long.
    fn confirm(&mut self, time: f64) {
        let near = |cell: [i64; 3], test: Test| {
            (0..27).any(|step| {
                let around = [0, 1, 2].map(|axis| cell[axis] + step / [1, 3, 9][axis] % 3 - 1);
                self.severed.get(&around).is_some_and(|severed| severed.is_near(&test))
            })
        };
        let (mut quads, mut waiting) = (Vec::new(), VecDeque::new());
        for (test, cell, quad) in self.pending.drain(..) {
            if near(cell, test) {
                quads.push(quad);
            } else if self.test.is_near(&test) {
                waiting.push_back((test, cell, quad));
            }
        }
        self.sheet.times.extend(quads.iter().map(|_| time));
        self.sheet.quads.append(&mut quads);
        self.pending = waiting;
    }

    fn record_piece(&mut self, cells: &Cells<'_>, piece: &Piece) {
        let lattice = cells.tissue.lattice;
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

fn cell_of(index: Vector3) -> [i64; 3] {
    [0, 1, 2].map(|axis| index[axis].floor() as i64)
}

/// The cells a piece of a sweep may meet.
struct Cells<'a> {
    tissue: &'a Tissue<'a>,
    /// Lowest corner (i, j, k) and the particles of the corners, x fastest.
    list: Vec<([usize; 3], [u32; 8])>,
    /// Box of each cell, from the beginning to the end of the test.
    bounds: Vec<Bounds>,
    /// Those whose box, from the beginning to the end of the test, meets each cube of a pitch.
    cubes: Cubes,
    /// Largest distance that one of their corners moves during the whole test [m].
    longest_move: f64,
}

/// So many cells nearest to a place are asked, when none holds it.
const MOST_NEAR: usize = 8;
/// A cell over more cubes than this is stretched too far to say where a place in it was at rest.
const MOST_CUBES: i64 = 4096;

impl<'a> Cells<'a> {
    fn near(tissue: &'a Tissue<'a>, piece: &Piece) -> Self {
        let &Tissue { lattice, layout, .. } = tissue;
        let reach = Bounds::of(piece, 2.0 * REACH * lattice.pitch);
        let list: Vec<_> = (0..layout.blocks.len())
            .into_par_iter()
            .flat_map_iter(|block| {
                // A cell reaches one pitch up from its lowest corner.
                let part = tissue.part_near(block, &reach, [0.0, 1.0]);
                part.into_iter().flat_map(|part| slots_of(&part)).filter_map(move |slot| {
                    let low = layout.particle_of_slot(lattice, block * BLOCK_LEN + slot)?;
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
        let mut cells = Self { tissue, list, bounds: Vec::new(), cubes: Cubes::default(), longest_move: 0.0 };
        let boxed: Vec<([usize; 3], [u32; 8], Bounds)> = cells
            .list
            .par_iter()
            .map(|&(ijk, corners)| {
                let mut bounds = Bounds::EMPTY;
                for share in [0.0, 1.0] {
                    cells.corner_places(ijk, corners, share).into_iter().for_each(|place| bounds.include(place));
                }
                (ijk, corners, bounds)
            })
            .filter(|(.., bounds)| reach.meets(bounds))
            .collect();
        // From the last on: each cube gives them back ascending.
        for (number, (.., bounds)) in boxed.iter().enumerate().rev() {
            let [low, high] = [bounds.min, bounds.max].map(|corner| cells.cube_of(corner));
            let cubes: i64 = (0..3).map(|axis| (high[axis] - low[axis] + 1).min(MOST_CUBES)).product();
            if cubes > MOST_CUBES {
                continue;
            }
            for k in low[2]..=high[2] {
                for j in low[1]..=high[1] {
                    for i in low[0]..=high[0] {
                        cells.cubes.add([i, j, k], number as u32);
                    }
                }
            }
        }
        let moved = |&particle: &u32| (cells.displacement(particle, 1.0) - cells.displacement(particle, 0.0)).norm();
        let longest = boxed.par_iter().flat_map_iter(|(_, corners, _)| corners).map(moved).reduce(|| 0.0, f64::max);
        let (list, bounds) = boxed.into_iter().map(|(ijk, corners, bounds)| ((ijk, corners), bounds)).unzip();
        Self { list, bounds, longest_move: longest, ..cells }
    }

    /// How far the piece goes through the tissue, at most [m]; 0 where there is none.
    fn way(&self, piece: &Piece) -> f64 {
        let shared = piece.during[1] - piece.during[0];
        if self.list.is_empty() { 0.0 } else { piece.stroke.norm() + self.longest_move * shared }
    }

    /// Shares of the edge and of its stroke between which the piece may meet the cells or come within reach of them.
    fn shares(&self, piece: &Piece) -> Option<[[f64; 2]; 2]> {
        let all = self.bounds.iter().copied().reduce(Bounds::joined)?;
        let margin = Vector3::repeat((REACH + STEP) * self.tissue.lattice.pitch);
        let (low, high) = (all.min - margin - piece.origin.coords, all.max + margin - piece.origin.coords);
        let normal = piece.side.cross(&piece.stroke);
        // Of a vector: how much of it goes along the edge, and along the stroke. Where the edge slides along itself or stays, all of it
        // may matter.
        let size = normal.norm_squared();
        if size <= 1e-12 * piece.side.norm_squared() * piece.stroke.norm_squared() || size == 0.0 {
            let along = range_of(piece.side / piece.side.norm_squared(), low, high)?;
            return Some([along, [0.0, 1.0]]);
        }
        let along = range_of(piece.stroke.cross(&normal) / size, low, high)?;
        let across = range_of(normal.cross(&piece.side) / size, low, high)?;
        Some([along, across])
    }

    /// Displacement of a particle at a share of the test [m].
    fn displacement(&self, particle: u32, share: f64) -> Vector3 {
        let [before, now] = self.tissue.displacements(self.tissue.layout.slot[particle as usize] as usize);
        before + (now - before) * share
    }

    fn corner_places(&self, ijk: [usize; 3], corners: [u32; 8], share: f64) -> [Vector3; 8] {
        std::array::from_fn(|corner| {
            let index = [0, 1, 2].map(|axis| (ijk[axis] + (corner >> axis & 1)) as f64);
            Vector3::from(index) * self.tissue.lattice.pitch + self.displacement(corners[corner], share)
        })
    }

    /// Index at rest of what is at a place at a share of the test [m]: from the first cell that holds it, else from the nearest
    /// within reach.
    fn rest_of(&self, place: Vector3, share: f64) -> Option<Vector3> {
        let cube = self.cube_of(place);
        let found = |number: u32| {
            let (ijk, corners) = self.list[number as usize];
            let local = local(&self.corner_places(ijk, corners, share), place)?;
            Some((Vector3::from(ijk.map(|i| i as f64)), local))
        };
        if let Some((low, local)) = self.cubes.of(cube).filter_map(found).find(|(_, local)| outside(local) <= 1e-9) {
            return Some(low + local);
        }
        // Not inside any: the nearest cells by their boxes, and among them the one it is least outside of.
        let around = (0..125).map(|step| [0, 1, 2].map(|axis| cube[axis] + step / [1, 5, 25][axis] % 5 - 2));
        let mut near: Vec<u32> = around.flat_map(|cube| self.cubes.of(cube)).collect();
        near.sort_unstable();
        near.dedup();
        let mut near: Vec<(f64, u32)> =
            near.into_iter().map(|number| (self.bounds[number as usize].distance(place), number)).collect();
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(MOST_NEAR);
        let found = near.iter().filter_map(|&(_, number)| found(number));
        let (low, local) = found.min_by(|(_, a), (_, b)| outside(a).total_cmp(&outside(b)))?;
        (outside(&local) <= REACH).then(|| low + local)
    }

    fn cube_of(&self, place: Vector3) -> [i64; 3] {
        cell_of(place / self.tissue.lattice.pitch)
    }
}

/// Cells by the cubes they meet, chained: nothing is reserved per cube.
#[derive(Default)]
struct Cubes {
    /// The last entry of each cube.
    last: CellMap<[i64; 3], u32>,
    /// A cell, and the entry of its cube before this one.
    entries: Vec<(u32, Option<u32>)>,
}

impl Cubes {
    fn add(&mut self, cube: [i64; 3], cell: u32) {
        let entry = self.entries.len() as u32;
        let before = self.last.insert(cube, entry);
        self.entries.push((cell, before));
    }

    /// Those of a cube, the last that was added first.
    fn of(&self, cube: [i64; 3]) -> impl Iterator<Item = u32> + '_ {
        let mut next = self.last.get(&cube).copied();
        std::iter::from_fn(move || {
            let (cell, before) = self.entries[next? as usize];
            next = before;
            Some(cell)
        })
    }
}

/// Products of a vector with the points of a box, as far as they lie in 0 to 1.
fn range_of(vector: Vector3, low: Vector3, high: Vector3) -> Option<[f64; 2]> {
    let (mut least, mut most) = (0.0, 0.0);
    for axis in 0..3 {
        let ends = [vector[axis] * low[axis], vector[axis] * high[axis]];
        least += ends[0].min(ends[1]);
        most += ends[0].max(ends[1]);
    }
    let range = [least.max(0.0), most.min(1.0)];
    (range[0] <= range[1]).then_some(range)
}

/// How far local coordinates lie outside their cell.
fn outside(local: &Vector3) -> f64 {
    local.iter().map(|&x| (-x).max(x - 1.0)).fold(f64::MIN, f64::max)
}

/// Local coordinates of a place in a cell of these corners, by Newton's method on the trilinear map; `None` where the cell is too
/// deformed for it.
fn local(corners: &[Vector3; 8], place: Vector3) -> Option<Vector3> {
    const STEPS: usize = 12;
    let size = (corners[7] - corners[0]).norm();
    let mut local = Vector3::repeat(0.5);
    for _ in 0..STEPS {
        let (value, gradient) = trilinear(corners, local);
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
        for expected in [Vector3::new(0.1, 0.7, 0.4), Vector3::new(1.3, 0.2, -0.1)] {
            let found = local(&places, trilinear(&places, expected).0).unwrap();
            assert!((found - expected).norm() < 1e-8, "{found}");
            assert!((outside(&found) - (expected.x - 1.0).max(-0.1)).abs() < 1e-8);
        }
        assert_eq!(local(&[Vector3::zeros(); 8], Vector3::x()), None, "a cell pressed to a point");
    }
}
