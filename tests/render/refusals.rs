//! What cannot be drawn is refused with what was found; what is odd but whole is drawn.

use yawara::render::camera::{Direction, Framing, Lens};
use yawara::render::{ClipPlane, Look, RenderError, render};
use yawara::surface::mesh::{OrganMesh, TriangleMesh};

use crate::bodies::{RED, ball, bare, camera, coverage, organ, plate};

#[track_caller]
fn refused(organs: &[OrganMesh], look: &Look, parts: &[&str]) {
    let around = [organ(RED, plate(0.0, 10.0))];
    let camera = camera(&around, Direction::ANTERIOR, &Lens::default(), [64, 64]);
    let message = render(organs, &camera, look).unwrap_err().to_string();
    for part in parts {
        assert!(message.contains(part), "'{message}' lacks '{part}'");
    }
}

#[test]
fn meshes_that_are_not_whole_are_refused() {
    let with = |change: fn(&mut TriangleMesh)| {
        let mut mesh = plate(0.0, 10.0);
        change(&mut mesh);
        [organ(RED, mesh)]
    };
    refused(&[], &bare(), &["nothing to draw"]);
    refused(&[organ(RED, TriangleMesh::default())], &bare(), &["nothing to draw"]);
    refused(&with(|mesh| mesh.positions[2][1] = f32::NAN), &bare(), &["`body`", "vertex 2", "NaN"]);
    refused(&with(|mesh| mesh.positions[0][0] = f32::INFINITY), &bare(), &["vertex 0", "inf"]);
    refused(&with(|mesh| mesh.triangles[1][2] = 4), &bare(), &["triangle 1", "vertex 4", "4"]);
    refused(&with(|mesh| mesh.normals = vec![[0.0; 3]; 3]), &bare(), &["3 normals", "expected 4"]);
    refused(&with(|mesh| mesh.colors = vec![[0.0; 3]; 5]), &bare(), &["5 colours", "expected 4"]);
    refused(&with(|mesh| mesh.colors = vec![[0.0, f32::NAN, 0.0]; 4]), &bare(), &["colour 0", "NaN"]);
    for (point, normal) in [([0.0; 3], [0.0; 3]), ([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0])] {
        let look = Look { clip: Some(ClipPlane { point, normal }), ..bare() };
        refused(&[organ(RED, plate(0.0, 10.0))], &look, &["clip plane", &format!("{point:?}"), &format!("{normal:?}")]);
    }
}

#[test]
fn cameras_that_cannot_be_are_refused() {
    for size in [[0, 100], [15, 15], [8193, 16], [8192, 8192], [u32::MAX, u32::MAX]] {
        let error = Framing::new(Direction::ANTERIOR, size).unwrap_err();
        assert_eq!(error, RenderError::Size { width: size[0], height: size[1] });
        assert!(error.to_string().contains(&format!("{} x {}", size[0], size[1])));
    }
    let turned = Framing::new(Direction { azimuth: f64::NAN, elevation: 0.0 }, [64, 64]).unwrap_err().to_string();
    assert!(turned.contains("azimuth is NaN"), "{turned}");
    let mut framing = Framing::new(Direction::LEFT, [64, 64]).unwrap();
    assert_eq!(framing.camera(&Lens::default()).unwrap_err(), RenderError::Empty);
    framing.include(&[organ(RED, plate(0.0, 10.0))]);
    for zoom in [0.0, -1.0, 51.0, f64::NAN, f64::INFINITY] {
        let message = framing.camera(&Lens { zoom, ..Lens::default() }).unwrap_err().to_string();
        assert!(message.contains(&format!("zoom is {zoom}")) && message.contains("0.02 to 50"), "{message}");
    }
    let center = Some([0.0, f64::INFINITY, 0.0]);
    let message = framing.camera(&Lens { center, ..Lens::default() }).unwrap_err().to_string();
    assert!(message.contains("center is inf"), "{message}");
}

/// Sizes and places that f32 barely holds, flat triangles, triangles without area, vertices at one point.
#[test]
fn odd_meshes_are_drawn() {
    let alone = |mesh: TriangleMesh, lens: &Lens| {
        let organs = [organ(RED, mesh)];
        let camera = camera(&organs, Direction::THREE_QUARTER, lens, [64, 64]);
        let clip = Some(ClipPlane { point: [0.0; 3], normal: [1.0, 0.2, 0.1] });
        render(&organs, &camera, &Look { clip, occlusion: true, ..bare() }).unwrap();
        coverage(&render(&organs, &camera, &bare()).unwrap())
    };
    let expected = alone(ball([0.0; 3], 30.0, 20), &Lens::default());
    for (scale, shift) in [(1e-30, 0.0), (1e30, 0.0), (1.0, 1e6), (1e-3, 0.0)] {
        let mut mesh = ball([0.0; 3], 30.0 * scale, 20);
        mesh.positions.iter_mut().for_each(|position| position[0] += shift);
        let found = alone(mesh, &Lens::default());
        assert!((found / expected - 1.0).abs() < 0.02, "{scale} {shift}: {found} for {expected}");
    }
    let mut flat = plate(0.0, 10.0);
    flat.triangles.extend([[0, 0, 1], [2, 2, 2]]);
    assert!(alone(flat.clone(), &Lens::default()) > 100.0);
    flat.positions.fill([3.0, 4.0, 5.0]);
    assert_eq!(alone(flat, &Lens::default()), 0.0, "a point covers nothing");
    // Nearly everything is off the picture, or in one pixel.
    for zoom in [0.02, 50.0] {
        for center in [None, Some([29.0, 0.0, 0.0]), Some([500.0, 400.0, 0.0]), Some([0.0, -1e6, 0.0])] {
            alone(ball([0.0; 3], 30.0, 20), &Lens { zoom, center, orthographic: false });
        }
    }
}
