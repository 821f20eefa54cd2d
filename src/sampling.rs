//! Samples of a sequence that no stride can bring in step with its rows, such as the scan lines of an image.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// At most `wanted` of `len` indices, ascending: one at random from each of equal stretches, so that no stride can fall in
/// step with scan lines.
pub(crate) fn even_sample(len: usize, wanted: usize, seed: u64) -> Vec<usize> {
    even_indices(len, wanted, &mut ChaCha8Rng::seed_from_u64(seed))
}

/// [`even_sample`] with random numbers that go on.
pub(crate) fn even_indices(len: usize, wanted: usize, random: &mut ChaCha8Rng) -> Vec<usize> {
    if len <= wanted {
        return (0..len).collect();
    }
    let bound = |i: usize| i * len / wanted;
    (0..wanted).map(|i| bound(i) + below(random, bound(i + 1) - bound(i))).collect()
}

/// A random number below `n`, by multiplication; the bias of 2^-64 n is of no account.
pub(crate) fn below(random: &mut ChaCha8Rng, n: usize) -> usize {
    ((u128::from(random.next_u64()) * n as u128) >> 64) as usize
}
