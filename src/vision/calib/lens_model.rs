//! Which distortion coefficients a lens model has, from none to all five.

use strum::{IntoStaticStr, VariantArray};

/// A lens model; each contains the coefficients of the models before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, IntoStaticStr, VariantArray)]
pub enum LensModel {
    /// No distortion.
    #[strum(serialize = "pinhole")]
    Pinhole,
    /// k1.
    #[strum(serialize = "k1")]
    Radial1,
    /// k1, k2.
    #[strum(serialize = "k1k2")]
    Radial2,
    /// k1, k2, p1, p2.
    #[strum(serialize = "k1k2p1p2")]
    Tangential,
    /// k1, k2, p1, p2, k3.
    #[strum(serialize = "k1k2p1p2k3")]
    Full,
}

/// The index of each coefficient among fx, fy, cx, cy, k1, k2, p1, p2, k3.
const COEFFICIENTS: [(&str, usize, LensModel); 5] = [
    ("k1", 4, LensModel::Radial1),
    ("k2", 5, LensModel::Radial2),
    ("p1", 6, LensModel::Tangential),
    ("p2", 7, LensModel::Tangential),
    ("k3", 8, LensModel::Full),
];

impl LensModel {
    /// All models, the simplest first.
    pub const ALL: &'static [LensModel] = <Self as VariantArray>::VARIANTS;

    /// The model's name on the command line and in files.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns whether the parameter at this index among fx, fy, cx, cy, k1, k2, p1, p2, k3 belongs to the model.
    pub fn contains_parameter(self, place: usize) -> bool {
        COEFFICIENTS.iter().find(|(_, at, _)| *at == place).is_none_or(|(_, _, model)| *model <= self)
    }

    /// Returns the number of the model's parameters, including focal lengths and principal point.
    pub fn count(self) -> usize {
        (0..9).filter(|place| self.contains_parameter(*place)).count()
    }

    /// Returns the coefficients that this model has and the previous model does not have.
    pub fn added(self) -> Vec<&'static str> {
        COEFFICIENTS.iter().filter(|(_, _, model)| *model == self).map(|(name, ..)| *name).collect()
    }

    /// Returns the coefficients that are not in the model.
    pub fn excluded_coefficients(self) -> Vec<&'static str> {
        COEFFICIENTS.iter().filter(|(_, _, model)| *model > self).map(|(name, ..)| *name).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_model_adds_to_the_one_before() {
        assert_eq!(LensModel::ALL.iter().map(|model| model.count()).collect::<Vec<_>>(), [4, 5, 6, 8, 9]);
        assert_eq!(LensModel::Radial2.excluded_coefficients(), ["p1", "p2", "k3"]);
        assert!(LensModel::Full.excluded_coefficients().is_empty());
    }
}
