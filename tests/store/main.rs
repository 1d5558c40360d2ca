//! Run directories: round trip, interruption, overwriting, damage.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;
use yawara::cut::CutSheet;
use yawara::geometry::{Affine, Grid, GridShape, Matrix3, Vector3};
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
use yawara::lattice::{Lattice, NO_PARTICLE, SeveredSpring, Topology};
use yawara::scene::resolved::Model;
use yawara::store::{
    BackgroundWriter, Extra, ExtraValues, FrameData, InputFile, ReadRunError, RunHeader, RunReader, RunWriter, Status,
    WriteRunError,
};

/// A block with some points missing, all springs between neighbours, on an oblique grid.
fn lattice(dims: [usize; 3]) -> Lattice {
    let turn = nalgebra::Rotation3::from_euler_angles(0.1, -0.2, 0.3).into_inner();
    let affine = Affine::from_parts(turn * Matrix3::identity() * 3.0, Vector3::new(-17.3, 20.1, 3.7)).unwrap();
    let grid = Grid { shape: GridShape::new(dims[0], dims[1], dims[2]), affine };
    let points: Vec<u32> = (0..grid.shape.len() as u32).filter(|p| p % 7 != 3).collect();
    let mut particle_at = vec![NO_PARTICLE; grid.shape.len()];
    for (particle, &point) in points.iter().enumerate() {
        particle_at[point as usize] = particle as u32;
    }
    let organ = points.iter().map(|p| (p % 3) as u8).collect();
    let springs = vec![0; points.len()];
    let mut lattice = Lattice {
        grid,
        pitch: 0.003,
        points,
        particle_at,
        organ,
        springs: std::sync::Arc::new(springs),
        cell_organ: Vec::new(),
        cell_fill: Vec::new(),
    };
    for particle in 0..lattice.len() as u32 {
        let bits = (0..NEIGHBOURS).filter(|&d| lattice.neighbour(particle, d).is_some()).map(|d| 1 << d).sum();
        std::sync::Arc::make_mut(&mut lattice.springs)[particle as usize] = bits;
    }
    lattice
}

/// The first `count` springs of the lattice, as a blade would list them.
fn springs(lattice: &Lattice, count: usize) -> Vec<SeveredSpring> {
    let all = (0..lattice.len() as u32).flat_map(|p| (FIRST_FORWARD..NEIGHBOURS).map(move |d| (p, d)));
    all.filter(|&(p, d)| lattice.springs[p as usize] & (1 << d) != 0)
        .take(count)
        .enumerate()
        .map(|(n, (particle, direction))| SeveredSpring {
            particle,
            direction: direction as u8,
            at: 0.02 + 0.001 * (n % 900) as f32,
            time: 0.01 * n as f64,
        })
        .collect()
}

fn displacements(lattice: &Lattice, frame: usize) -> Vec<[f32; 3]> {
    let wave = |p: usize, axis: usize| ((p + 31 * axis) as f32 * 0.01 + frame as f32).sin() * frame as f32;
    (0..lattice.len()).map(|p| [wave(p, 0), wave(p, 1), wave(p, 2)]).collect()
}

fn header() -> RunHeader {
    RunHeader {
        scene_toml: Some("# a scene\n[time]\nduration = 0.4\n".into()),
        scene_json: json!({ "time": { "duration": 0.4 }, "organs": [] }),
        inputs: vec![InputFile { path: "ct.nii.gz".into(), bytes: 12, sha256: "00ff".into() }],
        model: Model::Tissue,
        dt_s: 1e-4,
        steps: 25,
    }
}

/// Springs severed up to each frame of [`write`].
const SEVERED: [usize; 4] = [0, 0, 40, 57];

fn push(writer: &mut RunWriter, lattice: &Lattice, frame: usize) -> Result<(), WriteRunError> {
    let (severed, displacements) = (springs(lattice, SEVERED[frame]), displacements(lattice, frame));
    writer.push_frame(FrameData {
        time_s: 0.1 * frame as f64,
        step: 25 * frame as u64,
        displacements_mm: &displacements,
        severed: &severed,
    })?;
    writer.commit()
}

