//! Slices: orientation, contours, and the inverse of deformations.

use std::collections::BTreeMap;

use nalgebra::Rotation3;
use yawara::geometry::{Affine, Grid, GridShape, Matrix3, Point3, Vector3};
use yawara::lattice::build::OrganMap;
use yawara::lattice::cells::build_cells;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
use yawara::lattice::{Lattice, SeveredSpring, Topology};
use yawara::slice::contour::contour;
use yawara::slice::deformed::{Carried, InverseMap};
use yawara::slice::{ObliquePlane, Plane, Raster, Section, SliceAxis, SlicePicture, SlicePlane, Tint};
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::{Surface, field};
use yawara::volume::{CtVolume, LabelVolume};

use crate::blob;

const AXES: [SliceAxis; 3] = [SliceAxis::X, SliceAxis::Y, SliceAxis::Z];

/// A grid about the patient's origin whose voxel axes are the columns of `turn`, 1.5 mm long.
fn grid(turn: Matrix3, shape: GridShape) -> Grid {
    let linear = turn * 1.5;
    let half = Vector3::from(shape.dims().map(|n| (n - 1) as f64 / 2.0));
    Grid { shape, affine: Affine::from_parts(linear, -(linear * half)).unwrap() }
}

/// Right-handed and left-handed, straight and oblique, and with voxel axes in another order.
fn orientations() -> Vec<Matrix3> {
    let oblique = Rotation3::from_euler_angles(0.3, -0.25, 0.4).into_inner();
    let flip = |x: f64, y: f64, z: f64| Matrix3::from_diagonal(&Vector3::new(x, y, z));
    let cycle = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    vec![
        flip(1.0, 1.0, 1.0),
        flip(-1.0, -1.0, 1.0),
        flip(-1.0, 1.0, 1.0),
        cycle,
        oblique,
        oblique * flip(-1.0, 1.0, 1.0),
        oblique * cycle * flip(1.0, 1.0, -1.0),
    ]
}

#[test]
fn right_is_left_and_front_and_head_are_up_whatever_way_the_voxels_lie() {
    // A ball toward the patient's right, front and head, each by another distance.
    let ball = Point3::new(12.0, 8.0, 4.0);
    for turn in orientations() {
        let grid = grid(turn, GridShape::new(40, 44, 48));
        let bright = |at| if (grid.place(at) - ball).norm() < 6.0 { 240.0 } else { -160.0 };
        let ct = CtVolume::from_vec(grid, (0..grid.shape.len()).map(bright).collect());
        for axis in AXES {
            let at_mm = ball[axis.index()];
            let raster = SlicePlane { axis, at_mm, pixel_mm: 0.7 }.raster(&grid).unwrap();
            let picture = SlicePicture { annotate: false, ..SlicePicture::of_ct(&ct) }.draw(&raster).unwrap();
            let (mut sum, mut middle) = (0.0, [0.0; 2]);
            for (x, y, pixel) in picture.enumerate_pixels() {
                let weight = f64::from(pixel.0[0]);
                sum += weight;
                middle = [middle[0] + weight * f64::from(x), middle[1] + weight * f64::from(y)];
            }
            // Millimetres from the middle of the picture, which is the patient's origin.
            let [width, height] = [raster.width, raster.height].map(|n| (f64::from(n) - 1.0) / 2.0);
            let found = [(middle[0] / sum - width) * 0.7, (middle[1] / sum - height) * 0.7];
            let expected = match axis {
                SliceAxis::X => [-8.0, -4.0],
                SliceAxis::Y => [-12.0, -4.0],
                SliceAxis::Z => [-12.0, -8.0],
            };
            let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            // The ball is made of voxels of 1.5 mm.
            assert!(off < 0.5, "{axis}: {found:?} mm instead of {expected:?}");
        }
    }
}

