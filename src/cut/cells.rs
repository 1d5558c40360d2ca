//! The cells of the deformed lattice that a piece of an edge may meet in a test, and where a place in one of them is at rest.

use std::ops::ControlFlow;

use arrayvec::ArrayVec;
use rayon::prelude::*;

use super::blade::Piece;
use super::bounds::Bounds;
use super::cube_ranges::{CubeRange, CubeRanges};
use super::sheet::STEP;
use super::tissue::{Part, Tissue};
use super::trilinear::{REACH, local, outside};
use crate::geometry::Vector3;
use crate::lattice::{Lattice, NO_PARTICLE};

/// So many cells nearest to a place are asked, when none holds it.
const MOST_NEAR: usize = 8;
/// A cell over more cubes than this is stretched too far to say where a place in it was at rest.
const MOST_CUBES: i64 = 4096;
/// Marks a grid point without a particle.
const NO_SLOT: u32 = u32::MAX;

/// The cells a piece of a sweep may meet.
pub(super) struct Cells<'a> {
    tissue: &'a Tissue<'a>,
    list: Vec<Cell>,
    /// Cubes of a pitch that the box of each cell meets; none for one that is stretched too far.
    cubes: CubeRanges,
    /// Box of all of them; `None` without any.
    all: Option<Bounds>,
    /// Largest distance that one of their corners moves during the whole test [m].
    longest_move: f64,
}

/// A cell, all of whose corners hold particles.
struct Cell {
    /// Grid index of its lowest corner.
    ijk: [usize; 3],
    /// Slots of its corners, x fastest.
    slots: [u32; 8],
    /// Its box, from the beginning to the end of the test [m].
    bounds: Bounds,
}

impl<'a> Cells<'a> {
    pub(super) fn near(tissue: &'a Tissue<'a>, piece: &Piece) -> Self {
        let reach = Bounds::of(piece, 2.0 * REACH * tissue.lattice.pitch);
        // A cell reaches one pitch up from its lowest corner.
        let parts = tissue.parts_near(&reach, [0.0, 1.0]);
        let found: Vec<(Vec<Cell>, f64)> =
            parts.par_iter().map_init(Points::default, |points, part| points.cells(tissue, part, &reach)).collect();
        let longest_squared = found.iter().map(|&(_, longest)| longest).fold(0.0, f64::max);
        let mut list = Vec::with_capacity(found.iter().map(|(cells, _)| cells.len()).sum());
        found.into_iter().for_each(|(mut cells, _)| list.append(&mut cells));
        let cubes = CubeRanges::new(list.iter().map(|cell| cubes_of(&cell.bounds, tissue.lattice.pitch)).collect());
        let mut all = Bounds::EMPTY;
        list.iter().for_each(|cell| all.join(&cell.bounds));
        let all = (!list.is_empty()).then_some(all);
        Self { tissue, list, cubes, all, longest_move: longest_squared.sqrt() }
    }

