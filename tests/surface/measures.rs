//! Volumes, radii and normals against shapes that are known.

use yawara::geometry::{Affine, GridShape, Vector3};
use yawara::lattice::Topology;
use yawara::surface::check::check;
use yawara::surface::field_normals::GradientOf;
use yawara::surface::{Surface, SurfaceError, field, marching_cubes};

use crate::support::{Random, ball, cut_plane, extract, lattice, lattice_on, unit_grid};

fn sphere_field(n: usize, radius: f32) -> (GridShape, Affine, Vec<f32>) {
    let shape = GridShape::new(n, n, n);
    let middle = (n as f32 - 1.0) / 2.0;
    let value = |p| {
        let [x, y, z] = shape.ijk(p).map(|i| i as f32 - middle);
        radius - (x * x + y * y + z * z).sqrt()
    };
    let affine = Affine::from_spacing([1.0; 3], [-f64::from(middle); 3]).unwrap();
    (shape, affine, (0..shape.len()).map(value).collect())
}

#[test]
fn a_sphere_has_the_right_radius_volume_and_normals() {
    let (shape, affine, values) = sphere_field(64, 25.0);
    let mesh = marching_cubes(shape, &affine, &values, GradientOf::Field).unwrap();
    let report = check(&mesh);
    assert!(report.passes() && report.components.len() == 1 && report.euler == 2, "{report}");
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 25.0_f64.powi(3);
    assert!((report.volume_mm3 / exact - 1.0).abs() < 2e-3, "{} against {exact}", report.volume_mm3);
    for (place, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let (place, normal) = (Vector3::from(place.map(f64::from)), Vector3::from(normal.map(f64::from)));
        assert!((place.norm() - 25.0).abs() < 0.001, "{}", place.norm());
        assert!(place.normalize().dot(&normal) > 0.999, "{place} {normal}");
    }
}

/// A plain field and a fully linked lattice with the same values give the same triangles, on the same grid edges.
#[test]
fn with_and_without_a_lattice_the_mesh_is_the_same() {
    let mut random = Random::new(5);
    for _ in 0..50 {
        let grid = unit_grid(2 + random.below(70), 2 + random.below(5), 2 + random.below(5));
        let values: Vec<f32> = (0..grid.shape.len()).map(|_| random.unit() as f32 - 0.5).collect();
        let lattice = lattice_on(grid, |_| true);
        let plain = marching_cubes(grid.shape, &grid.affine, &values, GradientOf::Field).unwrap();
        let surface = Surface::extract(&lattice, &Topology::new(&lattice), &values).unwrap();
        assert!(check(&plain).passes());
        assert_eq!(plain.triangles, surface.triangles());
        let carried = surface.at_rest(&lattice);
        for (a, b) in plain.positions.iter().zip(&carried.positions) {
            let apart = [0, 1, 2].map(|axis| (a[axis] - b[axis]).abs());
            // Along its edge each has its own interpolation.
            assert!(apart.iter().all(|&d| d < 1.0) && apart.iter().filter(|&&d| d > 1e-5).count() <= 1, "{a:?} {b:?}");
        }
    }
}

#[test]
fn zeros_nans_and_infinities_in_a_field_do_no_harm() {
    let mut random = Random::new(11);
    let values_to_pick = [0.0, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-38, -1e-38, 1.0, -1.0, 3e38, -3e38];
    let affine = Affine::from_spacing([1.0, 2.0, -3.0], [0.0; 3]).unwrap();
    for _ in 0..200 {
        let shape = GridShape::new(5, 6, 4);
        let values: Vec<f32> = (0..shape.len()).map(|_| values_to_pick[random.below(values_to_pick.len())]).collect();
        let report = check(&marching_cubes(shape, &affine, &values, GradientOf::Field).unwrap());
        assert!(report.passes(), "{report}");
    }
    let error = marching_cubes(GridShape::new(2, 2, 2), &affine, &[0.0; 7], GradientOf::Field).unwrap_err();
    assert!(matches!(error, SurfaceError::FieldLength { found: 7, expected: 8, .. }));
}

