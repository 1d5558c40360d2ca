//! Drag in proportion to mass: motion dies down by itself, by the same share of the velocity everywhere.
//!
//! `m dv/dt = f - rate m v`: without other forces a velocity is `exp(-rate t)` of what it was. The step takes this factor
//! whole, on the velocity between the new forces and the new places:
//!
//! ```text
//! v' = exp(-rate dt) (v + dt f(u) / m)        u' = u + dt v'
//! ```
//!
//! so a free particle decays exactly at any step, and a step that was stable stays so: a mode of frequency `w`, damped by
//! `c`, has a trace of `1 + e - e (dt^2 w^2 + dt c)` and a determinant of `e (1 - dt c)` with `e` the factor, and stays
//! bounded while `dt^2 w^2 + 2 dt c < 2 (1 + 1/e)`, which is never less than the 4 without drag. What has come to rest does
//! not know of it: the rest shape under a load is the same. A body that falls ends at `g dt e / (1 - e)`, that is `g / rate`
//! but for the share `rate dt / 2`.
//!
//! A rigid body is made of masses that are slowed alike, so its momentum and its angular momentum about the centre have the
//! same factor. What is held or grabbed goes where it is told.
//!
//! The velocity is f32: of a `rate dt` below 1e-7 nothing is left.

use rayon::prelude::*;

use crate::dynamics::World;
use crate::kernel::rows::LANES;
use crate::lattice::layout::BLOCK_LEN;

/// Drag of a world.
#[derive(Debug, Clone, Copy)]
pub(in crate::dynamics) struct Drag {
    /// [1/s]
    rate: f64,
}

impl Drag {
    /// What is left of a velocity after a step.
    pub(in crate::dynamics) fn kept(self, dt: f64) -> f64 {
        (-self.rate * dt).exp()
    }
}

impl World {
    /// Lets the velocity of everything that is free die down like `exp(-rate t)` [1/s] besides what forces do to it; 0 for no
    /// drag.
    ///
    /// # Panics
    /// If the rate is negative or not finite.
    pub fn set_drag(&mut self, rate: f64) {
        assert!(rate >= 0.0 && rate.is_finite(), "drag takes velocity away");
        self.drag = (rate > 0.0).then_some(Drag { rate });
    }

    /// The rate of drag [1/s]; 0 without.
    pub(in crate::dynamics) fn drag_rate(&self) -> f64 {
        self.drag.map_or(0.0, |drag| drag.rate)
    }

    /// After the drives, before bodies move: slows what is free. Brings the largest squared speed of each block up to date.
    pub(in crate::dynamics) fn apply_drag(&mut self, fastest: &mut [f32]) {
        let Some(drag) = self.drag else { return };
        let dt = self.dt();
        // What is lost and not what is left, which would round a slow decay to another rate.
        let lost = -(-drag.rate * dt).exp_m1() as f32;
        let [x, y, z] = self.velocity.each_mut().map(|axis| axis.par_chunks_exact_mut(BLOCK_LEN));
        let blocks = (x, y, z).into_par_iter().zip(self.dt_over_mass.par_chunks_exact(BLOCK_LEN)).zip(fastest);
        blocks.for_each(|(((x, y, z), free), fastest)| *fastest = slow_block(lost, free, [x, y, z]));
        if let Some(rigid) = &mut self.rigid {
            rigid.slow(drag.kept(dt));
        }
    }
}

/// Takes a share of the velocities of one block where the weight is not 0; returns the largest squared speed of the block, infinite
/// when a velocity is not finite.
fn slow_block(lost: f32, weight: &[f32], velocity: [&mut [f32]; 3]) -> f32 {
    let [x, y, z] = velocity.map(|axis| axis.as_chunks_mut::<LANES>().0);
    let mut fastest = [0.0_f32; LANES];
    for (((x, y), z), weight) in x.iter_mut().zip(y).zip(z).zip(weight.as_chunks::<LANES>().0) {
        for lane in 0..LANES {
            let share = if weight[lane] > 0.0 { lost } else { 0.0 };
            let [vx, vy, vz] = [x[lane] - share * x[lane], y[lane] - share * y[lane], z[lane] - share * z[lane]];
            [x[lane], y[lane], z[lane]] = [vx, vy, vz];
            let squared = vx * vx + vy * vy + vz * vz;
            let counted = if squared < f32::MAX { squared } else { f32::INFINITY };
            fastest[lane] = if counted > fastest[lane] { counted } else { fastest[lane] };
        }
    }
    fastest.into_iter().fold(0.0, f32::max)
}
