// The page of `surfel view` in a notebook: a frame, whose messages go to the kernel through the widget's own channel.
export default {
  render({ model, el }) {
    const frame = document.createElement('iframe');
    frame.title = 'Scene';
    frame.style.cssText = `width: 100%; height: ${model.get('height')}px; border: 0`;
    const fromFrame = ({ data, source }) => {
      if (source === frame.contentWindow && data?.surfel) model.send(data.surfel);
    };
    const fromKernel = (message, buffers) => {
      const [buffer] = buffers ?? [];
      // A copy: the view may be a part of the channel's own buffer.
      const file = buffer && new Uint8Array(buffer.buffer, buffer.byteOffset, buffer.byteLength).slice().buffer;
      frame.contentWindow?.postMessage({ surfel: message, file }, '*', file ? [file] : []);
    };
    window.addEventListener('message', fromFrame);
    model.on('msg:custom', fromKernel);
    frame.srcdoc = model.get('_page');
    el.append(frame);
    return () => {
      window.removeEventListener('message', fromFrame);
      model.off('msg:custom', fromKernel);
    };
  },
};