fn write(path: &Path, lattice: &Lattice) -> RunWriter {
    let field: Vec<f32> = (0..lattice.grid.shape.len()).map(|p| p as f32 * 0.5).collect();
    let dims = lattice.grid.shape.dims();
    let extra = Extra {
        name: "surface_field".into(),
        description: "field whose zero is the surface".into(),
        unit: "HU".into(),
        shape: vec![dims[2], dims[1], dims[0]],
        values: ExtraValues::F32(&field),
    };
    let mut writer = RunWriter::create(path, header(), lattice, &[extra], false).unwrap();
    for frame in 0..SEVERED.len() {
        push(&mut writer, lattice, frame).unwrap();
        writer.push_series("volume_by_cells", "mL", &[1.0 + frame as f64, 2.0 + frame as f64]).unwrap();
        writer.log(&format!("frame {frame}\nwritten")).unwrap();
    }
    writer
}

fn assert_frame(reader: &RunReader, lattice: &Lattice, frame: usize) {
    let read = reader.frame(frame).unwrap();
    assert_eq!(read.displacements_mm, displacements(lattice, frame));
    assert_eq!((read.time_s, read.step), (0.1 * frame as f64, 25 * frame as u64));
    let expected = Topology::replay(lattice, &springs(lattice, SEVERED[frame])).unwrap();
    assert_eq!(read.topology.alive(), expected.alive());
    assert_eq!(read.topology.severed(), expected.severed());
}

/// Every file below a folder with its bytes.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(at) = folders.pop() {
        for entry in fs::read_dir(&at).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(folder).unwrap().to_path_buf(), fs::read(&path).unwrap());
            }
        }
    }
    files
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a/run");
    let lattice = lattice([6, 5, 4]);
    write(&path, &lattice).finish(Status::Complete).unwrap();
    let reader = RunReader::open(&path).unwrap();
    assert_eq!(reader.frames(), 4);
    assert_eq!(reader.warning(), None);
    let read = reader.lattice();
    assert_eq!(read.grid, lattice.grid, "bit for bit");
    assert_eq!(read.pitch.to_bits(), lattice.pitch.to_bits());
    assert_eq!((&read.points, &read.particle_at), (&lattice.points, &lattice.particle_at));
    assert_eq!((&read.organ, &read.springs), (&lattice.organ, &lattice.springs));
    for frame in 0..4 {
        assert_frame(&reader, &lattice, frame);
    }
    assert_eq!(reader.series_names(), ["volume_by_cells"]);
    let series = reader.series("volume_by_cells").unwrap();
    assert_eq!(series.values, [1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0]);
    assert_eq!(series.unit, "mL");
    let field = reader.extra_f32("surface_field").unwrap();
    assert_eq!((field.shape, field.values[3]), (vec![4, 5, 6], 1.5));
    assert_eq!(reader.scene(), &header().scene_json);
    assert_eq!(reader.scene_toml().unwrap(), header().scene_toml);
    assert_eq!(reader.log().unwrap(), "frame 0 written\nframe 1 written\nframe 2 written\nframe 3 written\n");
    let manifest = reader.manifest();
    assert_eq!((manifest.frames, manifest.particles), (4, lattice.len() as u64));
    assert_eq!((manifest.springs, manifest.inputs.len()), (lattice.spring_count() as u64, 1));
    let left: Vec<_> = fs::read_dir(folder.path().join("a")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["run"], "nothing temporary is left");
}

#[test]
fn frames_count_once_committed_and_at_the_latest_when_the_writer_goes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let lattice = lattice([4, 4, 4]);
    let still = vec![[0.0; 3]; lattice.len()];
    let frame = |time_s| FrameData { time_s, step: 0, displacements_mm: &still, severed: &[] };
    let mut writer = RunWriter::create(&path, header(), &lattice, &[], false).unwrap();
    for number in 0..3 {
        writer.push_frame(frame(f64::from(number))).unwrap();
    }
    writer.commit().unwrap();
    assert_eq!(RunReader::open(&path).unwrap().frames(), 3);
    writer.push_frame(frame(3.0)).unwrap();
    drop(writer);
    let reader = RunReader::open(&path).unwrap();
    assert_eq!(reader.times(), [0.0, 1.0, 2.0, 3.0]);
    assert!(reader.warning().is_some(), "nobody said that the run was complete");
}

