//! Reading a run, one frame at a time.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::ARRAYS;
use super::array::{Number, Spec, read_json};
use super::error::ReadRunError;
use super::manifest::{self, Manifest, Status};
use crate::cut::CutSheet;
use crate::geometry::{Affine, Grid, GridShape, Matrix4};
use crate::lattice::build::NO_ORGAN;
use crate::lattice::neighbours::{ALL_ALIVE, NEIGHBOURS, opposite};
use crate::lattice::{Lattice, NO_PARTICLE, SeveredSpring, Topology};

/// Most grid points of a lattice that is read: its index from grid to particles takes 4 bytes for each.
const MOST_POINTS: usize = 1 << 30;

/// One frame of a run.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Simulated time [s].
    pub time_s: f64,
    /// Steps taken since the start.
    pub step: u64,
    /// Displacement of each particle from rest, RAS+ [mm].
    pub displacements_mm: Vec<[f32; 3]>,
    /// The springs as of this frame.
    pub topology: Topology,
}

/// A growing list of numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Unit of the values.
    pub unit: String,
    /// The values.
    pub values: Vec<f64>,
}

/// An array that was kept with the lattice.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtraArray<T> {
    /// Length of each axis, slowest first.
    pub shape: Vec<usize>,
    /// Its values.
    pub values: Vec<T>,
}

/// A run opened for reading. Holds the lattice and the lists; frames are read when asked for.
#[derive(Debug)]
pub struct RunReader {
    path: PathBuf,
    manifest: Manifest,
    scene: Value,
    lattice: Lattice,
    displacement: Spec<f32>,
    time: Vec<f64>,
    step: Vec<u64>,
    severed_count: Vec<u64>,
}

impl RunReader {
    /// Opens a run: reads its manifest, scene, lattice and the list of its frames. An interrupted run opens with the
    /// frames it has.
    ///
    /// # Errors
    /// If this is no run, a part of the above is missing or damaged, or parts do not belong together. Damaged frames are
    /// found when they are read.
    pub fn open(path: &Path) -> Result<Self, ReadRunError> {
        let manifest_path = path.join("manifest.json");
        if !manifest_path.is_file() {
            return Err(ReadRunError::NotARun { path: path.to_path_buf() });
        }
        let manifest = read_manifest(&manifest_path)?;
        let scene = read_json(&path.join("scene.json"))?;
        let root = path.join(ARRAYS);
        let lattice = read_lattice(&root.join("lattice"), &manifest)?;
        let frames = root.join("frames");
        let (displacement, count) = Spec::<f32>::open(frames.join("displacement"))?;
        if displacement.row() != [lattice.len(), 3] {
            let message = format!("rows of {:?}, but the lattice has {} particles", displacement.row(), lattice.len());
            return Err(ReadRunError::Inconsistent { path: frames.join("displacement"), message });
        }
        let time = read_list(frames.join("time"), count)?;
        let step = read_list(frames.join("step"), count)?;
        let severed_count: Vec<u64> = read_list(frames.join("severed_count"), count)?;
        if !severed_count.is_sorted() {
            let message = format!("{severed_count:?} shrinks, but springs do not grow back");
            return Err(ReadRunError::Inconsistent { path: frames.join("severed_count"), message });
        }
        Ok(Self { path: path.to_path_buf(), manifest, scene, lattice, displacement, time, step, severed_count })
    }

