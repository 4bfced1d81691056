//! Determines whether the camera has reached its stable temperature, from the temperature of its lens over time, on any
//! clock.
//!
//! The camera triangulates between its projector and its sensor, and their angles change while the camera warms up or
//! cools down. The manufacturer requires ten minutes of captures, and states: during warm-up the temperature rises by
//! 0.5 to 1.5 °C per minute; the air of a production hall changes it by at most 0.03 °C per minute. So the camera is
//! treated as warm if the slope of a straight line through the temperatures of the last minutes,
//!     T(t) = T₀ + s t,   s = Σ (tᵢ − t̄)(Tᵢ − T̄) / Σ (tᵢ − t̄)²,   σₛ² = Σ rᵢ² / (n − 2) / Σ (tᵢ − t̄)²,          (1)
//! has a magnitude below a limit between these two figures, including its own error 2 σₛ. The state is reported as
//! unclear if the temperatures were recorded for less than ten minutes, or if the limit is within the error of the
//! slope. This module never waits and never stops a cycle. Source: support.zivid.com, "Warm-up" and "Thermal
//! Stabilization".

use panelprep_base::number_text::distinguishable_texts;

/// Minimum time for which the temperature must be recorded, s: ten minutes, as the manufacturer requires.
const MIN_OBSERVED_S: f64 = 600.0;
/// Length of the last period to which the line is fitted, s.
const FITTED_PERIOD_S: f64 = 300.0;
/// Maximum time between two temperatures of one series, s; in a longer gap the camera may have been off.
const MAX_GAP_S: f64 = 120.0;
/// Maximum slope of a warm camera, °C per minute: three times that of the air in a production hall, and a fifth of a
/// slow warm-up.
const MAX_SLOPE_C_PER_MIN: f64 = 0.1;
/// Minimum standard deviation of a temperature, °C: temperatures are reported in steps of 0.1 °C, and the error is
/// uniformly distributed within half a step to either side.
const MIN_ERROR_C: f64 = 0.05 / 1.732;
/// Maximum age of a temperature that is used, s.
pub const MAX_TEMPERATURE_AGE_S: f64 = MIN_OBSERVED_S + MAX_GAP_S;

/// A temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemperatureReading {
    /// Time of the temperature reading, s.
    pub at_s: f64,
    /// Temperature of the lens, °C.
    pub lens_c: f64,
}

/// The thermal state of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WarmUpState {
    /// The camera's temperature is stable.
    Warm {
        /// Slope of the temperature, °C per minute.
        rise_c_per_min: f64,
    },
    /// The camera is warming up or cooling down.
    Changing {
        /// Slope of the temperature, °C per minute.
        rise_c_per_min: f64,
    },
    /// The temperatures scatter too much for a decision.
    Unclear {
        /// Slope of the temperature, °C per minute.
        rise_c_per_min: f64,
        /// The error of the slope (95 %), °C per minute.
        error_c_per_min: f64,
    },
    /// The temperatures were recorded for too short a time, or the camera reports no temperature.
    NoReadings {
        /// Time for which the temperature was recorded without a gap, s.
        followed_s: f64,
    },
}

impl std::fmt::Display for WarmUpState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            WarmUpState::Warm { rise_c_per_min } => {
                write!(
                    f,
                    "the 3D camera is warm: its temperature changes by {:.2} °C per minute",
                    rise_c_per_min.abs()
                )
            }
            WarmUpState::Changing { rise_c_per_min } => {
                let verb = if *rise_c_per_min > 0.0 { "warms up" } else { "cools down" };
                let [found, limit] = distinguishable_texts(rise_c_per_min.abs(), MAX_SLOPE_C_PER_MIN, 2);
                write!(
                    f,
                    "the 3D camera still {verb}, by {found} °C per minute (limit {limit} °C per minute). Take shots \
                     for ten minutes before you rely on an accuracy of tenths of a millimetre"
                )
            }
            WarmUpState::Unclear { rise_c_per_min, error_c_per_min } => write!(
                f,
                "it is not clear whether the 3D camera is warm: its temperature changes by {rise_c_per_min:.2} ± \
                 {error_c_per_min:.2} °C per minute (warm: {MAX_SLOPE_C_PER_MIN} °C per minute or less)"
            ),
            WarmUpState::NoReadings { followed_s } => write!(
                f,
                "it is not known whether the 3D camera is warm: its temperature was recorded for {:.0} of {:.0} min",
                (followed_s / 60.0).floor(),
                MIN_OBSERVED_S / 60.0
            ),
        }
    }
}

/// Determines the thermal state at `now_s` from temperatures in the order of their times, on the same clock.
pub fn judge_warm_up(readings: &[TemperatureReading], now_s: f64) -> WarmUpState {
    let series = recent_readings(readings, now_s);
    let followed_s = series.first().map_or(0.0, |first| now_s - first.at_s);
    if followed_s < MIN_OBSERVED_S {
        return WarmUpState::NoReadings { followed_s };
    }
    let line: Vec<TemperatureReading> =
        series.iter().filter(|reading| now_s - reading.at_s <= FITTED_PERIOD_S).copied().collect();
    let Some((rise_c_per_min, error_c_per_min)) = temperature_slope(&line) else {
        return WarmUpState::NoReadings { followed_s: 0.0 };
    };
    match rise_c_per_min.abs() {
        most if most + error_c_per_min <= MAX_SLOPE_C_PER_MIN => WarmUpState::Warm { rise_c_per_min },
        least if least - error_c_per_min > MAX_SLOPE_C_PER_MIN => WarmUpState::Changing { rise_c_per_min },
        _ => WarmUpState::Unclear { rise_c_per_min, error_c_per_min },
    }
}

