//! Generates Rust source from a parsed shader, so that no layout or binding is written by hand.

use std::error::Error;
use std::fmt::Write as _;

use naga::valid::{GlobalUse, ModuleInfo};
use naga::{AddressSpace, Expression, Literal, Module, ShaderStage, StorageAccess, TypeInner};

/// Returns the Rust text of a sorted slice of the functions' names.
pub(crate) fn functions(module: &Module) -> String {
    let mut names: Vec<&str> = module.functions.iter().filter_map(|(_, f)| f.name.as_deref()).collect();
    names.sort_unstable();
    format!("&{names:?}")
}

/// Returns the Rust text of a module of byte offsets for each struct in buffers, and of the shaders' constants.
pub(crate) fn layouts(module: &Module) -> Result<String, Box<dyn Error>> {
    let mut shared = Vec::new();
    for (_, variable) in module.global_variables.iter() {
        if matches!(variable.space, AddressSpace::Uniform | AddressSpace::Storage { .. }) {
            collect(module, variable.ty, &mut shared);
        }
    }
    let mut text = String::new();
    for (_, ty) in module.types.iter().filter(|(handle, _)| shared.contains(handle)) {
        let (Some(name), TypeInner::Struct { members, span }) = (&ty.name, &ty.inner) else { continue };
        writeln!(text, "/// Offsets of `{name}`, bytes.\npub mod {} {{", snake(name))?;
        // The stride of an array of the struct: its size is a multiple of its alignment.
        writeln!(text, "    /// Size, also from one to the next in an array.\n    pub const SIZE: usize = {span};")?;
        for member in members {
            let Some(field) = &member.name else { continue };
            writeln!(text, "    /// Offset of `{field}`.")?;
            writeln!(text, "    pub const {}: usize = {};", field.to_uppercase(), member.offset)?;
        }
        writeln!(text, "}}")?;
    }
    for (_, constant) in module.constants.iter() {
        let Some(name) = &constant.name else { continue };
        let (ty, value) = match &module.global_expressions[constant.init] {
            Expression::Literal(Literal::U32(value)) => ("u32", value.to_string()),
            Expression::Literal(Literal::I32(value)) => ("i32", value.to_string()),
            Expression::Literal(Literal::F32(value)) => ("f32", format!("{value:?}")),
            other => return Err(format!("constant {name} is {other:?}, expected a u32, i32 or f32 literal").into()),
        };
        writeln!(text, "/// `{name}` of the shaders.\npub const {name}: {ty} = {value};")?;
    }
    Ok(text)
}

/// Adds `ty` and all structs that it contains to `found`.
fn collect(module: &Module, ty: naga::Handle<naga::Type>, found: &mut Vec<naga::Handle<naga::Type>>) {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } if !found.contains(&ty) => {
            found.push(ty);
            members.iter().for_each(|member| collect(module, member.ty, found));
        }
        TypeInner::Array { base, .. } => collect(module, *base, found),
        _ => {}
    }
}

fn snake(name: &str) -> String {
    let mut text = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.extend(c.to_lowercase());
    }
    text
}

/// Returns the Rust text of the table of entry points with their bindings.
pub(crate) fn entries(module: &Module, info: &ModuleInfo) -> Result<String, Box<dyn Error>> {
    let mut text = String::from("&[\n");
    for (index, entry) in module.entry_points.iter().enumerate() {
        let stage = match entry.stage {
            ShaderStage::Vertex => "Vertex",
            ShaderStage::Fragment => "Fragment",
            ShaderStage::Compute => "Compute",
            other => return Err(format!("entry point {} has stage {other:?}", entry.name).into()),
        };
        let used = info.get_entry_point(index);
        let mut bindings = Vec::new();
        for (handle, variable) in module.global_variables.iter() {
            let Some(at) = variable.binding.filter(|_| used[handle] != GlobalUse::empty()) else { continue };
            let kind = match (&module.types[variable.ty].inner, variable.space) {
                (_, AddressSpace::Uniform) => "Uniform",
                (_, AddressSpace::Storage { access }) if access.contains(StorageAccess::STORE) => "StorageWrite",
                (_, AddressSpace::Storage { .. }) => "StorageRead",
                (TypeInner::Image { class: naga::ImageClass::Depth { .. }, .. }, _) => "DepthTexture",
                (TypeInner::Image { class: naga::ImageClass::Sampled { .. }, .. }, _) => "Texture",
                (other, _) => return Err(format!("{:?} is a {other:?}", variable.name).into()),
            };
            bindings.push((at.group, at.binding, kind));
        }
        bindings.sort_unstable();
        let list: Vec<String> = bindings
            .iter()
            .map(|(group, binding, kind)| {
                format!("Binding {{ group: {group}, binding: {binding}, kind: BindingKind::{kind} }}")
            })
            .collect();
        writeln!(
            text,
            "    Entry {{ name: {:?}, stage: Stage::{stage}, workgroup: {:?}, bindings: &[{}] }},",
            entry.name,
            entry.workgroup_size,
            list.join(", ")
        )?;
    }
    text.push(']');
    Ok(text)
}
