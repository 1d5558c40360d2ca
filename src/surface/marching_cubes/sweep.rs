//! Numbering of vertices and triangles over the whole grid, layer by layer.
//!
//! ```text
//! count:   crossings of each row (bits of neighbouring rows xor-ed), then running sums      -> first id of every row
//! vertices: per layer in parallel: every crossing in the order of its id
//! triangles: per layer of cells in parallel: only cells whose corners differ; ids by counting along the row
//! ```
//! Layer `k` owns the vertices on edges that start there, the seam vertices of those edges and the centres of the
//! cells above it. The triangles of cell layer `k` use the vertices of layers `k` and `k + 1` only, which is what lets
//! the passes over the finished mesh run in parallel without ever changing an answer.

use rayon::prelude::*;

use super::bits::{InsideBits, next_point};
use super::cell::Site;
use super::cube::{EDGES, RING_EDGES, RINGS, face_slot};
use super::table::CASES;
use crate::surface::SurfaceError;
use crate::surface::seam::{Seam, SeamCell};

/// Crossings are kept this far from both ends of their edge, as a fraction of it, so that no triangle degenerates.
pub(crate) const CLEARANCE: f32 = 0.02;

/// The far end is kept clear by this share more: an edge between two organs has a crossing from either end, and they must not meet.
const FAR_CLEARANCE: f32 = 1.1 * CLEARANCE;

/// Where the surface crosses an edge, as a fraction from its inside end: the zero of linear interpolation.
///
/// Half-way where the outside end has no value (beyond the grid, NaN) or would be inside but holds no particle.
#[inline]
pub(crate) fn crossing_fraction(inside: f32, outside: Option<f32>) -> f32 {
    let t = match outside {
        Some(outside) if outside <= 0.0 => inside / (inside - outside),
        _ => 0.5,
    };
    if t.is_finite() { t.clamp(CLEARANCE, 1.0 - FAR_CLEARANCE) } else { 0.5 }
}

/// A crossing between an inside and an outside point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Crossing {
    /// Lower end of the edge, padded indices.
    pub(crate) low: [usize; 3],
    /// Axis of the edge.
    pub(crate) axis: usize,
    /// True when the lower end is the inside one.
    pub(crate) upward: bool,
    /// Fraction of the edge from the inside end.
    pub(crate) t: f32,
}

/// First ids of everything: rows of crossings, seam edges, centres, layers.
#[derive(Debug, Clone)]
pub(crate) struct Numbering {
    /// First id of the x, y and z crossings of each padded row.
    rows: Vec<[u32; 3]>,
    /// First vertex of each layer; one entry more than there are layers.
    pub(crate) layers: Vec<u32>,
    /// First vertex of each seam edge.
    pub(crate) seam_edges: Vec<u32>,
    /// First centre of each seam cell.
    pub(crate) centres: Vec<u32>,
}

impl Numbering {
    /// Counts and numbers the vertices.
    pub(crate) fn new(bits: &InsideBits, seam: &Seam) -> Result<Self, SurfaceError> {
        let (rows_per_layer, layers) = (bits.shape.ny + 2, bits.shape.nz + 2);
        let mut rows = vec![[0_u32; 3]; rows_per_layer * layers];
        rows.par_chunks_mut(rows_per_layer).enumerate().for_each(|(k, rows)| {
            for (j, row) in rows.iter_mut().enumerate() {
                *row = [0, 1, 2].map(|axis| (0..bits.words).map(|w| crossed(bits, axis, j, k, w).count_ones()).sum());
            }
        });
        let mut total = 0_usize;
        let mut take = |count: usize| {
            let first = u32::try_from(total);
            total += count;
            first.map_err(|_| SurfaceError::TooManyVertices)
        };
        let mut numbering = Self {
            rows: Vec::new(),
            layers: Vec::with_capacity(layers + 1),
            seam_edges: Vec::with_capacity(seam.edges.len()),
            centres: Vec::with_capacity(seam.cells.len()),
        };
        for (k, rows) in rows.chunks_mut(rows_per_layer).enumerate() {
            numbering.layers.push(take(0)?);
            for count in rows.iter_mut().flatten() {
                *count = take(*count as usize)?;
            }
            for edge in seam.edges_of_layer(k) {
                numbering.seam_edges.push(take(edge.vertex_count())?);
            }
            for cell in seam.cells_of_layer(k) {
                numbering.centres.push(take(cell.patch.centres.len())?);
            }
        }
        numbering.layers.push(take(0)?);
        numbering.rows = rows;
        Ok(numbering)
    }

