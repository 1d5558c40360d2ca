//! Decimated and tidied meshes: closed, near, and the same at any thread count.

use rayon::prelude::*;
use yawara::geometry::{GridShape, Vector3};
use yawara::lattice::{Lattice, Topology};
use yawara::surface::care::{Care, CareError, CaredMesh, RestMesh};
use yawara::surface::check::{MeshReport, check};
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::weld::{soup, weld};
use yawara::surface::{Sheet, Surface, field};

use crate::support::{Random, ball, cut_plane, lattice, lattice_on, sever, springs, unit_grid};

const NOTHING: Care = Care { spacing_mm: 1.0, tidy: false, triangles: None, max_error_mm: None };

/// What care needs of a surface.
struct Given {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    sheets: Vec<Sheet>,
    organs: Vec<u8>,
}

impl Given {
    fn of(surface: &Surface) -> Self {
        Self {
            positions: surface.rest_places().collect(),
            triangles: surface.triangles().to_vec(),
            sheets: surface.sheets().collect(),
            organs: surface.organs().collect(),
        }
    }

    fn of_lattice(lattice: &Lattice, topology: &Topology) -> Self {
        let values = field::smoothed(lattice, 0, field::SMOOTHING_PASSES);
        Self::of(&Surface::extract(lattice, topology, &values).unwrap())
    }

    fn after(&self, care: Care) -> CaredMesh {
        let Self { positions, triangles, sheets, organs } = self;
        care.apply(RestMesh { positions, triangles, sheets, organs }).unwrap()
    }

    fn report(&self) -> MeshReport {
        check(&mesh(&self.positions, &self.triangles))
    }

    fn share(&self, percent: usize) -> Care {
        Care { triangles: Some(self.triangles.len() * percent / 100), ..NOTHING }
    }
}

fn mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriangleMesh {
    let positions = positions.iter().map(|p| p.map(|c| c as f32)).collect();
    TriangleMesh { positions, triangles: triangles.to_vec(), ..TriangleMesh::default() }
}

/// Defects of the mesh as it would be written, as it is and welded by place; and that every parent suits.
fn sound(given: &Given, cared: &CaredMesh, welds: bool, what: &str) -> MeshReport {
    let mesh = mesh(&cared.positions, &cared.triangles);
    let report = check(&mesh);
    assert!(report.passes() && report.unused_vertices == 0, "{what}: {report}");
    if welds {
        let welded = check(&weld(&soup(&mesh), 0.0));
        assert!(welded.passes() && welded.vertices == report.vertices, "{what}, welded: {welded}");
    }
    assert_eq!(cared.parents.len(), cared.positions.len());
    assert!(cared.parents.iter().all(|&parent| (parent as usize) < given.positions.len()), "{what}");
    report
}

fn random_cut(trial: u64) -> (Lattice, Topology, Vec<f32>) {
    let mut random = Random::new(trial);
    let [nx, ny, nz] = [0; 3].map(|_| 2 + random.below(5));
    let fill = [0.3, 0.6, 0.9, 1.0][random.below(4)];
    let seed = random.next();
    let lattice = lattice(nx, ny, nz, |[i, j, k]| {
        i + j + k == 0 || Random::new(seed ^ ((i * 36 + j * 6 + k) as u64) << 20).unit() < fill
    });
    let mut topology = Topology::new(&lattice);
    let density = [0.0, 0.02, 0.05, 0.1, 0.3, 0.7][random.below(6)];
    for (particle, direction) in springs(&lattice) {
        if random.unit() < density {
            sever(&lattice, &mut topology, particle, direction, random.unit() as f32);
        }
    }
    if random.unit() < 0.5 {
        let normal = Vector3::from([0; 3].map(|_| random.unit() - 0.5)).normalize();
        let point = Vector3::new(nx as f64, ny as f64, nz as f64) * 0.5;
        cut_plane(&lattice, &mut topology, point, normal, |_| true);
    }
    let sign = |&p: &u32| if p == u32::MAX { -1.0 } else { 1.0 };
    let field = lattice.particle_at.iter().map(|p| sign(p) * (0.01 + random.unit() as f32)).collect();
    (lattice, topology, field)
}

