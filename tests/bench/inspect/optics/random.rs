//! Random numbers of the optical renderer: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), and a table of normal
//! deviates.

#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// Creates one of the streams of random numbers of a seed.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut random =
            Random(seed.wrapping_mul(0xD134_2543_DE82_EF95) ^ stream.wrapping_mul(0xA076_1D64_78BD_642F));
        random.bits();
        random
    }

    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn chance(&mut self, share: f64) -> bool {
        self.between(0.0, 1.0) < share
    }

    /// Returns a standard normal deviate (Box, Muller 1958).
    fn normal(&mut self) -> f32 {
        let radius = (-2.0 * self.between(1e-12, 1.0).ln()).sqrt();
        (radius * self.between(0.0, std::f64::consts::TAU).cos()) as f32
    }
}

/// A table of normal deviates that can be read from any position.
#[derive(Debug)]
pub struct Deviates(Vec<f32>);

const DEVIATES: usize = 1 << 16;

impl Deviates {
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, 77);
        Deviates((0..DEVIATES).map(|_| random.normal()).collect())
    }

    pub fn at(&self, index: usize) -> f32 {
        self.0[index % DEVIATES]
    }
}
