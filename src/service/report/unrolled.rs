//! The unrolled region: grids as boxes over its unit square, with the dimensions of the panel along its middle
//! lines.

use super::canvas::{Canvas, InkColor, PenWidth};
use panelprep_base::geometry::{ColorPicture, Pixel};
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::{GridId, Region};

/// Number of pixels along the region's longer side.
const PICTURE_PX: usize = 900;

/// The size at which the region is drawn.
pub(super) struct UnrolledRegion {
    px_per_mm: f64,
    size_px: [f64; 2],
}

impl UnrolledRegion {
    /// Creates the drawing size of a region with these lengths along u and v, mm.
    pub fn new(sides_mm: [f64; 2]) -> Self {
        let px_per_mm = PICTURE_PX as f64 / sides_mm[0].max(sides_mm[1]).max(1.0);
        UnrolledRegion { px_per_mm, size_px: sides_mm.map(|side_mm| side_mm * px_per_mm) }
    }

    /// Completes the picture with the edges and names of these grids, a scale bar and a legend.
    pub fn finished(
        &self,
        picture: &ColorPicture,
        (region, grids): (&Region, &[(GridId, usize, usize)]),
        legend: &[(InkColor, &str)],
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(picture)?;
        let text_px = (self.size_px[1] / 40.0).max(12.0);
        for (id, ..) in grids {
            let edge = self.edge_px(region, *id);
            canvas.polyline(&edge, true, PenWidth { ink: InkColor::WHITE, width_px: 1 })?;
            let corner = Pixel::at(edge[0].u + text_px * 0.4, edge[0].v + text_px * 1.3);
            canvas.label(corner, &id.to_string(), text_px, InkColor::WHITE)?;
        }
        canvas.scale_bar_within(self.px_per_mm)?;
        canvas.with_legend(legend)?.finish()
    }

    fn edge_px(&self, region: &Region, id: GridId) -> [Pixel; 4] {
        let [low, high] = region.unit_box(id);
        let place = |u: f64, v: f64| Pixel::at(u * self.size_px[0], v * self.size_px[1]);
        [place(low.x, low.y), place(high.x, low.y), place(high.x, high.y), place(low.x, high.y)]
    }
}

/// Paints each pixel of some grids in the colour of its sample. A grid consists of its name, the number of samples
/// along u, and all samples.
pub(super) fn paint_grids(
    unrolled: &UnrolledRegion,
    (region, grids): (&Region, &[(GridId, usize, usize)]),
    ground: InkColor,
    color: impl Fn(usize, usize, (usize, usize)) -> InkColor,
) -> ColorPicture {
    let [width, height] = unrolled.size_px.map(|size| (size as usize).max(1));
    let mut picture = ColorPicture::uniform(width, height, ground.0);
    for (number, (id, columns, samples)) in grids.iter().enumerate() {
        let [low, high] = region.unit_box(*id);
        let rows = samples / (*columns).max(1);
        let start = |low: f64, size: usize| (low * size as f64).round() as usize;
        let index = |at: usize, size: usize, low: f64, high: f64, count: usize| {
            let share = ((at as f64 + 0.5) / size as f64 - low) / (high - low);
            ((share * count as f64).max(0.0) as usize).min(count.saturating_sub(1))
        };
        let across = start(low.x, width)..start(high.x, width).min(width);
        let columns_of: Vec<usize> = across.clone().map(|x| index(x, width, low.x, high.x, *columns)).collect();
        for y in start(low.y, height)..start(high.y, height).min(height) {
            let row = index(y, height, low.y, high.y, rows);
            let pixels = &mut picture.rgb[y * width + across.start..y * width + across.end];
            for ((x, column), pixel) in across.clone().zip(&columns_of).zip(pixels) {
                *pixel = color(number, row * columns + column, (x, y)).0;
            }
        }
    }
    picture
}
