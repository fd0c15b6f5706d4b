//! `surfel view`: server, protocol and attacks, by a client in Rust.

use crate::common::Folder;
#[cfg(unix)]
use crate::common::ignores_signal;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::Message;
use tungstenite::protocol::{Role, WebSocket, WebSocketConfig};

/// Time after which an answer counts as missing.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running `surfel view`, ended when dropped.
struct Server {
    child: Child,
    address: SocketAddr,
    token: String,
}

impl Server {
    fn start(folder: &Folder, words: &str) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_surfel"));
        command
            .current_dir(folder.path())
            .args(["view", "--no-open", "--backend", "cpu"])
            .args(words.split_whitespace());
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let (address, token) = line.trim().strip_prefix("http://").unwrap().split_once("/?token=").unwrap();
        Self { address: address.parse().unwrap(), token: token.to_owned(), child }
    }

    fn port(&self) -> u16 {
        self.address.port()
    }

    fn cookie(&self) -> String {
        format!("Cookie: surfel-{}={}\r\n", self.port(), self.token)
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends a request's head, and returns the whole response. A server that refuses a head may close the connection
    /// before all is sent.
    fn raw(&self, head: &str) -> String {
        let mut stream = self.connect();
        let _ = stream.write_all(head.as_bytes());
        let mut response = Vec::new();
        let _ = stream.read_to_end(&mut response);
        String::from_utf8_lossy(&response).into_owned()
    }

    fn get(&self, target: &str, headers: &str) -> String {
        self.raw(&format!("GET {target} HTTP/1.1\r\nHost: {}\r\n{headers}\r\n", self.address))
    }

    /// Opens a WebSocket as the page does. If the server refuses, returns the first line of its response.
    fn socket(&self, host: &str, origin: &str, cookie: &str) -> Result<Client, String> {
        let mut stream = self.connect();
        let head = format!(
            "GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{cookie}\r\n"
        );
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = Vec::new();
        while !answer.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            if stream.read(&mut byte).unwrap_or(0) == 0 {
                break;
            }
            answer.push(byte[0]);
        }
        let answer = String::from_utf8_lossy(&answer).into_owned();
        if !answer.starts_with("HTTP/1.1 101") {
            return Err(answer.lines().next().unwrap_or_default().to_owned());
        }
        // RFC 6455, 1.3 has this key and its answer.
        assert!(answer.contains("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{answer}");
        let config = WebSocketConfig::default().max_message_size(None).max_frame_size(None);
        let mut client = Client(WebSocket::from_raw_socket(stream, Role::Client, Some(config)));
        let welcome = client.next().0;
        assert_eq!(welcome["do"], "welcome");
        Ok(client)
    }

    fn client(&self) -> Client {
        let host = self.address.to_string();
        self.socket(&host, &format!("http://{host}"), &self.cookie()).unwrap()
    }

    /// Returns the largest memory that the server has used so far, in MiB; 0 if the system doesn't report the number.
    fn peak_mib(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok()).unwrap_or(0) >> 10
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Client that speaks the page's side of the WebSocket protocol.
struct Client(WebSocket<TcpStream>);

impl Client {
    fn send(&mut self, message: &Value) {
        self.0.send(Message::text(message.to_string())).unwrap();
    }

    /// Returns the next message other than progress: its header, and the bytes of the file that follows (empty if there
    /// is none).
    fn next(&mut self) -> (Value, Vec<u8>) {
        loop {
            let (header, file) = match self.0.read().unwrap() {
                Message::Text(text) => (serde_json::from_str::<Value>(&text).unwrap(), Vec::new()),
                Message::Binary(bytes) => {
                    let end = 4 + u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
                    (serde_json::from_slice(&bytes[4..end]).unwrap(), bytes[end..].to_vec())
                }
                other => panic!("{other:?}"),
            };
            if header["do"] != "progress" {
                return (header, file);
            }
        }
    }

    fn ask(&mut self, message: &Value) -> (Value, Vec<u8>) {
        self.send(message);
        loop {
            let answer = self.next();
            // An image of a sample of the points may come before the exact one.
            if answer.0["id"] == message["id"] && (answer.0["moving"] != true || message["moving"] == true) {
                return answer;
            }
        }
    }

    fn draw(&mut self, id: u64, state: &Value) -> (Value, Vec<u8>) {
        self.ask(&json!({ "do": "draw", "id": id, "state": state, "size": [160, 120] }))
    }
}

/// Returns a scan of a bumpy hill with classes and intensities, as text.
fn hill() -> String {
    let mut text = "x y z intensity classification\n".to_owned();
    for i in 0..60 {
        for j in 0..60 {
            let (x, y) = (f64::from(i) * 0.1, f64::from(j) * 0.1);
            let z = (x * 1.3).sin() * 0.4 + (y * 0.9).cos() * 0.5;
            text.push_str(&format!("{x:.2} {y:.2} {z:.4} {} {}\n", i * j, if i < 20 { 2 } else { 5 }));
        }
    }
    text
}

fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    folder.write("hill.txt", hill());
    folder
}

