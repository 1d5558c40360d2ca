//! Vertices carried by the cells of a lattice: once bound, each frame is one trilinear interpolation per vertex.

use rayon::prelude::*;

use super::endings::Ending;
use super::hosts::{Host, Hosts, Numbered};
use crate::geometry::{Matrix3, Vector3};
use crate::lattice::{Lattice, Topology};
use crate::surface::gradient::Gradients;
use crate::surface::hinged::Hinged;

/// How far outside its cell a vertex still follows the cell's own map [cells]; beyond, it follows the nearest such point.
const REACH: f32 = 1.5;
/// Vertices per parallel task.
const VERTICES_PER_TASK: usize = 1 << 13;

/// Where a vertex rides.
#[derive(Debug, Clone, Copy)]
struct Seat {
    host: u32,
    /// Local coordinates in the host's cell, 0 to 1 inside.
    local: [f32; 3],
}

/// A corner that stands for one across a cut or beyond the lattice: a weighted mean of what the corners that carry continue to.
#[derive(Debug, Clone)]
struct VirtualCorner {
    /// Particle, its gradient, weight, and steps along the grid axes from it to this corner.
    sources: Vec<(u32, u32, f32, [f32; 3])>,
}

/// What carries every vertex of a surface.
#[derive(Debug, Clone)]
pub(super) struct Carriage {
    seats: Vec<Seat>,
    /// Vertices that all corners of their cell carry in part, with the number of that host.
    endings: Vec<Ending<u32>>,
    /// The eight corners of every host: particles, then virtual corners.
    hosts: Vec<[u32; 8]>,
    corners: Vec<VirtualCorner>,
    gradients: Gradients,
    hinged: Hinged,
    particles: usize,
    /// From displacements per index step to displacements per mm.
    to_index: Matrix3,
}

/// Where the vertices of a surface are in a frame; one of each per vertex.
pub(super) struct Carried<'a> {
    pub(super) positions: &'a mut [[f32; 3]],
    pub(super) moved: &'a mut [[f32; 3]],
    pub(super) normals: &'a mut [[f32; 3]],
}

impl Carriage {
    /// Binds vertices to the lattice.
    ///
    /// - `hosts_of`: host of each vertex; `places`: its index coordinates in the lattice; `endings`: vertices near the ends of cuts.
    pub(super) fn bind(
        lattice: &Lattice,
        topology: &Topology,
        hosts: &Hosts<'_>,
        hosts_of: &[Host],
        places: &[Vector3],
        endings: &[Ending<Host>],
    ) -> Self {
        let mut numbered = Numbered::default();
        let seats: Vec<Seat> = hosts_of
            .iter()
            .zip(places)
            .map(|(&host, place)| {
                let local = [0, 1, 2].map(|axis| (place[axis] - f64::from(host.cell[axis])) as f32);
                Seat { host: numbered.number(host), local: local.map(|x| x.clamp(-REACH, 1.0 + REACH)) }
            })
            .collect();
        let numbered_all = |&ending: &Ending<Host>| ending.with(numbered.number(ending.all));
        let endings = endings.iter().map(numbered_all).collect();
        let mut corners = Vec::new();
        let mut asked = Vec::new();
        let hosts = numbered
            .list
            .iter()
            .map(|host| {
                let particles = hosts.corners(host.cell);
                std::array::from_fn(|corner| {
                    if host.carrying >> corner & 1 == 1 {
                        return particles[corner];
                    }
                    corners.push(VirtualCorner { sources: sources(host.carrying, &particles, corner) });
                    asked.extend(corners[corners.len() - 1].sources.iter().map(|source| source.0));
                    (lattice.len() + corners.len() - 1) as u32
                })
            })
            .collect();
        asked.sort_unstable();
        asked.dedup();
        let (gradients, index) = Gradients::new(lattice, topology.alive(), &asked);
        for source in corners.iter_mut().flat_map(|corner| &mut corner.sources) {
            source.1 = index[asked.binary_search(&source.0).expect("asked for")];
        }
        let axes = lattice.grid.affine.linear();
        let to_index = axes.try_inverse().unwrap_or_else(Matrix3::identity);
        let hinged = Hinged::find(lattice, topology);
        Self { seats, endings, hosts, corners, gradients, hinged, particles: lattice.len(), to_index }
    }

