//! `surfel mcp`: the protocol and its tools.

use crate::common::Folder;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A running `surfel mcp`.
struct Server {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Server {
    fn start(folder: &Folder, words: &str) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_surfel"));
        command.current_dir(folder.path()).arg("mcp").args(words.split_whitespace());
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let (input, output) = (child.stdin.take(), BufReader::new(child.stdout.take().unwrap()));
        Self { child, input, output }
    }

    fn send(&mut self, line: &str) {
        writeln!(self.input.as_mut().unwrap(), "{line}").unwrap();
    }

    fn answer(&mut self) -> Value {
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap()
    }

    /// Calls a tool, and returns its result.
    fn call(&mut self, tool: &str, arguments: &Value) -> Value {
        let parameters = json!({ "name": tool, "arguments": arguments });
        let request = json!({ "jsonrpc": "2.0", "id": 7, "method": "tools/call", "params": parameters });
        self.send(&request.to_string());
        let answer = self.answer();
        assert_eq!(answer["id"], 7);
        answer["result"].clone()
    }

    /// Calls a tool that must fail, and returns the text of its error.
    fn fails(&mut self, tool: &str, arguments: &Value) -> String {
        let result = self.call(tool, arguments);
        assert_eq!(result["isError"], true, "{result}");
        result["content"][0]["text"].as_str().unwrap().to_owned()
    }

    fn ends(mut self) {
        drop(self.input.take());
        assert!(self.child.wait().unwrap().success());
    }
}

/// Returns the PNG image in a tool's result, from the content block with the index `block`.
fn png(result: &Value, block: usize) -> Vec<u8> {
    let block = &result["content"][block];
    assert_eq!((&block["type"], &block["mimeType"]), (&json!("image"), &json!("image/png")));
    base64(block["data"].as_str().unwrap())
}

/// Decodes Base64 (RFC 4648).
fn base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits = text.bytes().filter(|digit| *digit != b'=');
    let values: Vec<u32> = digits.map(|d| DIGITS.iter().position(|known| *known == d).unwrap() as u32).collect();
    let bytes = values.chunks(4).flat_map(|four| {
        let bits = four.iter().enumerate().fold(0, |sum, (i, value)| sum | value << (18 - 6 * i));
        (0..four.len() - 1).map(move |i| (bits >> (16 - 8 * i)) as u8)
    });
    bytes.collect()
}

/// Returns a folder with a wavy sheet of points, with a class each.
fn sheet(name: &str) -> Folder {
    let folder = Folder::new(name);
    let mut text = String::from("x y z classification\n");
    for i in 0..40 {
        for k in 0..40 {
            let (x, y) = (0.1 * f64::from(i), 0.1 * f64::from(k));
            text += &format!("{x} {y} {} {}\n", 0.2 * (2.0 * x).sin(), if i < 20 { 2 } else { 6 });
        }
    }
    folder.write("sheet.csv", text);
    folder
}

