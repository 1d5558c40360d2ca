//! Values at the grid points of a lattice, above zero in the tissue of an organ: what the surface is drawn from.
//!
//! Whatever a field is made of, its sign follows the organ: particles of the organ are above zero, all other points are not.
//! So the surface has the topology of the lattice, and values only decide where on its edge each crossing lies.

use rayon::prelude::*;

use crate::lattice::{Lattice, NO_PARTICLE};

/// Smallest magnitude of a smoothed or HU field: keeps thin parts from shrinking to threads.
///
/// With 0.02 an isolated particle shrinks to 1e-5 of its voxel; with 0.5 every crossing sits half-way and
/// staircases are back. Found by the volumes and radii in the tests below.
const FLOOR: f32 = 0.25;

/// Membership of an organ: +1 at its particles, -1 elsewhere. Every crossing lies half-way.
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

/// Membership smoothed by `passes` of the binomial filter (1 2 1)/4 along each axis: softens staircases.
///
/// Points beyond the grid count as outside. The sign stays that of [`binary`], with a magnitude of at least 0.25.
pub fn smoothed(lattice: &Lattice, organ: u8, passes: usize) -> Vec<f32> {
    let membership = binary(lattice, organ);
    let mut field = membership.clone();
    for _ in 0..passes {
        field = binomial(lattice, &field);
    }
    keep_sign(&mut field, &membership);
    field
}

/// HU (or any other grey value) at the grid points against a range of tissue, within one organ.
///
/// Above zero where `range[0] < hu < range[1]`; an open end is an infinite one. Values are measured in units of
/// `width` \[HU\], the contrast over which the border of the organ is drawn, and the sign stays that of [`binary`].
/// NaN counts as the border of the organ.
///
/// # Panics
/// If there is not one value per grid point.
pub fn from_hu(lattice: &Lattice, organ: u8, hu: &[f32], range: [f32; 2], width: f32) -> Vec<f32> {
    assert_eq!(hu.len(), lattice.grid.shape.len(), "one value per grid point");
    let membership = binary(lattice, organ);
    let mut field: Vec<f32> = hu.par_iter().map(|&hu| (hu - range[0]).min(range[1] - hu) / width).collect();
    keep_sign(&mut field, &membership);
    field
}

/// Gives every value the sign of the membership and at least the smallest magnitude.
fn keep_sign(field: &mut [f32], membership: &[f32]) {
    field.par_iter_mut().zip(membership).for_each(|(value, &member)| {
        // `max` drops a NaN, which leaves the smallest magnitude.
        *value = member * (member * *value).max(FLOOR);
    });
}

/// One pass of (1 2 1)/4 along x, y and z; outside the grid lies -1.
fn binomial(lattice: &Lattice, field: &[f32]) -> Vec<f32> {
    const BEYOND: f32 = -1.0;
    let shape = lattice.grid.shape;
    let mut result = field.to_vec();
    for stride in [1, shape.nx, shape.nx * shape.ny] {
        let count = match stride {
            1 => shape.nx,
            s if s == shape.nx => shape.ny,
            _ => shape.nz,
        };
        let source = result.clone();
        let per_task = shape.nx * shape.ny;
        result.par_chunks_mut(per_task.max(1)).enumerate().for_each(|(task, layer)| {
            for (place, value) in layer.iter_mut().enumerate() {
                let at = task * per_task + place;
                let step = at / stride % count;
                let before = if step > 0 { source[at - stride] } else { BEYOND };
                let after = if step + 1 < count { source[at + stride] } else { BEYOND };
                *value = 0.25 * (before + after) + 0.5 * source[at];
            }
        });
    }
    result
}
