//! Where severed springs part the surface: which dead edges count, where their lips lie, and what is known of their cells.
//!
//! ```text
//! dead springs between inside points        every edge or face diagonal of a cell that has lost (or never had) its spring
//! seam cells                                the cells such a spring belongs to: they take the general path
//! seam edges                                dead edges whose ends some face parts; a lone broken spring parts nothing
//! per seam edge                             two lips, a crack front for every face that keeps its ends together,
//!                                           a rim for every lip that meets the skin beside its corner
//! rim crossings                             crossings of the skin beside a cut or beyond the blade, drawn along the skin to the rim
//! ```
//! Body diagonals never matter: the surface is decided face by face.

use rayon::prelude::*;

use super::blade::Blades;
use super::junction::{
    Beyond, LIP_CLEARANCE, LIP_SHIFT, NearBlade, RimCrossing, RimPlace, front_place, passes_corner, rim_at,
};
use super::marching_cubes::bits::InsideBits;
use super::marching_cubes::cell::Cell;
use super::marching_cubes::cube::{EDGES, RING_EDGES, RINGS, corner_offset, face_slot};
use super::marching_cubes::face::{Between, Face};
use super::marching_cubes::sweep::{CLEARANCE, Crossing, crossing_at};
use super::seam::{SeamEdge, edge_key, point_key, point_of_key};
use crate::geometry::GridShape;
use crate::lattice::{Lattice, Topology, neighbours};

/// A cell with a dead spring, before it is drawn.
#[derive(Debug, Clone)]
pub(crate) struct CellState {
    /// Lower corner, padded indices.
    pub(crate) low: [u32; 3],
    pub(crate) cell: Cell,
    pub(super) seam_edges: Vec<(u8, u32)>,
}

/// Edges whose ends a cut has parted, ascending as in [`super::seam::Seam`], and the cells with a dead spring, ascending too.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gaps {
    pub(crate) edges: Vec<SeamEdge>,
    pub(crate) cells: Vec<CellState>,
    /// Ascending by their edges.
    pub(crate) rim_crossings: Vec<RimCrossing>,
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
        let (edges, found): (Vec<SeamEdge>, Vec<Vec<RimCrossing>>) =
            keys.par_iter().map(|&key| tissue.seam_edge(key, &keys, values)).unzip();
        let passed = blades
            .particles(lattice, topology.alive())
            .into_par_iter()
            .flat_map_iter(|particle| tissue.passed_crossings(particle, values));
        let mut rim_crossings: Vec<RimCrossing> = found.into_par_iter().flatten().chain(passed).collect();
        // Of several places on the rim the nearest.
        rim_crossings.sort_by(|a, b| a.edge.cmp(&b.edge).then(a.moved().total_cmp(&b.moved())));
        rim_crossings.dedup_by_key(|crossing| crossing.edge);
        debug_assert!(edges.iter().zip(&keys).all(|(edge, &key)| edge.key(shape) == key));
        let cell_keys = sorted(dead.par_iter().flat_map_iter(|spring| spring.cells(shape)).collect());
        let cells = cell_keys.par_iter().map(|&key| tissue.cell_state(key, &keys, &edges, &rim_crossings)).collect();
        Self { edges, cells, rim_crossings }
    }
}