/// Returns the last readings between which there is no gap, up to now.
fn recent_readings(readings: &[TemperatureReading], now_s: f64) -> &[TemperatureReading] {
    let mut next_s = now_s;
    let of_series = readings.iter().rev().take_while(|reading| {
        let is_near = next_s - reading.at_s <= MAX_GAP_S;
        next_s = reading.at_s;
        is_near
    });
    let count = of_series.count();
    readings.split_at(readings.len() - count).1
}

/// Calculates the slope and its error (95 %) by equation (1), °C per minute; `None` for fewer than three readings.
fn temperature_slope(line: &[TemperatureReading]) -> Option<(f64, f64)> {
    let count = line.len() as f64;
    if line.len() < 3 {
        return None;
    }
    let mean = |of: &dyn Fn(&TemperatureReading) -> f64| line.iter().map(of).sum::<f64>() / count;
    let (middle_s, middle_c) = (mean(&|reading| reading.at_s), mean(&|reading| reading.lens_c));
    let spread: f64 = line.iter().map(|reading| (reading.at_s - middle_s).powi(2)).sum();
    if spread <= 0.0 {
        return None;
    }
    let together: f64 = line.iter().map(|reading| (reading.at_s - middle_s) * (reading.lens_c - middle_c)).sum();
    let slope = together / spread;
    let left = |reading: &TemperatureReading| reading.lens_c - middle_c - slope * (reading.at_s - middle_s);
    let squares: f64 = line.iter().map(|reading| left(reading).powi(2)).sum();
    let error_c = (squares / (count - 2.0)).sqrt().max(MIN_ERROR_C);
    Some((60.0 * slope, 60.0 * 2.0 * error_c / spread.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a reading every 30 s from `from_s` to 900 s.
    fn readings(from_s: f64, lens_c: impl Fn(f64) -> f64) -> Vec<TemperatureReading> {
        let times = (0..=30).map(|half| f64::from(half) * 30.0).filter(|at_s| *at_s >= from_s);
        times.map(|at_s| TemperatureReading { at_s, lens_c: lens_c(at_s) }).collect()
    }

    /// Expected values, calculated by hand: 0.06 °C per minute are 0.001 °C per second. Eleven readings at intervals of
    /// 30 s give Σ (t − t̄)² = 2 · 30² · 55 = 99,000 s², whose root is 314.64 s. The minimum error is 60 · 2 · 0.02887
    /// / 314.64 = 0.0110 °C per minute.
    #[test]
    fn a_linear_rise_is_measured_with_its_error() {
        let line = readings(600.0, |at_s| 30.0 + 0.001 * at_s);
        let (rise_c, error_c) = temperature_slope(&line).expect("eleven");
        assert!((rise_c - 0.06).abs() < 1e-9 && (error_c - 0.01101).abs() < 1e-5, "{rise_c} {error_c}");
        assert_eq!(temperature_slope(&line[..2]), None);
    }

    /// A camera approaches its final temperature as 40 − 15 e^(−t/τ) with τ = 2.5 min. At 15 min its temperature rises
    /// by 15/2.5 · e^(−6) = 0.015 °C per minute, at 5 min by 0.81 °C per minute.
    #[test]
    fn a_camera_of_constant_temperature_is_warm() {
        let warming = |at_s: f64| 40.0 - 15.0 * (-at_s / 150.0_f64).exp();
        assert!(
            matches!(judge_warm_up(&readings(0.0, warming), 900.0), WarmUpState::Warm { rise_c_per_min } if rise_c_per_min > 0.03)
        );
        // The same camera, ten minutes earlier in its warm-up.
        let early = judge_warm_up(&readings(0.0, |at_s| warming(at_s - 600.0)), 900.0);
        assert!(matches!(early, WarmUpState::Changing { rise_c_per_min } if rise_c_per_min > 0.8), "{early:?}");
        assert!(early.to_string().starts_with("the 3D camera still warms up, by "), "{early}");
        let film = judge_warm_up(&readings(0.0, |at_s| 40.0 - 0.005 * at_s), 900.0);
        assert!(
            film.to_string()
                .starts_with("the 3D camera still cools down, by 0.30 °C per minute (limit 0.1 °C per minute)")
        );
    }

    #[test]
    fn missing_temperatures_are_reported() {
        let steady = |_: f64| 36.0;
        let short = judge_warm_up(&readings(330.0, steady), 900.0);
        assert_eq!(short, WarmUpState::NoReadings { followed_s: 570.0 });
        assert!(short.to_string().ends_with("recorded for 9 of 10 min"), "{short}");
        assert_eq!(judge_warm_up(&[], 900.0), WarmUpState::NoReadings { followed_s: 0.0 });
        // In the first case the last reading is three minutes old. In the second case there is a gap of three minutes
        // before the last five readings.
        assert_eq!(judge_warm_up(&readings(0.0, steady), 1_080.0), WarmUpState::NoReadings { followed_s: 0.0 });
        let mut gap = readings(0.0, steady);
        gap.retain(|reading| !(430.0..=580.0).contains(&reading.at_s));
        assert_eq!(judge_warm_up(&gap, 900.0), WarmUpState::NoReadings { followed_s: 300.0 });
        // A rise of 0.1 °C a minute is exactly at the limit.
        let edge = judge_warm_up(&readings(0.0, |at_s| 30.0 + at_s / 600.0), 900.0);
        assert!(matches!(edge, WarmUpState::Unclear { .. }), "{edge:?}");
        assert!(edge.to_string().contains("changes by 0.10 ± 0.01 °C per minute"), "{edge}");
    }
}