    /// Number of vertices.
    pub(crate) fn vertex_count(&self) -> usize {
        self.layers[self.layers.len() - 1] as usize
    }

    fn row(&self, bits: &InsideBits, j: usize, k: usize) -> [u32; 3] {
        self.rows[k * (bits.shape.ny + 2) + j]
    }
}

/// Crossings of word `w` along an axis: bit `i` tells whether point `i` and the next one along the axis differ.
#[inline]
fn crossed(bits: &InsideBits, axis: usize, j: usize, k: usize, w: usize) -> u64 {
    let row = bits.row(j, k);
    match axis {
        0 => row[w] ^ next_point(row, w),
        1 if j <= bits.shape.ny => row[w] ^ bits.row(j + 1, k)[w],
        2 if k <= bits.shape.nz => row[w] ^ bits.row(j, k + 1)[w],
        _ => 0,
    }
}

/// Makes one value per crossing, at the place of its id; the places of seam vertices and centres keep `V::default()`.
pub(crate) fn crossing_values<V: Default + Clone + Send>(
    bits: &InsideBits,
    values: &[f32],
    numbering: &Numbering,
    make: impl Fn(Crossing) -> V + Sync,
) -> Vec<V> {
    let mut out = vec![V::default(); numbering.vertex_count()];
    let layers = split_layers(&mut out, &numbering.layers);
    layers.into_par_iter().enumerate().for_each(|(k, layer)| {
        let mut slots = layer.iter_mut();
        each_crossing(bits, k, |low, axis| {
            if let Some(slot) = slots.next() {
                *slot = make(crossing_at(bits, values, low, axis));
            }
        });
    });
    out
}

/// Visits the crossings of a layer in the order of their ids: lower end (padded indices) and axis.
pub(crate) fn each_crossing(bits: &InsideBits, k: usize, mut visit: impl FnMut([usize; 3], usize)) {
    for j in 0..bits.shape.ny + 2 {
        for axis in 0..3 {
            for w in 0..bits.words {
                let mut left = crossed(bits, axis, j, k, w);
                while left != 0 {
                    let low = [64 * w + left.trailing_zeros() as usize, j, k];
                    left &= left - 1;
                    visit(low, axis);
                }
            }
        }
    }
}

/// The crossing on an edge that has one.
pub(crate) fn crossing_at(bits: &InsideBits, values: &[f32], low: [usize; 3], axis: usize) -> Crossing {
    let value = |[i, j, k]: [usize; 3]| {
        let [nx, ny, nz] = bits.shape.dims();
        let within = (1..=nx).contains(&i) && (1..=ny).contains(&j) && (1..=nz).contains(&k);
        within.then(|| values[bits.shape.linear([i - 1, j - 1, k - 1])])
    };
    let mut high = low;
    high[axis] += 1;
    let upward = bits.get(low);
    let (inside, outside) = if upward { (low, high) } else { (high, low) };
    let t = value(inside).map_or(0.5, |inside| crossing_fraction(inside, value(outside)));
    Crossing { low, axis, upward, t }
}

/// Cuts a slice into the parts of the layers whose first ids are given.
pub(crate) fn split_layers<'a, V>(mut values: &'a mut [V], layers: &[u32]) -> Vec<&'a mut [V]> {
    let mut parts = Vec::with_capacity(layers.len());
    for pair in layers.windows(2) {
        let (part, rest) = values.split_at_mut((pair[1] - pair[0]) as usize);
        parts.push(part);
        values = rest;
    }
    parts
}

/// Triangles and where each layer of cells begins among them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct LayeredTriangles {
    pub(crate) triangles: Vec<[u32; 3]>,
    /// First triangle of each layer; one entry more than there are layers.
    pub(crate) layers: Vec<u32>,
}

