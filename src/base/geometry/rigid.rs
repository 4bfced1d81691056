//! Frames, angles and pixels as types; points, directions and rigid transforms with their frames; and the uncertainty
//! of a pose, stated as the uncertainty of the points that the pose maps.
//!
//! Every point, direction and transform has its frame in its type, so that adding a camera point to a base point does
//! not compile. Types cannot distinguish the same frame at two times: if a person bumps the panel, `Panel` before and
//! after is one type but two poses. For this reason the cycle uses a localization only for a limited time, until the
//! phase Verify renews it.
//!
//! `Rigid<To, From>` is the thesis's `ᵀᵒT_From` (Eq. 3.1): it maps a point of frame `From` to frame `To`. In a product
//! adjacent frames must match, `base_from_panel = base_from_camera * camera_from_panel`; every other order does not
//! compile. [`Rigid::from_isometry_unchecked`] is the only function that creates a transform from plain numbers. A
//! search for its name finds every place where the frames are not checked by the compiler.
//!
//! No public function accepts two bare numbers side by side. Lengths are `f64` in mm with the unit in their name, or
//! are inside of points and transforms with frames. Angles are passed in degrees; [`Degrees::to_rad`] is the only
//! conversion to radians, for numerical code.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use std::marker::PhantomData;
use std::ops::{Add, Mul, Sub};

/// A coordinate frame; implemented only by the markers of this module.
pub trait Frame: Copy + std::fmt::Debug + PartialEq + Send + Sync + 'static {
    /// The frame's name in messages.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident = $text:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {}
        impl Frame for $name { const NAME: &'static str = $text; }
    )*};
}

frames! {
    /// The robot's base; the world, as in thesis 3.3. X forward, Z up, mm.
    Base = "base";
    /// The panel. At its nominal pose it coincides with `Base` (thesis 3.8).
    Panel = "panel";
    /// The fixed 3D camera: x right, y down, z out of the lens.
    Camera = "camera";
    /// The 2D camera on the flange: x right, y down, z out of the lens.
    FlangeCamera = "flange camera";
    /// The robot's mounting flange; Z away from the arm.
    Flange = "flange";
    /// The sanding tool; Z out of the pad, into the panel.
    Tool = "tool";
    /// The drawing of a panel: the frame of its file.
    Drawing = "drawing";
    /// A calibration board; origin in its first inner corner, Z away from the viewer.
    Board = "board";
}

/// Standard gravity, m/s²: a mass of 1 kg has a weight of 9.80665 N.
pub const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;

/// An angle in degrees.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Degrees(pub f64);

impl Degrees {
    /// Returns the angle in radians, for use in numerical code.
    pub fn to_rad(self) -> f64 {
        self.0.to_radians()
    }

    /// Creates an angle from radians that numerical code has computed.
    pub fn from_rad(angle_rad: f64) -> Self {
        Degrees(angle_rad.to_degrees())
    }
}

impl std::fmt::Display for Degrees {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}°", crate::number_text::fixed_decimals(self.0, 3))
    }
}

/// A position in a picture, px. Whole numbers are pixel centres, as in OpenCV; u points to the right, v down.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pixel {
    /// Column, px.
    pub u: f64,
    /// Row, px.
    pub v: f64,
}

impl Pixel {
    /// Creates the pixel at column `u`, row `v`.
    pub fn at(u: f64, v: f64) -> Self {
        Pixel { u, v }
    }

    /// Calculates the distance to another pixel, px.
    pub fn distance_px(self, other: Pixel) -> f64 {
        (self.u - other.u).hypot(self.v - other.v)
    }

    /// Returns the column and row of the nearest pixel of a picture of this size; `None` outside of the picture.
    pub fn nearest_whole(self, width: usize, height: usize) -> Option<(usize, usize)> {
        let (column, row) = (self.u.round(), self.v.round());
        let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
        inside.then_some((column as usize, row as usize))
    }
}

/// A point measured in frame `F`, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point<F: Frame> {
    /// Coordinates of the point in its frame, mm.
    pub mm: Point3<f64>,
    frame: PhantomData<F>,
}

