//! A run in one file: in steps, and as morph targets.

use std::fs;

use yawara::io::gltf::{GltfReader, MorphAnimationWriter, Precision, StepAnimationWriter, quantization_error_mm};
use yawara::io::mesh_error::WriteMeshError;
use yawara::surface::mesh::OrganMesh;

use crate::meshes::{chunks, near};
use crate::{blob, entries};

/// Three frames: the liver moves, then its triangles change; the kidney stays and is gone in the last.
fn frames() -> Vec<Vec<OrganMesh>> {
    let kidney = blob("kidney", [-80.0, 15.0, 640.0], 4);
    let mut gone = kidney.clone();
    gone.mesh = Default::default();
    vec![
        vec![blob("liver", [60.0, -20.0, 700.0], 6), kidney.clone()],
        vec![blob("liver", [60.0, -20.0, 710.0], 6), kidney],
        vec![blob("liver", [60.0, -20.0, 720.0], 7), gone],
    ]
}

#[test]
fn each_frame_is_read_back_at_its_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    for (at, organs) in frames().iter().enumerate() {
        writer.push_frame(0.25 * at as f64, organs).unwrap();
        assert!(!path.exists(), "the file appears whole or not at all");
    }
    writer.finish().unwrap();
    assert_eq!(entries(folder.path()), ["run.glb"]);
    let mut reader = GltfReader::open(&path).unwrap();
    assert_eq!(reader.frames(), 3);
    for (at, expected) in frames().iter().enumerate() {
        assert_eq!(reader.time(at), Some(0.25 * at as f64));
        let found = reader.read_frame(at).unwrap();
        let filled: Vec<_> = expected.iter().filter(|organ| !organ.mesh.triangles.is_empty()).collect();
        assert_eq!(found.len(), filled.len(), "frame {at}");
        for (found, expected) in found.iter().zip(filled) {
            assert_eq!((&found.name, &found.mesh.triangles), (&expected.name, &expected.mesh.triangles));
            let far =
                found.mesh.positions.iter().zip(&expected.mesh.positions).any(|(a, b)| (a[2] - b[2]).abs() > 1e-3);
            assert!(!far, "frame {at}");
        }
    }
    assert!(reader.read_frame(3).unwrap_err().to_string().contains("3 frames, not a frame 3"));
}

#[test]
fn exactly_one_frame_is_shown_at_any_time_and_the_last_is_held() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    frames().iter().enumerate().for_each(|(at, organs)| writer.push_frame(0.1 + 0.2 * at as f64, organs).unwrap());
    writer.finish().unwrap();
    let (json, binary) = chunks(&path);
    let floats = |accessor: &serde_json::Value| -> Vec<f32> {
        let accessor = &json["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let start = view["byteOffset"].as_u64().unwrap() as usize;
        let bytes = &binary[start..start + view["byteLength"].as_u64().unwrap() as usize];
        bytes.chunks(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect()
    };
    let animation = &json["animations"][0];
    assert_eq!(json["animations"].as_array().unwrap().len(), 1);
    let shown = |time: f32| -> Vec<usize> {
        let channels = animation["channels"].as_array().unwrap().iter().enumerate();
        channels
            .filter(|(_, channel)| {
                let sampler = &animation["samplers"][channel["sampler"].as_u64().unwrap() as usize];
                assert_eq!((&sampler["interpolation"], &channel["target"]["path"]), (&"STEP".into(), &"scale".into()));
                let (times, scales) = (floats(&sampler["input"]), floats(&sampler["output"]));
                let last = times.partition_point(|&key| key <= time).saturating_sub(1);
                scales[3 * last..3 * last + 3] == [1.0; 3]
            })
            .map(|(at, _)| at)
            .collect()
    };
    for (time, frame) in [(0.0, 0), (0.1, 0), (0.29, 0), (0.31, 1), (0.49, 1), (0.51, 2), (0.69, 2), (9.0, 2)] {
        assert_eq!(shown(time), [frame], "at {time} s");
    }
    let ends: Vec<f32> =
        animation["samplers"].as_array().unwrap().iter().map(|s| *floats(&s["input"]).last().unwrap()).collect();
    assert!((ends[2] - 0.7).abs() < 1e-6, "the last frame lasts as long as the one before");
}

#[test]
fn hidden_frames_shrink_to_the_middle_of_the_body() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    frames().iter().enumerate().for_each(|(at, organs)| writer.push_frame(at as f64, organs).unwrap());
    writer.finish().unwrap();
    let (json, _) = chunks(&path);
    let shown: Vec<_> = json["scenes"][0]["nodes"].as_array().unwrap().iter().collect();
    for node in shown {
        let node = &json["nodes"][node.as_u64().unwrap() as usize];
        let middle: Vec<f64> = node["translation"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        // Liver and kidney lie about (0, 0, 680) mm in patient space: head is +Y here.
        assert!(middle[0].abs() < 0.03 && (middle[1] - 0.68).abs() < 0.03 && middle[2].abs() < 0.03, "{middle:?}");
    }
}

#[test]
fn triangles_are_stored_once_per_topology() {
    let folder = tempfile::tempdir().unwrap();
    let (same, changed) = (folder.path().join("same.glb"), folder.path().join("changed.glb"));
    let organ = blob("liver", [0.0; 3], 12);
    let turned = {
        let mut other = organ.clone();
        other.mesh.triangles.iter_mut().for_each(|t| t.rotate_left(1));
        other
    };
    for (path, other) in [(&same, &organ), (&changed, &turned)] {
        let mut writer = StepAnimationWriter::create(path, Precision::Float).unwrap();
        for at in 0..6 {
            let organ = if at % 2 == 0 { &organ } else { other };
            writer.push_frame(f64::from(at), std::slice::from_ref(organ)).unwrap();
        }
        writer.finish().unwrap();
    }
    let size = |path| fs::metadata(path).unwrap().len();
    let indices = 6 * organ.mesh.triangles.len() as u64;
    let saved = size(&changed) - size(&same);
    assert!(saved >= 5 * indices, "{saved} bytes saved, five of six index lists take {}", 5 * indices);
}

#[test]
fn one_frame_is_a_still() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("still.glb");
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    writer.push_frame(3.0, &frames()[0]).unwrap();
    writer.finish().unwrap();
    let mut reader = GltfReader::open(&path).unwrap();
    assert_eq!((reader.frames(), reader.time(0), reader.read_frame(0).unwrap().len()), (1, None, 2));
}

