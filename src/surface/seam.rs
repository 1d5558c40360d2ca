//! Where severed springs part the surface: which dead edges count, where their lips lie, and the patches of their cells.
//!
//! ```text
//! dead springs between inside points        every edge or face diagonal of a cell that has lost (or never had) its spring
//! seam cells                                the cells such a spring belongs to: they take the general path
//! seam edges                                dead edges whose ends some face parts; a lone broken spring parts nothing
//! per seam edge                             two lips, a crack front for every face that keeps its ends together,
//!                                           a rim for every lip that meets the skin beside its corner
//! ```
//! Body diagonals never matter: the surface is decided face by face.

use rayon::prelude::*;

use super::blade::Blades;
use super::junction::{Beyond, FrontPlace, LIP_SHIFT, RimPlace, front_place, rim_at};
use super::marching_cubes::bits::InsideBits;
use super::marching_cubes::cell::{Cell, Patch};
use super::marching_cubes::cube::{EDGES, RINGS, corner_offset};
use super::marching_cubes::face::{Between, Face};
use super::marching_cubes::sweep::{CLEARANCE, crossing_at};
use crate::geometry::GridShape;
use crate::lattice::{Lattice, Topology, neighbours};

/// An edge whose ends a cut has parted.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SeamEdge {
    /// Lower end of the edge, padded indices.
    pub(crate) low: [u32; 3],
    /// Axis of the edge.
    pub(crate) axis: u8,
    /// Particles at the lower and the upper end.
    pub(crate) ends: [u32; 2],
    /// Distance of each lip from its own end, as a fraction of the edge.
    pub(crate) lips: [f32; 2],
    /// Crack fronts in the order of their face slots.
    pub(crate) fronts: Vec<FrontPlace>,
    /// Rims in the order of face slot, then end.
    pub(crate) rims: Vec<RimPlace>,
    front_slots: u8,
    rim_slots: u8,
}

impl SeamEdge {
    /// Number of vertices: lips, fronts, rims, in this order.
    pub(crate) fn vertex_count(&self) -> usize {
        2 + self.fronts.len() + self.rims.len()
    }

    /// Place of a crack front among the vertices of this edge.
    pub(crate) fn front_place(&self, slot: u8) -> u32 {
        debug_assert!(self.front_slots >> slot & 1 == 1, "no crack front at slot {slot}");
        2 + (self.front_slots & ((1 << slot) - 1)).count_ones()
    }

    /// Place of a rim among the vertices of this edge.
    pub(crate) fn rim_place(&self, slot: u8, end: u8) -> u32 {
        debug_assert!(self.rim_slots >> (2 * slot + end) & 1 == 1, "no rim at slot {slot}, end {end}");
        let before = (1_u8 << (2 * slot + end)) - 1;
        (2 + self.fronts.len()) as u32 + (self.rim_slots & before).count_ones()
    }

    /// Its place in the order of edges.
    pub(crate) fn key(&self, shape: GridShape) -> u64 {
        edge_key(shape, self.low.map(i64::from), self.axis)
    }
}

/// A cell with a dead spring.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SeamCell {
    /// Lower corner, padded indices.
    pub(crate) low: [u32; 3],
    /// Its triangles.
    pub(crate) patch: Patch,
    /// Its seam edges: edge of the cell, index into [`Seam::edges`].
    pub(crate) seam_edges: Vec<(u8, u32)>,
}

impl SeamCell {
    /// Padded index along x.
    pub(crate) fn column(&self) -> usize {
        self.low[0] as usize
    }
}

/// A cell with a dead spring, before it is drawn.
#[derive(Debug, Clone)]
pub(crate) struct CellState {
    /// Lower corner, padded indices.
    pub(crate) low: [u32; 3],
    pub(crate) cell: Cell,
    seam_edges: Vec<(u8, u32)>,
}

/// Edges whose ends a cut has parted, ascending as in [`Seam`], and the cells with a dead spring, ascending too.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gaps {
    pub(crate) edges: Vec<SeamEdge>,
    pub(crate) cells: Vec<CellState>,
}

