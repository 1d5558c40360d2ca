//! The surface of a lattice: extracted once per cut epoch, carried once per frame.

use std::collections::HashMap;

use super::SurfaceError;
use super::blade::Blades;
use super::embed::{Carrier, Embedding, Front, Rim, Vertex};
use super::gradient::Gradients;
use super::hinged::Hinged;
use super::junction::{RimCrossing, signed};
use super::marching_cubes::bits::InsideBits;
use super::marching_cubes::sweep::{self, Crossing, Numbering};
use super::mesh::TriangleMesh;
use super::normals::{Layers, Sheet, vertex_normals};
use super::rim;
use super::rim_edges;
use super::seam::{Seam, SeamEdge, edge_key};
use crate::lattice::{Lattice, NO_PARTICLE, Topology, neighbours};

/// A closed surface round the tissue of a lattice, with both faces of every cut, and what moves each of its vertices.
///
/// Vertex numbers, triangles and labels stay the same until the next extraction, which is needed only after a cut.
/// The mesh is closed, manifold and oriented whatever was severed. A spring whose loss parts nothing (its ends hold
/// together on every face at it) leaves the surface as it was.
#[derive(Debug, Clone)]
pub struct Surface {
    embedding: Embedding,
    triangles: Vec<[u32; 3]>,
    vertex_layers: Vec<u32>,
    triangle_layers: Vec<u32>,
    turned: Vec<u32>,
    particles: usize,
}

impl Surface {
    /// Extracts the surface where `field` passes through zero: one value per grid point of the lattice, x fastest.
    ///
    /// A point is inside when its value is above zero and it holds a particle; beyond the grid is outside. See
    /// [`super::field`] for fields of an organ.
    ///
    /// # Errors
    /// If the field has not one value per grid point, or the surface would need more than 2^32 vertices or triangles.
    pub fn extract(lattice: &Lattice, topology: &Topology, field: &[f32]) -> Result<Self, SurfaceError> {
        let mut surface = Self::extract_places(lattice, topology, field)?;
        add_gradients(&mut surface.embedding, lattice, topology);
        Ok(surface)
    }

    /// [`Surface::extract`] for what does not carry the surface itself: topology and rest places only.
    pub(crate) fn extract_places(lattice: &Lattice, topology: &Topology, field: &[f32]) -> Result<Self, SurfaceError> {
        let shape = lattice.grid.shape;
        if field.len() != shape.len() {
            return Err(SurfaceError::FieldLength { found: field.len(), expected: shape.len(), shape });
        }
        let bits = InsideBits::new(shape, field, Some(&lattice.particle_at));
        let blades = Blades::new(lattice, topology.severed());
        let mut seam = Seam::find(lattice, topology, &blades, &bits, field);
        let numbering = Numbering::new(&bits, &seam)?;
        let mut drawn = sweep::triangles(&bits, &seam, &numbering, lattice.grid.affine.determinant() < 0.0)?;
        let centres = seam.cells.iter().zip(&numbering.centres);
        let centres = centres.flat_map(|(cell, &first)| (first..).take(cell.patch.centres.len()));
        let loops = loops_of(centres, &drawn.triangles);
        let pitch_mm = lattice.pitch * 1e3;
        let (mut embedding, crowded) = loop {
            let crossings =
                Crossings { lattice, alive: topology.alive(), blades: &blades, rim_crossings: &seam.rim_crossings };
            let vertices = sweep::crossing_values(&bits, field, &numbering, |crossing| crossings.vertex(crossing));
            let mut embedding = Embedding { vertices, rims: crossings.rims(), ..Embedding::default() };
            for (edge, &first) in seam.edges.iter().zip(&numbering.seam_edges) {
                crossings.add_seam_edge(edge, first as usize, &mut embedding);
            }
            add_centres(&mut embedding, &loops);
            let crowded = rim::crowded(&embedding, &drawn.triangles, pitch_mm);
            let places = (lattice, &embedding, &*drawn.triangles);
            if crowded.is_empty() || !rim::make_room(&crowded, places, &mut seam.edges, &mut seam.rim_crossings) {
                break (embedding, crowded);
            }
        };
        let turned = rim_edges::turn(&mut embedding, &mut drawn.triangles, |_, _| true, &crowded, pitch_mm);
        Ok(Self {
            embedding,
            triangles: drawn.triangles,
            vertex_layers: numbering.layers,
            triangle_layers: drawn.layers,
            turned,
            particles: lattice.len(),
        })
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.embedding.vertices.len()
    }

