//! Values at the grid points of a lattice, above zero in the tissue of an organ: what the surface is drawn from.
//!
//! Where voxels are particles, the sign of a field follows the organ whatever the field is made of: particles of the organ are
//! above zero, all other points are not. So the surface has the topology of the lattice, and values only decide where on
//! its edge each crossing lies.
//!
//! In a lattice of cells the particles lie on the very border, and smoothing decides on which side of it, with two
//! exceptions: walls between organs stay where they are, and a cell that would vanish altogether keeps its corners.

use rayon::prelude::*;

use super::marching_cubes::surface_in_cells;
use crate::geometry::GridShape;
use crate::lattice::build::{NO_ORGAN, corners};
use crate::lattice::cells::{cells_around, shares};
use crate::lattice::{FRINGE, Lattice, NO_PARTICLE};

/// Smallest magnitude of a smoothed or HU field, where +-1 is well inside or outside. At 0.02 crossings crowd at thin parts and
/// triangles become slivers; at 0.5 every crossing is pinned half-way and staircases are back.
const FLOOR: f32 = 0.1;

/// See [`keep_sign`].
const REBOUND: f32 = 0.5;

/// The same at a point whose only neighbour across the border lies straight ahead, on a flat wall: no sliver can come of it, and
/// walls of cells lie where their corners are.
const FLAT_FLOOR: f32 = 0.005;

/// Passes of [`smoothed`] that suit binary masks: measured on balls of 4 to 14 particles radius, they leave a roughness of 0.04 to 0.07
/// pitch of the 0.17 to 0.20 that [`binary`] has.
pub const SMOOTHING_PASSES: usize = 2;

/// The volume of a smoothed field is brought this close to that of its particles.
const VOLUME_TOLERANCE: f64 = 1e-4;

/// Membership of an organ: +1 at its particles, -1 elsewhere.
pub fn binary(lattice: &Lattice, organ: u8) -> Vec<f32> {
    lattice
        .particle_at
        .par_iter()
        .map(|&particle| {
            let member = particle != NO_PARTICLE && lattice.organ[particle as usize] == organ;
            if member { 1.0 } else { -1.0 }
        })
        .collect()
}

/// How much of an organ there is at each point, from -1 to +1: in a lattice of cells the fill around the point, else [`binary`].
///
/// The sign is that of [`binary`], so thin parts neither vanish nor join.
pub fn filled(lattice: &Lattice, organ: u8) -> Vec<f32> {
    let membership = binary(lattice, organ);
    let field = unsigned(lattice, organ, &membership);
    let floors = floors(lattice, &membership);
    keep_sign(field, &membership, &floors, 0.0)
}

/// [`filled`] before it is given the sign of the membership.
fn unsigned(lattice: &Lattice, organ: u8, membership: &[f32]) -> Vec<f32> {
    if lattice.has_cells() {
        shares(lattice, organ).into_iter().map(|share| 2.0 * share - 1.0).collect()
    } else {
        membership.to_vec()
    }
}

/// Volume of an organ's tissue [cells].
fn tissue_volume(lattice: &Lattice, organ: u8) -> f64 {
    if !lattice.has_cells() {
        return lattice.organ.iter().filter(|&&own| own == organ).count() as f64;
    }
    let cells = lattice.cell_organ.iter().zip(&lattice.cell_fill);
    cells.filter(|(own, _)| **own == organ).map(|(_, &fill)| f64::from(fill)).sum()
}

