//! What the resolution of surfaces costs and brings.

use std::time::Instant;

use super::choice::Choice;
use super::ledger::{LedgerError, Line, SurfaceLine};
use super::plan::RESOLUTIONS;
use super::surface_distance::Measured;
use super::sweep::Study;
use crate::run::meshes::{MeshOptions, Resolution, RunMesher};
use crate::scene::resolved::Body;
use crate::store::RunReader;
use crate::surface::check::check;
use crate::surface::mesh::OrganMesh;

/// Name of the resolution of the lattice.
pub const LATTICE: &str = "lattice";
/// How often a surface is drawn, to time it.
const REPEATS: usize = 3;
/// A reference that would have more triangles than this is taken less fine.
const MOST_TRIANGLES: usize = 4_000_000;

/// The surfaces of a run's last frame.
pub struct Drawn {
    /// One for each soft organ.
    pub meshes: Vec<OrganMesh>,
    /// Time to draw and carry them from what is on disk \[s\].
    pub seconds: f64,
}

/// Draws the soft organs of the first run of a choice as they are at its end. `None` where that cannot be done.
pub fn surface_of(study: &Study<'_>, choice: &Choice, resolution: Resolution) -> Option<Drawn> {
    let soft = study.scene().organs.iter().filter(|organ| !matches!(organ.body, Body::Rigid { .. }));
    let names: Vec<String> = soft.map(|organ| organ.name.clone()).collect();
    let reader = RunReader::open(&study.run_folder(choice)).ok()?;
    let last = reader.frames().checked_sub(1)?;
    let begun = Instant::now();
    let mut mesher = RunMesher::new(reader, &names, &MeshOptions { resolution, ..MeshOptions::default() }).ok()?;
    let (_, meshes) = mesher.frame(last).ok()?;
    Some(Drawn { meshes, seconds: begun.elapsed().as_secs_f64() })
}

/// Measures surfaces of a run from coarse to fine, where that is not known yet, against one twice as fine as the finest.
///
/// # Errors
/// If the results cannot be kept.
pub fn measure(study: &mut Study<'_>, choice: &Choice) -> Result<(), LedgerError> {
    if study.ledger().surfaces().next().is_some() {
        return Ok(());
    }
    let inputs = study.inputs();
    let grid = inputs.labels.as_ref().map(|labels| labels.grid()).or(inputs.image.as_ref().map(|image| image.grid()));
    let Some(voxel) = grid.map(|grid| grid.affine.spacing().into_iter().fold(f64::INFINITY, f64::min)) else {
        return Ok(());
    };
    let by_voxel = || RESOLUTIONS.map(|share| share * voxel).to_vec();
    let mut spacings = study.options().resolutions_mm.clone().unwrap_or_else(by_voxel);
    spacings.sort_by(|a, b| b.total_cmp(a));
    let mut list = vec![(LATTICE.to_owned(), Resolution::Lattice)];
    list.extend(spacings.iter().map(|&spacing| (format!("{spacing}"), Resolution::Spacing(spacing))));
    let Some(&finest) = spacings.last() else { return Ok(()) };
    let Some(fine) = surface_of(study, choice, Resolution::Spacing(finest)) else { return Ok(()) };
    let triangles = count(&fine.meshes);
    let finer = [2.0, 1.5].into_iter().find(|&by: &f64| triangles as f64 * by.powi(2) < MOST_TRIANGLES as f64);
    let Some(by) = finer else { return Ok(()) };
    let reference_mm = finest / by;
    let Some(drawn) = surface_of(study, choice, Resolution::Spacing(reference_mm)) else { return Ok(()) };
    let Some(reference) = Measured::new(drawn.meshes.iter().map(|mesh| &mesh.mesh)) else { return Ok(()) };
    let line = |resolution: &str, drawn: &Drawn, seconds: f64, distance| {
        Line::Surface(SurfaceLine {
            run: choice.key(),
            resolution: resolution.to_owned(),
            triangles: count(&drawn.meshes),
            seconds,
            volume_ml: drawn.meshes.iter().map(|mesh| check(&mesh.mesh).volume_ml()).sum(),
            distance,
        })
    };
    // Round after round, so that a noisy machine does not decide.
    let mut seconds = vec![f64::INFINITY; list.len()];
    let mut lines = Vec::new();
    for repeat in 0..REPEATS {
        for (number, (name, resolution)) in list.iter().enumerate() {
            let Some(drawn) = surface_of(study, choice, *resolution) else { continue };
            seconds[number] = seconds[number].min(drawn.seconds);
            if repeat + 1 == REPEATS {
                let own = Measured::new(drawn.meshes.iter().map(|mesh| &mesh.mesh));
                let distance = own.map(|own| own.distance(&reference));
                lines.push(line(name, &drawn, seconds[number], distance));
            }
        }
    }
    lines.push(line(&format!("{reference_mm}"), &drawn, drawn.seconds, None));
    lines.into_iter().try_for_each(|line| study.ledger_mut().push(line))
}

fn count(meshes: &[OrganMesh]) -> usize {
    meshes.iter().map(|mesh| mesh.mesh.triangles.len()).sum()
}
