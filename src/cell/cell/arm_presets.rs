//! The geometry and the axes of an arm, and the presets: KUKA arms that a cell's file may name. Their lengths, limits
//! and speeds are from public models; each preset names its source.
//!
//! All presets have an ortho-parallel basis and a spherical wrist. Their axes have the same directions of rotation and
//! the same zero positions: with all axes at 0°, upper arm and forearm point forward, horizontally. The public models
//! state no accelerations.

/// A value for each axis, axis 1 first.
pub type PerAxis = [f64; 6];

/// Default time in which an axis reaches its highest speed, s. Data sheets do not state accelerations.
pub(super) const AXIS_ACCELERATION_TIME_S: f64 = 0.3;

/// The arm's geometry. The lengths have the names of Brandstötter, Angerer and Hofbaur (2014).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmGeometry {
    /// Distance from axis 1 to axis 2, forward, mm.
    pub a1_mm: f64,
    /// Distance from axis 3 to the forearm's axis, mm.
    pub a2_mm: f64,
    /// Distance from axis 1 to axis 2, sideways, mm.
    pub b_mm: f64,
    /// Height of axis 2, mm.
    pub c1_mm: f64,
    /// Length of the upper arm, mm.
    pub c2_mm: f64,
    /// Length of the forearm up to the wrist's centre, mm.
    pub c3_mm: f64,
    /// Distance from the wrist's centre to the flange, mm.
    pub c4_mm: f64,
    /// Angle of each axis at which the arm of the kinematic model points straight up, degrees.
    pub offsets_deg: PerAxis,
    /// Direction of rotation of each axis: 1 as in the kinematic model, −1 opposite.
    pub signs: [i8; 6],
}

/// Limits of the angle, speed and acceleration of each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmAxes {
    /// Lowest angle of each axis, degrees.
    pub min_deg: PerAxis,
    /// Highest angle of each axis, degrees.
    pub max_deg: PerAxis,
    /// Highest speeds, degrees a second.
    pub max_speed_deg_s: PerAxis,
    /// Highest accelerations, degrees a second squared.
    pub max_acceleration_deg_s2: PerAxis,
}

/// A preset: an arm that a cell's file may name.
#[derive(Debug, PartialEq)]
pub struct Preset {
    /// The arm's keyword in the cell's file.
    pub name: &'static str,
    /// The public model that contains these values: the GitHub repository and the package.
    pub source: &'static str,
    /// The arm's lengths, offsets and signs.
    pub geometry: ArmGeometry,
    /// Lowest angle of each axis, degrees.
    pub min_deg: PerAxis,
    /// Highest angle of each axis, degrees.
    pub max_deg: PerAxis,
    /// Highest speeds, degrees a second.
    pub max_speed_deg_s: PerAxis,
}

/// Returns the geometry of an arm with the lengths a₁, a₂ and c₁ to c₄, mm.
const fn lengths([a1_mm, a2_mm]: [f64; 2], [c1_mm, c2_mm, c3_mm, c4_mm]: [f64; 4]) -> ArmGeometry {
    let (offsets_deg, signs) = ([0.0, -90.0, 0.0, 0.0, 0.0, 0.0], [-1, 1, 1, -1, 1, -1]);
    ArmGeometry { a1_mm, a2_mm, b_mm: 0.0, c1_mm, c2_mm, c3_mm, c4_mm, offsets_deg, signs }
}

impl Preset {
    /// Returns the limits of the arm's axes.
    pub fn axes(&self) -> ArmAxes {
        let Preset { min_deg, max_deg, max_speed_deg_s, .. } = *self;
        let max_acceleration_deg_s2 = max_speed_deg_s.map(|speed_deg_s| speed_deg_s / AXIS_ACCELERATION_TIME_S);
        ArmAxes { min_deg, max_deg, max_speed_deg_s, max_acceleration_deg_s2 }
    }

    /// Returns the largest difference between the link lengths of this arm and of `other`, mm.
    pub fn max_length_difference_mm(&self, other: &ArmGeometry) -> f64 {
        let lengths =
            |arm: &ArmGeometry| [arm.a1_mm, arm.a2_mm, arm.b_mm, arm.c1_mm, arm.c2_mm, arm.c3_mm, arm.c4_mm];
        let pairs = lengths(&self.geometry).into_iter().zip(lengths(other));
        pairs.map(|(own_mm, other_mm)| (own_mm - other_mm).abs()).fold(0.0, f64::max)
    }

    /// Returns the preset whose link lengths are most similar to those of `arm`.
    pub fn nearest(arm: &ArmGeometry) -> &'static Preset {
        let mut nearest = &PRESETS[0];
        for preset in &PRESETS[1..] {
            if preset.max_length_difference_mm(arm) < nearest.max_length_difference_mm(arm) {
                nearest = preset;
            }
        }
        nearest
    }
}

