//! An obstacle in a world: its shape, where it is, where it goes in this step, and what it has felt.

use super::shapes::{Form, Shape};
use crate::geometry::{Matrix3, Vector3};
use crate::lattice::Lattice;

/// An obstacle among the blocks of a lattice. Vectors without another word are in lattice axes and SI units.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    pub(super) name: String,
    form: Form,
    pub(super) friction: f64,
    /// Lattice axes to those of the form.
    axes: Matrix3,
    /// The lattice's first point, in axes of the form.
    origin: Vector3,
    /// From where the form says to where it is now.
    pub(super) offset: Vector3,
    /// The same after this step.
    pub(super) target: Vector3,
    /// False once it is taken away.
    pub(super) present: bool,
    /// What the tissue did to it in the last step [N].
    pub(super) force: Vector3,
    /// The same summed over time [N s].
    pub(super) impulse: Vector3,
    /// For each block at most how far its soft particles are from it [m]; what is below zero is not known.
    pub(super) clearance: Vec<f32>,
}

impl Placed {
    pub(super) fn new(name: &str, Shape(form): Shape, friction: f64, lattice: &Lattice, blocks: usize) -> Self {
        let (axes, origin) = if form.in_lattice_axes() {
            (Matrix3::identity(), Vector3::zeros())
        } else {
            let affine = &lattice.grid.affine;
            (affine.linear() * (1e-3 / lattice.pitch), affine.origin().coords * 1e-3)
        };
        let zero = Vector3::zeros();
        Self {
            name: name.to_owned(),
            form,
            friction,
            axes,
            origin,
            offset: zero,
            target: zero,
            present: true,
            force: zero,
            impulse: zero,
            clearance: vec![f32::NEG_INFINITY; blocks],
        }
    }

    /// Signed distance of a place while the obstacle is at an offset.
    pub(super) fn value(&self, place: Vector3, offset: Vector3) -> f64 {
        self.form.value(self.axes * (place - offset) + self.origin)
    }

    /// Gradient of the same.
    pub(super) fn gradient(&self, place: Vector3, offset: Vector3) -> Vector3 {
        self.axes.tr_mul(&self.form.gradient(self.axes * (place - offset) + self.origin))
    }

    pub(super) fn steepness(&self) -> f64 {
        self.form.steepness()
    }

    /// Nothing is known of any block.
    pub(super) fn forget(&mut self) {
        self.clearance.fill(f32::NEG_INFINITY);
    }

    /// Takes it away; its account stays.
    pub(super) fn remove(&mut self) {
        self.present = false;
        self.force = Vector3::zeros();
        self.clearance = Vec::new();
    }

    pub(super) fn bytes(&self) -> usize {
        self.form.bytes() + 4 * self.clearance.len()
    }
}