#[test]
fn wrong_frames_are_refused_and_the_animation_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    writer.push_frame(1.0, &frames()[0]).unwrap();
    for time in [1.0, 0.5, -1.0, f64::NAN, f64::INFINITY, 1.0 + 1e-9] {
        let refused = writer.push_frame(time, &frames()[1]);
        assert!(matches!(refused, Err(WriteMeshError::FrameTime { frame: 1, .. })), "{time}");
    }
    let mut bad = frames().remove(1);
    bad[0].mesh.triangles[0][0] = 1 << 20;
    assert!(matches!(writer.push_frame(2.0, &bad), Err(WriteMeshError::VertexIndex { found: 1_048_576, .. })));
    writer.push_frame(2.0, &frames()[1]).unwrap();
    writer.finish().unwrap();
    assert_eq!(GltfReader::open(&path).unwrap().frames(), 2);
}

#[test]
fn an_abandoned_or_empty_animation_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    writer.push_frame(0.0, &frames()[0]).unwrap();
    drop(writer);
    let writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    assert!(writer.is_empty() && writer.finish().is_err());
    // A folder stands where the file should be.
    fs::create_dir(&path).unwrap();
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    writer.push_frame(0.0, &frames()[0]).unwrap();
    assert!(matches!(writer.finish(), Err(WriteMeshError::Io { .. })));
    fs::remove_dir(&path).unwrap();
    assert!(entries(folder.path()).is_empty());
}

#[test]
fn quantised_frames_are_read_back_at_their_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    let mut writer = StepAnimationWriter::create(&path, Precision::Quantized).unwrap();
    frames().iter().enumerate().for_each(|(at, organs)| writer.push_frame(at as f64, organs).unwrap());
    writer.finish().unwrap();
    let mut reader = GltfReader::open(&path).unwrap();
    assert_eq!(reader.frames(), 3);
    for (at, expected) in frames().iter().enumerate() {
        let bound = quantization_error_mm(expected) as f32 + 1e-3;
        for (found, expected) in reader.read_frame(at).unwrap().iter().zip(expected) {
            assert!(near(&found.mesh.positions, &expected.mesh.positions, 0.0, bound), "frame {at}, {}", found.name);
        }
    }
}

