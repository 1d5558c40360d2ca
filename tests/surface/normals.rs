//! Places and normals of plain fields against shapes that are known, clean and with noise.

use yawara::geometry::{Affine, GridShape, Matrix3, Point3, Vector3};
use yawara::surface::check::check;
use yawara::surface::field_normals::{GradientOf, field_normals};
use yawara::surface::marching_cubes;
use yawara::surface::mesh::TriangleMesh;

use crate::support::Random;

/// Signed distance (above zero inside) and outward direction, by grid index.
type Shape = fn(Vector3) -> (f64, Vector3);

const N: usize = 64;

const MIDDLE: f64 = 31.3;

const RADIUS: f64 = 22.0;

fn sphere(index: Vector3) -> (f64, Vector3) {
    let from = index - Vector3::repeat(MIDDLE);
    (RADIUS - from.norm(), from.normalize())
}

fn torus(index: Vector3) -> (f64, Vector3) {
    let from = index - Vector3::repeat(MIDDLE);
    let ring = Vector3::new(from.x, from.y, 0.0).normalize() * 18.0;
    (8.0 - (from - ring).norm(), (from - ring).normalize())
}

/// A piece of the gyroid with a period of 40 spacings, in a ball.
fn gyroid(index: Vector3) -> (f64, Vector3) {
    let rate = std::f64::consts::TAU / 40.0;
    let (s, c) = (index.map(|x| (rate * x).sin()), index.map(|x| (rate * x).cos()));
    let value = s.x * c.y + s.y * c.z + s.z * c.x;
    let slope = Vector3::new(c.x * c.y - s.z * s.x, c.y * c.z - s.x * s.y, c.z * c.x - s.y * s.z) * rate;
    (-value / slope.norm(), slope.normalize())
}

const SHAPES: [(&str, Shape); 3] = [("sphere", sphere), ("torus", torus), ("gyroid", gyroid)];

fn grid() -> GridShape {
    GridShape::new(N, N, N)
}

fn sampled(shape: Shape, mut value: impl FnMut(f64) -> f64) -> Vec<f32> {
    let index = |p| Vector3::from(grid().ijk(p).map(|i| i as f64));
    (0..grid().len()).map(|p| value(shape(index(p)).0) as f32).collect()
}

/// Sheared, turned and mirrored axes of different lengths.
fn skewed() -> Affine {
    let linear = Matrix3::new(0.7, 0.2, 0.0, -0.1, 0.9, 0.3, 0.1, 0.0, -1.6);
    Affine::from_parts(linear, Vector3::new(120.0, -80.0, 900.0)).unwrap()
}

fn indices(affine: &Affine, mesh: &TriangleMesh) -> Vec<[f64; 3]> {
    mesh.positions.iter().map(|p| affine.index_of(Point3::from(p.map(f64::from))).into()).collect()
}

/// Mean angle \[degrees\] to the true normals, over vertices well inside the grid.
fn mean_error(shape: Shape, affine: &Affine, indices: &[[f64; 3]], normals: &[[f32; 3]]) -> f64 {
    let mut errors = Vec::new();
    for (&index, normal) in indices.iter().zip(normals) {
        if index.iter().all(|&i| (3.0..N as f64 - 4.0).contains(&i)) {
            let outward = shape(Vector3::from(index)).1;
            let truth = [Vector3::x(), Vector3::y(), Vector3::z()]
                .map(|axis| affine.index_vector_of(axis))
                .map(|column| column.dot(&outward));
            let normal = Vector3::from(normal.map(f64::from));
            assert!((normal.norm() - 1.0).abs() < 1e-5, "{normal}");
            errors.push(normal.angle(&Vector3::from(truth)));
        }
    }
    assert!(errors.len() > 3000, "{}", errors.len());
    (errors.iter().sum::<f64>() / errors.len() as f64).to_degrees()
}

#[test]
fn normals_of_clean_fields_are_within_a_degree() {
    for affine in [Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap(), skewed()] {
        for (name, shape) in SHAPES {
            let values = sampled(shape, |distance| distance);
            for of in [GradientOf::Field, GradientOf::Smoothed] {
                let mesh = marching_cubes(grid(), &affine, &values, of).unwrap();
                assert!(check(&mesh).passes(), "{name}");
                let error = mean_error(shape, &affine, &indices(&affine, &mesh), &mesh.normals);
                eprintln!("{name}, {of:?}: {error:.3} degrees");
                assert!(error < 0.5, "{name}, {of:?}: {error}");
            }
        }
    }
}

#[test]
fn smoothed_normals_stand_three_percent_of_noise() {
    let affine = Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap();
    for (name, shape) in SHAPES {
        let mut random = Random::new(3);
        // Sum of 12 uniform numbers: deviation 1. The ramp goes from -1 to 1 over two spacings: 3 % of 2.
        let mut noise = || 0.06 * ((0..12).map(|_| random.unit()).sum::<f64>() - 6.0);
        let values = sampled(shape, |distance| distance.clamp(-1.0, 1.0) + noise());
        let error = |of| {
            let mesh = marching_cubes(grid(), &affine, &values, of).unwrap();
            mean_error(shape, &affine, &indices(&affine, &mesh), &mesh.normals)
        };
        let [rough, smooth] = [GradientOf::Field, GradientOf::Smoothed].map(error);
        eprintln!("{name}: {rough:.2} degrees from the field, {smooth:.2} smoothed");
        assert!(smooth < 1.5 && smooth < 0.6 * rough, "{name}: {rough}, {smooth}");
    }
}

