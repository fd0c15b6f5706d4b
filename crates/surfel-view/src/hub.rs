//! Queues between clients (open pages) and the drawing thread. For each client and layer, only the newest request for
//! an image and the newest image wait.

use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Largest number of clients that are connected at the same time.
pub(crate) const MAX_CLIENTS: usize = 16;
/// Largest number of a client's waiting requests, apart from requests for images. Further ones are refused.
const MAX_TASKS: usize = 16;
/// Largest number of messages, apart from the newest image of each layer, that wait for a client. A slower client is
/// disconnected.
const MAX_TEXTS: usize = 64;
/// Largest total size, in bytes, of the messages that wait for a client, apart from the newest image of each layer. A
/// client that doesn't read its saved images is thus disconnected.
const MAX_WAITING_BYTES: usize = 256 << 20;
/// Number of layers, which are images that a page shows at once: the two of a comparison.
pub(crate) const LAYERS: usize = 2;

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A message to a client.
#[derive(Clone, Debug)]
pub(crate) enum Outgoing {
    /// Text message, in JSON.
    Text(String),
    /// Binary message: the length of a header, the header in JSON, and a file.
    Binary(Vec<u8>),
    /// Answer to a WebSocket ping, with the ping's bytes.
    Pong(Vec<u8>),
}

impl Outgoing {
    fn bytes(&self) -> usize {
        match self {
            Self::Text(text) => text.len(),
            Self::Binary(bytes) | Self::Pong(bytes) => bytes.len(),
        }
    }
}

/// Queue of messages to a client. Texts are sent in order. Of each layer (image on the page), only the newest image is
/// sent.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    messages: VecDeque<Outgoing>,
    images: [Option<Vec<u8>>; LAYERS],
    is_closed: bool,
}

impl Outbox {
    /// Adds a message. Closes the outbox, which disconnects the client, if too many messages or bytes wait in it.
    pub(crate) fn push(&self, message: Outgoing) {
        let mut waiting = lock(&self.waiting);
        waiting.messages.push_back(message);
        let bytes: usize = waiting.messages.iter().map(Outgoing::bytes).sum();
        if waiting.messages.len() > MAX_TEXTS || bytes > MAX_WAITING_BYTES {
            waiting.is_closed = true;
            waiting.messages.clear();
        }
        self.changed.notify_all();
    }

    /// Adds an image of a layer to the queue. The image replaces an older one of the same layer that still waits.
    pub(crate) fn put_image(&self, layer: usize, image: Vec<u8>) {
        let mut waiting = lock(&self.waiting);
        if let Some(slot) = waiting.images.get_mut(layer) {
            *slot = Some(image);
        }
        self.changed.notify_all();
    }

    /// Closes the outbox, which ends [`Outbox::next`].
    pub(crate) fn close(&self) {
        lock(&self.waiting).is_closed = true;
        self.changed.notify_all();
    }

