//! Borders of several organs drawn at once: every organ closed, every wall shared, whatever was severed.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use yawara::geometry::Vector3;
use yawara::lattice::{Lattice, NO_PARTICLE, Topology};
use yawara::surface::check::check;
use yawara::surface::field;
use yawara::surface::interfaces::{MultiMesh, MultiSurface, OUTSIDE, Partition};
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::weld::{soup, weld};

use crate::support::{Random, cut_plane, lattice, sever, springs};

/// Sums of f32 places in f64 against each other, relative to the sum of what is added.
const VOLUME_ROUNDING: f64 = 1e-5;

/// Volume that an organ may lose or gain where it touches itself [cells].
const STOOD_BACK: f64 = 2e-3;

/// Depth of the line over a wall in a flat skin [pitches].
const GROOVE: f32 = 0.2;

/// What was looked at.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    triangles: usize,
    /// Edges at which three or more sheets meet.
    lines: usize,
    /// Vertices that an organ has to itself, because it touches itself there.
    touching: usize,
    severed: usize,
}

impl std::ops::Add for Seen {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            triangles: self.triangles + other.triangles,
            lines: self.lines + other.lines,
            touching: self.touching + other.touching,
            severed: self.severed + other.severed,
        }
    }
}

/// The oracle: reads triangles, labels and places alone.
fn assert_sound(surface: &MultiSurface, mesh: &MultiMesh<'_>, what: &str) -> Seen {
    let mut seen = Seen { triangles: surface.triangles().len(), ..Seen::default() };
    let organs: BTreeSet<u8> = surface.sides().iter().flatten().copied().filter(|&label| label != OUTSIDE).collect();
    let bits = |place: &[f32; 3]| place.map(f32::to_bits);
    let places: BTreeSet<_> = mesh.positions.iter().map(bits).collect();
    let mut sum = 0.0;
    let mut used = 0;
    for &organ in &organs {
        let own = mesh.organ_mesh(organ);
        let report = check(&own);
        assert!(report.passes(), "{what}, organ {organ}: {report}");
        assert_eq!(report.unused_vertices, 0, "{what}");
        assert!(own.normals.iter().flatten().all(|c| c.is_finite()), "{what}");
        let welded = check(&weld(&soup(&own), 0.0));
        assert!(welded.passes() && welded.vertices == report.vertices, "{what}, organ {organ}, welded: {welded}");
        seen.touching += own.positions.iter().filter(|&place| !places.contains(&bits(place))).count();
        sum += report.volume_mm3;
        used += own.triangles.len();
    }
    // Every triangle is used by its organs alone: twice between two, once at the outside.
    let to_outside = surface.sides().iter().filter(|sides| sides[1] == OUTSIDE).count();
    assert_eq!(used, 2 * surface.triangles().len() - to_outside, "{what}");
    assert!(surface.sides().iter().all(|[one, two]| one < two), "{what}");
    // Along every edge as many sheets as labels; each label behind one of them and in front of another.
    let mut edges: BTreeMap<[u32; 2], Vec<(u8, i32)>> = BTreeMap::new();
    for (triangle, sides) in surface.triangles().iter().zip(surface.sides()) {
        for corner in 0..3 {
            let (from, to) = (triangle[corner], triangle[(corner + 1) % 3]);
            let sign = if from < to { 1 } else { -1 };
            edges.entry([from.min(to), from.max(to)]).or_default().extend([(sides[0], sign), (sides[1], -sign)]);
        }
    }
    for (edge, labels) in &edges {
        let sheets = labels.len() / 2;
        let around: BTreeSet<u8> = labels.iter().map(|label| label.0).collect();
        assert_eq!(sheets, around.len(), "{what}, edge {edge:?}: {labels:?}");
        for &label in &around {
            let of_label: Vec<i32> = labels.iter().filter(|one| one.0 == label).map(|one| one.1).collect();
            assert_eq!((of_label.len(), of_label.iter().sum::<i32>()), (2, 0), "{what}, edge {edge:?}: {labels:?}");
        }
        seen.lines += usize::from(sheets > 2);
    }
    // The border of all together.
    let union = TriangleMesh {
        positions: mesh.positions.clone(),
        triangles: surface
            .triangles()
            .iter()
            .zip(surface.sides())
            .filter(|(_, sides)| sides[1] == OUTSIDE)
            .map(|(triangle, _)| *triangle)
            .collect(),
        ..TriangleMesh::default()
    };
    let whole = check(&union);
    assert!(whole.is_closed() && whole.is_oriented(), "{what}: {whole}");
    let tolerance = VOLUME_ROUNDING * (1.0 + sum) + STOOD_BACK * seen.touching as f64;
    assert!((sum - whole.volume_mm3).abs() <= tolerance, "{what}: {sum} of {}", whole.volume_mm3);
    let interfaces = mesh.interfaces();
    assert_eq!(interfaces.iter().map(|one| one.mesh.triangles.len()).sum::<usize>(), surface.triangles().len());
    seen
}