#[test]
fn labels_are_tinted_and_stand_in_for_a_missing_ct() {
    let grid = grid(Matrix3::identity(), GridShape::new(6, 6, 6));
    let labels = LabelVolume::from_vec(grid, (0..216).map(|at| u16::from(at % 6 >= 3) * 5).collect());
    let raster = SlicePlane { axis: SliceAxis::Z, at_mm: 0.0, pixel_mm: 1.5 }.raster(&grid).unwrap();
    let plain = SlicePicture { annotate: false, ..SlicePicture::of_labels(&labels) };
    let row = |picture: SlicePicture<'_>| [0, 5].map(|x| picture.draw(&raster).unwrap().get_pixel(x, 2).0);
    let [right, left] = row(plain);
    assert!(right == [150; 3] && left == [40; 3], "label 5 lies in high i, the patient's right: {right:?} {left:?}");
    let tint = Tint { colors: BTreeMap::from([(5, [1.0, 0.0, 0.0])]), alpha: 1.0 };
    let [right, left] = row(SlicePicture { tint: Some(&tint), ..plain });
    assert!(right[0] > 200 && right[1] == 0 && left == [40; 3], "{right:?} {left:?}");
    let none = Tint { alpha: 0.0, ..tint };
    assert_eq!(row(SlicePicture { tint: Some(&none), ..plain }), row(plain));
}

#[test]
fn the_contour_of_a_ball_is_a_circle() {
    let mut ball = blob("ball", [0.0; 3], 80).mesh;
    let center = Vector3::new(20.0, -10.0, 300.0);
    let radius = 25.0;
    for position in &mut ball.positions {
        let place = Vector3::from(position.map(f64::from)).normalize() * radius + center;
        *position = place.map(|x| x as f32).into();
    }
    for axis in AXES {
        for offset in [0.0, 7.0, -20.0] {
            let segments = contour(&ball, &Plane::across(axis, center[axis.index()] + offset));
            let expected = (radius * radius - offset * offset).sqrt();
            let length: f64 = segments.iter().map(|[a, b]| (a - b).norm()).sum();
            assert!((length / (std::f64::consts::TAU * expected) - 1.0).abs() < 2e-3, "{axis} {offset}: {length}");
            for end in segments.iter().flatten() {
                let mut offset_from_center = end.coords - center;
                offset_from_center[axis.index()] = 0.0;
                // Chords of 4.5 degrees lie up to 0.08 % of the radius inside.
                assert!((offset_from_center.norm() - expected).abs() < 0.1, "{axis} {offset}: {end}");
            }
        }
    }
}

#[test]
fn the_contour_is_drawn_where_the_tissue_ends() {
    let grid = grid(orientations()[5], GridShape::new(50, 50, 50));
    let ct = CtVolume::from_vec(grid, vec![-1000.0; 125_000]);
    let organ = blob("liver", [4.0, -3.0, 2.0], 40);
    let raster = SlicePlane { axis: SliceAxis::Z, at_mm: 5.0, pixel_mm: 0.5 }.raster(&grid).unwrap();
    let contours: [(&TriangleMesh, [f32; 3]); 1] = [(&organ.mesh, [0.0, 1.0, 0.0])];
    let picture = SlicePicture { contours: &contours, annotate: false, ..SlicePicture::of_ct(&ct) };
    let picture = picture.draw(&raster).unwrap();
    let segments = contour(&organ.mesh, &Plane::across(SliceAxis::Z, 5.0));
    assert!(segments.len() > 50);
    for [a, b] in &segments {
        let [x, y] = raster.pixel_of(nalgebra::center(a, b)).map(|at| at.round() as u32);
        assert!(picture.get_pixel(x, y).0[1] > 100, "({x}, {y})");
    }
    let green = picture.pixels().filter(|pixel| pixel.0[1] > 0).count();
    assert!(green < 6 * 400, "a thin line: {green} pixels");
}

/// A full block of particles with all springs, on a grid about the origin.
fn block(turn: Matrix3, shape: GridShape) -> Lattice {
    let grid = grid(turn, shape);
    let springs = (0..shape.len()).map(|at| {
        let alive = |direction: &usize| shape.neighbour(shape.ijk(at), OFFSETS[*direction]).is_some();
        (0..NEIGHBOURS).filter(alive).fold(0, |bits, direction| bits | 1 << direction)
    });
    let springs: Vec<u32> = springs.collect();
    let points: Vec<u32> = (0..shape.len() as u32).collect();
    let (cell_organ, cell_fill) = (Vec::new(), Vec::new());
    let organ = vec![0; shape.len()];
    Lattice {
        grid,
        pitch: 1.5e-3,
        particle_at: points.clone(),
        points,
        organ,
        springs: springs.into(),
        cell_organ,
        cell_fill,
    }
}

