//! The panel's pose: `[locate]` and `[corner]`.

use panelprep_base::config::{Choice, Section, Setting, settings};
use panelprep_base::number_text::list;
use toml::de::DeValue;

/// The method of refining a pose from the search's result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Registration {
    /// Point-to-plane registration with the outline.
    PointToPlane,
    /// The thesis's point-to-point ICP, for comparison.
    Thesis,
}

impl Choice for Registration {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("point-to-plane", Registration::PointToPlane), ("thesis", Registration::Thesis)];
}

settings! {
    /// `[locate]`: where the panel is searched for, and the limits for acceptance (thesis 3.8).
    pub struct Locate {
        /// The method of refining the pose. The thesis's method does not state its own error: the distance of its pose
        /// from that of the other method counts as its error.
        method: Registration, (), default Registration::PointToPlane;
        /// Lower corner of the search box in the base frame, mm.
        box_min_mm: [f64; 3], -5_000.0..=5_000.0, required;
        /// Upper corner of the search box in the base frame, mm.
        box_max_mm: [f64; 3], -5_000.0..=5_000.0, required;
        /// Largest shift of the panel's centre from its nominal position, mm.
        max_shift_mm: f64, 0.0..=1_000.0, default 60.0;
        /// Largest rotation in the panel's plane, degrees.
        turn_limit_deg: f64, 0.0..=180.0, default 15.0;
        /// Largest tilt of the panel's normal, degrees.
        max_tilt_deg: f64, 0.0..=45.0, default 15.0;
        /// Largest root mean square of the point-to-plane residuals, mm.
        max_rms_mm: f64, 0.001..=5.0, default 0.25;
        /// Smallest fraction of taught points found in the scan, and of the panel's points in the scan found among the
        /// taught points, 0…1; a fifth of the panel may be hidden.
        min_overlap: f64, 0.0..=1.0, default 0.75;
    }
}

pub(in crate::recipe) fn parse_locate(section: &Section<'_, '_>) -> Option<Locate> {
    let locate = Locate::parse(section)?;
    let (low, high) = (locate.box_min_mm(), locate.box_max_mm());
    if (0..3).any(|axis| low[axis] >= high[axis]) {
        section
            .problem("box_max_mm", format!("{} must exceed box_min_mm {} in every axis", list(&high), list(&low)));
        return None;
    }
    Some(locate)
}

/// A corner of the panel, as the flange camera sees it at the taught pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CornerName {
    /// The upper left corner.
    TopLeft,
    /// The upper right corner.
    TopRight,
    /// The lower right corner.
    BottomRight,
    /// The lower left corner.
    BottomLeft,
}

impl Choice for CornerName {
    const KEYWORDS: &'static [(&'static str, Self)] = &[
        ("top-left", CornerName::TopLeft),
        ("top-right", CornerName::TopRight),
        ("bottom-right", CornerName::BottomRight),
        ("bottom-left", CornerName::BottomLeft),
    ];
}

/// The corner that each taught picture shows: one keyword for all pictures, or a list in the order of teaching.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CornerNames(Vec<CornerName>);

impl CornerNames {
    /// Returns the corner of a taught picture, counted from 0; pictures beyond the list show the last named corner.
    pub fn for_picture(&self, picture: usize) -> CornerName {
        self.0.get(picture).or(self.0.last()).copied().unwrap_or(CornerName::TopLeft)
    }

    /// Returns all keywords as a recipe writes them, in the order of teaching.
    pub fn keywords(&self) -> Vec<&'static str> {
        let word =
            |name: &CornerName| CornerName::KEYWORDS.iter().find(|(_, known)| known == name).map(|(word, _)| *word);
        self.0.iter().filter_map(word).collect()
    }
}

impl From<CornerName> for CornerNames {
    fn from(name: CornerName) -> CornerNames {
        CornerNames(vec![name])
    }
}

impl Setting for CornerNames {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let Some(list) = value.as_array() else { return CornerName::parse(value, &()).map(CornerNames::from) };
        if list.is_empty() {
            return Err("found an empty list; valid: one corner for each taught picture".to_owned());
        }
        list.iter().map(|item| CornerName::parse(item.get_ref(), &())).collect::<Result<_, _>>().map(CornerNames)
    }
}

settings! {
    /// `[corner]`: settings for reading the corner picture (thesis 3.9, Fig. 3.17).
    pub struct Corner {
        /// The corner of the panel that each taught picture shows.
        which: CornerNames, (), default CornerName::TopLeft.into();
        /// Diameter of the bilateral filter's neighbourhood, px.
        bilateral_diameter_px: usize, 3..=31, default 9;
        /// Largest difference between two brightnesses that are still averaged, grey levels.
        bilateral_sigma_gray: f64, 1.0..=255.0, default 40.0;
        /// Lowest brightness of the panel.
        panel_gray_min: usize, 0..=255, default 0;
        /// Highest brightness of the panel.
        panel_gray_max: usize, 0..=255, default 110;
        /// Length of edge beside the corner that is left out because of the rounding, mm.
        rounding_mm: f64, 0.0..=100.0, default 8.0;
        /// Length of each edge that is fitted, mm.
        edge_mm: f64, 2.0..=200.0, default 25.0;
        /// Largest correction in the camera's plane, mm.
        max_correction_mm: f64, 0.1..=50.0, default 8.0;
        /// If a picture indicates a smaller correction than this, mm, it is the last one.
        settled_mm: f64, 0.05..=5.0, default 0.3;
        /// Largest number of moves after the first picture.
        max_moves: usize, 0..=10, default 3;
        /// Largest distance of the corner from its position by the localization just before contact, mm.
        verify_mm: f64, 0.05..=5.0, default 0.2;
    }
}

pub(in crate::recipe) fn parse_corner(section: &Section<'_, '_>) -> Option<Corner> {
    let corner = Corner::parse(section)?;
    if corner.panel_gray_min() >= corner.panel_gray_max() {
        section.problem("panel_gray_max", format!("must exceed panel_gray_min, {}", corner.panel_gray_min()));
        return None;
    }
    Some(corner)
}
