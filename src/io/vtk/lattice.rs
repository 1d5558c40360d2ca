//! A lattice as VTK cells: hexahedra where voxels are cells of tissue, springs as lines where voxels are particles.

use std::path::Path;

use super::appended::{AppendedFile, Section};
use crate::geometry::{Matrix3, Vector3};
use crate::io::mesh_error::WriteMeshError;
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use crate::lattice::{Lattice, Topology};

/// Shapes of cells, as VTK numbers them.
const VERTEX: u8 = 1;
const LINE: u8 = 3;
const HEXAHEDRON: u8 = 12;
/// Corners of a cell (x fastest) in VTK's order: round the lower face, then round the upper.
const CORNERS: [usize; 8] = [0, 1, 3, 2, 4, 5, 7, 6];
/// The same for lattices whose axes are left-handed in patient space: the upper face first.
const MIRRORED_CORNERS: [usize; 8] = [4, 5, 7, 6, 0, 1, 3, 2];

/// A lattice at one moment.
#[derive(Debug, Clone, Copy)]
pub struct LatticeState<'a> {
    /// The rest state.
    pub lattice: &'a Lattice,
    /// The living springs.
    pub topology: &'a Topology,
    /// Displacement of each particle from rest, RAS+ [mm].
    pub displacements_mm: &'a [[f32; 3]],
    /// Names of the organs that the lattice numbers.
    pub organ_names: &'a [String],
    /// When [s].
    pub time: f64,
}

/// Writes a lattice as `.vtu` [mm, RAS+]: its particles where they are now.
///
/// Point data: `displacement_mm`, `organ` (its place in `organ_names` of the field data; 255 beyond the border that is drawn),
/// `severed_springs` (how many of the particle's).
///
/// Cell data of tissue, a hexahedron for each cell: `organ`, `fill` (share that is tissue), `severed` (0 or 1),
/// `severed_springs` (of its 28), `strain` (equivalent strain at its middle, see `equivalent_strain`), `volume_ratio` (at its
/// middle, to rest). In model `paper`, a vertex for each particle and a line for each living spring: `organ` (of the spring's
/// lower particle) and `strain` (of the spring's length; 0 for particles).
///
/// # Errors
/// If a displacement is not finite, there are more than 2^31 - 1 corners, or the file cannot be written.
///
/// # Panics
/// If the state's parts are of different lattices.
pub fn write_vtu(path: &Path, state: &LatticeState) -> Result<(), WriteMeshError> {
    let LatticeState { lattice, topology, displacements_mm, organ_names, time } = *state;
    assert_eq!(displacements_mm.len(), lattice.len());
    if let Some((at, found)) = displacements_mm.iter().enumerate().find(|(_, d)| !d.iter().all(|x| x.is_finite())) {
        let (path, organ, what) = (path.to_path_buf(), "lattice".to_owned(), "displacement");
        return Err(WriteMeshError::NotFinite { path, organ, what, at, found: found.to_vec() });
    }
    let particles = lattice.len();
    let cells: Vec<u32> = (0..particles as u32).filter(|&particle| lattice.cell(particle).is_some()).collect();
    let springs: usize = topology.alive().iter().map(|bits| (bits >> FIRST_FORWARD).count_ones() as usize).sum();
    let (count, corners) = if lattice.has_cells() {
        (cells.len(), 8 * cells.len())
    } else {
        (particles + springs, particles + 2 * springs)
    };
    if i32::try_from(corners).is_err() {
        return Err(WriteMeshError::TooLarge {
            path: path.to_path_buf(),
            format: "VTU with 32-bit indices",
            what: "corners of cells",
            found: corners as u64,
            limit: i32::MAX as u64,
            advice: "choose a coarser pitch",
        });
    }
    let counts = format!("NumberOfPoints=\"{particles}\" NumberOfCells=\"{count}\"");
    let mut file = AppendedFile::new("UnstructuredGrid", "Cells", counts);
    file.texts("unit", ["mm"]);
    file.texts("space", ["RAS+: x to the patient's right, y to the front, z to the head"]);
    file.texts("organ_names", organ_names.iter().map(String::as_str));
    file.time(time);
    file.floats(Section::Points, "points", particles, move |particle| {
        place(state, particle as u32).map(|x| x as f32).into()
    });
    file.floats(Section::PointData, "displacement_mm", particles, move |particle| displacements_mm[particle]);
    file.bytes(Section::PointData, "organ", particles, move |particle| [lattice.organ[particle]]);
    file.bytes(Section::PointData, "severed_springs", particles, move |particle| {
        [(lattice.springs[particle] & !topology.alive()[particle]).count_ones() as u8]
    });
    if lattice.has_cells() {
        push_cells(&mut file, state, &cells);
    } else {
        push_springs(&mut file, state, springs);
    }
    file.write(path).map_err(WriteMeshError::io(path))
}

