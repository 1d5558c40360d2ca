//! Vertices carried by particles: a fixed sparse combination per vertex, evaluated once per frame.
//!
//! | vertex | carried by |
//! |---|---|
//! | skin, the outside end a linked particle | both ends, interpolated |
//! | skin towards air; lip of a cut | its particle p: `u_p + t (F_p - 1)(X_q - X_p)`, see [`super::gradient`] |
//! | crack front | the corners of its face that hold together |
//! | rim | its particle p, along the cut edge and along the skin edge as those crossings move; where it lies off their face, aside too |
//! | centre of a loop | the mean of the loop |
//!
//! All of them reproduce a homogeneous deformation. Displacements are combined and added to the rest place in f64,
//! so small motions far from the origin lose nothing before the last rounding to f32.

use rayon::prelude::*;

use super::gradient::{AxisDisplacements, Gradients};
use super::hinged::Hinged;
use super::normals::Sheet;
use crate::lattice::Lattice;

/// What moves a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Carrier {
    /// Fraction `t` of the way from one particle to another.
    Between { from: u32, to: u32, t: f32 },
    /// `t` steps (signed) along a grid axis from a particle, by its gradient.
    Beyond { particle: u32, gradient: u32, axis: u8, t: f32 },
    /// Index into [`Embedding::fronts`].
    Front { index: u32 },
    /// Index into [`Embedding::rims`].
    Rim { index: u32 },
    /// Index into [`Embedding::centres`].
    Centre { index: u32 },
}

impl Default for Carrier {
    fn default() -> Self {
        Carrier::Between { from: 0, to: 0, t: 0.0 }
    }
}

/// A vertex at rest and what moves it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Vertex {
    /// Rest place, RAS+ [mm].
    pub(crate) rest: [f64; 3],
    pub(crate) carrier: Carrier,
    /// Organ of the particle on its inside.
    pub(crate) organ: u8,
    pub(crate) sheet: Sheet,
}

impl Vertex {
    /// Where it lies for light and colour: a crossing of the skin that was drawn to the rim of a cut is on the rim.
    pub(crate) fn shown_on(&self) -> Sheet {
        if self.sheet == Sheet::Skin && self.rim().is_some() { Sheet::Rim } else { self.sheet }
    }

    /// Index into [`Embedding::rims`], if a rim carries it.
    pub(crate) fn rim(&self) -> Option<u32> {
        match self.carrier {
            Carrier::Rim { index } => Some(index),
            _ => None,
        }
    }
}

/// A crack front: up to four particles with their weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Front {
    pub(crate) particles: [u32; 4],
    pub(crate) weights: [f32; 4],
}

/// A rim: legs from a particle, along the cut edge, along the edge to the outside, and a little along the third axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rim {
    /// Along the cut edge and along the third axis, signed steps; always by the gradient.
    pub(crate) lip_axis: u8,
    pub(crate) lip: f32,
    pub(crate) aside_axis: u8,
    pub(crate) aside: f32,
    pub(crate) particle: u32,
    pub(crate) gradient: u32,
    /// Along the edge to the outside.
    pub(crate) skin: Carrier,
    /// Whether it lies where it would if nothing were known of blade and skin beyond its corner.
    pub(crate) is_plain: bool,
}

/// The carriers of all vertices of a surface.
#[derive(Debug, Clone, Default)]
pub(crate) struct Embedding {
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) gradients: Gradients,
    pub(crate) hinged: Hinged,
    pub(crate) fronts: Vec<Front>,
    pub(crate) rims: Vec<Rim>,
    /// Centres: the vertex itself, then the vertices of its loop.
    pub(crate) centres: Vec<(u32, Vec<u32>)>,
}

impl Embedding {
    /// A particle on the inside of each vertex and on its side of every cut; 0 for centres.
    pub(crate) fn anchors(&self) -> Vec<u32> {
        let of = |vertex: &Vertex| match vertex.carrier {
            Carrier::Between { from, .. } => from,
            Carrier::Beyond { particle, .. } => particle,
            Carrier::Front { index } => self.fronts[index as usize].particles[0],
            Carrier::Rim { index } => self.rims[index as usize].particle,
            Carrier::Centre { .. } => 0,
        };
        self.vertices.iter().map(of).collect()
    }

