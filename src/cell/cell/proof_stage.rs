//! The stages of the acceptance tests on a real robot controller, and the last stage that is signed.

use panelprep_base::config::Choice;

/// A stage of the acceptance tests, the list "To be proven" on the controller's installation page. Each stage relies on
/// the tests of the previous stage, which must be signed first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr, strum::EnumString)]
pub enum ProofStage {
    /// In T1, with the sanding tool without power and the panel out of reach.
    A,
    /// In automatic mode, in the air.
    B,
    /// Contact with a foam panel.
    C,
}

impl ProofStage {
    /// All stages in the order of the tests.
    pub const ALL: [ProofStage; 3] = [ProofStage::A, ProofStage::B, ProofStage::C];

    /// Returns the stage's letter, as on the page and in the cell's file.
    pub fn letter(self) -> &'static str {
        self.into()
    }

    /// Returns the stage that must be signed before this stage begins.
    pub fn before(self) -> Option<ProofStage> {
        ProofStage::ALL.into_iter().rfind(|stage| *stage < self)
    }

    /// Returns the stage that follows this one.
    pub fn next(self) -> Option<ProofStage> {
        ProofStage::ALL.into_iter().find(|stage| *stage > self)
    }

    /// Returns the first unsigned stage, if `signed` is the last signed one. If all stages are signed, returns the last
    /// stage.
    pub fn after(signed: Option<ProofStage>) -> ProofStage {
        signed.map_or(ProofStage::A, |signed| signed.next().unwrap_or(ProofStage::C))
    }

    /// Returns the conditions under which this stage is tested.
    pub fn conditions(self) -> &'static str {
        match self {
            ProofStage::A => {
                "in T1, the tool without power, the panel out of reach; hold the Start key while this program tests"
            }
            ProofStage::B => "in AUT, in the air: the tool without power, the hand valve of the water closed",
            ProofStage::C => "in AUT, the pad on foam, the tool's motor unplugged",
        }
    }

    /// Returns what is permitted after this stage is signed.
    pub fn permits(self) -> &'static str {
        match self {
            ProofStage::A => "a motion in automatic mode, in the air",
            ProofStage::B => "contact with foam (`panelprep cycle --on-foam`)",
            ProofStage::C => "a cycle on a panel",
        }
    }
}

impl Choice for ProofStage {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("A", ProofStage::A), ("B", ProofStage::B), ("C", ProofStage::C)];
}

/// A signed page of the acceptance tests, as it is in the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SignedPage {
    /// The stage that the page confirms.
    pub stage: ProofStage,
    /// The checksum that the controller reported for its programs during the tests.
    pub programs_sum: i32,
    /// The first stage with a test that failed after the page was signed; `None` if no test failed.
    pub wrong_since: Option<ProofStage>,
}

impl SignedPage {
    /// Returns the last stage that the page still confirms. A stage with a test that failed later must be tested again,
    /// and so must all stages after it.
    pub fn proven_stage(&self) -> Option<ProofStage> {
        self.wrong_since.map_or(Some(self.stage), |wrong| wrong.before().map(|before| before.min(self.stage)))
    }
}

/// A required stage is not signed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{}, but {} requires a signed stage {}: test stage {next} with `panelprep robot prove --stage {next} --out FILE --by NAME`, sign its page, \
     store the signature with the same command and --sign, then set signed_stage = \"{next}\" in the cell's file",
    .why, .needed.permits(), .needed.letter(), next = ProofStage::after(*.signed).letter()
)]
pub struct Unsigned {
    /// The required stage.
    pub needed: ProofStage,
    /// The last stage that is treated as signed, if there is one.
    pub signed: Option<ProofStage>,
    /// Why the stage is not treated as signed.
    pub why: UnsignedCause,
}

