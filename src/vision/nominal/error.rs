//! The reasons why a drawing cannot be used to teach a panel.

use panelprep_base::geometry::LengthUnit;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};

/// Maximum number of parts that a message lists.
const MAX_LISTED: usize = 12;

/// A part of a drawing, as a message lists it.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedPart {
    /// Name of the part.
    pub name: String,
    /// Side lengths of the bounding box, mm.
    pub size_mm: [f64; 3],
    /// Surface area, mm².
    pub area_mm2: f64,
}

/// The reason why a drawing cannot be used to teach a panel.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NominalError {
    /// Neither the file nor the caller states the unit.
    #[error("the file states no unit, and --unit was not given: the drawing would be {}; state the unit", sizes(*size))]
    NoUnit {
        /// Side lengths of the bounding box, in the unit of the file.
        size: [f64; 3],
    },
    /// The file and the caller state different units.
    #[error("the file states the unit {}, but --unit is {}; omit --unit, or correct the unit in the file's comment", stated.abbreviation(), given.abbreviation())]
    OtherUnit {
        /// The unit that the file states.
        stated: LengthUnit,
        /// The unit of the command line.
        given: LengthUnit,
    },
    /// The drawing is larger than any panel, or far from its own origin.
    #[error(
        "the size of the drawing is {} mm, and it extends {} mm from its origin (limits {} mm and {} mm): check \
         --unit, or export the panel alone, in its own frame", size(*size_mm), fixed_decimals(*reach_mm, 0), fixed_decimals(*limit_mm, 0), fixed_decimals(*reach_limit_mm, 0)
    )]
    TooLarge {
        /// Side lengths of the bounding box, mm.
        size_mm: [f64; 3],
        /// Maximum side length, mm.
        limit_mm: f64,
        /// Maximum absolute coordinate, mm.
        reach_mm: f64,
        /// Maximum absolute coordinate that is permitted, mm.
        reach_limit_mm: f64,
    },
    /// There are several parts, and none was selected.
    #[error("the drawing has {} parts that do not touch: {}; name the panel with --part NAME", parts.len(), list(parts))]
    SeveralParts {
        /// All parts, the largest first.
        parts: Vec<ListedPart>,
    },
    /// All triangles are smaller than the distance within which vertices are joined.
    #[error(
        "the size of the drawing is {} mm, and all its triangles are smaller than {} mm, the distance within which \
         vertices are joined: check --unit",
        size(*size_mm), fixed_decimals(*weld_mm, 3)
    )]
    NothingLeft {
        /// Distance within which vertices are joined, mm.
        weld_mm: f64,
        /// Side lengths of the bounding box, mm.
        size_mm: [f64; 3],
    },
    /// No part has this name.
    #[error("the drawing has no part \"{name}\"; its parts are: {}", list(parts))]
    NoPart {
        /// The given name.
        name: String,
        /// All parts, the largest first.
        parts: Vec<ListedPart>,
    },
    /// Three or more triangles meet at one edge.
    #[error(
        "three or more faces meet at {count} edges of the part, the first near {} mm of the drawing: bodies are joined there, or a face \
         exists twice; export the panel alone, as one body", format_point(*at_mm)
    )]
    ManyFaces {
        /// Number of these edges.
        count: usize,
        /// Centre of the first edge in the drawing frame, mm.
        at_mm: [f64; 3],
    },
    /// The borders of two faces are beside each other, but do not meet.
    #[error(
        "the faces of the part do not meet: a gap of {} mm near {} mm of the drawing (limit {} mm), at {count} edges; sew the \
         faces in the CAD system before the export, or export with a smaller deviation",
        distinguishable_texts(*width_mm, *limit_mm, 3)[0], format_point(*at_mm), distinguishable_texts(*width_mm, *limit_mm, 3)[1]
    )]
    Gap {
        /// Width of the widest gap, mm.
        width_mm: f64,
        /// Maximum width of a harmless gap, mm.
        limit_mm: f64,
        /// Position of the widest gap in the drawing frame, mm.
        at_mm: [f64; 3],
        /// Number of edges at gaps.
        count: usize,
    },
    /// The surface passes through itself.
    #[error(
        "the surface of the part passes through itself at {count} edges, the first near {} mm of the drawing; correct the \
         body in the CAD system (a union of its bodies), then export it again", format_point(*at_mm)
    )]
    CrossesItself {
        /// Number of edges that pass through a face.
        count: usize,
        /// First position in the drawing frame, mm.
        at_mm: [f64; 3],
    },
    /// The drawing is not in the search box.
    #[error(
        "the drawing at its nominal pose lies from {} to {} mm in the robot's base, but the search box in [locate] \
         from {} to {} mm; check the unit, [nominal], and the box", format_point(*min_mm), format_point(*max_mm), format_point(*from_mm), format_point(*to_mm)
    )]
    OutsideSearchBox {
        /// Lower corner of the drawing's bounding box in the base frame, mm.
        min_mm: [f64; 3],
        /// Upper corner of the drawing's bounding box in the base frame, mm.
        max_mm: [f64; 3],
        /// Lower corner of the search box, mm.
        from_mm: [f64; 3],
        /// Upper corner of the search box, mm.
        to_mm: [f64; 3],
    },
    /// No ray meets the drawing.
    #[error(
        "the 3D camera does not see the drawing at its nominal pose: its bounding box lies from {} to {} mm in the \
         robot's base; check the unit and [nominal] base_from_drawing or its datum points", format_point(*min_mm), format_point(*max_mm)
    )]
    NotSeen {
        /// Lower corner of the drawing's bounding box in the base frame, mm.
        min_mm: [f64; 3],
        /// Upper corner of the drawing's bounding box in the base frame, mm.
        max_mm: [f64; 3],
    },
    /// The lens model has no ray for a pixel.
    #[error("the camera's lens calibration has no ray for the pixel ({u}, {v}); calibrate the lens again")]
    NoRay {
        /// Column of the pixel.
        u: usize,
        /// Row of the pixel.
        v: usize,
    },
}

fn format_point(mm: [f64; 3]) -> String {
    format!("({})", mm.map(|mm| fixed_decimals(mm, 1).to_string()).join(", "))
}

fn size(mm: [f64; 3]) -> String {
    mm.map(|mm| fixed_decimals(mm, if mm < 10.0 { 2 } else { 0 }).to_string()).join(" × ")
}

fn sizes(numbers: [f64; 3]) -> String {
    let with = |(unit, _): (LengthUnit, _)| {
        format!("{} mm with --unit {}", size(numbers.map(|number| number * unit.to_mm())), unit.abbreviation())
    };
    LengthUnit::ALL.map(with).join(", ")
}

fn list(parts: &[ListedPart]) -> String {
    let part = |part: &ListedPart| {
        format!("\"{}\" ({} mm, {} cm²)", part.name, size(part.size_mm), fixed_decimals(part.area_mm2 / 100.0, 1))
    };
    let mut words: Vec<String> = parts.iter().take(MAX_LISTED).map(part).collect();
    if parts.len() > MAX_LISTED {
        words.push(format!("and {} smaller ones", parts.len() - MAX_LISTED));
    }
    words.join(", ")
}
