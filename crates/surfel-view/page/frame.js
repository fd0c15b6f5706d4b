// Source of images of the page in a notebook's frame: the window around it, which passes messages on to the kernel.
'use strict';

window.surfelSource = {
  start({ receive, unpacked }) {
    addEventListener('message', ({ data, source }) => {
      if (source !== parent || !data?.surfel) return;
      if (data.file) receive(...unpacked(new Uint8Array(data.file))); else receive(data.surfel, null);
    });
    parent.postMessage({ surfel: { do: 'begin' } }, '*');
  },

  send(message) {
    parent.postMessage({ surfel: message }, '*');
    return true;
  },
};
