//! `[arm]` and `[[keep_out]]`: the arm's link lengths, axis limits and safety margins, and the boxes that no part of
//! the arm may enter.
//!
//! Link lengths and signs are those of Brandstötter, Angerer and Hofbaur (2014) for six axes with an ortho-parallel
//! basis and a spherical wrist. Without the table the arm is a KUKA KR 6 R700-2. For any other arm the file must state
//! all values: a default value would belong to another arm.

use super::arm_presets::{AXIS_ACCELERATION_TIME_S, ArmAxes, ArmGeometry, PRESETS, PerAxis, Preset};
use super::robot_correction::CorrectionNumbers;
use panelprep_base::config::{Section, Setting, settings};
use panelprep_base::geometry::{Base, Point};
use panelprep_base::number_text;
use toml::de::DeValue;

/// Model of the robot arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmModel {
    /// An arm with a known name.
    Named(&'static Preset),
    /// Any other arm: the file states all of its values.
    Custom,
}

/// The keyword of `model` for an arm whose values are all in the file.
const CUSTOM: &str = "custom";

impl Setting for ArmModel {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let words = PRESETS.iter().map(|preset| preset.name).chain([CUSTOM]).collect();
        let word = <&'static str>::parse(value, &words)?;
        Ok(PRESETS.iter().find(|preset| preset.name == word).map_or(ArmModel::Custom, ArmModel::Named))
    }
}

settings! {
    /// `[arm]` as it is written in the file.
    pub struct ArmTable {
        /// Model of the robot arm.
        model: ArmModel, (), default ArmModel::Named(&PRESETS[0]);
        /// Distance from axis 1 to axis 2, forward, mm.
        a1_mm: Option<f64>, -5_000.0..=5_000.0, default None;
        /// Distance from axis 3 to the forearm's axis, mm; negative if the forearm is above axis 3.
        a2_mm: Option<f64>, -5_000.0..=5_000.0, default None;
        /// Distance from axis 1 to axis 2, sideways, mm.
        b_mm: Option<f64>, -5_000.0..=5_000.0, default None;
        /// Height of axis 2, mm.
        c1_mm: Option<f64>, -5_000.0..=5_000.0, default None;
        /// Length of the upper arm, mm.
        c2_mm: Option<f64>, 1.0..=5_000.0, default None;
        /// Length of the forearm up to the wrist's centre, mm.
        c3_mm: Option<f64>, 1.0..=5_000.0, default None;
        /// Distance from the wrist's centre to the flange, mm.
        c4_mm: Option<f64>, 0.0..=2_000.0, default None;
        /// Angle of each axis at which the arm of the kinematic model points straight up, degrees.
        offsets_deg: Option<[f64; 6]>, -360.0..=360.0, default None;
        /// Direction of rotation of each axis: 1 if it is the same as in the kinematic model, −1 if it is opposite.
        signs: Option<[f64; 6]>, -1.0..=1.0, default None;
        /// Lowest angle of each axis, degrees.
        min_deg: Option<[f64; 6]>, -720.0..=720.0, default None;
        /// Highest angle of each axis, degrees.
        max_deg: Option<[f64; 6]>, -720.0..=720.0, default None;
        /// Highest speed of each axis, degrees a second.
        max_speed_deg_s: Option<[f64; 6]>, 1.0..=2_000.0, default None;
        /// Highest acceleration of each axis, degrees a second squared. Default: the axis reaches its highest speed in
        /// 0.3 s.
        max_acceleration_deg_s2: Option<[f64; 6]>, 1.0..=50_000.0, default None;
        /// Minimum distance of each axis angle from its limits, degrees.
        limit_margin_deg: f64, 0.0..=45.0, default 3.0;
        /// Minimum angle of axis 5 from the wrist singularity, at which axes 4 and 6 are parallel, degrees.
        wrist_margin_deg: f64, 0.5..=45.0, default 5.0;
        /// Minimum angle between the elbow and its extended position, degrees.
        elbow_margin_deg: f64, 0.5..=45.0, default 5.0;
        /// Minimum distance of the wrist's centre from axis 1, mm.
        overhead_margin_mm: f64, 1.0..=500.0, default 50.0;
        /// Minimum distance of the arm's centre line from a keep-out box, mm: half the arm's thickness plus a safety
        /// margin.
        clearance_mm: f64, 0.0..=500.0, default 80.0;
        /// Minimum distance of the tool's centre line from a keep-out box, mm.
        tool_clearance_mm: f64, 0.0..=500.0, default 40.0;
    }
}

