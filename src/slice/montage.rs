//! Several pictures in one.

use image::{GenericImage, Rgb, RgbImage};

/// Between the panels [px].
const GAP: u32 = 4;
const BETWEEN: Rgb<u8> = Rgb([70, 70, 70]);

/// Puts pictures side by side, row by row, each in the upper left of a panel as large as the largest; `None` without pictures
/// or columns, or when the whole would be more than 2^32 - 1 pixels wide or high.
pub fn montage(pictures: &[RgbImage], columns: usize) -> Option<RgbImage> {
    let columns = columns.min(pictures.len());
    let largest = |size: fn(&RgbImage) -> u32| pictures.iter().map(size).max();
    let (width, height) = (largest(RgbImage::width)?, largest(RgbImage::height)?);
    let side = |count: usize, panel: u32| {
        let count = u32::try_from(count).ok()?;
        count.checked_mul(panel.checked_add(GAP)?)?.checked_sub(GAP)
    };
    let rows = pictures.len().checked_div(columns)? + usize::from(!pictures.len().is_multiple_of(columns));
    let mut whole = RgbImage::from_pixel(side(columns, width)?, side(rows, height)?, BETWEEN);
    for (at, picture) in pictures.iter().enumerate() {
        let (column, row) = ((at % columns) as u32, (at / columns) as u32);
        whole.copy_from(picture, column * (width + GAP), row * (height + GAP)).ok()?;
    }
    Some(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_run_row_by_row() {
        let panel = |shade: u8, width| RgbImage::from_pixel(width, 3, Rgb([shade; 3]));
        let pictures: Vec<RgbImage> = (1..=5).map(|shade| panel(shade, 4 + u32::from(shade == 2))).collect();
        let whole = montage(&pictures, 3).unwrap();
        assert_eq!(whole.dimensions(), (3 * 5 + 2 * GAP, 2 * 3 + GAP));
        let at = |column: u32, row: u32| whole.get_pixel(column * (5 + GAP), row * (3 + GAP))[0];
        assert_eq!([at(0, 0), at(1, 0), at(2, 0), at(0, 1), at(1, 1)], [1, 2, 3, 4, 5]);
        assert_eq!(*whole.get_pixel(whole.width() - 1, whole.height() - 1), BETWEEN);
        assert_eq!(montage(&pictures, 40).unwrap().width(), 5 * 5 + 4 * GAP);
        assert!(montage(&[], 2).is_none() && montage(&pictures, 0).is_none());
    }
}
