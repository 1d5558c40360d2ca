//! From a CT volume to a soft organ that can be pushed, pulled and cut, and to surfaces worth looking at.
//!
//! Every voxel of an organ becomes a particle, joined to its 26 neighbours by springs and dampers; Newton's equation is
//! stepped in time O(n); a blade removes the springs it goes through; the surface is a marching-cubes mesh whose vertices
//! are carried by the particles and which opens where the blade went. The model is that of Hattori and Kaneko, *3-D model
//! of soft organs*; materials, stable steps and surfaces are this library's.
//!
//! # The way through
//!
//! ```text
//! volume ──► organ map ──► lattice ──► world ──► run directory ──► surface ──► STL · PLY · glTF · OBJ · VTK
//!   (HU)     (per voxel)  (particles,  (step,     (frames,          (cut-aware,   slices (PNG)
//!                          springs)     cut)       topology)         carried)     plots · checks
//! ```
//! Each arrow is one public type handed on; nothing flows back. In reading order:
//!
//! | folder | what it holds |
//! |---|---|
//! | [`geometry`] | points, affine maps, grids: voxel index to patient place |
//! | [`volume`] | CT volumes and label maps: crop, sample, resample, measure |
//! | [`io`] | files, one format per module: NIfTI in and out, STL, PLY, glTF, OBJ, VTK, PNG |
//! | [`phantom`] | volumes the program makes itself: an abdomen, a cube, a beam |
//! | [`lattice`] | particles, their 26 neighbours, regions, blocks in memory, living springs |
//! | [`material`] | Young's modulus and density, or the paper's constants, to masses and springs |
//! | [`cut`] | a blade's sweep to the springs it crosses |
//! | [`kernel`] | the hot loop: plain reference, fast body, instruction sets |
//! | [`dynamics`] | the moving world: step, stable step, rigid bodies, contact, time line, energy and volume |
//! | [`scene`] | TOML to a checked description in SI units |
//! | [`store`] | the run directory |
//! | [`surface`] | cut-aware marching cubes, carrying, checking |
//! | [`look`] | colour: from values to linear RGB |
//! | [`slice`] | a plane of a volume, at rest or carried by the lattice |
//! | [`render`] | pictures of surfaces and of the lattice, drawn without a graphics card |
//! | [`plot`] | line plots |
//! | [`run`] | the whole way, from a scene to frames and from frames to meshes |
//! | [`deviation`] | how far one run is from another, and the law of the pitch |
//! | [`study`] | what accuracy costs in time, for any scene |
//! | [`accuracy`] | pitch, integrator and step for an error that a scene asks for |
//! | [`verify`] | what the program promises, tried out |
//! | [`cli`] | the command line |
//!
//! # Units and axes
//!
//! SI inside (m, kg, s, Pa, N), millimetres and patient coordinates (RAS+, as in NIfTI: x to the patient's right, y to the
//! front, z to the head) at the edges: files, scenes, regions, meshes. GLB is in metres with +Y towards the head. Arrays
//! run x fastest. State is f32, kept as displacements from rest; whatever judges (energies, volumes, clocks) is f64.
//!
//! # What holds everywhere
//!
//! - `kernel` sees slices and numbers: no files, no scene, no allocation. `io` never simulates; `dynamics` never opens a
//!   file; only `cli` prints or exits.
//! - Rest state is constant, and only cutting changes the topology, by removing springs.
//! - Same scene, same bits, at any number of threads.
//! - A file appears whole or not at all. Bad input is a typed error that says what to do, never a panic.
//!
//! # Example
//!
//! The whole way by hand; [`run`] does the same from a scene.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use yawara::{cut::Blade, dynamics::World, dynamics::stable_dt::stable_dt, geometry::{Point3, Vector3}, volume::Volume};
//! use yawara::lattice::{Topology, build::NO_ORGAN, cells::build_cells, region::Region};
//! use yawara::material::tissue::{Damping, TissueBody, assemble};
//! use yawara::surface::{Surface, field, mesh::{Finish, OrganMesh}};
//! use yawara::io::{nifti, stl};
//!
//! # let folder = tempfile::tempdir()?;
//! # let folder = folder.path();
//! # nifti::write_labels(&folder.join("labels.nii.gz"), &yawara::phantom::cube(12, 3.0)?.labels)?;
//! // Which voxels belong to the organ: here label 1.
//! let (labels, _) = nifti::read_labels(&folder.join("labels.nii.gz"))?;
//! let organs = labels.as_slice().iter().map(|&label| if label == 1 { 0 } else { NO_ORGAN }).collect();
//! let lattice = build_cells(&Volume::from_vec(*labels.grid(), organs), None)?;
//!
//! // Soft tissue, and the step it allows.
//! let liver = TissueBody { youngs_modulus: 5e3, poissons_ratio: 0.25, density: 1060.0, damping: Damping::Ratio(0.2) };
//! let assembly = assemble(&lattice, &[Some(liver)]);
//! let dt = 0.95 * stable_dt(&lattice, &Topology::new(&lattice), &assembly);
//! let mut world = World::new(lattice, assembly, dt);
//!
//! // Hold the left, pull the right (N), and sweep a blade 1 m wide down to the middle, in the lattice's own metres.
//! let side = |x: f64| Region::HalfSpace { point: Point3::new(x, 0.0, 0.0), normal: Vector3::new(x, 0.0, 0.0) };
//! world.hold(&side(-15.0).select(world.lattice()));
//! let pull = world.push(&side(15.0).select(world.lattice()));
//! world.set_force(pull, Vector3::new(0.1, 0.0, 0.0));
//! let edge = vec![Point3::new(0.02, -0.5, 0.1), Point3::new(0.02, 0.5, 0.1)];
//! let blade = Blade::new(edge, &[Vector3::zeros(), Vector3::new(0.0, 0.0, -0.08)]);
//! assert!(world.cut(&blade.sweep(0.0, blade.path_length())) > 0);
//! (0..200).try_for_each(|_| world.step())?;
//!
//! // The surface as it is now, closed and opened by the cut, in patient mm.
//! let values = field::smoothed(world.lattice(), 0, field::SMOOTHING_PASSES);
//! let surface = Surface::extract(world.lattice(), world.topology(), &values)?;
//! let mesh = surface.carry(world.lattice(), &world.displacements_mm());
//! assert!(yawara::surface::check::check(&mesh).passes());
//! let organ = OrganMesh { name: "liver".to_owned(), color: [0.5, 0.1, 0.1], finish: Finish::Wet, mesh };
//! stl::write_stl(&folder.join("liver.stl"), &[organ])?;
//! # Ok(())
//! # }
//! ```

pub mod geometry;
mod splitmix;
pub mod volume;

pub mod io;
pub mod phantom;

pub mod lattice;
pub mod material;

pub mod cut;
pub mod kernel;

pub mod dynamics;
pub mod scene;

pub mod store;
pub mod surface;

pub mod look;

pub mod slice;

pub mod render;

pub mod plot;
pub mod run;

pub mod accuracy;
pub mod deviation;
pub mod study;
pub mod verify;

pub mod cli;
