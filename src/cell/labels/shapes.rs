//! Breaks as polygons over time.

use panelprep_base::geometry::Pixel;
use serde::{Deserialize, Serialize};

/// The outline of a break, valid from a time onward.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Time from which the break has this outline, s of the clip.
    pub from_s: f64,
    /// The corners of the outline, px; the last corner is joined to the first.
    pub corners_px: Vec<[f64; 2]>,
}

/// One place where the film broke.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Break {
    /// The time from which on the film is closed again, s of the clip; `None` if it is open at the clip's end.
    pub closes_s: Option<f64>,
    /// The outlines of the break in the order of time; the break begins with the first outline.
    pub shapes: Vec<Shape>,
}

/// A person's statement about a clip.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statement {
    /// The person's name.
    pub author: String,
    /// Whether the person has looked at the whole clip, and nothing broke.
    pub clean: bool,
    /// The places where the film broke.
    pub breaks: Vec<Break>,
}

impl Break {
    /// Returns whether the break is open at this time, s of the clip.
    pub fn is_open_at(&self, time_s: f64) -> bool {
        let has_begun = self.shapes.first().is_some_and(|first| first.from_s <= time_s);
        has_begun && self.closes_s.is_none_or(|closes_s| time_s < closes_s)
    }

    /// Returns the corners of the break at this time, px; none before the break begins. The corners are returned
    /// whether or not the break has closed again.
    pub fn corners_at(&self, time_s: f64) -> Vec<Pixel> {
        let begun = self.shapes.partition_point(|shape| shape.from_s <= time_s);
        let Some(shape) = begun.checked_sub(1).and_then(|index| self.shapes.get(index)) else { return Vec::new() };
        let corners = || shape.corners_px.iter().copied();
        match self.shapes.get(begun) {
            Some(next) if next.corners_px.len() == shape.corners_px.len() => {
                let share = (time_s - shape.from_s) / (next.from_s - shape.from_s);
                let between = |([u, v], [next_u, next_v]): ([f64; 2], [f64; 2])| {
                    Pixel::at(u + (next_u - u) * share, v + (next_v - v) * share)
                };
                corners().zip(next.corners_px.iter().copied()).map(between).collect()
            }
            _ => corners().map(|[u, v]| Pixel::at(u, v)).collect(),
        }
    }
}
