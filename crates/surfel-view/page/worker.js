// Draws by WebAssembly on a thread of its own, so that the exported page stays responsive. The page loads this script
// behind module.js.

let surfel = null; // the module, once it is loaded
const draws = [null, null]; // newest request for an image of each layer
const tasks = [];           // other requests
const { port1: wake, port2: woken } = new MessageChannel();

/** Loads a module or a file, from its gzip-compressed base64 text or from its URL. Returns its bytes. */
async function load(place) {
  if (!place.url) return unpack(place);
  const answer = await fetch(place.url);
  if (!answer.ok) throw new Error(`${place.url}: the server answers ${answer.status}.`);
  return answer.arrayBuffer();
}

/** Returns a function that reads parts of a file by HTTP ranges. It waits for each part, as a worker may. */
function rangesOf(url) {
  return (at, count) => {
    const request = new XMLHttpRequest();
    request.open('GET', url, false);
    request.responseType = 'arraybuffer';
    request.setRequestHeader('Range', `bytes=${at}-${at + count - 1}`);
    request.send();
    if (request.status === 200) throw new Error('The server answers no ranges.');
    if (request.status !== 206 || request.response.byteLength !== count) throw new Error(`Status ${request.status}.`);
    return new Uint8Array(request.response);
  };
}

/** Unpacks a gzip file that is written in base64. */
async function unpack(text) {
  const packed = await fetch(`data:application/gzip;base64,${text}`);
  return new Response(packed.body.pipeThrough(new DecompressionStream('gzip'))).arrayBuffer();
}

function tell(header) {
  postMessage({ header });
}

/** Loads the module and the page's own file. */
async function begin({ modules, file, name, flags, ranged }) {
  tell({ do: 'progress', stage: 'loading the drawing module', part: null });
  const isFast = isFused();
  surfel = new SurfelModule(await WebAssembly.compile(await load(isFast ? modules.fused : modules.emulated)));
  if (ranged) {
    const readFile = rangesOf(file.url);
    readFile(0, 1); // a server without ranges has its own message
    return tell({ ...surfel.openHost(readFile, ranged, name, flags), isOther: false });
  }
  tell({ do: 'progress', stage: 'unpacking', part: null });
  open(new Uint8Array(await load(file)), name, flags, false);
}

function open(bytes, name, flags, isOther) {
  tell({ do: 'progress', stage: `reading ${name}`, part: null });
  draws.fill(null);
  tell({ ...surfel.open(bytes, name, flags), isOther });
}

/** Answers the next request. The message at the end lets newer requests arrive before the next answer. */
woken.onmessage = () => {
  const request = draws.find((draw) => draw) ?? tasks.shift();
  if (!request) return;
  if (request.do === 'draw') draws[request.layer ?? 0] = null;
  const start = performance.now();
  let answer;
  try {
    answer = surfel.answer(request);
  } catch (error) {
    // After a failure, such as a lack of memory, the module can't answer further requests.
    tell({ do: 'error', id: request.id, layer: request.layer, of: request.do, message: `The drawing module failed (${error.message}). Open the page again.` });
    return;
  }
  const ms = performance.now() - start;
  if (answer instanceof Uint8Array) postMessage({ bytes: answer, ms }, [answer.buffer]); else tell(answer);
  wake.postMessage(0);
};

onmessage = async ({ data }) => {
  try {
    if (data.modules) return await begin(data);
    if (!surfel) return;
    if (data.bytes) return open(data.bytes, data.name, [], true);
  } catch (error) {
    return tell({ do: 'error', message: error.message });
  }
  if (data.do === 'draw') draws[data.layer ?? 0] = data; else tasks.push(data);
  wake.postMessage(0);
};