fn raster_around(lattice: &Lattice, axis: SliceAxis, at_mm: f64) -> Raster {
    SlicePlane { axis, at_mm, pixel_mm: 0.4 }.raster(&raster_grid(lattice)).unwrap()
}

/// Moves every particle by a map of patient space [mm], and compares the slice with the map's inverse.
fn check_affine(turn: Matrix3, linear: Matrix3, shift: Vector3, tolerance_mm: f64) {
    let lattice = block(turn, GridShape::new(9, 10, 11));
    let topology = Topology::new(&lattice);
    let moved = |p: Point3| Point3::from(linear * p.coords + shift);
    let displacements: Vec<[f32; 3]> = (0..lattice.len() as u32)
        .map(|particle| {
            let rest = lattice.rest_place(particle);
            (moved(rest) - rest).map(|u| u as f32).into()
        })
        .collect();
    let back = linear.try_inverse().unwrap();
    for axis in AXES {
        let raster = raster_around(&lattice, axis, 2.3);
        let carried = InverseMap::new(&lattice, &topology, &displacements).carried(&raster);
        let (mut worst, mut covered) = (0.0f64, 0);
        for (at, pixel) in carried.pixels().iter().enumerate() {
            let place = raster.place(at as u32 % raster.width, at as u32 / raster.width);
            let rest = Point3::from(back * (place.coords - shift));
            let index = lattice.grid.affine.index_of(rest);
            let [nx, ny, nz] = lattice.grid.shape.dims().map(|n| (n - 1) as f64);
            let depth = |i: f64, n: f64| i.min(n - i);
            let inside = depth(index.x, nx).min(depth(index.y, ny)).min(depth(index.z, nz));
            match pixel {
                Carried::From(found) => {
                    worst = worst.max((found - rest).norm());
                    covered += 1;
                    assert!(inside > -1e-3, "{axis}: tissue where there is none, {inside}");
                }
                _ => assert!(inside < 1e-3, "{axis}: a hole at depth {inside}"),
            }
        }
        assert!(covered > 300 && worst < tolerance_mm, "{axis}: {covered} pixels, {worst} mm");
    }
}

#[test]
fn rigid_motion_and_stretch_are_inverted_exactly() {
    // Displacements are single precision: 1e-8 m of 0.1 m.
    const TOLERANCE_MM: f64 = 2e-5;
    for turn in [orientations()[0], orientations()[5]] {
        check_affine(turn, Matrix3::identity(), Vector3::new(3.1, -2.7, 4.4), TOLERANCE_MM);
        check_affine(turn, Rotation3::from_euler_angles(0.2, 0.5, -0.3).into_inner(), Vector3::zeros(), TOLERANCE_MM);
        let stretch = Matrix3::new(1.4, 0.2, 0.0, 0.0, 0.8, 0.1, 0.0, -0.1, 1.1);
        check_affine(turn, stretch, Vector3::new(0.5, 0.0, -1.0), TOLERANCE_MM);
    }
}

