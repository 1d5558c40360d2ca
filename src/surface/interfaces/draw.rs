//! All walls of a lattice at once: cells to keys, keys to vertices.
//!
//! ```text
//! per layer of cells, in parallel    every cell whose labels differ, or with a dead spring: triangles between keys of vertices
//! sort                               keys -> vertex numbers
//! per key, in parallel               place and carrier of crossings, lips, crack fronts and rims
//! nodes, then centres                weighted means of vertices before them
//! ```

use rayon::prelude::*;

use super::cell::{Cell, CellPatch, NODES, Node};
use super::face::OUTSIDE;
use super::partition::Partition;
use crate::lattice::{Lattice, Topology, neighbours};
use crate::surface::SurfaceError;
use crate::surface::blade::Blades;
use crate::surface::embed::{Carrier, Embedding, Vertex};
use crate::surface::extract::Crossings;
use crate::surface::gaps::{CellState, Gaps};
use crate::surface::junction::FRONT_DEPTH;
use crate::surface::marching_cubes::bits::InsideBits;
use crate::surface::marching_cubes::cell::{Rims, Site};
use crate::surface::marching_cubes::cube::{EDGES, RING_EDGES, RINGS, corner_offset, face_slot};
use crate::surface::marching_cubes::sweep::crossing_at;
use crate::surface::marching_cubes::table::CASES;
use crate::surface::normals::Sheet;
use crate::surface::rim;
use crate::surface::rim_edges;
use crate::surface::seam::{edge_key, point_key, point_of_key};

/// A vertex that follows others: number, and what it is the weighted mean of.
#[derive(Debug, Clone)]
pub(super) struct Knot {
    pub(super) vertex: u32,
    pub(super) sources: Vec<(u32, f32)>,
}

/// Walls and skins of all organs.
#[derive(Debug, Clone, Default)]
pub(super) struct Drawn {
    pub(super) embedding: Embedding,
    /// In an order in which sources come before what follows them.
    pub(super) knots: Vec<Knot>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Labels behind and in front of each triangle, the smaller first.
    pub(super) sides: Vec<[u8; 2]>,
    /// Centres at which an organ may touch itself, ascending.
    pub(super) cones: Vec<u32>,
}

/// A vertex: padded point and slot, the slots of a point as follows.
type Key = u64;
const SLOTS: u64 = 128;
/// Crossings of the three edges that start at the point.
const CROSSINGS: u64 = 0;
/// Lips of those edges, lower and upper.
const LIPS: u64 = 3;
/// Crack fronts in the four faces at each of those edges.
const FRONTS: u64 = 9;
/// Rims in those faces, at either end.
const RIMS: u64 = 21;
/// Nodes of the three faces that start there.
const FACE_NODES: u64 = 45;
/// Centres of the cell that starts there.
const CELL_CENTRES: u64 = 51;

/// Labels with a layer of outside all round.
struct Padded {
    labels: Vec<u8>,
    row: usize,
    layer: usize,
}

impl Padded {
    fn new(partition: &Partition) -> Self {
        let shape = partition.shape();
        let (row, layer) = (shape.nx + 2, (shape.nx + 2) * (shape.ny + 2));
        let mut labels = vec![OUTSIDE; layer * (shape.nz + 2)];
        for (from, source) in partition.labels().chunks(shape.nx.max(1)).enumerate() {
            let to = (from / shape.ny + 1) * layer + (from % shape.ny + 1) * row + 1;
            labels[to..to + shape.nx].copy_from_slice(source);
        }
        Self { labels, row, layer }
    }

    /// Labels of a cell's corners, by its lowest one.
    #[inline]
    fn corners(&self, [i, j, k]: [usize; 3]) -> [u8; 8] {
        let at = k * self.layer + j * self.row + i;
        std::array::from_fn(|c| self.labels[at + (c & 1) + (c >> 1 & 1) * self.row + (c >> 2) * self.layer])
    }
}