/// A box that no part of the arm may enter.
#[derive(Debug, Clone, PartialEq)]
pub struct KeepOut {
    /// The name of the box, for messages.
    pub name: String,
    /// Lower corner in the base frame, mm.
    pub min: Point<Base>,
    /// Upper corner, mm; each of its coordinates is larger than that of the lower corner.
    pub max: Point<Base>,
}

/// A robot arm with its keep-out boxes, after all checks of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    geometry: ArmGeometry,
    axes: ArmAxes,
    table: ArmTable,
    keep_out: Vec<KeepOut>,
    correction: Option<CorrectionNumbers>,
}

impl Arm {
    /// Returns the arm's lengths, offsets and signs.
    pub fn geometry(&self) -> &ArmGeometry {
        &self.geometry
    }

    /// Returns the limits of the axes.
    pub fn axes(&self) -> &ArmAxes {
        &self.axes
    }

    /// Returns the preset with the most similar link lengths and the largest difference of a length, mm; `None` if the
    /// file names a preset.
    pub fn nearest_preset(&self) -> Option<(&'static Preset, f64)> {
        let nearest = Preset::nearest(&self.geometry);
        (self.table.model == ArmModel::Custom).then(|| (nearest, nearest.max_length_difference_mm(&self.geometry)))
    }

    /// Returns the table `[arm]` as the file states it, which contains the margins.
    pub fn margins(&self) -> &ArmTable {
        &self.table
    }

    /// Returns the boxes that no part of the arm may enter.
    pub fn keep_out(&self) -> &[KeepOut] {
        &self.keep_out
    }

    /// Returns the arm's measured deviations from its nominal geometry; `None` if none were measured.
    pub fn correction(&self) -> Option<&CorrectionNumbers> {
        self.correction.as_ref()
    }

    pub(super) fn with_correction(self, correction: CorrectionNumbers) -> Self {
        Arm { correction: Some(correction), ..self }
    }
}

pub(super) fn parse_arm(section: &Section<'_, '_>, keep_out: &[Section<'_, '_>]) -> Option<Arm> {
    let table = ArmTable::parse(section);
    let keep_out: Vec<Option<KeepOut>> = keep_out.iter().map(parse_keep_out).collect();
    let (table, keep_out) = (table?, keep_out.into_iter().collect::<Option<Vec<_>>>()?);
    let (geometry, axes) = match table.model {
        ArmModel::Named(preset) => parse_preset_arm(section, &table, preset)?,
        ArmModel::Custom => parse_custom_arm(section, &table)?,
    };
    for axis in 0..6 {
        let (low, high) = (axes.min_deg[axis], axes.max_deg[axis]);
        if low + 2.0 * table.limit_margin_deg >= high {
            let message = format!(
                "axis {}: the range from {low} to {high}° is not larger than limit_margin_deg at both ends: widen the range, or reduce the margin",
                axis + 1
            );
            section.problem("max_deg", message);
            return None;
        }
    }
    Some(Arm { geometry, axes, table, keep_out, correction: None })
}