#[test]
fn still_images_are_those_of_the_copied_command_to_the_byte() {
    let f = folder("view-bytes");
    let server = Server::start(&f, "hill.txt --shader edl");
    let mut client = server.client();
    let (first, _) = client.draw(1, &json!({}));
    let eye: Vec<f64> = serde_json::from_value(first["camera"]["eye"].clone()).unwrap();
    let near = format!("{},{},{}", eye[0] * 0.7, eye[1] * 0.7, eye[2] * 0.7 + 1.0);
    let states = [
        json!({}),
        json!({ "view": "top", "shader": "phong" }),
        json!({ "eye": near, "target": "3,3,0", "camera-up": "0,0,1" }),
        json!({ "eye": near, "target": "3,3,0", "camera-up": "0,0,1", "color-by": "classification", "classes": "!5" }),
        json!({ "eye": "3,-9,6", "target": "3,3,0", "ortho": "on", "ortho-height": "5", "edge-aa": "samples" }),
        json!({ "up": "+y", "crop": "0,0,-9,3,9,9", "where": ["intensity>20"], "background": "transparent" }),
    ];
    for (i, state) in states.iter().enumerate() {
        // Images between two still ones change nothing.
        let moving = json!({ "do": "draw", "id": 500 + i, "state": state, "size": [40, 30], "moving": true });
        let (header, jpeg) = client.ask(&moving);
        assert!(header["moving"] == true && jpeg.starts_with(&[0xff, 0xd8]), "{header}");
        let (header, png) = client.draw(10 + i as u64, state);
        assert_eq!(header["do"], "image", "{header}");
        let copy = json!({ "do": "copy", "id": 100 + i, "as": "command", "state": state, "size": [160, 120] });
        let command = client.ask(&copy).0["text"].as_str().unwrap().to_owned();
        assert!(command.starts_with("surfel render hill.txt "), "{command}");
        let words: Vec<String> = command.split(' ').map(|word| word.trim_matches('\'').to_owned()).collect();
        let words: Vec<&str> = words[1..].iter().map(String::as_str).chain(["-f", "--backend", "cpu"]).collect();
        f.run_words(&words).code(0);
        assert!(f.read("view.png") == png, "{command}");
        let copy = json!({ "do": "copy", "id": 200 + i, "as": "scene", "state": state, "size": [160, 120] });
        f.write("scene.json", client.ask(&copy).0["text"].as_str().unwrap());
        f.run("render scene.json -o scene.png -f --backend cpu").code(0);
        let (a, b) = (f.image("scene.png"), f.image("view.png"));
        assert!(a.color == b.color, "the scene gives another image than {command}");
    }
}