    /// Corners of each triangle, counter-clockwise seen from outside in RAS+.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Organ of the particle inside each vertex, as in [`Lattice::organ`]; in a lattice of cells, smoothing may draw the border
    /// outside a particle that belongs to none ([`crate::lattice::FRINGE`]).
    pub fn organs(&self) -> impl ExactSizeIterator<Item = u8> + '_ {
        self.embedding.vertices.iter().map(|vertex| vertex.organ)
    }

    /// Whether each vertex lies on a face of a cut (its rim included) rather than on the skin.
    pub fn on_seam(&self) -> impl ExactSizeIterator<Item = bool> + '_ {
        self.embedding.vertices.iter().map(|vertex| vertex.shown_on() != Sheet::Skin)
    }

    /// Which part of the surface each vertex lies on.
    pub fn sheets(&self) -> impl ExactSizeIterator<Item = Sheet> + '_ {
        self.embedding.vertices.iter().map(|vertex| vertex.sheet)
    }

    /// First vertex of each layer of the grid, and the end: crossings in the order of their edges, then what cuts added.
    pub(crate) fn vertex_layers(&self) -> &[u32] {
        &self.vertex_layers
    }

    /// A particle on the inside of each vertex and on its side of every cut.
    pub(crate) fn anchors(&self) -> Vec<u32> {
        let embedding = &self.embedding;
        let mut anchors = embedding.anchors();
        for (centre, ring) in &embedding.centres {
            anchors[*centre as usize] = anchors[ring[0] as usize];
        }
        anchors
    }

    /// The vertices where a cut ends inside the tissue, ascending.
    pub(crate) fn ends_of_cuts(&self) -> Vec<u32> {
        self.embedding.ends_of_cuts()
    }

    /// The triangles, and the centres of loops with the vertices of each loop.
    pub(crate) fn into_triangles_and_centres(self) -> (Vec<[u32; 3]>, Vec<Loop>) {
        (self.triangles, self.embedding.centres)
    }

    /// Rest place of each vertex, RAS+ [mm].
    pub fn rest_places(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        self.embedding.vertices.iter().map(|vertex| vertex.rest)
    }

    /// The surface moved by displacements of the particles, RAS+ [mm], in the order of the lattice.
    ///
    /// Positions, normals, labels (organ indices) and displacements are filled in.
    ///
    /// # Panics
    /// If there is not one displacement per particle of the lattice the surface was extracted from.
    pub fn carry(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> TriangleMesh {
        let mut mesh = TriangleMesh {
            triangles: self.triangles.clone(),
            labels: self.organs().map(u16::from).collect(),
            ..TriangleMesh::default()
        };
        self.carry_positions(lattice, displacements, &mut mesh.positions, &mut mesh.displacements);
        mesh.normals = self.normals(&mesh.positions);
        mesh
    }

    /// Only the places and displacements of the vertices, RAS+ [mm], into buffers that are reused from frame to frame.
    ///
    /// # Panics
    /// As [`Surface::carry`].
    pub fn carry_positions(
        &self,
        lattice: &Lattice,
        displacements: &[[f32; 3]],
        positions: &mut Vec<[f32; 3]>,
        moved: &mut Vec<[f32; 3]>,
    ) {
        assert_eq!(displacements.len(), self.particles, "one displacement per particle");
        assert_eq!(lattice.len(), self.particles, "the lattice the surface was extracted from");
        self.embedding.carry(lattice, displacements, positions, moved);
    }

    /// Unit normals at the given places of the vertices: smooth on the skin, of their own on the faces of a cut.
    ///
    /// # Panics
    /// If there is not one place per vertex.
    pub fn normals(&self, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        assert_eq!(positions.len(), self.vertex_count(), "one place per vertex");
        let layers = Layers { vertices: &self.vertex_layers, triangles: &self.triangle_layers, turned: &self.turned };
        vertex_normals(positions, &self.triangles, layers, |vertex| self.embedding.vertices[vertex].shown_on())
    }

    /// The surface at rest.
    pub fn at_rest(&self, lattice: &Lattice) -> TriangleMesh {
        self.carry(lattice, &vec![[0.0; 3]; self.particles])
    }
}