    pub(super) fn lattice(&self) -> &'a Lattice {
        self.tissue.lattice
    }

    fn pitch(&self) -> f64 {
        self.tissue.lattice.pitch
    }

    /// How far the piece goes through the tissue, at most [m]; 0 where there is none.
    pub(super) fn way(&self, piece: &Piece) -> f64 {
        let shared = piece.during[1] - piece.during[0];
        if self.list.is_empty() { 0.0 } else { piece.stroke.norm() + self.longest_move * shared }
    }

    /// Shares of the edge and of its stroke between which the piece may meet the cells or come within reach of them.
    pub(super) fn shares(&self, piece: &Piece) -> Option<[[f64; 2]; 2]> {
        let all = self.all?;
        let margin = Vector3::repeat((REACH + STEP) * self.pitch());
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

    /// Index at rest of what is at a place at a share of the test [m]: from the first cell that holds it, else from the nearest
    /// within reach.
    pub(super) fn rest_of(&self, place: Vector3, share: f64) -> Option<Vector3> {
        let pitch = self.pitch();
        let cube = cell_of(place / pitch);
        let found = |cell: &Cell| {
            let local = local(&self.corner_places(cell, share), place)?;
            let [i, j, k] = cell.ijk;
            Some((Vector3::new(i as f64, j as f64, k as f64), local))
        };
        let mut inside = None;
        self.cubes.visit(&CubeRange { low: cube, high: cube }, &mut |number| {
            let cell = &self.list[number];
            // Far above what Newton's method leaves of a place.
            let beside = 1e-6 * (cell.bounds.max - cell.bounds.min).norm() + 1e-9 * pitch;
            if !cell.bounds.grown(beside).holds(place) {
                return ControlFlow::Continue(());
            }
            match found(cell) {
                Some((low, local)) if outside(&local) <= 1e-9 => {
                    inside = Some(low + local);
                    ControlFlow::Break(())
                }
                _ => ControlFlow::Continue(()),
            }
        });
        if inside.is_some() {
            return inside;
        }
        // Not inside any: the nearest cells by their boxes, and among them the one it is least outside of.
        let around = CubeRange { low: cube.map(|i| i.saturating_sub(2)), high: cube.map(|i| i.saturating_add(2)) };
        let mut near = ArrayVec::<(f64, usize), { MOST_NEAR + 1 }>::new();
        self.cubes.visit(&around, &mut |number| {
            let distance = self.list[number].bounds.distance(place);
            // Behind those as near, whose numbers are lower.
            let at = near.partition_point(|(other, _)| other.total_cmp(&distance).is_le());
            if at < MOST_NEAR {
                near.insert(at, (distance, number));
                near.truncate(MOST_NEAR);
            }
            ControlFlow::Continue(())
        });
        let found = near.iter().filter_map(|&(_, number)| found(&self.list[number]));
        let (low, local) = found.min_by(|(_, a), (_, b)| outside(a).total_cmp(&outside(b)))?;
        (outside(&local) <= REACH).then(|| low + local)
    }

    fn corner_places(&self, cell: &Cell, share: f64) -> [Vector3; 8] {
        let pitch = self.pitch();
        let mut places = [Vector3::zeros(); 8];
        for (corner, place) in places.iter_mut().enumerate() {
            let up = [corner & 1, corner >> 1 & 1, corner >> 2];
            let [before, now] = self.tissue.displacements(cell.slots[corner] as usize);
            for axis in 0..3 {
                let moved = before[axis] + (now[axis] - before[axis]) * share;
                place[axis] = (cell.ijk[axis] + up[axis]) as f64 * pitch + moved;
            }
        }
        places
    }
}

/// The grid points of a part of a block and one layer above it, x fastest; buffers for one part after the other.
#[derive(Default)]
struct Points {
    /// [`NO_SLOT`] where there is no particle.
    slots: Vec<u32>,
    /// Where the particle goes during the test, and the square of how far [m^2].
    ways: Vec<(Bounds, f64)>,
}

impl Points {
    /// The cells whose lowest corner is in a part and whose box meets another one, in the order of slots; and the largest
    /// squared move of one of their corners [m^2].
    fn cells(&mut self, tissue: &Tissue<'_>, (block, part): &(usize, Part), reach: &Bounds) -> (Vec<Cell>, f64) {
        self.fill(tissue, *block, part);
        let corner = tissue.layout.corner(*block);
        let [nx, ny] = [part[0].len() + 1, part[1].len() + 1];
        // From a cell's lowest corner to the others, x fastest.
        let steps = [0, 1, nx, nx + 1, nx * ny, nx * ny + 1, nx * ny + nx, nx * ny + nx + 1];
        let (mut cells, mut longest) = (Vec::new(), 0.0_f64);
        for k in 0..part[2].len() {
            for j in 0..part[1].len() {
                for i in 0..part[0].len() {
                    let first = (k * ny + j) * nx + i;
                    let mut slots = [NO_SLOT; 8];
                    for (corner, slot) in slots.iter_mut().enumerate() {
                        *slot = self.slots[first + steps[corner]];
                    }
                    if slots.contains(&NO_SLOT) {
                        continue;
                    }
                    let (mut bounds, mut longest_here) = (Bounds::EMPTY, 0.0);
                    for step in steps {
                        let (way, squared) = &self.ways[first + step];
                        bounds.join(way);
                        longest_here = f64::max(longest_here, *squared);
                    }
                    if !reach.meets(&bounds) {
                        continue;
                    }
                    longest = longest.max(longest_here);
                    let local = [part[0].start + i, part[1].start + j, part[2].start + k];
                    let mut ijk = [0; 3];
                    for (axis, index) in ijk.iter_mut().enumerate() {
                        *index = (corner[axis] + local[axis] as i64) as usize;
                    }
                    cells.push(Cell { ijk, slots, bounds });
                }
            }
        }
        (cells, longest)
    }

