//! VTK: the arrays that the header promises are where it says, with the values of the mesh or the lattice.

use std::fs;
use std::path::Path;

use yawara::geometry::{Affine, Grid, GridShape};
use yawara::io::mesh_error::WriteMeshError;
use yawara::io::mesh_format::MeshFormat;
use yawara::io::vtk::{LatticeState, Regions, write_pvd, write_vtp, write_vtp_borders, write_vtu};
use yawara::lattice::cells::build_cells;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use yawara::lattice::{Lattice, SeveredSpring, Topology};
use yawara::volume::Volume;

use crate::blob;

/// A file with appended raw arrays, taken apart without the writer's help.
struct Parsed {
    xml: String,
    data: Vec<u8>,
}

impl Parsed {
    fn open(path: &Path) -> Self {
        let bytes = fs::read(path).unwrap();
        let mark = b"<AppendedData encoding=\"raw\">\n_";
        let at = bytes.windows(mark.len()).position(|window| window == mark).unwrap();
        assert!(bytes.ends_with(b"\n</AppendedData>\n</VTKFile>\n"));
        Self { xml: String::from_utf8(bytes[..at].to_vec()).unwrap(), data: bytes[at + mark.len()..].to_vec() }
    }

    /// The bytes of an array of a type and a number of components.
    fn array(&self, name: &str, kind: &str, components: usize) -> &[u8] {
        let tag = format!(
            "type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" offset=\""
        );
        let found = self.xml.matches(&tag).count();
        assert!(found >= 1, "{tag} in {}", self.xml);
        let rest = &self.xml[self.xml.find(&tag).unwrap() + tag.len()..];
        let offset: usize = rest[..rest.find('"').unwrap()].parse().unwrap();
        let length = u64::from_le_bytes(self.data[offset..offset + 8].try_into().unwrap()) as usize;
        &self.data[offset + 8..offset + 8 + length]
    }

