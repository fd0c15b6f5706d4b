//! JSON-RPC 2.0 messages of the Model Context Protocol.

use super::tools::Tools;
use serde_json::{Value, json};

/// Largest accepted length of a message, in bytes.
pub(super) const MAX_LINE: usize = 1 << 20;
/// Supported versions of the protocol, the newest last. Their differences don't concern this server.
const VERSIONS: [&str; 3] = ["2024-11-05", "2025-03-26", "2025-06-18"];

/// JSON-RPC error code for text that isn't JSON.
const PARSE_ERROR: i32 = -32700;
/// JSON-RPC error code for JSON that isn't a request.
const INVALID_REQUEST: i32 = -32600;
/// JSON-RPC error code for a method that doesn't exist.
const NO_METHOD: i32 = -32601;
/// JSON-RPC error code for parameters that are wrong for a method.
const INVALID_PARAMETERS: i32 = -32602;

/// Instructions that the server gives to the host's language model.
const INSTRUCTIONS: &str = "Surfel draws point clouds, scans, splats and meshes as surfaces. Begin with inspect, which \
                            tells what a file holds. render returns images: of the view that suits the file, of \
                            views that you name, or a contact sheet of several. pick tells the position, row and \
                            attributes of what is seen at a pixel. compare measures the difference between two \
                            settings or files.";

/// Returns the answer to a message that is too long.
pub(super) fn too_long() -> Value {
    failure(&Value::Null, INVALID_REQUEST, &format!("the message has more than {MAX_LINE} bytes"))
}

fn failure(id: &Value, code: i32, message: &str) -> Value {
    json!({ "jsonrpc": "2.0", "id": id, "error": { "code": code, "message": message } })
}

/// Returns the response to a JSON-RPC message; `None` for blank lines, notifications and responses.
pub(super) fn answer(line: &[u8], tools: &mut Tools) -> Option<Value> {
    if line.trim_ascii().is_empty() {
        return None;
    }
    let message: Value = match serde_json::from_slice(line) {
        Ok(message) => message,
        Err(error) => return Some(failure(&Value::Null, PARSE_ERROR, &format!("the message is not JSON: {error}"))),
    };
    let id = &message["id"];
    let Some(method) = message["method"].as_str() else {
        // This server sends no requests, so it ignores answers.
        let is_answer = message.get("result").is_some() || message.get("error").is_some();
        let problem = "expected a JSON object with \"method\", the name of a method";
        return (!is_answer).then(|| failure(id, INVALID_REQUEST, problem));
    };
    // Notifications have no identifier.
    message.get("id")?;
    let result = match method {
        "initialize" => Ok(welcome(&message["params"])),
        "ping" => Ok(json!({})),
        "tools/list" => Ok(json!({ "tools": super::tools::descriptions() })),
        "tools/call" => {
            let parameters = &message["params"];
            let name = parameters["name"].as_str().unwrap_or_default();
            tools.call(name, &parameters["arguments"]).map_err(|problem| (INVALID_PARAMETERS, problem))
        }
        _ => Err((NO_METHOD, format!("there is no method {method}"))),
    };
    Some(match result {
        Ok(result) => json!({ "jsonrpc": "2.0", "id": id, "result": result }),
        Err((code, problem)) => failure(id, code, &problem),
    })
}

/// Returns the result of `initialize`. The protocol version is the client's if it is supported, otherwise the newest.
fn welcome(parameters: &Value) -> Value {
    let wanted = parameters["protocolVersion"].as_str();
    let version = VERSIONS.into_iter().find(|version| wanted == Some(*version)).or(VERSIONS.last().copied());
    json!({
        "protocolVersion": version,
        "capabilities": { "tools": {} },
        "serverInfo": { "name": "surfel", "title": "Surfel", "version": surfel_app::metadata::VERSION },
        "instructions": INSTRUCTIONS,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mcp::access::Access;
    use surfel_backend::BackendOptions;

    fn tools() -> Tools {
        Tools::new(Access::new(&[]).unwrap(), BackendOptions::default())
    }

    fn ask(text: &str) -> Option<Value> {
        answer(text.as_bytes(), &mut tools())
    }

    #[test]
    fn messages_get_the_answers_of_the_specification() {
        let hello = r#"{"jsonrpc":"2.0","id":1,"method":"initialize","params":{"protocolVersion":"2024-11-05"}}"#;
        let hello = ask(hello).unwrap();
        assert_eq!((&hello["id"], &hello["result"]["protocolVersion"]), (&json!(1), &json!("2024-11-05")));
        let newer =
            ask(r#"{"jsonrpc":"2.0","id":"a","method":"initialize","params":{"protocolVersion":"2099-01-01"}}"#);
        assert_eq!(newer.unwrap()["result"]["protocolVersion"], *VERSIONS.last().unwrap());
        assert_eq!(ask(r#"{"jsonrpc":"2.0","method":"notifications/initialized"}"#), None);
        assert_eq!(ask(r#"{"jsonrpc":"2.0","id":3,"result":{}}"#), None);
        assert_eq!(ask(" \n"), None);
        assert_eq!(ask(r#"{"jsonrpc":"2.0","id":4,"method":"ping"}"#).unwrap()["result"], json!({}));
        let listed = ask(r#"{"jsonrpc":"2.0","id":5,"method":"tools/list"}"#).unwrap();
        let names: Vec<_> = listed["result"]["tools"].as_array().unwrap().iter().map(|tool| &tool["name"]).collect();
        assert_eq!(names, ["inspect", "render", "pick", "compare"]);
    }

    #[test]
    fn wrong_messages_are_answered_by_an_error_code() {
        for (text, code) in [
            ("{", PARSE_ERROR),
            ("[]", INVALID_REQUEST),
            ("3", INVALID_REQUEST),
            ("{}", INVALID_REQUEST),
            (r#"{"id":1,"method":"resources/list"}"#, NO_METHOD),
            (r#"{"id":1,"method":"tools/call"}"#, INVALID_PARAMETERS),
            (r#"{"id":1,"method":"tools/call","params":{"name":"delete"}}"#, INVALID_PARAMETERS),
        ] {
            assert_eq!(ask(text).unwrap()["error"]["code"], code, "{text}");
        }
    }
}