/// Smoothing takes staircases away and keeps the volume of the particles.
#[test]
fn smoothed_fields_keep_the_volume_and_lose_the_staircases() {
    for radius in [2.3, 4.2, 8.2, 14.2] {
        let lattice = lattice(32, 32, 32, ball(32, radius));
        let [rough, smooth] = [0, field::SMOOTHING_PASSES].map(|passes| {
            let values = field::smoothed(&lattice, 0, passes);
            let surface = Surface::extract(&lattice, &Topology::new(&lattice), &values).unwrap();
            let mesh = surface.at_rest(&lattice);
            let report = check(&mesh);
            assert!(report.passes(), "{report}");
            let error = report.volume_mm3 / lattice.len() as f64 - 1.0;
            let distance = |p: &[f32; 3]| (Vector3::from(p.map(f64::from)) - Vector3::repeat(15.5)).norm();
            let count = mesh.positions.len() as f64;
            let mean = mesh.positions.iter().map(distance).sum::<f64>() / count;
            let rms = (mesh.positions.iter().map(|p| (distance(p) - mean).powi(2)).sum::<f64>() / count).sqrt();
            eprintln!("ball {radius}, {passes} passes: volume {:+.2} %, roughness {rms:.3}", 100.0 * error);
            (error, rms)
        });
        assert!(smooth.0.abs() < 2e-4 && smooth.1 < 0.5 * rough.1 && smooth.1 < 0.08, "{radius}: {smooth:?}");
    }
    let block = lattice(12, 12, 12, |ijk| ijk.iter().all(|&i| (2..10).contains(&i)));
    let tube = lattice(40, 11, 11, |[_, j, k]| (j as f64 - 5.0).powi(2) + (k as f64 - 5.0).powi(2) < 6.0);
    let sheet = lattice(12, 12, 12, |ijk| ijk[2] == 5);
    let speck = lattice(5, 5, 5, |ijk| ijk == [2, 2, 2]);
    for (name, lattice, tolerance) in
        [("block", &block, 2e-4), ("tube", &tube, 2e-4), ("sheet", &sheet, 2e-4), ("speck", &speck, 0.9)]
    {
        let values = field::smoothed(lattice, 0, field::SMOOTHING_PASSES);
        let surface = Surface::extract(lattice, &Topology::new(lattice), &values).unwrap();
        let report = check(&surface.at_rest(lattice));
        let error = report.volume_mm3 / lattice.len() as f64 - 1.0;
        eprintln!("{name}: volume {:+.2} %", 100.0 * error);
        assert!(report.passes() && error.abs() < tolerance, "{name}: {error}, {report}");
    }
}

/// HU moves the crossings, membership alone decides what is inside.
#[test]
fn hu_places_the_surface_within_the_organ() {
    let n = 24;
    let lattice = lattice(n, n, n, ball(n, 8.3));
    // Tissue of 100 HU in water of 0 with a border 2 voxels wide round a radius of 8.6: the level of 50 HU lies at 8.6.
    let radius = |p: usize| (Vector3::from(lattice.grid.shape.ijk(p).map(|i| i as f64)) - Vector3::repeat(11.5)).norm();
    let hu: Vec<f32> =
        (0..lattice.grid.shape.len()).map(|p| (50.0 + 50.0 * (8.6 - radius(p))).clamp(0.0, 100.0) as f32).collect();
    let values = field::from_hu(&lattice, 0, &hu, [50.0, f32::INFINITY], 50.0);
    let binary = field::binary(&lattice, 0);
    assert!(values.iter().zip(&binary).all(|(value, member)| (*value > 0.0) == (*member > 0.0)));
    let surface = Surface::extract(&lattice, &Topology::new(&lattice), &values).unwrap();
    let mesh = surface.at_rest(&lattice);
    assert!(check(&mesh).passes());
    let errors =
        mesh.positions.iter().map(|p| ((Vector3::from(p.map(f64::from)) - Vector3::repeat(11.5)).norm() - 8.6).powi(2));
    let rms = (errors.sum::<f64>() / mesh.positions.len() as f64).sqrt();
    // Exact where the level lies between an inside and an outside point, held back by membership elsewhere.
    assert!(rms < 0.2, "{rms}");
    let unknown = field::from_hu(&lattice, 0, &vec![f32::NAN; hu.len()], [50.0, f32::INFINITY], 50.0);
    assert!(unknown.iter().all(|v| v.is_finite()));
}

/// The faces of a cut keep their own normals up to the rim; the skin keeps its own too.
#[test]
fn normals_of_a_cut_face_are_those_of_the_blade() {
    let lattice = lattice(10, 8, 8, |_| true);
    let mut topology = Topology::new(&lattice);
    cut_plane(&lattice, &mut topology, Vector3::new(4.4, 0.0, 0.0), Vector3::x(), |_| true);
    let surface = extract(&lattice, &topology);
    let mesh = surface.at_rest(&lattice);
    let mut seen = 0;
    for ((place, normal), seam) in mesh.positions.iter().zip(&mesh.normals).zip(surface.on_seam()) {
        let on_rim = place[1].min(place[2]) < 0.0 || place[1].max(place[2]) > 7.0;
        if seam && !on_rim {
            let expected = if place[0] < 4.4 { 1.0 } else { -1.0 };
            assert!((normal[0] - expected).abs() < 1e-4, "{place:?} {normal:?}");
            seen += 1;
        } else if seam || ((place[0] - 4.4).abs() < 1.0 && on_rim) {
            assert!(normal[0].abs() < 0.2, "skin at the rim: {place:?} {normal:?}");
        }
    }
    assert_eq!(seen, 2 * 64);
}