#[test]
fn host_can_inspect_draw_pick_and_compare() {
    let folder = sheet("mcp");
    let mut server = Server::start(&folder, "");
    server.send(r#"{"jsonrpc":"2.0","id":0,"method":"initialize","params":{"protocolVersion":"2025-06-18"}}"#);
    let welcome = server.answer();
    assert_eq!(welcome["result"]["serverInfo"]["name"], "surfel");
    server.send(r#"{"jsonrpc":"2.0","method":"notifications/initialized"}"#);

    let facts = server.call("inspect", &json!({ "path": "sheet.csv" }));
    assert_eq!(facts["structuredContent"]["points"], 1600);
    assert!(facts["content"][0]["text"].as_str().unwrap().contains("classification"));

    let scene = |more: Value| {
        let mut arguments = json!({ "paths": ["sheet.csv"], "size": [64, 48] });
        arguments.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        arguments
    };
    let drawn = server.call("render", &scene(json!({ "views": ["30,40"], "options": { "shader": "edl" } })));
    assert_eq!(drawn["isError"], false, "{drawn}");
    let image = png(&drawn, 1);
    // The command that the answer states draws the same bytes.
    let command = drawn["structuredContent"]["images"][0]["command"].as_str().unwrap();
    let words = command.strip_prefix("surfel ").unwrap();
    folder.run(&words.replace("-o view.png", "-o again.png")).code(0);
    assert!(folder.read("again.png") == image, "{command}");
    assert_eq!(drawn["structuredContent"]["images"][0]["camera"]["size"], json!([64, 48]));

    let sheet = server.call("render", &scene(json!({ "views": ["front", "top", "iso"], "sheet": true })));
    assert_eq!(sheet["content"].as_array().unwrap().len(), 2);
    assert_eq!(sheet["structuredContent"]["images"].as_array().unwrap().len(), 3);
    folder.write("sheet.png", png(&sheet, 1));
    let planes = folder.image("sheet.png");
    assert!(planes.width > 2 * 64 && planes.height > 2 * 48, "{} x {}", planes.width, planes.height);

    let picked = server.call("pick", &scene(json!({ "view": "top", "at": [32, 24] })));
    let picked = &picked["structuredContent"]["picked"];
    let position = picked["position"].as_array().unwrap();
    assert!((position[0].as_f64().unwrap() - 2.0).abs() < 0.2, "{picked}");
    assert!(picked["values"]["classification"].is_number() && picked["row"].is_number(), "{picked}");
    let nothing = server.call("pick", &scene(json!({ "view": "front", "at": [0, 0] })));
    assert_eq!(nothing["structuredContent"]["picked"], Value::Null);

    let same = server.call("compare", &scene(json!({ "a": {}, "b": {} })));
    assert_eq!((&same["structuredContent"]["rmse"], &same["structuredContent"]["psnr"]), (&json!(0.0), &Value::Null));
    let other = server.call("compare", &scene(json!({ "a": {}, "b": { "options": { "shader": "normal" } } })));
    assert!(other["structuredContent"]["rmse"].as_f64().unwrap() > 0.01 && !png(&other, 1).is_empty());
    server.ends();
}

#[test]
fn wrong_calls_are_answered_and_the_next_one_works() {
    let folder = sheet("mcp-wrong");
    std::fs::create_dir(folder.path().join("inner")).unwrap();
    let mut server = Server::start(&folder, "sheet.csv");
    let of = |more: Value| {
        let mut arguments = json!({ "paths": ["sheet.csv"] });
        arguments.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        arguments
    };
    for (tool, arguments, expected) in [
        ("inspect", json!({ "path": "/etc/passwd" }), "may be read"),
        ("inspect", json!({ "path": "missing.ply" }), "can't read"),
        ("inspect", json!({ "path": 3 }), "expected text"),
        ("render", json!({}), "expected a list of files"),
        ("render", of(json!({ "paths": ["-"] })), "can't read"),
        ("render", of(json!({ "output": "a.png" })), "no argument output"),
        ("render", of(json!({ "views": [] })), "1 to 12 views"),
        ("render", of(json!({ "views": ["somewhere"] })), "somewhere"),
        ("render", of(json!({ "size": [100_000, 100_000] })), "pixels"),
        ("render", of(json!({ "size": [0, 4] })), "pixels"),
        // A product beyond 64 bits.
        ("render", of(json!({ "size": [u32::MAX, u32::MAX], "views": ["top", "top", "top"] })), "pixels"),
        ("render", of(json!({ "options": { "matcap": "/etc/passwd" } })), "command line only"),
        ("render", of(json!({ "options": { "allow-outside": "on" } })), "no such option"),
        ("render", of(json!({ "options": { "shader": "shiny" } })), "shader"),
        ("pick", of(json!({ "size": [8, 8], "at": [8, 0] })), "outside of the image"),
        ("compare", of(json!({ "a": {} })), "b: expected an object"),
    ] {
        let text = server.fails(tool, &arguments);
        assert!(text.contains(expected), "{tool} {arguments}: {text}");
    }
    server.send("{ not JSON");
    assert_eq!(server.answer()["error"]["code"], -32700);
    server.send(&"x".repeat(3 << 20));
    assert_eq!(server.answer()["error"]["code"], -32600);
    let facts = server.call("inspect", &json!({ "path": "sheet.csv" }));
    assert_eq!(facts["isError"], false);
    server.ends();
    folder.run("mcp nowhere").fails(3, "expected a file or a folder");
}
