use super::super::flat::{FlatPanelOptions, taught};
use super::*;

fn found(flat: FlatPanelOptions) -> Vec<OffPanel> {
    taught(&flat).region_off_panel(12.0, &[])
}

/// A region inside the panel, with noise and some missing points, does not extend beyond the panel.
#[test]
fn a_region_on_the_panel_is_on_it() {
    assert_eq!(found(FlatPanelOptions::default()), []);
    assert_eq!(found(FlatPanelOptions { dropouts: true, ..FlatPanelOptions::default() }), []);
    // A panel edge that coincides with the region's edge is not an overhang: here both end at column 250.
    assert_eq!(found(FlatPanelOptions { region_right_px: 250.0, ..FlatPanelOptions::default() }), []);
}

/// Calculated by hand: a pixel is 1 mm at 700 mm. A notch of 20 × 12 px enters the panel from above, columns 140 to
/// 159. The region begins in row 45, seven rows above the notch's end, row 52. The place farthest from the panel
/// lies in the notch's middle on the region's edge.
#[test]
fn a_region_over_the_edge_is_measured_and_named() {
    let off = found(FlatPanelOptions { notch: Some(140), ..FlatPanelOptions::default() });
    let [OffPanel { gap_kind: GapKind::Edge, size_mm: Some(mm), pixel: at, grid, corner: None, grids }] = &off[..]
    else {
        panic!("{off:?}")
    };
    assert!((mm - 7.0).abs() < 1.0, "{mm} mm");
    assert!((140.0..160.0).contains(&at.u) && at.v == 45.0, "{at:?}");
    // The region has 180 px in six columns: the notch lies over px 80 to 100 of the region, in the third and fourth
    // column.
    assert_eq!(
        (grid.row, grids.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")),
        (1, "r1c3 r1c4".to_owned())
    );
    let reason = off[0].reason();
    assert_eq!(reason.code, "region_off_panel");
    assert!(
        reason.message.contains("extends beyond the panel's edge by ") && reason.message.contains("r1c3, r1c4"),
        "{}",
        reason.message
    );
}

/// Calculated by hand: the same notch, from column 219 on, ends one pixel before the region's corner 2. The corner
/// itself is on the panel.
#[test]
fn a_corner_beside_which_the_region_hangs_over_is_named() {
    let off = found(FlatPanelOptions { notch: Some(219), ..FlatPanelOptions::default() });
    let [OffPanel { gap_kind: GapKind::Edge, corner: Some(2), grid, .. }] = &off[..] else { panic!("{off:?}") };
    assert_eq!(grid.to_string(), "r1c6");
    assert!(
        off[0].reason().message.contains("near corner 2 of the region, in grid r1c6"),
        "{}",
        off[0].reason().message
    );
}

/// By hand: a hole of 17 × 17 px, through which the background is seen 160 mm behind, so 17 mm. Its middle is (188,
/// 98), in the fifth column and second row. A hole of 9 mm is smaller than the limit for a hole, and a masked hole is
/// already known to the person.
#[test]
fn a_hole_is_measured_and_named() {
    let off = found(FlatPanelOptions { hole_px: 17, ..FlatPanelOptions::default() });
    let [OffPanel { gap_kind: GapKind::Hole, size_mm: Some(mm), pixel: at, grid, corner: None, .. }] = &off[..]
    else {
        panic!("{off:?}")
    };
    assert!((mm - 17.0).abs() < 0.5, "{mm} mm");
    assert!((at.u - 188.0).abs() < 1.0 && (at.v - 98.0).abs() < 1.0 && grid.to_string() == "r2c5", "{at:?} {grid}");
    let reason = off[0].reason();
    assert!(
        reason.code == "region_over_hole" && reason.message.contains("17.0 mm in grid r2c5"),
        "{}",
        reason.message
    );
    assert_eq!(found(FlatPanelOptions { hole_px: 9, ..FlatPanelOptions::default() }), []);
    let mask = [[175.0, 85.0], [201.0, 85.0], [201.0, 111.0], [175.0, 111.0]];
    assert_eq!(
        taught(&FlatPanelOptions { hole_px: 17, ..FlatPanelOptions::default() }).region_off_panel(12.0, &[mask]),
        []
    );
}

/// Inside a person's outline, missing points are not a hole; a place at which the background is seen is a hole.
#[test]
fn a_drawn_outline_states_what_is_panel() {
    let drawn = |sees_through: bool| {
        found(FlatPanelOptions {
            hole_px: 17,
            is_drawn: true,
            is_hole_empty: !sees_through,
            ..FlatPanelOptions::default()
        })
    };
    assert_eq!(drawn(false), []);
    assert!(matches!(drawn(true)[..], [OffPanel { gap_kind: GapKind::Hole, .. }]), "{:?}", drawn(true));
}
