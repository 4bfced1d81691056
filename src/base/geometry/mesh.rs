//! A triangle mesh as read from its file: vertices, triangles, and the objects to which the triangles belong.
//!
//! A drawing's file may contain no unit. Therefore coordinates become lengths only together with a [`LengthUnit`].

/// Words that may stand between "unit" and the name of the unit.
const UNIT_FILLER_WORDS: [&str; 4] = ["in", "is", "are", "all"];
/// Names of length units that are recognised but not supported in a drawing.
const OTHER_UNITS: [&str; 16] = [
    "cm",
    "centimeter",
    "centimeters",
    "centimetre",
    "centimetres",
    "dm",
    "km",
    "ft",
    "foot",
    "feet",
    "mil",
    "mils",
    "um",
    "micron",
    "microns",
    "yard",
];

/// Returns whether a word names a unit of length.
fn is_length_unit(word: &str) -> bool {
    LengthUnit::from_name(word).is_some() || OTHER_UNITS.iter().any(|other| other.eq_ignore_ascii_case(word))
}

/// The unit of length of a drawing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Millimetres.
    Millimetre,
    /// Inches of 25.4 mm.
    Inch,
    /// Metres.
    Metre,
}

impl LengthUnit {
    /// All units, each with its names in options and files; the first name is the abbreviation.
    pub const ALL: [(LengthUnit, &'static [&'static str]); 3] = [
        (LengthUnit::Millimetre, &["mm", "millimeter", "millimeters", "millimetre", "millimetres"]),
        (LengthUnit::Inch, &["in", "inch", "inches"]),
        (LengthUnit::Metre, &["m", "meter", "meters", "metre", "metres"]),
    ];

    /// Returns the unit with this name, in upper or lower case.
    pub fn from_name(name: &str) -> Option<Self> {
        let is_named = |names: &[&str]| names.iter().any(|known| known.eq_ignore_ascii_case(name));
        LengthUnit::ALL.into_iter().find(|(_, names)| is_named(names)).map(|(unit, _)| unit)
    }

    /// Returns the unit that a comment of the file contains, as in "units: mm", "units in mm" or "unit = inches";
    /// `None` if the comment contains no unit.
    ///
    /// # Errors
    /// If the comment contains a unit that is not supported: another unit, as in "units: cm", or a multiple, as in
    /// "unit: 0.001 m". The error contains the unit's text.
    pub fn from_comment(comment: &str) -> Result<Option<Self>, String> {
        let is_of_word = |c: char| c.is_alphanumeric() || c == '.';
        let mut words = comment.split(|c: char| !is_of_word(c)).map(|word| word.trim_matches('.'));
        if !words.any(|word| word.eq_ignore_ascii_case("unit") || word.eq_ignore_ascii_case("units")) {
            return Ok(None);
        }
        let mut rest = words.filter(|word| !word.is_empty());
        // The word "in" means inch only if no unit follows: in "units in mm" it is a preposition.
        let is_filler = |word: &str| UNIT_FILLER_WORDS.iter().any(|filler| filler.eq_ignore_ascii_case(word));
        let mut ahead = rest.clone();
        while ahead.next().is_some_and(is_filler)
            && ahead.clone().next().is_some_and(|next| is_length_unit(next) || is_filler(next))
        {
            rest.next();
        }
        let Some(word) = rest.next() else { return Ok(None) };
        let next = rest.next().filter(|next| is_length_unit(next));
        match (LengthUnit::from_name(word), word.parse::<f64>().is_ok(), next) {
            (Some(unit), _, _) => Ok(Some(unit)),
            (None, true, Some(next)) => Err(format!("{word} {next}")),
            (None, false, _) if is_length_unit(word) => Err(word.to_owned()),
            _ => Ok(None),
        }
    }

    /// Returns the length of one unit, mm.
    pub fn to_mm(self) -> f64 {
        match self {
            LengthUnit::Millimetre => 1.0,
            LengthUnit::Inch => 25.4,
            LengthUnit::Metre => 1_000.0,
        }
    }

    /// Returns the unit's abbreviation.
    pub fn abbreviation(self) -> &'static str {
        match self {
            LengthUnit::Millimetre => "mm",
            LengthUnit::Inch => "in",
            LengthUnit::Metre => "m",
        }
    }
}