#[test]
fn lists_longer_than_a_chunk_survive() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let lattice = lattice([20, 12, 12]);
    let all = springs(&lattice, 20_000);
    assert_eq!(all.len(), 20_000);
    let mut writer = RunWriter::create(&path, header(), &lattice, &[], false).unwrap();
    let still = vec![[0.0; 3]; lattice.len()];
    let counts = [0, 1, 8191, 8192, 8193, 20_000];
    for (frame, &count) in counts.iter().enumerate() {
        let severed = &all[..count];
        writer.push_frame(FrameData { time_s: frame as f64, step: 1, displacements_mm: &still, severed }).unwrap();
        writer.commit().unwrap();
    }
    let reader = RunReader::open(&path).unwrap();
    for (frame, &count) in counts.iter().enumerate() {
        assert_eq!(reader.severed(frame).unwrap(), all[..count], "frame {frame}");
    }
}

#[test]
fn same_input_same_bytes_but_for_the_date() {
    let folder = tempfile::tempdir().unwrap();
    let lattice = lattice([6, 5, 4]);
    let trees = [1, 3].map(|threads| {
        let path = folder.path().join(format!("run{threads}"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write(&path, &lattice).finish(Status::Complete).unwrap());
        let mut files = tree(&path);
        let manifest = String::from_utf8(files.remove(Path::new("manifest.json")).unwrap()).unwrap();
        let dateless: Vec<String> =
            manifest.lines().filter(|l| !l.contains("\"created\"")).map(str::to_owned).collect();
        assert_eq!(dateless.len() + 1, manifest.lines().count());
        (files, dateless)
    });
    assert!(trees[0].0.len() > 30, "{} files", trees[0].0.len());
    assert_eq!(trees[0], trees[1]);
}

/// A crash leaves the files as they were after some number of renames: replay every such moment of the last frame.
#[test]
fn a_thread_of_its_own_writes_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let lattice = lattice([6, 5, 4]);
    let mut sheet = CutSheet::default();
    let written = |name: &str| {
        let mut files = tree(&folder.path().join(name));
        // Two dates.
        files.remove(Path::new("manifest.json")).unwrap();
        files
    };
    let begin = |name: &str| RunWriter::create(&folder.path().join(name), header(), &lattice, &[], false).unwrap();
    let (mut plain, mut background) = (begin("plain"), BackgroundWriter::new(begin("background")).unwrap());
    for frame in 0..SEVERED.len() {
        if frame == 2 {
            sheet.vertices.extend([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
            sheet.quads.push([0, 1, 2, 3]);
            sheet.times.push(0.2);
        }
        let severed = springs(&lattice, SEVERED[frame]);
        plain.push_cuts(&sheet).unwrap();
        push(&mut plain, &lattice, frame).unwrap();
        plain.push_series("volume", "mL", &[frame as f64]).unwrap();
        plain.log("a line").unwrap();
        background.push_cuts(&sheet).unwrap();
        let moved = displacements(&lattice, frame);
        background.push_frame((0.1 * frame as f64, 25 * frame as u64), moved, &severed).unwrap();
        background.push_series("volume".to_owned(), "mL", vec![frame as f64]).unwrap();
        background.log("a line").unwrap();
    }
    // What no reader would take is refused at once, and the run goes on.
    let endless = vec![[f32::INFINITY; 3]; lattice.len()];
    let refused = background.push_frame((0.4, 100), endless, &springs(&lattice, SEVERED[3])).unwrap_err();
    assert!(matches!(refused, WriteRunError::NotFinite { frame: 4, particle: 0 }));
    plain.finish(Status::Complete).unwrap();
    background.finish(Status::Complete).unwrap();
    assert_eq!(written("plain"), written("background"));
    assert_eq!(RunReader::open(&folder.path().join("background")).unwrap().frames(), 4);
}

#[test]
fn what_a_thread_of_its_own_cannot_write_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (path, lattice) = (folder.path().join("run"), lattice([6, 5, 4]));
    let writer = RunWriter::create(&path, header(), &lattice, &[], false).unwrap();
    let mut background = BackgroundWriter::new(writer).unwrap();
    fs::remove_dir_all(&path).unwrap();
    fs::write(&path, "in the way").unwrap();
    // By the first call after the disk has answered, once.
    let mut push = || background.push_series("volume".to_owned(), "mL", vec![1.0]);
    let error = (0..1000).find_map(|_| push().err()).expect("nothing can be written");
    assert!(error.to_string().contains("run"), "{error}");
    push().unwrap();
    let error = background.finish(Status::Complete).unwrap_err();
    assert!(matches!(error, WriteRunError::GivenUp { .. }), "{error}");
}

#[test]
fn a_run_cut_short_at_any_file_keeps_the_frames_before() {
    let folder = tempfile::tempdir().unwrap();
    let lattice = lattice([6, 5, 4]);
    let path = folder.path().join("run");
    let mut writer = RunWriter::create(&path, header(), &lattice, &[], false).unwrap();
    for frame in 0..3 {
        push(&mut writer, &lattice, frame).unwrap();
    }
    let before = tree(&path);
    push(&mut writer, &lattice, 3).unwrap();
    let after = tree(&path);
    let changed: Vec<&PathBuf> = after.keys().filter(|p| before.get(*p) != after.get(*p)).collect();
    let index = Path::new("arrays.zarr/frames/displacement/zarr.json");
    let stage = |p: &Path| match p {
        p if p == Path::new("manifest.json") => 3,
        p if p == index => 2,
        p if p.ends_with("zarr.json") => 1,
        _ => 0,
    };
    // 1 displacement, 4 + 3 lists, their 7 lengths, the index, the manifest.
    assert_eq!(changed.len(), 17, "{changed:?}");
    let mut moments = 0;
    for done in 0..=3 {
        let within: Vec<&PathBuf> = changed.iter().copied().filter(|p| stage(p) == done).collect();
        // Files of one stage are renamed in any order: none, one at a time, all but one, all.
        let none_and_all = [Vec::new(), within.clone()];
        let each = within.iter().map(|&p| vec![p]);
        let but_one = within.iter().map(|&p| within.iter().copied().filter(|&q| q != p).collect());
        for subset in none_and_all.into_iter().chain(each).chain(but_one) {
            let copy = folder.path().join("copy");
            for (name, bytes) in &before {
                let file = copy.join(name);
                fs::create_dir_all(file.parent().unwrap()).unwrap();
                fs::write(file, bytes).unwrap();
            }
            for name in changed.iter().filter(|p| stage(p) < done).chain(&subset) {
                fs::write(copy.join(name), &after[*name]).unwrap();
            }
            // And a temporary file that never got its name.
            fs::write(copy.join("arrays.zarr/frames/displacement/.yawara-x.part"), "torn").unwrap();
            let reader = RunReader::open(&copy).unwrap();
            let whole = done == 3 || (done == 2 && !subset.is_empty());
            assert_eq!(reader.frames(), if whole { 4 } else { 3 }, "after {subset:?}");
            for frame in 0..reader.frames() {
                assert_frame(&reader, &lattice, frame);
            }
            assert!(reader.warning().unwrap().contains("interrupted"));
            fs::remove_dir_all(&copy).unwrap();
            moments += 1;
        }
    }
    assert_eq!(moments, 4 * 2 + 17 * 2);
}

#[test]
fn damage_is_found_named_and_kept_to_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    let lattice = lattice([6, 5, 4]);
    let path = folder.path().join("run");
    write(&path, &lattice).finish(Status::Complete).unwrap();
    let chunk = path.join("arrays.zarr/frames/displacement/c.2.0.0");
    let whole = fs::read(&chunk).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 0x10;
    let reader = RunReader::open(&path).unwrap();
    for (bytes, word) in
        [(Some(&flipped[..]), "CRC-32C"), (Some(&whole[..whole.len() / 2]), "CRC-32C"), (None, "missing")]
    {
        match bytes {
            Some(bytes) => fs::write(&chunk, bytes).unwrap(),
            None => fs::remove_file(&chunk).unwrap(),
        }
        let error = reader.frame(2).unwrap_err();
        assert!(matches!(&error, ReadRunError::Damaged { path, .. } if *path == chunk), "{error}");
        let text = error.to_string();
        assert!(text.contains("c.2.0.0") && text.contains(word) && text.contains("other frame"), "{text}");
        for frame in [0, 1, 3] {
            assert_frame(&reader, &lattice, frame);
        }
    }
    fs::write(&chunk, &whole).unwrap();
    assert_frame(&reader, &lattice, 2);
    // The lists of severed springs: frames before the first cut do not need them.
    fs::remove_file(path.join("arrays.zarr/severed/at/c.0")).unwrap();
    assert_frame(&reader, &lattice, 1);
    assert!(reader.topology(2).unwrap_err().to_string().contains("severed/at/c.0"));
    assert_eq!(reader.displacements_mm(2).unwrap(), displacements(&lattice, 2));
    let error = reader.frame(4).unwrap_err().to_string();
    assert!(error.contains("frame 4") && error.contains("has 4"), "{error}");
    let error = reader.series("energy").unwrap_err().to_string();
    assert!(error.contains("energy") && error.contains("volume_by_cells"), "{error}");
    assert!(reader.extra_f32("../lattice/rest").is_err());
    let error = reader.extra_u8("surface_field").unwrap_err().to_string();
    assert!(error.contains("float32") && error.contains("uint8"), "{error}");
}

