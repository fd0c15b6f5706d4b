//! Test of the widget in JupyterLab. It runs a notebook's cell in headless Chromium, and rotates the scene.

use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use crate::{page, python};

/// Source of the tested notebook's cell, which draws a coloured sphere.
const CELL: &str = "import numpy as np, surfel\\n\
    points = np.random.default_rng(1).normal(size=(20000, 3))\\n\
    points /= np.linalg.norm(points, axis=1)[:, None]\\n\
    surfel.scene(points, colors=(points + 1) / 2).widget(backend='cpu')";
/// Maximum number of attempts to connect to the server, at intervals of 0.1 s.
const ATTEMPTS: u32 = 600;

/// Tests the widget. Returns true if the test passed, or if the packages of the page's tests aren't installed.
pub(crate) fn test(root: &Path, interpreter: &Path) -> bool {
    let tests = page::folder(root);
    if !tests.join("node_modules").is_dir() {
        println!("skipped: widget in JupyterLab: no packages in {}", tests.display());
        return true;
    }
    let folder = tests.join("lab");
    let cell = format!(
        "{{\"cell_type\":\"code\",\"execution_count\":null,\"id\":\"a\",\"metadata\":{{}},\"outputs\":[],\
         \"source\":\"{CELL}\"}}"
    );
    let kernel = "{\"kernelspec\":{\"name\":\"python3\",\"display_name\":\"Python 3\"}}";
    let notebook = format!("{{\"cells\":[{cell}],\"metadata\":{kernel},\"nbformat\":4,\"nbformat_minor\":5}}");
    let written = fs::create_dir_all(&folder).and_then(|()| fs::write(folder.join("look.ipynb"), notebook));
    let port =
        TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).map(|address| address.port());
    let Ok(port) = written.and(port) else {
        eprintln!("error: {} can't be written, or no port is free", folder.display());
        return false;
    };
    let mut server = Command::new(interpreter);
    server.args(["-m", "jupyterlab", "--no-browser", "--allow-root", "--ip=127.0.0.1", "--ServerApp.token=t"]);
    server.arg(format!("--port={port}")).current_dir(&folder).env("PYTHONPATH", root.join(python::SOURCE));
    let Ok(mut server) = server.stdout(Stdio::null()).stderr(Stdio::null()).spawn() else { return false };
    let is_there = (0..ATTEMPTS).any(|_| {
        thread::sleep(Duration::from_millis(100));
        TcpStream::connect(("127.0.0.1", port)).is_ok()
    });
    let mut node = Command::new("node");
    node.arg(tests.join("lab.mjs")).arg(format!("http://127.0.0.1:{port}")).arg("look.ipynb");
    let passed = is_there && node.arg(tests.join("screenshots")).status().is_ok_and(|status| status.success());
    let _ = server.kill();
    let _ = server.wait();
    passed
}