#[test]
fn random_cut_lattices_stay_closed_manifolds() {
    const TRIALS: u64 = 1200;
    let totals: Vec<[usize; 3]> = (0..TRIALS)
        .into_par_iter()
        .map(|trial| {
            let (lattice, topology, field) = random_cut(trial);
            let given = Given::of(&Surface::extract(&lattice, &topology, &field).unwrap());
            let welds = check(&weld(&soup(&mesh(&given.positions, &given.triangles)), 0.0)).passes();
            let mut left = 0;
            let error = |max_error_mm| Care { max_error_mm: Some(max_error_mm), ..NOTHING };
            let cares = [
                Care { tidy: true, ..NOTHING },
                given.share(50),
                given.share(20),
                given.share(5),
                error(0.05),
                error(0.4),
                Care { tidy: true, ..error(0.2) },
                Care { tidy: true, ..given.share(20) },
            ];
            for care in cares {
                let cared = given.after(care);
                sound(&given, &cared, welds, &format!("trial {trial}, {care:?}"));
                for (&parent, place) in cared.parents.iter().zip(&cared.positions) {
                    let moved = (Vector3::from(*place) - Vector3::from(given.positions[parent as usize])).norm();
                    let skin = given.sheets[parent as usize] == Sheet::Skin;
                    // Faces and rims of cuts keep places they had.
                    assert!(skin || moved == 0.0, "trial {trial}, {care:?}: {moved}");
                }
                left += cared.triangles.len();
            }
            assert_eq!(given.after(NOTHING).positions, given.positions);
            [given.triangles.len(), left, usize::from(welds)]
        })
        .collect();
    let sum = |at: usize| totals.iter().map(|t| t[at]).sum::<usize>();
    eprintln!("{TRIALS} lattices, {} triangles, {} after eight cares, {} weld", sum(0), sum(1), sum(2));
    assert!(sum(0) > 200_000 && sum(1) < 6 * sum(0) && sum(2) > TRIALS as usize * 9 / 10);
}

fn two_halves() -> (Lattice, Topology) {
    let lattice = lattice(26, 26, 26, ball(26, 11.2));
    let mut topology = Topology::new(&lattice);
    let cut =
        cut_plane(&lattice, &mut topology, Vector3::new(12.0, 13.3, 11.0), Vector3::new(0.8, 0.5, -0.3), |_| true);
    assert!(cut > 2000);
    (lattice, topology)
}

#[test]
fn volumes_stay_and_the_lips_of_a_cut_stay_apart() {
    let (lattice, topology) = two_halves();
    let whole = Topology::new(&lattice);
    for (name, topology, parts) in [("whole", &whole, 1), ("cut", &topology, 2)] {
        let given = Given::of_lattice(&lattice, topology);
        let before = given.report();
        assert!(before.passes() && before.components.len() == parts);
        for percent in [50, 20, 5] {
            for tidy in [false, true] {
                let cared = given.after(Care { tidy, ..given.share(percent) });
                let what = format!("{name}, {percent} %, tidy {tidy}");
                let after = sound(&given, &cared, true, &what);
                let change = after.volume_mm3 / before.volume_mm3 - 1.0;
                eprintln!(
                    "{what}: {} of {} triangles, volume {:+.3} %, smallest angle {:.2}, {} below 5 degrees",
                    after.triangles,
                    before.triangles,
                    100.0 * change,
                    after.min_angle_deg,
                    after.slivers
                );
                assert!(change.abs() < 0.005, "{what}: {change}");
                assert!(after.components.len() == parts && after.euler == before.euler, "{what}");
                assert!(after.triangles <= given.triangles.len() * percent / 100 + 1, "{what}: {}", after.triangles);
            }
        }
    }
}

#[test]
fn tidying_leaves_no_needles() {
    let (lattice, topology) = two_halves();
    let given = Given::of_lattice(&lattice, &topology);
    let before = given.report();
    let cared = given.after(Care { tidy: true, ..NOTHING });
    let after = sound(&given, &cared, true, "tidy");
    eprintln!(
        "tidy: {} of {} triangles, smallest angle {:.2} from {:.2}, below 5 degrees {} from {}, volume {:+.4} %",
        after.triangles,
        before.triangles,
        after.min_angle_deg,
        before.min_angle_deg,
        after.slivers,
        before.slivers,
        100.0 * (after.volume_mm3 / before.volume_mm3 - 1.0)
    );
    assert!(after.min_angle_deg > before.min_angle_deg && after.slivers * 10 < before.slivers);
}

/// Distance from a point to a triangle: over its face where it lies over it, else to the nearest side.
fn to_triangle(p: Vector3, corners: [Vector3; 3]) -> f64 {
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a)).normalize();
    let over = (0..3).all(|at| {
        let (from, to) = (corners[at], corners[(at + 1) % 3]);
        (to - from).cross(&(p - from)).dot(&normal) >= 0.0
    });
    if over {
        return (p - a).dot(&normal).abs();
    }
    let side = |from: Vector3, to: Vector3| {
        let way = to - from;
        (p - from - way * ((p - from).dot(&way) / way.norm_squared()).clamp(0.0, 1.0)).norm()
    };
    side(a, b).min(side(b, c)).min(side(c, a))
}

