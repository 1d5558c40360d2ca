//! How surfaces are lit and coloured.

use yawara::render::camera::{Direction, Lens};
use yawara::render::{Background, Lines, Look, render};
use yawara::surface::mesh::Finish;

use crate::bodies::{GREEN, RED, ball, bare, camera, coverage, middle_of, organ, picture, plate};

/// Brightness of a dry ball falls steadily from where the key light meets it (upper left) to where it does not.
#[test]
fn brightness_falls_away_from_the_light() {
    let picture = picture(&[organ([0.3; 3], ball([0.0; 3], 30.0, 90))], Direction::ANTERIOR);
    // The ball's radius is 105 pixels; the key light stands over about (-0.44, 0.59) of it.
    let along: Vec<u8> = (0..14)
        .map(|step| {
            let share = -0.6 + 0.1 * f64::from(step);
            let place = [120.0 + share * 0.6 * 105.0, 120.0 + share * 0.8 * 105.0].map(|at| at as u32);
            picture.get_pixel(place[0], place[1])[1]
        })
        .collect();
    assert!(along.windows(2).all(|pair| pair[0] >= pair[1]), "{along:?}");
    assert!(along[0] > along[13] + 60 && along[13] > 20, "{along:?}");
}

#[test]
fn wet_surfaces_shine_and_dry_ones_do_not() {
    let brightest = |finish: Finish| {
        let mut body = organ(RED, ball([0.0; 3], 30.0, 60));
        body.finish = finish;
        picture(&[body], Direction::ANTERIOR).pixels().map(|pixel| pixel[2]).max().unwrap()
    };
    assert!(brightest(Finish::Wet) > brightest(Finish::Dry) + 40);
}

#[test]
fn colours_of_vertices_win_over_that_of_the_organ() {
    let mut body = organ(RED, plate(0.0, 20.0));
    body.mesh.colors = vec![GREEN, GREEN, RED, RED];
    let picture = picture(&[body], Direction::ANTERIOR);
    let ((green, many), (red, _)) = (middle_of(&picture, 1, 0), middle_of(&picture, 0, 1));
    assert!(many > 1000 && green[1] > 140.0 && red[1] < 100.0, "green is below: {green:?} {red:?}");
}

#[test]
fn the_inside_is_darker_but_not_black() {
    let body = [organ([0.3; 3], plate(0.0, 20.0))];
    let at = |direction| picture(&body, direction).get_pixel(120, 120)[1];
    let (front, inside) = (at(Direction::ANTERIOR), at(Direction::POSTERIOR));
    assert!(inside > 40 && inside < front - 40, "{front} {inside}");
}

/// In the corner of a step there is less light than on its open faces, and only with occlusion.
#[test]
fn creases_are_darker() {
    let mut wall = plate(0.0, 40.0);
    // A floor that meets the wall along its lower edge.
    wall.positions.extend([[40.0, 60.0, -40.0], [-40.0, 60.0, -40.0]]);
    wall.triangles.extend([[4, 5, 1], [4, 1, 0]]);
    let body = [organ([0.3; 3], yawara::render::normals::creased(&wall, 40.0))];
    let direction = Direction { azimuth: 0.0, elevation: 35.0 };
    let camera = camera(&body, direction, &Lens::default(), [240, 240]);
    let brightness = |occlusion| {
        let picture = render(&body, &camera, &Look { occlusion, ..bare() }).unwrap();
        // Down the middle, the wall's darkest and brightest pixels.
        let column: Vec<u8> =
            (0..240).map(|y| *picture.get_pixel(120, y)).filter(|p| p[3] == 255).map(|p| p[1]).collect();
        (column[4..column.len() / 2].to_vec(), column)
    };
    let (open, all_open) = brightness(false);
    let (shaded, all_shaded) = brightness(true);
    assert_eq!(open.iter().max(), shaded.iter().max(), "far from the crease nothing changes");
    let least = |column: &[u8]| *column.iter().min().unwrap();
    assert!(least(&all_shaded) + 12 < least(&all_open), "{} {}", least(&all_shaded), least(&all_open));
}

#[test]
fn backgrounds_are_what_was_asked_for() {
    let body = [organ(RED, ball([0.0; 3], 30.0, 24))];
    let camera = camera(&body, Direction::LEFT, &Lens::default(), [64, 64]);
    let corner = |background| *render(&body, &camera, &Look { background, ..bare() }).unwrap().get_pixel(0, 0);
    assert_eq!(corner(Background::Plain([1.0; 3])).0, [255; 4]);
    assert_eq!(corner(Background::Plain([0.0, 0.215_860_5, 0.0])).0, [0, 128, 0, 255]);
    assert_eq!(corner(Background::Transparent).0, [0; 4]);
    let gradient = render(&body, &camera, &Look { background: Background::Gradient, ..bare() }).unwrap();
    assert!(gradient.get_pixel(0, 0)[0] > gradient.get_pixel(0, 63)[0] + 20);
}

#[test]
fn wireframes_have_lines_and_hide_what_is_behind() {
    let body = [organ([0.3; 3], ball([0.0; 3], 30.0, 10))];
    let camera = camera(&body, Direction::THREE_QUARTER, &Lens::default(), [240, 240]);
    let draw = |lines| render(&body, &camera, &Look { lines, ..bare() }).unwrap();
    let (plain, lines) = (draw(Lines::None), draw(Lines::Triangles));
    assert_eq!(coverage(&plain), coverage(&lines));
    let darker = plain.pixels().zip(lines.pixels()).filter(|(plain, lines)| plain[1] > lines[1] + 30).count();
    // Some 5000 pixels of rings, columns and diagonals on its near side; with the far side there would be twice as many.
    assert!((1500..9000).contains(&darker), "{darker}");
}