/// Draws every cell. `flip` reverses the triangles, for grids whose axes are left-handed in patient space.
pub(crate) fn triangles(
    bits: &InsideBits,
    seam: &Seam,
    numbering: &Numbering,
    flip: bool,
) -> Result<LayeredTriangles, SurfaceError> {
    let layers: Vec<Vec<[u32; 3]>> = (0..bits.shape.nz + 1)
        .into_par_iter()
        .map(|k| {
            let expected = 2 * (numbering.layers[k + 1] - numbering.layers[k]) as usize;
            let mut triangles = Vec::with_capacity(expected + expected / 16);
            for j in 0..bits.shape.ny + 1 {
                CellRow { bits, seam, numbering, j, k }.draw(&mut triangles);
            }
            if flip {
                triangles.iter_mut().for_each(|triangle: &mut [u32; 3]| triangle.swap(1, 2));
            }
            triangles
        })
        .collect();
    let mut first = vec![0_u32];
    let mut total = 0;
    for layer in &layers {
        total += layer.len();
        first.push(u32::try_from(total).map_err(|_| SurfaceError::TooManyVertices)?);
    }
    let mut triangles = vec![[0; 3]; total];
    let parts = split_layers(&mut triangles, &first);
    parts.into_par_iter().zip(&layers).for_each(|(part, layer)| part.copy_from_slice(layer));
    Ok(LayeredTriangles { triangles, layers: first })
}

/// One row of cells.
struct CellRow<'a> {
    bits: &'a InsideBits,
    seam: &'a Seam,
    numbering: &'a Numbering,
    j: usize,
    k: usize,
}