/// The centre of a loop, and the vertices of the loop.
pub(crate) type Loop = (u32, Vec<u32>);

/// Makes the vertices of crossings.
pub(super) struct Crossings<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) alive: &'a [u32],
    pub(super) blades: &'a Blades,
    pub(super) rim_crossings: &'a [RimCrossing],
}

/// Gradients are numbered once all vertices are known.
const NOT_YET: u32 = u32::MAX;

impl Crossings<'_> {
    pub(super) fn vertex(&self, crossing: Crossing) -> Vertex {
        let mut inside = crossing.low.map(|i| i as i64 - 1);
        inside[crossing.axis] += i64::from(!crossing.upward);
        let particle = self.particle(inside).unwrap_or(0);
        if let Some(index) = self.rim_crossing(crossing.low, crossing.axis) {
            let rim = &self.rim_crossings[index];
            return Vertex {
                rest: self.place(inside, &rim.steps()),
                carrier: Carrier::Rim { index: index as u32 },
                organ: self.lattice.organ[particle as usize],
                sheet: Sheet::Skin,
            };
        }
        let whole = self.alive[particle as usize] == self.lattice.springs[particle as usize];
        let t =
            if whole { crossing.t } else { self.blades.limit(particle, crossing.axis, crossing.upward, crossing.t) };
        let carrier = self.carrier(particle, inside, crossing.axis, crossing.upward, t);
        let step = signed(t, crossing.upward);
        Vertex {
            rest: self.place(inside, &[(crossing.axis, step)]),
            carrier,
            organ: self.lattice.organ[particle as usize],
            sheet: Sheet::Skin,
        }
    }

    /// The place among the rim crossings of a crossing by padded indices.
    fn rim_crossing(&self, low: [usize; 3], axis: usize) -> Option<usize> {
        if self.rim_crossings.is_empty() {
            return None;
        }
        let edge = edge_key(self.lattice.grid.shape, low.map(|i| i as i64), axis as u8);
        self.rim_crossings.binary_search_by_key(&edge, |rim| rim.edge).ok()
    }

    /// What carries the rim crossings, in their order: the first rims of an embedding.
    pub(super) fn rims(&self) -> Vec<Rim> {
        let rim = |rim: &RimCrossing| {
            let (inside, axis) = (rim.inside(self.lattice.grid.shape), rim.edge % 3);
            let particle = self.particle(inside).unwrap_or(0);
            let [(_, lip), (across, step), (aside_axis, aside)] = rim.steps();
            let skin = self.carrier(particle, inside, across, step >= 0.0, step.abs());
            Rim {
                lip_axis: axis as u8,
                lip,
                aside_axis: aside_axis as u8,
                aside,
                particle,
                gradient: NOT_YET,
                skin,
                is_plain: false,
            }
        };
        self.rim_crossings.iter().map(rim).collect()
    }

    /// From a particle towards its neighbour along an axis: between both where they are linked, else beyond the particle.
    pub(super) fn carrier(&self, particle: u32, ijk: [i64; 3], axis: usize, upward: bool, t: f32) -> Carrier {
        let mut offset = [0; 3];
        offset[axis] = if upward { 1 } else { -1 };
        let linked = self.alive[particle as usize] >> neighbours::direction_of(offset) & 1 == 1;
        let other = self.particle([0, 1, 2].map(|a| ijk[a] + i64::from(offset[a])));
        match other {
            Some(other) if linked => Carrier::Between { from: particle, to: other, t },
            _ => Carrier::Beyond { particle, gradient: NOT_YET, axis: axis as u8, t: signed(t, upward) },
        }
    }

    pub(super) fn particle(&self, ijk: [i64; 3]) -> Option<u32> {
        let shape = self.lattice.grid.shape;
        let within = (0..3).all(|axis| ijk[axis] >= 0 && ijk[axis] < shape.dims()[axis] as i64);
        let particle = within.then(|| self.lattice.particle_at[shape.linear(ijk.map(|i| i as usize))])?;
        (particle != NO_PARTICLE).then_some(particle)
    }

    /// Rest place `steps` along grid axes from a grid point, RAS+ [mm].
    pub(super) fn place(&self, ijk: [i64; 3], steps: &[(usize, f32)]) -> [f64; 3] {
        let mut index = ijk.map(|i| i as f64);
        for &(axis, step) in steps {
            index[axis] += f64::from(step);
        }
        self.lattice.grid.affine.apply(index.into()).into()
    }

    /// The lips, crack fronts and rims of a seam edge, from vertex `first` on.
    pub(super) fn add_seam_edge(&self, edge: &SeamEdge, first: usize, embedding: &mut Embedding) {
        let axis = usize::from(edge.axis);
        let ends = [0, 1].map(|end| {
            let mut ijk = edge.low.map(|i| i64::from(i) - 1);
            ijk[axis] += end;
            ijk
        });
        let organ = |particle: u32| self.lattice.organ[particle as usize];
        for (end, ijk) in ends.into_iter().enumerate() {
            let (particle, t) = (edge.ends[end], signed(edge.lips[end], end == 0));
            embedding.vertices[first + end] = Vertex {
                rest: self.place(ijk, &[(axis, t)]),
                carrier: Carrier::Beyond { particle, gradient: NOT_YET, axis: edge.axis, t },
                organ: organ(particle),
                sheet: Sheet::Seam,
            };
        }
        let mut at = first + 2;
        for front in &edge.fronts {
            let mut rest = [0.0; 3];
            for (particle, weight) in front.particles.iter().zip(front.weights) {
                let place = self.lattice.rest_place(*particle);
                for axis in 0..3 {
                    rest[axis] += f64::from(weight) * place[axis];
                }
            }
            let index = embedding.fronts.len() as u32;
            embedding.fronts.push(Front { particles: front.particles, weights: front.weights });
            let organ = organ(front.particles[0]);
            embedding.vertices[at] = Vertex { rest, carrier: Carrier::Front { index }, organ, sheet: Sheet::Seam };
            at += 1;
        }
        for rim in &edge.rims {
            let end = usize::from(rim.end);
            let (particle, ijk) = (edge.ends[end], ends[end]);
            let (lip, skin) = (signed(rim.at[0], end == 0), signed(rim.at[1], rim.skin_upward));
            let skin_axis = usize::from(rim.skin_axis);
            let aside_axis = 3 - axis - skin_axis;
            let index = embedding.rims.len() as u32;
            embedding.rims.push(Rim {
                lip_axis: edge.axis,
                lip,
                aside_axis: aside_axis as u8,
                aside: rim.at[2],
                particle,
                gradient: NOT_YET,
                skin: self.carrier(particle, ijk, skin_axis, rim.skin_upward, rim.at[1]),
                is_plain: rim.at == rim.plain,
            });
            embedding.vertices[at] = Vertex {
                rest: self.place(ijk, &[(axis, lip), (skin_axis, skin), (aside_axis, rim.at[2])]),
                carrier: Carrier::Rim { index },
                organ: organ(particle),
                sheet: Sheet::Rim,
            };
            at += 1;
        }
    }
}