/// All presets; the first one is the default.
pub static PRESETS: [Preset; 21] = [
    Preset {
        name: "kr6-r700-2",
        source: "kroshu/kuka_robot_descriptions, kuka_agilus_support",
        geometry: lengths([25.0, -25.0], [400.0, 335.0, 365.0, 90.0]),
        min_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        max_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        max_speed_deg_s: [360.0, 300.0, 360.0, 450.0, 450.0, 540.0],
    },
    Preset {
        name: "kr6-r700-sixx",
        source: "kroshu/kuka_robot_descriptions, kuka_agilus_support",
        geometry: lengths([25.0, -35.0], [400.0, 315.0, 365.0, 80.0]),
        min_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        max_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        max_speed_deg_s: [360.0, 300.0, 360.0, 381.0, 388.0, 615.0],
    },
    Preset {
        name: "kr6-r900-2",
        source: "kroshu/kuka_robot_descriptions, kuka_agilus_support",
        geometry: lengths([25.0, -25.0], [400.0, 455.0, 420.0, 90.0]),
        min_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        max_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        max_speed_deg_s: [360.0, 300.0, 360.0, 450.0, 450.0, 540.0],
    },
    Preset {
        name: "kr6-r900-sixx",
        source: "kroshu/kuka_robot_descriptions, kuka_agilus_support",
        geometry: lengths([25.0, -35.0], [400.0, 455.0, 420.0, 80.0]),
        min_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        max_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        max_speed_deg_s: [360.0, 300.0, 360.0, 381.0, 388.0, 615.0],
    },
    Preset {
        name: "kr8-r1440-2-arc-hw",
        source: "kroshu/kuka_robot_descriptions, kuka_cybertech_support",
        geometry: lengths([170.0, -210.0], [425.0, 610.0, 627.0, 80.0]),
        min_deg: [-170.0, -185.0, -119.0, -165.0, -115.0, -350.0],
        max_deg: [170.0, 65.0, 181.0, 165.0, 140.0, 350.0],
        max_speed_deg_s: [220.0, 210.0, 270.0, 430.0, 430.0, 628.6],
    },
    Preset {
        name: "kr8-r2100-2-arc-hw",
        source: "kroshu/kuka_robot_descriptions, kuka_cybertech_support",
        geometry: lengths([160.0, -220.0], [520.0, 980.0, 935.0, 80.0]),
        min_deg: [-185.0, -185.0, -138.0, -165.0, -115.0, -350.0],
        max_deg: [185.0, 65.0, 175.0, 165.0, 140.0, 350.0],
        max_speed_deg_s: [200.0, 171.6, 190.0, 430.0, 430.0, 630.0],
    },
    Preset {
        name: "kr10-r900-2",
        source: "kroshu/kuka_robot_descriptions, kuka_agilus_support",
        geometry: lengths([25.0, -25.0], [400.0, 455.0, 420.0, 90.0]),
        min_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        max_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        max_speed_deg_s: [300.0, 225.0, 330.0, 360.0, 360.0, 433.0],
    },
    Preset {
        name: "kr10-r1100-2",
        source: "kroshu/kuka_robot_descriptions, kuka_agilus_support",
        geometry: lengths([25.0, -25.0], [400.0, 560.0, 515.0, 90.0]),
        min_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        max_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        max_speed_deg_s: [300.0, 225.0, 330.0, 360.0, 360.0, 433.0],
    },
    Preset {
        name: "kr10-r1420",
        source: "ros-industrial/kuka_experimental, kuka_kr10_support",
        geometry: lengths([150.0, -20.0], [450.0, 610.0, 660.0, 80.0]),
        min_deg: [-170.0, -185.0, -137.0, -185.0, -120.0, -350.0],
        max_deg: [170.0, 65.0, 163.0, 185.0, 120.0, 350.0],
        max_speed_deg_s: [220.0, 210.0, 270.0, 381.0, 311.0, 492.0],
    },
    Preset {
        name: "kr12-r1450-3-hw",
        source: "kroshu/kuka_robot_descriptions, kuka_cybertech_support",
        geometry: lengths([165.0, -188.0], [374.0, 560.0, 700.2, 80.0]),
        min_deg: [-170.0, -185.0, -120.0, -180.0, -140.0, -350.0],
        max_deg: [170.0, 65.0, 180.0, 180.0, 140.0, 350.0],
        max_speed_deg_s: [180.0, 170.0, 260.0, 430.0, 450.0, 720.0],
    },
    Preset {
        name: "kr16-r1100-3",
        source: "kroshu/kuka_robot_descriptions, kuka_agilus_support",
        geometry: lengths([100.0, -50.0], [500.0, 500.0, 500.0, 90.0]),
        min_deg: [-170.0, -195.0, -115.0, -200.0, -120.0, -350.0],
        max_deg: [170.0, 55.0, 165.0, 200.0, 120.0, 350.0],
        max_speed_deg_s: [290.0, 270.0, 270.0, 430.0, 450.0, 700.0],
    },
    Preset {
        name: "kr16-r1610-2",
        source: "kroshu/kuka_robot_descriptions, kuka_cybertech_support",
        geometry: lengths([160.0, -150.0], [520.0, 780.0, 655.0, 153.0]),
        min_deg: [-185.0, -185.0, -138.0, -350.0, -130.0, -350.0],
        max_deg: [185.0, 65.0, 175.0, 350.0, 130.0, 350.0],
        max_speed_deg_s: [200.0, 175.0, 190.0, 430.0, 430.0, 630.0],
    },
    Preset {
        name: "kr16-r2010-2",
        source: "kroshu/kuka_robot_descriptions, kuka_cybertech_support",
        geometry: lengths([160.0, -150.0], [520.0, 980.0, 860.0, 153.0]),
        min_deg: [-185.0, -185.0, -138.0, -350.0, -130.0, -350.0],
        max_deg: [185.0, 65.0, 175.0, 350.0, 130.0, 350.0],
        max_speed_deg_s: [200.0, 175.0, 190.0, 430.0, 430.0, 630.0],
    },
    Preset {
        name: "kr20-r1810-2",
        source: "kroshu/kuka_robot_descriptions, kuka_cybertech_support",
        geometry: lengths([160.0, -150.0], [520.0, 780.0, 860.0, 153.0]),
        min_deg: [-185.0, -185.0, -138.0, -350.0, -130.0, -350.0],
        max_deg: [185.0, 65.0, 175.0, 350.0, 130.0, 350.0],
        max_speed_deg_s: [200.0, 171.6, 190.0, 430.0, 430.0, 630.0],
    },
    Preset {
        name: "kr20-r3100",
        source: "kroshu/kuka_robot_descriptions, kuka_iontec_support",
        geometry: lengths([175.0, -50.0], [575.0, 1_290.0, 1_635.0, 153.0]),
        min_deg: [-185.0, -175.0, -120.0, -350.0, -130.0, -350.0],
        max_deg: [185.0, 60.0, 170.0, 350.0, 130.0, 350.0],
        max_speed_deg_s: [180.0, 165.0, 160.0, 360.0, 360.0, 630.0],
    },
    Preset {
        name: "kr30-r2100",
        source: "kroshu/kuka_robot_descriptions, kuka_iontec_support",
        geometry: lengths([175.0, -50.0], [575.0, 890.0, 1_035.0, 185.0]),
        min_deg: [-185.0, -175.0, -120.0, -180.0, -125.0, -350.0],
        max_deg: [185.0, 60.0, 165.0, 180.0, 125.0, 350.0],
        max_speed_deg_s: [180.0, 165.0, 180.0, 250.0, 250.0, 360.0],
    },
    Preset {
        name: "kr50-r2100",
        source: "kroshu/kuka_robot_descriptions, kuka_iontec_support",
        geometry: lengths([175.0, -50.0], [575.0, 890.0, 1_035.0, 185.0]),
        min_deg: [-185.0, -175.0, -120.0, -180.0, -125.0, -350.0],
        max_deg: [185.0, 60.0, 165.0, 180.0, 125.0, 350.0],
        max_speed_deg_s: [180.0, 175.0, 175.0, 250.0, 250.0, 360.0],
    },
    Preset {
        name: "kr50-r2500",
        source: "kroshu/kuka_robot_descriptions, kuka_iontec_support",
        geometry: lengths([175.0, -50.0], [575.0, 1_290.0, 1_035.0, 185.0]),
        min_deg: [-185.0, -175.0, -120.0, -180.0, -125.0, -350.0],
        max_deg: [185.0, 60.0, 170.0, 180.0, 125.0, 350.0],
        max_speed_deg_s: [175.0, 158.0, 175.0, 250.0, 250.0, 360.0],
    },
    Preset {
        name: "kr70-r2100",
        source: "kroshu/kuka_robot_descriptions, kuka_iontec_support",
        geometry: lengths([175.0, -50.0], [575.0, 890.0, 1_035.0, 185.0]),
        min_deg: [-185.0, -175.0, -120.0, -180.0, -125.0, -350.0],
        max_deg: [185.0, 60.0, 165.0, 180.0, 125.0, 350.0],
        max_speed_deg_s: [180.0, 158.0, 160.0, 230.0, 230.0, 320.0],
    },
    Preset {
        name: "kr120-r2700-2",
        source: "kroshu/kuka_robot_descriptions, kuka_quantec_support",
        geometry: lengths([330.0, -115.0], [645.0, 1_150.0, 1_220.0, 215.0]),
        min_deg: [-185.0, -140.0, -120.0, -350.0, -125.0, -350.0],
        max_deg: [185.0, -5.0, 168.0, 350.0, 125.0, 350.0],
        max_speed_deg_s: [116.8, 111.5, 119.4, 190.0, 180.0, 260.0],
    },
    Preset {
        name: "kr120-r2500-pro",
        source: "ros-industrial/kuka_experimental, kuka_kr120_support",
        geometry: lengths([350.0, 41.0], [675.0, 1_150.0, 1_000.0, 215.0]),
        min_deg: [-185.0, -155.0, -130.0, -350.0, -130.0, -350.0],
        max_deg: [185.0, 35.0, 154.0, 350.0, 130.0, 350.0],
        max_speed_deg_s: [156.0, 156.0, 156.0, 330.0, 330.0, 615.0],
    },
];