/// [`filled`] smoothed by `passes` of the binomial filter (1 2 1)/4 along each axis, see [`SMOOTHING_PASSES`]: softens
/// staircases and keeps the volume.
///
/// What the filter took away is filtered and added back once, which halves the shrinking of curved parts; a small constant then
/// brings the volume of the uncut surface within 1e-4 of that of the tissue (not where it is all specks or all flat walls).
/// Points beyond the grid count as outside.
///
/// # Source
/// Tukey, Exploratory data analysis, 1977 ("twicing").
pub fn smoothed(lattice: &Lattice, organ: u8, passes: usize) -> Vec<f32> {
    if passes == 0 {
        return filled(lattice, organ);
    }
    let membership = binary(lattice, organ);
    let base = unsigned(lattice, organ, &membership);
    let smooth = |mut field: Vec<f32>, beyond: f32| {
        for _ in 0..passes {
            field = binomial(lattice.grid.shape, &field, beyond);
        }
        field
    };
    let mut field = smooth(base.clone(), -1.0);
    let lost = smooth(base.iter().zip(&field).map(|(value, smooth)| value - smooth).collect(), 0.0);
    field.par_iter_mut().zip(lost).for_each(|(value, lost)| *value += lost);
    let volume = tissue_volume(lattice, organ);
    let border = Border::new(lattice, organ, membership);
    let shifted = |shift: f32| border.settle(field.iter().map(|value| value + shift).collect());
    shifted(volume_keeping_shift(|shift| volume_in_cells(lattice.grid.shape, &shifted(shift)) / volume - 1.0))
}

/// Zero of an error that grows with the shift, by the Illinois variant of false position.
pub(super) fn volume_keeping_shift(error: impl Fn(f32) -> f64) -> f32 {
    // The contrast between the border and well inside.
    const RANGE: f32 = 1.0;
    let (mut low, mut high) = ((-RANGE, error(-RANGE)), (RANGE, error(RANGE)));
    if !(low.1 < 0.0 && high.1 > 0.0) {
        // Out of reach: nothing but specks, for which more is better, or nothing at all.
        return if high.1 <= 0.0 { RANGE } else { 0.0 };
    }
    for _ in 0..20 {
        let share = (low.1 / (low.1 - high.1)) as f32;
        let at = low.0 + share * (high.0 - low.0);
        let found = error(at);
        if found.abs() < VOLUME_TOLERANCE {
            return at;
        }
        if found < 0.0 {
            low = (at, found);
            high.1 /= 2.0;
        } else {
            high = (at, found);
            low.1 /= 2.0;
        }
    }
    low.0
}

/// Volume inside the surface of a field, in cells of its grid; 0 when there is no surface.
pub(super) fn volume_in_cells(shape: GridShape, field: &[f32]) -> f64 {
    let Ok((positions, triangles)) = surface_in_cells(shape, field) else { return 0.0 };
    let corner = |vertex: u32| nalgebra::Vector3::from(positions[vertex as usize].map(f64::from));
    triangles.iter().map(|t| corner(t[0]).dot(&corner(t[1]).cross(&corner(t[2])))).sum::<f64>() / 6.0
}

/// HU (or any other grey value) at the grid points against a range of tissue, within one organ.
///
/// Above zero where `range[0] < hu < range[1]`; an open end is an infinite one. Values are measured in units of
/// `width` \[HU\], the contrast over which the border of the organ is drawn; for their sign see the module.
/// NaN counts as the border of the organ.
///
/// # Panics
/// If there is not one value per grid point.
pub fn from_hu(lattice: &Lattice, organ: u8, hu: &[f32], range: [f32; 2], width: f32) -> Vec<f32> {
    assert_eq!(hu.len(), lattice.grid.shape.len(), "one value per grid point");
    let field = hu.par_iter().map(|&hu| (hu - range[0]).min(range[1] - hu) / width).collect();
    Border::new(lattice, organ, binary(lattice, organ)).settle(field)
}

/// Share by which [`part_walls`] deepens a field beyond a wall: half-way between two particles, the wall then stands back by 0.0025 of a
/// pitch, and by 0.0008 at the ends of what smoothing leaves. Welding needs about 0.001 between both walls.
pub(crate) const WALL: f32 = 0.01;