#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (path, other) = (folder.path().join("run"), folder.path().join("other"));
    write(&path, &lattice([6, 5, 4])).finish(Status::Complete).unwrap();
    write(&other, &lattice([5, 6, 4])).finish(Status::Complete).unwrap();
    let refused = |file: &str, change: &dyn Fn(&str) -> String, words: &[&str]| {
        let file = path.join(file);
        let original = fs::read_to_string(&file).unwrap();
        let changed = change(&original);
        assert_ne!(original, changed);
        fs::write(&file, changed).unwrap();
        let text = RunReader::open(&path).unwrap_err().to_string();
        assert!(words.iter().all(|w| text.contains(w)), "{text}");
        fs::write(&file, original).unwrap();
    };
    refused(
        "manifest.json",
        &|s| s.replace("\"format_version\": 3", "\"format_version\": 9"),
        &["version 9", "reads version 3"],
    );
    refused("manifest.json", &|s| s[..s.len() / 2].into(), &["manifest.json", "line"]);
    refused("manifest.json", &|s| s.replace("yawara-run", "zip"), &["zip", "yawara-run"]);
    let zarr = "arrays.zarr/frames/displacement/zarr.json";
    refused(zarr, &|s| s.replace("crc32c", "crc32"), &["displacement", "codecs"]);
    refused(zarr, &|s| s.replace("float32", "float64"), &["float64", "float32"]);
    refused(zarr, &|s| s.replacen("    4,", "    5,", 1), &["frames/time", "4 rows", "at least 5"]);
    refused(
        "arrays.zarr/lattice/points/zarr.json",
        &|s| s.replace("\"shape\": [\n    103", "\"shape\": [\n    1"),
        &["points"],
    );
    let huge = |s: &str| s.replacen("103", "99999999999999999", 2);
    refused("arrays.zarr/lattice/points/zarr.json", &huge, &["points", "99999999999999999"]);
    // A lattice of another shape with as many points.
    let shape = Path::new("arrays.zarr/lattice/grid_shape/c.0");
    fs::copy(other.join(shape), path.join(shape)).unwrap();
    let text = RunReader::open(&path).unwrap_err().to_string();
    assert!(text.contains("lattice/springs") && text.contains("neighbours"), "{text}");
    let text = RunReader::open(folder.path()).unwrap_err().to_string();
    assert!(text.contains("not a yawara run"), "{text}");
}

