//! Tools so thin that tissue, which is met at its particles, may let them through.

use crate::scene::resolved::{Action, Operation, Scene, ToolShape};

/// Thinner than this many pitches a tool may slip between particles.
const LEAST_PITCHES: f64 = 2.0;

/// A warning for each tool of a scene that is thin for a pitch [m]. Meshes are left out: what is too thin among them is refused.
pub fn thin_tools(scene: &Scene, pitch: f64) -> Vec<String> {
    let pitch = pitch * 1e3;
    let warning = |operation: &Operation| {
        let Action::Tool { shape, .. } = &operation.action else { return None };
        let thickness = match shape {
            ToolShape::Sphere { radius, .. } | ToolShape::Capsule { radius, .. } => 2.0 * radius,
            ToolShape::Box { min, max } => (max - min).min(),
            ToolShape::Mesh { .. } => return None,
        };
        (thickness < LEAST_PITCHES * pitch).then(|| {
            format!(
                "`{}` is {thickness:.3} mm thick and the lattice's particles are {pitch:.3} mm apart, so it may slip between \
                 them; make it {LEAST_PITCHES} pitches thick, or refine lattice.pitch",
                operation.name
            )
        })
    };
    scene.operations.iter().filter_map(warning).collect()
}
