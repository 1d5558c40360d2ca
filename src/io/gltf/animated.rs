//! A whole run as one animated GLB, written frame by frame.

use std::path::Path;

use gltf_json::animation::{Animation, Channel, Interpolation, Property, Sampler, Target};
use gltf_json::validation::Checked::Valid;
use gltf_json::{Index, Node};

use super::document::{DocumentWriter, node};
use super::to_gltf;
use crate::io::mesh_error::WriteMeshError;
use crate::surface::mesh::OrganMesh;

/// Writes an animation frame by frame; the file appears at [`finish`](AnimatedGlbWriter::finish), whole, or never.
///
/// Memory holds one copy of each organ's last triangles and the JSON (about 2 kB per frame and organ), not the frames.
/// An organ's triangles are stored again only when they changed since its last frame. Each frame is shown from its time to
/// the next frame's; the last as long as the one before.
pub struct AnimatedGlbWriter {
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

impl AnimatedGlbWriter {
    /// Begins an animation that will be at `path`.
    ///
    /// # Errors
    /// If no temporary file can be made in the folder of `path`.
    pub fn create(path: &Path) -> Result<Self, WriteMeshError> {
        Ok(Self { document: DocumentWriter::create(path)?, frames: Vec::new(), middle: None })
    }

    /// Adds a frame at a time [s]. An organ is known by its name; one without triangles is left out of the frame.
    ///
    /// # Errors
    /// If the time is negative or does not grow, a mesh is inconsistent or not finite, or the file would exceed 4 GiB: then the
    /// frame is refused and the animation can go on without it. If the temporary file cannot be written: then it cannot.
    pub fn push_frame(&mut self, time: f64, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
        let frame = self.frames.len();
        let previous = self.frames.last().map_or(f64::NEG_INFINITY, |frame| frame.time);
        // Keys are stored in single precision and must still grow there.
        if !((time as f32).is_finite() && time >= 0.0 && time as f32 > previous as f32) {
            let path = self.document.path().to_path_buf();
            return Err(WriteMeshError::FrameTime { path, frame, time, previous });
        }
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
        let (mut channels, mut samplers) = (Vec::new(), Vec::new());
        let times: Vec<f32> = self.frames.iter().map(|frame| frame.time as f32).collect();
        let (first, last) = (times[0], times[times.len() - 1]);
        let end = last + (last - times[times.len() - 2]);
        for (at, frame) in self.frames.iter().enumerate() {
            let mut keys = vec![(times[at], 1.0)];
            if at > 0 {
                keys.insert(0, (first, 0.0));
            }
            keys.push(times.get(at + 1).map_or((end, 1.0), |&next| (next, 0.0)));
            let (times, scales): (Vec<f32>, Vec<f32>) = keys.into_iter().unzip();
            let input = self.document.times(&times).map_err(|source| self.document.tear(source))?;
            let output = self.document.scales(&scales).map_err(|source| self.document.tear(source))?;
            let (extensions, extras) = (None, None);
            samplers.push(Sampler { extensions, extras, input, interpolation: Valid(Interpolation::Step), output });
            let target = Target { extensions: None, extras: None, node: frame.node, path: Valid(Property::Scale) };
            channels.push(Channel { sampler: Index::new(at as u32), target, extensions: None, extras: None });
        }
        Ok(Animation { extensions: None, extras: None, channels, name: Some("run".to_string()), samplers })
    }
}

/// Middle of the box around all vertices, glTF axes [m]; `None` without a vertex or with one that is not finite.
fn middle(organs: &[OrganMesh]) -> Option<[f32; 3]> {
    let places = || organs.iter().flat_map(|organ| &organ.mesh.positions);
    let middle = [0, 1, 2].map(|axis| {
        let (low, high) = places().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), place| {
            (low.min(place[axis].into()), high.max(place[axis].into()))
        });
        f64::midpoint(low, high) / 1000.0
    });
    let middle = to_gltf(middle).map(|x| x as f32);
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
        let mut writer = AnimatedGlbWriter::create(&path).unwrap();
        writer.document.set_limit(100);
        writer.push_frame(0.0, &organs).unwrap();
        writer.push_frame(0.1, &organs).unwrap();
        let message = writer.push_frame(0.2, &organs).unwrap_err().to_string();
        assert!(message.contains("limit") || message.contains("(100)"), "{message}");
        assert!(message.contains("{frame}") && message.contains("coarser"), "{message}");
        assert_eq!(writer.len(), 2, "the refused frame is not counted");
        writer.document.set_limit(10_000);
        writer.finish().unwrap();
        assert_eq!(super::super::GlbReader::open(&path).unwrap().frames(), 2);
    }

    #[test]
    fn a_torn_document_is_not_finished() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = AnimatedGlbWriter::create(&folder.path().join("run.glb")).unwrap();
        writer.document.tear(std::io::Error::other("disk full"));
        assert!(matches!(writer.finish(), Err(WriteMeshError::Unfinished { .. })));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