    /// Steps taken before a frame.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn step(&self, index: usize) -> u64 {
        self.step[index]
    }

    /// Folder of the run.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The manifest. Its frame count may be one behind [`RunReader::frames`] in an interrupted run.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The scene after checking.
    pub fn scene(&self) -> &Value {
        &self.scene
    }

    /// The scene as written, if the run has it.
    ///
    /// # Errors
    /// If it is there but cannot be read as text.
    pub fn scene_toml(&self) -> Result<Option<String>, ReadRunError> {
        let path = self.path.join("scene.toml");
        match fs::read_to_string(&path) {
            Ok(text) => Ok(Some(text)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(ReadRunError::Io { path, source }),
        }
    }

    /// The lines of the log; a torn last line is shown as far as it goes.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn log(&self) -> Result<String, ReadRunError> {
        let path = self.path.join("log.txt");
        let bytes = fs::read(&path).map_err(|source| ReadRunError::Io { path, source })?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// The rest state.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Number of whole frames.
    pub fn frames(&self) -> usize {
        self.time.len()
    }

    /// What a user should know before trusting the last frame: why the run ended early, if it did.
    pub fn warning(&self) -> Option<String> {
        let frames = self.frames();
        match &self.manifest.status {
            Status::Complete => None,
            Status::Running => Some(format!(
                "{}: the run was interrupted or is still being computed; it has {frames} whole frames",
                self.path.display()
            )),
            Status::Stopped { reason } => {
                Some(format!("{}: the run stopped early with {frames} frames: {reason}", self.path.display()))
            }
        }
    }

    /// Simulated time of each frame [s].
    pub fn times(&self) -> &[f64] {
        &self.time
    }

    /// Reads a frame with its springs.
    ///
    /// # Errors
    /// If there is no such frame, or its part of the arrays is damaged.
    pub fn frame(&self, index: usize) -> Result<Frame, ReadRunError> {
        let displacements_mm = self.displacements_mm(index)?;
        let topology = self.topology(index)?;
        Ok(Frame { time_s: self.time[index], step: self.step[index], displacements_mm, topology })
    }

    /// Reads the displacements of a frame, RAS+ [mm].
    ///
    /// # Errors
    /// As [`RunReader::frame`].
    pub fn displacements_mm(&self, index: usize) -> Result<Vec<[f32; 3]>, ReadRunError> {
        self.check(index)?;
        let values = self.displacement.read_chunk(index)?;
        Ok(values.as_chunks::<3>().0.to_vec())
    }

    /// The springs as of a frame.
    ///
    /// # Errors
    /// If there is no such frame, or the lists of severed springs are damaged or do not fit the lattice.
    pub fn topology(&self, index: usize) -> Result<Topology, ReadRunError> {
        let severed = self.severed(index)?;
        let path = || self.path.join(ARRAYS).join("severed");
        Topology::replay(&self.lattice, &severed).map_err(|source| ReadRunError::BadSevered { path: path(), source })
    }

    /// Every spring severed up to a frame, in order.
    ///
    /// # Errors
    /// As [`RunReader::topology`].
    pub fn severed(&self, index: usize) -> Result<Vec<SeveredSpring>, ReadRunError> {
        self.check(index)?;
        let folder = self.path.join(ARRAYS).join("severed");
        let count = self.severed_count[index] as usize;
        let particle: Vec<u32> = read_list(folder.join("particle"), count)?;
        let direction: Vec<u8> = read_list(folder.join("direction"), count)?;
        let at: Vec<f32> = read_list(folder.join("at"), count)?;
        let time: Vec<f64> = read_list(folder.join("time"), count)?;
        let spring =
            |n: usize| SeveredSpring { particle: particle[n], direction: direction[n], at: at[n], time: time[n] };
        Ok((0..count).map(spring).collect())
    }

    /// Where blades had gone by a frame, as it lies at rest.
    ///
    /// # Errors
    /// If there is no such frame, or the lists are damaged or do not belong together.
    pub fn cut_sheet(&self, index: usize) -> Result<CutSheet, ReadRunError> {
        self.check(index)?;
        let folder = self.path.join(ARRAYS).join("cuts");
        let inconsistent = |name: &str, message| ReadRunError::Inconsistent { path: folder.join(name), message };
        let (vertex, vertices) = Spec::<f32>::open(folder.join("vertex"))?;
        let (quad, quads) = Spec::<u32>::open(folder.join("quad"))?;
        if vertex.row() != [3] || quad.row() != [4] {
            return Err(inconsistent("quad", format!("rows of {:?}, expected 4 corners", quad.row())));
        }
        let times: Vec<f64> = read_list(folder.join("time"), quads)?;
        let count = times.partition_point(|&time| time <= self.time[index]);
        let vertices = vertex.read(vertices)?.as_chunks::<3>().0.to_vec();
        let quads = quad.read(count)?.as_chunks::<4>().0.to_vec();
        if let Some(at) = quads.iter().position(|quad| quad.iter().any(|&v| v as usize >= vertices.len())) {
            let message = format!("quad {at} is {:?}, but there are {} vertices", quads[at], vertices.len());
            return Err(inconsistent("quad", message));
        }
        Ok(CutSheet { vertices, quads, times: times[..count].to_vec() })
    }

    /// Names of the series, sorted.
    pub fn series_names(&self) -> Vec<String> {
        self.names("series")
    }

    /// Reads a series.
    ///
    /// # Errors
    /// If there is no such series, or it is damaged.
    pub fn series(&self, name: &str) -> Result<Series, ReadRunError> {
        let (spec, rows) = Spec::open(self.member("series", name)?)?;
        Ok(Series { unit: spec.unit_name().unwrap_or_default().to_owned(), values: spec.read(rows)? })
    }

    /// Names of the extra arrays, sorted.
    pub fn extra_names(&self) -> Vec<String> {
        self.names("extra")
    }

    /// Reads an extra array of bytes.
    ///
    /// # Errors
    /// If there is no such array, it holds another kind of number, or it is damaged.
    pub fn extra_u8(&self, name: &str) -> Result<ExtraArray<u8>, ReadRunError> {
        self.extra(name)
    }

    /// Reads an extra array of labels.
    ///
    /// # Errors
    /// As [`RunReader::extra_u8`].
    pub fn extra_u16(&self, name: &str) -> Result<ExtraArray<u16>, ReadRunError> {
        self.extra(name)
    }

    /// Reads an extra array of indices.
    ///
    /// # Errors
    /// As [`RunReader::extra_u8`].
    pub fn extra_u32(&self, name: &str) -> Result<ExtraArray<u32>, ReadRunError> {
        self.extra(name)
    }

    /// Reads an extra array of single-precision values.
    ///
    /// # Errors
    /// As [`RunReader::extra_u8`].
    pub fn extra_f32(&self, name: &str) -> Result<ExtraArray<f32>, ReadRunError> {
        self.extra(name)
    }

    /// Reads an extra array of double-precision values.
    ///
    /// # Errors
    /// As [`RunReader::extra_u8`].
    pub fn extra_f64(&self, name: &str) -> Result<ExtraArray<f64>, ReadRunError> {
        self.extra(name)
    }

    fn extra<T: Number>(&self, name: &str) -> Result<ExtraArray<T>, ReadRunError> {
        let (spec, rows) = Spec::open(self.member("extra", name)?)?;
        Ok(ExtraArray { shape: [&[rows], spec.row()].concat(), values: spec.read(rows)? })
    }

    fn names(&self, group: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path.join(ARRAYS).join(group)).into_iter().flatten().flatten();
        let arrays = entries.filter(|entry| entry.path().join("zarr.json").is_file());
        let mut names: Vec<String> = arrays.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort_unstable();
        names
    }

    fn member(&self, group: &str, name: &str) -> Result<PathBuf, ReadRunError> {
        let path = self.path.join(ARRAYS).join(group).join(name);
        let known = self.names(group);
        // A look-up by listing: a name cannot lead out of the folder.
        if known.iter().any(|k| k == name) { Ok(path) } else { Err(ReadRunError::NoSuchArray { path, known }) }
    }

    fn check(&self, asked: usize) -> Result<(), ReadRunError> {
        let frames = self.frames();
        if asked < frames { Ok(()) } else { Err(ReadRunError::NoSuchFrame { path: self.path.clone(), asked, frames }) }
    }
}