fn shared(lattice: &Lattice, topology: &Topology, partition: &Partition, what: &str) -> Seen {
    let surface = MultiSurface::extract(lattice, topology, partition).unwrap();
    let seen = assert_sound(&surface, &surface.at_rest(lattice), what);
    Seen { severed: topology.severed().len(), ..seen }
}

/// Fields of random size with the signs of the lattice's organs.
fn random_partition(lattice: &Lattice, organs: u8, random: &mut Random) -> Partition {
    let fields = (0..organs)
        .map(|organ| {
            let value = |&particle: &u32| {
                let own = particle != NO_PARTICLE && lattice.organ[particle as usize] == organ;
                (0.01 + 0.99 * random.unit() as f32) * if own { 1.0 } else { -1.0 }
            };
            lattice.particle_at.iter().map(value).collect()
        })
        .collect();
    Partition::of_lattice(lattice, fields)
}

/// One random case: 2 to 5 organs, as noise or in regions, with air; springs severed at random, by planes and half planes.
fn random_case(trial: u64) -> Seen {
    let mut random = Random::new(trial);
    let [nx, ny, nz] = [0; 3].map(|_| 2 + random.below(4));
    let fill = [0.5, 0.8, 0.95, 1.0][random.below(4)];
    let seed = random.next();
    let mut lattice = lattice(nx, ny, nz, |[i, j, k]| {
        i + j + k == 0 || Random::new(seed ^ ((i * 36 + j * 6 + k) as u64) << 20).unit() < fill
    });
    let organs = 2 + random.below(4) as u8;
    let seeds: Vec<Vector3> = (0..organs).map(|_| Vector3::from_fn(|_, _| 6.0 * random.unit())).collect();
    let regions = random.unit() < 0.5;
    for particle in 0..lattice.len() as u32 {
        let place = Vector3::from(lattice.ijk(particle).map(|i| i as f64));
        let nearest = |one: &usize, two: &usize| (seeds[*one] - place).norm().total_cmp(&(seeds[*two] - place).norm());
        lattice.organ[particle as usize] = match regions {
            true => (0..seeds.len()).min_by(nearest).unwrap() as u8,
            false => random.below(organs.into()) as u8,
        };
    }
    let mut topology = Topology::new(&lattice);
    match random.below(4) {
        0 => {}
        1 => {
            let density = [0.02, 0.1, 0.3, 0.6, 1.0][random.below(5)];
            for (particle, direction) in springs(&lattice) {
                if random.unit() < density {
                    let at = [random.unit(), 0.0, 1.0][if random.unit() < 0.9 { 0 } else { 1 + random.below(2) }];
                    sever(&lattice, &mut topology, particle, direction, at as f32);
                }
            }
        }
        planes => {
            for _ in 1..planes {
                let normal = Vector3::from_fn(|_, _| random.unit() - 0.5).normalize();
                let point = Vector3::from_fn(|_, _| 5.0 * random.unit());
                let stop = 8.0 * random.unit();
                cut_plane(&lattice, &mut topology, point, normal, |place| place.x < stop);
            }
        }
    }
    let partition = match random.below(3) {
        0 => {
            let passes = random.below(3);
            let smoothed = |organ| field::smoothed(&lattice, organ, passes);
            Partition::of_lattice(&lattice, (0..organs).map(smoothed).collect())
        }
        _ => random_partition(&lattice, organs, &mut random),
    };
    shared(&lattice, &topology, &partition, &format!("trial {trial}"))
}

