//! Points in time, for the durations in statistics.

#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
pub use std::time::Instant;

#[cfg(all(target_family = "wasm", target_os = "unknown"))]
pub use without::Instant;

#[cfg(all(target_family = "wasm", target_os = "unknown"))]
mod without {
    use std::ops::Sub;
    use std::time::Duration;

    /// Substitute for a point in time on WebAssembly, which has no clock of its own: every duration is zero. The
    /// embedding page measures with its own clock.
    #[derive(Clone, Copy, Debug)]
    pub struct Instant(());

    impl Instant {
        /// Returns the only point in time.
        pub fn now() -> Self {
            Self(())
        }

        /// Returns a duration of zero.
        pub fn elapsed(self) -> Duration {
            Duration::ZERO
        }
    }

    impl Sub for Instant {
        type Output = Duration;

        fn sub(self, _: Self) -> Duration {
            Duration::ZERO
        }
    }
}
