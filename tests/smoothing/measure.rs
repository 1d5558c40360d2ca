//! How far a mesh is from the solid it was made of.

use yawara::geometry::{Affine, Grid, GridShape};
use yawara::lattice::Topology;
use yawara::lattice::build::{NO_ORGAN, build};
use yawara::surface::Surface;
use yawara::surface::mesh::TriangleMesh;
use yawara::volume::Volume;

use crate::solids::{Solid, dot, minus, norm, outward, unit};

#[derive(Debug)]
pub(crate) struct Measured {
    /// Mean and root mean square of the distance of the vertices \[voxels\].
    pub(crate) mean: f64,
    pub(crate) rms: f64,
    /// Relative errors.
    pub(crate) volume: f64,
    pub(crate) area: f64,
    /// Mean angle to the true normal, of triangles by area, and of the field's gradient at the vertices \[degrees\].
    pub(crate) triangles: f64,
    pub(crate) gradient: f64,
}

/// The surface of a field as organs are drawn: straight between the points of the grid, without cuts.
pub(crate) fn mesh_of(shape: GridShape, field: &[f32]) -> TriangleMesh {
    let grid = Grid { shape, affine: Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap() };
    let inside = field.iter().map(|&value| if value > 0.0 { 0 } else { NO_ORGAN }).collect();
    let lattice = build(&Volume::from_vec(grid, inside)).unwrap();
    let value = |point: usize| {
        let place: [f64; 3] = lattice.grid.place(point).into();
        let index = place.map(|c| c.round() as i64);
        let within = (0..3).all(|axis| (0..shape.dims()[axis] as i64).contains(&index[axis]));
        if within { field[shape.linear(index.map(|i| i as usize))] } else { -1.0 }
    };
    let values: Vec<f32> = (0..lattice.grid.shape.len()).map(value).collect();
    Surface::extract(&lattice, &Topology::new(&lattice), &values).unwrap().at_rest(&lattice)
}

pub(crate) fn measure(solid: &Solid, field: &[f32]) -> Measured {
    let mesh = mesh_of(solid.shape, field);
    let place = |vertex: u32| mesh.positions[vertex as usize].map(f64::from);
    let (mut mean, mut square, mut gradient) = (0.0, 0.0, 0.0);
    let vertices = mesh.positions.len() as f64;
    for position in &mesh.positions {
        let position = position.map(f64::from);
        let distance = (solid.distance)(position);
        mean += distance / vertices;
        square += distance * distance / vertices;
        gradient += angle(downhill(solid.shape, field, position), outward(solid, position)) / vertices;
    }
    let (mut volume, mut area, mut triangles) = (0.0, 0.0, 0.0);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(place);
        let normal = cross(minus(b, a), minus(c, a));
        let size = norm(normal) / 2.0;
        volume += dot(a, normal) / 6.0;
        area += size;
        if size > 1e-9 {
            let middle = [0, 1, 2].map(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
            triangles += size * angle(unit(normal), outward(solid, middle));
        }
    }
    Measured {
        mean,
        rms: square.sqrt(),
        volume: volume / solid.volume - 1.0,
        area: area / solid.area - 1.0,
        triangles: triangles / area,
        gradient,
    }
}

/// Direction in which a field falls: central differences at the grid points, linear between them.
fn downhill(shape: GridShape, field: &[f32], place: [f64; 3]) -> [f64; 3] {
    let base = place.map(|x| x.floor().max(0.0));
    let share = minus(place, base);
    let value = |ijk: [i64; 3]| {
        let dims = shape.dims();
        let index = [0, 1, 2].map(|axis| ijk[axis].clamp(0, dims[axis] as i64 - 1) as usize);
        f64::from(field[shape.linear(index)])
    };
    let mut total = [0.0; 3];
    for corner in 0..8 {
        let side = [corner & 1, corner >> 1 & 1, corner >> 2];
        let ijk = [0, 1, 2].map(|axis| base[axis] as i64 + side[axis]);
        let weight: f64 = (0..3).map(|axis| if side[axis] == 1 { share[axis] } else { 1.0 - share[axis] }).product();
        for (axis, total) in total.iter_mut().enumerate() {
            let beside = |by: i64| {
                let mut ijk = ijk;
                ijk[axis] += by;
                value(ijk)
            };
            *total -= weight * (beside(1) - beside(-1));
        }
    }
    unit(total)
}

fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    dot(a, b).clamp(-1.0, 1.0).acos().to_degrees()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
