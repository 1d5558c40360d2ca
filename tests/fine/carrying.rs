//! Vertices follow the lattice, normals follow the deformation.

use yawara::geometry::{Matrix3, Point3, Vector3};
use yawara::surface::check::check;

use crate::bodies::{RADIUS, ball, displace, fine_ball, mesh, middle, surface};

#[test]
fn an_even_deformation_is_reproduced_to_rounding() {
    let f = Matrix3::new(1.2, 0.3, 0.0, -0.1, 0.9, 0.2, 0.0, 0.1, 1.1);
    for tissue in [true, false] {
        let mut world = ball(tissue);
        displace(&mut world, |place| (f - Matrix3::identity()) * (place - middle()));
        let surface = surface(&world, &fine_ball(1.3));
        let mesh = surface.carry(world.lattice(), &world.displacements_mm());
        let turned = f.try_inverse().unwrap().transpose();
        for ((place, rest), normal) in mesh.positions.iter().zip(surface.rest_places()).zip(&mesh.normals) {
            let rest = Point3::from(*rest);
            let expected = middle() + f * (rest - middle());
            let place = Point3::from(place.map(f64::from));
            assert!((place - expected).norm() < 2e-5, "{rest} comes to {place}, expected {expected}");
            // The normal of a sphere, through the inverse transpose; what is left is the facets'.
            let expected = (turned * (rest - middle())).normalize();
            assert!(expected.dot(&Vector3::from(normal.map(f64::from))) > 0.99, "{normal:?} at {rest}");
        }
        assert!(check(&mesh).passes());
    }
}

#[test]
fn a_finer_surface_comes_nearer_to_the_ball_whatever_the_lattice() {
    let world = ball(true);
    let errors = [2.0, 1.0, 0.5].map(|spacing| {
        let mesh = mesh(&world, &fine_ball(spacing));
        let off = |place: &[f32; 3]| ((Point3::from(place.map(f64::from)) - middle()).norm() - RADIUS).powi(2);
        (mesh.positions.iter().map(off).sum::<f64>() / mesh.positions.len() as f64).sqrt()
    });
    // Straight lines between samples of a curved distance: second order.
    assert!(errors[0] < 0.03 && errors[1] < 0.35 * errors[0] && errors[2] < 0.35 * errors[1], "{errors:?}");
}

/// A bent rod of the same motion on lattices of 6, 3 and 1.5 mm: what carrying by a coarser lattice costs.
#[test]
fn carrying_errs_by_the_square_of_the_pitch() {
    use yawara::geometry::{Affine, Grid, GridShape};
    use yawara::lattice::cells::build_cells;
    use yawara::volume::Volume;
    let bend = |place: Point3| {
        let x = place.x / 40.0;
        Vector3::new(0.0, 6.0 * x * x * x, 4.0 * (2.0 * x).sin())
    };
    let body = fine_ball(1.0);
    let errors = [6.0, 3.0, 1.5].map(|pitch: f64| {
        let count = (42.0 / pitch).ceil() as usize;
        let first = middle() - Vector3::repeat(21.0);
        let affine = Affine::from_spacing([pitch; 3], first.coords.into()).unwrap();
        let shape = GridShape::new(count, count, count);
        let lattice = build_cells(&Volume::from_vec(Grid { shape, affine }, vec![0; shape.len()]), None).unwrap();
        let displacements: Vec<[f32; 3]> = (0..lattice.len() as u32)
            .map(|particle| <[f64; 3]>::from(bend(lattice.rest_place(particle))).map(|c| c as f32))
            .collect();
        let topology = yawara::lattice::Topology::new(&lattice);
        let surface =
            yawara::surface::fine::FineSurface::extract(&body, &lattice, &topology, &yawara::cut::CutSheet::default())
                .unwrap();
        let mesh = surface.carry(&lattice, &displacements);
        let off = |(moved, rest): (&[f32; 3], &[f64; 3])| {
            (Vector3::from(moved.map(f64::from)) - bend(Point3::from(*rest))).norm()
        };
        mesh.displacements.iter().zip(surface.rest_places()).map(off).fold(0.0, f64::max)
    });
    println!("carried by 6, 3 and 1.5 mm: off by {errors:.4?} mm at most, for bends of up to 6 mm");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.6..2.3).contains(&order), "order {order} in {errors:?}");
    }
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let meshes = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut world = ball(true);
            crate::bodies::cut(&mut world, Vector3::new(1.0, 0.0, 0.0), Vector3::y(), Vector3::z(), 3.0);
            displace(&mut world, |place| 0.1 * (place - middle()));
            mesh(&world, &fine_ball(0.9))
        })
    });
    assert!(meshes[0] == meshes[1]);
}
