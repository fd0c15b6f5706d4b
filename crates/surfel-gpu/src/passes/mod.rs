//! Passes of a frame: their targets, entry points, order and cost.

pub(crate) mod cell_stages;
pub(crate) mod cells;
pub(crate) mod draw;
pub(crate) mod fill_rate;
pub(crate) mod layer_draws;
pub(crate) mod memory;
pub(crate) mod pass_list;
pub(crate) mod pixel_pass;
pub(crate) mod plan_cost;
pub(crate) mod probe;
pub(crate) mod schedule;
pub(crate) mod targets;
