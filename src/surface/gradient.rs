//! How the tissue around a particle is deformed: the gradient that carries vertices beyond the last particle.
//!
//! ```text
//! enough neighbours in space    least squares over the surviving springs, weight 1 / distance^2
//! fewer, or all in one plane    mean over the linked neighbours that have enough
//! none of those either          the rotation that fits best (sheets, chains); the identity for a lone particle
//! then                          singular values held within [0.1, 4]
//! ```
//! The clamp keeps a crushed, inverted or exploding neighbourhood from throwing vertices about: a vertex stays within
//! four edge lengths of its particle. Homogeneous deformations within these stretches are reproduced to rounding.

use nalgebra::{Rotation3, Unit};
use rayon::prelude::*;

use crate::geometry::{Affine, Matrix3, Vector3};
use crate::lattice::{Lattice, neighbours};

/// Smallest and largest stretch a gradient may have. 0.1 keeps a crushed neighbourhood from turning the surface inside out; at 4,
/// twice the stretch at which soft tissue tears, a vertex still lies within four pitches of its particle.
const STRETCH: [f64; 2] = [0.1, 4.0];

/// A neighbourhood spans space when the smallest eigenvalue of its moment matrix is above this. Three springs that span
/// space at all have 0.07 or more; three in a plane have 0 up to rounding.
const SPANS: f64 = 1e-3;

/// The particles whose gradients a surface needs, with everything that does not change between frames.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gradients {
    /// Neighbourhoods that span space: their gradients come first.
    full: Vec<Neighbourhood>,
    /// The rest, in the order of their gradients after those.
    poor: Vec<Neighbourhood>,
    /// For each poor one: gradients of its linked neighbours to average.
    helpers: Vec<Vec<u32>>,
}

#[derive(Debug, Clone)]
struct Neighbourhood {
    particle: u32,
    /// Surviving springs.
    alive: u32,
    /// Inverse of the moment matrix, in index space: xx, xy, xz, yy, yz, zz.
    inverse: [f64; 6],
}

/// Displacement per step along each grid axis [mm]: columns of (F - 1) M, where M maps indices to patient space.
pub(crate) type AxisDisplacements = [[f32; 3]; 3];

fn offset(direction: usize) -> Vector3 {
    Vector3::from(neighbours::OFFSETS[direction].map(f64::from))
}

fn weight(direction: usize) -> f64 {
    1.0 / neighbours::family(direction) as f64
}

/// Whether some springs of a particle do not all lie in a plane.
pub(crate) fn spans(alive: u32) -> bool {
    moment(alive).symmetric_eigenvalues().min() > SPANS
}

/// Sum of weight * offset * offset^T over some springs.
fn moment(alive: u32) -> Matrix3 {
    directions(alive).map(|d| offset(d) * offset(d).transpose() * weight(d)).sum()
}

fn directions(alive: u32) -> impl Iterator<Item = usize> {
    (0..neighbours::NEIGHBOURS).filter(move |direction| alive >> direction & 1 == 1)
}

impl Neighbourhood {
    /// The neighbourhood of a particle, and whether it spans space.
    fn new(particle: u32, alive: u32) -> (Self, bool) {
        let spans = spans(alive);
        let i = if spans { moment(alive).try_inverse().unwrap_or_else(Matrix3::zeros) } else { Matrix3::zeros() };
        let inverse = [i[(0, 0)], i[(0, 1)], i[(0, 2)], i[(1, 1)], i[(1, 2)], i[(2, 2)]];
        (Self { particle, alive, inverse }, spans)
    }

