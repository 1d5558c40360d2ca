//! OBJ: objects, normals and colours come back; files of other programs are read.

use std::fs;

use yawara::io::mesh_format::MeshFormat;
use yawara::io::obj::{read_obj, write_obj};
use yawara::surface::mesh::OrganMesh;

use crate::blob;
use crate::meshes::near;

fn organs() -> Vec<OrganMesh> {
    let mut kidney = blob("left kidney", [-80.0, 15.0, 640.0], 5);
    kidney.color = [0.4, 0.2, 0.9];
    vec![blob("liver", [60.0, -20.0, 700.0], 9), kidney]
}

#[test]
fn organs_come_back_exactly_with_normals_and_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my organs.obj");
    write_obj(&path, &organs()).unwrap();
    let found = MeshFormat::Obj.read(&path).unwrap();
    assert_eq!(found.len(), 2);
    assert_eq!(found[1].name, "left_kidney", "names are words");
    for (found, expected) in found.iter().zip(organs()) {
        assert_eq!(found.mesh.positions, expected.mesh.positions);
        assert_eq!(found.mesh.triangles, expected.mesh.triangles);
        assert_eq!(found.mesh.normals, expected.mesh.normals);
        assert!(near(&found.mesh.colors, &expected.mesh.colors, 0.0, 0.005));
        assert!(near(&[found.color], &[expected.color], 0.0, 0.005));
    }
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("# unit mm; patient space RAS+") && text.contains("mtllib my_organs.mtl"));
    let library = fs::read_to_string(folder.path().join("my_organs.mtl")).unwrap();
    assert_eq!(library.matches("newmtl ").count(), 2);
}

#[test]
fn what_an_organ_lacks_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.obj");
    let mut organs = organs();
    organs[0].mesh.normals.clear();
    organs[1].mesh.colors.clear();
    write_obj(&path, &organs).unwrap();
    fs::remove_file(folder.path().join("m.mtl")).unwrap();
    let found = read_obj(&path).unwrap();
    assert!(found.iter().all(|organ| organ.mesh.colors.is_empty()));
    assert!(found[0].mesh.normals.is_empty());
    assert_eq!(found[1].mesh.normals, organs[1].mesh.normals, "numbered apart from the vertices");
}

#[test]
fn files_of_other_programs_are_read_and_wrong_ones_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.obj");
    let text = "# other\r\nmtllib ../gone.mtl\r\nv 0 0 0\r\nv 1 0 0 1.0\r\nv 0 1.5 0\r\nv 9 9 9\r\nvt 0 0\r\ns off\r\n\
                f 1/1 2/1 3/1\r\ng second\r\nf -4 -3 -1\r\nl 1 2\r\n";
    fs::write(&path, text).unwrap();
    let found = read_obj(&path).unwrap();
    assert_eq!((found[0].name.as_str(), found[1].name.as_str()), ("other", "second"));
    assert_eq!(found[0].mesh.positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.5, 0.0]]);
    assert_eq!((found[1].mesh.positions[2], &found[1].mesh.triangles), ([9.0; 3], &vec![[0, 1, 2]]));
    for (from, to, part) in [
        ("f 1/1 2/1 3/1", "f 1 2 3 4", "line 9: a face of 4 corners"),
        ("f -4 -3 -1", "f 1 2 9", "line 11: a face uses vertex 9 of 4"),
        ("f -4 -3 -1", "f 0 1 2", "vertex 0 of 4"),
        ("f -4 -3 -1", "f -9 1 2", "vertex -9 of 4"),
        ("f -4 -3 -1", "f -9223372036854775808 1 2", "of 4"),
        ("f -4 -3 -1", "f 1//1 2//2 3//3", "normal 1 of 0"),
        ("v 0 1.5 0", "v 0 nan 0", "'nan' is no finite number"),
        ("v 0 1.5 0", "v 0 1.5", "a vertex of 2 numbers"),
    ] {
        fs::write(&path, text.replace(from, to)).unwrap();
        let message = read_obj(&path).unwrap_err().to_string();
        assert!(message.contains("other.obj") && message.contains(part), "{message}");
    }
    fs::write(&path, "v 0 0 0\n").unwrap();
    assert!(read_obj(&path).unwrap_err().to_string().contains("no face"));
}