/// Returns the geometry and the axes of a preset. The file must not state link lengths, but may narrow the axis limits.
fn parse_preset_arm(
    section: &Section<'_, '_>,
    table: &ArmTable,
    preset: &Preset,
) -> Option<(ArmGeometry, ArmAxes)> {
    let own = preset.axes();
    let given = [
        ("a1_mm", table.a1_mm.is_some()),
        ("a2_mm", table.a2_mm.is_some()),
        ("b_mm", table.b_mm.is_some()),
        ("c1_mm", table.c1_mm.is_some()),
        ("c2_mm", table.c2_mm.is_some()),
        ("c3_mm", table.c3_mm.is_some()),
        ("c4_mm", table.c4_mm.is_some()),
        ("offsets_deg", table.offsets_deg.is_some()),
        ("signs", table.signs.is_some()),
    ];
    let wrong: Vec<&str> = given.iter().filter(|(_, given)| *given).map(|(key, _)| *key).collect();
    for key in &wrong {
        section.problem(key, "is defined by the model; set model = \"custom\" to state all values of another arm");
    }
    let axes = ArmAxes {
        min_deg: table.min_deg.unwrap_or(own.min_deg),
        max_deg: table.max_deg.unwrap_or(own.max_deg),
        max_speed_deg_s: table.max_speed_deg_s.unwrap_or(own.max_speed_deg_s),
        max_acceleration_deg_s2: table.max_acceleration_deg_s2.unwrap_or(own.max_acceleration_deg_s2),
    };
    let mut wider = false;
    for (key, beyond) in [
        ("min_deg", (0..6).find(|i| axes.min_deg[*i] < own.min_deg[*i])),
        ("max_deg", (0..6).find(|i| axes.max_deg[*i] > own.max_deg[*i])),
        ("max_speed_deg_s", (0..6).find(|i| axes.max_speed_deg_s[*i] > own.max_speed_deg_s[*i])),
    ] {
        if let Some(axis) = beyond {
            section.problem(
                key,
                format!("axis {}: the limit of the cell must not be wider than the limit of the arm", axis + 1),
            );
            wider = true;
        }
    }
    (wrong.is_empty() && !wider).then_some((preset.geometry, axes))
}

fn parse_custom_arm(section: &Section<'_, '_>, table: &ArmTable) -> Option<(ArmGeometry, ArmAxes)> {
    let number = |key: &str, value: Option<f64>| require_value(section, key, value);
    let list = |key: &str, value: Option<PerAxis>| require_value(section, key, value);
    let lengths = [
        number("a1_mm", table.a1_mm),
        number("a2_mm", table.a2_mm),
        number("b_mm", table.b_mm),
        number("c1_mm", table.c1_mm),
        number("c2_mm", table.c2_mm),
        number("c3_mm", table.c3_mm),
        number("c4_mm", table.c4_mm),
    ];
    let lists = [
        list("offsets_deg", table.offsets_deg),
        list("signs", table.signs),
        list("min_deg", table.min_deg),
        list("max_deg", table.max_deg),
        list("max_speed_deg_s", table.max_speed_deg_s),
    ];
    let [a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm] = lengths;
    let [offsets_deg, signs, min_deg, max_deg, max_speed_deg_s] = lists;
    let (signs, max_speed_deg_s) = (signs?, max_speed_deg_s?);
    if signs.iter().any(|sign| sign.abs() != 1.0) {
        section.problem("signs", format!("found {}, valid: 1 or -1 for each axis", number_text::list(&signs)));
        return None;
    }
    let geometry = ArmGeometry {
        a1_mm: a1_mm?,
        a2_mm: a2_mm?,
        b_mm: b_mm?,
        c1_mm: c1_mm?,
        c2_mm: c2_mm?,
        c3_mm: c3_mm?,
        c4_mm: c4_mm?,
        offsets_deg: offsets_deg?,
        signs: signs.map(|sign| if sign > 0.0 { 1 } else { -1 }),
    };
    let in_time = max_speed_deg_s.map(|speed| speed / AXIS_ACCELERATION_TIME_S);
    let axes = ArmAxes {
        min_deg: min_deg?,
        max_deg: max_deg?,
        max_speed_deg_s,
        max_acceleration_deg_s2: table.max_acceleration_deg_s2.unwrap_or(in_time),
    };
    Some((geometry, axes))
}

fn require_value<T>(section: &Section<'_, '_>, key: &str, value: Option<T>) -> Option<T> {
    if value.is_none() {
        section.problem(key, "is missing; model = \"custom\" needs all values of the arm");
    }
    value
}

fn parse_keep_out(section: &Section<'_, '_>) -> Option<KeepOut> {
    let name = section.parse::<String>("name", (), None);
    let corner = |key| section.parse::<[f64; 3]>(key, -10_000.0..=10_000.0, None);
    let (low, high) = (corner("min_mm"), corner("max_mm"));
    section.finish();
    let (name, low, high) = (name?, low?, high?);
    if (0..3).any(|axis| low[axis] >= high[axis]) {
        section.problem(
            "max_mm",
            format!("{} must exceed min_mm {} in every axis", number_text::list(&high), number_text::list(&low)),
        );
        return None;
    }
    let point = |[x_mm, y_mm, z_mm]: [f64; 3]| Point::at(x_mm, y_mm, z_mm);
    Some(KeepOut { name, min: point(low), max: point(high) })
}

