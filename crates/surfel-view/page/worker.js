// Draws by WebAssembly on a thread of its own, so that the exported page stays responsive. Follows module.js.

let surfel = null; // the module, once it is loaded
const draws = [null, null]; // newest request for an image of each layer
const tasks = [];           // other requests
const { port1: wake, port2: woken } = new MessageChannel();

/** Unpacks a gzip file that is written in base64. */
async function unpack(text) {
  const packed = await fetch(`data:application/gzip;base64,${text}`);
  return new Response(packed.body.pipeThrough(new DecompressionStream('gzip'))).arrayBuffer();
}

function tell(header) {
  postMessage({ header });
}

/** Loads the module and the page's own file. */
async function begin({ modules, file, name, flags }) {
  tell({ do: 'progress', stage: 'loading the drawing module', part: null });
  const isFast = isFused();
  surfel = new SurfelModule(await WebAssembly.compile(await unpack(isFast ? modules.fused : modules.emulated)));
  tell({ do: 'progress', stage: 'unpacking', part: null });
  open(new Uint8Array(await unpack(file)), name, flags, false);
}

function open(bytes, name, flags, isOther) {
  tell({ do: 'progress', stage: `reading ${name}`, part: null });
  draws.fill(null);
  tell({ ...surfel.open(bytes, name, flags), isOther });
}

/** Answers the next request, then lets newer ones come in. */
woken.onmessage = () => {
  const request = draws.find((draw) => draw) ?? tasks.shift();
  if (!request) return;
  if (request.do === 'draw') draws[request.layer ?? 0] = null;
  const start = performance.now();
  let answer;
  try {
    answer = surfel.answer(request);
  } catch (error) {
    // A module that has run out of memory can't go on.
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
