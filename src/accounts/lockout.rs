//! After some wrong passwords in a row an account pauses: trying on is of no use, and the person can come back.

use std::collections::BTreeMap;

/// Wrong passwords in a row.
pub const TRIES: u32 = 5;
/// How long an account pauses after them, s; twice as long after each further row of them, up to an hour.
pub const PAUSE_S: f64 = 60.0;
const LONGEST_S: f64 = 3_600.0;
/// So many names are remembered. The ones that were tried longest ago are forgotten first.
const MOST_NAMES: usize = 1_000;

/// Who tried wrong passwords lately. Times are seconds of any clock that does not jump.
#[derive(Debug, Default)]
pub struct Lockout(BTreeMap<String, Tried>);

#[derive(Debug, Clone, Copy)]
struct Tried {
    wrong: u32,
    last_s: f64,
    /// The account pauses until then, where a row was full.
    until_s: Option<f64>,
}

/// How long an account pauses after so many full rows, s.
fn pause_s(rows: u32) -> f64 {
    (PAUSE_S * f64::from(2_u32.saturating_pow(rows.saturating_sub(1).min(16)))).min(LONGEST_S)
}

impl Lockout {
    /// How long this account still pauses, s; `None` where its password may be tried.
    pub fn pauses_s(&self, name: &str, now_s: f64) -> Option<f64> {
        let left_s = self.0.get(name)?.until_s? - now_s;
        (left_s > 0.0).then_some(left_s)
    }

    /// A wrong password; whether the account pauses from now on. While it pauses nothing is counted, and nothing ends the pause.
    pub fn wrong(&mut self, name: &str, now_s: f64) -> bool {
        if self.pauses_s(name, now_s).is_some() {
            return true;
        }
        if self.0.len() >= MOST_NAMES && !self.0.contains_key(name) {
            let oldest =
                self.0.iter().min_by(|a, b| a.1.last_s.total_cmp(&b.1.last_s)).map(|(name, _)| name.clone());
            oldest.and_then(|name| self.0.remove(&name));
        }
        let former = self.0.get(name).map_or(0, |tried| tried.wrong);
        let wrong = former.saturating_add(1);
        let until_s = wrong.is_multiple_of(TRIES).then(|| now_s + pause_s(wrong / TRIES));
        self.0.insert(name.to_owned(), Tried { wrong, last_s: now_s, until_s });
        until_s.is_some()
    }

    /// The right password.
    pub fn right(&mut self, name: &str) {
        self.0.remove(name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_wrong_passwords_pause_an_account_for_longer_each_time() {
        let mut lockout = Lockout::default();
        let mut now_s = 0.0;
        // By hand: 60 s, 120 s, 240 s, …, never more than an hour.
        for pause_s in [60.0, 120.0, 240.0, 480.0, 960.0, 1_920.0, 3_600.0, 3_600.0] {
            for n in 1..=5 {
                assert_eq!(lockout.pauses_s("anna", now_s), None);
                assert_eq!(lockout.wrong("anna", now_s), n == 5);
            }
            assert_eq!(lockout.pauses_s("anna", now_s + 1.0), Some(pause_s - 1.0));
            assert_eq!(lockout.pauses_s("ben", now_s), None, "another account goes on");
            now_s += pause_s;
        }
        lockout.right("anna");
        assert!(!lockout.wrong("anna", now_s), "counted from the beginning");
    }

    /// One more attempt that was under way when the row was full takes nothing from the pause, and adds nothing to it.
    #[test]
    fn a_wrong_password_during_the_pause_does_not_lift_it() {
        let mut lockout = Lockout::default();
        for _ in 0..5 {
            lockout.wrong("anna", 0.0);
        }
        for n in 1..200 {
            assert!(lockout.wrong("anna", f64::from(n) / 10.0));
            assert!(lockout.pauses_s("anna", f64::from(n) / 10.0).is_some());
        }
        assert_eq!(lockout.pauses_s("anna", 59.0), Some(1.0));
        assert_eq!(lockout.pauses_s("anna", 60.0), None);
        assert!(!lockout.wrong("anna", 60.0), "the first of the next row");
    }

    #[test]
    fn only_so_many_names_are_remembered() {
        let mut lockout = Lockout::default();
        for n in 0..3_000 {
            lockout.wrong(&format!("n{n}"), f64::from(n));
        }
        assert_eq!(lockout.0.len(), 1_000);
    }
}