fn sorted(mut keys: Vec<u64>) -> Vec<u64> {
    keys.par_sort_unstable();
    keys.dedup();
    keys
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

    /// The edge of that key, and crossings of the skin beside it that belong to its rims.
    fn seam_edge(&self, key: u64, keys: &[u64], values: &[f32]) -> (SeamEdge, Vec<RimCrossing>) {
        let (low, axis) = (point_of_key(self.bits.shape, key / 3), (key % 3) as u8);
        let mut high = low;
        high[usize::from(axis)] += 1;
        // Springs that were never there (two organs that do not hold together) part half-way where voxels are particles.
        let ends = [low, high].map(|end| self.at(end).unwrap_or(0));
        let cut = self.blades.on_edge(ends[0], axis);
        let at = cut.unwrap_or(0.5).clamp(LIP_CLEARANCE + LIP_SHIFT, 1.0 - LIP_CLEARANCE - LIP_SHIFT);
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
        let mut rim_crossings = Vec::new();
        for slot in 0..4 {
            self.add_face(&mut edge, slot, keys, values, &mut rim_crossings);
        }
        (edge, rim_crossings)
    }

    /// Adds the crack front and the rims that a seam edge has in one of its faces.
    fn add_face(
        &self,
        edge: &mut SeamEdge,
        slot: u8,
        keys: &[u64],
        values: &[f32],
        rim_crossings: &mut Vec<RimCrossing>,
    ) {
        let (low, normal, m) = face_of_slot(edge.low.map(i64::from), edge.axis, slot);
        let (mut face, particles) = self.face(low, normal);
        for ring_edge in 0..4 {
            let (start, axis) = ring_edge_at(low, normal, ring_edge);
            let cut = keys.binary_search(&edge_key(self.bits.shape, start, axis)).is_ok();
            face.cut |= u8::from(cut) << ring_edge;
        }
        // Both edges across run the same way, from this edge to the one that faces it.
        let (across, upward) = ((edge.axis + 1 + slot / 2) % 3, slot.is_multiple_of(2));
        let third = 3 - edge.axis - across;
        let upward_slopes = [across, third].map(|over| self.blades.slope(edge.ends, edge.axis.into(), over.into()));
        let mut rims = [None; 2];
        // Ends of contours from a lip straight to a crossing, and from a lip to a rim. The second stay clear of the first.
        let (mut straight, mut bent) = (None, Vec::new());
        for contour in face.contours() {
            match face.between(contour) {
                Some(Between::Front { edge: ring_edge }) if usize::from(ring_edge) == m => {
                    edge.front_slots |= 1 << slot;
                    // From the ring corner m on: the ring runs against the axis on its second half.
                    let at = edge.lips[0] + LIP_SHIFT;
                    edge.fronts.push(front_place(face, particles, m, if m < 2 { at } else { 1.0 - at }));
                    continue;
                }
                Some(Between::Front { .. }) => continue,
                _ => {}
            }
            let Some((lip, skin)) = face.lip_and_skin(contour).filter(|(lip, _)| usize::from(lip.edge) == m) else {
                continue;
            };
            if skin.corner == lip.corner { bent.push((lip, skin)) } else { straight = Some((lip, skin)) }
        }
        // Whether the straight one ends where the blade meets the skin: it runs along the blade then.
        let mut along = false;
        for (lip, skin) in straight.into_iter().chain(bent) {
            // On the first half of the ring, the corner m is the lower end of its edge.
            let end = u8::from((lip.corner == lip.edge) != (m < 2));
            // Seen from the corner of the lip: the cut edge, then across it into the face, then up along the third axis.
            let signs = [end == 0, upward, true].map(|upward| if upward { 1.0 } else { -1.0 });
            let slopes = [0, 1].map(|n| upward_slopes[n] * signs[0] * signs[n + 1]);
            let blade = NearBlade { normal: [1.0, -slopes[0], -slopes[1]], offset: edge.lips[usize::from(end)] };
            let side = Side::new(low, normal, m, lip.corner);
            let met = self.skin_ends(face, &side, values).and_then(|ends| blade.meets(ends));
            let mut corner = edge.low.map(i64::from);
            corner[usize::from(edge.axis)] += i64::from(end);
            let on_axes = |normal: [f32; 3]| {
                let along = [edge.axis, across, third].map(|axis| normal[usize::from(axis)]);
                [0, 1, 2].map(|n| along[n] * signs[n])
            };
            let (start, axis) = ring_edge_at(low, normal, usize::from(skin.edge));
            let raw = self.crossing(start, axis, values).t;
            if skin.corner == lip.corner {
                let normal = || on_axes(self.skin_normal(corner, across.into(), upward, values));
                let met = met.or_else(|| blade.meets_near([0.0, raw, 0.0], normal()));
                let skin = self.skin_fraction(start, axis, values);
                let beyond = self.beyond(face, &side, values);
                let clear = along || matches!(beyond, Beyond::Sheet(to) if blade.runs_along(to));
                let plain = rim_at(edge.lips, end, skin, slopes[0], None, beyond);
                let at = rim_at(edge.lips, end, skin, slopes[0], met, if clear { Beyond::Nothing } else { beyond });
                let behind = met.is_none() && passes_corner(edge.lips[usize::from(end)], raw, slopes[0]);
                rims[usize::from(end)] =
                    Some(RimPlace { end, skin_axis: across, skin_upward: upward, at, plain, gave_way: false, behind });
            } else {
                let above = stepped(corner, across.into(), upward);
                let normal = || on_axes(self.skin_normal(above, edge.axis.into(), end == 0, values));
                let Some([x, y, z]) = met.or_else(|| blade.meets_near([raw, 1.0, 0.0], normal())) else { continue };
                along = true;
                rim_crossings.push(RimCrossing {
                    edge: edge_key(self.bits.shape, start, axis),
                    upward: end == 0,
                    across,
                    across_upward: !upward,
                    at: [x, 1.0 - y, z],
                    plain: raw,
                    gave_way: false,
                });
            }
        }
        for rim in rims.into_iter().flatten() {
            edge.rim_slots |= 1 << (2 * slot + rim.end);
            edge.rims.push(rim);
        }
    }

    /// The crossing of an edge by padded indices, where the field has it.
    fn crossing(&self, low: [i64; 3], axis: u8, values: &[f32]) -> Crossing {
        crossing_at(self.bits, values, low.map(|i| i as usize), usize::from(axis))
    }

    /// Fraction of a crossed edge from its inside end, before the blade.
    fn skin_fraction(&self, low: [i64; 3], axis: u8, values: &[f32]) -> f32 {
        let crossing = self.crossing(low, axis, values);
        let mut inside = low;
        inside[usize::from(axis)] += i64::from(!crossing.upward);
        let limited = |particle| self.blades.limit(particle, usize::from(axis), crossing.upward, crossing.t);
        self.at(inside).map_or(crossing.t, limited)
    }

    /// The two places where the skin enters a face, seen from the corner of a lip; `None` where it does not.
    fn skin_ends(&self, face: Face, side: &Side, values: &[f32]) -> Option<[[f32; 2]; 2]> {
        let inside = |corner: u8| face.inside >> corner & 1 == 1;
        let at = |(low, axis)| self.crossing(low, axis, values).t;
        let ends = match (inside(side.above), inside(side.opposite)) {
            (false, false) => [[0.0, at(side.own)], [1.0, at(side.far)]],
            (false, true) => [[0.0, at(side.own)], [1.0 - at(side.facing), 1.0]],
            (true, false) => [[at(side.facing), 1.0], [1.0, at(side.far)]],
            (true, true) => return None,
        };
        Some(ends)
    }

    /// What stands opposite a rim's corner.
    fn beyond(&self, face: Face, side: &Side, values: &[f32]) -> Beyond {
        if face.inside >> side.opposite & 1 == 0 {
            return Beyond::Nothing;
        }
        if face.cut >> side.far_edge & 1 == 1 {
            return Beyond::Corner;
        }
        let (start, axis) = side.facing;
        Beyond::Sheet(1.0 - self.skin_fraction(start, axis, values))
    }

    /// Crossings of the skin round a particle that the blade has passed: the skin of its side ends where the blade meets it.
    fn passed_crossings(&self, particle: u32, values: &[f32]) -> Vec<RimCrossing> {
        let here = self.lattice.ijk(particle).map(|i| i as i64 + 1);
        let mut found = Vec::new();
        if self.at(here) != Some(particle) {
            return found;
        }
        let Some(plane) = self.blades.near(self.lattice, self.alive, particle) else { return found };
        for (axis, upward) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
            let there = stepped(here, axis, upward);
            if self.at(there).is_some() {
                continue;
            }
            let t = self.skin(here, axis, upward, values);
            let mut add = |at: [f32; 3], across: usize, across_upward: bool| {
                found.push(RimCrossing {
                    edge: edge_key(self.bits.shape, if upward { here } else { there }, axis as u8),
                    upward,
                    across: across as u8,
                    across_upward,
                    at,
                    plain: t,
                    gave_way: false,
                });
            };
            let mut met = false;
            for (across, across_upward) in (1..3).flat_map(|n| [((axis + n) % 3, false), ((axis + n) % 3, true)]) {
                let ways = [(axis, upward), (across, across_upward)];
                let blade = plane.seen_along(ways);
                if blade.past([t, 0.0, 0.0]) <= 0.0 {
                    break;
                }
                if let Some(at) = blade.meets([[t, 0.0], self.skin_end(here, ways, values)]) {
                    met = true;
                    add(at, across, across_upward);
                }
            }
            let across = (axis + 1) % 3;
            let blade = plane.seen_along([(axis, upward), (across, true)]);
            if !met && blade.past([t, 0.0, 0.0]) > 0.0 {
                let normal = self.skin_normal(here, axis, upward, values);
                let along = [normal[axis] * if upward { 1.0 } else { -1.0 }, normal[across], normal[3 - axis - across]];
                if let Some(at) = blade.meets_near([t, 0.0, 0.0], along) {
                    add(at, across, true);
                }
            }
        }
        found
    }

    /// Fraction at which the skin crosses the edge from an inside point along an axis.
    fn skin(&self, from: [i64; 3], axis: usize, upward: bool, values: &[f32]) -> f32 {
        let low = if upward { from } else { stepped(from, axis, false) };
        self.crossing(low, axis as u8, values).t
    }

    /// Where the skin that crosses the edge from a point along the first way leaves the face between both ways.
    fn skin_end(&self, here: [i64; 3], ways: [(usize, bool); 2], values: &[f32]) -> [f32; 2] {
        let [(axis, upward), (across, across_upward)] = ways;
        let beside = stepped(here, across, across_upward);
        let opposite = stepped(beside, axis, upward);
        match (self.at(beside).is_some(), self.at(opposite).is_some()) {
            (false, _) => [0.0, self.skin(here, across, across_upward, values)],
            (true, false) => [self.skin(beside, axis, upward, values), 1.0],
            (true, true) => [1.0, 1.0 - self.skin(opposite, across, !across_upward, values)],
        }
    }

    /// Outward normal of the skin where it crosses the edge from a point along an axis, from the faces at that edge.
    fn skin_normal(&self, here: [i64; 3], axis: usize, upward: bool, values: &[f32]) -> [f32; 3] {
        let sign = if upward { 1.0 } else { -1.0 };
        let mut normal = [sign; 3];
        for across in [(axis + 1) % 3, (axis + 2) % 3] {
            let [up, down] = [true, false].map(|way| self.skin_end(here, [(axis, upward), (across, way)], values));
            normal[across] = (down[0] - up[0]) / (up[1] + down[1]);
        }
        normal
    }

    fn cell_state(&self, key: u64, keys: &[u64], edges: &[SeamEdge], rim_crossings: &[RimCrossing]) -> CellState {
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
            let key = edge_key(self.bits.shape, one.0, (edge / 4) as u8);
            if self.linked(one, two) {
                cell.alive |= 1 << edge;
            } else if one.1.is_some() != two.1.is_some() {
                let on_rim = rim_crossings.binary_search_by_key(&key, |crossing| crossing.edge).is_ok();
                cell.rims.crossings |= u16::from(on_rim) << edge;
            } else if one.1.is_some()
                && let Ok(index) = keys.binary_search(&key)
            {
                cell.cut |= 1 << edge;
                seam_edges.push((edge as u8, index as u32));
            }
        }
        for (face, ring) in RINGS.iter().enumerate() {
            for m in 0..2 {
                let [one, two] = [ring[m], ring[m + 2]].map(|corner| corners[usize::from(corner)]);
                cell.diagonals |= u16::from(self.linked(one, two)) << (2 * face + m);
            }
        }
        for &(edge, index) in &seam_edges {
            cell.rims.behind |= behind(&edges[index as usize], edge);
        }
        CellState { low: low.map(|i| i as u32), cell, seam_edges }
    }
}