/// What a layer of cells draws.
#[derive(Default)]
struct Layer {
    triangles: Vec<([Key; 3], [u8; 2])>,
    nodes: Vec<KeyedNode>,
    centres: Vec<(Key, Vec<Key>)>,
    cones: Vec<Key>,
}

struct KeyedNode {
    key: Key,
    arcs: Vec<(u8, Key)>,
    dead_diagonals: usize,
}

/// Draws the partition of a lattice's grid, opened where `topology` parts it; places at rest, without the gradients that carry.
pub(super) fn draw(lattice: &Lattice, topology: &Topology, partition: &Partition) -> Result<Drawn, SurfaceError> {
    let shape = lattice.grid.shape;
    if partition.shape() != shape {
        return Err(SurfaceError::FieldLength { found: partition.labels().len(), expected: shape.len(), shape });
    }
    let bits = InsideBits::new(shape, partition.skin(), Some(&lattice.particle_at));
    let blades = Blades::new(lattice, topology.severed());
    let mut gaps = Gaps::find(lattice, topology, &blades, &bits, partition.skin(), Some(partition.labels()));
    let padded = Padded::new(partition);
    let scene = Scene { lattice, partition, bits: &bits, gaps: &gaps, padded: &padded };
    let layers: Vec<Layer> = (0..shape.nz + 1).into_par_iter().map(|k| scene.layer(k)).collect();
    let keys = keys_of(&layers);
    if u32::try_from(keys.len()).is_err() {
        return Err(SurfaceError::TooManyVertices);
    }
    let number = |key: Key| keys.binary_search(&key).expect("keys of all triangles") as u32;
    let flip = lattice.grid.affine.determinant() < 0.0;
    let flat: Vec<&([Key; 3], [u8; 2])> = layers.iter().flat_map(|layer| &layer.triangles).collect();
    if u32::try_from(flat.len()).is_err() {
        return Err(SurfaceError::TooManyVertices);
    }
    let numbered = |(corners, _): &&([Key; 3], [u8; 2])| {
        let [a, b, c] = corners.map(number);
        if flip { [a, c, b] } else { [a, b, c] }
    };
    let mut triangles: Vec<[u32; 3]> = flat.par_iter().map(numbered).collect();
    let sides: Vec<[u8; 2]> = flat.iter().map(|triangle| triangle.1).collect();

    let pitch_mm = lattice.pitch * 1e3;
    let (mut embedding, knots, crowded) = loop {
        let scene = Scene { lattice, partition, bits: &bits, gaps: &gaps, padded: &padded };
        let crossings =
            Crossings { lattice, alive: topology.alive(), blades: &blades, rim_crossings: &gaps.rim_crossings };
        let mut embedding = scene.embedding(&crossings, &keys);
        let mut knots = Vec::new();
        for node in layers.iter().flat_map(|layer| &layer.nodes) {
            let Ok(vertex) = keys.binary_search(&node.key) else { continue };
            let sources = node_sources(node, |key| embedding.vertices[number(key) as usize].rest);
            let sources = sources.into_iter().map(|(key, weight)| (number(key), weight)).collect();
            settle(&mut embedding, &mut knots, Knot { vertex: vertex as u32, sources });
        }
        for (key, sources) in layers.iter().flat_map(|layer| &layer.centres) {
            let weight = 1.0 / sources.len() as f32;
            let sources = sources.iter().map(|&source| (number(source), weight)).collect();
            settle(&mut embedding, &mut knots, Knot { vertex: number(*key), sources });
        }
        let crowded = rim::crowded(&embedding, &triangles, pitch_mm);
        let drawn = (lattice, &embedding, &*triangles);
        if crowded.is_empty() || !rim::make_room(&crowded, drawn, &mut gaps.edges, &mut gaps.rim_crossings) {
            break (embedding, knots, crowded);
        }
    };
    rim_edges::turn(&mut embedding, &mut triangles, |one, other| sides[one] == sides[other], &crowded, pitch_mm);
    let cones = layers.iter().flat_map(|layer| &layer.cones).map(|&key| number(key)).collect();
    Ok(Drawn { embedding, knots, triangles, sides, cones })
}