#[test]
fn overwriting_takes_nothing_but_runs() {
    let folder = tempfile::tempdir().unwrap();
    let lattice = lattice([4, 4, 4]);
    let create = |path: &Path, overwrite| RunWriter::create(path, header(), &lattice, &[], overwrite);
    let path = folder.path().join("run");
    fs::create_dir(&path).unwrap();
    let mut writer = create(&path, false).expect("an empty folder is free");
    writer
        .push_frame(FrameData { time_s: 0.0, step: 0, displacements_mm: &vec![[0.0; 3]; lattice.len()], severed: &[] })
        .unwrap();
    let old = tree(&path);
    let error = create(&path, false).unwrap_err();
    assert!(matches!(error, WriteRunError::Exists { .. }) && error.to_string().contains("run: exists"), "{error}");
    // A run that cannot begin leaves the old one.
    let bad = Extra {
        name: "A".into(),
        description: String::new(),
        unit: "1".into(),
        shape: vec![1],
        values: ExtraValues::U8(&[1]),
    };
    assert!(matches!(RunWriter::create(&path, header(), &lattice, &[bad], true), Err(WriteRunError::BadName { .. })));
    assert_eq!(tree(&path), old);
    fs::write(path.join("mesh.stl"), "mine").unwrap();
    let error = create(&path, true).unwrap_err();
    assert!(matches!(&error, WriteRunError::ForeignFile { found, .. } if found == "mesh.stl"), "{error}");
    fs::remove_file(path.join("mesh.stl")).unwrap();
    create(&path, true).unwrap();
    assert_eq!(RunReader::open(&path).unwrap().frames(), 0);
    let stranger = folder.path().join("photos");
    fs::create_dir(&stranger).unwrap();
    fs::write(stranger.join("manifest.json"), "{\"format\": \"album\"}").unwrap();
    let error = create(&stranger, true).unwrap_err();
    assert!(matches!(error, WriteRunError::NotARun { .. }) && error.to_string().contains("photos"), "{error}");
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    assert!(matches!(create(&file, true), Err(WriteRunError::NotAFolder { .. })));
    let mut left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["file", "photos", "run"], "nothing temporary is left");
}

