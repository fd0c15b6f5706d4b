//! Pseudo-random generator that returns the same numbers on every machine.

use glam::DVec3;

/// Generator SplitMix64 (Steele, Lea and Flood 2014).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Creates a generator that returns the same numbers for the same seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Returns 64 uniform bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a uniform number in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 * (-53.0f64).exp2()
    }

    /// Returns a log-uniform number from `low` to `high`; both limits are above 0.
    pub fn factor(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.range(0.0, 1.0))
    }

    /// Returns true with probability `share`.
    pub fn chance(&mut self, share: f64) -> bool {
        self.range(0.0, 1.0) < share
    }

    /// Returns a uniform integer from 0 to `count` − 1; 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count.max(1) as u64) as usize
    }

    /// Returns one of the items, each with the same probability.
    pub fn pick<T: Copy, const N: usize>(&mut self, items: [T; N]) -> T {
        items[self.below(N)]
    }

    /// Returns a uniform direction on the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        let (z, angle) = (self.range(-1.0, 1.0), self.range(0.0, std::f64::consts::TAU));
        let r = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(r * angle.cos(), r * angle.sin(), z)
    }

    /// Returns a colour with channels in [0.1, 1). Channels aren't near 0, where errors would be hidden.
    pub fn color(&mut self) -> [f32; 3] {
        [0; 3].map(|_: i32| self.range(0.1, 1.0) as f32)
    }

    /// Shuffles `items` (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, (self.bits() % (i as u64 + 1)) as usize);
        }
    }
}