/// Makes the walls of all organs meet: where two touch, both draw their wall half-way between what each would have, point by point.
///
/// Smoothing moves the wall of each organ on its own, by some hundredths of a pitch either way, to keep the volume of each; without
/// this, walls of two organs pass through each other. Skins stay where they are.
///
/// - `fields`: one per organ, as [`smoothed`] gives them.
///
/// # Panics
/// If a field has not one value per grid point.
pub fn join_walls(lattice: &Lattice, fields: &mut [Vec<f32>]) {
    assert!(fields.iter().all(|field| field.len() == lattice.particle_at.len()), "one value per grid point");
    for (point, &particle) in lattice.particle_at.iter().enumerate().filter(|point| *point.1 != NO_PARTICLE) {
        let owner = usize::from(lattice.organ[particle as usize]);
        let Some(own) = fields.get(owner).map(|field| field[point]).filter(|own| *own > 0.0) else { continue };
        for (_, field) in fields.iter_mut().enumerate().filter(|(organ, _)| *organ != owner) {
            field[point] = -own;
        }
    }
}

/// Sets the walls of an organ back from the organs it touches, by 0.001 to 0.0025 pitch.
///
/// Two organs drawn from [`binary`] fields share every vertex of their common wall, and so do many of [`smoothed`] ones. Readers that
/// weld vertices by place, as STL needs, would find edges with four triangles there.
///
/// Not guaranteed: that walls do not pass through each other, unless [`join_walls`] went before.
///
/// # Panics
/// If there is not one value per grid point.
pub fn part_walls(lattice: &Lattice, organ: u8, field: &mut [f32]) {
    assert_eq!(field.len(), lattice.particle_at.len(), "one value per grid point");
    field.par_iter_mut().zip(&lattice.particle_at).for_each(|(value, &particle)| {
        if particle != NO_PARTICLE && ![organ, NO_ORGAN].contains(&lattice.organ[particle as usize]) {
            *value *= 1.0 + WALL;
        }
    });
}

/// Which points may change sides.
struct Border<'a> {
    lattice: &'a Lattice,
    organ: u8,
    membership: Vec<f32>,
    /// Points of a lattice of cells that are the organ's or nobody's, and touch no other organ.
    free: Vec<bool>,
}

const AHEAD: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];

impl<'a> Border<'a> {
    fn new(lattice: &'a Lattice, organ: u8, membership: Vec<f32>) -> Self {
        let shape = lattice.grid.shape;
        let foreign = |point: usize| match lattice.particle_at[point] {
            NO_PARTICLE => false,
            particle => ![organ, FRINGE].contains(&lattice.organ[particle as usize]),
        };
        let foreign_cell = |cell: usize| match lattice.particle_at[cell] {
            NO_PARTICLE => false,
            particle => ![organ, NO_ORGAN].contains(&lattice.cell_organ[particle as usize]),
        };
        let is_free = |point: usize| {
            let ijk = shape.ijk(point);
            lattice.particle_at[point] != NO_PARTICLE
                && !cells_around(shape, point).any(foreign_cell)
                && !AHEAD.iter().filter_map(|&offset| shape.neighbour(ijk, offset)).any(foreign)
        };
        let free = match lattice.has_cells() {
            true => (0..shape.len()).into_par_iter().map(is_free).collect(),
            false => Vec::new(),
        };
        Self { lattice, organ, membership, free }
    }

    /// Gives every value its sign and at least the smallest magnitude.
    fn settle(&self, field: Vec<f32>) -> Vec<f32> {
        if !self.lattice.has_cells() {
            let floors = vec![FLOOR; field.len()];
            return keep_sign(field, &self.membership, &floors, REBOUND);
        }
        let side = |point: usize| match self.free[point] {
            // NaN is outside.
            true => {
                if field[point] > 0.0 {
                    1.0
                } else {
                    -1.0
                }
            }
            false => self.membership[point],
        };
        let sides: Vec<f32> = (0..field.len()).into_par_iter().map(side).collect();
        let settled: Vec<f32> = (0..field.len())
            .into_par_iter()
            .map(|point| if self.is_last_of_a_cell(point, &sides) { 1.0 } else { sides[point] })
            .collect();
        let floors = floors(self.lattice, &settled);
        keep_sign(field, &settled, &floors, 0.0)
    }