impl<F: Frame> Point<F> {
    /// Creates the point with these coordinates, mm.
    pub fn at(x_mm: f64, y_mm: f64, z_mm: f64) -> Self {
        Self::new(Point3::new(x_mm, y_mm, z_mm))
    }

    /// Creates the point with these coordinates, mm.
    pub fn new(mm: Point3<f64>) -> Self {
        Point { mm, frame: PhantomData }
    }

    /// Calculates the distance to another point of the same frame, mm.
    pub fn distance_mm(self, other: Self) -> f64 {
        (self.mm - other.mm).norm()
    }
}

/// A displacement measured in frame `F`, mm. A direction is a vector of length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vector<F: Frame> {
    /// Components, mm (without a unit if it is a direction).
    pub mm: Vector3<f64>,
    frame: PhantomData<F>,
}

impl<F: Frame> Vector<F> {
    /// Creates the vector with these components, mm.
    pub fn new(mm: Vector3<f64>) -> Self {
        Vector { mm, frame: PhantomData }
    }

    /// Returns the unit vector along this vector; `None` if this vector is too short to have a direction.
    pub fn direction(self) -> Option<Self> {
        self.mm.try_normalize(1e-12).map(Self::new)
    }

    /// Calculates the angle between two vectors of the same frame.
    pub fn angle_between(self, other: Self) -> Degrees {
        Degrees::from_rad(self.mm.angle(&other.mm))
    }
}

impl<F: Frame> Sub for Point<F> {
    type Output = Vector<F>;
    fn sub(self, other: Self) -> Vector<F> {
        Vector::new(self.mm - other.mm)
    }
}

impl<F: Frame> Add<Vector<F>> for Point<F> {
    type Output = Point<F>;
    fn add(self, step: Vector<F>) -> Point<F> {
        Point::new(self.mm + step.mm)
    }
}

impl<F: Frame> Mul<f64> for Vector<F> {
    type Output = Vector<F>;
    fn mul(self, factor: f64) -> Vector<F> {
        Vector::new(self.mm * factor)
    }
}

/// The rigid transform that maps points of `From` to `To`; translation in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid<To: Frame, From: Frame> {
    isometry: Isometry3<f64>,
    frames: PhantomData<(To, From)>,
}

impl<To: Frame, From: Frame> Rigid<To, From> {
    /// Creates a transform from plain numbers. The caller ensures that they map points of `From` to `To`.
    pub fn from_isometry_unchecked(isometry: Isometry3<f64>) -> Self {
        Rigid { isometry, frames: PhantomData }
    }

    /// Returns the inverse, which maps points of `To` to `From`.
    pub fn inverse(self) -> Rigid<From, To> {
        Rigid::from_isometry_unchecked(self.isometry.inverse())
    }

    /// Returns the transform without its frames, for numerical code.
    pub fn isometry(&self) -> &Isometry3<f64> {
        &self.isometry
    }

    /// Returns the rotation of the transform, without its translation.
    pub fn rotation(&self) -> Rotation3<f64> {
        self.isometry.rotation.to_rotation_matrix()
    }

    /// Returns the position of the origin of `From` in `To`.
    pub fn origin(&self) -> Point<To> {
        Point::new(Point3::from(self.isometry.translation.vector))
    }

    /// Returns the total angle of the rotation, 0…180°.
    pub fn rotation_angle(&self) -> Degrees {
        Degrees::from_rad(self.isometry.rotation.angle())
    }

    /// Returns the transform followed by a displacement measured in `To`.
    pub fn followed_by_displacement(self, step: Vector<To>) -> Self {
        Self::from_isometry_unchecked(Translation3::from(step.mm) * self.isometry)
    }

    /// Returns the distance between the images of a point of `From` under this transform and under `other`, mm.
    pub fn distance_at_mm(self, other: Self, point: Point<From>) -> f64 {
        (self * point).distance_mm(other * point)
    }
}

impl<F: Frame> Rigid<F, F> {
    /// Returns the identity transform.
    pub fn identity() -> Self {
        Self::from_isometry_unchecked(Isometry3::identity())
    }
}

