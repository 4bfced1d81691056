//! Arguments of `panelprep shoot`.

use super::simulation::Simulation;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Kinds of shots that `shoot` can take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Shot {
    /// A 3D scan: organised PCD and PLY, and its colours as PNG.
    Scan,
    /// A picture by the 3D camera's colour sensor, under the cell's own light.
    Picture,
    /// A sequence of pictures by the 3D camera's colour sensor, under the cell's own light.
    Film,
    /// A picture by the camera on the flange.
    Corner,
}

impl Shot {
    /// Whether the shot is taken under the cell's own light.
    pub fn needs_light(self) -> bool {
        matches!(self, Shot::Picture | Shot::Film)
    }

    /// Whether the shot is a 3D scan.
    pub fn is_scan(self) -> bool {
        self == Shot::Scan
    }
}

/// Options of `shoot`.
#[derive(Debug, Clone, Args)]
pub struct Shoot {
    /// The kind of shot.
    #[arg(value_enum)]
    pub what: Shot,
    /// Folder for the files.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of shots, one after the other; a film counts as one.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    pub count: u32,
    /// Length of a film, s.
    #[arg(long, default_value_t = 10.0, value_parser = film_seconds)]
    pub seconds: f64,
    /// Maximum number of pictures per second that are requested for a film.
    #[arg(long, value_name = "N", default_value_t = 5.0, value_parser = film_rate)]
    pub pictures_per_second: f64,
    /// From this second on, the film's pictures are marked as taken under the spray, earlier pictures as dry.
    #[arg(long, value_name = "S")]
    pub spray_from_s: Option<f64>,
    /// From this second on, the film's pictures are marked as wet; without this option, a film without spray is marked
    /// as wet from its beginning.
    #[arg(long, value_name = "S")]
    pub wet_from_s: Option<f64>,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
}

fn film_seconds(text: &str) -> Result<f64, String> {
    let allowed = || "the limits are 0.1 to 600 s".to_owned();
    text.parse().ok().filter(|seconds| (0.1..=600.0).contains(seconds)).ok_or_else(allowed)
}

fn film_rate(text: &str) -> Result<f64, String> {
    let allowed = || "the limits are 0.1 to 60 per second".to_owned();
    text.parse().ok().filter(|rate| (0.1..=60.0).contains(rate)).ok_or_else(allowed)
}