    fn floats(&self, name: &str, components: usize) -> Vec<f32> {
        self.array(name, "Float32", components).chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    fn integers(&self, name: &str) -> Vec<i32> {
        self.array(name, "Int32", 1).chunks(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    fn words(&self, name: &str) -> Vec<u16> {
        self.array(name, "UInt16", 1).chunks(2).map(|b| u16::from_le_bytes(b.try_into().unwrap())).collect()
    }

    fn text(&self, name: &str) -> String {
        let rest = &self.xml[self.xml.find(&format!("Name=\"{name}\"")).unwrap()..];
        let codes = &rest[rest.find('>').unwrap() + 1..rest.find('<').unwrap()];
        String::from_utf8(codes.split(' ').map(|code| code.parse().unwrap()).collect()).unwrap()
    }
}

#[test]
fn surfaces_hold_every_attribute_where_the_header_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vtp");
    let mut empty = blob("none", [0.0; 3], 3);
    empty.mesh = Default::default();
    let organs = [blob("liver & <co>", [60.0, -20.0, 700.0], 9), empty, blob("kidney", [-80.0, 15.0, 640.0], 5)];
    write_vtp(&path, &organs, Some(0.125)).unwrap();
    let found = Parsed::open(&path);
    let flat = |of: fn(&yawara::surface::mesh::TriangleMesh) -> Vec<f32>| -> Vec<f32> {
        organs.iter().flat_map(|organ| of(&organ.mesh)).collect()
    };
    assert_eq!(found.floats("points", 3), flat(|mesh| mesh.positions.as_flattened().to_vec()));
    assert_eq!(found.floats("normal", 3), flat(|mesh| mesh.normals.as_flattened().to_vec()));
    assert_eq!(found.floats("displacement_mm", 3), flat(|mesh| mesh.displacements.as_flattened().to_vec()));
    assert_eq!(found.floats("hu", 1), flat(|mesh| mesh.hu.clone()));
    assert_eq!(found.floats("strain", 1), flat(|mesh| mesh.strains.clone()));
    assert_eq!(found.floats("speed_mm_per_s", 1), flat(|mesh| mesh.speeds.clone()));
    let [first, _, second] = &organs;
    let (points, triangles) = (first.mesh.positions.len(), first.mesh.triangles.len());
    assert_eq!(found.array("color_srgb", "UInt8", 3).len(), 3 * (points + second.mesh.positions.len()));
    let corners = found.integers("connectivity");
    assert_eq!(corners[..3], first.mesh.triangles[0].map(|corner| corner as i32));
    let last = *second.mesh.triangles.last().unwrap();
    assert_eq!(corners[corners.len() - 3..], last.map(|corner| corner as i32 + points as i32));
    let ends = found.integers("offsets");
    assert_eq!((ends[0], *ends.last().unwrap()), (3, corners.len() as i32));
    let organ = found.words("organ");
    assert_eq!((organ[triangles - 1], organ[triangles], organ.len()), (0, 2, ends.len()));
    assert_eq!(found.text("organ_names"), "liver & <co>\0none\0kidney\0");
    assert_eq!((found.text("unit"), found.text("space").starts_with("RAS+")), ("mm\0".into(), true));
    assert!(found.xml.contains("Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">0.125<"));
    let message = MeshFormat::Vtp.read(&path).unwrap_err().to_string();
    assert!(message.contains("m.vtp: VTK XML is not read here"), "{message}");
}

#[test]
fn borders_say_what_lies_on_either_side() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vtp");
    let borders = [blob("liver|outside", [0.0; 3], 7), blob("liver|gallbladder", [9.0; 3], 4)];
    let names = ["outside", "liver", "gallbladder"].map(str::to_owned);
    write_vtp_borders(&path, &borders, Regions { names: &names, sides: &[[1, 0], [1, 2]] }, None).unwrap();
    let found = Parsed::open(&path);
    assert_eq!(found.text("region_names"), "outside\0liver\0gallbladder\0");
    let [first, second] = borders.map(|border| border.mesh.triangles.len());
    assert_eq!(found.words("inside"), vec![1; first + second]);
    assert_eq!(found.words("outside"), [vec![0; first], vec![2; second]].concat());
}

/// A block of 4 x 3 x 2 voxels of tissue, on axes that run against the patient's x when `mirrored`.
fn block(mirrored: bool) -> Lattice {
    let mut affine = Affine::from_spacing([5.0; 3], [10.0, 20.0, 30.0]).unwrap();
    if mirrored {
        let mut matrix = affine.matrix();
        matrix[(0, 0)] = -5.0;
        affine = Affine::new(&matrix).unwrap();
    }
    let grid = Grid { shape: GridShape::new(4, 3, 2), affine };
    build_cells(&Volume::from_vec(grid, vec![0; 24]), None).unwrap()
}

#[test]
fn cells_of_a_stretched_and_cut_lattice() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lattice.vtu");
    for mirrored in [false, true] {
        let lattice = block(mirrored);
        let mut topology = Topology::new(&lattice);
        let direction = (FIRST_FORWARD..NEIGHBOURS).find(|&d| lattice.springs[0] >> d & 1 == 1).unwrap();
        assert!(
            topology.sever(&lattice, SeveredSpring { particle: 0, direction: direction as u8, at: 0.5, time: 0.0 })
        );
        // Stretched by a tenth along the patient's z.
        let moved: Vec<[f32; 3]> =
            (0..lattice.len() as u32).map(|p| [0.0, 0.0, 0.1 * lattice.rest_place(p).z as f32]).collect();
        let names = ["liver".to_owned()];
        let state = LatticeState {
            lattice: &lattice,
            topology: &topology,
            displacements_mm: &moved,
            organ_names: &names,
            time: 0.5,
        };
        write_vtu(&path, &state).unwrap();
        let found = Parsed::open(&path);
        let points = found.floats("points", 3);
        let corners = found.integers("connectivity");
        let cells = corners.len() / 8;
        assert_eq!(found.integers("offsets"), (1..=cells as i32).map(|n| 8 * n).collect::<Vec<_>>());
        assert!(found.array("types", "UInt8", 1).iter().all(|&kind| kind == 12));
        let place = |n: i32| nalgebra::Vector3::from_fn(|axis, _| f64::from(points[3 * n as usize + axis]));
        for cell in corners.chunks(8) {
            // Right-handed: the lower face turns so that its normal points to the upper one.
            let [a, b, d, e] = [cell[0], cell[1], cell[3], cell[4]].map(place);
            let volume = (b - a).cross(&(d - a)).dot(&(e - a));
            assert!((volume - 1.1 * 125.0).abs() < 1e-2, "mirrored {mirrored}: {volume}");
        }
        assert!(found.floats("volume_ratio", 1).iter().all(|ratio| (ratio - 1.1).abs() < 1e-4));
        // Green-Lagrange strain 0.105 along one axis: its deviator has the norm sqrt(2/3) of that.
        assert!(found.floats("strain", 1).iter().all(|strain| (strain - 0.105 * 2.0 / 3.0).abs() < 1e-4));
        assert_eq!(found.floats("fill", 1).len(), cells);
        let severed = found.array("severed", "UInt8", 1);
        let touched = lattice.cells_of_spring(0, direction).filter(|&cell| lattice.cell(cell).is_some()).count();
        assert_eq!(severed.iter().filter(|&&flag| flag == 1).count(), touched);
        // The first array of the name is the particles'.
        assert_eq!(found.array("severed_springs", "UInt8", 1).iter().map(|&n| u32::from(n)).sum::<u32>(), 2);
        let mut wild = moved.clone();
        wild[3][1] = f32::NAN;
        let refused = write_vtu(&path, &LatticeState { displacements_mm: &wild, ..state });
        assert!(matches!(refused, Err(WriteMeshError::NotFinite { at: 3, .. })));
    }
}

#[test]
fn springs_of_a_lattice_of_particles() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lattice.vtu");
    let grid = Grid { shape: GridShape::new(3, 1, 1), affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
    let lattice = yawara::lattice::build::build(&Volume::from_vec(grid, vec![0_u8; 3])).unwrap();
    let mut topology = Topology::new(&lattice);
    let along = (FIRST_FORWARD..NEIGHBOURS).find(|&d| lattice.springs[0] >> d & 1 == 1).unwrap();
    assert!(topology.sever(&lattice, SeveredSpring { particle: 1, direction: along as u8, at: 0.5, time: 0.0 }));
    let moved = [[0.0; 3], [0.5, 0.0, 0.0], [9.0, 0.0, 0.0]];
    let names = ["rope".to_owned()];
    let state = LatticeState {
        lattice: &lattice,
        topology: &topology,
        displacements_mm: &moved,
        organ_names: &names,
        time: 0.0,
    };
    write_vtu(&path, &state).unwrap();
    let found = Parsed::open(&path);
    assert_eq!(found.array("types", "UInt8", 1), [1, 1, 1, 3]);
    assert_eq!(found.integers("connectivity"), [0, 1, 2, 0, 1]);
    assert_eq!(found.integers("offsets"), [1, 2, 3, 5]);
    assert_eq!(found.floats("strain", 1), [0.0, 0.0, 0.0, 0.25]);
    assert_eq!(found.array("severed_springs", "UInt8", 1), [0, 1, 1]);
}

#[test]
fn the_list_of_frames_names_files_and_times() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pvd");
    write_pvd(&path, &[(0.0, "a & b_0.vtp".to_owned()), (0.05, "a & b_1.vtp".to_owned())]).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("<DataSet timestep=\"0\" part=\"0\" file=\"a &amp; b_0.vtp\"/>"), "{text}");
    assert!(text.contains("<DataSet timestep=\"0.05\" part=\"0\" file=\"a &amp; b_1.vtp\"/>"), "{text}");
}
