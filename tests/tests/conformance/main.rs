//! All conformance tests in one program: backends against the reference, the reference against closed forms, and the
//! harness that compares them against faults.
//!
//! - the rendering model: [`closed_forms`], [`clip_closed_forms`], [`extreme_closed_forms`],
//!   [`transparency_closed_forms`], [`meshes_among_splats`], [`shadow_maps`], [`octree_levels`], [`image_invariants`],
//!   [`decision_margin`], [`checkerboard_filter_errors`], [`textured_meshes`], [`nearest_planes`],
//!   [`thin_sheets`], [`trained_gaussians`];
//! - backends: [`cpu_backend`], [`gpu_backends`], [`compute_path`], [`gpu_frame_costs`], [`gpu_scene_storage`],
//!   [`feature_costs`], [`golden_scenes`], [`stability_sweeps`], [`preset_promises`], [`random_scene_features`],
//!   [`own_images`];
//! - splats made from meshes: [`splats_of_meshes`], [`clean_images`], [`sharp_features`], [`texture_acquisition`]; real
//!   data: [`real_models`];
//! - the harness itself: [`harness_catches_faults`], [`expectation_table`], [`conformance_report`], [`packed_truths`];
//! - shared helpers: [`drawing`], [`validated_gpu`], [`faulty_renderer`], [`scene_files`].

mod balls;
mod checkerboard_filter_errors;
mod clean_images;
mod clip_closed_forms;
mod closed_forms;
mod compute_path;
mod conformance_report;
mod cpu_backend;
mod decision_margin;
mod drawing;
mod edge_samples;
mod encoded_colors;
mod expectation_table;
mod extreme_closed_forms;
mod faulty_renderer;
mod feature_costs;
mod golden_scenes;
mod gpu_backends;
mod gpu_frame_costs;
mod gpu_scene_storage;
mod harness_catches_faults;
mod image_invariants;
mod meshes_among_splats;
mod nearest_planes;
mod octree_levels;
mod own_images;
mod packed_truths;
mod preset_promises;
mod random_scene_features;
mod real_models;
mod scene_files;
mod shadow_maps;
mod sharp_features;
mod splats_of_meshes;
mod stability_sweeps;
mod texture_acquisition;
mod textured_meshes;
mod thin_sheets;
mod trained_gaussians;
mod transparency_closed_forms;
mod updated_scenes;
mod validated_gpu;