#[cfg(unix)]
#[test]
fn folders_have_ordinary_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (path, plain) = (folder.path().join("run"), folder.path().join("plain"));
    fs::create_dir(&plain).unwrap();
    write(&path, &lattice([4, 4, 4]));
    let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
    assert_eq!(mode(&path), mode(&plain));
}

#[test]
fn frames_that_do_not_fit_are_refused_and_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let lattice = lattice([6, 5, 4]);
    let mut writer = write(&path, &lattice);
    let before = tree(&path);
    let good = displacements(&lattice, 1);
    let frame = |displacements_mm, severed| FrameData { time_s: 1.0, step: 1, displacements_mm, severed };
    let (all, fewer) = (springs(&lattice, 57), springs(&lattice, 56));
    let text = writer.push_frame(frame(&good[1..], &all)).unwrap_err().to_string();
    assert!(text.contains("frame 4") && text.contains("102") && text.contains("103"), "{text}");
    let mut bad = good.clone();
    bad[17][2] = f32::NAN;
    let text = writer.push_frame(frame(&bad, &all)).unwrap_err().to_string();
    assert!(text.contains("frame 4") && text.contains("particle 17"), "{text}");
    let text = writer.push_frame(frame(&good, &fewer)).unwrap_err().to_string();
    assert!(text.contains("56") && text.contains("57"), "{text}");
    let mut other = all.clone();
    other[56].at = 0.9;
    assert!(matches!(writer.push_frame(frame(&good, &other)), Err(WriteRunError::SeveredChanged { .. })));
    for name in ["", "a/b", "..", "Volume"] {
        let text = writer.push_series(name, "1", &[1.0]).unwrap_err().to_string();
        assert!(text.contains(&format!("{name:?}")), "{text}");
    }
    let text = writer.push_series("volume_by_cells", "m3", &[1.0]).unwrap_err().to_string();
    assert!(text.contains("mL") && text.contains("m3"), "{text}");
    let text = writer.push_series("energy", "J", &[1.0, f64::NAN]).unwrap_err().to_string();
    assert!(text.contains("`energy`: value 1 is NaN"), "{text}");
    assert_eq!(tree(&path), before);
    writer.push_frame(frame(&good, &all)).unwrap();
    writer.finish(Status::Stopped { reason: "the tip exploded".into() }).unwrap();
    let reader = RunReader::open(&path).unwrap();
    assert_eq!(reader.frames(), 5);
    assert!(reader.warning().unwrap().contains("the tip exploded"));
}

