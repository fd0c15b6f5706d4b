//! Export of a page that draws without a server. The result is one HTML file with the page, the drawing module and the
//! scene's file, or a folder of these for a web server.

use crate::Config;
use crate::page;
use crate::request_handler::RequestHandler;
use data_encoding::BASE64;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::json;
use std::io::{self, Write};
use std::path::Path;
use surfel_app::options::{Commands, Setter, table};
use surfel_io::copc::Copc;
use surfel_io::{IoError, RegularFile, atomic};
use surfel_load::paths::is_stdin;
use surfel_load::scene::is_scene_file;

/// Largest accepted size of a file that is exported within the page, in bytes. A browser has several copies of it in
/// memory.
const MAX_BYTES: u64 = 512 << 20;
/// File name of the page in an exported folder.
const INDEX: &str = "index.html";
/// Image size, in pixels, for drawing the scene once before it is exported, to find out whether it can be drawn.
const TRIED_SIZE: [u32; 2] = [64, 48];

/// Names of the options that concern the exporting machine, not the scene. They are left out of the exported page.
const OF_MACHINE: [&str; 3] = ["backend", "adapter", "memory"];

/// Returns the page's content security policy, by which the page runs only its own code. `connects` are the policy's
/// sources from which the page may read data, such as `'self'`.
fn policy(connects: &str) -> String {
    format!(
        "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; style-src \
         'unsafe-inline'; img-src blob: data:; connect-src {connects}; base-uri 'none'; form-action 'none'"
    )
}

/// File names and bytes of the drawing modules: for browsers with fused multiply-add, and for others.
const MODULES: [(&str, &[u8]); 2] =
    [("fused.wasm", surfel_web_module::FUSED), ("emulated.wasm", surfel_web_module::EMULATED)];

/// File names and texts of the scripts of the drawing worker.
const WORKER: [(&str, &str); 2] =
    [("module.js", include_str!("../page/module.js")), ("worker.js", include_str!("../page/worker.js"))];

/// Returns an HTML file that shows a scene in any browser, without a server. It contains the input file, byte by byte,
/// and the options of the configuration.
///
/// # Errors
/// A message if the drawing module isn't built, or if the input isn't one file, is a scene file, refers to other files,
/// can't be drawn, or has more than 512 MiB. Also a message for options that name files.
pub fn export(config: &Config) -> Result<Vec<u8>, String> {
    let input = checked(config)?;
    let bytes = read(config, input)?;
    try_once(config)?;
    exported(&About::new(config, input, None), &bytes)
}

/// Writes a folder for a web server, which shows a scene in any browser. It contains the page as `index.html`, the
/// drawing modules, and the input file under its own name. From a COPC file, the page reads only what a view needs, by
/// HTTP ranges. Returns the size of the folder's files in bytes.
///
/// `index.html` is written last, so that the page never exists without the files that it needs.
///
/// # Errors
/// Errors of [`export`], except for the file's size. Also a message if the input is stdin or has the name of another
/// file of the folder, or if a file of the folder can't be written, or exists and `overwrite` is false.
pub fn export_folder(config: &Config, folder: &Path, overwrite: bool) -> Result<u64, String> {
    let input = checked(config)?;
    let Some(name) = input.file_name().filter(|_| !is_stdin(input)).and_then(|name| name.to_str()) else {
        return Err("-: a folder takes a file with a name, not stdin".to_owned());
    };
    if MODULES.iter().any(|(module, _)| *module == name) || name == INDEX {
        return Err(format!("{name}: the folder has a file of this name already"));
    }
    try_once(config)?;
    let failed = |e: IoError| e.to_string();
    let opened = RegularFile::open(input).map_err(|e| format!("{}: {e}", input.display()))?;
    let mut file = opened.ok_or_else(|| format!("{}: expected a regular file", input.display()))?;
    let is_copc = matches!(Copc::open(input), Ok(Some(_)));
    let beside = PageFile { name: name.to_owned(), file_bytes: file.file_bytes(), is_ranged: is_copc };
    let is_taken = |name: &&str| !overwrite && folder.join(name).exists();
    let names = MODULES.iter().map(|(name, _)| *name).chain([name, INDEX]);
    if let Some(taken) = names.clone().find(is_taken) {
        return Err(IoError::Exists { path: folder.join(taken) }.to_string());
    }
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: can't create the folder: {e}", folder.display()))?;
    for (name, module) in MODULES {
        atomic::write(&folder.join(name), overwrite, |out| out.write_all(module)).map_err(failed)?;
    }
    let target = folder.join(name);
    if atomic::target(&target) != atomic::target(input) {
        atomic::write(&target, overwrite, |out| io::copy(&mut file, out).map(|_| ())).map_err(failed)?;
    }
    let html = beside_page(&About::new(config, input, Some(beside)))?;
    atomic::write(&folder.join(INDEX), overwrite, |out| out.write_all(html.as_bytes())).map_err(failed)?;
    Ok(names.filter_map(|name| std::fs::metadata(folder.join(name)).ok()).map(|found| found.len()).sum())
}

