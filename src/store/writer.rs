//! Writing a run, frame by frame.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use serde_json::{Value, json};

use super::array::{self, GROWING_ROWS, Growing, Number, Pending, Spec};
use super::error::WriteRunError;
use super::manifest::{self, InputFile, Manifest, Program, Status};
use super::{ARRAYS, codec, place};
use crate::cut::CutSheet;
use crate::lattice::{Lattice, SeveredSpring};
use crate::scene::resolved::Model;

/// What is known before the first frame.
#[derive(Debug, Clone)]
pub struct RunHeader {
    /// The scene as written, kept word for word.
    pub scene_toml: Option<String>,
    /// The scene after checking.
    pub scene_json: Value,
    /// Files the run is computed from.
    pub inputs: Vec<InputFile>,
    /// The law that joins the particles.
    pub model: Model,
    /// Time step [s].
    pub dt_s: f64,
    /// Steps of the whole run.
    pub steps: u64,
}

/// Values of an extra array, x fastest as everything else.
#[derive(Debug, Clone, Copy)]
pub enum ExtraValues<'a> {
    /// Bytes.
    U8(&'a [u8]),
    /// Labels.
    U16(&'a [u16]),
    /// Indices.
    U32(&'a [u32]),
    /// Measured or computed values.
    F32(&'a [f32]),
    /// Values that judge.
    F64(&'a [f64]),
}

/// An array to keep with the lattice, for example the field its surface is drawn from.
#[derive(Debug, Clone)]
pub struct Extra<'a> {
    /// Its name: 1 to 64 of a-z, 0-9 and _.
    pub name: String,
    /// What it means.
    pub description: String,
    /// Unit of its values, `1` when they have none.
    pub unit: String,
    /// Length of each axis, slowest first; at least one axis, none empty.
    pub shape: Vec<usize>,
    /// Its values.
    pub values: ExtraValues<'a>,
}

/// One frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameData<'a> {
    /// Simulated time [s].
    pub time_s: f64,
    /// Steps taken since the start.
    pub step: u64,
    /// Displacement of each particle from rest, RAS+ [mm].
    pub displacements_mm: &'a [[f32; 3]],
    /// Every spring severed so far, in order: what [`crate::lattice::Topology::severed`] gives.
    pub severed: &'a [SeveredSpring],
}

/// A run being written.
#[derive(Debug)]
pub struct RunWriter {
    path: PathBuf,
    manifest: Manifest,
    log: File,
    particles: usize,
    arrays: Arrays,
    series: BTreeMap<String, Growing<f64>>,
    /// Chunks of frames that are not on disk yet, by path: a list that grew twice is written once.
    staged: BTreeMap<PathBuf, Vec<u8>>,
    staged_bytes: usize,
    committed: Instant,
}

/// Frames are written together when the first of them has waited this long: making files durable can take longer than
/// computing them.
const COMMIT_INTERVAL: Duration = Duration::from_millis(500);
/// Or when they take this much memory [bytes].
const MOST_STAGED: usize = 64 << 20;

impl RunWriter {
    /// Says early, before a run is prepared, whether [`RunWriter::create`] would refuse `path`. Nothing is written.
    ///
    /// # Errors
    /// If the path holds something that may not be replaced, or is not a folder.
    pub fn check_place(path: &Path, overwrite: bool) -> Result<(), WriteRunError> {
        // A link to a folder stands for the folder.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        place::check(&path, overwrite).map(drop)
    }

    /// Begins a run at `path`, which appears whole with the lattice and no frames.
    ///
    /// A path that holds something is refused, unless `overwrite` is set and it is a run with nothing else in it; the old
    /// run is replaced only when the new one is ready to begin.
    ///
    /// # Errors
    /// If the path cannot be used, the disk is full, or an extra array has a bad name or length.
    pub fn create(
        path: &Path,
        header: RunHeader,
        lattice: &Lattice,
        extras: &[Extra<'_>],
        overwrite: bool,
    ) -> Result<Self, WriteRunError> {
        // A link to a folder stands for the folder.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        let occupied = place::check(&path, overwrite)?;
        let most = codec::MOST_BYTES / size_of::<[f32; 3]>();
        if lattice.len() > most {
            return Err(WriteRunError::TooManyParticles { particles: lattice.len(), most });
        }
        if lattice.is_empty() {
            return Err(WriteRunError::WrongLength { name: "lattice: particles".into(), found: 0, expected: 1 });
        }
        let building = place::beside(&path)?;
        let at = building.path();
        let manifest = first_manifest(&header, lattice);
        let mut files = vec![
            (at.join("manifest.json"), array::pretty(&manifest)),
            (at.join("scene.json"), array::pretty(&header.scene_json)),
            (at.join("log.txt"), Vec::new()),
        ];
        files.extend(header.scene_toml.map(|text| (at.join("scene.toml"), text.into_bytes())));
        let root = at.join(ARRAYS);
        files.push(array::group(&root, json!({ "format": manifest::FORMAT, "space": "RAS+" })));
        files.extend(
            ["lattice", "extra", "frames", "severed", "cuts", "series"]
                .map(|name| array::group(&root.join(name), json!({}))),
        );
        files.extend(lattice_files(&root.join("lattice"), lattice));
        for extra in extras {
            files.extend(extra_files(&root.join("extra"), extra)?);
        }
        let empty = Arrays::new(&root, lattice.len());
        files.extend(empty.lists());
        files.push(empty.displacement.metadata(0));
        array::write_all(&files)?;
        place::install(building, &path, occupied)?;
        let log_path = path.join("log.txt");
        let log = File::options().append(true).open(&log_path).map_err(|e| WriteRunError::io(&log_path, e))?;
        let arrays = Arrays::new(&path.join(ARRAYS), lattice.len());
        Ok(Self {
            path,
            manifest,
            log,
            particles: lattice.len(),
            arrays,
            series: BTreeMap::new(),
            staged: BTreeMap::new(),
            staged_bytes: 0,
            committed: Instant::now(),
        })
    }

    /// The run directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The manifest as it stands.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Number of frames added.
    pub fn frames(&self) -> usize {
        self.arrays.time.rows()
    }

    /// Adds a frame. It counts from the next [`RunWriter::commit`], which follows by itself within half a second of frames;
    /// after an error or a crash the frames committed before are as they were.
    ///
    /// After an error the writer should be given up: its lists may be ahead of the disk.
    ///
    /// # Errors
    /// If the data does not fit the lattice or the frame before, is not finite, or cannot be written.
    pub fn push_frame(&mut self, frame: FrameData<'_>) -> Result<(), WriteRunError> {
        let number = self.frames();
        let FrameData { displacements_mm, severed, .. } = frame;
        if displacements_mm.len() != self.particles {
            let (found, expected) = (displacements_mm.len(), self.particles);
            return Err(WriteRunError::WrongLength { name: format!("frame {number}: displacements"), found, expected });
        }
        check_finite(number, displacements_mm)?;
        let before = self.arrays.severed.particle.rows();
        if severed.len() < before || before.checked_sub(1).map(|last| severed[last]) != self.arrays.severed.last {
            return Err(WriteRunError::SeveredChanged { frame: number, found: severed.len(), before });
        }
        let arrays = &mut self.arrays;
        let mut chunks = vec![arrays.displacement.chunk(number, bytemuck::cast_slice(displacements_mm))];
        chunks.extend(arrays.severed.append(&severed[before..]));
        chunks.extend(arrays.time.append(&[frame.time_s]));
        chunks.extend(arrays.step.append(&[frame.step]));
        chunks.extend(arrays.severed_count.append(&[severed.len() as u64]));
        self.stage(chunks);
        if self.committed.elapsed() >= COMMIT_INTERVAL || self.staged_bytes >= MOST_STAGED {
            self.commit()
        } else {
            Ok(())
        }
    }

    /// Adds what a sheet has gained since it was last given, for the frames to come.
    ///
    /// # Errors
    /// If it is shorter than before, or a vertex is not finite.
    pub fn push_cuts(&mut self, sheet: &CutSheet) -> Result<(), WriteRunError> {
        let lists = &self.arrays.cuts;
        let (vertices, quads) = (lists.vertex.rows(), lists.quad.rows());
        if sheet.vertices.len() < vertices || sheet.quads.len() < quads {
            return Err(WriteRunError::SheetChanged { found: sheet.quads.len(), before: quads });
        }
        if let Some(vertex) = sheet.vertices[vertices..].iter().position(|v| v.iter().any(|c| !c.is_finite())) {
            return Err(WriteRunError::SheetNotFinite { vertex: vertices + vertex });
        }
        let chunks = self.arrays.cuts.append(sheet);
        self.stage(chunks);
        Ok(())
    }

    fn stage(&mut self, chunks: Vec<Pending>) {
        for (path, bytes) in chunks {
            self.staged_bytes += bytes.len();
            self.staged.insert(path, bytes);
        }
    }

    /// Makes all frames added so far durable.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn commit(&mut self) -> Result<(), WriteRunError> {
        self.committed = Instant::now();
        if self.staged.is_empty() {
            return Ok(());
        }
        // First what the frames hold, then how long the lists are, then the length of `displacement`, which makes them count.
        let chunks: Vec<Pending> = std::mem::take(&mut self.staged).into_iter().collect();
        self.staged_bytes = 0;
        array::write_all(&chunks)?;
        array::write_all(&self.arrays.lists())?;
        let frames = self.frames();
        array::write_all(&[self.arrays.displacement.metadata(frames)])?;
        self.manifest.frames = frames as u64;
        self.write_manifest()
    }

    /// Appends values to a named series, which begins with the first call.
    ///
    /// # Errors
    /// If the name cannot be used, the unit changed, a value is not finite, or the values cannot be written.
    pub fn push_series(&mut self, name: &str, unit: &str, values: &[f64]) -> Result<(), WriteRunError> {
        check_name(name)?;
        if let Some(at) = values.iter().position(|value| !value.is_finite()) {
            let row = self.series.get(name).map_or(0, Growing::rows) + at;
            return Err(WriteRunError::SeriesNotFinite { name: name.to_owned(), row, value: values[at] });
        }
        let folder = self.path.join(ARRAYS).join("series").join(name);
        let series = self
            .series
            .entry(name.to_owned())
            .or_insert_with(|| Growing::new(Spec::new(folder, &[], GROWING_ROWS, &["sample"]).unit(unit)));
        let before = series.spec().unit_name().unwrap_or_default();
        if before != unit {
            let (name, before, found) = (name.to_owned(), before.to_owned(), unit.to_owned());
            return Err(WriteRunError::UnitChanged { name, before, found });
        }
        array::write_all(&series.append(values))?;
        array::write_all(&[series.metadata()])
    }

    /// Appends a line to `log.txt`; line breaks inside become spaces.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn log(&mut self, line: &str) -> Result<(), WriteRunError> {
        let mut line = line.replace(['\n', '\r'], " ");
        line.push('\n');
        // One call, so that a line is torn only when the disk tears it.
        self.log.write_all(line.as_bytes()).map_err(|e| WriteRunError::io(&self.path.join("log.txt"), e))
    }

    /// Writes the last frames and the last status of the run.
    ///
    /// # Errors
    /// If the frames, the log or the manifest cannot be written.
    pub fn finish(mut self, status: Status) -> Result<(), WriteRunError> {
        self.commit()?;
        self.log.sync_all().map_err(|e| WriteRunError::io(&self.path.join("log.txt"), e))?;
        self.manifest.status = status;
        self.write_manifest()
    }

    fn write_manifest(&self) -> Result<(), WriteRunError> {
        array::write_all(&[(self.path.join("manifest.json"), array::pretty(&self.manifest))])
    }
}

/// Refuses a frame that no reader would take.
pub(super) fn check_finite(frame: usize, displacements_mm: &[[f32; 3]]) -> Result<(), WriteRunError> {
    match displacements_mm.iter().position(|u| u.iter().any(|v| !v.is_finite())) {
        Some(particle) => Err(WriteRunError::NotFinite { frame, particle }),
        None => Ok(()),
    }
}

/// A run that is given up, as after an error of its caller, keeps the frames it was handed.
impl Drop for RunWriter {
    fn drop(&mut self) {
        // Nobody is left to hear of an error; the frames committed before are safe.
        let _ = self.commit();
    }
}

/// Everything that grows with the frames.
#[derive(Debug)]
struct Arrays {
    displacement: Spec<f32>,
    time: Growing<f64>,
    step: Growing<u64>,
    severed_count: Growing<u64>,
    severed: Severed,
    cuts: Cuts,
}

/// The three lists of a cut sheet.
#[derive(Debug)]
struct Cuts {
    vertex: Growing<f32>,
    quad: Growing<u32>,
    time: Growing<f64>,
}

/// The four lists of severed springs.
#[derive(Debug)]
struct Severed {
    particle: Growing<u32>,
    direction: Growing<u8>,
    at: Growing<f32>,
    time: Growing<f64>,
    /// The last spring of the frame before.
    last: Option<SeveredSpring>,
}

fn list<T: Number>(folder: PathBuf, dimension: &'static str, unit: &str, about: &str) -> Growing<T> {
    Growing::new(Spec::new(folder, &[], GROWING_ROWS, &[dimension]).unit(unit).about(about))
}

impl Arrays {
    fn new(root: &Path, particles: usize) -> Self {
        let frames = root.join("frames");
        let severed = root.join("severed");
        Self {
            displacement: Spec::new(frames.join("displacement"), &[particles, 3], 1, &["frame", "particle", "axis"])
                .unit("mm")
                .about("displacement from rest along RAS+"),
            time: list(frames.join("time"), "frame", "s", "simulated time"),
            step: list(frames.join("step"), "frame", "1", "steps taken since the start"),
            severed_count: list(frames.join("severed_count"), "frame", "1", "springs severed so far"),
            severed: Severed {
                particle: list(severed.join("particle"), "spring", "1", "the end with the lower particle number"),
                direction: list(severed.join("direction"), "spring", "1", "direction 13 to 25 from that end"),
                at: list(
                    severed.join("at"),
                    "spring",
                    "1",
                    "where the blade crossed: 0 at the particle, 1 at the other end",
                ),
                time: list(severed.join("time"), "spring", "s", "when it was severed"),
                last: None,
            },
            cuts: Cuts::new(&root.join("cuts")),
        }
    }

    /// `zarr.json` of every list.
    fn lists(&self) -> Vec<Pending> {
        let severed = &self.severed;
        vec![
            severed.particle.metadata(),
            severed.direction.metadata(),
            severed.at.metadata(),
            severed.time.metadata(),
            self.time.metadata(),
            self.step.metadata(),
            self.severed_count.metadata(),
            self.cuts.vertex.metadata(),
            self.cuts.quad.metadata(),
            self.cuts.time.metadata(),
        ]
    }
}

impl Cuts {
    fn new(folder: &Path) -> Self {
        let vertex = Spec::new(folder.join("vertex"), &[3], GROWING_ROWS, &["vertex", "axis"]);
        let vertex = vertex.unit("mm").about("where a blade went, at rest, RAS+");
        let quad = Spec::new(folder.join("quad"), &[4], GROWING_ROWS, &["quad", "corner"]);
        let quad = quad.unit("1").about("corners, in order round it");
        let time = list(folder.join("time"), "quad", "s", "when the blade had passed it");
        Self { vertex: Growing::new(vertex), quad: Growing::new(quad), time }
    }

    fn append(&mut self, sheet: &CutSheet) -> Vec<Pending> {
        let (vertices, quads) = (self.vertex.rows(), self.quad.rows());
        let mut files = self.vertex.append(bytemuck::cast_slice(&sheet.vertices[vertices..]));
        files.extend(self.quad.append(bytemuck::cast_slice(&sheet.quads[quads..])));
        files.extend(self.time.append(&sheet.times[quads..]));
        files
    }
}

impl Severed {
    fn append(&mut self, springs: &[SeveredSpring]) -> Vec<Pending> {
        fn column<T>(springs: &[SeveredSpring], of: impl Fn(&SeveredSpring) -> T) -> Vec<T> {
            springs.iter().map(of).collect()
        }
        let mut files = self.particle.append(&column(springs, |s| s.particle));
        files.extend(self.direction.append(&column(springs, |s| s.direction)));
        files.extend(self.at.append(&column(springs, |s| s.at)));
        files.extend(self.time.append(&column(springs, |s| s.time)));
        self.last = springs.last().copied().or(self.last);
        files
    }
}

fn first_manifest(header: &RunHeader, lattice: &Lattice) -> Manifest {
    Manifest {
        format: manifest::FORMAT.into(),
        format_version: manifest::FORMAT_VERSION,
        program: Program { name: env!("CARGO_PKG_NAME").into(), version: env!("CARGO_PKG_VERSION").into() },
        created: manifest::rfc3339(SystemTime::now()),
        inputs: header.inputs.clone(),
        model: match header.model {
            Model::Paper => "paper",
            Model::Tissue => "tissue",
        }
        .into(),
        pitch_m: lattice.pitch,
        particles: lattice.len() as u64,
        springs: lattice.spring_count() as u64,
        dt_s: header.dt_s,
        steps: header.steps,
        status: Status::Running,
        frames: 0,
    }
}

/// The rest state. `ijk` and `rest` follow from the others; they are there for programs that read without our code.
fn lattice_files(folder: &Path, lattice: &Lattice) -> Vec<Pending> {
    let particles = 0..lattice.len() as u32;
    let shape = lattice.grid.shape.dims().map(|n| n as u32);
    let ijk: Vec<i32> = particles.clone().flat_map(|p| lattice.ijk(p).map(|i| i as i32)).collect();
    let rest: Vec<f64> = particles.flat_map(|p| <[f64; 3]>::from(lattice.rest_place(p))).collect();
    // nalgebra keeps columns together; the file keeps rows.
    let affine: Vec<f64> = lattice.grid.affine.matrix().transpose().iter().copied().collect();
    let spec = |name: &str| folder.join(name);
    let per_particle = ["particle"];
    let cells = if lattice.has_cells() {
        let organ = "organ of the cell above the particle, towards +i, +j, +k; 255 where there is none";
        [
            whole(spec("cell_organ"), &[], &per_particle, "1", organ, &lattice.cell_organ),
            whole(spec("cell_fill"), &[], &per_particle, "1", "how much of that cell is tissue", &lattice.cell_fill),
        ]
        .concat()
    } else {
        Vec::new()
    };
    [
        whole(spec("grid_shape"), &[], &["axis"], "1", "grid points along i, j, k", &shape),
        whole(spec("affine"), &[4], &["row", "column"], "mm", "index (i, j, k, 1) to RAS+", &affine),
        whole(spec("pitch"), &[], &["value"], "m", "distance of neighbouring particles", &[lattice.pitch]),
        whole(spec("points"), &[], &per_particle, "1", "linear grid index, i fastest", &lattice.points),
        whole(spec("ijk"), &[3], &["particle", "axis"], "1", "grid index", &ijk),
        whole(spec("rest"), &[3], &["particle", "axis"], "mm", "rest place, RAS+", &rest),
        whole(
            spec("organ"),
            &[],
            &per_particle,
            "1",
            "organ of the scene; 255 beyond the border drawn",
            &lattice.organ,
        ),
        whole(spec("springs"), &[], &per_particle, "1", "springs at rest, one bit per direction", &lattice.springs),
        cells,
    ]
    .concat()
}

fn whole<T: Number>(
    folder: PathBuf,
    row: &[usize],
    dimensions: &[&'static str],
    unit: &str,
    about: &str,
    values: &[T],
) -> Vec<Pending> {
    let rows = values.len() / row.iter().product::<usize>();
    Spec::new(folder, row, rows, dimensions).unit(unit).about(about).whole(values)
}

fn extra_files(folder: &Path, extra: &Extra<'_>) -> Result<Vec<Pending>, WriteRunError> {
    const AXES: [&str; 8] = ["axis_0", "axis_1", "axis_2", "axis_3", "axis_4", "axis_5", "axis_6", "axis_7"];
    check_name(&extra.name)?;
    let found = match extra.values {
        ExtraValues::U8(v) => v.len(),
        ExtraValues::U16(v) => v.len(),
        ExtraValues::U32(v) => v.len(),
        ExtraValues::F32(v) => v.len(),
        ExtraValues::F64(v) => v.len(),
    };
    let expected = extra.shape.iter().product::<usize>();
    if found != expected || found == 0 || !(1..=AXES.len()).contains(&extra.shape.len()) {
        let name = format!("extra array {:?} of shape {:?}", extra.name, extra.shape);
        return Err(WriteRunError::WrongLength { name, found, expected });
    }
    let (folder, row, axes) = (folder.join(&extra.name), &extra.shape[1..], &AXES[..extra.shape.len()]);
    let (unit, about) = (&extra.unit, &extra.description);
    Ok(match extra.values {
        ExtraValues::U8(v) => whole(folder, row, axes, unit, about, v),
        ExtraValues::U16(v) => whole(folder, row, axes, unit, about, v),
        ExtraValues::U32(v) => whole(folder, row, axes, unit, about, v),
        ExtraValues::F32(v) => whole(folder, row, axes, unit, about, v),
        ExtraValues::F64(v) => whole(folder, row, axes, unit, about, v),
    })
}

fn check_name(name: &str) -> Result<(), WriteRunError> {
    let fine = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'_';
    if (1..=64).contains(&name.len()) && name.bytes().all(fine) {
        Ok(())
    } else {
        Err(WriteRunError::BadName { name: name.to_owned() })
    }
}
