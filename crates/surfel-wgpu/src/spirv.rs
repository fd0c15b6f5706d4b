//! Shader modules from the SPIR-V that was built with the project, for Vulkan. wgpu passes it to the driver unchanged,
//! so the driver compiles what it compiles for `surfel-ash`: both draw the same bits, and nothing is translated at run
//! time.

use surfel_shaders::SPIRV;

/// Opcode of the instruction that decorates an object of a module: the words after the opcode are the object, the
/// decoration and its number (SPIR-V 1.3 §3.32.3).
const OP_DECORATE: u32 = 71;
/// Decorations (§3.20) with the number of a variable's binding and of its group.
const BINDING: u32 = 33;
const DESCRIPTOR_SET: u32 = 34;
/// Number of words before the first instruction of a module.
const HEADER_WORDS: usize = 5;

/// True if the device passes SPIR-V to its driver.
pub(crate) fn is_passed(device: &wgpu::Device) -> bool {
    let is_enabled = device.features().contains(wgpu::Features::PASSTHROUGH_SHADERS);
    is_enabled && device.adapter_info().backend == wgpu::Backend::Vulkan
}

/// Creates the module of an entry point. `groups` are the binding numbers in the layouts of the pipeline's bind groups,
/// in ascending order. `None` if the project has no such entry point.
pub(crate) fn module(device: &wgpu::Device, entry: &str, groups: &[&[u32]]) -> Option<wgpu::ShaderModule> {
    let (_, words) = SPIRV.iter().find(|(name, _)| *name == entry)?;
    let words = renumbered(words, groups);
    let point = wgpu::PassthroughShaderEntryPoint { name: entry.into(), workgroup_size: (0, 0, 0) };
    let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
        label: Some(entry),
        entry_points: vec![point].into(),
        spirv: Some(words.into()),
        ..wgpu::ShaderModuleDescriptorPassthrough::default()
    };
    // SAFETY: The words are SPIR-V that naga validated and wrote when this crate was built, apart from the numbers of
    // bindings, which are those that wgpu gives the layouts of the same pipeline.
    Some(unsafe { device.create_shader_module_passthrough(descriptor) })
}

/// Returns the words of a module with the binding numbers of wgpu's Vulkan backend. It numbers the bindings of each
/// layout from 0 in ascending order, without gaps.
fn renumbered(words: &[u32], groups: &[&[u32]]) -> Vec<u32> {
    let mut words = words.to_vec();
    let decorations = decorations(&words);
    for &(at, object, decoration) in &decorations {
        if decoration != BINDING {
            continue;
        }
        let is_group = |&&(_, other, decoration): &&(usize, u32, u32)| other == object && decoration == DESCRIPTOR_SET;
        let number = |at: usize| words.get(at).copied().unwrap_or(u32::MAX);
        let group = decorations.iter().find(is_group).and_then(|&(at, ..)| groups.get(number(at) as usize));
        let position = group.and_then(|bindings| bindings.iter().position(|&binding| binding == number(at)));
        if let (Some(position), Some(word)) = (position, words.get_mut(at)) {
            *word = position as u32;
        }
    }
    words
}

/// Returns the numbered decorations of a module's objects: the index of the word with the number, the object and the
/// decoration.
fn decorations(words: &[u32]) -> Vec<(usize, u32, u32)> {
    let (mut found, mut at) = (Vec::new(), HEADER_WORDS);
    while let Some(&[first, object, decoration, _]) = words.get(at..at + 4) {
        if first & 0xffff == OP_DECORATE && first >> 16 == 4 {
            found.push((at + 3, object, decoration));
        }
        at += (first >> 16).max(1) as usize;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_shaders::ENTRIES;

    /// Returns the pairs of group and binding of a module, in ascending order.
    fn bindings(words: &[u32]) -> Vec<[u32; 2]> {
        let all = decorations(words);
        let number = |object, wanted| {
            let found = all.iter().find(|&&(_, other, decoration)| other == object && decoration == wanted);
            words[found.unwrap().0]
        };
        let of_bindings = all.iter().filter(|(_, _, decoration)| *decoration == BINDING);
        let mut pairs: Vec<_> =
            of_bindings.map(|&(at, object, _)| [number(object, DESCRIPTOR_SET), words[at]]).collect();
        pairs.sort_unstable();
        pairs
    }

    #[test]
    fn bindings_of_every_entry_point_are_numbered_without_gaps() {
        for entry in ENTRIES {
            let (_, words) = SPIRV.iter().find(|(name, _)| *name == entry.name).unwrap();
            let mut declared: Vec<_> = entry.bindings.iter().map(|binding| [binding.group, binding.binding]).collect();
            declared.sort_unstable();
            assert_eq!(bindings(words), declared, "{}", entry.name);
            // A layout may have more bindings than an entry point uses.
            let of_group = |group: u32| {
                let own = declared.iter().filter(|pair| pair[0] == group).map(|pair| pair[1]);
                let mut all: Vec<u32> = own.chain([2, 90]).collect();
                all.sort_unstable();
                all.dedup();
                all
            };
            let groups: Vec<Vec<u32>> = (0..4).map(of_group).collect();
            let slices: Vec<&[u32]> = groups.iter().map(Vec::as_slice).collect();
            let renumbered = renumbered(words, &slices);
            let position = |[group, binding]: [u32; 2]| {
                let at = groups[group as usize].iter().position(|&other| other == binding).unwrap();
                [group, at as u32]
            };
            assert_eq!(bindings(&renumbered), declared.into_iter().map(position).collect::<Vec<_>>(), "{}", entry.name);
            let changed = words.iter().zip(&renumbered).filter(|(old, new)| old != new).count();
            assert!(words.len() == renumbered.len() && changed <= entry.bindings.len());
        }
    }
}