    /// Displacements of the virtual corners \[mm\].
    fn continued(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let gradients = self.gradients.evaluate(lattice, displacements);
        let continued = self.corners.par_iter().map(|corner| {
            let mut sum = [0.0; 3];
            for &(particle, gradient, weight, steps) in &corner.sources {
                let (own, slopes) = (displacements[particle as usize], &gradients[gradient as usize]);
                for axis in 0..3 {
                    let along: f32 = (0..3).map(|step| steps[step] * slopes[step][axis]).sum();
                    sum[axis] += weight * (own[axis] + along);
                }
            }
            sum
        });
        continued.collect()
    }

    /// Places, displacements and normals under displacements of the particles, RAS+ \[mm\].
    ///
    /// - `rest`: rest places \[mm\]; `normals`: unit normals at rest. A normal turns with the cofactor of the deformation
    ///   gradient at its vertex.
    pub(super) fn carry(
        &self,
        lattice: &Lattice,
        displacements: &[[f32; 3]],
        rest: &[[f64; 3]],
        normals: &[[f32; 3]],
        carried: Carried<'_>,
    ) {
        assert_eq!(displacements.len(), self.particles, "one displacement per particle");
        let displacements = &*self.hinged.steadied(lattice, displacements);
        let continued = self.continued(lattice, displacements);
        let corner = |corner: u32| {
            let corner = corner as usize;
            displacements.get(corner).copied().unwrap_or_else(|| continued[corner - self.particles])
        };
        let to_index: [[f32; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| self.to_index[(r, c)] as f32));
        carried
            .positions
            .par_chunks_mut(VERTICES_PER_TASK)
            .zip(carried.moved.par_chunks_mut(VERTICES_PER_TASK))
            .zip(carried.normals.par_chunks_mut(VERTICES_PER_TASK))
            .enumerate()
            .for_each(|(task, ((positions, moved), turned))| {
                let first = task * VERTICES_PER_TASK;
                for at in 0..positions.len() {
                    let seat = &self.seats[first + at];
                    let eight = self.hosts[seat.host as usize].map(corner);
                    let (value, slopes) = trilinear(&eight, seat.local);
                    moved[at] = value;
                    let rest = rest[first + at];
                    positions[at] = [0, 1, 2].map(|axis| (rest[axis] + f64::from(value[axis])) as f32);
                    turned[at] = turn(normals[first + at], &slopes, &to_index);
                }
            });
        for &Ending { vertex, all, local, share, slope } in &self.endings {
            let (at, seat) = (vertex as usize, &self.seats[vertex as usize]);
            let carried_by = |host: u32, local| trilinear(&self.hosts[host as usize].map(corner), local);
            let (one, all) = (carried_by(seat.host, seat.local), carried_by(all, local));
            let apart = [0, 1, 2].map(|axis| all.0[axis] - one.0[axis]);
            let value = [0, 1, 2].map(|axis| one.0[axis] + share * apart[axis]);
            let slopes = [0, 1, 2].map(|step| {
                let mix = |axis: usize| one.1[step][axis] + share * (all.1[step][axis] - one.1[step][axis]);
                [0, 1, 2].map(|axis| mix(axis) + slope[step] * apart[axis])
            });
            carried.moved[at] = value;
            carried.positions[at] = [0, 1, 2].map(|axis| (rest[at][axis] + f64::from(value[axis])) as f32);
            carried.normals[at] = turn(normals[at], &slopes, &to_index);
        }
    }
}

