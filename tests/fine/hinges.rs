//! What a cut leaves hinged on a strip of springs is drawn where the tissue behind it goes, wherever it swings.

use yawara::dynamics::World;
use yawara::geometry::{Matrix3, Point3, Vector3};
use yawara::lattice::build::NO_ORGAN;
use yawara::look::strain::equivalent_strains;
use yawara::slice::deformed::{Carried, InverseMap};
use yawara::slice::{SliceAxis, SlicePlane};
use yawara::surface::{Surface, field};

use crate::bodies::{cut, displace, fine_body, middle, surface};
use crate::support::{TISSUE, organ_map, tissue_lattice, world};

/// A block of 3 mm cells, and some layers of them more in front (+y) of its left half.
fn stepped(layers: usize) -> World {
    let inside = |[i, j, _]: [usize; 3]| if j < 5 || j < 5 + layers && i < 5 { 0 } else { NO_ORGAN };
    world(tissue_lattice(&organ_map([10; 3], inside), &[Some(TISSUE)]))
}

/// A turn, by rest place [mm].
fn motion(place: Point3) -> Vector3 {
    let f = Matrix3::new(0.8, -0.6, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 1.0);
    (f - Matrix3::identity()) * (place - middle())
}

/// How far places went astray of the motion, at most [mm].
fn astray<'a>(moved: &[[f32; 3]], rest: impl Iterator<Item = &'a [f64; 3]>) -> f64 {
    let off = |(moved, rest): (&[f32; 3], &[f64; 3])| {
        (Vector3::from(moved.map(f64::from)) - motion(Point3::from(*rest))).norm()
    };
    moved.iter().zip(rest).map(off).fold(0.0, f64::max)
}

/// The stepped block in motion, and what is in front of it in the plane of the step folded over the tissue behind it.
fn folded(layers: usize, cut_it: bool) -> World {
    let mut world = stepped(layers);
    if cut_it {
        // 1 mm to the left of the step: what is in front is joined to others of its plane only.
        assert!(cut(&mut world, Vector3::new(-1.0, 0.0, 0.0), Vector3::z(), Vector3::y(), 30.0) > 0);
    }
    displace(&mut world, motion);
    let in_front = |&particle: &u32| {
        let [x, y, _] = (world.lattice().rest_place(particle) - middle()).into();
        x.abs() < 0.1 && y > 0.1
    };
    let in_front: Vec<u32> = (0..world.lattice().len() as u32).filter(in_front).collect();
    assert_eq!(in_front.len(), 11 * layers);
    for particle in in_front {
        let folded = world.displacement(particle) + Vector3::new(0.002, -0.005, 0.001);
        world.set_displacement(particle, folded);
    }
    world
}

/// How far surfaces, fine and of the lattice, and a slice go astray of the motion \[mm\], and the largest strain.
fn drawn(layers: usize, cut_it: bool) -> ([f64; 3], f32) {
    let world = folded(layers, cut_it);
    let (lattice, topology, moved) = (world.lattice(), world.topology(), world.displacements_mm());
    let body = fine_body(0.9, 18.0, |place| {
        let [x, y, z] = (place - middle()).into();
        let front = if x < 0.0 { 3.0 * layers as f64 } else { 0.0 };
        [15.0 - x.abs(), y + 15.0, front - y, 15.0 - z.abs()].into_iter().fold(f64::INFINITY, f64::min)
    });
    let fine = surface(&world, &body);
    let coarse = Surface::extract(lattice, topology, &field::filled(lattice, 0)).unwrap();
    let places: Vec<[f64; 3]> = coarse.rest_places().collect();
    let raster = SlicePlane { axis: SliceAxis::Z, at_mm: middle().z + 1.0, pixel_mm: 0.4 };
    let raster = raster.raster(&lattice.grid).unwrap();
    let slice = InverseMap::new(lattice, topology, &moved).carried(&raster);
    let pixels = slice.pixels().iter().enumerate().filter_map(|(at, pixel)| match pixel {
        Carried::From(rest) => {
            let place = raster.place(at as u32 % raster.width, at as u32 / raster.width);
            Some((*rest + motion(*rest) - place).norm())
        }
        _ => None,
    });
    let off = [
        astray(&fine.carry(lattice, &moved).displacements, fine.rest_places().iter()),
        astray(&coarse.carry(lattice, &moved).displacements, places.iter()),
        pixels.fold(0.0, f64::max),
    ];
    (off, equivalent_strains(lattice, topology, &moved).into_iter().fold(0.0, f32::max))
}

#[test]
fn a_strip_that_swings_on_a_hinge_is_drawn_with_the_tissue_behind_it() {
    for layers in 1..=3 {
        let (off, strained) = drawn(layers, false);
        println!("{layers} wide, joined to cells: off by {off:.3?} mm, strains up to {strained:.3}");
        assert!(off.iter().all(|off| *off > 1.0) && strained > 0.4, "tissue is drawn where it is");
        let (off, strained) = drawn(layers, true);
        println!("{layers} wide, hinged: off by {off:.6?} mm, strains up to {strained:.6}");
        if layers <= 2 {
            assert!(off.iter().all(|off| *off < 1e-4) && strained < 1e-4);
        } else {
            assert!(off.iter().all(|off| *off > 1.0), "a membrane is drawn where it is");
        }
    }
}