/// Places a knot among the vertices it follows.
fn settle(embedding: &mut Embedding, knots: &mut Vec<Knot>, knot: Knot) {
    let mut rest = [0.0_f64; 3];
    let mut sheet = 0;
    for &(source, weight) in &knot.sources {
        let source = &embedding.vertices[source as usize];
        rest = [0, 1, 2].map(|axis| rest[axis] + f64::from(weight) * source.rest[axis]);
        sheet |= source.sheet as u8;
    }
    let sheet = [Sheet::Skin, Sheet::Seam, Sheet::Rim].into_iter().find(|&known| known as u8 == sheet);
    let organ = embedding.vertices[knot.sources[0].0 as usize].organ;
    let carrier = Carrier::Centre { index: knots.len() as u32 };
    embedding.vertices[knot.vertex as usize] = Vertex { rest, carrier, organ, sheet: sheet.unwrap_or_default() };
    knots.push(knot);
}

fn keys_of(layers: &[Layer]) -> Vec<Key> {
    let mut keys: Vec<Key> =
        layers.par_iter().flat_map_iter(|layer| layer.triangles.iter().flat_map(|triangle| triangle.0)).collect();
    keys.par_sort_unstable();
    keys.dedup();
    keys
}

/// Where a node lies: on the straight way between the two crossings beside the outside, so that a wall leaves no groove in the skin,
/// as near as it comes to the others; behind the front of a cut; in the middle where there is no outside.
fn node_sources(node: &KeyedNode, rest: impl Fn(Key) -> [f64; 3]) -> Vec<(Key, f32)> {
    let arcs = &node.arcs;
    let Some(outside) = arcs.iter().position(|arc| arc.0 == OUTSIDE) else {
        return arcs.iter().map(|arc| (arc.1, 1.0 / arcs.len() as f32)).collect();
    };
    let ends = [(outside + arcs.len() - 1) % arcs.len(), outside].map(|at| arcs[at].1);
    let others: Vec<Key> = arcs.iter().map(|arc| arc.1).filter(|key| !ends.contains(key)).collect();
    if lips_of_one_edge(ends) {
        let depth = FRONT_DEPTH[node.dead_diagonals.min(2)];
        let behind = others.iter().map(|&key| (key, depth / others.len() as f32));
        return ends.into_iter().map(|key| (key, (1.0 - depth) / 2.0)).chain(behind).collect();
    }
    let [from, to] = ends.map(&rest);
    let along = |place: [f64; 3]| {
        let dot = |a: [f64; 3]| (0..3).map(|axis| a[axis] * (to[axis] - from[axis])).sum::<f64>();
        dot([0, 1, 2].map(|axis| place[axis] - from[axis])) / dot([0, 1, 2].map(|axis| to[axis] - from[axis]))
    };
    let mean = others.iter().map(|&key| along(rest(key))).sum::<f64>() / others.len() as f64;
    let share = if mean.is_finite() { mean.clamp(0.1, 0.9) as f32 } else { 0.5 };
    vec![(ends[0], 1.0 - share), (ends[1], share)]
}

fn lips_of_one_edge([one, two]: [Key; 2]) -> bool {
    let edge = |key: Key| (LIPS..FRONTS).contains(&(key % SLOTS)).then(|| (key / SLOTS, (key % SLOTS - LIPS) / 2));
    edge(one).is_some() && edge(one) == edge(two)
}

struct Scene<'a> {
    lattice: &'a Lattice,
    partition: &'a Partition,
    bits: &'a InsideBits,
    gaps: &'a Gaps,
    padded: &'a Padded,
}

