//! Kinds of damage to the bytes of a file: to bits, to blocks, and to its end.

use rand::RngExt;
use rand_pcg::Pcg64;

/// The kinds of damage, each with its name.
pub const DAMAGES: [(&str, fn(&mut Vec<u8>, &mut Pcg64)); 6] = [
    ("one bit", |bytes, draw| flip(bytes, 1, draw)),
    ("some bits", |bytes, draw| {
        let count = draw.random_range(2..200);
        flip(bytes, count, draw);
    }),
    ("cut short", |bytes, draw| bytes.truncate(draw.random_range(0..bytes.len()))),
    ("a block of zeros", |bytes, draw| random_block(bytes, draw).fill(0)),
    ("a block of noise", |bytes, draw| {
        let seed: u64 = draw.random();
        let mut noise = <Pcg64 as rand::SeedableRng>::seed_from_u64(seed);
        random_block(bytes, draw).iter_mut().for_each(|byte| *byte = noise.random());
    }),
    ("a block of elsewhere", |bytes, draw| {
        let length = random_length(bytes.len(), draw);
        let [from, to] = [0, 1].map(|_| draw.random_range(0..=bytes.len() - length));
        bytes.copy_within(from..from + length, to);
    }),
];

fn flip(bytes: &mut [u8], count: usize, draw: &mut Pcg64) {
    for _ in 0..count {
        let at = draw.random_range(0..bytes.len());
        bytes[at] ^= 1 << draw.random_range(0..8);
    }
}

/// Draws a length from one byte to a quarter of the file; each power of two is equally likely.
fn random_length(file: usize, draw: &mut Pcg64) -> usize {
    let most = (file as f64 / 4.0).max(1.0).log2();
    (draw.random_range(0.0..=most).exp2() as usize).clamp(1, file)
}

/// Returns a random block of the size that a disk or a packet damages.
fn random_block<'b>(bytes: &'b mut [u8], draw: &mut Pcg64) -> &'b mut [u8] {
    let length = random_length(bytes.len(), draw);
    let at = draw.random_range(0..=bytes.len() - length);
    &mut bytes[at..at + length]
}
