//! The tool's orientation on the surface (thesis 4.7).
//!
//! Tool Z = −N, out of the pad and into the panel (4.17). The thesis uses Y = Z × (0, 0, −1), which is not defined if
//! the normal is vertical, and changes rapidly near that direction. Here X is a reference direction projected
//! perpendicular to Z, so that
//!     X = (e − (e·Z) Z) / |…|,   Y = Z × X.                                              (4.18, 4.19 replaced)
//! The reference e is the recipe's axis, or the feed *axis* S_u with one sign for the whole path: the feed direction
//! itself would rotate the wrist by 180° at every row. If e is nearly parallel to the normal, the path is rejected.

use crate::surface::{BSplineSurface, Parameter};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Degrees, Panel, Point, Rigid, Tool, Vector};
use panelprep_cell::recipe;

/// Minimum angle between a reference and the normal at which the reference determines the tool's rotation about the
/// normal.
const MIN_ANGLE: Degrees = Degrees(6.0);

/// The reference direction for the tool's rotation about the normal (spin).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpinReference {
    /// The axis along which rows run, S_u of the surface.
    Feed,
    /// A direction in the panel's frame.
    Axis(Vector<Panel>),
}

impl SpinReference {
    /// Returns the recipe's `reference_axis`; if it is zero, the feed axis.
    pub fn from_settings(settings: &recipe::Path) -> Self {
        let axis = Vector::new(Vector3::from(settings.reference_axis()));
        axis.direction().map_or(SpinReference::Feed, SpinReference::Axis)
    }
}

/// The settings of the tool's orientation: its spin, and its inclination.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolOrientation {
    /// The reference direction for the spin.
    pub reference: SpinReference,
    /// Rotation about the tool's own Y axis: the tool leans along its X axis. The sign is the same for the whole path,
    /// in both directions of the rows.
    pub lead: Degrees,
    /// Rotation about the tool's own X axis, after the lead.
    pub tilt: Degrees,
}

impl ToolOrientation {
    /// Creates the orientation from the recipe's settings.
    pub fn from_settings(settings: &recipe::Path) -> Self {
        ToolOrientation {
            reference: SpinReference::from_settings(settings),
            lead: Degrees(settings.lead_deg()),
            tilt: Degrees(settings.tilt_deg()),
        }
    }

    fn inclination(&self) -> Rigid<Tool, Tool> {
        let turn = |axis: nalgebra::Unit<Vector3<f64>>, angle: Degrees| {
            UnitQuaternion::from_axis_angle(&axis, angle.to_rad())
        };
        let lean = turn(Vector3::y_axis(), self.lead) * turn(Vector3::x_axis(), self.tilt);
        Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::identity(), lean))
    }
}

/// The reasons why the tool has no pose at a point of the surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OrientationError {
    /// The surface has no normal.
    #[error("the surface has no normal at (u, v) = ({:.4}, {:.4}); scan the panel again", at.u, at.v)]
    NoNormal {
        /// The parameters of the point.
        at: Parameter,
    },
    /// The reference is nearly parallel to the normal and does not determine the spin.
    #[error(
        "reference_axis is {angle} from the normal, at least {MIN_ANGLE} are needed; choose an axis along the \
         panel, or [0, 0, 0] for the feed axis"
    )]
    ReferenceAlongNormal {
        /// Angle between the reference and the normal, 0…90°.
        angle: Degrees,
    },
}

/// Returns the tool's pose at a point of the surface, with its tip `height_mm` above the surface along the normal; lead
/// and tilt rotate the tool about its tip.
///
/// # Errors
/// If the surface has no normal at this point, or the reference is nearly parallel to the normal.
pub fn panel_from_tool(
    surface: &BSplineSurface,
    at: Parameter,
    height_mm: f64,
    stance: ToolOrientation,
) -> Result<Rigid<Panel, Tool>, OrientationError> {
    let tangents = surface.tangents(at);
    let normal = surface.unit_normal(&tangents).ok_or(OrientationError::NoNormal { at })?;
    let axis = match stance.reference {
        SpinReference::Feed => tangents.s_u.mm.normalize(),
        SpinReference::Axis(axis) => axis.mm,
    };
    let z = -normal.mm; // Eq. 4.17
    // Z follows the normal exactly and only the spin follows the reference: the pad must lie flat, but its spin has no
    // influence.
    let across = axis - z * axis.dot(&z);
    let sine = across.norm();
    if sine < MIN_ANGLE.to_rad().sin() {
        return Err(OrientationError::ReferenceAlongNormal { angle: Degrees::from_rad(sine.asin()) });
    }
    let x = across / sine;
    let origin: Point<Panel> = tangents.point + normal * height_mm;
    let upright: Rigid<Panel, Tool> = Rigid::from_axes([x, z.cross(&x), z].map(Vector::new), origin);
    Ok(upright * stance.inclination())
}