impl Scene<'_> {
    fn layer(&self, k: usize) -> Layer {
        let shape = self.lattice.grid.shape;
        let first = self.gaps.cells.partition_point(|cell| (cell.low[2] as usize) < k);
        let mut special = self.gaps.cells[first..].iter().peekable();
        let mut layer = Layer::default();
        for j in 0..shape.ny + 1 {
            for i in 0..shape.nx + 1 {
                let low = [i, j, k];
                let labels = self.padded.corners(low);
                let state = special.next_if(|state| state.low.map(|i| i as usize) == low);
                if let Some(state) = state {
                    layer.add(self.key_of(low), &special_cell(labels, state).patch());
                } else if labels[1..].iter().any(|&label| label != labels[0]) {
                    self.add_intact(low, labels, &mut layer);
                }
            }
        }
        layer
    }

    fn key_of(&self, low: [usize; 3]) -> impl Fn(u8) -> Key + use<> {
        let shape = self.lattice.grid.shape;
        move |code| key_of(low, code, |point| point_key(shape, point))
    }

    /// A cell without a dead spring: from the table of one surface where there are two labels.
    fn add_intact(&self, low: [usize; 3], labels: [u8; 8], layer: &mut Layer) {
        let least = labels.iter().copied().min().unwrap_or(OUTSIDE);
        let most = labels.iter().copied().max().unwrap_or(OUTSIDE);
        let key = self.key_of(low);
        if labels.iter().any(|&label| label != least && label != most) {
            return layer.add(key, &Cell { labels, gaps: 0, diagonals: 0xfff, rims: Rims::NONE }.patch());
        }
        let case = (0..8).fold(0, |case, corner| case | u8::from(labels[corner] == least) << corner);
        let triangles = CASES.triangles(case).iter();
        layer.triangles.extend(triangles.map(|triangle| (triangle.map(&key), [least, most])));
    }

    /// Every vertex but knots, whose places stay zero for now.
    fn embedding(&self, crossings: &Crossings<'_>, keys: &[Key]) -> Embedding {
        let shape = self.lattice.grid.shape;
        // The vertices of all gaps, edge by edge.
        let mut first = vec![0];
        for edge in &self.gaps.edges {
            first.push(first[first.len() - 1] + edge.vertex_count());
        }
        let mut scratch = Embedding {
            vertices: vec![Vertex::default(); first[first.len() - 1]],
            rims: crossings.rims(),
            ..Embedding::default()
        };
        for (edge, &at) in self.gaps.edges.iter().zip(&first) {
            crossings.add_seam_edge(edge, at, &mut scratch);
        }
        let on_gap = |point: [i64; 3], axis: u64, place: &dyn Fn(&crate::surface::seam::SeamEdge) -> u32| {
            let key = edge_key(shape, point, axis as u8);
            let at = self.gaps.edges.binary_search_by_key(&key, |edge| edge.key(shape)).expect("a gap has its edge");
            scratch.vertices[first[at] + place(&self.gaps.edges[at]) as usize]
        };
        let vertex = |&key: &Key| {
            let (point, slot) = (point_of_key(shape, key / SLOTS), key % SLOTS);
            match slot {
                CROSSINGS..LIPS => self.crossing(crossings, point, slot as usize),
                LIPS..FRONTS => on_gap(point, (slot - LIPS) / 2, &|_| ((slot - LIPS) % 2) as u32),
                FRONTS..RIMS => {
                    on_gap(point, (slot - FRONTS) / 4, &|edge| edge.front_place(((slot - FRONTS) % 4) as u8))
                }
                RIMS..FACE_NODES => {
                    let rim = slot - RIMS;
                    on_gap(point, rim / 8, &|edge| edge.rim_place((rim % 8 / 2) as u8, (rim % 2) as u8))
                }
                _ => Vertex::default(),
            }
        };
        let vertices = keys.par_iter().map(vertex).collect();
        Embedding { vertices, ..scratch }
    }

    /// The crossing of an edge: of the skin, or of the wall between two organs.
    fn crossing(&self, crossings: &Crossings<'_>, low: [i64; 3], axis: usize) -> Vertex {
        let mut high = low;
        high[axis] += 1;
        let at = low.map(|i| i as usize);
        if self.bits.get(at) != self.bits.get(high.map(|i| i as usize)) {
            return crossings.vertex(crossing_at(self.bits, self.partition.skin(), at, axis));
        }
        let shape = self.lattice.grid.shape;
        let [from, to] = [low, high].map(|point| shape.linear(point.map(|i| i as usize - 1)));
        let t = self.partition.wall(from, to);
        let ijk = low.map(|i| i - 1);
        let particle = crossings.particle(ijk).expect("a wall lies between two particles");
        let mut step = [0; 3];
        step[axis] = 1;
        debug_assert!(self.lattice.neighbour(particle, neighbours::direction_of(step)).is_some());
        Vertex {
            rest: crossings.place(ijk, &[(axis, t)]),
            carrier: crossings.carrier(particle, ijk, axis, true, t),
            organ: self.partition.labels()[from],
            sheet: Sheet::Skin,
        }
    }
}

