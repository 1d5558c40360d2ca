//! Several organs on one fine grid, with shared walls, carried by a lattice that blades went through.

use std::path::PathBuf;

use rayon::prelude::*;
use yawara::cut::Blade;
use yawara::dynamics::World;
use yawara::geometry::{Grid, GridShape, Point3, Vector3};
use yawara::io::nifti;
use yawara::lattice::build::NO_ORGAN;
use yawara::lattice::cells::build_cells;
use yawara::surface::check::check;
use yawara::surface::interfaces::{MultiBody, MultiSurface, OUTSIDE, OrganField, Partition};
use yawara::surface::smooth::{Voxels, from_mask};
use yawara::surface::weld::{soup, weld};
use yawara::volume::{LabelVolume, Volume, VoxelBox};

use crate::support::{Random, TISSUE};

/// Labels of the abdomen that touch: liver, gallbladder, right kidney, vena cava, portal vein, duodenum, pancreas.
const ORGANS: [u16; 7] = [5, 4, 2, 8, 9, 56, 10];

/// Sums of f32 places, relative.
const VOLUME_ROUNDING: f64 = 1e-5;

fn partition(labels: &LabelVolume) -> Partition {
    let shape = labels.shape();
    let organ = |found: u16| ORGANS.iter().position(|&label| label == found);
    let field = |number: usize| {
        let member: Vec<bool> = labels.as_slice().iter().map(|&found| organ(found) == Some(number)).collect();
        let foreign: Vec<bool> =
            labels.as_slice().iter().map(|&found| organ(found).is_some_and(|other| other != number)).collect();
        let values = from_mask(Voxels { shape, organ: &member, foreign: &foreign }, 1.0);
        OrganField { low: [0; 3], shape, values }
    };
    Partition::new(shape, (0..ORGANS.len()).map(field).collect(), |point| organ(labels.as_slice()[point]).is_some())
}

/// The lattice of those organs at a pitch `coarse` times that of the labels, cut by a random blade.
fn cut_world(labels: &LabelVolume, coarse: usize, blade: u64) -> World {
    let dims = labels.shape().dims().map(|n| n / coarse);
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    let matrix = labels.grid().affine.matrix();
    let mut scaled = matrix;
    let shift = (coarse as f64 - 1.0) / 2.0;
    for row in 0..3 {
        for column in 0..3 {
            scaled[(row, column)] *= coarse as f64;
            scaled[(row, 3)] += shift * matrix[(row, column)];
        }
    }
    let grid = Grid { shape, affine: yawara::geometry::Affine::new(&scaled).unwrap() };
    let organ = |point: usize| {
        let ijk = shape.ijk(point).map(|i| i * coarse);
        (0..coarse.pow(3))
            .find_map(|c| {
                let at = [ijk[0] + c % coarse, ijk[1] + c / coarse % coarse, ijk[2] + c / coarse / coarse];
                ORGANS.iter().position(|&label| label == labels.as_slice()[labels.shape().linear(at)])
            })
            .map_or(NO_ORGAN, |organ| organ as u8)
    };
    let map = Volume::from_vec(grid, (0..shape.len()).map(organ).collect());
    let lattice = build_cells(&map, None).unwrap();
    let assembly = yawara::material::tissue::assemble(&lattice, &[Some(TISSUE); ORGANS.len()]);
    let mut world = World::new(lattice, assembly, 1e-4);
    let mut random = Random::new(blade);
    let places: Vec<Point3> = (0..world.lattice().len() as u32).map(|p| world.lattice().rest_place(p)).collect();
    let target = places[(random.unit() * places.len() as f64) as usize];
    let to_lattice = |place: Point3| world.lattice().grid.affine.index_of(place) * world.lattice().pitch;
    let (edge, way) = (random.vector().normalize() * 300.0, random.vector());
    let way = (way - edge * (way.dot(&edge) / edge.norm_squared())).normalize();
    let depth = if random.unit() < 0.4 { 300.0 } else { 30.0 * random.unit() };
    let ends = vec![to_lattice(target - edge - way * 300.0), to_lattice(target + edge - way * 300.0)];
    let stroke = world.to_lattice_axes(way * (300.0 + depth) * 1e-3);
    let blade_of = Blade::new(ends, &[Vector3::zeros(), stroke]);
    world.cut(&blade_of.sweep(0.0, blade_of.path_length()));
    world
}

/// `YAWARA_BLADES` sets how many blades are tried.
#[test]
fn random_blades_through_organs_that_touch_leave_every_organ_closed() {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let data = std::env::var_os("YAWARA_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let path = data.join("ct-abdomen-3mm/example_seg.nii.gz");
    if !path.is_file() {
        eprintln!("SKIPPED: no {}; set YAWARA_DATA", path.display());
        return;
    }
    let blades = std::env::var("YAWARA_BLADES").ok().map_or(12, |n| n.parse().expect("a number of blades"));
    let (labels, _) = nifti::read_labels(&path).unwrap();
    let part: VoxelBox = labels.bounding_box(|found| ORGANS.contains(found)).unwrap().grown([4; 3], labels.shape());
    let labels = labels.crop(&part);
    let body = MultiBody::new(*labels.grid(), &partition(&labels)).unwrap();
    let triangles: Vec<usize> = (0..blades)
        .into_par_iter()
        .map(|blade| {
            let world = cut_world(&labels, 1 + blade as usize % 2, blade);
            let surface =
                MultiSurface::extract_fine(&body, world.lattice(), world.topology(), world.cut_sheet()).unwrap();
            let mesh = surface.carry(world.lattice(), &world.displacements_mm());
            let mut sum = 0.0;
            for organ in 0..ORGANS.len() as u8 {
                let own = mesh.organ_mesh(organ);
                let report = check(&own);
                assert!(report.passes(), "blade {blade}, label {}: {report}", ORGANS[usize::from(organ)]);
                let welded = check(&weld(&soup(&own), 0.0));
                assert!(welded.passes(), "blade {blade}, label {}, welded: {welded}", ORGANS[usize::from(organ)]);
                sum += report.volume_mm3;
            }
            let mut skin =
                yawara::surface::mesh::TriangleMesh { positions: mesh.positions.clone(), ..Default::default() };
            let all = surface.triangles().iter().zip(surface.sides());
            skin.triangles = all.filter(|(_, sides)| sides[1] == OUTSIDE).map(|(triangle, _)| *triangle).collect();
            let whole = check(&skin).volume_mm3;
            assert!((sum - whole).abs() < VOLUME_ROUNDING * sum, "blade {blade}: {sum} of {whole}");
            surface.triangles().len()
        })
        .collect();
    let sum = triangles.iter().sum::<usize>();
    println!("{blades} blades through {} organs: {sum} triangles", ORGANS.len());
    assert!(sum > 40_000 * triangles.len());
}