/// An object of a mesh file. It consists of the triangles from its first triangle to the first triangle of the next
/// object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshObject {
    /// The object's name; empty if the file does not name it.
    pub name: String,
    /// The index of the object's first triangle.
    pub first_triangle: usize,
}

/// A mesh as read from its file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TriangleMesh {
    /// The vertices, in the file's unit and frame; all coordinates are finite.
    pub vertices: Vec<[f64; 3]>,
    /// The triangles, each as the indices of its three vertices.
    pub triangles: Vec<[u32; 3]>,
    /// The objects in the order of the file.
    pub objects: Vec<MeshObject>,
    /// The unit, if the file contains one.
    pub unit: Option<LengthUnit>,
}

impl TriangleMesh {
    /// Begins another object at the next triangle. If the previous object has no triangles, it is removed.
    pub fn begin_object(&mut self, name: &str) {
        let first_triangle = self.triangles.len();
        if self.objects.last().is_some_and(|last| last.first_triangle == first_triangle) {
            self.objects.pop();
        }
        self.objects.push(MeshObject { name: name.to_owned(), first_triangle });
    }

    /// Returns each object's name with its triangles; triangles before the first object belong to an object
    /// without a name.
    pub fn objects(&self) -> impl Iterator<Item = (&str, &[[u32; 3]])> + '_ {
        let first = self.objects.first().map_or(self.triangles.len(), |object| object.first_triangle);
        let before = (first > 0).then(|| ("", &self.triangles[..first]));
        let ends = self.objects.iter().skip(1).map(|next| next.first_triangle).chain([self.triangles.len()]);
        let named = self
            .objects
            .iter()
            .zip(ends)
            .map(|(object, end)| (object.name.as_str(), &self.triangles[object.first_triangle..end]))
            .filter(|(_, triangles)| !triangles.is_empty());
        before.into_iter().chain(named)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three triangles and three objects: the first triangle comes before any object, and the first object is empty.
    #[test]
    fn triangles_belong_to_the_object_before_them() {
        let mut mesh = TriangleMesh { triangles: vec![[0, 1, 2]], ..TriangleMesh::default() };
        mesh.begin_object("empty");
        mesh.begin_object("skin");
        mesh.triangles.push([1, 2, 3]);
        mesh.begin_object("rib");
        mesh.triangles.push([2, 3, 4]);
        mesh.begin_object("end");
        let objects: Vec<_> = mesh.objects().collect();
        assert_eq!(objects, [("", &[[0, 1, 2]][..]), ("skin", &[[1, 2, 3]][..]), ("rib", &[[2, 3, 4]][..])]);
    }

    #[test]
    fn units_have_names() {
        assert_eq!(LengthUnit::from_name("Inches"), Some(LengthUnit::Inch));
        assert_eq!(LengthUnit::from_name("ft"), None);
        assert_eq!(LengthUnit::from_comment("made by x, UNITS=mm"), Ok(Some(LengthUnit::Millimetre)));
        assert_eq!(LengthUnit::from_comment("unit: metres"), Ok(Some(LengthUnit::Metre)));
        assert_eq!(LengthUnit::from_comment("units in mm"), Ok(Some(LengthUnit::Millimetre)));
        assert_eq!(LengthUnit::from_comment("all units are in millimeters."), Ok(Some(LengthUnit::Millimetre)));
        assert_eq!(LengthUnit::from_comment("units: in"), Ok(Some(LengthUnit::Inch)));
        assert_eq!(
            ["unit 1", "mm", "units of measure: mm", "community inch"].map(LengthUnit::from_comment),
            [Ok(None), Ok(None), Ok(None), Ok(None)]
        );
        let refused = ["units: cm", "unit: 0.001 m", "units in feet"].map(LengthUnit::from_comment);
        assert_eq!(refused, ["cm", "0.001 m", "feet"].map(|words| Err(words.to_owned())));
        assert_eq!(LengthUnit::ALL.map(|(unit, names)| names[0] == unit.abbreviation()), [true; 3]);
    }
}
