//! Borders of several organs drawn at once: every organ closed, every wall shared, whatever was severed.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use yawara::geometry::Vector3;
use yawara::lattice::{Lattice, NO_PARTICLE, Topology};
use yawara::surface::check::check;
use yawara::surface::field;
use yawara::surface::interfaces::{MultiMesh, MultiSurface, OUTSIDE, Partition};
use yawara::surface::mesh::TriangleMesh;

use crate::support::{Random, cut_plane, lattice, sever, springs};

/// Sums of f32 places in f64 against each other, relative to the sum of what is added.
const VOLUME_ROUNDING: f64 = 1e-5;

/// What was looked at.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    triangles: usize,
    /// Edges at which three or more sheets meet.
    lines: usize,
    /// Vertices that an organ needs twice because it touches itself there.
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
    let mut sum = 0.0;
    let mut used = 0;
    for &organ in &organs {
        let own = mesh.organ_mesh(organ);
        let report = check(&own);
        assert!(report.passes(), "{what}, organ {organ}: {report}");
        assert_eq!(report.unused_vertices, 0, "{what}");
        assert!(own.normals.iter().flatten().all(|c| c.is_finite()), "{what}");
        let distinct: BTreeSet<[u32; 3]> = own.positions.iter().map(|place| place.map(f32::to_bits)).collect();
        seen.touching += own.positions.len() - distinct.len();
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
    assert!((sum - whole.volume_mm3).abs() <= VOLUME_ROUNDING * (1.0 + sum), "{what}: {sum} of {}", whole.volume_mm3);
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
    let mut random = Random(trial);
    let [nx, ny, nz] = [0; 3].map(|_| 2 + random.below(4));
    let fill = [0.5, 0.8, 0.95, 1.0][random.below(4)];
    let seed = random.next();
    let mut lattice = lattice(nx, ny, nz, |[i, j, k]| {
        i + j + k == 0 || Random(seed ^ ((i * 36 + j * 6 + k) as u64) << 20).unit() < fill
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

#[test]
fn random_organs_and_cuts_share_closed_walls() {
    // Ten thousand in release: cargo test --release --test surface -- random_organs
    let trials = if cfg!(debug_assertions) { 600 } else { 10_000 };
    let seen = (0..trials).into_par_iter().map(random_case).reduce(Seen::default, |one, two| one + two);
    eprintln!("{trials} lattices: {seen:?}");
    assert!(seen.triangles > 300 * trials as usize && seen.lines > 50 * trials as usize, "{seen:?}");
    assert!(seen.severed > 10 * trials as usize, "{seen:?}");
}
