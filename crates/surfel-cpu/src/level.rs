//! Which SIMD instructions a renderer uses.

use fearless_simd::Level;
#[cfg(target_arch = "x86_64")]
use fearless_simd::x86::{Avx2, Avx512, Sse2};

/// Which SIMD instructions to use. Changes the speed and no bit of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SimdLevel {
    /// The best that the processor has.
    #[default]
    Best,
    /// AVX2 where there is any better, else the best.
    Avx2,
    /// The least that this kind of processor always has. Far slower where that lacks a fused multiply-add.
    Baseline,
}

/// Instructions that the processor is known to have.
///
/// Fewer than `fearless_simd` knows: every one is a copy of the whole rasteriser, and SSE4.2 is no faster than SSE2 here,
/// since neither has a fused multiply-add.
#[derive(Clone, Copy)]
pub(crate) enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    #[cfg(target_arch = "x86_64")]
    Sse2(Sse2),
    #[cfg(not(target_arch = "x86_64"))]
    Other(Level),
}

impl Instructions {
    /// The instructions for a level on this processor.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn new(level: SimdLevel) -> Option<Self> {
        let best = Level::new();
        let avx512 = best.as_avx512().filter(|_| level == SimdLevel::Best).map(Self::Avx512);
        let avx2 = best.as_avx2().filter(|_| level != SimdLevel::Baseline).map(Self::Avx2);
        avx512.or(avx2).or(best.as_sse2().map(Self::Sse2))
    }

    /// The instructions for a level on this processor.
    #[cfg(not(target_arch = "x86_64"))]
    pub(crate) fn new(level: SimdLevel) -> Option<Self> {
        Some(Self::Other(if level == SimdLevel::Baseline { Level::baseline() } else { Level::new() }))
    }

    /// Their name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Sse2(_) => "SSE2",
            #[cfg(not(target_arch = "x86_64"))]
            Self::Other(_) => std::env::consts::ARCH,
        }
    }
}

/// Runs an expression with the token of some [`Instructions`].
macro_rules! with_instructions {
    ($instructions:expr, $simd:ident => $run:expr) => {
        match $instructions {
            #[cfg(target_arch = "x86_64")]
            $crate::level::Instructions::Avx512($simd) => $run,
            #[cfg(target_arch = "x86_64")]
            $crate::level::Instructions::Avx2($simd) => $run,
            #[cfg(target_arch = "x86_64")]
            $crate::level::Instructions::Sse2($simd) => $run,
            #[cfg(not(target_arch = "x86_64"))]
            $crate::level::Instructions::Other(level) => fearless_simd::dispatch!(level, $simd => $run),
        }
    };
}

pub(crate) use with_instructions;
