//! Sums over square windows, row by row.

use crate::image::View;

/// Writes the sums of `value` of a channel's pixels over the windows around the pixels of row `y`, as far as they lie inside
/// the image. `columns` is scratch.
#[inline(always)]
pub fn box_sums(
    image: View,
    channel: usize,
    y: usize,
    radius: usize,
    value: impl Fn(f32) -> f32,
    columns: &mut Vec<f32>,
    sums: &mut [f32],
) {
    let (height, width) = (image.size.height, image.size.width);
    columns.clear();
    columns.resize(width, 0.0);
    for y in y.saturating_sub(radius)..height.min(y + radius + 1) {
        for (column, &pixel) in columns.iter_mut().zip(image.row(channel, y)) {
            *column += value(pixel);
        }
    }
    sums.copy_from_slice(columns);
    for right in 1..width.min(radius + 1) {
        for (sum, column) in sums.iter_mut().zip(&columns[right..]) {
            *sum += column;
        }
        for (sum, column) in sums[right..].iter_mut().zip(&*columns) {
            *sum += column;
        }
    }
}