fn read_manifest(path: &Path) -> Result<Manifest, ReadRunError> {
    let json: Value = read_json(path)?;
    let bad = |message: String| ReadRunError::BadJson { path: path.to_path_buf(), message };
    if json["format"] != manifest::FORMAT {
        return Err(bad(format!("format is {}, expected {:?}", json["format"], manifest::FORMAT)));
    }
    // The version first: a newer manifest may have other keys.
    let version = json["format_version"].as_u64().and_then(|v| u32::try_from(v).ok());
    match version {
        Some(manifest::FORMAT_VERSION) => serde_json::from_value(json).map_err(|e| bad(e.to_string())),
        Some(found) => {
            Err(ReadRunError::UnknownVersion { path: path.to_path_buf(), found, known: manifest::FORMAT_VERSION })
        }
        None => Err(bad(format!("format_version is {}, expected a whole number", json["format_version"]))),
    }
}

/// The first `rows` numbers of a list that must have at least so many.
fn read_list<T: Number>(folder: PathBuf, rows: usize) -> Result<Vec<T>, ReadRunError> {
    let (spec, found) = Spec::<T>::open(folder)?;
    if found < rows || !spec.row().is_empty() {
        let message = format!("{found} rows of {:?}, expected at least {rows} numbers", spec.row());
        return Err(ReadRunError::Inconsistent { path: spec.folder().to_path_buf(), message });
    }
    spec.read(rows)
}