    /// Sum of weight * (displacement difference) * offset^T over the surviving springs \[mm\].
    fn moment_of(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> Matrix3 {
        let own = displacements[self.particle as usize];
        let point = i64::from(lattice.points[self.particle as usize]);
        let shape = lattice.grid.shape;
        let strides = [1, shape.nx as i64, (shape.nx * shape.ny) as i64];
        let mut sum = [[0.0_f64; 3]; 3];
        for direction in directions(self.alive) {
            // A living spring has both its ends on the grid, so no border needs watching.
            let step: i64 = (0..3).map(|axis| strides[axis] * i64::from(neighbours::OFFSETS[direction][axis])).sum();
            let their = displacements[lattice.particle_at[(point + step) as usize] as usize];
            let (offset, weight) = (neighbours::OFFSETS[direction].map(f64::from), weight(direction));
            for row in 0..3 {
                let difference = weight * (f64::from(their[row]) - f64::from(own[row]));
                for column in 0..3 {
                    sum[column][row] += difference * offset[column];
                }
            }
        }
        Matrix3::from_columns(&sum.map(Vector3::from))
    }

    /// Least-squares gradient of the displacement in index space, (F - 1) M.
    fn least_squares(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> Matrix3 {
        let [xx, xy, xz, yy, yz, zz] = self.inverse;
        self.moment_of(lattice, displacements) * Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// The rotation nearest to what the surviving springs did.
    fn rotation(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> Matrix3 {
        let axes = lattice.grid.affine.linear();
        let rest = axes * moment(self.alive);
        // Sum of weight * deformed * rest^T, in patient space.
        let fit = (rest + self.moment_of(lattice, displacements)) * axes.transpose();
        let size = fit.norm();
        if !(size.is_finite() && size > 0.0) {
            return Matrix3::identity();
        }
        let svd = fit.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
        let [first, second, third] = order;
        if svd.singular_values[second] < 1e-6 * svd.singular_values[first] {
            // A chain: turned as little as its direction demands.
            let (from, to) = (v_t.row(first).transpose(), u.column(first).into_owned());
            // Not by the arc cosine: of unit vectors that are nearly one it is not a number when rounding makes their product
            // larger than 1.
            let across = from.cross(&to);
            let angle = across.norm().atan2(from.dot(&to));
            return Unit::try_new(across, 1e-12)
                .map_or_else(Matrix3::identity, |axis| Rotation3::from_axis_angle(&axis, angle).into_inner());
        }
        let mut signs = Vector3::repeat(1.0);
        signs[third] = (u.determinant() * v_t.determinant()).signum();
        u * Matrix3::from_diagonal(&signs) * v_t
    }
}

/// Holds the singular values of a deformation gradient within [`STRETCH`]; a mirrored one is flipped back.
fn tamed(f: Matrix3) -> Matrix3 {
    let [low, high] = STRETCH;
    let size = f.norm_squared();
    if !size.is_finite() {
        return Matrix3::identity();
    }
    // The largest singular value is at most |F|, the smallest at least 2 det F / |F|^2.
    let determinant = f.determinant();
    if size <= high * high && determinant > 0.0 && 2.0 * determinant >= low * size {
        return f;
    }
    let svd = f.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    let mut values = svd.singular_values;
    let mut smallest = values.imin();
    if u.determinant() * v_t.determinant() >= 0.0 {
        smallest = usize::MAX;
    }
    for (at, value) in values.iter_mut().enumerate() {
        // With the smallest direction mirrored, its signed stretch is negative: the clamp brings it back to `low`.
        *value = if at == smallest { -low } else { value.clamp(low, high) };
    }
    u * Matrix3::from_diagonal(&values) * v_t
}

impl Gradients {
    /// Prepares the gradients of the given particles; returns them with the index of each one's gradient.
    pub(crate) fn new(lattice: &Lattice, alive: &[u32], particles: &[u32]) -> (Self, Vec<u32>) {
        const UNSET: u32 = u32::MAX;
        let mut result = Self::default();
        // Index among the full ones, by particle.
        let mut full_at = vec![UNSET; if particles.is_empty() { 0 } else { lattice.len() }];
        let mut poor = Vec::new();
        let neighbourhoods: Vec<_> =
            particles.par_iter().map(|&particle| Neighbourhood::new(particle, alive[particle as usize])).collect();
        let mut index = vec![UNSET; particles.len()];
        for (place, (neighbourhood, spans)) in neighbourhoods.into_iter().enumerate() {
            if spans {
                index[place] = result.full.len() as u32;
                full_at[neighbourhood.particle as usize] = index[place];
                result.full.push(neighbourhood);
            } else {
                poor.push((place, neighbourhood));
            }
        }
        for (_, neighbourhood) in &poor {
            let mut helpers = Vec::new();
            for direction in directions(neighbourhood.alive) {
                let Some(other) = lattice.neighbour(neighbourhood.particle, direction) else { continue };
                if full_at[other as usize] == UNSET {
                    let (theirs, spans) = Neighbourhood::new(other, alive[other as usize]);
                    if !spans {
                        continue;
                    }
                    full_at[other as usize] = result.full.len() as u32;
                    result.full.push(theirs);
                }
                helpers.push(full_at[other as usize]);
            }
            result.helpers.push(helpers);
        }
        for (rank, (place, neighbourhood)) in poor.into_iter().enumerate() {
            index[place] = (result.full.len() + rank) as u32;
            result.poor.push(neighbourhood);
        }
        (result, index)
    }

    /// The gradients under the given displacements (RAS+ \[mm\], one per particle).
    pub(crate) fn evaluate(&self, lattice: &Lattice, displacements: &[[f32; 3]]) -> Vec<AxisDisplacements> {
        let affine = &lattice.grid.affine;
        let (axes, to_index) = (affine.linear(), inverse_axes(affine));
        let deformation = |g: Matrix3| tamed(Matrix3::identity() + g * to_index);
        let full: Vec<Matrix3> =
            self.full.par_iter().map(|n| deformation(n.least_squares(lattice, displacements))).collect();
        let poor: Vec<Matrix3> = self
            .poor
            .par_iter()
            .zip(&self.helpers)
            .map(|(neighbourhood, helpers)| {
                if helpers.is_empty() {
                    return neighbourhood.rotation(lattice, displacements);
                }
                let sum: Matrix3 = helpers.iter().map(|&helper| full[helper as usize]).sum();
                tamed(sum / helpers.len() as f64)
            })
            .collect();
        full.into_par_iter()
            .chain(poor)
            .map(|f| {
                let g = (f - Matrix3::identity()) * axes;
                [0, 1, 2].map(|column| [0, 1, 2].map(|row| g[(row, column)] as f32))
            })
            .collect()
    }
}

fn inverse_axes(affine: &Affine) -> Matrix3 {
    Matrix3::from_columns(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| affine.index_vector_of(axis)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taming_leaves_sound_gradients_alone_and_bounds_the_rest() {
        let turn = Rotation3::from_euler_angles(0.3, -1.0, 2.0).into_inner();
        let sound = turn * Matrix3::new(1.5, 0.2, 0.0, 0.0, 0.6, 0.1, 0.0, 0.0, 1.1);
        assert!((tamed(sound) - sound).norm() < 1e-12);
        let wild = [
            turn * Matrix3::from_diagonal(&Vector3::new(1e6, 1.0, 1e-9)),
            Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)),
            Matrix3::zeros(),
            Matrix3::repeat(f64::NAN),
            Matrix3::repeat(f64::INFINITY),
        ];
        for f in wild {
            let values = tamed(f).singular_values();
            assert!(values.iter().all(|v| (STRETCH[0] - 1e-9..=STRETCH[1] + 1e-9).contains(v)), "{f}: {values}");
        }
        let mirrored = tamed(Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -0.5)));
        assert!((mirrored - Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, STRETCH[0]))).norm() < 1e-12);
    }

    /// The bound on the eigenvalue tells three springs that span space from three that do not.
    #[test]
    fn spanning_is_decided_far_from_rounding() {
        let (mut spanning, mut smallest) = (0, f64::INFINITY);
        for a in 0..26 {
            for b in a + 1..26 {
                for c in b + 1..26 {
                    let determinant = Matrix3::from_columns(&[offset(a), offset(b), offset(c)]).determinant();
                    let moment: Matrix3 = [a, b, c].map(|d| offset(d) * offset(d).transpose() * weight(d)).iter().sum();
                    let lowest = moment.symmetric_eigenvalues().min();
                    assert_eq!(determinant.abs() > 0.5, lowest > SPANS);
                    if determinant.abs() > 0.5 {
                        spanning += 1;
                        smallest = smallest.min(lowest);
                    }
                }
            }
        }
        assert!(spanning > 1000);
        assert!(smallest > 0.03, "{smallest}");
    }
}
