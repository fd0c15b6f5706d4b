//! Generates SPIR-V for Vulkan. All of naga's options are explicit, because its defaults flip y and invent missing
//! bindings.

use std::error::Error;

use naga::Module;
use naga::back::spv::{BindingInfo, BindingMap, Options, WriterFlags, ZeroInitializeWorkgroupMemoryMode, write_vec};
use naga::compact::{KeepUnused, compact};
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// Code that naga adds to a shader so that no access is out of bounds, no loop runs forever and no workgroup memory is
/// read before it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AddedChecks {
    /// Policy for indices of arrays in workgroups' and functions' memory.
    pub index: BoundsCheckPolicy,
    /// Policy for indices of arrays in buffers, and for texels.
    pub buffer: BoundsCheckPolicy,
    /// True if every loop counts its iterations.
    pub bounds_loops: bool,
    /// True if workgroup memory is zeroed.
    pub zeroes_workgroup: bool,
}

impl AddedChecks {
    /// Returns the checks with which an entry point is built.
    pub(crate) fn of(entry: &str) -> Self {
        // The compute path bounds its loops and indices by its own counts, and it has the tightest loops.
        let is_bounded = entry.starts_with("cell_");
        Self {
            index: if is_bounded { BoundsCheckPolicy::Unchecked } else { BoundsCheckPolicy::Restrict },
            // An out-of-bounds access reads some valid element, whether or not the device has robustness. An image that
            // a frame doesn't need has one pixel.
            buffer: BoundsCheckPolicy::Restrict,
            bounds_loops: !is_bounded,
            // Shaders write workgroup memory before they read it.
            zeroes_workgroup: false,
        }
    }
}

/// Returns the Rust text of a slice of entry points: each name with the words of its SPIR-V module.
pub(crate) fn modules(module: &Module) -> Result<String, Box<dyn Error>> {
    let one = |entry: &naga::EntryPoint| {
        Ok(format!("    ({:?}, &{:?}),\n", entry.name, words(module, &entry.name, AddedChecks::of(&entry.name))?))
    };
    let all: Result<String, Box<dyn Error>> = module.entry_points.iter().map(one).collect();
    Ok(format!("&[\n{}]", all?))
}

/// Returns the words of a SPIR-V module with one entry point and only the code and bindings that it uses, since some
/// drivers expect a descriptor for every binding that a module declares.
pub(crate) fn words(module: &Module, entry: &str, checks: AddedChecks) -> Result<Vec<u32>, Box<dyn Error>> {
    let mut module = module.clone();
    module.entry_points.retain(|e| e.name == entry);
    compact(&mut module, KeepUnused::No);
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module)?;
    let zeroes = match checks.zeroes_workgroup {
        true => ZeroInitializeWorkgroupMemoryMode::Polyfill,
        false => ZeroInitializeWorkgroupMemoryMode::None,
    };
    let options = Options {
        // The newest version that Vulkan 1.1 accepts.
        lang_version: (1, 3),
        // No flags: y isn't flipped (the viewport flips it, as in wgpu), there is no point size, and depths stay within
        // 0 to 1. Names are omitted, since validation layers from before 2023 don't recognise WGSL as a source
        // language.
        flags: WriterFlags::empty(),
        fake_missing_bindings: false,
        binding_map: bindings(&module),
        capabilities: None,
        bounds_check_policies: BoundsCheckPolicies {
            index: checks.index,
            buffer: checks.buffer,
            image_load: checks.buffer,
            binding_array: BoundsCheckPolicy::Unchecked,
        },
        zero_initialize_workgroup_memory: zeroes,
        force_loop_bounding: checks.bounds_loops,
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

/// Returns a map of bindings that preserves all numbers: a bind group becomes the descriptor set with its number.
fn bindings(module: &Module) -> BindingMap {
    let used = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
    let info = |at: naga::ResourceBinding| BindingInfo {
        descriptor_set: at.group,
        binding: at.binding,
        binding_array_size: None,
    };
    used.map(|at| (at, info(at))).collect()
}
