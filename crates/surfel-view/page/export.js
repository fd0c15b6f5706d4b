// Source of images of an exported page: a WebAssembly module that draws in a worker, and the file that was exported.
// Both are in the page, or beside it.
'use strict';

window.surfelSource = {
  worker: null,

  start({ receive, unpacked, lose, say }) {
    const text = (id) => document.getElementById(id).textContent;
    const script = new Blob([text('module.js'), text('worker.js')], { type: 'text/javascript' });
    this.worker = new Worker(URL.createObjectURL(script));
    this.worker.onmessage = ({ data: { header, bytes, ms } }) => {
      if (!bytes) return receive(header, null);
      const [answer, file] = unpacked(bytes);
      // The module has no clock.
      if ('ms' in answer) [answer.ms, answer.frame_ms] = [ms, ms];
      receive(answer, file);
    };
    this.worker.onerror = (event) => {
      lose('The drawing module failed.');
      say(`The drawing module failed: ${event.message}`, true);
    };
    say('Loading…');
    const { name, flags, beside, ranged } = JSON.parse(text('exported'));
    if (beside && location.protocol === 'file:') {
      return say('This page reads files beside it, which browsers allow from a web server only.', true);
    }
    // The worker can't resolve relative addresses, so it gets absolute ones.
    const address = (file) => ({ url: new URL(encodeURIComponent(file), document.baseURI).href });
    const take = beside ? address : text;
    const modules = { fused: take('fused.wasm'), emulated: take('emulated.wasm') };
    this.worker.postMessage({ modules, file: beside ? address(beside) : text('file'), name, flags, ranged });
    // The worker has the text of these elements, so they are removed from the page.
    if (!beside) for (const id of ['fused.wasm', 'emulated.wasm', 'file']) document.getElementById(id).remove();
    this.takeFiles(say);
  },

  send(message) {
    this.worker.postMessage(message);
    return true;
  },

  /** Opens a file that is dropped onto the page. */
  takeFiles(say) {
    addEventListener('dragover', (event) => event.preventDefault());
    addEventListener('drop', async (event) => {
      event.preventDefault();
      const [file, ...more] = event.dataTransfer.files;
      if (!file) return;
      if (more.length) return say('Drop one file at a time.', true);
      say(`Reading ${file.name}…`);
      const bytes = new Uint8Array(await file.arrayBuffer());
      this.worker.postMessage({ bytes, name: file.name }, [bytes.buffer]);
    });
  },
};
