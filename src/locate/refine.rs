/// x
pub fn refine() {}
