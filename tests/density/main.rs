//! Density by voxel: what a scene's lattice weighs against what its voxels weigh, summed here one by one.

use std::path::Path;

use yawara::dynamics::World;
use yawara::geometry::{Affine, Grid, GridShape, Matrix3, Point3, Vector3};
use yawara::io::nifti::{CtEncoding, write_ct, write_labels};
use yawara::run::inputs;
use yawara::run::label_lookup::Files;
use yawara::run::prepare::{PrepareError, Prepared, prepare};
use yawara::scene;
use yawara::volume::{CtVolume, LabelVolume, Volume};

/// Masses are f32, each rounded from its own sum.
const ROUNDING: f64 = 1e-6;
/// [mm]
const SPACING: f64 = 4.0;
const MAP: &str = "{ hu = [[-200, 800], [0, 1000], [40, 1030], [400, 1500]] }";

/// Label 1, a block with a corner missing, and label 2, a bar, further off than a cell.
struct Body {
    folder: tempfile::TempDir,
    labels: LabelVolume,
    ct: CtVolume,
}

impl Body {
    /// With a CT that differs from voxel to voxel, and air around.
    fn new() -> Self {
        let shape = GridShape::new(16, 10, 8);
        let affine = Affine::from_spacing([SPACING; 3], [-30.0, 12.0, 400.0]).unwrap();
        let grid = Grid { shape, affine };
        let label = |voxel: usize| match shape.ijk(voxel) {
            [2..=8, 2..=7, 2..=5] if shape.ijk(voxel) != [8, 7, 5] => 1,
            [12..=14, 1..=8, 3..=4] => 2,
            _ => 0,
        };
        let labels: Vec<u16> = (0..shape.len()).map(label).collect();
        let hu = |voxel: usize| {
            let [i, j, k] = shape.ijk(voxel).map(|n| n as f64);
            if labels[voxel] == 0 { -1000.0 } else { (31.0 * j - 17.0 * i + 40.0 * (1.7 * k + i * j).sin()) as f32 }
        };
        let ct = Volume::from_vec(grid, (0..shape.len()).map(hu).collect());
        let labels = Volume::from_vec(grid, labels);
        let folder = tempfile::tempdir().unwrap();
        write_ct(&folder.path().join("ct.nii"), &ct, CtEncoding::Float32).unwrap();
        write_labels(&folder.path().join("labels.nii"), &labels).unwrap();
        Self { folder, labels, ct }
    }

    /// Density of a voxel by [`MAP`], written out [kg/m^3].
    fn density(&self, voxel: usize) -> f64 {
        let hu = f64::from(self.ct.as_slice()[voxel]);
        match hu {
            ..=-200.0 => 800.0,
            ..=0.0 => 1000.0 + hu,
            ..=40.0 => 1000.0 + 0.75 * hu,
            ..=400.0 => 1030.0 + (hu - 40.0) * 470.0 / 360.0,
            _ => 1500.0,
        }
    }

    /// Voxels of a label: place, RAS+ [mm], and mass [kg].
    fn voxels(&self, label: u16) -> Vec<(Point3, f64)> {
        let volume = (SPACING * 1e-3).powi(3);
        let own = (0..self.labels.shape().len()).filter(|&voxel| self.labels.as_slice()[voxel] == label);
        own.map(|voxel| (self.labels.grid().place(voxel), self.density(voxel) * volume)).collect()
    }

    fn mass(&self, label: u16) -> f64 {
        self.voxels(label).iter().map(|(_, mass)| mass).sum()
    }

    /// Writes densities as a volume of their own: of organs the mapped ones, elsewhere none at all.
    fn write_densities(&self) {
        let density = |voxel| if self.labels.as_slice()[voxel] == 0 { 0.0 } else { self.density(voxel) as f32 };
        let densities: CtVolume =
            Volume::from_vec(*self.labels.grid(), (0..self.labels.shape().len()).map(density).collect());
        write_ct(&self.folder.path().join("density.nii"), &densities, CtEncoding::Float32).unwrap();
    }

    /// Label 1 soft, label 2 as given; `lattice` are the keys of its table.
    fn prepared(&self, lattice: &str, soft: &str, bar: &str) -> Result<Prepared, PrepareError> {
        let text = format!(
            "[volume]\nimage = \"ct.nii\"\nlabels = \"labels.nii\"\n[lattice]\n{lattice}\n\
             [[organ]]\nname = \"block\"\nlabel = 1\n{soft}\n[[organ]]\nname = \"bar\"\nlabel = 2\n{bar}\n\
             [time]\nduration = 0.01\nframes = 1\n[gravity]\nacceleration = [0, 0, -9.81]\n"
        );
        let (scene, _) = scene::parse(&text, Path::new("s.toml"), self.folder.path(), &Files)
            .unwrap_or_else(|error| panic!("{error}"));
        prepare(&scene, &inputs::load(&scene).unwrap_or_else(|error| panic!("{error}")))
    }
}

