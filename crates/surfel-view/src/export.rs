//! Export of a page that needs no server: one HTML file with the page, the drawing module and the scene's file.

use crate::Config;
use crate::desk::Desk;
use crate::page;
use data_encoding::BASE64;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::json;
use std::io::{self, Write};
use std::path::Path;
use surfel::options::{Commands, Setter, table};
use surfel::paths::is_stdin;
use surfel::scene::is_scene_file;

/// Largest file that is exported, in bytes. A browser holds it in memory several times.
const MAX_BYTES: u64 = 512 << 20;
/// Size of the image that the page is tried with.
const TRIED_SIZE: [u32; 2] = [64, 48];

/// Options that concern the machine of the export, not the scene.
const OF_MACHINE: [&str; 3] = ["backend", "adapter", "memory"];

/// Policy of the page: it runs its own code alone, and connects to nothing.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; \
                      style-src 'unsafe-inline'; img-src blob: data:; connect-src data:; base-uri 'none'; \
                      form-action 'none'";

/// The drawing module, for browsers with fused multiply-add and for others.
const MODULES: [(&str, &[u8]); 2] =
    [("fused.wasm", surfel_web_module::FUSED), ("emulated.wasm", surfel_web_module::EMULATED)];

/// Scripts of the worker that draws.
const WORKER: [(&str, &str); 2] =
    [("module.js", include_str!("../page/module.js")), ("worker.js", include_str!("../page/worker.js"))];

/// Returns an HTML file that shows a scene in any browser, without a server. It holds one file, byte by byte, and the
/// options of the configuration.
///
/// # Errors
/// A message if the drawing module isn't built; for a scene file, several files, a file that refers to others, that
/// can't be drawn or that is above 512 MiB; and for options that name files.
pub fn export(config: &Config) -> Result<Vec<u8>, String> {
    if MODULES.iter().any(|(_, module)| module.is_empty()) {
        return Err("this program has no drawing module: run cargo xtask web, and build it again".to_owned());
    }
    let [input] = &config.inputs[..] else {
        return Err(
            "--export takes one file\n  help: surfel convert joins the splats of a scene in a PLY file".to_owned()
        );
    };
    if is_scene_file(input) {
        let input = input.display();
        return Err(format!("{input}: --export takes a file of splats, points or a mesh, not a scene file"));
    }
    for (name, text) in &config.flags {
        let row = table().find(Commands::VIEW, name);
        if row.is_some_and(|row| matches!(row.set, Setter::Path(_)) && !row.has_name(text) && text != "builtin") {
            return Err(format!("--{name} {text}: an exported page holds no second file"));
        }
    }
    let bytes = read(config, input)?;
    let mut desk = Desk::new(config)?;
    let asked = desk.asked_of(&json!(null), &desk.initial.clone(), TRIED_SIZE)?;
    desk.show_once(&asked)?;
    if let Some(other) = desk.session(&asked.key)?.shown().and_then(|shown| shown.beside.first()) {
        return Err(format!(
            "{} refers to {}, and an exported page holds no second file\n  help: convert it to splats: surfel convert \
             INPUT out.ply",
            input.display(),
            other.display()
        ));
    }
    let flags: Vec<_> = config.flags.iter().filter(|(name, _)| !OF_MACHINE.contains(&name.as_str())).cloned().collect();
    exported(&input.to_string_lossy(), &flags, &bytes)
}

/// Returns bytes packed by gzip, as text in base64.
fn packed(bytes: &[u8]) -> Result<String, String> {
    let failed = |e: io::Error| format!("can't pack the page: {e}");
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(bytes).map_err(failed)?;
    Ok(BASE64.encode(&packed.finish().map_err(failed)?))
}

fn read(config: &Config, input: &Path) -> Result<Vec<u8>, String> {
    match &config.stdin {
        Some(bytes) if is_stdin(input) => Ok(bytes.to_vec()),
        _ => surfel::io::input::read(input, MAX_BYTES).map_err(|e| e.to_string()),
    }
}

/// Returns the page with everything that it needs inside.
fn exported(name: &str, flags: &[(String, String)], file: &[u8]) -> Result<Vec<u8>, String> {
    // Text of a script element ends at "</script", which neither base64 nor this JSON contains.
    let about = json!({ "name": name, "flags": flags }).to_string().replace('<', "\\u003c");
    let mut before = format!("<script type=\"application/json\" id=\"exported\">{about}</script>\n");
    for (id, bytes) in MODULES.iter().copied().chain([("file", file)]) {
        before += &format!("<script type=\"text/plain\" id=\"{id}\">{}</script>\n", packed(bytes)?);
    }
    for (id, script) in WORKER {
        before += &format!("<script type=\"text/plain\" id=\"{id}\">\n{script}</script>\n");
    }
    before += &page::script(include_str!("../page/export.js"));
    page::with(POLICY, &before).map(String::into_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_everything_and_name_no_address() {
        let flags = [("color-by".to_owned(), "</script><b>".to_owned())];
        let html = String::from_utf8(exported("a<b>.ply", &flags, b"a file").unwrap()).unwrap();
        assert!(html.contains("\"a\\u003cb>.ply\"") && !html.contains("</script><b>"), "names end no script");
        assert!(!html.contains("src=\"/") && !html.contains("href=\"/"), "nothing is read from elsewhere");
        assert_eq!(html.matches("<script").count(), html.matches("</script>").count());
        assert!(html.contains(&packed(b"a file").unwrap()));
        for script in ["module.js", "worker.js", "export.js", "view.js"] {
            let path = format!("{}/page/{script}", env!("CARGO_MANIFEST_DIR"));
            assert!(!std::fs::read_to_string(path).unwrap().contains("</script"), "{script}");
        }
    }

    #[test]
    fn several_files_scene_files_and_options_with_files_are_refused() {
        let config = |inputs: &[&str], flags: &[(&str, &str)]| Config {
            inputs: inputs.iter().map(Into::into).collect(),
            flags: flags.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect(),
            ..Config::default()
        };
        if surfel_web_module::FUSED.is_empty() {
            assert!(export(&Config::default()).unwrap_err().contains("cargo xtask web"));
            return;
        }
        for (config, words) in [
            (config(&["a.ply", "b.ply"], &[]), "takes one file"),
            (config(&["scene.json"], &[]), "not a scene file"),
            (config(&["a.ply"], &[("matcap", "a.png")]), "no second file"),
            (config(&["missing.ply"], &[]), "missing.ply"),
        ] {
            let problem = export(&config).unwrap_err();
            assert!(problem.contains(words), "{problem}");
        }
    }
}
