//! SPIR-V for Vulkan, with every option of naga's stated: its defaults flip y and make up missing bindings.

use std::error::Error;

use naga::Module;
use naga::back::spv::{BindingInfo, BindingMap, Options, WriterFlags, ZeroInitializeWorkgroupMemoryMode, write_vec};
use naga::compact::{KeepUnused, compact};
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// Rust text: a slice of each entry point's name and module.
pub(crate) fn modules(module: &Module) -> Result<String, Box<dyn Error>> {
    let one = |entry: &naga::EntryPoint| Ok(format!("    ({:?}, &{:?}),\n", entry.name, words(module, &entry.name)?));
    let all: Result<String, Box<dyn Error>> = module.entry_points.iter().map(one).collect();
    Ok(format!("&[\n{}]", all?))
}

/// A module of one entry point and what it uses: there are drivers that look for a descriptor of all that a module
/// declares.
fn words(module: &Module, entry: &str) -> Result<Vec<u32>, Box<dyn Error>> {
    let mut module = module.clone();
    module.entry_points.retain(|e| e.name == entry);
    compact(&mut module, KeepUnused::No);
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module)?;
    // Loops and indices of the compute path are bounded by what it has counted itself, and it has the tightest loops.
    let is_bounded = entry.starts_with("cell_");
    let options = Options {
        // The latest that Vulkan 1.1 takes.
        lang_version: (1, 3),
        // No flip of y (the viewport does it, as wgpu's), no names (layers of before 2023 call WGSL no source
        // language), no point size, and depths are between 0 and 1 as they are.
        flags: WriterFlags::empty(),
        fake_missing_bindings: false,
        binding_map: bindings(&module),
        capabilities: None,
        // What is out of bounds reads something that is there, whatever robustness the device has. An image that a
        // frame doesn't need is of one pixel.
        bounds_check_policies: BoundsCheckPolicies {
            index: if is_bounded { BoundsCheckPolicy::Unchecked } else { BoundsCheckPolicy::Restrict },
            buffer: BoundsCheckPolicy::Restrict,
            image_load: BoundsCheckPolicy::Restrict,
            binding_array: BoundsCheckPolicy::Unchecked,
        },
        // What is read of workgroup memory is written before.
        zero_initialize_workgroup_memory: ZeroInitializeWorkgroupMemoryMode::None,
        force_loop_bounding: !is_bounded,
        ray_query_initialization_tracking: false,
        trace_ray_argument_validation: false,
        use_storage_input_output_16: false,
        debug_info: None,
        task_dispatch_limits: None,
        mesh_shader_primitive_indices_clamp: false,
        emit_int_div_checks: true,
    };
    Ok(write_vec(&module, &info, &options, None)?)
}

/// Each binding under its own number: a group is a descriptor set.
fn bindings(module: &Module) -> BindingMap {
    let used = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
    let info = |at: naga::ResourceBinding| BindingInfo {
        descriptor_set: at.group,
        binding: at.binding,
        binding_array_size: None,
    };
    used.map(|at| (at, info(at))).collect()
}