#[cfg(test)]
mod tests {
    use super::super::Cell;

    fn problems(text: &str) -> Vec<String> {
        let problems = Cell::check("f", text).err().map_or(String::new(), |problems| problems.to_string());
        problems.lines().map(|line| line.trim_start_matches("f:").to_owned()).collect()
    }

    #[test]
    fn without_a_table_it_is_the_kr_6() {
        let cell = Cell::check("f", "").unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!((cell.arm().geometry().c2_mm, cell.arm().axes().max_deg[2]), (335.0, 156.0));
        assert_eq!((cell.arm().margins().wrist_margin_deg(), cell.arm().keep_out().len()), (5.0, 0));
    }

    #[test]
    fn an_unknown_arm_is_refused_with_the_known_names() {
        let cell =
            Cell::check("f", "[arm]\nmodel = 'kr10-r1100-2'\n").unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!((cell.arm().geometry().c2_mm, cell.arm().axes().max_speed_deg_s[1]), (560.0, 225.0));
        assert_eq!(cell.arm().nearest_preset(), None);
        let wrong = problems("[arm]\nmodel = 'kr10-r1100'\n");
        assert!(wrong[0].contains("kr10-r1100-2") && wrong[0].contains("custom"), "{wrong:?}");
    }

    #[test]
    fn another_arm_needs_all_of_its_numbers() {
        let wrong = problems("[arm]\nmodel = 'custom'\na1_mm = 150\n");
        assert!(wrong.len() == 11 && wrong.iter().all(|line| line.contains("needs all values")), "{wrong:?}");
        let other = "[arm]\nmodel = 'custom'\na1_mm = 150\na2_mm = -20\nb_mm = 0\nc1_mm = 450\nc2_mm = 610\n\
                     c3_mm = 660\nc4_mm = 80\noffsets_deg = [0, -90, 0, 0, 0, 0]\nsigns = [-1, 1, 1, -1, 1, -1]\n\
                     min_deg = [-170, -190, -120, -185, -120, -350]\nmax_deg = [170, 45, 156, 185, 120, 350]\n\
                     max_speed_deg_s = [200, 200, 200, 300, 300, 400]\n";
        assert_eq!(problems(other), [""; 0]);
        // Expected value, calculated by hand: with the lengths of a KR 10 R1420, but an upper arm of 615 mm, the
        // largest difference is 5 mm.
        let nearest = |text: &str| {
            let cell = Cell::check("f", text).unwrap_or_else(|problems| panic!("{problems}"));
            cell.arm().nearest_preset().map(|(preset, off_mm)| (preset.name, off_mm))
        };
        assert_eq!(nearest(other), Some(("kr10-r1420", 0.0)));
        assert_eq!(nearest(&other.replace("c2_mm = 610", "c2_mm = 615")), Some(("kr10-r1420", 5.0)));
        assert_eq!(problems(&other.replace("[-1, 1, 1,", "[-1, 0.5, 1,")).len(), 1);
    }

    #[test]
    fn a_cell_may_only_narrow_the_limits_of_the_arm() {
        assert_eq!(problems("[arm]\nmax_deg = [90, 45, 156, 185, 120, 350]\n"), [""; 0]);
        let wrong = problems("[arm]\nmax_deg = [171, 45, 156, 185, 120, 350]\nc2_mm = 400\n");
        assert_eq!(wrong.len(), 2, "{wrong:?}");
        assert!(wrong[0].contains("axis 1") && wrong[1].contains("custom"), "{wrong:?}");
        assert!(problems("[arm]\nmin_deg = [0, 40, 0, 0, 0, 0]\n")[0].contains("axis 2"));
    }

    #[test]
    fn keep_out_boxes_have_names_and_corners_in_order() {
        let text = "[[keep_out]]\nname = 'post'\nmin_mm = [600, -120, 0]\nmax_mm = [650, -80, 700]\n";
        let cell = Cell::check("f", text).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!(cell.arm().keep_out()[0].name, "post");
        assert_eq!(problems(&text.replace("650", "550")).len(), 1);
    }
}