/// `YAWARA_TRIALS` sets how many lattices are tried.
#[test]
fn random_organs_and_cuts_share_closed_walls() {
    let trials: u64 = std::env::var("YAWARA_TRIALS").map_or(10_000, |n| n.parse().expect("a number of lattices"));
    let seen = (0..trials).into_par_iter().map(random_case).reduce(Seen::default, |one, two| one + two);
    eprintln!("{trials} lattices: {seen:?}");
    assert!(seen.triangles > 300 * trials as usize && seen.lines > 50 * trials as usize, "{seen:?}");
    assert!(seen.severed > 10 * trials as usize && seen.touching > trials as usize / 10, "{seen:?}");
}

/// A block of two organs that meet in a plane across x, in a layer of nothing.
fn halves() -> Lattice {
    let mut lattice = lattice(14, 11, 10, |ijk| ijk.iter().zip([14, 11, 10]).all(|(&i, n)| i > 0 && i + 1 < n));
    for particle in 0..lattice.len() as u32 {
        lattice.organ[particle as usize] = u8::from(lattice.ijk(particle)[0] > 6);
    }
    lattice
}

fn smoothed(lattice: &Lattice, organs: u8) -> Partition {
    Partition::of_lattice(lattice, (0..organs).map(|organ| field::smoothed(lattice, organ, 2)).collect())
}

#[test]
fn a_wall_is_shared_and_leaves_no_groove_in_the_skin() {
    let lattice = halves();
    let surface = MultiSurface::extract(&lattice, &Topology::new(&lattice), &smoothed(&lattice, 2)).unwrap();
    let mesh = surface.at_rest(&lattice);
    assert_sound(&surface, &mesh, "halves");
    let interfaces = mesh.interfaces();
    let pairs: Vec<_> = interfaces.iter().map(|one| (one.inside, one.outside)).collect();
    assert_eq!(pairs, [(0, 1), (0, OUTSIDE), (1, OUTSIDE)]);
    let wall: BTreeSet<_> = interfaces[0].mesh.positions.iter().map(|place| place.map(f32::to_bits)).collect();
    for organ in [0, 1] {
        let own: BTreeSet<_> = mesh.organ_mesh(organ).positions.iter().map(|place| place.map(f32::to_bits)).collect();
        assert!(wall.is_subset(&own), "every vertex of the wall is the organ's, bit for bit");
    }
    assert!(interfaces[0].mesh.positions.iter().all(|place| (place[0] - 6.5).abs() < 0.05), "the wall is a plane");
    // The skin over the wall, clear of the block's edges, lies as high as elsewhere but for what smoothing leaves of every field's own sign;
    // drawn organ by organ it lies a third of a pitch lower.
    let top = mesh.positions.iter().filter(|p| p[2] > 6.0 && (4.0..10.0).contains(&p[0]) && (4.0..7.0).contains(&p[1]));
    let heights: Vec<f32> = top.map(|place| place[2]).filter(|z| *z > 8.0).collect();
    let (low, high) = heights.iter().fold((f32::MAX, f32::MIN), |(low, high), &z| (low.min(z), high.max(z)));
    assert!(heights.len() > 15 && high - low < GROOVE, "{low} to {high}");
    // Skins shade as one: on both sides of the line where the wall ends, normals point up.
    for interface in &interfaces[1..] {
        let up =
            interface.mesh.positions.iter().zip(&interface.mesh.normals).filter(|(place, _)| {
                place[2] > 8.0 && (5.0..8.0).contains(&place[0]) && (4.0..7.0).contains(&place[1])
            });
        assert!(up.clone().count() > 5);
        up.for_each(|(place, normal)| assert!(normal[2] > 0.97, "{place:?}: {normal:?}"));
    }
}

