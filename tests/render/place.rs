//! What is where, and what hides what.

use image::RgbaImage;
use yawara::render::camera::{Direction, Lens};
use yawara::render::render;
use yawara::surface::mesh::TriangleMesh;

use crate::bodies::{GREEN, RED, ball, bare, camera, coverage, middle_of, organ, picture, plate};
use crate::support::Random;

const DIRECTIONS: [Direction; 9] = [
    Direction::ANTERIOR,
    Direction::POSTERIOR,
    Direction::LEFT,
    Direction::RIGHT,
    Direction::SUPERIOR,
    Direction::INFERIOR,
    Direction::THREE_QUARTER,
    Direction::THREE_QUARTER_LEFT,
    Direction::THREE_QUARTER_BELOW,
];

#[test]
fn the_patient_is_the_right_way_round() {
    // Two balls apart along one axis: where the second lies from the first, by direction. The picture's y grows downwards.
    let apart = |axis: usize, direction: Direction| {
        let mut center = [0.0; 3];
        center[axis] = 60.0;
        let organs = [organ(RED, ball([0.0; 3], 15.0, 16)), organ(GREEN, ball(center, 15.0, 16))];
        let picture = picture(&organs, direction);
        let ((from, red), (to, green)) = (middle_of(&picture, 0, 1), middle_of(&picture, 1, 0));
        assert!(red > 500 && green > 500, "{red} {green}");
        [to[0] - from[0], to[1] - from[1]]
    };
    // Right, front and head of the patient, in the directions they must have.
    for (direction, [right, front, head]) in [
        (Direction::ANTERIOR, ["left", "", "up"]),
        (Direction::POSTERIOR, ["right", "", "up"]),
        (Direction::LEFT, ["", "left", "up"]),
        (Direction::RIGHT, ["", "right", "up"]),
        (Direction::SUPERIOR, ["right", "up", ""]),
        (Direction::INFERIOR, ["left", "up", ""]),
    ] {
        for (axis, expected) in [right, front, head].into_iter().enumerate().filter(|(_, side)| !side.is_empty()) {
            let [x, y] = apart(axis, direction);
            let found = match x.abs() > y.abs() {
                true => ["left", "right"][usize::from(x > 0.0)],
                false => ["up", "down"][usize::from(y > 0.0)],
            };
            assert_eq!(found, expected, "{direction:?}, axis {axis}");
            assert!(x.abs().max(y.abs()) > 50.0 && x.abs().min(y.abs()) < 2.0, "{direction:?}: {x} {y}");
        }
    }
}

#[test]
fn areas_are_true() {
    let organs = [organ(RED, plate(0.0, 40.0))];
    for orthographic in [false, true] {
        let camera = camera(&organs, Direction::ANTERIOR, &Lens { orthographic, ..Lens::default() }, [200, 150]);
        let found = coverage(&render(&organs, &camera, &bare()).unwrap()) * camera.pixel_mm().powi(2);
        assert!((found / 6400.0 - 1.0).abs() < 0.003, "{found} mm^2");
    }
}