#[test]
fn errors_of_the_system_name_the_path_and_what_to_do() {
    let path = PathBuf::from("/data/run");
    let io = |kind| std::io::Error::from(kind);
    for (error, words) in [
        (WriteRunError::DiskFull { path: path.clone() }, ["/data/run", "full", "free some space"]),
        (
            WriteRunError::NotWritable { path: path.clone(), source: io(std::io::ErrorKind::PermissionDenied) },
            ["/data/run", "permission denied", "another folder"],
        ),
        (WriteRunError::NotAFolder { path: path.clone() }, ["/data/run", "a file", "another path"]),
        (
            WriteRunError::TooManyParticles { particles: 1_000_000_000, most: 178_000_000 },
            ["1000000000", "178000000", "too many"],
        ),
    ] {
        let text = error.to_string();
        assert!(words.iter().all(|w| text.contains(w)), "{text}");
    }
    // A real one: below a file nothing can be made.
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    let inside = folder.path().join("file/run");
    let text = RunWriter::create(&inside, header(), &lattice([4, 4, 4]), &[], false).unwrap_err().to_string();
    assert!(text.contains("file"), "{text}");
}

#[test]
fn severed_springs_of_another_lattice_are_refused() {
    let lattice = lattice([4, 4, 4]);
    let spring = springs(&lattice, 1)[0];
    for (index, bad) in [
        SeveredSpring { direction: 3, ..spring },
        SeveredSpring { direction: 26, ..spring },
        SeveredSpring { particle: 4000, ..spring },
        spring,
    ]
    .into_iter()
    .enumerate()
    {
        let error = Topology::replay(&lattice, &[spring, bad]).unwrap_err();
        assert_eq!(error.index, 1, "case {index}");
        let text = error.to_string();
        assert!(text.contains(&bad.particle.to_string()) && text.contains(&bad.direction.to_string()), "{text}");
    }
    // The same from a run: the lists of one with the lattice of another.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let block = self::lattice([6, 5, 4]);
    drop(write(&path, &block));
    let copy = springs(&block, 1)[0];
    let doubled: Vec<u8> = fs::read(path.join("arrays.zarr/severed/particle/c.0")).unwrap();
    fs::write(path.join("arrays.zarr/severed/direction/c.0"), doubled).unwrap();
    let error = RunReader::open(&path).unwrap().frame(3).unwrap_err();
    assert!(matches!(error, ReadRunError::Damaged { .. }), "{error}: a chunk of another type of number");
    let source = Topology::replay(&block, &[copy, copy]).unwrap_err();
    let text = ReadRunError::BadSevered { path: path.clone(), source }.to_string();
    assert!(text.contains("run") && text.contains("severed spring 1"), "{text}");
    // The neighbour loses the same spring.
    let topology = Topology::replay(&lattice, &[spring]).unwrap();
    let other = lattice.neighbour(spring.particle, usize::from(spring.direction)).unwrap();
    let back = OFFSETS.iter().position(|o| *o == OFFSETS[usize::from(spring.direction)].map(|v| -v)).unwrap();
    assert_eq!(topology.alive()[other as usize] & (1 << back), 0);
}
