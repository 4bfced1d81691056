//! The faults of a clip and its labels that stop a command.

use std::path::PathBuf;

/// The reason why a clip, or its labels, cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum ClipFault {
    /// A film would overwrite another film.
    #[error("{} already contains a film (clip.csv or 00001.png); name another folder", folder.display())]
    ClipExists {
        /// The folder.
        folder: PathBuf,
    },
    /// A folder without a clip.
    #[error(
        "{}: there is no clip.csv; a clip is a folder of numbered pictures with a clip.csv that states the time of each \
         picture, as `panelprep shoot film` writes it", folder.display()
    )]
    NoClip {
        /// The folder.
        folder: PathBuf,
    },
    /// A clip of a set that has no labels.
    #[error(
        "{}: the clip has no labels: no mask.png in its folder truth or next to its pictures; mark the breaks with \
         `panelprep label --clip {}`",
        clip.display(), clip.display()
    )]
    NoLabels {
        /// The clip's folder.
        clip: PathBuf,
    },
    /// Labels that cannot be read.
    #[error("{}: {cause}; move the file away to begin with new labels", file.display())]
    BadLabels {
        /// The file.
        file: PathBuf,
        /// The problem of the labels.
        cause: panelprep_cell::labels::FormError,
    },
    /// A person labelled another clip, or this clip before it was changed.
    #[error(
        "{}: these labels were made for other pictures than those of {}; check each break again with `panelprep \
         label --clip {}`",
        labels.display(), clip.display(), clip.display()
    )]
    OtherClip {
        /// The labels' file.
        labels: PathBuf,
        /// The clip's folder.
        clip: PathBuf,
    },
    /// A mask would overwrite the labels of a person.
    #[error(
        "{}: contains labels of a person, which the mask of this inspection would overwrite; name another folder for --pictures",
        folder.display()
    )]
    HoldsLabels {
        /// The folder.
        folder: PathBuf,
    },
    /// No picture of the film would be wet, so that no test could use it.
    #[error("--wet-from-s is {wet_from_s} s; the limits are 0 to {seconds} s, the length of the film")]
    NeverWet {
        /// The requested time.
        wet_from_s: f64,
        /// Length of the film, s.
        seconds: f64,
    },
    /// It is not stated when the sprayed panel is wet.
    #[error(
        "--spray-from-s is {spray_from_s} s, but --wet-from-s is missing; give --wet-from-s, the time at which the \
         spray is off"
    )]
    NoFirstWetPicture {
        /// The requested time.
        spray_from_s: f64,
    },
    /// The phases are in another order than the test needs.
    #[error(
        "--spray-from-s is {spray_from_s} s, --wet-from-s is {wet_from_s} s, and the film lasts {seconds} s; the spray must begin at \
         0 s or later, the wet pictures after the spray, and both within the film"
    )]
    SprayAfterWet {
        /// The requested time.
        spray_from_s: f64,
        /// The requested time.
        wet_from_s: f64,
        /// Length of the film, s.
        seconds: f64,
    },
}
