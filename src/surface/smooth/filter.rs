//! Separable filters over a grid: symmetric taps along x, y and z.

use rayon::prelude::*;

use crate::geometry::GridShape;

/// Filters a field along every axis; `taps` holds the middle tap and those on one side, `beyond` is the value outside the grid.
///
/// # Panics
/// If there is not one value per grid point.
pub(super) fn filtered(shape: GridShape, field: &[f32], taps: &[f32], beyond: f32) -> Vec<f32> {
    assert_eq!(field.len(), shape.len(), "one value per grid point");
    let GridShape { nx, ny, .. } = shape;
    let layer = nx * ny;
    if field.is_empty() {
        return Vec::new();
    }
    let outside = vec![beyond; layer];
    let mut flat = vec![0.0; field.len()];
    flat.par_chunks_mut(layer).zip(field.par_chunks(layer)).for_each(|(out, source)| {
        let reach = taps.len() - 1;
        let mut padded = vec![beyond; nx + 2 * reach];
        let mut along_x = vec![0.0; layer];
        for (out, source) in along_x.chunks_mut(nx).zip(source.chunks(nx)) {
            padded[reach..reach + nx].copy_from_slice(source);
            weigh(out, taps, |offset| &padded[reach.wrapping_add_signed(offset)..][..nx]);
        }
        for (j, out) in out.chunks_mut(nx).enumerate() {
            weigh(out, taps, |offset| along_x.chunks(nx).nth(j.wrapping_add_signed(offset)).unwrap_or(&outside[..nx]));
        }
    });
    let mut result = vec![0.0; field.len()];
    result.par_chunks_mut(layer).enumerate().for_each(|(k, out)| {
        weigh(out, taps, |offset| flat.chunks(layer).nth(k.wrapping_add_signed(offset)).unwrap_or(&outside));
    });
    result
}

/// The sum of rows at offsets from a row, each times its tap.
fn weigh<'a>(out: &mut [f32], taps: &[f32], row: impl Fn(isize) -> &'a [f32]) {
    for (out, here) in out.iter_mut().zip(row(0)) {
        *out = taps[0] * here;
    }
    for (offset, &tap) in (1..).zip(&taps[1..]) {
        for ((out, before), after) in out.iter_mut().zip(row(-offset)).zip(row(offset)) {
            *out += tap * (before + after);
        }
    }
}

/// Curvature of the level sets of a field, times the length of its gradient: the second differences along the level set. Zero
/// where the gradient is less than `flat`, and at the border of the grid.
///
/// Blurring with second moment s^2 along each axis moves every level set by s^2/2 of this; subtracting as much moves it back. A filter flat to
/// the fourth order ("twicing") takes back only half of it, since the step at a border holds all frequencies.
pub(super) fn curvature(shape: GridShape, field: &[f32], flat: f32) -> Vec<f32> {
    let GridShape { nx, ny, nz } = shape;
    let steps = [1, nx, nx * ny];
    let at_border = |at: usize| shape.ijk(at).iter().zip([nx, ny, nz]).any(|(&index, n)| index == 0 || index + 1 >= n);
    (0..field.len())
        .into_par_iter()
        .map(|at| {
            if at_border(at) {
                return 0.0;
            }
            let slope = steps.map(|step| 0.5 * (field[at + step] - field[at - step]));
            let bend = steps.map(|step| field[at + step] - 2.0 * field[at] + field[at - step]);
            let twist = |a: usize, b: usize| {
                let (a, b) = (steps[a], steps[b]);
                0.25 * (field[at + a + b] + field[at - a - b] - field[at + a - b] - field[at - a + b])
            };
            let square = slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2];
            if square.is_nan() || square < flat * flat {
                return 0.0;
            }
            let across = slope[0] * slope[0] * bend[0]
                + slope[1] * slope[1] * bend[1]
                + slope[2] * slope[2] * bend[2]
                + 2.0
                    * (slope[0] * slope[1] * twist(0, 1)
                        + slope[0] * slope[2] * twist(0, 2)
                        + slope[1] * slope[2] * twist(1, 2));
            bend[0] + bend[1] + bend[2] - across / square
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filtered_field_is_the_sum_over_all_taps() {
        let shape = GridShape::new(5, 4, 3);
        let taps = [0.5, 0.3, -0.05];
        let beyond = 2.0;
        let field: Vec<f32> = (0..shape.len()).map(|at| ((at * 37) % 11) as f32).collect();
        let found = filtered(shape, &field, &taps, beyond);
        for at in 0..shape.len() {
            let mut expected = 0.0;
            for (dk, dj, di) in (-2..=2).flat_map(|k| (-2..=2).flat_map(move |j| (-2..=2).map(move |i| (k, j, i)))) {
                let weight: f32 = [di, dj, dk].map(|d: i32| taps[d.unsigned_abs() as usize]).iter().product();
                // Beyond the border of one axis all that lies along the others is `beyond`, too.
                let value = shape.neighbour(shape.ijk(at), [di, dj, dk]).map_or(beyond, |other| field[other]);
                expected += weight * value;
            }
            assert!((found[at] - expected).abs() < 1e-4 * (1.0 + beyond), "{at}: {} is not {expected}", found[at]);
        }
    }
}