    /// Waits for the next message; `None` after the outbox is closed.
    pub(crate) fn next(&self) -> Option<Outgoing> {
        let mut waiting = lock(&self.waiting);
        loop {
            if waiting.is_closed {
                return None;
            }
            if let Some(message) = waiting.messages.pop_front() {
                return Some(message);
            }
            if let Some(image) = waiting.images.iter_mut().find_map(Option::take) {
                return Some(Outgoing::Binary(image));
            }
            waiting = self.changed.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Reason for which the drawing thread continues.
#[derive(Debug)]
pub(crate) enum Next {
    /// A request of a client.
    Job(Job),
    /// All points are loaded ([`Hub::report_loaded`]).
    Loaded,
}

/// A request of a client, with the client's outbox for the answer.
#[derive(Clone, Debug)]
pub(crate) struct Job {
    pub(crate) outbox: Arc<Outbox>,
    pub(crate) request: Value,
}

struct Client {
    id: u64,
    outbox: Arc<Outbox>,
    draws: [Option<Value>; LAYERS],
    tasks: VecDeque<Value>,
    /// True if the client's last answered request was one for an image. The next answer is then to a request of another
    /// kind, if one waits.
    drew: bool,
}

impl Client {
    /// Removes and returns the next request. Requests for images and other requests alternate, so that a turntable
    /// doesn't delay a pick.
    fn next(&mut self) -> Option<Value> {
        if self.drew
            && let Some(task) = self.tasks.pop_front()
        {
            self.drew = false;
            return Some(task);
        }
        let draw = self.draws.iter_mut().find_map(Option::take);
        self.drew = draw.is_some();
        draw.or_else(|| self.tasks.pop_front())
    }
}

#[derive(Default)]
struct Clients {
    all: Vec<Client>,
    /// Index, among all clients, of the client whose request is answered next.
    turn: usize,
    last_id: u64,
    is_loaded: bool,
}

/// Queues of all clients. The clients' threads add requests, and the drawing thread answers the clients in turn.
#[derive(Default)]
pub(crate) struct Hub {
    clients: Mutex<Clients>,
    work: Condvar,
}

impl Hub {
    /// Adds a client, and returns its identifier and its queue of messages. Returns `None` if there are [`MAX_CLIENTS`]
    /// already.
    pub(crate) fn join(&self) -> Option<(u64, Arc<Outbox>)> {
        let mut clients = lock(&self.clients);
        if clients.all.len() >= MAX_CLIENTS {
            return None;
        }
        clients.last_id += 1;
        let (id, outbox) = (clients.last_id, Arc::new(Outbox::default()));
        let tasks = VecDeque::new();
        clients.all.push(Client { id, outbox: outbox.clone(), draws: Default::default(), tasks, drew: false });
        Some((id, outbox))
    }

    /// Removes a client and its waiting requests, and closes its outbox.
    pub(crate) fn leave(&self, id: u64) {
        let mut clients = lock(&self.clients);
        clients.all.retain(|client| {
            if client.id == id {
                client.outbox.close();
            }
            client.id != id
        });
    }

    /// Adds a request of a client. A request for an image replaces a waiting one for the same layer. Returns false if
    /// too many requests of other kinds wait, or if there is no such client.
    pub(crate) fn ask(&self, id: u64, request: Value) -> bool {
        let mut clients = lock(&self.clients);
        let Some(client) = clients.all.iter_mut().find(|client| client.id == id) else { return false };
        if request["do"] == "draw" {
            let layer = request["layer"].as_u64().unwrap_or(0) as usize;
            client.draws[layer.min(LAYERS - 1)] = Some(request);
        } else {
            if client.tasks.len() >= MAX_TASKS {
                return false;
            }
            client.tasks.push_back(request);
        }
        self.work.notify_all();
        true
    }

    /// Waits for the next request. Clients are served in turn.
    pub(crate) fn next(&self) -> Next {
        let mut clients = lock(&self.clients);
        loop {
            if std::mem::take(&mut clients.is_loaded) {
                return Next::Loaded;
            }
            let count = clients.all.len();
            for step in 0..count {
                let place = (clients.turn + step) % count;
                if let Some(request) = clients.all[place].next() {
                    clients.turn = place + 1;
                    let outbox = clients.all[place].outbox.clone();
                    return Next::Job(Job { outbox, request });
                }
            }
            clients = self.work.wait(clients).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Returns a waiting request of some client for an image of the first layer, without removing it from the queue.
    pub(crate) fn waiting_draw(&self) -> Option<Value> {
        lock(&self.clients).all.iter().find_map(|client| client.draws[0].clone())
    }

    /// Wakes the drawing thread because all points are loaded.
    pub(crate) fn report_loaded(&self) {
        lock(&self.clients).is_loaded = true;
        self.work.notify_all();
    }

    /// Sends a text to all clients.
    pub(crate) fn broadcast(&self, message: &Value) {
        let text = message.to_string();
        lock(&self.clients).all.iter().for_each(|client| client.outbox.push(Outgoing::Text(text.clone())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn other_requests_are_answered_between_images() {
        let hub = Hub::default();
        let (client, _) = hub.join().unwrap();
        let next = |wanted: &str| {
            let Next::Job(job) = hub.next() else { panic!("loaded") };
            assert_eq!(job.request["do"], wanted);
        };
        hub.ask(client, json!({ "do": "draw" }));
        next("draw");
        for _ in 0..2 {
            assert!(hub.ask(client, json!({ "do": "pick" })) && hub.ask(client, json!({ "do": "draw" })));
            next("pick");
            next("draw");
        }
    }

    #[test]
    fn newest_image_request_of_each_client_is_answered_in_turn() {
        let hub = Hub::default();
        let ((a, _), (b, _)) = (hub.join().unwrap(), hub.join().unwrap());
        for id in 0..9 {
            assert!(hub.ask(a, json!({ "do": "draw", "id": id })));
        }
        assert!(hub.ask(a, json!({ "do": "pick", "id": 20 })));
        assert!(hub.ask(b, json!({ "do": "draw", "id": 30, "layer": 1 })));
        let id = |next| match next {
            Next::Job(job) => job.request["id"].as_u64().unwrap(),
            other => panic!("{other:?}"),
        };
        let ids: Vec<u64> = (0..3).map(|_| id(hub.next())).collect();
        assert_eq!(ids, [8, 30, 20]);
        hub.leave(b);
        assert!(!hub.ask(b, json!({ "do": "draw" })));
        hub.report_loaded();
        assert!(matches!(hub.next(), Next::Loaded));
    }

    #[test]
    fn work_and_messages_of_a_client_are_bounded() {
        let hub = Hub::default();
        let (id, outbox) = hub.join().unwrap();
        assert_eq!((0..99).filter(|_| hub.ask(id, json!({ "do": "pick" }))).count(), MAX_TASKS);
        for step in 0..1000 {
            outbox.put_image(0, vec![step as u8; 4]);
        }
        assert!(matches!(outbox.next(), Some(Outgoing::Binary(image)) if image == [231; 4]));
        for _ in 0..=MAX_TEXTS {
            hub.broadcast(&json!({}));
        }
        assert!(outbox.next().is_none(), "a client that reads nothing is disconnected");
        let outbox = Outbox::default();
        for _ in 0..2 {
            outbox.push(Outgoing::Binary(vec![0; MAX_WAITING_BYTES / 2 + 1]));
        }
        assert!(outbox.next().is_none(), "a client that reads no saved images is disconnected");
        let joined = (0..99).filter(|_| hub.join().is_some()).count();
        assert_eq!(joined, MAX_CLIENTS - 1);
    }
}