#[test]
fn a_cut_opens_and_the_place_left_is_empty() {
    let lattice = block(Matrix3::identity(), GridShape::new(9, 9, 9));
    let mut topology = Topology::new(&lattice);
    // Sever everything between the columns 3 and 4 of x and pull the right half 4 mm away.
    let column = |particle: u32| lattice.ijk(particle)[0];
    for particle in 0..lattice.len() as u32 {
        for direction in FIRST_FORWARD..NEIGHBOURS {
            let Some(other) = lattice.neighbour(particle, direction) else { continue };
            if (column(particle) <= 3) != (column(other) <= 3) {
                topology.sever(&lattice, SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 });
            }
        }
    }
    let pulled = |particle: u32| if column(particle) > 3 { [4.0, 0.0, 0.0] } else { [0.0; 3] };
    let displacements: Vec<[f32; 3]> = (0..lattice.len() as u32).map(pulled).collect();
    let raster = raster_around(&lattice, SliceAxis::Z, 0.3);
    let map = InverseMap::new(&lattice, &topology, &displacements);
    let carried = map.carried(&raster);
    let at = |x: f64| {
        let [column, row] = raster.pixel_of(Point3::new(x, 0.1, 0.3)).map(|at| at.round() as usize);
        carried.pixels()[row * raster.width as usize + column]
    };
    // Columns lie at -6, -4.5, ..., 6 mm; 3 and 4 are at -1.5 and 0, pulled to 4.
    assert!(matches!(at(-3.0), Carried::From(rest) if (rest.x + 3.0).abs() < 0.3));
    // Each side reaches half a pitch beyond its last particles, carried as they are.
    assert!(matches!(at(-0.9), Carried::From(rest) if (rest.x + 0.9).abs() < 0.3));
    assert!(matches!(at(3.4), Carried::From(rest) if (rest.x + 0.6).abs() < 0.3));
    for x in [-0.4, 0.5, 2.0, 3.0] {
        assert_eq!(at(x), Carried::Left, "{x}");
    }
    assert!(matches!(at(7.0), Carried::From(rest) if (rest.x - 3.0).abs() < 0.3));
    assert!(matches!(at(9.5), Carried::From(_)));
    assert_eq!(at(11.0), Carried::Elsewhere);
    // A cut that has not opened leaves no gap.
    let still = vec![[0.0; 3]; lattice.len()];
    let closed = InverseMap::new(&lattice, &topology, &still).carried(&raster);
    assert!(closed.pixels().iter().all(|pixel| *pixel != Carried::Left));
    // Without the cut the gap would be stretched tissue.
    let whole = Topology::new(&lattice);
    let uncut = InverseMap::new(&lattice, &whole, &displacements).carried(&raster);
    assert!(
        uncut.pixels().iter().filter(|pixel| matches!(pixel, Carried::From(_))).count() > carried_count(&carried) + 50
    );
}

#[test]
fn surfaces_decide_where_a_cut_block_ends_and_how_wide_its_gap_is() {
    let shape = GridShape::new(13, 13, 13);
    let grid = Grid { shape, affine: Affine::from_spacing([1.5; 3], [-9.0; 3]).unwrap() };
    let lattice = build_cells(&OrganMap::from_vec(grid, vec![0; shape.len()]), None).unwrap();
    // The blade goes off the middle between two columns of particles, at x = 0.3 mm.
    const BLADE_MM: f64 = 0.3;
    let mut topology = Topology::new(&lattice);
    for particle in 0..lattice.len() as u32 {
        for direction in FIRST_FORWARD..NEIGHBOURS {
            let Some(other) = lattice.neighbour(particle, direction) else { continue };
            let (a, b) = (lattice.rest_place(particle).x, lattice.rest_place(other).x);
            if (a < BLADE_MM) != (b < BLADE_MM) {
                let at = ((BLADE_MM - a) / (b - a)) as f32;
                topology.sever(&lattice, SeveredSpring { particle, direction: direction as u8, at, time: 0.0 });
            }
        }
    }
    assert!(!topology.severed().is_empty());
    let values = field::smoothed(&lattice, 0, field::SMOOTHING_PASSES);
    let extract = |topology: &Topology| Surface::extract(&lattice, topology, &values).unwrap();
    const GAP_MM: f32 = 5.0;
    let pulled = |particle: u32| if lattice.rest_place(particle).x > BLADE_MM { GAP_MM } else { 0.0 };
    let moved: Vec<[f32; 3]> = (0..lattice.len() as u32).map(|particle| [pulled(particle), 0.0, 0.0]).collect();
    let values_mm: Vec<f32> = moved.iter().map(|u| u[0]).collect();
    let (rest, now) = (extract(&Topology::new(&lattice)).at_rest(&lattice), extract(&topology).carry(&lattice, &moved));
    for point in [Point3::new(1.0, 0.4, 0.2), Point3::new(1.0, -3.0, 2.0)] {
        let normal = Vector3::new(0.0, 0.3, -1.0);
        let raster = ObliquePlane { point, normal, up: None, pixel_mm: Some(0.1) };
        let raster = raster.raster(&raster_grid(&lattice)).unwrap();
        let [then, section] = [&rest, &now].map(|mesh| Section::new(&[mesh], &raster));
        let carried = InverseMap::new(&lattice, &topology, &moved).with_values(&values_mm);
        let carried = carried.carried_within(&raster, &section, &then);
        let (mut gap, mut seen) = (0, [0; 2]);
        for (at, pixel) in carried.pixels().iter().enumerate() {
            let place = raster.place(at as u32 % raster.width, at as u32 / raster.width);
            assert_eq!(
                matches!(pixel, Carried::From(_)),
                section.organ(at).is_some(),
                "{place}: no hole in the tissue"
            );
            // Away from the edges of the block.
            if (place - point).norm() > 9.0 || (place.y.abs().max(place.z.abs())) > 7.0 {
                continue;
            }
            match pixel {
                Carried::From(rest) => {
                    let side = usize::from(place.x > BLADE_MM + 2.0);
                    let expected = place - f64::from(GAP_MM) * side as f64 * Vector3::x();
                    assert!((rest - expected).norm() < 2e-4, "{place}: {rest} instead of {expected}");
                    assert!((carried.values()[at] - GAP_MM * side as f32).abs() < 1e-4, "{place}");
                    seen[side] += 1;
                }
                _ if place.x.abs() < 7.0 => {
                    gap += usize::from(raster.pixel_of(place)[1].round() == raster.pixel_of(point)[1].round())
                }
                _ => {}
            }
        }
        // One row of pixels across the gap: the pull, and the kerf of a few thousandths of a pitch.
        let width = 0.1 * gap as f64;
        assert!((width - f64::from(GAP_MM)).abs() < 0.15, "{width} mm");
        assert!(seen.iter().all(|&count| count > 500), "{seen:?}");
    }
}