#[test]
fn picks_name_the_row_and_compared_states_have_a_difference() {
    let f = folder("view-pick");
    let server = Server::start(&f, "hill.txt");
    let mut client = server.client();
    // Row 30·60 + 30 of the file, seen from above at the image's middle.
    let z = (3.0_f64 * 1.3).sin() * 0.4 + (3.0_f64 * 0.9).cos() * 0.5;
    let state = json!({ "eye": format!("3,3,{}", z + 2.0), "target": format!("3,3,{z}"), "camera-up": "0,1,0" });
    let pick = json!({ "do": "pick", "id": 1, "state": state, "size": [161, 121], "at": [80, 60] });
    let picked = client.ask(&pick).0["picked"].clone();
    assert_eq!((&picked["row"], &picked["input"]), (&json!(1830), &json!("hill.txt")), "{picked}");
    assert_eq!((&picked["values"]["classification"], &picked["values"]["intensity"]), (&json!(5.0), &json!(900.0)));
    let position: Vec<f64> = serde_json::from_value(picked["position"].clone()).unwrap();
    let off = (position[0] - 3.0).abs().max((position[1] - 3.0).abs()).max((position[2] - z).abs());
    assert!(off < 0.02, "{picked}");
    let away = json!({ "eye": "0,0,99", "target": "0,0,100", "camera-up": "0,1,0" });
    let nothing = json!({ "do": "pick", "id": 2, "state": away, "size": [161, 121], "at": [80, 60] });
    assert_eq!(client.ask(&nothing).0["picked"], Value::Null);

    let compare = |id: u64, b: Value| json!({ "do": "compare", "id": id, "a": state, "b": b, "size": [64, 48] });
    let (same, map) = client.ask(&compare(3, state.clone()));
    assert_eq!((&same["max_abs"], &same["psnr"]), (&json!(0.0), &Value::Null), "{same}");
    assert!(map.starts_with(b"\x89PNG"));
    let mut unlit = state.clone();
    unlit["shader"] = json!("unlit");
    let (other, _) = client.ask(&compare(4, unlit));
    assert!(other["max_abs"].as_f64().unwrap() > 0.01 && other["frame_ms"][1].as_f64().unwrap() > 0.0, "{other}");
    let (saved, png) = client.ask(&json!({ "do": "save", "id": 5, "state": state, "size": [300, 200] }));
    assert_eq!(saved["do"], "saved");
    f.write("saved.png", png);
    let image = f.image("saved.png");
    assert_eq!((image.width, image.height), (300, 200));
}

#[test]
fn wrong_requests_get_an_error_and_the_server_goes_on() {
    let f = folder("view-wrong");
    f.write("broken.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1\n");
    let server = Server::start(&f, "hill.txt");
    let mut client = server.client();
    for (id, request) in [
        json!({ "do": "format", "state": {} }),
        json!({ "do": "draw", "state": { "matcap": "../hill.txt" }, "size": [9, 9] }),
        json!({ "do": "draw", "state": { "shader": "matte" }, "size": [9, 9] }),
        json!({ "do": "draw", "state": { "input": 7 }, "size": [9, 9] }),
        json!({ "do": "draw", "state": { "eye": "0,0,0", "target": "0,0,0" }, "size": [9, 9] }),
        json!({ "do": "draw", "state": { "color-by": "colour" }, "size": [9, 9] }),
        json!({ "do": "draw", "state": {}, "size": [0, 9] }),
        json!({ "do": "draw", "state": {}, "size": [100_000, 100_000] }),
        json!({ "do": "draw", "state": { "backend": "reference" }, "size": [2000, 2000] }),
        json!({ "do": "draw", "state": {} }),
        json!({ "do": "save", "state": {}, "size": [16_000, 16_000] }),
        json!({ "do": "copy", "as": "shell", "state": {}, "size": [9, 9] }),
        json!({ "do": "pick", "at": "middle", "state": {}, "size": [9, 9] }),
    ]
    .into_iter()
    .enumerate()
    {
        let mut request = request;
        request["id"] = json!(id);
        let (answer, _) = client.ask(&request);
        assert!(answer["do"] == "error" && !answer["message"].as_str().unwrap().is_empty(), "{request}: {answer}");
    }
    client.0.send(Message::text("no JSON")).unwrap();
    assert_eq!(client.next().0["do"], "error");
    assert_eq!(client.draw(99, &json!({})).0["do"], "image");

    let broken = Server::start(&f, "broken.ply");
    let (answer, _) = broken.client().draw(1, &json!({}));
    assert!(answer["message"].as_str().unwrap().contains("broken.ply"), "{answer}");
    f.run("view --no-open absent.ply").fails(3, "absent.ply");
    f.run("view --no-open hill.txt --host 0.0.0.0").fails(1, "ssh -L");
    f.run("view --no-open hill.txt --port 99999").fails(2, "65535");
    f.run(&format!("view --no-open hill.txt --port {}", server.port())).fails(1, "--port");
    f.run("view --no-open hill.txt --view top --eye 1,2,3").fails(2, "--view");
}