/// A plate cut into triangles round random points has no gap and no seam: every pixel inside is wholly covered, and along
/// its border coverage is that of the plain plate.
#[test]
fn shared_edges_leave_no_gap() {
    let mut random = Random::new(5);
    let plain = picture(&[organ(RED, plate(0.0, 40.0))], Direction::THREE_QUARTER);
    for _ in 0..20 {
        let cells = 12;
        let mut mesh = TriangleMesh::default();
        let step = 80.0 / cells as f32;
        for row in 0..=cells {
            for column in 0..=cells {
                let inside = (1..cells).contains(&row) && (1..cells).contains(&column);
                let mut shift = || if inside { (random.unit() as f32 - 0.5) * 0.8 * step } else { 0.0 };
                let [x, z] = [40.0 - step * column as f32 + shift(), -40.0 + step * row as f32 + shift()];
                mesh.positions.push([x, 0.0, z]);
            }
        }
        for row in 0..cells {
            for column in 0..cells {
                let at = |row: u32, column: u32| row * (cells + 1) + column;
                let (a, b, c, d) = (at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column));
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        let cut = picture(&[organ(RED, mesh)], Direction::THREE_QUARTER);
        // Corners on the border are rounded to 1/256 pixel, which may move it across a sample.
        let alpha = |picture: &RgbaImage| picture.pixels().map(|pixel| i32::from(pixel[3])).collect::<Vec<_>>();
        let mut differing = 0;
        for (one, other) in alpha(&plain).into_iter().zip(alpha(&cut)) {
            assert!((one - other).abs() <= 32, "{one} {other}");
            differing += usize::from(one != other);
        }
        assert!(differing < 60, "{differing} pixels of the border differ");
    }
}

#[test]
fn what_is_in_front_hides_what_is_behind_in_any_order() {
    let (front, back) = (organ(RED, plate(10.0, 20.0)), organ(GREEN, plate(-10.0, 20.0)));
    for organs in [[front.clone(), back.clone()], [back, front]] {
        for (direction, seen, hidden) in [(Direction::ANTERIOR, 0, 1), (Direction::POSTERIOR, 1, 0)] {
            let middle = *picture(&organs, direction).get_pixel(120, 120);
            assert!(middle[3] == 255 && middle[seen] > 2 * middle[hidden], "{direction:?}: {middle:?}");
        }
    }
}

#[test]
fn framing_shows_all_of_it_as_large_as_it_can_be() {
    let organs = [organ(RED, ball([10.0, 200.0, 900.0], 30.0, 24)), organ(GREEN, ball([90.0, 150.0, 960.0], 12.0, 24))];
    for direction in DIRECTIONS {
        for orthographic in [false, true] {
            let lens = Lens { orthographic, ..Lens::default() };
            let picture = render(&organs, &camera(&organs, direction, &lens, [320, 200]), &bare()).unwrap();
            let seen: Vec<_> = picture.enumerate_pixels().filter(|(.., pixel)| pixel[3] > 0).collect();
            let range = |place: fn(&(u32, u32, &image::Rgba<u8>)) -> u32| {
                let places = || seen.iter().map(place);
                [places().min().unwrap(), places().max().unwrap()]
            };
            let ([left, right], [top, bottom]) = (range(|pixel| pixel.0), range(|pixel| pixel.1));
            assert!(left > 0 && right < 319 && top > 0 && bottom < 199, "{direction:?}");
            let filled = (f64::from(right - left) / 320.0).max(f64::from(bottom - top) / 200.0);
            assert!((0.84..0.90).contains(&filled), "{direction:?}, {orthographic}: {filled}");
            // In the middle, within the rounding of pixels.
            let off = [(left + right).abs_diff(319), (top + bottom).abs_diff(199)];
            assert!(off[0].min(off[1]) <= 4, "{direction:?}, {orthographic}: {off:?}");
        }
    }
    let zoomed = camera(&organs, Direction::LEFT, &Lens { zoom: 3.0, ..Lens::default() }, [320, 200]);
    let whole = camera(&organs, Direction::LEFT, &Lens::default(), [320, 200]);
    assert!((whole.pixel_mm() / zoomed.pixel_mm() - 3.0).abs() < 1e-9);
}

#[test]
fn a_centre_is_in_the_middle_of_the_picture() {
    let organs = [organ(RED, ball([0.0; 3], 30.0, 24)), organ(GREEN, ball([45.0, 0.0, 30.0], 4.0, 24))];
    let lens = Lens { center: Some([45.0, 0.0, 30.0]), zoom: 4.0, ..Lens::default() };
    let camera = camera(&organs, Direction::THREE_QUARTER, &lens, [240, 240]);
    let (middle, count) = middle_of(&render(&organs, &camera, &bare()).unwrap(), 1, 0);
    assert!(count > 200 && middle.iter().all(|x| (x - 120.0).abs() < 1.0), "{count} {middle:?}");
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let organs = [organ(RED, ball([0.0; 3], 30.0, 120)), organ(GREEN, ball([20.0, 30.0, 10.0], 18.0, 60))];
    let camera = camera(&organs, Direction::THREE_QUARTER, &Lens::default(), [333, 217]);
    let clip = Some(yawara::render::ClipPlane { point: [0.0; 3], normal: [0.2, 0.1, 1.0] });
    let look = yawara::render::Look { clip, ..Default::default() };
    let draw = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(&organs, &camera, &look).unwrap())
    };
    let one = draw(1);
    assert!(one.pixels().collect::<std::collections::HashSet<_>>().len() > 200, "a picture worth comparing");
    assert!([2, 4].iter().all(|&threads| draw(threads) == one));
}
