//! Renaming of elements and properties of PLY files from synonyms to the names that readers search for.

use super::header::{ElementDef, Kind, ScalarType};
use super::{INDEX_LISTS, body};
use crate::point_columns::{COLORS, NORMALS, POSITIONS, plain_name};

/// Names of the element with the vertices, ignoring case, in order of priority.
const VERTICES: [&str; 4] = ["vertex", "vertices", "point", "points"];
const FACES: [&str; 2] = ["face", "faces"];

/// Renames elements and properties from synonyms to the names of Surfel's splat profile, such as `vertex` and `nx`. A
/// synonym stays if the file has the profile's name, too. Messages use the file's own names.
pub(super) fn make_canonical(elements: &mut [ElementDef]) {
    rename_element(elements, &VERTICES);
    rename_element(elements, &FACES);
    for element in elements {
        match element.name.as_str() {
            "vertex" => {
                // Degrees aren't lengths: vertices in degrees are refused because they have no x y z.
                let lengths: Vec<[&str; 3]> = POSITIONS.into_iter().filter(|set| !set[0].starts_with("lon")).collect();
                rename_set(element, ["x", "y", "z"], &lengths);
                rename_set(element, ["nx", "ny", "nz"], &NORMALS);
                rename_colors(element);
                rename_set(element, ["radius"], &[["radius"], ["radii"]]);
            }
            "face" => {
                rename_colors(element);
                rename_corners(element);
            }
            _ => {}
        }
    }
}

/// Renames an element whose name is one of `names`, in any letter case, to the first of them. Does nothing if the file
/// has an element with the first name already.
fn rename_element(elements: &mut [ElementDef], names: &[&str]) {
    if elements.iter().any(|e| e.name == names[0]) {
        return;
    }
    let found = names.iter().find_map(|name| elements.iter().position(|e| e.name.eq_ignore_ascii_case(name)));
    if let Some(found) = found {
        elements[found].name = names[0].into();
    }
}

fn rename_colors(element: &mut ElementDef) {
    let rgb = ["red", "green", "blue"];
    rename_set(element, rgb, &COLORS);
    let has_colors = rgb.iter().all(|name| element.properties.iter().any(|p| p.name == *name));
    rename_set(element, ["alpha"], if has_colors { &[["alpha"], ["a"]] } else { &[["alpha"]] });
}

/// Renames a set of properties to the `canonical` names, unless one of these names exists already. Each of `sets`
/// contains a synonym for each canonical name. The first set whose synonyms all exist is renamed.
fn rename_set<const N: usize>(element: &mut ElementDef, canonical: [&str; N], sets: &[[&str; N]]) {
    let properties = &mut element.properties;
    if canonical.iter().any(|name| properties.iter().any(|p| p.name == *name)) {
        return;
    }
    let plain: Vec<String> = properties
        .iter()
        .map(|p| if matches!(p.kind, Kind::Scalar(_)) { plain_name(&p.name) } else { String::new() })
        .collect();
    let found = sets.iter().find_map(|set| {
        let places = set.map(|name| plain.iter().position(|p| p == name));
        places.iter().all(Option::is_some).then_some(places)
    });
    for (place, name) in found.into_iter().flatten().flatten().zip(canonical) {
        properties[place].name = name.into();
    }
}

/// Renames the list of a face's corners to `vertex_indices` if it is the only list of whole numbers. Does nothing if a
/// property has one of the names in [`INDEX_LISTS`] already.
fn rename_corners(element: &mut ElementDef) {
    let properties = &mut element.properties;
    if properties.iter().any(|p| INDEX_LISTS.contains(&p.name.as_str())) {
        return;
    }
    let is_list = |kind| matches!(kind, Kind::List { item, .. } if ScalarType::is_integer(item));
    let mut lists = properties.iter_mut().filter(|p| is_list(p.kind) && p.name != body::COORDINATES);
    if let (Some(only), None) = (lists.next(), lists.next()) {
        only.name = INDEX_LISTS[0].into();
    }
}
