//! The median of numbers.

/// A number with a total order.
pub trait TotalOrder: Copy {
    /// Compares by the total order of the IEEE standard, in which NaN is the largest.
    fn order(&self, other: &Self) -> std::cmp::Ordering;
}

impl TotalOrder for f64 {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for f32 {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        self.total_cmp(other)
    }
}

/// The median of these values, which are reordered; for an even count the larger of the two in the middle. `None`
/// if there are no values.
pub fn median<T: TotalOrder>(values: &mut [T]) -> Option<T> {
    let middle = values.len() / 2;
    (middle < values.len()).then(|| *values.select_nth_unstable_by(middle, T::order).1)
}

/// The median of these values, which are reordered; for an even count the mean of the two in the middle. `None` if
/// there are no values.
pub fn median_in_place(values: &mut [f64]) -> Option<f64> {
    let is_odd = values.len() % 2 == 1;
    let middle = values.len() / 2;
    let high = median(values)?;
    let low = values[..middle].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Some(if is_odd { high } else { (low + high) / 2.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle_one_or_the_larger_of_two() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0_f32, 1.0, 3.0, 2.0]), Some(3.0));
        assert_eq!(median::<f64>(&mut []), None);
    }

    #[test]
    fn the_median_between_two_is_their_mean() {
        assert_eq!(median_in_place(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median_in_place(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(median_in_place(&mut []), None);
    }
}