/// How many more times than others the places on the rim of a cut count in the centre of a loop.
const RIM_SHARE: usize = 8;

/// The vertices of the loop round each centre, ascending by centre: a fan names its ring vertex first, so the triangles round a
/// centre list its loop.
fn loops_of(centres: impl Iterator<Item = u32>, triangles: &[[u32; 3]]) -> Vec<Loop> {
    let index: HashMap<u32, u32> = centres.zip(0..).collect();
    if index.is_empty() {
        return Vec::new();
    }
    let mut rings = vec![Vec::new(); index.len()];
    for triangle in triangles {
        for corner in &triangle[1..] {
            if let Some(&at) = index.get(corner) {
                rings[at as usize].push(triangle[0]);
            }
        }
    }
    let mut loops: Vec<Loop> =
        index.iter().map(|(&vertex, &at)| (vertex, std::mem::take(&mut rings[at as usize]))).collect();
    loops.sort_unstable_by_key(|centre| centre.0);
    loops
}

/// Puts centres into the middle of their loops.
fn add_centres(embedding: &mut Embedding, loops: &[Loop]) {
    let mut centres = loops.to_vec();
    for (_, ring) in &mut centres {
        // A loop over the rim bends there: its places on the rim count for most.
        let sheet = |&at: &u32| embedding.vertices[at as usize].sheet;
        let bends = ring.iter().any(|at| sheet(at) == Sheet::Skin);
        let rims: Vec<u32> = ring.iter().copied().filter(|at| bends && sheet(at) == Sheet::Rim).collect();
        (0..RIM_SHARE).for_each(|_| ring.extend(&rims));
    }
    for (at, (centre, ring)) in centres.iter().enumerate() {
        let mut rest = [0.0_f64; 3];
        for &vertex in ring {
            let place = embedding.vertices[vertex as usize].rest;
            rest = [0, 1, 2].map(|axis| rest[axis] + place[axis] / ring.len() as f64);
        }
        let first = &embedding.vertices[ring[0] as usize];
        embedding.vertices[*centre as usize] =
            Vertex { rest, carrier: Carrier::Centre { index: at as u32 }, organ: first.organ, sheet: Sheet::Rim };
    }
    embedding.centres = centres;
}