#[test]
fn only_own_pages_with_the_token_are_answered() {
    let f = folder("view-guard");
    let server = Server::start(&f, "hill.txt");
    let (host, cookie) = (server.address.to_string(), server.cookie());
    let status = |response: &str| response.split(' ').nth(1).unwrap_or_default().to_owned();
    // The token moves to a cookie that no script and no other site can use.
    let opened = server.get(&format!("/?token={}", server.token), "");
    assert!(status(&opened) == "303" && opened.contains("HttpOnly; SameSite=Lax"), "{opened}");
    assert!(opened.contains("Location: /\r\n"), "{opened}");
    for (target, headers) in
        [("/", ""), ("/view.js", ""), ("/?token=", ""), ("/?token=0123456789abcdef0123456789abcdef", "")]
    {
        let response = server.get(target, headers);
        assert!(status(&response) == "403" && !response.contains(&server.token), "{target}: {response}");
    }
    let page = server.get("/", &cookie);
    assert!(status(&page) == "200" && page.contains("default-src 'none'") && !page.contains(&server.token), "{page}");
    for target in ["/view.js", "/view.css", "/icon.svg"] {
        assert_eq!(status(&server.get(target, &cookie)), "200", "{target}");
    }
    for target in ["/../hill.txt", "/hill.txt", "/%2e%2e/hill.txt", "//etc/passwd", "/view.js/..", "/page/view.js"] {
        assert_eq!(status(&server.get(target, &cookie)), "404", "{target}");
    }
    for foreign in ["evil.example", "evil.example:80", "10.0.0.1", "127.0.0.1.evil.example", ""] {
        let response = server.raw(&format!("GET / HTTP/1.1\r\nHost: {foreign}\r\n{cookie}\r\n"));
        assert_eq!(status(&response), "421", "{foreign}");
    }
    assert_eq!(status(&server.raw(&format!("POST / HTTP/1.1\r\nHost: {host}\r\n{cookie}\r\n"))), "405");
    assert_eq!(status(&server.raw("\u{16}\u{3} nonsense\r\n\r\n")), "400");
    let long = format!("GET / HTTP/1.1\r\nHost: {host}\r\nX: {}\r\n\r\n", "a".repeat(1 << 20));
    assert!(["431", ""].contains(&status(&server.raw(&long)).as_str()));
    let own = format!("http://{host}");
    for (host, origin, cookie) in [
        (host.as_str(), own.as_str(), ""),
        (&host, &own, "Cookie: surfel=1\r\n"),
        (&host, "http://evil.example", &cookie),
        (&host, "null", &cookie),
        (&host, "http://127.0.0.1:1", &cookie),
        ("evil.example", "http://evil.example", &cookie),
    ] {
        let refused = server.socket(host, origin, cookie).err().unwrap();
        assert!(refused.contains("403") || refused.contains("421"), "{host} {origin}: {refused}");
    }
    // A tunnel has another port, and its page's own origin.
    let tunnel = "localhost:9999";
    assert!(server.socket(tunnel, "http://localhost:9999", &cookie).is_ok());
}