/// Checks that a configuration can be exported. Returns its only input.
fn checked(config: &Config) -> Result<&Path, String> {
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
    Ok(input)
}

/// Draws the scene once, so that a scene that can't be drawn is refused now instead of in a browser.
fn try_once(config: &Config) -> Result<(), String> {
    let mut handler = RequestHandler::new(config)?;
    let asked = handler.image_request(&json!(null), &handler.initial.clone(), TRIED_SIZE)?;
    handler.show_once(&asked)?;
    if let Some(other) = handler.session(&asked.key)?.shown().and_then(|shown| shown.beside.first()) {
        return Err(format!(
            "{} refers to {}, and an exported page holds no second file\n  help: convert it to splats: surfel convert \
             INPUT out.ply",
            config.inputs.first().map_or("", |input| input.to_str().unwrap_or_default()),
            other.display()
        ));
    }
    Ok(())
}

/// Input file that lies beside the page in an exported folder.
struct PageFile {
    name: String,
    file_bytes: u64,
    /// True if the page reads only the ranges of the file that a view needs, false if it reads the whole file.
    is_ranged: bool,
}

/// Description of the scene, which an exported page reads instead of asking a server.
struct About {
    /// Name of the input, for display and for copied commands.
    name: String,
    /// Names and texts of the options with which the page begins.
    flags: Vec<(String, String)>,
    /// Input file beside the page; `None` if the page contains it.
    beside: Option<PageFile>,
}

impl About {
    fn new(config: &Config, input: &Path, beside: Option<PageFile>) -> Self {
        let is_for_page = |(name, _): &&(String, String)| !OF_MACHINE.contains(&name.as_str());
        let flags = config.flags.iter().filter(is_for_page).cloned().collect();
        Self { name: input.to_string_lossy().into_owned(), flags, beside }
    }

    /// Returns the HTML element with this description as JSON.
    fn element(&self) -> String {
        let beside = self.beside.as_ref();
        let ranged = beside.filter(|beside| beside.is_ranged).map(|beside| beside.file_bytes);
        let name = beside.map(|beside| &beside.name);
        let about = json!({ "name": self.name, "flags": self.flags, "beside": name, "ranged": ranged }).to_string();
        // A script element ends at the text "</script". This JSON must not contain it.
        let about = about.replace('<', "\\u003c");
        format!("<script type=\"application/json\" id=\"exported\">{about}</script>\n")
    }
}

/// Compresses bytes by gzip and returns them as base64 text.
fn packed(bytes: &[u8]) -> Result<String, String> {
    let failed = |e: io::Error| format!("can't pack the page: {e}");
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(bytes).map_err(failed)?;
    Ok(BASE64.encode(&packed.finish().map_err(failed)?))
}

fn read(config: &Config, input: &Path) -> Result<Vec<u8>, String> {
    match &config.stdin {
        Some(bytes) if is_stdin(input) => Ok(bytes.to_vec()),
        _ => surfel_io::input::read(input, MAX_BYTES).map_err(|e| e.to_string()),
    }
}

/// Returns the page as one HTML file, which contains everything that the page needs.
fn exported(about: &About, file: &[u8]) -> Result<Vec<u8>, String> {
    let mut before = about.element();
    for (id, bytes) in MODULES.iter().copied().chain([("file", file)]) {
        before += &format!("<script type=\"text/plain\" id=\"{id}\">{}</script>\n", packed(bytes)?);
    }
    page::with(&policy("data:"), &(before + &scripts())).map(String::into_bytes)
}

/// Returns the page for an exported folder. The page reads the other files of the folder.
fn beside_page(about: &About) -> Result<String, String> {
    page::with(&policy("'self'"), &(about.element() + &scripts()))
}

/// Returns the script elements for a page that draws by the WebAssembly module, without a server.
fn scripts() -> String {
    let script = |(id, script)| format!("<script type=\"text/plain\" id=\"{id}\">\n{script}</script>\n");
    WORKER.map(script).concat() + &page::script(include_str!("../page/export.js"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_everything_and_name_no_address() {
        let flags = vec![("color-by".to_owned(), "</script><b>".to_owned())];
        let about = About { name: "a<b>.ply".to_owned(), flags, beside: None };
        let html = String::from_utf8(exported(&about, b"a file").unwrap()).unwrap();
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
