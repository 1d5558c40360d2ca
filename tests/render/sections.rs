//! Clip planes and what fills them.

use std::collections::HashMap;

use image::{Rgba, RgbaImage};
use yawara::render::camera::{Direction, Lens};
use yawara::render::{ClipPlane, Look, render};
use yawara::surface::mesh::OrganMesh;

use crate::bodies::{GREEN, RED, ball, bare, camera, organ};

const SIZE: [u32; 2] = [240, 240];

fn clipped(organs: &[OrganMesh], direction: Direction, orthographic: bool, clip: ClipPlane) -> (RgbaImage, f64) {
    let camera = camera(organs, direction, &Lens { orthographic, ..Lens::default() }, SIZE);
    (render(organs, &camera, &Look { clip: Some(clip), ..bare() }).unwrap(), camera.pixel_mm())
}

/// The colour that most pixels have, and how many: sections are the only flat thing on a ball.
fn flat(picture: &RgbaImage) -> (Rgba<u8>, usize) {
    let mut counts = HashMap::new();
    picture.pixels().filter(|pixel| pixel[3] == 255).for_each(|&pixel| *counts.entry(pixel).or_insert(0) += 1);
    counts.into_iter().max_by_key(|&(_, count)| count).unwrap()
}

/// A ball of 30 mm cut at 10 mm from its middle shows a disc of 30^2 - 10^2 mm^2 times pi, whichever half is kept.
#[test]
fn sections_are_filled_and_have_the_right_size() {
    let organs = [organ(RED, ball([5.0, 60.0, 700.0], 30.0, 90))];
    for orthographic in [false, true] {
        for (direction, towards) in [
            (Direction::ANTERIOR, [0.0, 1.0, 0.0]),
            (Direction::POSTERIOR, [0.0, -1.0, 0.0]),
            (Direction::RIGHT, [1.0, 0.0, 0.0]),
            (Direction::INFERIOR, [0.0, 0.0, -1.0]),
        ] {
            for shift in [-10.0, 10.0] {
                let point = [0, 1, 2].map(|axis| [5.0, 60.0, 700.0][axis] + shift * towards[axis]);
                let (picture, pixel_mm) =
                    clipped(&organs, direction, orthographic, ClipPlane { point, normal: towards });
                let (_, count) = flat(&picture);
                let expected = std::f64::consts::PI * 800.0 / pixel_mm.powi(2);
                let share = count as f64 / expected;
                // The outline takes two pixels all round, perspective makes what is nearer larger.
                let allowed = if orthographic { 0.93..0.99 } else { 0.78..1.12 };
                assert!(allowed.contains(&share), "{direction:?}, {orthographic}, {shift}: {share}");
            }
        }
    }
}

#[test]
fn the_outline_of_a_section_is_dark() {
    let organs = [organ(RED, ball([0.0; 3], 30.0, 90))];
    let (picture, _) =
        clipped(&organs, Direction::ANTERIOR, true, ClipPlane { point: [0.0; 3], normal: [0.0, 1.0, 0.0] });
    let (section, _) = flat(&picture);
    let row: Vec<Rgba<u8>> = (0..120).map(|x| *picture.get_pixel(x, 120)).filter(|pixel| pixel[3] == 255).collect();
    assert!(
        row[..2].iter().any(|pixel| f64::from(pixel[0]) < 0.75 * f64::from(section[0])),
        "{:?} {section:?}",
        &row[..2]
    );
    assert!(row[8..].iter().all(|pixel| *pixel == section));
}

#[test]
fn what_lies_behind_the_plane_stays_and_what_lies_before_it_goes() {
    let organs = [organ(RED, ball([0.0, -40.0, 0.0], 20.0, 30)), organ(GREEN, ball([0.0, 40.0, 0.0], 20.0, 30))];
    let plane = ClipPlane { point: [0.0; 3], normal: [0.0, 3.0, 0.0] };
    let (picture, _) = clipped(&organs, Direction::ANTERIOR, false, plane);
    assert!(picture.pixels().all(|pixel| pixel[3] == 0 || pixel[0] > pixel[1]), "nothing green is left");
    assert!(picture.get_pixel(120, 120)[3] == 255);
    // Without a section there is nothing flat.
    assert!(flat(&picture).1 < 600);
}

/// A section is no place to look through: what is inside another body, behind the plane, is hidden.
#[test]
fn sections_hide_what_is_behind_them() {
    let organs = [organ(GREEN, ball([0.0, -8.0, 0.0], 5.0, 30)), organ(RED, ball([0.0; 3], 30.0, 60))];
    let plane = ClipPlane { point: [0.0; 3], normal: [0.0, 1.0, 0.0] };
    let (picture, _) = clipped(&organs, Direction::ANTERIOR, false, plane);
    assert!(picture.pixels().all(|pixel| pixel[3] == 0 || pixel[0] > pixel[1]));
}

/// An open mesh has no inside: where rays pass through its hole no section is drawn, and elsewhere no stripe is.
#[test]
fn open_meshes_show_their_inside() {
    let mut body = organ([0.3; 3], ball([0.0; 3], 30.0, 60));
    // Without its back half every ray that enters from the front does not leave.
    body.mesh.triangles.retain(|triangle| triangle.iter().any(|&v| body.mesh.positions[v as usize][1] > -1.0));
    let plane = ClipPlane { point: [0.0, 20.0, 0.0], normal: [0.0, 1.0, 0.0] };
    let camera = camera(&[body.clone()], Direction::ANTERIOR, &Lens::default(), SIZE);
    let picture = render(&[body], &camera, &Look { clip: Some(plane), ..bare() }).unwrap();
    assert_eq!(picture.get_pixel(120, 120)[3], 0, "one looks through it");
}