impl<To: Frame, From: Frame> Rigid<To, From> {
    /// Creates the transform whose rotation has the axes of `From`, measured in `To`, as its columns (thesis Eq. 3.17).
    /// The caller ensures that the axes are orthonormal and right-handed.
    pub fn from_axes(axes: [Vector<To>; 3], origin: Point<To>) -> Self {
        let basis = nalgebra::Matrix3::from_columns(&axes.map(|axis| axis.mm));
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(basis));
        Self::from_isometry_unchecked(Isometry3::from_parts(Translation3::from(origin.mm.coords), rotation))
    }
}

impl<To: Frame, Via: Frame, From: Frame> Mul<Rigid<Via, From>> for Rigid<To, Via> {
    type Output = Rigid<To, From>;
    fn mul(self, other: Rigid<Via, From>) -> Rigid<To, From> {
        Rigid::from_isometry_unchecked(self.isometry * other.isometry)
    }
}

impl<To: Frame, From: Frame> Mul<Point<From>> for Rigid<To, From> {
    type Output = Point<To>;
    fn mul(self, point: Point<From>) -> Point<To> {
        Point::new(self.isometry * point.mm)
    }
}

impl<To: Frame, From: Frame> Mul<Vector<From>> for Rigid<To, From> {
    type Output = Vector<To>;
    fn mul(self, vector: Vector<From>) -> Vector<To> {
        Vector::new(self.isometry * vector.mm)
    }
}

/// Computes the rigid motion with the least squared distances between two lists of points (Kabsch, Acta Cryst. A32,
/// 1976). With the centroids p̄, q̄ and the singular value decomposition U S Vᵀ = Σ (p − p̄)(q − q̄)ᵀ,
///     R = U diag(1, 1, det(U Vᵀ)) Vᵀ,   t = p̄ − R q̄.
/// The determinant ensures that R is a rotation even if a reflection fits the points better (Umeyama, IEEE PAMI 13(4),
/// 1991). Returns `None` for fewer than three pairs, for points on a line and for numbers that are not finite.
pub fn fit_rigid_motion<From: Frame, To: Frame>(pairs: &[(Point<From>, Point<To>)]) -> Option<Rigid<To, From>> {
    let count = pairs.len() as f64;
    let (sum_from, sum_to) = pairs.iter().fold((Vector3::zeros(), Vector3::zeros()), |(from, to), pair| {
        (from + pair.0.mm.coords, to + pair.1.mm.coords)
    });
    let (mean_from, mean_to) = (sum_from / count, sum_to / count);
    let spread: Matrix3<f64> =
        pairs.iter().map(|(from, to)| (to.mm.coords - mean_to) * (from.mm.coords - mean_from).transpose()).sum();
    // The decomposition would not terminate for values that are not finite.
    if !spread.iter().all(|number| number.is_finite()) {
        return None;
    }
    let svd = spread.try_svd(true, true, f64::EPSILON, 0)?;
    // If the second singular value is zero, the points lie on a line, and the rotation about this line is not
    // determined.
    if pairs.len() < 3 || svd.singular_values[1] <= 1e-9 * svd.singular_values[0] {
        return None;
    }
    let (u, v_t) = (svd.u?, svd.v_t?);
    let turn = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, turn)) * v_t;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Some(Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::from(mean_to - rotation * mean_from),
        rotation,
    )))
}

/// The covariance of a pose, as the covariance of a small twist (ω, v) about a centre, in the camera's frame, rad and
/// mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseUncertainty {
    /// The pose whose uncertainty is stated.
    pub camera_from_panel: Rigid<Camera, Panel>,
    /// The point of the panel about which the twist rotates.
    pub centre: Point<Panel>,
    /// The covariance of the twist.
    pub covariance: Matrix6<f64>,
}