fn tissue(density: &str) -> String {
    format!("youngs_modulus = 5e3\ndensity = {density}")
}

fn free(density: &str) -> String {
    format!("rigid = true\ndensity = {density}")
}

fn total(prepared: &Prepared) -> f64 {
    prepared.assembly.mass.iter().map(|&mass| f64::from(mass)).sum()
}

fn near(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found / expected - 1.0).abs() <= tolerance, "{what}: {found:e}, expected {expected:e}");
}

#[test]
fn a_lattice_weighs_what_its_voxels_weigh() {
    let body = Body::new();
    let expected = body.mass(1) + body.mass(2);
    assert!((expected / (1060.0 / 1000.0) / body.mass(1) - 1.0).abs() > 0.1, "both organs count");
    // At the voxels' own pitch, and where cells are whole voxels: exactly. Between: no more than interpolation blurs.
    for (pitch, tolerance) in [("", ROUNDING), ("pitch = 8", ROUNDING), ("pitch = 2", 2e-3), ("pitch = 5.3", 5e-3)] {
        for bar in [tissue(MAP), free(MAP)] {
            let prepared = body.prepared(pitch, &tissue(MAP), &bar).unwrap();
            near(total(&prepared), expected, tolerance, &format!("\"{pitch}\", {bar}"));
        }
    }
}

#[test]
fn each_particle_weighs_an_eighth_of_the_voxels_around_it() {
    let body = Body::new();
    let Prepared { lattice, assembly, spreads, .. } = body.prepared("", &tissue(MAP), &free(MAP)).unwrap();
    let mut expected = vec![0.0; lattice.len()];
    for (place, mass) in [body.voxels(1), body.voxels(2)].concat() {
        for (particle, expected) in (0..).zip(&mut expected) {
            let off = lattice.rest_place(particle) - place;
            if off.iter().all(|offset| offset.abs() < 0.6 * SPACING) {
                *expected += mass / 8.0;
            }
        }
    }
    for (particle, (&found, &expected)) in assembly.mass.iter().zip(&expected).enumerate() {
        near(found.into(), expected, ROUNDING, &format!("particle {particle}"));
    }
    // What `info` tells of it.
    for (label, spread) in (1..).zip(&spreads) {
        let densities: Vec<f64> = body.voxels(label).iter().map(|(_, mass)| mass / (SPACING * 1e-3).powi(3)).collect();
        let spread = spread.density.expect("it varies");
        near(spread.least, densities.iter().copied().fold(f64::MAX, f64::min), 1e-9, "least");
        near(spread.most, densities.iter().copied().fold(0.0, f64::max), 1e-9, "most");
        near(spread.mean, densities.iter().sum::<f64>() / densities.len() as f64, 1e-9, "mean");
    }
    assert_eq!((spreads[0].youngs_modulus, spreads[1].youngs_modulus), (None, None));
}

#[test]
fn a_volume_of_densities_is_the_map_it_was_made_by() {
    let body = Body::new();
    body.write_densities();
    let file = "{ file = \"density.nii\" }";
    let paper = "stiffness = 10\ndamping = 0.01\nmass = 7e-5";
    for lattice in ["", "pitch = 2", "pitch = 5.3", "pitch = 8", "model = \"paper\"", "model = \"paper\"\npitch = 6"] {
        let is_paper = lattice.contains("paper");
        let soft = |density| if is_paper { paper.to_owned() } else { tissue(density) };
        // What lies around the organs has no density in the file; that must neither be refused nor run into them.
        let [mapped, read] = [MAP, file].map(|density| {
            body.prepared(lattice, &soft(density), &free(density)).unwrap_or_else(|error| panic!("{lattice}: {error}"))
        });
        assert_eq!(mapped.assembly.rigid, read.assembly.rigid);
        for (&mapped, &read) in mapped.assembly.mass.iter().zip(&read.assembly.mass) {
            near(read.into(), mapped.into(), ROUNDING, lattice);
        }
        near(read.schedule.stable_dt, mapped.schedule.stable_dt, 1e-5, lattice);
        if is_paper {
            let rigid = |particle: &usize| mapped.lattice.organ[*particle] == 1;
            let sum: f64 = (0..mapped.lattice.len()).filter(rigid).map(|p| f64::from(mapped.assembly.mass[p])).sum();
            if !lattice.contains("pitch") {
                near(sum, body.mass(2), ROUNDING, "the bar of model paper");
            }
        }
    }
}