/// What a corner that does not carry is continued from: the corners that do, the nearer the more.
fn sources(carrying: u8, particles: &[u32; 8], corner: usize) -> Vec<(u32, u32, f32, [f32; 3])> {
    let steps = |from: usize| [0, 1, 2].map(|axis| (corner >> axis & 1) as f32 - (from >> axis & 1) as f32);
    let near = (0..8).filter(|from| carrying >> from & 1 == 1);
    let weight = |from: usize| 1.0 / (from ^ corner).count_ones().pow(2) as f32;
    let total: f32 = near.clone().map(weight).sum();
    near.map(|from| (particles[from], 0, weight(from) / total, steps(from))).collect()
}

/// Value of eight corners, x fastest, and its slopes along the three axes of the cell.
// What is done for every vertex is compiled into the loop over them, though the ends of cuts need it too.
#[inline(always)]
fn trilinear(corners: &[[f32; 3]; 8], [x, y, z]: [f32; 3]) -> ([f32; 3], [[f32; 3]; 3]) {
    let mix = |a: [f32; 3], b: [f32; 3], t: f32| [0, 1, 2].map(|axis| a[axis] + t * (b[axis] - a[axis]));
    let less = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|axis| b[axis] - a[axis]);
    let c = corners;
    let along_x = [mix(c[0], c[1], x), mix(c[2], c[3], x), mix(c[4], c[5], x), mix(c[6], c[7], x)];
    let along_y = [mix(along_x[0], along_x[1], y), mix(along_x[2], along_x[3], y)];
    let x_slopes = [less(c[0], c[1]), less(c[2], c[3]), less(c[4], c[5]), less(c[6], c[7])];
    let slope_x = mix(mix(x_slopes[0], x_slopes[1], y), mix(x_slopes[2], x_slopes[3], y), z);
    let slope_y = mix(less(along_x[0], along_x[1]), less(along_x[2], along_x[3]), z);
    (mix(along_y[0], along_y[1], z), [slope_x, slope_y, less(along_y[0], along_y[1])])
}

/// A normal after a deformation of gradient F = 1 + (slopes) (index axes)^-1: the unit vector along cofactor(F) n.
#[inline(always)]
fn turn(normal: [f32; 3], slopes: &[[f32; 3]; 3], to_index: &[[f32; 3]; 3]) -> [f32; 3] {
    // Columns of F.
    let f: [[f32; 3]; 3] = std::array::from_fn(|column| {
        std::array::from_fn(|row| {
            let bent: f32 = (0..3).map(|step| slopes[step][row] * to_index[step][column]).sum();
            bent + if row == column { 1.0 } else { 0.0 }
        })
    });
    let cross =
        |a: [f32; 3], b: [f32; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let columns = [cross(f[1], f[2]), cross(f[2], f[0]), cross(f[0], f[1])];
    let turned = [0, 1, 2].map(|row| (0..3).map(|column| columns[column][row] * normal[column]).sum::<f32>());
    let length = turned.iter().map(|c| c * c).sum::<f32>().sqrt();
    if length > f32::MIN_POSITIVE && length.is_finite() { turned.map(|c| c / length) } else { normal }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_turn_with_the_cofactor() {
        let f = Matrix3::new(1.1, 0.3, 0.0, -0.2, 0.9, 0.1, 0.05, 0.0, 1.3);
        let axes = Matrix3::new(0.0, -3.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 3.0);
        let bend = (f - Matrix3::identity()) * axes;
        let slopes = [0, 1, 2].map(|column| [0, 1, 2].map(|row| bend[(row, column)] as f32));
        let inverse = axes.try_inverse().unwrap();
        let to_index = std::array::from_fn(|row| std::array::from_fn(|column| inverse[(row, column)] as f32));
        let normal = Vector3::new(0.6, 0.0, 0.8);
        let expected = (f.try_inverse().unwrap().transpose() * normal * f.determinant()).normalize();
        let found = turn([0.6, 0.0, 0.8], &slopes, &to_index);
        for axis in 0..3 {
            assert!((f64::from(found[axis]) - expected[axis]).abs() < 1e-6, "{found:?} against {expected}");
        }
    }
}