#[test]
fn floods_and_slow_readers_stall_nobody_and_memory_is_bounded() {
    let f = folder("view-flood");
    let mut server = Server::start(&f, "hill.txt");
    let mut client = server.client();
    client.draw(1, &json!({}));
    let before = server.peak_mib();

    let cookie = server.cookie();
    for i in 0..10_000 {
        let target = if i % 2 == 0 { "/view.js" } else { "/" };
        let response = server.get(target, if i % 3 == 0 { &cookie } else { "" });
        assert!(response.starts_with("HTTP/1.1 "), "request {i}: {response}");
    }
    // A frame that claims 1 GB, masked as a client's.
    let mut hostile = server.client();
    let stream = hostile.0.get_mut();
    stream.write_all(&[0x82, 0xff, 0, 0, 0, 0, 0x40, 0, 0, 0, 1, 2, 3, 4]).unwrap();
    let _ = stream.write_all(&[7; 1 << 16]);
    let mut end = Vec::new();
    let _ = stream.read_to_end(&mut end);
    // Messages that never end.
    let mut endless = server.client();
    let piece = [&[0x01, 0xfe, 0xff, 0xff, 0, 0, 0, 0][..], &vec![b'a'; 65_535]].concat();
    let sent = (0..2000).take_while(|_| endless.0.get_mut().write_all(&piece).is_ok()).count();
    assert!(sent < 2000, "a message of {sent} pieces was read");

    // A client that asks for large images and reads none.
    let mut slow = server.client();
    for id in 0..40 {
        slow.send(&json!({ "do": "draw", "id": id, "state": {}, "size": [1500, 1500], "moving": true }));
    }
    let start = Instant::now();
    for id in 10..20 {
        assert_eq!(client.draw(id, &json!({ "view": "top" })).0["do"], "image");
    }
    assert!(start.elapsed() < PATIENCE, "{:?}", start.elapsed());
    // Heads that never end take connections, which time out.
    let idle: Vec<TcpStream> = (0..100).map(|_| server.connect()).collect();
    assert_eq!(client.draw(30, &json!({})).0["do"], "image");
    drop(idle);
    let used = server.peak_mib() - before;
    assert!(used < 300, "{used} MiB more than before");
    assert!(server.child.try_wait().unwrap().is_none(), "the server ended");
}

#[cfg(unix)]
#[test]
fn the_server_ends_by_signals_and_draws_nothing_unasked() {
    let f = folder("view-signals");
    for (number, signal) in [(2, "INT"), (15, "TERM"), (1, "HUP")] {
        // A signal that this program ignores, as below `nohup` or in the background of a script, stays ignored.
        if ignores_signal(number) {
            continue;
        }
        let mut server = Server::start(&f, "hill.txt");
        let mut client = server.client();
        client.draw(1, &json!({}));
        let times = || {
            let stat = std::fs::read_to_string(format!("/proc/{}/stat", server.child.id())).unwrap_or_default();
            let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
            let ticks = |i: usize| fields.get(i).and_then(|t| t.parse::<u64>().ok()).unwrap_or(0);
            ticks(11) + ticks(12)
        };
        // The window begins half a second after the reply, so that the end of the requested drawing doesn't count.
        std::thread::sleep(Duration::from_millis(500));
        let idle_from = times();
        std::thread::sleep(Duration::from_secs(1));
        // A hundredth of a second per tick.
        assert!(times() - idle_from <= 2, "{} ticks while idle", times() - idle_from);
        let killed = Command::new("kill").args([format!("-{signal}"), server.child.id().to_string()]).status();
        assert!(killed.unwrap().success());
        let start = Instant::now();
        while server.child.try_wait().unwrap().is_none() {
            assert!(start.elapsed() < Duration::from_secs(10), "SIG{signal}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