fn read_lattice(folder: &Path, manifest: &Manifest) -> Result<Lattice, ReadRunError> {
    let inconsistent = |name: &str, message: String| ReadRunError::Inconsistent { path: folder.join(name), message };
    let dims: Vec<u32> = read_list(folder.join("grid_shape"), 3)?;
    let dims = [0, 1, 2].map(|axis| dims[axis] as usize);
    let points_of_grid = dims.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
    let Some(grid_len) = points_of_grid.filter(|n| (1..=MOST_POINTS).contains(n)) else {
        return Err(inconsistent(
            "grid_shape",
            format!("a grid of {dims:?} points; from 1 to {MOST_POINTS} can be read"),
        ));
    };
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    let (affine, rows) = Spec::<f64>::open(folder.join("affine"))?;
    if rows != 4 || affine.row() != [4] {
        return Err(inconsistent("affine", format!("{rows} rows of {:?}, expected 4 of 4", affine.row())));
    }
    let affine =
        Affine::new(&Matrix4::from_row_slice(&affine.read(4)?)).map_err(|e| inconsistent("affine", e.to_string()))?;
    let pitch = read_list::<f64>(folder.join("pitch"), 1)?[0];
    if !(pitch.is_finite() && pitch > 0.0) {
        return Err(inconsistent("pitch", format!("a pitch of {pitch} m, expected a length")));
    }
    let particles = usize::try_from(manifest.particles).unwrap_or(usize::MAX);
    if particles > grid_len {
        return Err(inconsistent(
            "points",
            format!("{particles} particles in the manifest, but {grid_len} grid points"),
        ));
    }
    let points: Vec<u32> = read_list(folder.join("points"), particles)?;
    let organ: Vec<u8> = read_list(folder.join("organ"), particles)?;
    let springs: Vec<u32> = read_list(folder.join("springs"), particles)?;
    if let Some(at) = points.windows(2).position(|pair| pair[0] >= pair[1]) {
        return Err(inconsistent(
            "points",
            format!("{} after {}, expected an ascending list", points[at + 1], points[at]),
        ));
    }
    if let Some(&last) = points.last().filter(|&&last| last as usize >= grid_len) {
        return Err(inconsistent("points", format!("grid point {last}, but the grid has {grid_len} points")));
    }
    let mut particle_at = vec![NO_PARTICLE; grid_len];
    for (particle, &point) in points.iter().enumerate() {
        particle_at[point as usize] = particle as u32;
    }
    let (cell_organ, cell_fill) = if folder.join("cell_organ").exists() {
        (read_list(folder.join("cell_organ"), particles)?, read_list(folder.join("cell_fill"), particles)?)
    } else {
        (Vec::new(), Vec::new())
    };
    let lattice = Lattice {
        grid: Grid { shape, affine },
        pitch,
        points,
        particle_at,
        organ,
        springs: springs.into(),
        cell_organ,
        cell_fill,
    };
    check_cells(&lattice).map_err(|(name, message)| inconsistent(name, message))?;
    for particle in 0..lattice.len() as u32 {
        let bits = lattice.springs[particle as usize];
        let loose = |direction: usize| match lattice.neighbour(particle, direction) {
            Some(other) => lattice.springs[other as usize] & (1 << opposite(direction)) == 0,
            None => true,
        };
        let found = (0..NEIGHBOURS).find(|&direction| bits & (1 << direction) != 0 && loose(direction));
        if bits & !ALL_ALIVE != 0 || found.is_some() {
            let message = format!("spring bits {bits:#x} of particle {particle} do not match its neighbours'");
            return Err(inconsistent("springs", message));
        }
    }
    Ok(lattice)
}

/// Every cell has eight corners and a share of tissue.
fn check_cells(lattice: &Lattice) -> Result<(), (&'static str, String)> {
    let dims = lattice.grid.shape.dims();
    for (particle, (&organ, &fill)) in (0..).zip(lattice.cell_organ.iter().zip(&lattice.cell_fill)) {
        if organ == NO_ORGAN {
            continue;
        }
        let ijk = lattice.ijk(particle);
        let inside = (0..3).all(|axis| ijk[axis] + 1 < dims[axis]);
        if !inside || lattice.cell(particle).is_none_or(|corners| corners.contains(&NO_PARTICLE)) {
            return Err(("cell_organ", format!("the cell above particle {particle} lacks a corner")));
        }
        if !(0.0..=1.0).contains(&fill) {
            return Err((
                "cell_fill",
                format!("the cell above particle {particle} is filled by {fill}, expected 0 to 1"),
            ));
        }
    }
    Ok(())
}