/// Rims of an edge of a cell that lie in the face of the cut, as in [`super::marching_cubes::cell::Rims::behind`].
fn behind(seam_edge: &SeamEdge, edge: u8) -> u64 {
    let mut found = 0;
    for (face, ring_edges) in (0_u8..).zip(RING_EDGES) {
        let Some(m) = ring_edges.iter().position(|&other| other == edge) else { continue };
        let slot = face_slot(face, edge);
        for rim in seam_edge.rims.iter().filter(|rim| rim.behind && seam_edge.slot_of(rim) == slot) {
            let corner = EDGES[usize::from(edge)][usize::from(rim.end)];
            let ring_end = u8::from(RINGS[usize::from(face)][m] != corner);
            found |= 1 << (8 * face + 2 * m as u8 + ring_end);
        }
    }
    found
}

/// The next point along an axis.
fn stepped(mut point: [i64; 3], axis: usize, upward: bool) -> [i64; 3] {
    point[axis] += if upward { 1 } else { -1 };
    point
}

/// A face seen from the corner of a lip on its ring edge `m`: lower end and axis of its other edges.
struct Side {
    /// From the corner to the one above it, along the axis across the cut edge.
    own: ([i64; 3], u8),
    /// From the far end of the cut edge to the corner opposite.
    far: ([i64; 3], u8),
    /// The edge that faces the cut one.
    facing: ([i64; 3], u8),
    far_edge: u8,
    above: u8,
    opposite: u8,
}

impl Side {
    fn new(low: [i64; 3], normal: usize, m: usize, corner: u8) -> Self {
        let (own, far) = if usize::from(corner) == m { ((m + 3) % 4, (m + 1) % 4) } else { ((m + 1) % 4, (m + 3) % 4) };
        let edge = |edge: usize| ring_edge_at(low, normal, edge);
        Self {
            own: edge(own),
            far: edge(far),
            facing: edge((m + 2) % 4),
            far_edge: far as u8,
            above: if usize::from(corner) == m { (corner + 3) % 4 } else { (corner + 1) % 4 },
            opposite: corner ^ 2,
        }
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
