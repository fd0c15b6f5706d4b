//! Drawing for a single page, without a server.

use crate::Config;
use crate::request_handler::{Answer, RequestHandler};
use serde_json::{Value, json};
use surfel_app::wording::as_flags;
use surfel_sample::NoProgress;

/// Message to the page.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// A JSON message.
    Text(String),
    /// A message with a file: the length of a header in four bytes, little-endian, the header in JSON, and the file.
    Binary(Vec<u8>),
}

/// Answers the requests of a single page, one after another.
///
/// ```
/// use surfel_view::{Config, Message, Painter};
/// let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
///            property float nx\nproperty float ny\nproperty float nz\nproperty float radius\nend_header\n\
///            0 0 0 0 0 1 1\n";
/// let stdin = Some(ply.as_bytes().into());
/// let mut painter = Painter::new(&Config { inputs: vec!["-".into()], stdin, ..Config::default() })?;
/// let answer = painter.answer(r#"{"do": "draw", "id": 1, "state": {}, "size": [64, 48]}"#);
/// assert!(matches!(answer, Message::Binary(_)));
/// # Ok::<(), String>(())
/// ```
pub struct Painter {
    handler: RequestHandler,
}

impl Painter {
    /// Creates a painter for these inputs and options. The first image loads the inputs.
    ///
    /// # Errors
    /// A message that names a flag that isn't an option.
    pub fn new(config: &Config) -> Result<Self, String> {
        Ok(Self { handler: RequestHandler::new(config)? })
    }

    /// Returns the first message to the page, as JSON: the options that the page can set, and the initial state.
    pub fn welcome(&self) -> String {
        self.handler.welcome().to_string()
    }

    /// Answers a request, which is a JSON object. An error is returned as a message, too.
    pub fn answer(&mut self, request: &str) -> Message {
        let request: Value = serde_json::from_str(request).unwrap_or_default();
        match self.handler.answer(0, &request, &NoProgress) {
            Ok(Answer::Text(answer)) => Message::Text(answer.to_string()),
            Ok(Answer::Image(file) | Answer::File(file)) => Message::Binary(file),
            Err(problem) => {
                let (id, layer, of) = (&request["id"], &request["layer"], &request["do"]);
                let error = json!({ "do": "error", "id": id, "layer": layer, "of": of, "message": as_flags(&problem) });
                Message::Text(error.to_string())
            }
        }
    }
}