/// A cell with a dead spring.
fn special_cell(labels: [u8; 8], state: &CellState) -> Cell {
    Cell { labels, gaps: state.cell.cut, diagonals: state.cell.diagonals, rims: state.cell.rims }
}

impl Layer {
    fn add(&mut self, key: impl Fn(u8) -> Key, patch: &CellPatch) {
        self.triangles.extend(patch.triangles.iter().map(|&(triangle, labels)| (triangle.map(&key), labels)));
        self.nodes.extend(patch.nodes.iter().map(|Node { code, arcs, dead_diagonals }| KeyedNode {
            key: key(*code),
            arcs: arcs.iter().map(|&(label, site)| (label, key(site))).collect(),
            dead_diagonals: *dead_diagonals,
        }));
        self.centres.extend(
            patch.centres.iter().map(|(centre, sources)| (key(*centre), sources.iter().map(|&s| key(s)).collect())),
        );
        self.cones.extend(patch.cones.iter().map(|&cone| key(cone)));
    }
}

/// Key of a site of the cell whose lowest corner is given, by padded indices.
fn key_of(low: [usize; 3], code: u8, point: impl Fn([i64; 3]) -> u64) -> Key {
    let at = |offset: [usize; 3]| SLOTS * point([0, 1, 2].map(|axis| (low[axis] + offset[axis]) as i64));
    let on_edge = |edge: u8| (at(corner_offset(EDGES[usize::from(edge)][0])), u64::from(edge / 4));
    if code >= NODES {
        let (face, index) = ((code - NODES) / 2, (code - NODES) % 2);
        let mut offset = [0; 3];
        offset[usize::from(face / 2)] = usize::from(face % 2);
        return at(offset) + FACE_NODES + 2 * u64::from(face / 2) + u64::from(index);
    }
    let in_face = |face: u8, ring_edge: u8| {
        let edge = RING_EDGES[usize::from(face)][usize::from(ring_edge)];
        let (base, axis) = on_edge(edge);
        (base, axis, edge, u64::from(face_slot(face, edge)))
    };
    match Site::from_code(code) {
        Site::Skin { edge } => {
            let (base, axis) = on_edge(edge);
            base + CROSSINGS + axis
        }
        Site::Lip { edge, end } => {
            let (base, axis) = on_edge(edge);
            base + LIPS + 2 * axis + u64::from(end)
        }
        Site::Front { face, ring_edge } => {
            let (base, axis, _, slot) = in_face(face, ring_edge);
            base + FRONTS + 4 * axis + slot
        }
        Site::Rim { face, ring_edge, ring_end } => {
            let (base, axis, edge, slot) = in_face(face, ring_edge);
            let corner = RINGS[usize::from(face)][usize::from(ring_edge + ring_end) % 4];
            let end = u64::from(corner == EDGES[usize::from(edge)][1]);
            base + RIMS + 8 * axis + 2 * slot + end
        }
        Site::Centre { index } => at([0; 3]) + CELL_CENTRES + u64::from(index),
    }
}
