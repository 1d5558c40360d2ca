//! Colour and attributes of surfaces: the CT at rest, strain, transfer functions, detail, paint.

mod colors;
mod hu;
mod strain;
#[path = "../support/mod.rs"]
mod support;

use yawara::geometry::{Matrix3, Point3, Vector3};
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use yawara::lattice::{Lattice, SeveredSpring, Topology};
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::{Surface, field};

/// Every spring between the layers `i` and `i + 1` severed half-way.
fn cut_after_layer(lattice: &Lattice, i: usize) -> Topology {
    let mut topology = Topology::new(lattice);
    for particle in 0..lattice.len() as u32 {
        for direction in FIRST_FORWARD..NEIGHBOURS {
            let Some(other) = lattice.neighbour(particle, direction) else { continue };
            let layers = [particle, other].map(|end| lattice.ijk(end)[0]);
            if layers.contains(&i) && layers.contains(&(i + 1)) {
                topology.sever(lattice, SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 });
            }
        }
    }
    assert!(!topology.severed().is_empty());
    topology
}

/// The surface of organ 0 under displacements, and which of its vertices lie on a face of a cut.
fn surface(lattice: &Lattice, topology: &Topology, displacements: &[[f32; 3]]) -> (TriangleMesh, Vec<bool>) {
    let values = field::smoothed(lattice, 0, 1);
    let surface = Surface::extract(lattice, topology, &values).unwrap();
    (surface.carry(lattice, displacements), surface.on_seam().collect())
}

/// Displacements \[mm\] of all particles by a function of their rest place.
fn moved(lattice: &Lattice, by: impl Fn(Point3) -> Vector3) -> Vec<[f32; 3]> {
    (0..lattice.len() as u32).map(|p| by(lattice.rest_place(p)).map(|c| c as f32).into()).collect()
}

/// Displacements of a homogeneous deformation about a place.
fn deformed(lattice: &Lattice, gradient: Matrix3, about: Point3) -> Vec<[f32; 3]> {
    moved(lattice, |place| (gradient - Matrix3::identity()) * (place - about))
}

/// The middle of a lattice's grid.
fn middle(lattice: &Lattice) -> Point3 {
    let dims = lattice.grid.shape.dims().map(|n| (n - 1) as f64 / 2.0);
    lattice.grid.affine.apply(Point3::from(dims))
}

/// Runs something on 1, 2 and 4 threads and gives the three results.
fn on_threads<T: Send>(run: impl Fn() -> T + Sync) -> [T; 3] {
    [1, 2, 4].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(&run))
}
