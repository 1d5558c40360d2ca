//! A whole run in one file, a mesh per frame and organ, written frame by frame.

use std::path::Path;

use gltf_json::{Animation, Index, Node};

use super::document::{self, DocumentWriter, node};
use super::vertices::{Precision, bounds, place};
use crate::io::mesh_error::WriteMeshError;
use crate::surface::mesh::OrganMesh;

/// Writes an animation frame by frame; the file appears at [`finish`](StepAnimationWriter::finish), whole, or never.
///
/// Memory holds one copy of each organ's last triangles and the JSON (about 2 kB per frame and organ), not the frames.
/// An organ's triangles are stored again only when they changed since its last frame. Each frame is shown from its time to
/// the next frame's; the last as long as the one before.
pub struct StepAnimationWriter {
    document: DocumentWriter,
    frames: Vec<Frame>,
    /// Middle of the first frame, glTF axes [m]. Hidden frames shrink to this place; at the file's origin, often far outside the
    /// body, they would make viewers that look at bounds show the body small and aside.
    middle: Option<[f32; 3]>,
}

struct Frame {
    time: f64,
    node: Index<Node>,
}

impl StepAnimationWriter {
    /// Begins an animation that will be at `path`.
    ///
    /// # Errors
    /// If no temporary file can be made in the folder of `path`.
    pub fn create(path: &Path, precision: Precision) -> Result<Self, WriteMeshError> {
        Ok(Self { document: DocumentWriter::create(path, precision)?, frames: Vec::new(), middle: None })
    }

    /// Adds a frame at a time [s]. An organ is known by its name; one without triangles is left out of the frame.
    ///
    /// # Errors
    /// If the time is negative or does not grow, a mesh is inconsistent or not finite, or the file would exceed 4 GiB: then the
    /// frame is refused and the animation can go on without it. If the temporary file cannot be written: then it cannot.
    pub fn push_frame(&mut self, time: f64, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
        let frame = self.frames.len();
        check_time(self.document.path(), frame, time, self.frames.last().map(|frame| frame.time))?;
        if self.middle.is_none() {
            self.middle = middle(organs);
            self.document.set_origin(self.middle.unwrap_or_default());
        }
        let children = self.document.push_organs(organs, |organ| format!("{} {frame}", organ.name))?;
        let children = Some(children).filter(|children| !children.is_empty());
        let mut shown = node(format!("frame {frame}"), None, children);
        shown.translation = self.middle;
        // Viewers that do not animate show the first frame alone.
        if frame > 0 {
            shown.scale = Some([0.0; 3]);
        }
        let node = self.document.root().push(shown);
        self.frames.push(Frame { time, node });
        Ok(())
    }

    /// Frames so far.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// True before the first frame.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Writes the file.
    ///
    /// # Errors
    /// If no frame has a triangle, a frame could not be written whole, the file would exceed 4 GiB, or it cannot be written.
    pub fn finish(mut self) -> Result<(), WriteMeshError> {
        let nodes = self.frames.iter().map(|frame| frame.node).collect();
        let animation = if self.frames.len() > 1 { Some(self.animation()?) } else { None };
        self.document.finish(nodes, animation)
    }

    fn animation(&mut self) -> Result<Animation, WriteMeshError> {
        let mut animation = document::animation();
        let times: Vec<f32> = self.frames.iter().map(|frame| frame.time as f32).collect();
        let (first, last) = (times[0], times[times.len() - 1]);
        let end = last + (last - times[times.len() - 2]);
        for (at, frame) in self.frames.iter().enumerate() {
            let mut keys = vec![(times[at], 1.0)];
            if at > 0 {
                keys.insert(0, (first, 0.0));
            }
            keys.push(times.get(at + 1).map_or((end, 1.0), |&next| (next, 0.0)));
            let written = self.document.visibility(&mut animation, frame.node, &keys);
            written.map_err(|source| self.document.tear(source))?;
        }
        Ok(animation)
    }
}

/// Refuses times [s] that an animation cannot have. Keys are stored in single precision and must still grow there.
pub(super) fn check_time(path: &Path, frame: usize, time: f64, previous: Option<f64>) -> Result<(), WriteMeshError> {
    let previous = previous.unwrap_or(f64::NEG_INFINITY);
    if (time as f32).is_finite() && time >= 0.0 && time as f32 > previous as f32 {
        return Ok(());
    }
    Err(WriteMeshError::FrameTime { path: path.to_path_buf(), frame, time, previous })
}

/// Middle of the box around all vertices, glTF axes [m]; `None` without a vertex or with one that is not finite.
pub(super) fn middle(organs: &[OrganMesh]) -> Option<[f32; 3]> {
    let boxes = organs.iter().filter_map(|organ| {
        let positions = &organ.mesh.positions;
        bounds(positions.len(), |vertex| place(positions[vertex], [0.0; 3]))
    });
    let corners: Vec<[f32; 3]> = boxes.flatten().collect();
    let [low, high] = bounds(corners.len(), |corner| corners[corner])?;
    let middle = [0, 1, 2].map(|axis| f32::midpoint(low[axis], high[axis]));
    middle.iter().all(|x| x.is_finite()).then_some(middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::{Finish, TriangleMesh};

    #[test]
    fn the_size_limit_refuses_the_frame_and_names_the_way_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.glb");
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mesh = TriangleMesh { positions, triangles: vec![[0, 1, 2]], ..TriangleMesh::default() };
        let organs = [OrganMesh { name: "liver".into(), color: [1.0; 3], finish: Finish::Wet, mesh }];
        let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
        writer.document.set_limit(100);
        writer.push_frame(0.0, &organs).unwrap();
        writer.push_frame(0.1, &organs).unwrap();
        let message = writer.push_frame(0.2, &organs).unwrap_err().to_string();
        assert!(message.contains("limit") || message.contains("(100)"), "{message}");
        assert!(message.contains("{frame}") && message.contains("coarser"), "{message}");
        assert_eq!(writer.len(), 2, "the refused frame is not counted");
        writer.document.set_limit(10_000);
        writer.finish().unwrap();
        assert_eq!(super::super::GltfReader::open(&path).unwrap().frames(), 2);
    }

    #[test]
    fn a_torn_document_is_not_finished() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = StepAnimationWriter::create(&folder.path().join("run.glb"), Precision::Float).unwrap();
        writer.document.tear(std::io::Error::other("disk full"));
        assert!(matches!(writer.finish(), Err(WriteMeshError::Unfinished { .. })));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