/// The farthest of random points of one mesh from another.
fn farthest(from: &CaredMesh, to: &CaredMesh, samples: usize) -> f64 {
    let corners = |mesh: &CaredMesh, t: usize| mesh.triangles[t].map(|v| Vector3::from(mesh.positions[v as usize]));
    let targets: Vec<[Vector3; 3]> = (0..to.triangles.len()).map(|t| corners(to, t)).collect();
    let distance = |sample: usize| {
        let mut random = Random::new(sample as u64);
        let [a, b, c] = corners(from, random.below(from.triangles.len()));
        let (mut u, mut v) = (random.unit(), random.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let point = a + (b - a) * u + (c - a) * v;
        targets.iter().map(|&triangle| to_triangle(point, triangle)).fold(f64::INFINITY, f64::min)
    };
    (0..samples).into_par_iter().map(distance).reduce(|| 0.0, f64::max)
}

#[test]
fn the_distance_asked_for_is_held_both_ways() {
    let (lattice, topology) = two_halves();
    let given = Given::of_lattice(&lattice, &topology);
    let original = given.after(NOTHING);
    let mut before = usize::MAX;
    for (max_error, tidy) in [(0.02, false), (0.1, false), (0.1, true), (0.4, false), (0.4, true)] {
        let cared = given.after(Care { max_error_mm: Some(max_error), tidy, ..NOTHING });
        sound(&given, &cared, true, &format!("{max_error} mm"));
        let apart = [farthest(&original, &cared, 1500), farthest(&cared, &original, 1500)];
        eprintln!(
            "{max_error} mm, tidy {tidy}: {} of {} triangles, {apart:.4?} mm apart",
            cared.triangles.len(),
            given.triangles.len()
        );
        assert!(apart.iter().all(|&distance| distance <= max_error), "{max_error}: {apart:?}");
        if !tidy {
            assert!(cared.triangles.len() < before, "a larger error leaves fewer triangles");
            before = cared.triangles.len();
        }
    }
    assert!(before < given.triangles.len() / 8, "{before}");
}

#[test]
fn the_same_bits_at_any_thread_count() {
    let (lattice, topology) = two_halves();
    let given = Given::of_lattice(&lattice, &topology);
    for care in [Care { tidy: true, ..given.share(10) }, Care { max_error_mm: Some(0.1), ..NOTHING }] {
        let [one, four] = [1, 4].map(|threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| given.after(care))
        });
        assert_eq!(one, four);
    }
}

/// Two organs that touch: the border between them keeps its vertices' organs, and parents never change organ.
#[test]
fn parents_are_near_and_of_the_same_organ_and_sheet() {
    let (lattice, topology) = two_halves();
    let mut given = Given::of_lattice(&lattice, &topology);
    given.organs = given.positions.iter().map(|p| u8::from(p[2] > 12.0)).collect();
    let cared = given.after(given.share(20));
    sound(&given, &cared, true, "two organs");
    let mut farthest: f64 = 0.0;
    for (&parent, &place) in cared.parents.iter().zip(&cared.positions) {
        let from = |p: [f64; 3]| (Vector3::from(p) - Vector3::from(place)).norm();
        farthest = farthest.max(from(given.positions[parent as usize]));
    }
    assert!(farthest < 1.5, "{farthest}");
    let organs = |wanted: u8| cared.parents.iter().filter(|&&p| given.organs[p as usize] == wanted).count();
    assert!(organs(0) > 50 && organs(1) > 50);
}

#[test]
fn what_cannot_be_cared_for_is_refused_with_reasons() {
    let lattice = lattice_on(unit_grid(3, 3, 3), |_| true);
    let given = Given::of(&Surface::extract(&lattice, &Topology::new(&lattice), &field::binary(&lattice, 0)).unwrap());
    assert_eq!(lattice.grid.shape, GridShape::new(3, 3, 3));
    let rest = RestMesh { positions: &given.positions, triangles: &given.triangles, sheets: &[], organs: &[] };
    let refused = |care: Care, mesh: RestMesh<'_>, words: &[&str]| {
        let text = care.apply(mesh).unwrap_err().to_string();
        assert!(words.iter().all(|word| text.contains(word)), "{text}");
    };
    refused(NOTHING, RestMesh { triangles: &given.triangles[1..], ..rest }, &["1 triangles", "expected two", "check"]);
    refused(NOTHING, RestMesh { triangles: &[[0, 1, 1]], ..rest }, &["triangle 0", "[0, 1, 1]"]);
    refused(NOTHING, RestMesh { organs: &[1, 2], ..rest }, &["2 organs", "one each"]);
    refused(Care { spacing_mm: 0.0, ..NOTHING }, rest, &["the spacing is 0 mm"]);
    refused(Care { max_error_mm: Some(f64::NAN), ..NOTHING }, rest, &["the largest error is NaN mm"]);
    let mut places = given.positions.clone();
    places[4][1] = f64::INFINITY;
    refused(NOTHING, RestMesh { positions: &places, ..rest }, &["vertex 4", "inf", "finite"]);
    let empty = RestMesh { positions: &[], triangles: &[], sheets: &[], organs: &[] };
    assert!(NOTHING.apply(empty).unwrap().triangles.is_empty());
    assert!(!CareError::NotManifold { vertex: 5 }.to_string().is_empty());
}
