//! Whether a place showed enough of its film to be judged, in both models of a film.

/// A pixel that showed nothing in a larger share of the pictures was not seen …
const MOST_UNSEEN: f64 = 0.5;
/// … nor was one that shows nothing for longer than this at the end, s: glints move on sooner, and a break stays.
const MOST_UNSEEN_AT_END_S: f32 = 3.0;

/// Whether a pixel was seen that showed nothing in so many of the pictures with these times, s, and in so many until now.
pub fn was_seen(unseen: u16, unseen_now: u16, times_s: &[f32]) -> bool {
    let Some((last_s, judged)) = times_s.last().zip(times_s.len().checked_sub(1)) else { return true };
    let told_s = times_s[judged.saturating_sub(usize::from(unseen_now))];
    f64::from(unseen) <= MOST_UNSEEN * judged as f64 && last_s - told_s <= MOST_UNSEEN_AT_END_S
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand, pictures every second, the first for the beginning: of ten, five may show nothing, and of those at the end three.
    #[test]
    fn half_of_the_pictures_and_the_last_three_seconds_may_show_nothing() {
        let times_s: Vec<f32> = (0..=10).map(|second| second as f32).collect();
        let seen = |unseen, unseen_now| was_seen(unseen, unseen_now, &times_s);
        assert_eq!([seen(5, 0), seen(6, 0), seen(3, 3), seen(4, 4)], [true, false, true, false]);
        assert!(was_seen(0, 0, &[]));
    }
}