/// The reason why a stage is not treated as signed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum UnsignedCause {
    /// The cell's file states no stage.
    #[error("[robot] signed_stage is missing")]
    NotStated,
    /// The cell's file states a lower stage.
    #[error("[robot] signed_stage is {}", .0.letter())]
    Lower(ProofStage),
    /// The store has no signed page, or cannot be read.
    #[error("[robot] signed_stage is {}, but the store contains no readable signed page of the acceptance tests", .0.letter())]
    NoPage(ProofStage),
    /// The newest signed page in the store confirms a lower stage.
    #[error(
        "[robot] signed_stage is {}, but the newest signed page in the store is for stage {}", .stated.letter(), .page.letter()
    )]
    LowerPage {
        /// The stage that the cell's file states.
        stated: ProofStage,
        /// The stage that the page confirms.
        page: ProofStage,
    },
    /// A test failed after the newest page was signed.
    #[error(
        "[robot] signed_stage is {}, but a test of stage {} failed in `panelprep robot prove` after the page was signed",
        .stated.letter(), .wrong.letter()
    )]
    WrongSince {
        /// The stage that the cell's file states.
        stated: ProofStage,
        /// The stage with the failed test.
        wrong: ProofStage,
    },
    /// The newest signed page in the store belongs to other programs of the controller.
    #[error(
        "[robot] signed_stage is {}, but the newest signed page in the store is for programs with the checksum {page}, and [robot] programs_sum is {accepted}", .stated.letter()
    )]
    OtherPrograms {
        /// The stage that the cell's file states.
        stated: ProofStage,
        /// The checksum of the tested programs.
        page: i32,
        /// The checksum of the accepted programs.
        accepted: i32,
    },
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;
    use ProofStage::{A, B, C};

    const REAL: &str = "kind = 'eki'\nhost = '172.31.1.147'\nprograms_sum = 7\n";

    fn refused(robot: &str, page: Option<SignedPage>, needed: ProofStage) -> Option<String> {
        let cell = Cell::check("cell.toml", &format!("[robot]\n{robot}")).expect("good").with_signed_page(page);
        cell.robot().check_stage_signed(needed).err().map(|unsigned| unsigned.to_string())
    }

    /// A controller without a signed page permits no motion in automatic mode. Each signed stage permits the operation
    /// that its tests cover.
    #[test]
    fn nothing_counts_as_signed_by_default() {
        let page = |stage| Some(SignedPage { stage, programs_sum: 7, wrong_since: None });
        let wrong = |wrong| Some(SignedPage { stage: C, programs_sum: 7, wrong_since: Some(wrong) });
        for (stated, page, permitted) in [
            ("", page(C), 0),
            ("signed_stage = 'A'", page(A), 1),
            ("signed_stage = 'B'", page(B), 2),
            ("signed_stage = 'C'", page(C), 3),
            // The cell's file states a higher stage than the signed page.
            ("signed_stage = 'C'", page(A), 1),
            ("signed_stage = 'C'", None, 0),
            // The cell's file states a lower stage than the signed page.
            ("signed_stage = 'A'", page(C), 1),
            // The programs were changed after the tests.
            ("signed_stage = 'C'", Some(SignedPage { stage: C, programs_sum: 8, wrong_since: None }), 0),
            // A test failed after the page was signed.
            ("signed_stage = 'C'", wrong(A), 0),
            ("signed_stage = 'C'", wrong(B), 1),
            ("signed_stage = 'C'", wrong(C), 2),
        ] {
            let robot = format!("{REAL}{stated}");
            let counted =
                ProofStage::ALL.into_iter().filter(|stage| refused(&robot, page, *stage).is_none()).count();
            assert_eq!(counted, permitted, "{stated} {page:?}");
        }
        assert_eq!(([A.before(), B.before(), C.before()], C.next()), ([None, Some(A), Some(B)], None));
    }

    #[test]
    fn the_refusal_names_what_is_missing_and_the_next_stage() {
        let words = refused(REAL, None, C).expect("refused");
        let start =
            "[robot] signed_stage is missing, but a cycle on a panel requires a signed stage C: test stage A";
        assert!(words.starts_with(start), "{words}");
        for (stated, page, expected) in [
            (
                "A",
                Some((A, 7)),
                "signed_stage is A, but a cycle on a panel requires a signed stage C: test stage B",
            ),
            ("C", Some((A, 7)), "is for stage A, but a cycle on a panel requires a signed stage C: test stage B"),
            (
                "C",
                None,
                "the store contains no readable signed page of the acceptance tests, but a cycle on a panel requires a signed stage C: test stage A",
            ),
            (
                "C",
                Some((C, 8)),
                "with the checksum 8, and [robot] programs_sum is 7, but a cycle on a panel requires a signed stage C",
            ),
        ] {
            let page = page.map(|(stage, programs_sum)| SignedPage { stage, programs_sum, wrong_since: None });
            let words = refused(&format!("{REAL}signed_stage = '{stated}'"), page, C).expect("refused");
            assert!(words.contains(expected), "{words}");
        }
    }

    /// A local address does not prove that the controller is a mock: it may be the end of a tunnel to a real
    /// controller.
    #[test]
    fn a_controller_at_an_address_of_this_computer_needs_its_proofs() {
        assert_eq!(refused("", None, C), None, "a mock inside this program");
        for host in ["127.0.0.1", "localhost", "::1"] {
            assert!(refused(&format!("kind = 'eki'\nhost = '{host}'"), None, A).is_some(), "{host}");
        }
    }
}
