//! Which choices are worth their time.

/// Points \[time, error\] that no other point beats: none is as good in one and better in the other. Ascending by time, so
/// descending by error; numbers of the points. Points that are not finite are left out, and of equal points the first stays.
///
/// - `gain`: a slower point has to be better by this share; 0 for the front as it is defined.
pub fn front(points: &[[f64; 2]], gain: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|&n| points[n].iter().all(|x| x.is_finite())).collect();
    order.sort_by(|&a, &b| {
        let [a, b] = [points[a], points[b]];
        a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
    });
    let mut best = f64::INFINITY;
    order.retain(|&n| {
        let better = points[n][1] < best * (1.0 - gain);
        if better {
            best = points[n][1];
        }
        better
    });
    order
}

/// The fastest point with at most this error.
pub fn cheapest(points: &[[f64; 2]], error: f64) -> Option<usize> {
    front(points, 0.0).into_iter().find(|&n| points[n][1] <= error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_of_a_small_table() {
        let table = [[8.0, 1e-3], [1.0, 1e-1], [2.0, 2e-1], [4.0, 1e-2], [4.0, 2e-2], [8.0, 1e-3], [9.0, f64::NAN]];
        assert_eq!(front(&table, 0.0), [1, 3, 0]);
        assert_eq!(front(&[[1.0, 1.0], [2.0, 0.99], [3.0, 0.97], [4.0, 0.5]], 0.02), [0, 2, 3]);
        assert_eq!(cheapest(&table, 0.5), Some(1));
        assert_eq!(cheapest(&table, 0.05), Some(3));
        assert_eq!(cheapest(&table, 1e-3), Some(0));
        assert_eq!(cheapest(&table, 1e-4), None);
        assert!(front(&[], 0.0).is_empty());
    }
}