fn push_cells<'a>(file: &mut AppendedFile<'a>, state: &'a LatticeState, cells: &'a [u32]) {
    let LatticeState { lattice, topology, .. } = *state;
    let count = cells.len();
    let data = Section::CellData;
    file.bytes(data, "organ", count, move |cell| [lattice.cell_organ[cells[cell] as usize]]);
    file.floats(data, "fill", count, move |cell| [lattice.cell_fill[cells[cell] as usize]]);
    let severed = move |cell: usize| topology.severed_in_cell(lattice, cells[cell]) as u8;
    file.bytes(data, "severed", count, move |cell| [u8::from(severed(cell) > 0)]);
    file.bytes(data, "severed_springs", count, move |cell| [severed(cell)]);
    file.floats(data, "strain", count, move |cell| [equivalent_strain(&gradient(state, cells[cell])) as f32]);
    file.floats(data, "volume_ratio", count, move |cell| [gradient(state, cells[cell]).determinant() as f32]);
    let mirrored = lattice.grid.affine.determinant() < 0.0;
    let order = if mirrored { MIRRORED_CORNERS } else { CORNERS };
    file.integers("connectivity", 8 * count as u64, count, move |cell, add| {
        let corners = lattice.cell(cells[cell]).unwrap_or_default();
        order.iter().for_each(|&corner| add(corners[corner]));
    });
    file.integers("offsets", count as u64, count, |cell, add| add(8 * (cell as u32 + 1)));
    file.bytes(Section::Cells, "types", count, |_| [HEXAHEDRON]);
}

fn push_springs<'a>(file: &mut AppendedFile<'a>, state: &'a LatticeState, springs: usize) {
    let LatticeState { lattice, topology, .. } = *state;
    let particles = lattice.len();
    let count = particles + springs;
    // Cells are the particles and then their springs: record `n` is particle `n`, or the springs of particle `n - particles`.
    let records = 2 * particles;
    let springs_of = move |particle: usize| {
        let directions = (FIRST_FORWARD..NEIGHBOURS).filter(move |d| topology.alive()[particle] >> d & 1 == 1);
        directions.filter_map(move |direction| lattice.neighbour(particle as u32, direction))
    };
    file.cell_bytes("organ", count, records, move |record, add| match record.checked_sub(particles) {
        None => add(lattice.organ[record]),
        Some(particle) => springs_of(particle).for_each(|_| add(lattice.organ[particle])),
    });
    file.cell_floats("strain", count, records, move |record, add| match record.checked_sub(particles) {
        None => add(0.0),
        Some(particle) => springs_of(particle).for_each(|other| {
            let now = (place(state, other) - place(state, particle as u32)).norm();
            let rest = (lattice.rest_place(other) - lattice.rest_place(particle as u32)).norm();
            add((now / rest - 1.0) as f32);
        }),
    });
    let corners = (particles + 2 * springs) as u64;
    file.integers("connectivity", corners, records, move |record, add| match record.checked_sub(particles) {
        None => add(record as u32),
        Some(particle) => springs_of(particle).for_each(|other| {
            add(particle as u32);
            add(other);
        }),
    });
    let end = move |cell: usize| if cell < particles { cell + 1 } else { particles + 2 * (cell + 1 - particles) };
    file.integers("offsets", count as u64, count, move |cell, add| add(end(cell) as u32));
    file.bytes(Section::Cells, "types", count, move |cell| [if cell < particles { VERTEX } else { LINE }]);
}

/// Where a particle is, RAS+ [mm].
fn place(state: &LatticeState, particle: u32) -> Vector3 {
    let moved = state.displacements_mm[particle as usize].map(f64::from);
    state.lattice.rest_place(particle).coords + Vector3::from(moved)
}

/// Deformation gradient at the middle of the cell above a particle, in lattice axes.
fn gradient(state: &LatticeState, particle: u32) -> Matrix3 {
    let corners = state.lattice.cell(particle).unwrap_or([particle; 8]);
    let mut columns = [Vector3::zeros(); 3];
    for (corner, &particle) in corners.iter().enumerate() {
        let place = place(state, particle);
        for (axis, column) in columns.iter_mut().enumerate() {
            *column += if corner >> axis & 1 == 1 { place } else { -place };
        }
    }
    // Four edges along each axis; from millimetres per cell to shares of the pitch, turned back from patient to lattice axes.
    let moved = Matrix3::from_columns(&columns) / (4.0 * 1e3 * state.lattice.pitch);
    let axes = state.lattice.grid.affine.matrix().fixed_view::<3, 3>(0, 0) / (1e3 * state.lattice.pitch);
    axes.transpose() * moved
}

/// Equivalent strain, sqrt(2/3 e:e), with e the deviator of the Green-Lagrange strain (F'F - I) / 2: a stretch of a small share
/// along one axis, without change of volume, has that share.
pub(crate) fn equivalent_strain(gradient: &Matrix3) -> f64 {
    let strain = (gradient.transpose() * gradient - Matrix3::identity()) / 2.0;
    let deviator = strain - Matrix3::identity() * (strain.trace() / 3.0);
    (2.0 / 3.0 * deviator.dot(&deviator)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equivalent_strain_of_known_states() {
        assert_eq!(equivalent_strain(&Matrix3::identity()), 0.0);
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.2, 2.0).into_inner();
        assert!(equivalent_strain(&turn) < 1e-15);
        assert!(equivalent_strain(&(Matrix3::identity() * 1.3)) < 1e-15, "a change of size alone is no distortion");
        let share = 1e-4;
        let pulled = Matrix3::from_diagonal(&Vector3::new(1.0 + share, 1.0 - share / 2.0, 1.0 - share / 2.0));
        assert!((equivalent_strain(&(turn * pulled)) / share - 1.0).abs() < 1e-3);
    }
}
