//! Prints a table of the shaders' SPIR-V, a row per entry point: size, instructions, loops, barriers, workgroup memory,
//! and the instructions that naga's checks add. `cargo xtask shader-stats` runs it.

#[path = "../build/spirv.rs"]
#[allow(dead_code, reason = "the build script also writes modules as Rust text")]
mod spirv;

use naga::proc::BoundsCheckPolicy;
use spirv::AddedChecks;
use std::error::Error;
use surfel_shaders::{ENTRIES, PASSES, SPIRV, Stage};

/// Counts of a SPIR-V module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    /// Instructions inside of functions.
    instructions: usize,
    loops: usize,
    barriers: usize,
    /// Size of the variables in workgroup memory, in bytes.
    workgroup_bytes: u32,
}

/// Opcodes of SPIR-V (specification of version 1.3, §3.32).
mod op {
    pub(super) const TYPE_INT: u32 = 21;
    pub(super) const TYPE_FLOAT: u32 = 22;
    pub(super) const TYPE_VECTOR: u32 = 23;
    pub(super) const TYPE_ARRAY: u32 = 28;
    pub(super) const TYPE_STRUCT: u32 = 30;
    pub(super) const TYPE_POINTER: u32 = 32;
    pub(super) const CONSTANT: u32 = 43;
    pub(super) const FUNCTION: u32 = 54;
    pub(super) const FUNCTION_END: u32 = 56;
    pub(super) const VARIABLE: u32 = 59;
    pub(super) const CONTROL_BARRIER: u32 = 224;
    pub(super) const LOOP_MERGE: u32 = 246;
}

/// Storage class of workgroup memory.
const WORKGROUP: u32 = 4;

impl Counts {
    /// Counts the instructions of a module.
    fn of(words: &[u32]) -> Self {
        let mut counts = Self::default();
        let mut is_inside = false;
        // Sizes of types, pointees of pointers and values of constants, by their identifiers.
        let (mut sizes, mut pointees, mut constants) = (Vec::new(), Vec::new(), Vec::new());
        let find =
            |table: &[(u32, u32)], id: u32| table.iter().find(|(of, _)| *of == id).map_or(0, |(_, value)| *value);
        // The header has five words.
        let mut rest = words.get(5..).unwrap_or_default();
        while let Some(&first) = rest.first() {
            let length = ((first >> 16) as usize).clamp(1, rest.len());
            let (instruction, after) = rest.split_at(length);
            rest = after;
            let operand = |i: usize| instruction.get(i).copied().unwrap_or(0);
            is_inside |= first & 0xffff == op::FUNCTION;
            counts.instructions += usize::from(is_inside);
            match first & 0xffff {
                op::FUNCTION_END => is_inside = false,
                op::LOOP_MERGE => counts.loops += 1,
                op::CONTROL_BARRIER => counts.barriers += 1,
                op::TYPE_INT | op::TYPE_FLOAT => sizes.push((operand(1), operand(2) / 8)),
                op::TYPE_VECTOR => sizes.push((operand(1), find(&sizes, operand(2)) * operand(3))),
                op::TYPE_ARRAY => sizes.push((operand(1), find(&sizes, operand(2)) * find(&constants, operand(3)))),
                op::TYPE_STRUCT => {
                    let members = instruction.iter().skip(2).map(|&member| find(&sizes, member));
                    sizes.push((operand(1), members.sum()));
                }
                op::TYPE_POINTER => pointees.push((operand(1), operand(3))),
                op::CONSTANT => constants.push((operand(2), operand(3))),
                op::VARIABLE if operand(3) == WORKGROUP => {
                    counts.workgroup_bytes += find(&sizes, find(&pointees, operand(1)));
                }
                _ => {}
            }
        }
        counts
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let module = naga::front::wgsl::parse_str(PASSES)?;
    let none = AddedChecks {
        index: BoundsCheckPolicy::Unchecked,
        buffer: BoundsCheckPolicy::Unchecked,
        bounds_loops: false,
        zeroes_workgroup: false,
    };
    let restrict = BoundsCheckPolicy::Restrict;
    let variants = [
        AddedChecks { index: restrict, ..none },
        AddedChecks { buffer: restrict, ..none },
        AddedChecks { bounds_loops: true, ..none },
        AddedChecks { zeroes_workgroup: true, ..none },
    ];
    println!("Instructions as built and without any check, then what each check alone adds.\n");
    let columns = "entry point | stage | bytes | instructions | bare | +index | +buffer | +loops | +zero | loops";
    println!("| {columns} | barriers | workgroup |");
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    let mut sums = [0usize; 7];
    for entry in ENTRIES {
        let Some((_, words)) = SPIRV.iter().find(|(name, _)| *name == entry.name) else { continue };
        let built = Counts::of(words);
        let counted = |checks| spirv::words(&module, entry.name, checks).map(|words| Counts::of(&words).instructions);
        let bare = counted(none)?;
        let mut added = Vec::new();
        for checks in variants {
            added.push(counted(checks)?.saturating_sub(bare));
        }
        let stage = match entry.stage {
            Stage::Vertex => "vertex",
            Stage::Fragment => "fragment",
            Stage::Compute => "compute",
        };
        let bytes = 4 * words.len();
        let Counts { instructions, loops, barriers, workgroup_bytes } = built;
        let of_checks = added.iter().map(usize::to_string).collect::<Vec<_>>().join(" | ");
        let name = entry.name;
        let sizes = format!("{bytes} | {instructions} | {bare} | {of_checks}");
        println!("| `{name}` | {stage} | {sizes} | {loops} | {barriers} | {workgroup_bytes} |");
        let numbers = [bytes, instructions, bare].into_iter().chain(added);
        sums.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += number);
    }
    let sums = sums.map(|sum| sum.to_string()).join(" | ");
    println!("| all {} | | {sums} | | | |", ENTRIES.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_agree_with_the_text() {
        let text = "
            var<workgroup> shared_words: array<vec4f, 32>;
            @group(0) @binding(0) var<storage, read_write> words: array<f32>;
            @compute @workgroup_size(32)
            fn cell_test(@builtin(local_invocation_index) i: u32) {
                shared_words[i] = vec4f(words[i]);
                workgroupBarrier();
                for (var k = 0u; k < 3u; k++) {
                    words[i] += shared_words[(i + k) % 32u].x;
                }
            }
        ";
        let module = naga::front::wgsl::parse_str(text).unwrap();
        let counts = |checks| Counts::of(&spirv::words(&module, "cell_test", checks).unwrap());
        let built = counts(AddedChecks::of("cell_test"));
        assert_eq!((built.loops, built.barriers, built.workgroup_bytes), (1, 1, 512));
        let full = AddedChecks {
            index: BoundsCheckPolicy::Restrict,
            bounds_loops: true,
            zeroes_workgroup: true,
            ..AddedChecks::of("cell_test")
        };
        let all = counts(full);
        // Zeroing ends with a barrier of its own.
        assert_eq!((all.loops, all.barriers), (1, 2));
        assert!(all.instructions > built.instructions + 10, "{all:?} {built:?}");
    }
}