fn raster_grid(lattice: &Lattice) -> Grid {
    let mut grid = lattice.grid;
    // Room for tissue that moves beyond its rest box.
    grid.shape = GridShape::new(grid.shape.nx + 24, grid.shape.ny + 24, grid.shape.nz + 24);
    grid.affine = grid.affine.shifted(Vector3::repeat(-12.0));
    grid
}

fn carried_count(carried: &yawara::slice::deformed::CarriedRaster) -> usize {
    carried.pixels().iter().filter(|pixel| matches!(pixel, Carried::From(_))).count()
}

#[test]
fn cells_end_at_their_corners() {
    let grid = Grid { shape: GridShape::new(7, 7, 7), affine: Affine::from_spacing([1.5; 3], [-4.5; 3]).unwrap() };
    let lattice = build_cells(&OrganMap::from_vec(grid, vec![0; 343]), None).unwrap();
    let topology = Topology::new(&lattice);
    let displacements = vec![[0.0; 3]; lattice.len()];
    let raster = raster_around(&lattice, SliceAxis::X, 0.2);
    let carried = InverseMap::new(&lattice, &topology, &displacements).carried(&raster);
    let reach = |at: &Carried| match at {
        Carried::From(rest) => rest.y.abs().max(rest.z.abs()),
        _ => 0.0,
    };
    let farthest = carried.pixels().iter().map(reach).fold(0.0, f64::max);
    let area = 0.16 * carried_count(&carried) as f64;
    assert!((5.0..=5.25 + 1e-6).contains(&farthest), "{farthest}");
    assert!((105.0..114.0).contains(&area), "{area} mm2 for a square of 10.5 mm");
}

#[test]
fn collapsed_and_absurd_states_do_not_panic() {
    let lattice = block(Matrix3::identity(), GridShape::new(4, 4, 4));
    let topology = Topology::new(&lattice);
    let raster = raster_around(&lattice, SliceAxis::Y, 0.0);
    let flat: Vec<[f32; 3]> = (0..64).map(|p| [0.0, -lattice.rest_place(p).y as f32, 0.0]).collect();
    for displacements in [flat, vec![[f32::NAN; 3]; 64], vec![[1e30, -1e30, 1e30]; 64]] {
        let carried = InverseMap::new(&lattice, &topology, &displacements).carried(&raster);
        assert_eq!(carried.pixels().len(), raster.len());
    }
}

#[test]
fn the_thread_count_changes_nothing() {
    let lattice = block(orientations()[4], GridShape::new(9, 9, 9));
    let topology = Topology::new(&lattice);
    // Tissue folded over itself: several cells claim the same pixels.
    let displacements: Vec<[f32; 3]> =
        (0..lattice.len() as u32).map(|p| [(-1.5 * lattice.rest_place(p).x) as f32, 1.0, 0.0]).collect();
    let raster = raster_around(&lattice, SliceAxis::Z, 0.0);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| InverseMap::new(&lattice, &topology, &displacements).carried(&raster))
    };
    assert_eq!(with(1), with(4));
}
