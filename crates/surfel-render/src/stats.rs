//! What a render cost.

/// Time of one stage.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// Its name.
    pub name: &'static str,
    /// Milliseconds.
    pub ms: f64,
}

/// Counts and times of one frame. Loading and writing files is never in them.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Stats {
    /// Milliseconds for the whole frame.
    pub frame_ms: f64,
    /// Milliseconds by stage.
    pub passes: Vec<PassTime>,
    /// Splats of the scene's clouds, and those that the frame chose of its octrees.
    pub splats: u64,
    /// Splats that were rasterised (not culled).
    pub drawn: u64,
    /// Fragments that contributed to a pixel; 0 where they aren't counted. CPUs count them, and `fragments_inside`
    /// among the counters, where [`crate::Planes::fragments`] is asked for, since it costs a fiftieth of a frame. So
    /// does wgpu, which has no exact count of samples that passed; `fragment_invocations` among the counters is what
    /// shaders ran, where the adapter counts it (pipeline statistics).
    pub fragments: u64,
    /// Resident bytes a splat, of octrees counting all of them.
    pub bytes_per_splat: f64,
    /// Threads used.
    pub threads: usize,
    /// Further counters, by name, in a backend's own words.
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
