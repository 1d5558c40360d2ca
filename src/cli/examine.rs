//! Meshes of files as they are judged: by their indices, or where these do not close them, by the places of their vertices.

use crate::surface::check::{MeshReport, check};
use crate::surface::mesh::TriangleMesh;
use crate::surface::weld::{soup, weld};

/// What was found of a mesh.
pub(super) struct Examined {
    pub(super) report: MeshReport,
    /// It is closed once vertices at one place are merged, as programs double them on sharp edges; the report is of the merged mesh.
    pub(super) merged: bool,
}

/// Examines a mesh from a file.
pub(super) fn examine(mesh: &TriangleMesh) -> Examined {
    let report = check(mesh);
    if !report.is_closed() && report.non_finite_vertices == 0 {
        let merged = check(&weld(&soup(mesh), 0.0));
        if merged.is_closed() {
            return Examined { report: merged, merged: true };
        }
    }
    Examined { report, merged: false }
}