    /// The vertices where a cut ends inside the tissue, ascending.
    pub(crate) fn ends_of_cuts(&self) -> Vec<u32> {
        let fronts = (0..).zip(&self.vertices).filter(|(_, vertex)| matches!(vertex.carrier, Carrier::Front { .. }));
        fronts.map(|(number, _)| number).collect()
    }
}

/// Vertices per parallel task.
const VERTICES_PER_TASK: usize = 1 << 13;

impl Embedding {
    /// Places and displacements of all vertices, RAS+ \[mm\], under displacements of the particles.
    pub(crate) fn carry(
        &self,
        lattice: &Lattice,
        displacements: &[[f32; 3]],
        positions: &mut Vec<[f32; 3]>,
        moved: &mut Vec<[f32; 3]>,
    ) {
        let displacements = &*self.hinged.steadied(lattice, displacements);
        let gradients = self.gradients.evaluate(lattice, displacements);
        positions.resize(self.vertices.len(), [0.0; 3]);
        moved.resize(self.vertices.len(), [0.0; 3]);
        let frame = Frame { embedding: self, gradients: &gradients, displacements };
        self.vertices
            .par_chunks(VERTICES_PER_TASK)
            .zip(positions.par_chunks_mut(VERTICES_PER_TASK))
            .zip(moved.par_chunks_mut(VERTICES_PER_TASK))
            .for_each(|((vertices, positions), moved)| {
                for ((vertex, position), moved) in vertices.iter().zip(positions).zip(moved) {
                    *moved = frame.displacement(&vertex.carrier);
                    *position = placed(vertex.rest, *moved);
                }
            });
        for (centre, ring) in &self.centres {
            let at = *centre as usize;
            let mut mean = [0.0_f64; 3];
            for &vertex in ring {
                for axis in 0..3 {
                    mean[axis] += f64::from(moved[vertex as usize][axis]) / ring.len() as f64;
                }
            }
            moved[at] = mean.map(|c| c as f32);
            positions[at] = placed(self.vertices[at].rest, moved[at]);
        }
    }
}

fn placed(rest: [f64; 3], moved: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|axis| (rest[axis] + f64::from(moved[axis])) as f32)
}

/// What one frame reads.
struct Frame<'a> {
    embedding: &'a Embedding,
    gradients: &'a [AxisDisplacements],
    displacements: &'a [[f32; 3]],
}

impl Frame<'_> {
    #[inline]
    fn displacement(&self, carrier: &Carrier) -> [f32; 3] {
        match *carrier {
            Carrier::Between { from, to, t } => {
                let (from, to) = (self.displacements[from as usize], self.displacements[to as usize]);
                [0, 1, 2].map(|axis| from[axis] + t * (to[axis] - from[axis]))
            }
            Carrier::Beyond { particle, gradient, axis, t } => {
                let own = self.displacements[particle as usize];
                let step = self.gradients[gradient as usize][usize::from(axis)];
                [0, 1, 2].map(|axis| own[axis] + t * step[axis])
            }
            Carrier::Front { index } => {
                let front = &self.embedding.fronts[index as usize];
                let mut sum = [0.0; 3];
                for (particle, weight) in front.particles.iter().zip(front.weights) {
                    let u = self.displacements[*particle as usize];
                    for axis in 0..3 {
                        sum[axis] += weight * u[axis];
                    }
                }
                sum
            }
            Carrier::Rim { index } => {
                let rim = &self.embedding.rims[index as usize];
                let skin = self.displacement(&rim.skin);
                let gradient = &self.gradients[rim.gradient as usize];
                let [lip, aside] = [rim.lip_axis, rim.aside_axis].map(|axis| gradient[usize::from(axis)]);
                [0, 1, 2].map(|axis| skin[axis] + rim.lip * lip[axis] + rim.aside * aside[axis])
            }
            // Filled in afterwards, from the vertices of its loop.
            Carrier::Centre { .. } => [0.0; 3],
        }
    }
}
