//! Selection of the SIMD instructions that a renderer uses.

#[cfg(feature = "scalar")]
use fearless_simd::Fallback;
use fearless_simd::Level;
#[cfg(target_arch = "x86_64")]
use fearless_simd::x86::{Avx2, Avx512};

/// SIMD instructions that a renderer may use. The choice changes the speed, but no bit of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum SimdLevel {
    /// The best instructions that the CPU has.
    #[default]
    Best,
    /// AVX2, even if the CPU has better instructions; on other architectures the best.
    Avx2,
    /// No SIMD instructions, for CPUs that have none of the others. Far slower, and as much code as all other levels
    /// together.
    #[cfg(feature = "scalar")]
    Scalar,
}

impl SimdLevel {
    /// All levels that this build of the crate supports.
    pub const ALL: &'static [Self] = &[
        Self::Best,
        Self::Avx2,
        #[cfg(feature = "scalar")]
        Self::Scalar,
    ];
}

/// SIMD instructions that the CPU supports, as a token for running SIMD code.
///
/// There are fewer variants than `fearless_simd` supports. Each one compiles a copy of the whole rasteriser, and
/// instructions without a fused multiply-add are no faster than scalar code.
#[derive(Clone, Copy)]
pub(crate) enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    #[cfg(not(target_arch = "x86_64"))]
    Other(Level),
    #[cfg(feature = "scalar")]
    Scalar(Fallback),
}

impl Instructions {
    /// Returns the instructions of a level. If this CPU lacks them, returns `Scalar` in builds with the feature
    /// `scalar`, else `None`.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn new(level: SimdLevel) -> Option<Self> {
        let best = Level::new();
        let found = match level {
            SimdLevel::Best => best.as_avx512().map(Self::Avx512).or(best.as_avx2().map(Self::Avx2)),
            SimdLevel::Avx2 => best.as_avx2().map(Self::Avx2),
            #[cfg(feature = "scalar")]
            SimdLevel::Scalar => None,
        };
        #[cfg(feature = "scalar")]
        let found = found.or(Some(Self::Scalar(Fallback::new())));
        found
    }

    /// Returns the instructions of a level. On this architecture the result is never `None`.
    #[cfg(not(target_arch = "x86_64"))]
    pub(crate) fn new(level: SimdLevel) -> Option<Self> {
        Some(match level {
            #[cfg(feature = "scalar")]
            SimdLevel::Scalar => Self::Scalar(Fallback::new()),
            _ => Self::Other(Level::new()),
        })
    }

    /// Returns the name of the instructions, for messages.
    pub(crate) fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "AVX2",
            #[cfg(not(target_arch = "x86_64"))]
            Self::Other(_) => std::env::consts::ARCH,
            #[cfg(feature = "scalar")]
            Self::Scalar(_) => "scalar",
        }
    }
}

/// Evaluates an expression of SIMD code, in which `$simd` is the `fearless_simd` token of the given [`Instructions`].
macro_rules! with_instructions {
    ($instructions:expr, $simd:ident => $run:expr) => {
        match $instructions {
            #[cfg(target_arch = "x86_64")]
            $crate::simd::level::Instructions::Avx512($simd) => $run,
            #[cfg(target_arch = "x86_64")]
            $crate::simd::level::Instructions::Avx2($simd) => $run,
            #[cfg(not(target_arch = "x86_64"))]
            $crate::simd::level::Instructions::Other(level) => fearless_simd::dispatch!(level, $simd => $run),
            #[cfg(feature = "scalar")]
            $crate::simd::level::Instructions::Scalar($simd) => $run,
        }
    };
}

pub(crate) use with_instructions;