impl Gaps {
    /// Finds what the dead springs between inside points part.
    ///
    /// - `labels`: organ of each grid point, where several are drawn at once: diagonals between two organs then join nothing.
    pub(crate) fn find(
        lattice: &Lattice,
        topology: &Topology,
        blades: &Blades,
        bits: &InsideBits,
        values: &[f32],
        labels: Option<&[u8]>,
    ) -> Self {
        let tissue = Tissue { lattice, alive: topology.alive(), bits, blades, labels };
        let dead = tissue.dead_springs();
        if dead.is_empty() {
            return Self::default();
        }
        let shape = bits.shape;
        let keys = sorted(
            dead.par_iter()
                .filter(|spring| spring.family() == 1 && tissue.parts_its_ends(spring))
                .map(|spring| edge_key(shape, spring.low, spring.axis()))
                .collect(),
        );
        let edges: Vec<SeamEdge> = keys.par_iter().map(|&key| tissue.seam_edge(key, &keys, values)).collect();
        debug_assert!(edges.iter().zip(&keys).all(|(edge, &key)| edge.key(shape) == key));
        let cell_keys = sorted(dead.par_iter().flat_map_iter(|spring| spring.cells(shape)).collect());
        let cells = cell_keys.par_iter().map(|&key| tissue.cell_state(key, &keys)).collect();
        Self { edges, cells }
    }
}

/// Everything a set of severed springs changes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Seam {
    /// Ascending by layer, row, column and axis.
    pub(crate) edges: Vec<SeamEdge>,
    /// Ascending by layer, row and column.
    pub(crate) cells: Vec<SeamCell>,
}

impl Seam {
    /// No dead spring.
    pub(crate) fn none() -> Self {
        Self::default()
    }

    /// Finds what the dead springs between inside points change.
    pub(crate) fn find(
        lattice: &Lattice,
        topology: &Topology,
        blades: &Blades,
        bits: &InsideBits,
        values: &[f32],
    ) -> Self {
        let Gaps { edges, cells } = Gaps::find(lattice, topology, blades, bits, values, None);
        let drawn =
            |state: CellState| SeamCell { low: state.low, patch: state.cell.patch(), seam_edges: state.seam_edges };
        Self { edges, cells: cells.into_par_iter().map(drawn).collect() }
    }

    /// Seam edges that start in a padded layer.
    pub(crate) fn edges_of_layer(&self, k: usize) -> &[SeamEdge] {
        let from = self.edges.partition_point(|edge| (edge.low[2] as usize) < k);
        let to = self.edges.partition_point(|edge| (edge.low[2] as usize) <= k);
        &self.edges[from..to]
    }

    /// Seam cells of a layer of cells.
    pub(crate) fn cells_of_layer(&self, k: usize) -> &[SeamCell] {
        let from = self.cells.partition_point(|cell| (cell.low[2] as usize) < k);
        let to = self.cells.partition_point(|cell| (cell.low[2] as usize) <= k);
        &self.cells[from..to]
    }

    /// Index range of the seam cells of one row.
    pub(crate) fn cells_of_row(&self, j: usize, k: usize) -> (usize, usize) {
        let row = |cell: &SeamCell| (cell.low[2] as usize, cell.low[1] as usize);
        let from = self.cells.partition_point(|cell| row(cell) < (k, j));
        let to = from + self.cells[from..].partition_point(|cell| row(cell) <= (k, j));
        (from, to)
    }
}

fn sorted(mut keys: Vec<u64>) -> Vec<u64> {
    keys.par_sort_unstable();
    keys.dedup();
    keys
}

/// Linear index of a padded point.
pub(crate) fn point_key(shape: GridShape, at: [i64; 3]) -> u64 {
    let (nx, ny) = (shape.nx as u64 + 2, shape.ny as u64 + 2);
    (at[2] as u64 * ny + at[1] as u64) * nx + at[0] as u64
}

pub(crate) fn point_of_key(shape: GridShape, key: u64) -> [i64; 3] {
    let (nx, ny) = (shape.nx as u64 + 2, shape.ny as u64 + 2);
    [(key % nx) as i64, (key / nx % ny) as i64, (key / (nx * ny)) as i64]
}

pub(crate) fn edge_key(shape: GridShape, low: [i64; 3], axis: u8) -> u64 {
    3 * point_key(shape, low) + u64::from(axis)
}

/// A dead spring between two inside points, from its lower end.
struct DeadSpring {
    low: [i64; 3],
    direction: usize,
}

impl DeadSpring {
    fn family(&self) -> usize {
        neighbours::family(self.direction)
    }