/// Frames of a liver that wobbles, is cut at frame `cut`, and wobbles on; a kidney that vanishes there.
fn wobble(count: usize, cut: usize) -> Vec<Vec<OrganMesh>> {
    let frame = |at: usize| {
        let mut liver = blob("liver", [60.0, -20.0, 700.0], if at < cut { 6 } else { 7 });
        for (vertex, position) in liver.mesh.positions.iter_mut().enumerate() {
            position[2] += 5.0 * (at as f32 + 0.1 * vertex as f32).sin();
        }
        let mut kidney = blob("kidney", [-80.0, 15.0, 640.0], 4);
        kidney.mesh.normals.clear();
        if at >= cut {
            kidney.mesh = Default::default();
        }
        vec![liver, kidney]
    };
    (0..count).map(frame).collect()
}

#[test]
fn morph_frames_are_read_back_at_their_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    // More frames than one mesh has targets, a cut in between, and one just before the last.
    for (count, cut) in [(3, 1), (5, 5), (150, 70), (65, 64), (64, 64)] {
        let frames = wobble(count, cut);
        let mut writer = MorphAnimationWriter::create(&path).unwrap();
        for (at, organs) in frames.iter().enumerate() {
            writer.push_frame(0.25 * at as f64, organs).unwrap();
        }
        writer.finish().unwrap();
        assert_eq!(entries(folder.path()), ["run.glb"]);
        let mut reader = GltfReader::open(&path).unwrap();
        assert_eq!(reader.frames(), count, "{count} frames, cut at {cut}");
        for (at, expected) in frames.iter().enumerate() {
            assert_eq!(reader.time(at), Some(0.25 * at as f64));
            let mut found = reader.read_frame(at).unwrap();
            found.sort_by(|a, b| b.name.cmp(&a.name));
            let filled: Vec<_> = expected.iter().filter(|organ| !organ.mesh.triangles.is_empty()).collect();
            assert_eq!(found.len(), filled.len(), "frame {at} of {count}");
            for (found, expected) in found.iter().zip(filled) {
                let (name, found, expected) = (&found.name, &found.mesh, &expected.mesh);
                assert_eq!(found.triangles, expected.triangles);
                assert!(near(&found.positions, &expected.positions, 3e-7, 3e-4), "frame {at} of {count}, {name}");
                assert!(near(&found.normals, &expected.normals, 0.0, 1e-5), "frame {at} of {count}, {name}");
                assert!(found.strains.is_empty() && found.displacements.is_empty(), "those of one moment");
                assert_eq!((&found.labels, &found.hu), (&expected.labels, &expected.hu));
            }
        }
    }
}

#[test]
fn morph_targets_take_less_room_than_frames() {
    let folder = tempfile::tempdir().unwrap();
    let (steps, morph) = (folder.path().join("steps.glb"), folder.path().join("morph.glb"));
    let frames = wobble(40, 40);
    let mut step_writer = StepAnimationWriter::create(&steps, Precision::Float).unwrap();
    let mut morph_writer = MorphAnimationWriter::create(&morph).unwrap();
    for (at, organs) in frames.iter().enumerate() {
        step_writer.push_frame(at as f64, organs).unwrap();
        morph_writer.push_frame(at as f64, organs).unwrap();
    }
    step_writer.finish().unwrap();
    morph_writer.finish().unwrap();
    let size = |path| fs::metadata(path).unwrap().len();
    assert!(2 * size(&morph) < size(&steps), "{} and {} bytes", size(&morph), size(&steps));
}

#[test]
fn wrong_morph_frames_are_refused_and_the_animation_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.glb");
    let frames = wobble(3, 3);
    let mut writer = MorphAnimationWriter::create(&path).unwrap();
    writer.push_frame(1.0, &frames[0]).unwrap();
    assert!(matches!(writer.push_frame(1.0, &frames[1]), Err(WriteMeshError::FrameTime { frame: 1, .. })));
    let mut bad = frames[1].clone();
    bad[0].mesh.positions[7][1] = f32::NAN;
    assert!(matches!(writer.push_frame(2.0, &bad), Err(WriteMeshError::NotFinite { at: 7, .. })));
    writer.push_frame(2.0, &frames[1]).unwrap();
    assert_eq!(writer.len(), 2);
    writer.finish().unwrap();
    assert_eq!(GltfReader::open(&path).unwrap().frames(), 2);
    let writer = MorphAnimationWriter::create(&path).unwrap();
    assert!(writer.is_empty() && matches!(writer.finish(), Err(WriteMeshError::Empty { .. })));
}