    fn fill(&mut self, tissue: &Tissue<'_>, block: usize, part: &Part) {
        self.slots.clear();
        self.ways.clear();
        let &Tissue { lattice, layout, .. } = tissue;
        let (corner, dims) = (layout.corner(block), lattice.grid.shape.dims());
        let shape = lattice.grid.shape;
        for k in part[2].start..=part[2].end {
            for j in part[1].start..=part[1].end {
                let row = [corner[1] + j as i64, corner[2] + k as i64];
                let row_in_grid = (0..2).all(|axis| (0..dims[axis + 1] as i64).contains(&row[axis]));
                for i in part[0].start..=part[0].end {
                    let x = corner[0] + i as i64;
                    let in_grid = row_in_grid && (0..dims[0] as i64).contains(&x);
                    let point = || shape.linear([x as usize, row[0] as usize, row[1] as usize]);
                    if !in_grid || lattice.particle_at[point()] == NO_PARTICLE {
                        self.slots.push(NO_SLOT);
                        self.ways.push((Bounds::EMPTY, 0.0));
                        continue;
                    }
                    let at = [i as i64, j as i64, k as i64];
                    let slot = layout.slot_beside(block, at).expect("a particle has a slot");
                    let [before, now] = tissue.displacements(slot);
                    let rest = Vector3::new(x as f64, row[0] as f64, row[1] as f64) * lattice.pitch;
                    // As `corner_places` rounds it at the end of the test.
                    let last = before + (now - before);
                    let mut way = Bounds::EMPTY;
                    way.include(rest + before);
                    way.include(rest + last);
                    self.slots.push(slot as u32);
                    self.ways.push((way, (last - before).norm_squared()));
                }
            }
        }
    }
}

/// The cubes of a pitch that a box meets; none when they are too many.
fn cubes_of(bounds: &Bounds, pitch: f64) -> CubeRange {
    let (low, high) = (cell_of(bounds.min / pitch), cell_of(bounds.max / pitch));
    let cubes: i64 =
        (0..3).map(|axis| high[axis].saturating_sub(low[axis]).saturating_add(1).min(MOST_CUBES)).product();
    if cubes > MOST_CUBES { CubeRange::EMPTY } else { CubeRange { low, high } }
}