impl CellRow<'_> {
    fn draw(&self, out: &mut Vec<[u32; 3]>) {
        let &Self { bits, seam, numbering, j, k } = self;
        let rows = [bits.row(j, k), bits.row(j + 1, k), bits.row(j, k + 1), bits.row(j + 1, k + 1)];
        let first = [(j, k), (j + 1, k), (j, k + 1), (j + 1, k + 1)].map(|(j, k)| numbering.row(bits, j, k));
        // Next id on the x edges of the four rows, on the y edges of two layers, on the z edges of two rows.
        let mut x = first.map(|row| row[0]);
        let mut y = [first[0][1], first[2][1]];
        let mut z = [first[0][2], first[1][2]];
        let (mut special, special_end) = seam.cells_of_row(j, k);
        let cases = &*CASES;
        for w in 0..bits.words {
            let here = rows.map(|row| row[w]);
            let next = rows.map(|row| next_point(row, w));
            let any = here.iter().chain(&next).fold(0, |a, b| a | b);
            let all = here.iter().chain(&next).fold(!0, |a, b| a & b);
            let mut active = any & !all;
            let mut special_here = 0_u64;
            let mut ahead = special;
            while ahead < special_end && seam.cells[ahead].column() / 64 == w {
                special_here |= 1 << (seam.cells[ahead].column() % 64);
                ahead += 1;
            }
            active |= special_here;
            if active == 0 {
                continue;
            }
            let x_cross = [0, 1, 2, 3].map(|row| here[row] ^ next[row]);
            let y_cross = [here[0] ^ here[1], here[2] ^ here[3]];
            let z_cross = [here[0] ^ here[2], here[1] ^ here[3]];
            while active != 0 {
                let bit = active.trailing_zeros();
                active &= active - 1;
                let at = |word: u64| (word >> bit & 1) as u32;
                // Ids of the twelve edges; meaningless, and never used, where an edge has no crossing.
                let ids = [
                    x[0],
                    x[1],
                    x[2],
                    x[3],
                    y[0],
                    y[1],
                    y[0] + at(y_cross[0]),
                    y[1] + at(y_cross[1]),
                    z[0],
                    z[0] + at(z_cross[0]),
                    z[1],
                    z[1] + at(z_cross[1]),
                ];
                if special_here >> bit & 1 == 1 {
                    self.draw_special(special, &ids, out);
                    special += 1;
                } else {
                    let mut case = 0;
                    for row in 0..4 {
                        case |= (at(here[row]) | at(next[row]) << 1) << (2 * row);
                    }
                    out.extend(cases.triangles(case as u8).iter().map(|t| t.map(|edge| ids[usize::from(edge)])));
                }
                // Every crossing of these rows belongs to an active cell, so counting cell by cell finds them all.
                for row in 0..4 {
                    x[row] += at(x_cross[row]);
                }
                for side in 0..2 {
                    y[side] += at(y_cross[side]);
                    z[side] += at(z_cross[side]);
                }
            }
        }
    }

    /// A cell with dead springs: its patch was worked out beforehand.
    fn draw_special(&self, index: usize, ids: &[u32; 12], out: &mut Vec<[u32; 3]>) {
        let cell: &SeamCell = &self.seam.cells[index];
        let seam_edge = |edge: u8| {
            let at = cell.seam_edges.iter().find(|entry| entry.0 == edge).map_or(0, |entry| entry.1 as usize);
            (&self.seam.edges[at], self.numbering.seam_edges[at])
        };
        let id = |code: u8| match Site::from_code(code) {
            Site::Skin { edge } => ids[usize::from(edge)],
            Site::Lip { edge, end } => seam_edge(edge).1 + u32::from(end),
            Site::Front { face, ring_edge } => {
                let edge = RING_EDGES[usize::from(face)][usize::from(ring_edge)];
                let (seam_edge, first) = seam_edge(edge);
                first + seam_edge.front_place(face_slot(face, edge))
            }
            Site::Rim { face, ring_edge, ring_end } => {
                let edge = RING_EDGES[usize::from(face)][usize::from(ring_edge)];
                let corner = RINGS[usize::from(face)][usize::from(ring_edge + ring_end) % 4];
                let end = u8::from(corner == EDGES[usize::from(edge)][1]);
                let (seam_edge, first) = seam_edge(edge);
                first + seam_edge.rim_place(face_slot(face, edge), end)
            }
            Site::Centre { index: centre } => self.numbering.centres[index] + u32::from(centre),
        };
        out.extend(cell.patch.triangles.iter().map(|t| t.map(id)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::GridShape;
    use crate::surface::marching_cubes::cell::Cell;
    use crate::surface::marching_cubes::cube::corner_offset;

    /// Every cell of a field as if it had a dead spring, so that all of them take the general path.
    fn all_cells_general(bits: &InsideBits) -> Seam {
        let GridShape { nx, ny, nz } = bits.shape;
        let mut seam = Seam::none();
        for k in 0..=nz {
            for j in 0..=ny {
                for i in 0..=nx {
                    let inside = (0..8).fold(0, |inside, corner| {
                        let [x, y, z] = corner_offset(corner);
                        inside | u8::from(bits.get([i + x, j + y, k + z])) << corner
                    });
                    let low = [i as u32, j as u32, k as u32];
                    seam.cells.push(SeamCell { low, patch: Cell::intact(inside).patch(), seam_edges: Vec::new() });
                }
            }
        }
        seam
    }

    #[test]
    fn the_table_and_the_general_path_draw_the_same() {
        let mut state = 1_u32;
        for nx in [1, 2, 7, 61, 62, 63, 64, 65, 126, 127, 130] {
            let shape = GridShape::new(nx, 4, 3);
            let values: Vec<f32> = (0..shape.len())
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 8) as f32 / (1 << 23) as f32 - 1.0
                })
                .collect();
            let bits = InsideBits::new(shape, &values, None);
            let (plain, general) = (Seam::none(), all_cells_general(&bits));
            let numbering = Numbering::new(&bits, &plain).unwrap();
            let with_cells = Numbering::new(&bits, &general).unwrap();
            assert_eq!(numbering.layers, with_cells.layers);
            let table = triangles(&bits, &plain, &numbering, false).unwrap();
            assert!(!table.triangles.is_empty());
            assert_eq!(table, triangles(&bits, &general, &with_cells, false).unwrap(), "{nx}");
        }
    }

    #[test]
    fn crossings_keep_clear_of_grid_points() {
        for (inside, outside) in [(1.0, Some(-1e-9)), (f32::MIN_POSITIVE, Some(-1.0)), (f32::INFINITY, Some(-1.0))] {
            let t = crossing_fraction(inside, outside);
            assert!((CLEARANCE..=1.0 - CLEARANCE).contains(&t), "{inside} {outside:?}: {t}");
        }
        assert_eq!(crossing_fraction(1.0, Some(-3.0)), 0.25);
        assert_eq!([None, Some(f32::NAN), Some(2.0)].map(|outside| crossing_fraction(1.0, outside)), [0.5; 3]);
    }
}
