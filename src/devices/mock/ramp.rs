//! Speed along a path: acceleration at the allowed rate, constant at the allowed speed, deceleration to a standstill
//! at the end of the path.
//!
//! From speed v, with distance d to the stop, the highest speed from which braking is still possible is √(v²/2 + a d);
//! braking from v needs v²/2a. The unit of length is the caller's: mm on a line, otherwise degrees of the leading
//! axis.

/// The limits for one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    /// Remaining length to the point where the motion must stop.
    pub(super) to_stop: f64,
    /// Highest speed, in units of length per second.
    pub(super) speed: f64,
    /// Acceleration and deceleration per second².
    pub(super) acceleration: f64,
}

/// Returns the distance of a step of `step_s` that starts at `speed`, and the speed at the step's end.
pub(super) fn step(speed: f64, limits: Limits, step_s: f64) -> (f64, f64) {
    let Limits { to_stop, speed: highest, acceleration } = limits;
    let (mut gone, mut now, mut left_s) = (0.0, speed, step_s);
    let change = |gone: &mut f64, now: &mut f64, left_s: &mut f64, target: f64| {
        let rate = acceleration.copysign(target - *now);
        let spent_s = ((target - *now) / rate).min(*left_s);
        *gone += *now * spent_s + 0.5 * rate * spent_s * spent_s;
        *now += rate * spent_s;
        *left_s -= spent_s;
    };
    if now > highest {
        change(&mut gone, &mut now, &mut left_s, highest);
    }
    let peak = (0.5 * now * now + acceleration * (to_stop - gone).max(0.0)).sqrt().min(highest);
    if peak > now {
        change(&mut gone, &mut now, &mut left_s, peak);
    }
    let level = to_stop - gone - 0.5 * now * now / acceleration;
    if now > 0.0 && level > 0.0 {
        let spent_s = (level / now).min(left_s);
        gone += now * spent_s;
        left_s -= spent_s;
    }
    if left_s > 0.0 {
        change(&mut gone, &mut now, &mut left_s, 0.0);
    }
    // A nanometre before the stop counts as the stop, and a nanometre per second as standstill: otherwise rounding
    // would leave a rest such as 10⁻³²⁰ without end.
    if to_stop - gone < 1e-6 { (to_stop, 0.0) } else { (gone, if now < 1e-6 { 0.0 } else { now }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn run(mut limits: Limits) -> (f64, f64) {
        let (mut time_s, mut speed, mut fastest) = (0.0, 0.0, 0.0_f64);
        while limits.to_stop > 0.0 {
            let (gone, next) = step(speed, limits, 0.012);
            // At the end the last nanometre is skipped, and so is the small remaining speed.
            assert!((next - speed).abs() <= limits.acceleration * 0.012 + 0.2, "{speed} then {next}");
            limits.to_stop -= gone;
            speed = next;
            time_s += 0.012;
            fastest = fastest.max(speed);
            assert!(time_s < 100.0, "never ends");
        }
        (time_s, fastest)
    }

    /// By hand: 250 mm at 100 mm/s and 1000 mm/s² need 250/100 + 100/1000 = 2.6 s; 217 ticks are 2.604 s.
    #[test]
    fn a_long_way_takes_length_by_speed_and_one_ramp() {
        let (time_s, fastest) = run(Limits { to_stop: 250.0, speed: 100.0, acceleration: 1000.0 });
        assert!((time_s - 2.604).abs() < 1e-9 && (fastest - 100.0).abs() < 1e-9, "{time_s} {fastest}");
    }

    /// By hand: 4 mm at 1000 mm/s² never reach 100 mm/s, only √(1000·4) = 63.2; they need 2·0.0632 = 0.126 s.
    #[test]
    fn a_short_way_is_a_triangle() {
        let (time_s, fastest) = run(Limits { to_stop: 4.0, speed: 100.0, acceleration: 1000.0 });
        assert!((time_s - 0.132).abs() < 1e-9 && fastest < 63.3, "{time_s} {fastest}");
    }

    /// By hand: from 100 mm/s down to 40 at 1000 mm/s² needs 60 ms, five ticks.
    #[test]
    fn too_fast_is_braked_down() {
        let mut speed = 100.0;
        for _ in 0..5 {
            speed = step(speed, Limits { to_stop: 500.0, speed: 40.0, acceleration: 1000.0 }, 0.012).1;
        }
        assert!((speed - 40.0).abs() < 1e-9, "{speed}");
    }

    proptest! {
        /// Braking ends at a speed of exactly 0, at the latest one step after the time that the braking needs.
        #[test]
        fn a_brake_holds(mut speed in 0.1..2000.0f64, acceleration in 50.0..9000.0f64) {
            let steps = (speed / acceleration / 0.012).ceil() as usize + 1;
            for _ in 0..steps {
                speed = step(speed, Limits { to_stop: 1e4, speed: 0.0, acceleration }, 0.012).1;
            }
            prop_assert_eq!(speed, 0.0);
        }

        #[test]
        fn it_stops_where_and_when_it_must(
            to_stop in 1e-3..500.0f64, speed in 10.0..2000.0f64, acceleration in 100.0..9000.0f64,
        ) {
            let (time_s, _) = run(Limits { to_stop, speed, acceleration });
            let reaches = to_stop > speed * speed / acceleration;
            let triangle_s = 2.0 * (to_stop / acceleration).sqrt();
            let needed_s = if reaches { to_stop / speed + speed / acceleration } else { triangle_s };
            prop_assert!(time_s > needed_s - 2e-4 && time_s < needed_s + 0.0121, "{time_s} {needed_s}");
        }
    }
}
