//! The stages of the list of what must be proven on a real controller, and how far it is signed.

use crate::config::Choice;

/// A stage of the list "To be proven" on the installation page of the controller. A stage is proven with what the
/// stage before it has proven, and its part of the page is signed before the next stage begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr, strum::EnumString)]
pub enum ProofStage {
    /// In T1, the sanding tool without power and the panel out of reach.
    A,
    /// In automatic mode, in the air.
    B,
    /// Contact with a foam panel.
    C,
}

impl ProofStage {
    /// All stages in their order.
    pub const ALL: [ProofStage; 3] = [ProofStage::A, ProofStage::B, ProofStage::C];

    /// Its letter, as the page and the cell's file state it.
    pub fn letter(self) -> &'static str {
        self.into()
    }

    /// The stage that must be signed before this one begins.
    pub fn before(self) -> Option<ProofStage> {
        ProofStage::ALL.into_iter().rfind(|stage| *stage < self)
    }

    /// The stage that follows this one.
    pub fn next(self) -> Option<ProofStage> {
        ProofStage::ALL.into_iter().find(|stage| *stage > self)
    }

    /// Returns the first stage that is not signed, after this last signed one; the last stage if all are signed.
    pub fn after(signed: Option<ProofStage>) -> ProofStage {
        signed.map_or(ProofStage::A, |signed| signed.next().unwrap_or(ProofStage::C))
    }

    /// The conditions under which it is proven.
    pub fn conditions(self) -> &'static str {
        match self {
            ProofStage::A => {
                "in T1, the tool without power, the panel out of reach; hold Start while this program tries"
            }
            ProofStage::B => "in AUT, in the air: the tool without power, the hand valve of the water closed",
            ProofStage::C => "in AUT, the pad on foam, the tool's motor unplugged",
        }
    }

    /// What a person is permitted to do once this stage is signed.
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

/// A stage that this needs is not signed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "[robot] signed_stage is {}, and {} needs {}: prove stage {} with `panelprep robot prove --out FILE --by NAME`, sign its \
     page, then set signed_stage = \"{}\" in the cell's file",
    .signed.map_or("missing", ProofStage::letter), .needed.permits(), .needed.letter(), ProofStage::after(*.signed).letter(),
    ProofStage::after(*.signed).letter()
)]
pub struct Unsigned {
    /// The stage that is needed.
    pub needed: ProofStage,
    /// The last stage that is signed, if one is.
    pub signed: Option<ProofStage>,
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    fn refused(robot: &str, needed: ProofStage) -> Option<String> {
        let cell = Cell::check("cell.toml", &format!("[robot]\n{robot}")).expect("good");
        cell.robot().requires_signed(needed).err().map(|unsigned| unsigned.to_string())
    }

    /// A real controller without a signed page permits nothing in automatic mode; each stage permits what it proves.
    #[test]
    fn nothing_counts_as_signed_by_default() {
        use ProofStage::{A, B, C};
        let real = "kind = 'eki'\nhost = '172.31.1.147'\n";
        for (signed, permitted) in
            [("", 0), ("signed_stage = 'A'", 1), ("signed_stage = 'B'", 2), ("signed_stage = 'C'", 3)]
        {
            let robot = format!("{real}{signed}");
            let counted = ProofStage::ALL.into_iter().filter(|stage| refused(&robot, *stage).is_none()).count();
            assert_eq!(counted, permitted, "{signed}");
        }
        let words = refused(real, C).expect("refused");
        assert!(
            words.starts_with("[robot] signed_stage is missing, and a cycle on a panel needs C: prove stage A"),
            "{words}"
        );
        assert!(
            refused(&format!("{real}signed_stage = 'A'"), C).is_some_and(|words| words.contains("prove stage B"))
        );
        // A mock, and a rehearsal with `mock-robot` on this computer, move no arm.
        assert_eq!([refused("", C), refused("kind = 'eki'\nhost = '127.0.0.1'", C)], [None, None]);
        assert_eq!(([A.before(), B.before(), C.before()], C.next()), ([None, Some(A), Some(B)], None));
    }
}
