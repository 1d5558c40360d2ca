//! The CT at rest places: exact on ramps, clear of the surroundings on the skin, in place on faces of cuts.

use yawara::geometry::{Affine, Grid, GridShape, Matrix3, Point3, Vector3};
use yawara::lattice::{Lattice, Topology};
use yawara::look::hu::{SKIN_DEPTH, hu_at_rest, skin_reach};
use yawara::look::rest::RestSurface;
use yawara::surface::mesh::TriangleMesh;
use yawara::volume::CtVolume;

use crate::support::{TISSUE, block, tissue_lattice};
use crate::{cut_after_layer, middle, moved, on_threads, surface};

/// A CT of 2 mm cubes on an oblique grid around a lattice.
fn ct_around(lattice: &Lattice, value: impl Fn(Point3) -> f64) -> CtVolume {
    let turn: Matrix3 = nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 0.5).into_inner();
    let shape = GridShape::new(50, 50, 50);
    let first = middle(lattice) - turn * Vector3::repeat(49.0);
    let grid = Grid { shape, affine: Affine::from_parts(turn * 2.0, first.coords).unwrap() };
    CtVolume::from_vec(grid, (0..shape.len()).map(|n| value(grid.place(n)) as f32).collect())
}

/// Linear in patient space [HU].
fn ramp(place: Point3) -> f64 {
    40.0 + 1.5 * place.x - 0.7 * place.y + 0.4 * place.z
}

fn lattice() -> Lattice {
    tissue_lattice(&block([12, 11, 10]), &[Some(TISSUE)]).0
}

fn rest_of(mesh: &TriangleMesh, vertex: usize) -> Point3 {
    Point3::from([0, 1, 2].map(|a| f64::from(mesh.positions[vertex][a]) - f64::from(mesh.displacements[vertex][a])))
}

#[test]
fn a_ramp_is_read_a_little_inside_the_skin() {
    let lattice = lattice();
    let still = vec![[0.0; 3]; lattice.len()];
    let (mesh, on_cut) = surface(&lattice, &Topology::new(&lattice), &still);
    let ct = ct_around(&lattice, ramp);
    let hu = hu_at_rest(&ct, &RestSurface::new(&mesh, &on_cut, skin_reach(&ct)));
    for vertex in 0..mesh.positions.len() {
        let normal = Vector3::from(mesh.normals[vertex].map(f64::from));
        // 2 mm cubes: a voxel is 2 mm along every direction.
        let expected = ramp(rest_of(&mesh, vertex) - normal * SKIN_DEPTH * 2.0);
        assert!((f64::from(hu[vertex]) - expected).abs() < 0.01, "{vertex}: {} is not {expected}", hu[vertex]);
    }
}

#[test]
fn faces_of_cuts_are_read_in_place_wherever_the_tissue_went() {
    let lattice = lattice();
    let layer = 6;
    let topology = cut_after_layer(&lattice, layer);
    let wall = lattice.grid.affine.apply(Point3::new(layer as f64 + 0.5, 0.0, 0.0)).x;
    let turn = nalgebra::Rotation3::from_euler_angles(0.0, 0.4, 0.9).into_inner();
    let apart = moved(&lattice, |place| {
        if place.x > wall { turn * (place - Point3::origin()) - (place - Point3::origin()) } else { Vector3::zeros() }
    });
    let (mesh, on_cut) = surface(&lattice, &topology, &apart);
    let ct = ct_around(&lattice, ramp);
    let reach = skin_reach(&ct);
    let hu = hu_at_rest(&ct, &RestSurface::new(&mesh, &on_cut, reach));
    let (low, high) = (middle(&lattice) - Vector3::repeat(9.0), middle(&lattice) + Vector3::repeat(9.0));
    let (mut inner, mut moved_most) = (0, 0.0_f32);
    for vertex in (0..mesh.positions.len()).filter(|&v| on_cut[v]) {
        let rest = rest_of(&mesh, vertex);
        if (1..3).all(|axis| rest[axis] > low[axis] && rest[axis] < high[axis]) {
            inner += 1;
            moved_most = mesh.displacements[vertex].iter().fold(moved_most, |most, c| most.max(c.abs()));
            assert!((f64::from(hu[vertex]) - ramp(rest)).abs() < 0.01, "{vertex}");
        } else {
            // Nearer to the skin than the reach: at most so far from its place.
            assert!((f64::from(hu[vertex]) - ramp(rest)).abs() < 1.8 * reach, "{vertex}");
        }
    }
    assert!(inner > 40 && moved_most > 5.0, "{inner} vertices, moved by {moved_most} mm");
}

#[test]
fn neither_skin_nor_rims_show_the_surroundings() {
    let lattice = lattice();
    let centre = middle(&lattice);
    // Voxels that straddle the border hold both, as in a scanner: 50 HU inside, fat outside.
    let half = [18.0, 16.5, 15.0];
    let ct = ct_around(&lattice, |place| {
        let beyond = (0..3).map(|axis| (place[axis] - centre[axis]).abs() - half[axis]).fold(f64::MIN, f64::max);
        50.0 - 150.0 * (beyond / 2.0 + 0.5).clamp(0.0, 1.0)
    });
    let (mesh, on_cut) = surface(&lattice, &cut_after_layer(&lattice, 6), &vec![[0.0; 3]; lattice.len()]);
    let hu = hu_at_rest(&ct, &RestSurface::new(&mesh, &on_cut, skin_reach(&ct)));
    let lowest = |cut: bool| (0..hu.len()).filter(|&v| on_cut[v] == cut).map(|v| hu[v]).fold(f32::INFINITY, f32::min);
    let in_place = (0..hu.len()).map(|v| ct.sample(rest_of(&mesh, v), 0.0)).fold(f32::INFINITY, f32::min);
    assert!(in_place < 0.0, "the border is tinted when it is read in place: {in_place} HU");
    assert!(lowest(false) > 40.0, "skin: {} HU", lowest(false));
    assert!(lowest(true) > 40.0, "faces of the cut: {} HU", lowest(true));
}

#[test]
fn beyond_the_volume_its_border_holds_and_threads_do_not_matter() {
    let lattice = lattice();
    let (mesh, on_cut) = surface(&lattice, &Topology::new(&lattice), &vec![[0.0; 3]; lattice.len()]);
    // Two voxels, far off.
    let grid = Grid { shape: GridShape::new(2, 1, 1), affine: Affine::from_spacing([1.0; 3], [900.0; 3]).unwrap() };
    let far = CtVolume::from_vec(grid, vec![7.0, 9.0]);
    let hu = hu_at_rest(&far, &RestSurface::new(&mesh, &on_cut, skin_reach(&far)));
    assert!(hu.iter().all(|&hu| hu == 7.0));
    let ct = ct_around(&lattice, ramp);
    let [one, two, four] = on_threads(|| hu_at_rest(&ct, &RestSurface::new(&mesh, &on_cut, skin_reach(&ct))));
    assert!(one == two && two == four);
    assert_eq!(one.len(), mesh.positions.len());
}
