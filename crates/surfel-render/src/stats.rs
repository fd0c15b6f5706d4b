//! Statistics of a render.

/// Duration of one stage of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// Name of the stage, which the backend defines.
    pub name: &'static str,
    /// Duration of the stage, in milliseconds.
    pub ms: f64,
}

/// Counts and durations of one frame, without loading and writing files.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Stats {
    /// Duration of the whole frame, in milliseconds.
    pub frame_ms: f64,
    /// Durations of the frame's stages, into which the backend divides the frame.
    pub passes: Vec<PassTime>,
    /// Number of splats of the scene's clouds, and of splats selected from octrees.
    pub splats: u64,
    /// Number of splats that were rasterised, that is, not culled.
    pub drawn: u64,
    /// Total number of fragments of the frame that contribute to any pixel; 0 if the backend doesn't count them. The
    /// CPU backends count them, and `fragments_inside` among the counters, only if [`crate::Planes::fragments`] is
    /// requested, because counting takes 2 % of a frame. The wgpu backend does the same, because it has no exact count
    /// of samples that passed. The counter `fragment_invocations` is the number of shader invocations, if the adapter
    /// counts them (pipeline statistics).
    pub fragments: u64,
    /// Resident memory per splat in bytes. For octrees, all splats count, selected or not.
    pub bytes_per_splat: f64,
    /// Number of CPU threads that drew the frame; 0 for GPU backends.
    pub threads: usize,
    /// Further counters: names that the backend defines, and values.
    pub counters: Vec<(&'static str, f64)>,
}

impl Stats {
    surfel_model::setters! {
        with_frame_ms frame_ms: f64,
        with_passes passes: Vec<PassTime>,
        with_splats splats: u64,
        with_drawn drawn: u64,
        with_fragments fragments: u64,
        with_bytes_per_splat bytes_per_splat: f64,
        with_threads threads: usize,
        with_counters counters: Vec<(&'static str, f64)>,
    }
}
