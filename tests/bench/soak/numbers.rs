//! Samples of a process's resources, and the growth of these resources. The smallest value of each period is used,
//! because the process frees the memory of a cycle or a client with a delay.

use std::fmt;
use std::fs;
use std::time::Duration;

/// The process's resources at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    resident_kb: f64,
    anonymous_kb: f64,
    descriptors: f64,
    threads: f64,
}

impl Sample {
    /// Reads a sample of the process with this id; `None` if the process has ended.
    pub fn read(id: u32) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{id}/status")).ok()?;
        let value = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
            line.split_whitespace().next()?.parse().ok()
        };
        Some(Sample {
            resident_kb: value("VmRSS")?,
            anonymous_kb: value("RssAnon")?,
            descriptors: fs::read_dir(format!("/proc/{id}/fd")).ok()?.count() as f64,
            threads: value("Threads")?,
        })
    }
}

/// The samples of one period.
#[derive(Debug, Clone, Copy)]
pub struct Period {
    end_h: f64,
    least: Sample,
    most: Sample,
}

/// A measured resource: its name, its unit, its maximum growth per hour, and its value in a sample. Without a maximum
/// growth, a fraction of the resource's size is the limit.
type Named = (&'static str, &'static str, Option<f64>, fn(&Sample) -> f64);

impl Period {
    /// The resources whose lowest value is checked. Resident memory of files is not checked, because the system frees
    /// it when needed.
    pub const LOWEST: [Named; 3] = [
        ("memory of its own", "kB", None, |sample| sample.anonymous_kb),
        ("descriptors", "", Some(1.0), |sample| sample.descriptors),
        ("threads", "", Some(1.0), |sample| sample.threads),
    ];

    /// Summarizes the samples of a period; `None` without a sample.
    pub fn from_samples(end: Duration, samples: &[Sample]) -> Option<Self> {
        let first = *samples.first()?;
        let by = |pick: fn(f64, f64) -> f64| {
            samples.iter().fold(first, |found, sample| Sample {
                resident_kb: pick(found.resident_kb, sample.resident_kb),
                anonymous_kb: pick(found.anonymous_kb, sample.anonymous_kb),
                descriptors: pick(found.descriptors, sample.descriptors),
                threads: pick(found.threads, sample.threads),
            })
        };
        Some(Period { end_h: end.as_secs_f64() / 3_600.0, least: by(f64::min), most: by(f64::max) })
    }
}

impl fmt::Display for Period {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Period { end_h, least, most } = self;
        write!(
            f,
            "{:6.1} min: VmRSS {:.0} to {:.0} kB, RssAnon {:.0} to {:.0} kB, descriptors {} to {}, threads {} to {}",
            end_h * 60.0,
            least.resident_kb,
            most.resident_kb,
            least.anonymous_kb,
            most.anonymous_kb,
            least.descriptors,
            most.descriptors,
            least.threads,
            most.threads
        )
    }
}

/// A least-squares line through the values of the periods.
#[derive(Debug, Clone, Copy)]
pub struct Growth {
    pub mean: f64,
    pub an_hour: f64,
    pub standard_error: f64,
}

impl Growth {
    /// Fits a line through the periods; `None` for fewer than three periods.
    pub fn fit(periods: &[Period], value: fn(&Sample) -> f64) -> Option<Self> {
        let count = periods.len() as f64;
        if periods.len() < 3 {
            return None;
        }
        let points = || periods.iter().map(|period| (period.end_h, value(&period.least)));
        let mean_h = points().map(|(at_h, _)| at_h).sum::<f64>() / count;
        let mean = points().map(|(_, value)| value).sum::<f64>() / count;
        let spread = points().map(|(at_h, _)| (at_h - mean_h).powi(2)).sum::<f64>();
        let an_hour = points().map(|(at_h, value)| (at_h - mean_h) * (value - mean)).sum::<f64>() / spread;
        let left = points().map(|(at_h, value)| (value - mean - an_hour * (at_h - mean_h)).powi(2)).sum::<f64>();
        Some(Growth { mean, an_hour, standard_error: (left / (count - 2.0) / spread).sqrt() })
    }
}
