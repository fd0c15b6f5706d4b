//! Files generated from the options table.

use std::path::Path;
use surfel_app::options::{Commands, Group, Options, Row, table};
use surfel_load::effects::{EFFECTS, Inputs};

/// Checks that a generated file is up to date, or writes it if the variable `SURFEL_WRITE` is set.
fn check(path: &Path, want: &str) {
    if std::env::var_os("SURFEL_WRITE").is_some() {
        std::fs::write(path, want).unwrap();
    }
    let is_current = std::fs::read_to_string(path).is_ok_and(|text| text == want);
    let remedy = "SURFEL_WRITE=1 cargo test -p surfel-cli --test tests options writes it";
    assert!(is_current, "{} is not what the options table says: {remedy}", path.display());
}

/// Lines around the generated part of Python's stubs.
const MARKS: [&str; 2] = ["# Generated from the options table:\n", "# End of what is generated.\n"];

#[test]
fn page_and_keywords_are_generated_from_the_table() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    check(&root.join("docs/options.md"), &table().page());
    let python = root.join("crates/surfel-python/python/surfel");
    check(&python.join("_table.py"), &table().python());
    let stub = std::fs::read_to_string(python.join("__init__.pyi")).unwrap();
    let (before, rest) = stub.split_once(MARKS[0]).unwrap();
    let (_, after) = rest.split_once(MARKS[1]).unwrap();
    check(&python.join("__init__.pyi"), &format!("{before}{}{}{}{after}", MARKS[0], table().stub(), MARKS[1]));
}

#[test]
fn a_new_row_is_in_the_page_the_keywords_and_the_setters() {
    let row = Row::text("glow", "G", |o, text| {
        o.render.cutoff = Some(surfel_app::values::cutoff(text)?);
        Ok(())
    });
    let row = row.of(Group::Appearance, Commands::RENDER).image().help("Glow of splats.", "").python("float");
    let table = table().clone().with(row.scene("settings.glow").synonyms(&["bloom"]));
    assert!(table.page().contains("| `--glow <G>` | Glow of splats. |  | render |  | `settings.glow` |"));
    assert!(table.page().contains("| bloom | `--glow` |"));
    assert!(table.stub().contains("    glow: float\n") && table.python().contains("    \"glow\",\n"));
    let mut options = Options::default();
    table.set(&mut options, Commands::RENDER, "glow", "3").unwrap();
    assert_eq!(options.render.cutoff, Some(3.0));
    assert_eq!(table.near_keyword(Commands::RENDER, "bloom").as_deref(), Some("glow"));
}

#[test]
fn rows_are_consistent() {
    for row in table().rows() {
        let name = row.name;
        assert!(!row.help.is_empty() && row.help.ends_with('.'), "{name}: {}", row.help);
        assert_eq!(row.is_switch(), row.value.is_empty(), "{name}");
        let twins = table().rows().filter(|other| other.name == name && other.commands.has(row.commands));
        assert_eq!(twins.count(), 1, "{name}");
        for other in row.conflicts.iter().chain(row.requires).chain(row.unless) {
            assert!(table().find(row.commands, other).is_some(), "{name}: {other}");
        }
        for synonym in row.synonyms {
            assert!(table().find(row.commands, synonym).is_none(), "{name}: {synonym} is an option");
        }
        row.set(&mut Options::default(), row.sample().as_ref()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(row.keyword == Commands::NONE || row.is_switch() || !row.python_type().is_empty());
    }
    for effect in EFFECTS {
        assert!(table().rows().any(|row| row.convert_key() == Some(effect.option)), "{}", effect.option);
    }
    assert_eq!(Inputs::POINTS.and(Inputs::MESHES).words(), "points or a mesh");
}

/// Tests that each option with a key in a scene file's `convert` object sets this key alone.
#[test]
fn scene_file_keys_are_those_of_the_table() {
    for row in table().rows().filter(|row| row.commands.has(Commands::RENDER)) {
        let Some(key) = row.convert_key() else { continue };
        let mut options = Options::default();
        row.set(&mut options, row.sample().as_ref()).unwrap();
        options.render.splats.convert.all_levels |= options.render.all_levels;
        let json = serde_json::to_value(&options.render.splats.convert).unwrap();
        let keys: Vec<&String> = json.as_object().unwrap().keys().collect();
        assert_eq!(keys, [key], "{}", row.name);
    }
}
