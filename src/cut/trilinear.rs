//! The trilinear map of a cell with eight corners, x fastest, and its inverse.

use crate::geometry::{Matrix3, Vector3};

/// How far beyond a cell its map is followed [cells]. The skin of an organ whose voxels are particles lies up to a diagonal
/// beyond the last cell.
pub(super) const REACH: f64 = 2.0;

/// How far local coordinates lie outside their cell.
pub(super) fn outside(local: &Vector3) -> f64 {
    local.iter().map(|&x| (-x).max(x - 1.0)).fold(f64::MIN, f64::max)
}

/// Local coordinates of a place in a cell of these corners, by Newton's method on the trilinear map; `None` where the cell is too
/// deformed for it.
pub(super) fn local(corners: &[Vector3; 8], place: Vector3) -> Option<Vector3> {
    const STEPS: usize = 12;
    let size = (corners[7] - corners[0]).norm();
    let mut local = Vector3::repeat(0.5);
    for _ in 0..STEPS {
        let (value, gradient) = trilinear(corners, local);
        let error = place - value;
        if error.norm() <= 1e-9 * size {
            return Some(local);
        }
        local += gradient.try_inverse()? * error;
        // Beyond this the map is not the cell's any more.
        local = local.map(|x| x.clamp(-1.0 - REACH, 2.0 + REACH));
    }
    None
}

/// Value and gradient of the trilinear map.
fn trilinear(corners: &[Vector3; 8], local: Vector3) -> (Vector3, Matrix3) {
    let (mut value, mut gradient) = (Vector3::zeros(), Matrix3::zeros());
    let weights = [0, 1, 2].map(|axis| [1.0 - local[axis], local[axis]]);
    for (corner, place) in corners.iter().enumerate() {
        let up = [corner & 1, corner >> 1 & 1, corner >> 2];
        let [x, y, z] = [weights[0][up[0]], weights[1][up[1]], weights[2][up[2]]];
        let slope = up.map(|up| if up == 1 { 1.0 } else { -1.0 });
        let weight = x * y * z;
        let row = [slope[0] * y * z, x * slope[1] * z, x * y * slope[2]];
        for axis in 0..3 {
            value[axis] += place[axis] * weight;
            for (column, part) in row.into_iter().enumerate() {
                gradient[(axis, column)] += place[axis] * part;
            }
        }
    }
    (value, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deformed_cell_is_inverted() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.9, 2.0).into_inner();
        let shape = |x: Vector3| turn * (x + Vector3::new(0.1 * x.y * x.z, 0.3 * x.x, -0.2 * x.x * x.y));
        let places: [Vector3; 8] =
            std::array::from_fn(|corner| shape(Vector3::from([0, 1, 2].map(|axis| (corner >> axis & 1) as f64))));
        for expected in [Vector3::new(0.1, 0.7, 0.4), Vector3::new(1.3, 0.2, -0.1)] {
            let found = local(&places, trilinear(&places, expected).0).unwrap();
            assert!((found - expected).norm() < 1e-8, "{found}");
            assert!((outside(&found) - (expected.x - 1.0).max(-0.1)).abs() < 1e-8);
        }
        assert_eq!(local(&[Vector3::zeros(); 8], Vector3::x()), None, "a cell pressed to a point");
    }
}