/// Numbers the gradients that vertices need, in the order of the vertices, and finds the particles that are drawn elsewhere.
pub(super) fn add_gradients(embedding: &mut Embedding, lattice: &Lattice, topology: &Topology) {
    let mut place_of = vec![NOT_YET; lattice.len()];
    let mut particles = Vec::new();
    let mut need = |particle: u32| {
        let place = &mut place_of[particle as usize];
        if *place == NOT_YET {
            *place = particles.len() as u32;
            particles.push(particle);
        }
        *place
    };
    for carrier in embedding.vertices.iter_mut().map(|vertex| &mut vertex.carrier) {
        if let Carrier::Beyond { particle, gradient, .. } = carrier {
            *gradient = need(*particle);
        }
    }
    for rim in &mut embedding.rims {
        rim.gradient = need(rim.particle);
        if let Carrier::Beyond { gradient, .. } = &mut rim.skin {
            *gradient = rim.gradient;
        }
    }
    let (gradients, index) = Gradients::new(lattice, topology.alive(), &particles);
    for carrier in embedding.vertices.iter_mut().map(|vertex| &mut vertex.carrier) {
        if let Carrier::Beyond { gradient, .. } = carrier {
            *gradient = index[*gradient as usize];
        }
    }
    for rim in &mut embedding.rims {
        rim.gradient = index[rim.gradient as usize];
        if let Carrier::Beyond { gradient, .. } = &mut rim.skin {
            *gradient = rim.gradient;
        }
    }
    embedding.gradients = gradients;
    embedding.hinged = Hinged::find(lattice, topology);
}