/// The same number everywhere, however it is said.
#[test]
fn a_map_to_one_density_is_that_density() {
    let body = Body::new();
    let flat = "{ hu = [[0, 1100], [1, 1100]] }";
    for lattice in ["", "pitch = 5.3"] {
        let [varied, constant] =
            [flat, "1100"].map(|density| body.prepared(lattice, &tissue(density), &free(density)).unwrap());
        for (&varied, &constant) in varied.assembly.mass.iter().zip(&constant.assembly.mass) {
            near(varied.into(), constant.into(), ROUNDING, lattice);
        }
        assert_eq!((constant.spreads[0].density, varied.spreads[0].density.is_some()), (None, true));
    }
}

/// Mass, centre and inertia of a free organ, against sums over its voxels.
#[test]
fn a_rigid_body_turns_as_its_voxels_do() {
    let body = Body::new();
    let paper = "stiffness = 10\ndamping = 0.01\nmass = 7e-5";
    let h = SPACING * 1e-3;
    // Every particle counts as a cube of its own: h^2 / 6. In model paper these are the voxels; in tissue the mass of a voxel
    // sits in cubes around its eight corners, h/2 off along each axis.
    for (lattice, soft, spread) in
        [("model = \"paper\"", paper.to_owned(), h * h / 6.0), ("", tissue("1060"), h * h * (0.5 + 1.0 / 6.0))]
    {
        let prepared = body.prepared(lattice, &soft, &free(MAP)).unwrap();
        let to_lattice = prepared.lattice.grid.affine;
        let pitch = prepared.lattice.pitch;
        let voxels: Vec<(Vector3, f64)> =
            body.voxels(2).into_iter().map(|(place, mass)| (to_lattice.index_of(place).coords * pitch, mass)).collect();
        let world = World::new(prepared.lattice, prepared.assembly, prepared.schedule.dt);
        let [found] = world.rigid_bodies() else { panic!("one bar") };

        let mass: f64 = voxels.iter().map(|(_, mass)| mass).sum();
        let centre = voxels.iter().map(|(place, mass)| place * *mass).sum::<Vector3>() / mass;
        let inertia: Matrix3 = voxels
            .iter()
            .map(|(place, mass)| {
                let r = place - centre;
                (Matrix3::identity() * (r.norm_squared() + spread) - r * r.transpose()) * *mass
            })
            .sum();
        near(found.mass(), mass, ROUNDING, "mass");
        let middle = voxels.iter().map(|(place, _)| place).sum::<Vector3>() / voxels.len() as f64;
        assert!((centre - middle).norm() > 0.02 * h, "the bar is heavier at one end");
        assert!((found.centre() - centre).norm() < 1e-6 * h, "{} {centre}", found.centre());
        assert!((found.inertia() - inertia).norm() < ROUNDING * inertia.norm(), "{} {inertia}", found.inertia());
    }
}

#[test]
fn a_voxel_without_a_density_is_refused_by_its_place() {
    let body = Body::new();
    body.write_densities();
    let path = body.folder.path().join("density.nii");
    let (densities, _) = yawara::io::nifti::read_ct(&path).unwrap();
    let bad = (0..).zip(body.labels.as_slice()).find(|(_, label)| **label == 2).unwrap().0;
    let place = body.labels.grid().place(bad);
    let mut values = densities.as_slice().to_vec();
    values[bad] = -5.0;
    write_ct(&path, &Volume::from_vec(*densities.grid(), values), CtEncoding::Float32).unwrap();
    for bar in [tissue("{ file = \"density.nii\" }"), free("{ file = \"density.nii\" }")] {
        let error = body.prepared("", &tissue("1060"), &bar).unwrap_err().to_string();
        let at = format!("({:.1}, {:.1}, {:.1}) mm (RAS+)", place.x, place.y, place.z);
        for part in ["organ `bar`", "density.nii", "a density of -5 kg/m3", &at, "above 0", "mend the volume"] {
            assert!(error.contains(part), "no {part} in: {error}");
        }
    }
}

/// Lighter particles allow a smaller step: the bound follows the lightest.
#[test]
fn the_stable_step_follows_the_density_of_each_cell() {
    let body = Body::new();
    let bound = |density: &str| body.prepared("", &tissue(density), "rigid = true").unwrap().schedule.limits.rest;
    let [light, heavy] = [bound("400"), bound("1600")];
    near(heavy / light, 2.0, 1e-3, "a step goes with the root of the density");
    // Half of the block is four times as light as the other.
    let both = bound("{ hu = [[-1000, 400], [0, 400], [1, 1600], [1000, 1600]] }");
    assert!(both < 1.05 * light && both < 0.6 * heavy, "{both:e} {light:e} {heavy:e}");
}