pub(super) fn cell_of(index: Vector3) -> [i64; 3] {
    [index.x.floor() as i64, index.y.floor() as i64, index.z.floor() as i64]
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::tissue::displaced;
    use crate::geometry::{Affine, Grid, GridShape, Point3};
    use crate::lattice::build::{NO_ORGAN, build, corners};
    use crate::lattice::layout::BlockLayout;
    use crate::splitmix::SplitMix;
    use crate::volume::Volume;

    /// A ragged lattice, displaced by up to three pitches, against a search through all of its cells without boxes of runs.
    #[test]
    fn all_cells_near_are_found_and_places_in_them() {
        let mut random = SplitMix::new(11);
        let shape = GridShape::new(37, 12, 19);
        let grid = Grid { shape, affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        let organs = (0..shape.len()).map(|_| if random.unit() < 0.03 { NO_ORGAN } else { 0 }).collect();
        let lattice = build(&Volume::from_vec(grid, organs)).unwrap();
        let (layout, h) = (BlockLayout::new(&lattice), lattice.pitch);
        let mut moments = [0, 1].map(|_| [0, 1, 2].map(|_| vec![0.0_f32; layout.slots()]));
        for (particle, &slot) in (0..).zip(&layout.slot) {
            let at = lattice.ijk(particle).map(|i| i as f64);
            let wave = [at[1] / 7.0, at[2] / 5.0, at[0] / 9.0].map(|x| 3.0 * x.sin());
            for (time, moment) in moments.iter_mut().enumerate() {
                for axis in 0..3 {
                    let moved = wave[axis] + 0.1 * time as f64 + 0.2 * random.unit();
                    moment[axis][slot as usize] = (moved * h) as f32;
                }
            }
        }
        let boxes = moments.each_ref().map(displaced);
        let tissue = Tissue::new(&lattice, &layout, (&moments[0], &boxes[0]), (&moments[1], &boxes[1]));
        let (mut inside, mut beside) = (0, 0);
        for _ in 0..20 {
            let mut vector = |size: [f64; 3]| Vector3::from(size.map(|size| size * (2.0 * random.unit() - 1.0) * h));
            let middle = Vector3::new(18.0, 6.0, 9.0) * h + vector([22.0, 9.0, 12.0]);
            let (side, stroke) = (vector([20.0; 3]), vector([1.0; 3]));
            let piece = Piece { origin: Point3::from(middle - 0.5 * side), side, stroke, during: [0.0, 1.0] };
            let cells = Cells::near(&tissue, &piece);
            // Every cell of the lattice, block by block.
            let reach = Bounds::of(&piece, 2.0 * REACH * h);
            let (mut all, shape) = (Vec::new(), lattice.grid.shape);
            for slot in 0..layout.slots() {
                let Some(low) = layout.particle_of_slot(&lattice, slot).map(|particle| lattice.ijk(particle)) else {
                    continue;
                };
                if (0..3).any(|axis| low[axis] + 1 >= shape.dims()[axis]) {
                    continue;
                }
                let corners = corners(shape, shape.linear(low)).map(|point| lattice.particle_at[point]);
                if corners.contains(&NO_PARTICLE) {
                    continue;
                }
                let mut bounds = Bounds::EMPTY;
                for (corner, share) in (0..8).flat_map(|corner| [(corner, 0.0), (corner, 1.0)]) {
                    let [before, now] = tissue.displacements(layout.slot[corners[corner] as usize] as usize);
                    let rest = Vector3::from(lattice.ijk(corners[corner]).map(|i| i as f64)) * h;
                    bounds.include(rest + (before + (now - before) * share));
                }
                if reach.meets(&bounds) {
                    all.push((lattice.ijk(corners[0]), bounds));
                }
            }
            let found: Vec<_> = cells.list.iter().map(|cell| (cell.ijk, cell.bounds.min, cell.bounds.max)).collect();
            assert_eq!(found, all.iter().map(|(ijk, b)| (*ijk, b.min, b.max)).collect::<Vec<_>>());
            for n in 0..=40 {
                let (place, share) = (piece.origin.coords + side * (f64::from(n) / 40.0), f64::from(n % 3) / 2.0);
                let own = cell_of(place / h);
                let meets = |cell: &&Cell, far: i64| {
                    let CubeRange { low, high } = cubes_of(&cell.bounds, h);
                    (0..3).all(|axis| low[axis] <= own[axis] + far && own[axis] - far <= high[axis])
                };
                let solved = |cell: &Cell| {
                    let low = Vector3::from(cell.ijk.map(|i| i as f64));
                    local(&cells.corner_places(cell, share), place).map(|local| (outside(&local), low + local))
                };
                let first = cells.list.iter().filter(|cell| meets(cell, 0)).filter_map(solved).find(|at| at.0 <= 1e-9);
                let mut near: Vec<&Cell> = cells.list.iter().filter(|cell| meets(cell, 2)).collect();
                near.sort_by(|a, b| a.bounds.distance(place).total_cmp(&b.bounds.distance(place)));
                let nearest = near.into_iter().take(MOST_NEAR).filter_map(solved).min_by(|a, b| a.0.total_cmp(&b.0));
                let expected = first.or(nearest.filter(|at| at.0 <= REACH)).map(|at| at.1);
                inside += usize::from(first.is_some());
                beside += usize::from(first.is_none() && expected.is_some());
                assert_eq!(cells.rest_of(place, share), expected);
            }
        }
        assert!(inside > 100 && beside > 50, "{inside} inside a cell, {beside} beside one");
    }
}
