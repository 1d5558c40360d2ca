//! Where smoothed surfaces lie: near the solid that was scanned, with its volume, whole where it is thin.
//!
//! `cargo test --test smoothing -- --nocapture` prints the table.

mod measure;
mod solids;

use measure::{Measured, measure};
use solids::{Solid, ball, hu, see, tube};
use yawara::surface::smooth::{Voxels, from_grey, from_mask};

fn show(solid: &Solid, source: &str, field: &[f32]) -> Measured {
    let m = measure(solid, field);
    println!(
        "{:9} {source:12} mean {:+.4} rms {:.4} vox  volume {:+.2} % area {:+.2} %  normals {:.2} deg, gradient {:.2} deg",
        solid.name,
        m.mean,
        m.rms,
        100.0 * m.volume,
        100.0 * m.area,
        m.triangles,
        m.gradient
    );
    m
}

#[test]
fn table() {
    for solid in [ball(4.0), ball(6.0), ball(8.0), ball(10.0), ball(14.0), tube(4.0), tube(1.2)] {
        let seen = see(&solid);
        let voxels = Voxels { shape: solid.shape, organ: &seen.mask, foreign: &[] };
        for noise in [0.0, 4.8, 16.0, 24.0] {
            show(&solid, &format!("grey {noise}"), &from_grey(voxels, &hu(&seen.cover, noise), 1.0));
        }
        for smooth in [0.0, 0.25, 0.5, 1.0, 2.0, 4.0] {
            show(&solid, &format!("mask {smooth}"), &from_mask(voxels, smooth));
        }
    }
}
