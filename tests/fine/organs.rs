//! Random blades through real organs.

use std::path::PathBuf;

use rayon::prelude::*;
use yawara::cut::Blade;
use yawara::dynamics::World;
use yawara::geometry::{Point3, Vector3};
use yawara::io::nifti;
use yawara::lattice::build::NO_ORGAN;
use yawara::lattice::cells::build_cells;
use yawara::surface::check::check;
use yawara::surface::fine::{Body, FineSurface};
use yawara::surface::weld::{soup, weld};
use yawara::volume::{LabelVolume, Volume};

use crate::support::{Random, TISSUE};

/// Labels of the abdomen: spleen, kidneys, gallbladder, liver, aorta, vena cava, pancreas.
const ORGANS: [u16; 8] = [1, 2, 3, 4, 5, 7, 8, 10];

/// `YAWARA_BLADES` sets how many blades are tried.
#[test]
fn random_blades_through_real_organs_leave_closed_manifolds() {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let data = std::env::var_os("YAWARA_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let path = data.join("ct-abdomen-3mm/example_seg.nii.gz");
    if !path.is_file() {
        eprintln!("SKIPPED: no {}; set YAWARA_DATA", path.display());
        return;
    }
    let blades = std::env::var("YAWARA_BLADES").ok().map_or(40, |n| n.parse().expect("a number of blades"));
    let (labels, _) = nifti::read_labels(&path).unwrap();
    let triangles: usize = (0..blades).into_par_iter().map(|blade| cut_one(&labels, blade)).sum();
    println!("{blades} blades through {} real organs: {triangles} triangles, no defect", ORGANS.len());
}

fn cut_one(labels: &LabelVolume, blade: u64) -> usize {
    let label = ORGANS[blade as usize % ORGANS.len()];
    let part = labels.bounding_box(|&found| found == label).unwrap().grown([3; 3], labels.shape());
    let organ = labels.crop(&part);
    let member = |found: &u16| *found == label;
    let map = organ.as_slice().iter().map(|found| if member(found) { 0 } else { NO_ORGAN }).collect();
    let lattice = build_cells(&Volume::from_vec(*organ.grid(), map), None).unwrap();
    let assembly = yawara::material::tissue::assemble(&lattice, &[Some(TISSUE)]);
    let mut world = World::new(lattice, assembly, 1e-4);
    let mut random = Random::new(blade);
    let places: Vec<Point3> = (0..world.lattice().len() as u32).map(|p| world.lattice().rest_place(p)).collect();
    let target = places[(random.unit() * places.len() as f64) as usize];
    let to_lattice = |place: Point3| world.lattice().grid.affine.index_of(place) * world.lattice().pitch;
    let (edge, way) = (random.vector().normalize() * 300.0, random.vector());
    let way = (way - edge * (way.dot(&edge) / edge.norm_squared())).normalize();
    let depth = if random.unit() < 0.4 { 300.0 } else { 20.0 * random.unit() };
    let ends = vec![to_lattice(target - edge - way * 300.0), to_lattice(target + edge - way * 300.0)];
    let stroke = world.to_lattice_axes(way * (300.0 + depth) * 1e-3);
    let blade_of = Blade::new(ends, &[Vector3::zeros(), stroke]);
    world.cut(&blade_of.sweep(0.0, blade_of.path_length()));
    let values = organ.as_slice().iter().map(|found| if member(found) { 1.0 } else { -1.0 }).collect();
    let body = Body::new(*organ.grid(), values).unwrap();
    let surface = FineSurface::extract(&body, world.lattice(), world.topology(), world.cut_sheet()).unwrap();
    let mesh = surface.carry(world.lattice(), &world.displacements_mm());
    let report = check(&mesh);
    assert!(report.passes(), "blade {blade} through label {label}: {report}");
    let welded = check(&weld(&soup(&mesh), 0.0));
    assert!(welded.passes(), "blade {blade} through label {label}, welded: {welded}");
    report.triangles
}