    /// Whether a point of the organ has a cell around it that would vanish altogether.
    fn is_last_of_a_cell(&self, point: usize, sides: &[f32]) -> bool {
        let Self { lattice, organ, .. } = self;
        self.membership[point] > 0.0
            && sides[point] < 0.0
            && cells_around(lattice.grid.shape, point).any(|cell| match lattice.particle_at[cell] {
                NO_PARTICLE => false,
                particle => {
                    lattice.cell_organ[particle as usize] == *organ
                        && lattice.cell_fill[particle as usize] >= 0.5
                        && corners(lattice.grid.shape, cell).iter().all(|&corner| sides[corner] < 0.0)
                }
            })
    }
}

/// Smallest magnitude of the field at every point of a lattice of cells.
fn floors(lattice: &Lattice, membership: &[f32]) -> Vec<f32> {
    let shape = lattice.grid.shape;
    let is_open = |point: usize| match lattice.particle_at[point] {
        NO_PARTICLE => true,
        particle => lattice.organ[particle as usize] == FRINGE,
    };
    (0..membership.len())
        .into_par_iter()
        .map(|point| {
            let ijk = shape.ijk(point);
            let neighbours = AHEAD.iter().filter_map(|&offset| shape.neighbour(ijk, offset));
            let mut across = neighbours.filter(|&other| membership[other] != membership[point]);
            match (across.next(), across.next()) {
                // Walls between organs keep their distance from the points, so that they can be parted.
                (Some(other), None) if lattice.has_cells() && (is_open(other) || is_open(point)) => FLAT_FLOOR,
                _ => FLOOR,
            }
        })
        .collect()
}

/// Gives every value the sign of the membership and at least the smallest magnitude.
///
/// The more a value contradicts the membership, the larger its magnitude, by the share `rebound`: where voxels are
/// particles, smoothing turns the sign of thin parts (and gaps), which should keep about their thickness rather than
/// shrink to a thread. Thin parts of cells are as thick as the distance of their corners anyway.
fn keep_sign(mut field: Vec<f32>, membership: &[f32], floors: &[f32], rebound: f32) -> Vec<f32> {
    field.par_iter_mut().zip(membership).zip(floors).for_each(|((value, &member), &floor)| {
        let along = member * *value;
        let kept = if along >= floor { along } else { floor + rebound * (floor - along.max(-1.0)) };
        // A comparison with NaN is false, and `max` drops it: an unknown value counts as a strong contradiction.
        *value = member * kept;
    });
    field
}

/// One pass of (1 2 1)/4 along x, y and z; `beyond` is the value outside the grid.
fn binomial(shape: GridShape, field: &[f32], beyond: f32) -> Vec<f32> {
    let GridShape { nx, ny, nz } = shape;
    let mix = |before: f32, here: f32, after: f32| 0.25 * (before + after) + 0.5 * here;
    let layer = nx * ny;
    if layer == 0 {
        return Vec::new();
    }
    let mut flat = vec![0.0; field.len()];
    flat.par_chunks_mut(layer).zip(field.par_chunks(layer)).for_each(|(out, source)| {
        let mut along_x = vec![0.0; layer];
        for (out, source) in along_x.chunks_mut(nx).zip(source.chunks(nx)) {
            for i in 0..nx {
                let before = if i > 0 { source[i - 1] } else { beyond };
                out[i] = mix(before, source[i], source.get(i + 1).copied().unwrap_or(beyond));
            }
        }
        for j in 0..ny {
            for i in 0..nx {
                let at = j * nx + i;
                let before = if j > 0 { along_x[at - nx] } else { beyond };
                out[at] = mix(before, along_x[at], along_x.get(at + nx).copied().unwrap_or(beyond));
            }
        }
    });
    let mut result = vec![0.0; field.len()];
    result.par_chunks_mut(layer).enumerate().for_each(|(k, out)| {
        for (place, out) in out.iter_mut().enumerate() {
            let at = k * layer + place;
            let before = if k > 0 { flat[at - layer] } else { beyond };
            let after = if k + 1 < nz { flat[at + layer] } else { beyond };
            *out = mix(before, flat[at], after);
        }
    });
    result
}