#[test]
fn a_cut_along_a_wall_parts_its_organs_and_ends_where_it_ends() {
    let lattice = halves();
    let partition = smoothed(&lattice, 2);
    let cut = |stop: f64| {
        let mut topology = Topology::new(&lattice);
        cut_plane(&lattice, &mut topology, Vector3::new(6.4, 0.0, 0.0), Vector3::x(), |place| place.z < stop);
        let surface = MultiSurface::extract(&lattice, &topology, &partition).unwrap();
        let mesh = surface.at_rest(&lattice);
        assert_sound(&surface, &mesh, &format!("cut to {stop}"));
        let area = |one: &yawara::surface::interfaces::Interface| check(&one.mesh).area_mm2;
        mesh.interfaces().iter().map(|one| ((one.inside, one.outside), area(one))).collect::<BTreeMap<_, _>>()
    };
    let (whole, half, apart) = (cut(-1.0), cut(4.6), cut(20.0));
    let lost = whole[&(0, 1)] - half[&(0, 1)];
    assert!((lost / whole[&(0, 1)] - 0.5).abs() < 0.08, "half of the wall is gone: {lost} of {}", whole[&(0, 1)]);
    for organ in [0, 1] {
        let gained = half[&(organ, OUTSIDE)] - whole[&(organ, OUTSIDE)];
        assert!((gained / lost - 1.0).abs() < 0.1, "each organ has it as a lip: {gained} of {lost}");
    }
    assert!(!apart.contains_key(&(0, 1)), "nothing is shared any more");
}

#[test]
fn a_cut_across_a_wall_parts_every_organ() {
    let lattice = halves();
    let partition = smoothed(&lattice, 2);
    for normal in [Vector3::y(), Vector3::new(0.3, 1.0, 0.2), Vector3::new(-0.8, 1.0, 0.1)] {
        let mut topology = Topology::new(&lattice);
        cut_plane(&lattice, &mut topology, Vector3::new(6.5, 5.2, 4.7), normal, |_| true);
        let surface = MultiSurface::extract(&lattice, &topology, &partition).unwrap();
        let mesh = surface.at_rest(&lattice);
        assert_sound(&surface, &mesh, &format!("{normal:?}"));
        for organ in [0, 1] {
            assert_eq!(check(&mesh.organ_mesh(organ)).components.len(), 2, "{normal:?}");
        }
    }
}

#[test]
fn three_organs_meet_in_a_line() {
    let mut lattice = lattice(12, 12, 9, |_| true);
    for particle in 0..lattice.len() as u32 {
        let [i, j, _] = lattice.ijk(particle).map(|n| n as f64 - 5.4);
        let third = (j.atan2(i) / std::f64::consts::TAU + 0.5) * 3.0;
        lattice.organ[particle as usize] = (third as u8).min(2);
    }
    let seen = shared(&lattice, &Topology::new(&lattice), &smoothed(&lattice, 3), "thirds");
    assert_eq!(seen.touching, 0, "no organ touches itself");
    let mut cut = Topology::new(&lattice);
    cut_plane(&lattice, &mut cut, Vector3::new(0.0, 0.0, 4.3), Vector3::new(0.1, 0.05, 1.0), |place| place.x < 8.0);
    shared(&lattice, &cut, &smoothed(&lattice, 3), "thirds, cut across their line");
}

/// Everything a surface has, knots and lips included, follows a homogeneous deformation.
#[test]
fn borders_follow_the_tissue() {
    let lattice = halves();
    let mut topology = Topology::new(&lattice);
    cut_plane(&lattice, &mut topology, Vector3::new(6.4, 0.0, 0.0), Vector3::new(1.0, 0.1, 0.0), |place| place.z < 4.6);
    cut_plane(&lattice, &mut topology, Vector3::new(0.0, 5.3, 0.0), Vector3::y(), |place| place.x < 9.0);
    let surface = MultiSurface::extract(&lattice, &topology, &smoothed(&lattice, 2)).unwrap();
    let rest = surface.at_rest(&lattice);
    let stretch = [[1.1, 0.05, 0.0], [-0.1, 0.95, 0.1], [0.0, 0.08, 1.2]];
    let to = |place: [f64; 3]| stretch.map(|row: [f64; 3]| (0..3).map(|axis| row[axis] * place[axis]).sum::<f64>());
    let displacements: Vec<[f32; 3]> = (0..lattice.len() as u32)
        .map(|particle| {
            let place: [f64; 3] = lattice.rest_place(particle).into();
            let moved = to(place);
            [0, 1, 2].map(|axis| (moved[axis] - place[axis]) as f32)
        })
        .collect();
    let moved = surface.carry(&lattice, &displacements);
    assert_sound(&surface, &moved, "deformed");
    for (place, moved) in rest.positions.iter().zip(&moved.positions) {
        let expected = to(place.map(f64::from));
        assert!((0..3).all(|axis| (f64::from(moved[axis]) - expected[axis]).abs() < 1e-4), "{moved:?}, {expected:?}");
    }
}