    fn axis(&self) -> u8 {
        neighbours::OFFSETS[self.direction].iter().position(|&o| o != 0).unwrap_or(0) as u8
    }

    /// Keys of the cells that hold both ends: four round an edge, two at a face diagonal.
    fn cells(&self, shape: GridShape) -> impl Iterator<Item = u64> + use<> {
        let (low, offset) = (self.low, neighbours::OFFSETS[self.direction]);
        (0..8_u8).filter_map(move |choice| {
            let back = corner_offset(choice);
            let mut cell = low;
            for axis in 0..3 {
                match offset[axis] {
                    0 => cell[axis] -= back[axis] as i64,
                    _ if back[axis] == 1 => return None,
                    o => cell[axis] += i64::from(o.min(0)),
                }
            }
            Some(point_key(shape, cell))
        })
    }
}

/// Inside particles and their living springs, by padded indices.
struct Tissue<'a> {
    lattice: &'a Lattice,
    alive: &'a [u32],
    bits: &'a InsideBits,
    blades: &'a Blades,
    /// Organ of each grid point, where several are drawn at once.
    labels: Option<&'a [u8]>,
}

/// Particles per task when all particles are searched.
const PARTICLES_PER_TASK: usize = 1 << 14;

impl Tissue<'_> {
    /// The particle at a point, when that is inside.
    fn at(&self, at: [i64; 3]) -> Option<u32> {
        let dims = self.bits.shape.dims();
        if (0..3).any(|axis| at[axis] < 1 || at[axis] > dims[axis] as i64) {
            return None;
        }
        let at = at.map(|i| i as usize);
        self.bits.get(at).then(|| self.lattice.particle_at[self.bits.shape.linear(at.map(|i| i - 1))])
    }

    /// Organ of an inside point, where that matters.
    fn label(&self, at: [i64; 3]) -> Option<u8> {
        self.labels.map(|labels| labels[self.bits.shape.linear(at.map(|i| (i - 1) as usize))])
    }

    /// Whether the spring between two neighbouring points lives.
    fn linked(&self, one: ([i64; 3], Option<u32>), two: ([i64; 3], Option<u32>)) -> bool {
        let (Some(particle), Some(_)) = (one.1, two.1) else { return false };
        let direction = neighbours::direction_of([0, 1, 2].map(|axis| (two.0[axis] - one.0[axis]) as i32));
        self.alive[particle as usize] >> direction & 1 == 1
    }

    /// Dead springs along edges and face diagonals between inside points, in the order of their lower ends.
    fn dead_springs(&self) -> Vec<DeadSpring> {
        let forward: Vec<usize> =
            (neighbours::FIRST_FORWARD..neighbours::NEIGHBOURS).filter(|&d| neighbours::family(d) < 3).collect();
        let mask = forward.iter().fold(0_u32, |mask, d| mask | 1 << d);
        self.alive
            .par_chunks(PARTICLES_PER_TASK)
            .enumerate()
            .flat_map_iter(|(task, chunk)| {
                let mut dead = Vec::new();
                for (place, alive) in chunk.iter().enumerate().filter(|(_, alive)| *alive & mask != mask) {
                    let particle = (task * PARTICLES_PER_TASK + place) as u32;
                    let low = self.lattice.ijk(particle).map(|i| i as i64 + 1);
                    if self.at(low).is_none() {
                        continue;
                    }
                    for &direction in forward.iter().filter(|&d| alive >> d & 1 == 0) {
                        let offset = neighbours::OFFSETS[direction];
                        if self.at([0, 1, 2].map(|axis| low[axis] + i64::from(offset[axis]))).is_some() {
                            dead.push(DeadSpring { low, direction });
                        }
                    }
                }
                dead
            })
            .collect()
    }

    /// The face with the given lower corner and normal, without its cut bits, and its particles.
    fn face(&self, low: [i64; 3], normal: usize) -> (Face, [Option<u32>; 4]) {
        let corners = RINGS[2 * normal].map(|corner| {
            let offset = corner_offset(corner);
            let at = [0, 1, 2].map(|axis| low[axis] + offset[axis] as i64);
            (at, self.at(at))
        });
        let mut face = Face { inside: 0, alive: 0, diagonals: 0, cut: 0 };
        for m in 0..4 {
            face.inside |= u8::from(corners[m].1.is_some()) << m;
            face.alive |= u8::from(self.linked(corners[m], corners[(m + 1) % 4])) << m;
        }
        for m in 0..2 {
            let joined =
                self.linked(corners[m], corners[m + 2]) && self.label(corners[m].0) == self.label(corners[m + 2].0);
            face.diagonals |= u8::from(joined) << m;
        }
        (face, corners.map(|corner| corner.1))
    }

    /// Whether a face at a dead edge puts its ends into different components.
    fn parts_its_ends(&self, spring: &DeadSpring) -> bool {
        (0..4).any(|slot| {
            let (low, normal, m) = face_of_slot(spring.low, spring.axis(), slot);
            let component = self.face(low, normal).0.components();
            component[m] != component[(m + 1) % 4]
        })
    }

    fn seam_edge(&self, key: u64, keys: &[u64], values: &[f32]) -> SeamEdge {
        let (low, axis) = (point_of_key(self.bits.shape, key / 3), (key % 3) as u8);
        let mut high = low;
        high[usize::from(axis)] += 1;
        // Springs that were never there (two organs that do not hold together) part half-way where voxels are particles.
        let ends = [low, high].map(|end| self.at(end).unwrap_or(0));
        let cut = self.blades.on_edge(ends[0], axis);
        let at = cut.unwrap_or(0.5).clamp(CLEARANCE + LIP_SHIFT, 1.0 - CLEARANCE - LIP_SHIFT);
        let forward = neighbours::direction_of([0, 1, 2].map(|a| i32::from(a == usize::from(axis))));
        let never = self.lattice.springs[ends[0] as usize] >> forward & 1 == 0;
        let lips = if never && self.lattice.has_cells() {
            // Air between two walls of cells, which end where their corners are.
            [CLEARANCE; 2]
        } else {
            [at - LIP_SHIFT, 1.0 - at - LIP_SHIFT]
        };
        let mut edge = SeamEdge {
            low: low.map(|i| i as u32),
            axis,
            ends,
            lips,
            fronts: Vec::new(),
            rims: Vec::new(),
            front_slots: 0,
            rim_slots: 0,
        };
        for slot in 0..4 {
            self.add_face(&mut edge, slot, keys, values);
        }
        edge
    }

    /// Adds the crack front and the rims that a seam edge has in one of its faces.
    fn add_face(&self, edge: &mut SeamEdge, slot: u8, keys: &[u64], values: &[f32]) {
        let (low, normal, m) = face_of_slot(edge.low.map(i64::from), edge.axis, slot);
        let (mut face, particles) = self.face(low, normal);
        for ring_edge in 0..4 {
            let (start, axis) = ring_edge_at(low, normal, ring_edge);
            let cut = keys.binary_search(&edge_key(self.bits.shape, start, axis)).is_ok();
            face.cut |= u8::from(cut) << ring_edge;
        }
        let mut rims = [None; 2];
        for contour in face.contours() {
            match face.between(contour) {
                Some(Between::Front { edge: ring_edge }) if usize::from(ring_edge) == m => {
                    edge.front_slots |= 1 << slot;
                    // From the ring corner m on: the ring runs against the axis on its second half.
                    let at = edge.lips[0] + LIP_SHIFT;
                    edge.fronts.push(front_place(face, particles, m, if m < 2 { at } else { 1.0 - at }));
                }
                Some(Between::Rim { lip, skin }) if usize::from(lip.edge) == m => {
                    // On the first half of the ring, the corner m is the lower end of its edge.
                    let end = u8::from((lip.corner == lip.edge) != (m < 2));
                    let (start, skin_axis) = ring_edge_at(low, normal, usize::from(skin.edge));
                    let skin = self.skin_fraction(start, skin_axis, values);
                    let beyond = self.beyond(face, low, normal, lip.corner, m, values);
                    let upward_slope = self.blades.slope(edge.ends, edge.axis.into(), skin_axis.into());
                    let slope = if skin.1 { upward_slope } else { -upward_slope };
                    let at = rim_at(edge.lips, end, skin.0, slope, beyond);
                    rims[usize::from(end)] = Some(RimPlace { end, skin_axis, skin_upward: skin.1, at });
                }
                _ => {}
            }
        }
        for rim in rims.into_iter().flatten() {
            edge.rim_slots |= 1 << (2 * slot + rim.end);
            edge.rims.push(rim);
        }
    }

    /// Fraction of a crossed edge from its inside end, and whether the outside lies upward.
    fn skin_fraction(&self, low: [i64; 3], axis: u8, values: &[f32]) -> (f32, bool) {
        let crossing = crossing_at(self.bits, values, low.map(|i| i as usize), usize::from(axis));
        let mut inside = low;
        inside[usize::from(axis)] += i64::from(!crossing.upward);
        let limited = |particle| self.blades.limit(particle, usize::from(axis), crossing.upward, crossing.t);
        (self.at(inside).map_or(crossing.t, limited), crossing.upward)
    }

    /// What stands opposite a rim's corner.
    fn beyond(&self, face: Face, low: [i64; 3], normal: usize, corner: u8, m: usize, values: &[f32]) -> Beyond {
        let opposite = usize::from(corner) ^ 2;
        if face.inside >> opposite & 1 == 0 {
            return Beyond::Nothing;
        }
        // Ring edges at the opposite corner: one faces the lip edge, the other joins the lip edge's far end.
        let facing = (m + 2) % 4;
        let side = if facing == opposite { (opposite + 3) % 4 } else { opposite };
        if face.cut >> side & 1 == 1 {
            return Beyond::Corner;
        }
        let (start, axis) = ring_edge_at(low, normal, facing);
        Beyond::Sheet(1.0 - self.skin_fraction(start, axis, values).0)
    }

    fn cell_state(&self, key: u64, edge_keys: &[u64]) -> CellState {
        let low = point_of_key(self.bits.shape, key);
        let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|corner| {
            let offset = corner_offset(corner);
            let at = [0, 1, 2].map(|axis| low[axis] + offset[axis] as i64);
            (at, self.at(at))
        });
        let mut cell = Cell::default();
        for (corner, (_, particle)) in corners.iter().enumerate() {
            cell.inside |= u8::from(particle.is_some()) << corner;
        }
        let mut seam_edges = Vec::new();
        for (edge, ends) in EDGES.iter().enumerate() {
            let [one, two] = ends.map(|corner| corners[usize::from(corner)]);
            if self.linked(one, two) {
                cell.alive |= 1 << edge;
            } else if one.1.is_some() && two.1.is_some() {
                let key = edge_key(self.bits.shape, one.0, (edge / 4) as u8);
                if let Ok(index) = edge_keys.binary_search(&key) {
                    cell.cut |= 1 << edge;
                    seam_edges.push((edge as u8, index as u32));
                }
            }
        }
        for (face, ring) in RINGS.iter().enumerate() {
            for m in 0..2 {
                let [one, two] = [ring[m], ring[m + 2]].map(|corner| corners[usize::from(corner)]);
                cell.diagonals |= u16::from(self.linked(one, two)) << (2 * face + m);
            }
        }
        CellState { low: low.map(|i| i as u32), cell, seam_edges }
    }
}

