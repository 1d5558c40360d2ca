//! Where a cut meets the skin: the outline of either face of a flat cut through a ball is a circle.

use std::collections::HashMap;

use yawara::geometry::{Point3, Vector3};

use crate::bodies::{RADIUS, ball, cut, fine_ball, middle, surface};

/// Spacing of the drawn body [mm].
const SPACING: f64 = 0.8;

/// What counts as a tooth [spacings].
const FAR: f64 = 0.2;

/// How far the outline of the faces of a flat cut lies from the circle, for every vertex of it [spacings].
fn outline_errors(normal: Vector3, offset: f64) -> Vec<f64> {
    let normal = normal.normalize();
    let mut world = ball(true);
    let edge = normal.cross(&Vector3::new(0.2, -0.5, 1.0)).normalize();
    assert!(cut(&mut world, normal * offset, edge, normal.cross(&edge), 30.0) > 0);
    let surface = surface(&world, &fine_ball(SPACING));
    let place = |vertex: u32| Point3::from(surface.rest_places()[vertex as usize]) - middle();
    let on_blade = |vertex: u32| (place(vertex).dot(&normal) - offset).abs() < 0.03 * SPACING;
    // Edges of triangles in the face of the cut, against those of the others.
    let mut sides: HashMap<(u32, u32), (usize, usize)> = HashMap::new();
    for &[a, b, c] in surface.triangles() {
        let flat = [a, b, c].into_iter().all(on_blade);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let count = sides.entry((from.min(to), from.max(to))).or_default();
            if flat { count.0 += 1 } else { count.1 += 1 }
        }
    }
    let rim = sides.iter().filter(|(_, count)| **count == (1, 1)).map(|(edge, _)| *edge);
    let radius = (RADIUS.powi(2) - offset.powi(2)).sqrt();
    let off = |vertex: u32| {
        let place = place(vertex);
        ((place - normal * place.dot(&normal)).norm() - radius) / SPACING
    };
    let mut errors: Vec<f64> = rim.flat_map(|(a, b)| [off(a), off(b)]).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

#[test]
fn faces_of_a_flat_cut_end_where_the_skin_does() {
    // Across an axis of the grid, where the skin is shallow and where it is steep, and slanting, where blade and skin leave some
    // places without room: without a tooth.
    for (normal, offset, most) in [
        (Vector3::x(), 0.4, 0.02),
        (Vector3::x(), 0.9, 0.02),
        (Vector3::x(), 5.1, 0.05),
        (Vector3::x(), -7.77, 0.08),
        (Vector3::new(1.0, 0.6, -0.3), 0.4, 0.02),
        (Vector3::new(0.1, 1.0, 0.2), -5.0, 0.02),
    ] {
        let errors = outline_errors(normal, offset);
        let rms = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
        let far = errors.iter().filter(|error| error.abs() > FAR).count() as f64 / errors.len() as f64;
        println!(
            "across {:?} at {offset} mm: {} places of the rims, off the circle by {rms:.3} spacings (rms), {:.3} inward and {:.3} \
             outward at most, {:.1} % by more than {FAR}",
            normal.as_slice(),
            errors.len(),
            -errors[0],
            errors[errors.len() - 1],
            100.0 * far
        );
        assert!(errors.len() > 200);
        assert!(rms < most && far == 0.0, "teeth in the rim: {rms}, {far}");
    }
}