impl PoseUncertainty {
    /// Returns the standard deviation of a point of the panel along a unit vector, mm; NaN if the covariance is not
    /// known. With the lever arm r from the centre to the point, a twist moves the point by ω × r + v, and along n by ω
    /// · (r × n) + v · n.
    pub fn along_mm(&self, place: Point<Panel>, direction: Vector<Panel>) -> f64 {
        let arm = (self.camera_from_panel * place - self.camera_from_panel * self.centre).mm;
        let along = (self.camera_from_panel * direction).mm;
        let turning = arm.cross(&along);
        let moves = Vector6::new(turning.x, turning.y, turning.z, along.x, along.y, along.z);
        // `max` would replace a NaN by 0; `clamp` keeps it.
        (self.covariance * moves).dot(&moves).clamp(0.0, f64::INFINITY).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use proptest::prelude::*;

    fn rigid<To: Frame, From: Frame>(numbers: [f64; 6]) -> Rigid<To, From> {
        let [x, y, z, rx, ry, rz] = numbers;
        Rigid::from_isometry_unchecked(Isometry3::new(Vector3::new(x, y, z), Vector3::new(rx, ry, rz)))
    }

    /// Expected value, calculated by hand: a rotation by 90° about Z maps x̂ to ŷ, then the translation (100, 0, 0) is
    /// added.
    #[test]
    fn a_transform_rotates_first_and_then_translates() {
        let base_from_panel: Rigid<Base, Panel> = rigid([100.0, 0.0, 0.0, 0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let moved = base_from_panel * Point::<Panel>::at(10.0, 0.0, 0.0);
        assert!((moved.mm - Point3::new(100.0, 10.0, 0.0)).norm() < 1e-12);
        let axis = base_from_panel * Vector::<Panel>::new(Vector3::x());
        assert!((axis.mm - Vector3::y()).norm() < 1e-12, "a direction is turned, not shifted");
    }

    #[test]
    fn axes_are_the_columns_of_the_rotation() {
        let axes = [Vector3::y(), Vector3::z(), Vector3::x()].map(Vector::<Base>::new);
        let base_from_panel: Rigid<Base, Panel> = Rigid::from_axes(axes, Point::at(1.0, 2.0, 3.0));
        let moved = base_from_panel * Point::<Panel>::at(5.0, 0.0, 0.0);
        assert!((moved.mm - Point3::new(1.0, 7.0, 3.0)).norm() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_inverse_cancels_and_products_are_associative(
            a in prop::array::uniform6(-3.0..3.0f64),
            b in prop::array::uniform6(-3.0..3.0f64),
            p in prop::array::uniform3(-500.0..500.0f64),
        ) {
            let base_from_panel: Rigid<Base, Panel> = rigid(a);
            let panel_from_camera: Rigid<Panel, Camera> = rigid(b);
            let point = Point::<Camera>::at(p[0], p[1], p[2]);
            let there = (base_from_panel * panel_from_camera) * point;
            prop_assert!(there.distance_mm(base_from_panel * (panel_from_camera * point)) < 1e-9);
            let back = (base_from_panel * panel_from_camera).inverse() * there;
            prop_assert!(back.distance_mm(point) < 1e-9);
        }
    }

    /// Expected value, calculated by hand: a rotation by 90° about Z and a shift of (10, 0, 0) map (1, 0, 0) to (10, 1,
    /// 0).
    #[test]
    fn the_rigid_motion_of_a_quarter_turn_is_fitted() {
        let pairs: [(Point<Panel>, Point<Base>); 3] = [
            (Point::at(0.0, 0.0, 0.0), Point::at(10.0, 0.0, 0.0)),
            (Point::at(1.0, 0.0, 0.0), Point::at(10.0, 1.0, 0.0)),
            (Point::at(0.0, 1.0, 0.0), Point::at(9.0, 0.0, 0.0)),
        ];
        let moved = fit_rigid_motion(&pairs).expect("three points") * Point::at(2.0, 0.0, 5.0);
        assert!(moved.distance_mm(Point::at(10.0, 2.0, 5.0)) < 1e-9, "{moved:?}");
    }

    #[test]
    fn points_on_a_line_determine_no_motion() {
        let on_line = |i: f64| (Point::<Panel>::at(i, 2.0 * i, 0.0), Point::<Base>::at(i, 2.0 * i, 0.0));
        assert!(fit_rigid_motion(&[1.0, 2.0, 3.0, 4.0].map(on_line)).is_none());
        assert!(fit_rigid_motion::<Panel, Base>(&[]).is_none());
        let not_a_number =
            [0.0, 1.0, f64::NAN].map(|i| (Point::<Panel>::at(i, i * i, 0.0), Point::<Base>::at(i, i * i, 0.0)));
        assert!(fit_rigid_motion(&not_a_number).is_none());
    }

    proptest! {
        /// Points in a plane do not determine the sign of the third singular vectors. Without the determinant, every
        /// second rotation in this test would result in a reflection.
        #[test]
        fn a_plane_panel_is_never_mirrored(turn in prop::array::uniform3(-2.0..2.0f64), shift in prop::array::uniform3(-99.0..99.0f64)) {
            let truth: Rigid<Base, Panel> = Rigid::from_isometry_unchecked(Isometry3::new(shift.into(), turn.into()));
            let pairs: Vec<_> = [(0.0, 0.0), (300.0, 0.0), (280.0, 200.0), (-20.0, 190.0)]
                .iter()
                .map(|&(y, z)| (Point::at(560.0, y, z), truth * Point::at(560.0, y, z)))
                .collect();
            let found = fit_rigid_motion(&pairs).expect("a plane");
            prop_assert!(found.distance_at_mm(truth, Point::at(700.0, 50.0, 80.0)) < 1e-8);
        }
    }

    /// Expected values, calculated by hand: a tilt of 1 mrad about y moves a point that is 100 mm away along x by 0.1
    /// mm along the normal. Together with a shift of 0.05 mm, the standard deviation is 0.1118 mm. Along x the point
    /// does not move.
    #[test]
    fn a_tilt_is_multiplied_by_its_lever_arm() {
        let turned = Isometry3::rotation(Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
        let mut covariance = Matrix6::zeros();
        // The panel's y axis is the camera's −x axis.
        covariance[(0, 0)] = 1e-6;
        covariance[(5, 5)] = 0.0025;
        let camera_from_panel = Rigid::from_isometry_unchecked(turned);
        let pose = PoseUncertainty { camera_from_panel, centre: Point::at(5.0, 0.0, 0.0), covariance };
        let place = Point::at(105.0, 0.0, 0.0);
        let [normal, aside] = [Vector3::z(), Vector3::x()].map(|axis| pose.along_mm(place, Vector::new(axis)));
        assert!((normal - 0.111_803).abs() < 1e-6 && aside < 1e-12, "{normal} {aside}");
    }

    #[test]
    fn an_unknown_covariance_gives_nan() {
        let camera_from_panel = Rigid::from_isometry_unchecked(Isometry3::identity());
        let covariance = Matrix6::repeat(f64::NAN);
        let pose = PoseUncertainty { camera_from_panel, centre: Point::at(0.0, 0.0, 0.0), covariance };
        assert!(pose.along_mm(Point::at(1.0, 0.0, 0.0), Vector::new(Vector3::z())).is_nan());
    }

    /// 180° is π rad.
    #[test]
    fn degrees_and_radians_convert_into_each_other() {
        assert!((Degrees(180.0).to_rad() - std::f64::consts::PI).abs() < 1e-15);
        assert!((Degrees::from_rad(std::f64::consts::FRAC_PI_6).0 - 30.0).abs() < 1e-12);
    }

    /// Pixel (−0.4, 1.6) is in column 0, row 2; a pixel more than half a pixel beyond the last column is outside.
    #[test]
    fn whole_pixels_end_half_a_pixel_outside_the_centres() {
        assert_eq!(Pixel::at(-0.4, 1.6).nearest_whole(4, 3), Some((0, 2)));
        assert_eq!(Pixel::at(3.6, 1.0).nearest_whole(4, 3), None);
        assert_eq!(Pixel::at(f64::NAN, 1.0).nearest_whole(4, 3), None);
    }
}