#[test]
fn a_sphere_is_met_within_a_thousandth_of_the_spacing() {
    let exact = 4.0 * std::f64::consts::PI * RADIUS * RADIUS;
    let ramp = |distance: f64| distance.clamp(-1.5, 1.5);
    for (name, values, bound) in [
        ("distance", sampled(sphere, |distance| distance), 1e-3),
        // The ends of a ramp over three spacings bend a few edges a little.
        ("grey", sampled(sphere, ramp), 1.5e-3),
    ] {
        let affine = Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap();
        let mesh = marching_cubes(grid(), &affine, &values, GradientOf::Field).unwrap();
        let report = check(&mesh);
        assert!(report.passes() && report.euler == 2, "{report}");
        let errors: Vec<f64> = indices(&affine, &mesh).into_iter().map(|i| sphere(Vector3::from(i)).0.abs()).collect();
        let worst = errors.iter().copied().fold(0.0, f64::max);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        eprintln!(
            "{name}: radius within {worst:.2e}, {mean:.2e} on average; area {:+.3} %",
            100.0 * (report.area_mm2 / exact - 1.0)
        );
        assert!(worst < bound, "{name}: {worst}");
        assert!((report.area_mm2 / exact - 1.0).abs() < 0.01, "{name}: {report}");
    }
}

/// The function for any places gives what the mesh was given on its edges, and interpolates in between.
#[test]
fn normals_at_any_place_agree_with_those_of_the_mesh() {
    let affine = skewed();
    let values = sampled(torus, |distance| distance);
    for of in [GradientOf::Field, GradientOf::Smoothed] {
        let mesh = marching_cubes(grid(), &affine, &values, of).unwrap();
        let at = indices(&affine, &mesh);
        let normals = field_normals(grid(), &affine, &values, of, &at).unwrap();
        for (a, b) in normals.iter().zip(&mesh.normals) {
            assert!((0..3).all(|axis| (a[axis] - b[axis]).abs() < 2e-3), "{a:?} {b:?}");
        }
        // Anywhere near the surface, not only on edges.
        let mut random = Random::new(7);
        let near: Vec<[f64; 3]> = at.iter().map(|i| i.map(|c| c + 0.5 * random.unit())).collect();
        let normals = field_normals(grid(), &affine, &values, of, &near).unwrap();
        let error = mean_error(torus, &affine, &near, &normals);
        assert!(error < 1.0, "{error}");
    }
}

#[test]
fn borders_nans_and_flat_fields_are_met() {
    let affine = Affine::from_spacing([2.0, 1.0, 1.0], [0.0; 3]).unwrap();
    let shape = GridShape::new(4, 4, 4);
    let slope: Vec<f32> = (0..shape.len()).map(|p| 1.5 - shape.ijk(p)[0] as f32).collect();
    let mut holed = slope.clone();
    holed[shape.linear([2, 2, 2])] = f32::NAN;
    for of in [GradientOf::Field, GradientOf::Smoothed] {
        // The slope is known up to the border, and beside a NaN; beyond the grid the way is straight out.
        let at = [[0.0, 0.0, 0.0], [1.5, 3.0, 0.0], [1.5, 2.0, 2.0], [3.0, 1.2, 2.7]];
        for values in [&slope, &holed] {
            let normals = field_normals(shape, &affine, values, of, &at).unwrap();
            assert_eq!(normals, [[1.0, 0.0, 0.0]; 4], "{of:?}");
        }
        let beyond = field_normals(shape, &affine, &slope, of, &[[1.0, -0.5, 1.0], [1.0, 1.0, 3.5]]).unwrap();
        assert_eq!(beyond, [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]);
        let flat = field_normals(shape, &affine, &[1.0; 64], of, &[[1.0; 3], [f64::NAN, 0.0, 0.0]]).unwrap();
        assert_eq!(flat, [[0.0; 3]; 2]);
        assert!(field_normals(shape, &affine, &[1.0; 63], of, &[]).is_err());
        // A sheet one point thin has no gradient of its own: the triangles give its normals.
        let sheet: Vec<f32> = (0..shape.len()).map(|p| if shape.ijk(p)[2] == 1 { 1.0 } else { -1.0 }).collect();
        let mesh = marching_cubes(shape, &affine, &sheet, of).unwrap();
        for (place, normal) in mesh.positions.iter().zip(&mesh.normals) {
            let inner = place[0] > 0.1 && place[0] < 5.9 && place[1] > 0.1 && place[1] < 2.9;
            assert!(!inner || normal[2] * (place[2] - 1.0) > 0.45, "{place:?} {normal:?}");
        }
    }
}
