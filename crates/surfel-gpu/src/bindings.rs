//! Bind group (descriptor set) layouts, derived from the bindings that the shaders' entry points use.

use surfel_shaders::{BindingKind, ENTRIES, Stage, layout};

/// Entry of a bind group (descriptor set) layout: one binding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BindingSlot {
    /// Binding number.
    pub binding: u32,
    /// Kind of the resource.
    pub kind: BindingKind,
    /// Shader stages that use the binding.
    pub stages: Vec<Stage>,
}

/// Returns the bindings of bind group number `group` that any of the entry points with the names `entries` uses, sorted
/// by binding number.
pub fn binding_slots(entries: &[impl AsRef<str>], group: u32) -> Vec<BindingSlot> {
    let mut binding_slots: Vec<BindingSlot> = Vec::new();
    for entry in ENTRIES.iter().filter(|entry| entries.iter().any(|e| e.as_ref() == entry.name)) {
        for used in entry.bindings.iter().filter(|used| used.group == group) {
            let at = binding_slots.iter().position(|slot| slot.binding == used.binding);
            match at.and_then(|at| binding_slots.get_mut(at)) {
                Some(slot) if !slot.stages.contains(&entry.stage) => slot.stages.push(entry.stage),
                Some(_) => {}
                None => binding_slots.push(BindingSlot {
                    binding: used.binding,
                    kind: used.kind,
                    stages: vec![entry.stage],
                }),
            }
        }
    }
    binding_slots.sort_by_key(|slot| slot.binding);
    binding_slots
}

/// Returns the number of workgroups needed to cover `length` invocations along an axis (0 is x, 1 is y, 2 is z) of the
/// compute entry point with the name `entry`. An unknown entry point counts as one with `layout::WORKGROUP` invocations
/// per workgroup.
pub fn workgroups(length: u32, entry: &str, axis: usize) -> u32 {
    let entry = ENTRIES.iter().find(|e| e.name == entry);
    let size = entry.and_then(|e| e.workgroup.get(axis).copied()).filter(|&size| size > 0);
    length.div_ceil(size.unwrap_or(layout::WORKGROUP))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_holds_what_its_entry_points_use_in_the_stages_that_use_it() {
        let records = binding_slots(&["visibility_vertex", "attribute_vertex"], 1);
        assert_eq!(records, [BindingSlot { binding: 0, kind: BindingKind::StorageRead, stages: vec![Stage::Vertex] }]);
        let setup = binding_slots(&["setup"], 1);
        assert_eq!(setup.iter().map(|slot| slot.binding).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 7]);
        assert_eq!(setup[4].kind, BindingKind::StorageWrite);
        assert!(binding_slots(&["setup"], 7).is_empty());
        assert_eq!((workgroups(65, "setup", 0), workgroups(9, "shade", 1)), (2, 2));
    }
}