/// Lower corner, normal and ring edge of the face at `slot` of an edge (slots as in [`super::marching_cubes::cube::face_slot`]).
fn face_of_slot(mut low: [i64; 3], axis: u8, slot: u8) -> ([i64; 3], usize, usize) {
    let axis = usize::from(axis);
    let reach = (axis + 1 + usize::from(slot / 2)) % 3;
    let normal = 3 - axis - reach;
    low[reach] -= i64::from(slot % 2);
    // The ring runs along b, c, b, c: edges 0 and 2 lie along b = normal + 1, at c = 0 and c = 1.
    let far = slot % 2 == 1;
    let m = match ((normal + 1) % 3 == axis, far) {
        (true, false) => 0,
        (true, true) => 2,
        (false, true) => 1,
        (false, false) => 3,
    };
    (low, normal, m)
}

/// Lower end and axis of a ring edge of a face.
fn ring_edge_at(mut low: [i64; 3], normal: usize, ring_edge: usize) -> ([i64; 3], u8) {
    let (b, c) = ((normal + 1) % 3, (normal + 2) % 3);
    match ring_edge {
        0 => (low, b as u8),
        1 => {
            low[b] += 1;
            (low, c as u8)
        }
        2 => {
            low[c] += 1;
            (low, b as u8)
        }
        _ => (low, c as u8),
    }
}
