// Loads by elements of the document: images, scripts, style sheets, canvases that become files.
{
  const { enqueue, finish, track, until } = sim;
  const decode = HTMLImageElement.prototype.decode;
  HTMLImageElement.prototype.decode = function () { return track(decode.call(this)); };
  const fontSet = Object.getPrototypeOf(document.fonts);
  const ready = Object.getOwnPropertyDescriptor(fontSet, 'ready');
  Object.defineProperty(fontSet, 'ready', {
    ...ready,
    get() { return ready.get.call(this).then((fonts) => new Promise((resolve) => sim.later(() => resolve(fonts), 0))); },
  });
  const toBlob = HTMLCanvasElement.prototype.toBlob;
  HTMLCanvasElement.prototype.toBlob = function (callback, ...args) {
    const item = enqueue();
    return toBlob.call(this, (blob) => finish(item, () => sim.call(callback, blob)), ...args);
  };

  // Images: their events are held back until those of earlier loads have been sent.
  const proto = HTMLImageElement.prototype;
  const items = new WeakMap(); // image that loads -> its place in the queue
  const gated = new WeakSet();
  const release = (image, give) => {
    const item = items.get(image);
    items.delete(image);
    if (item) finish(item, give);
  };
  const gate = (image) => {
    if (gated.has(image)) return;
    gated.add(image);
    for (const type of ['load', 'error']) {
      listen(image, type, (event) => {
        if (!event.isTrusted || !items.has(image)) return;
        event.stopImmediatePropagation();
        release(image, () => dispatch(image, new Event(type)));
      });
    }
  };
  const load = (image, value) => {
    gate(image);
    release(image, () => {}); // what it was to load before
    if (String(value)) items.set(image, enqueue());
  };
  proto.addEventListener = function (type, ...rest) {
    if (type === 'load' || type === 'error') gate(this);
    return EventTarget.prototype.addEventListener.call(this, type, ...rest);
  };
  for (const name of ['onload', 'onerror']) {
    const handler = Object.getOwnPropertyDescriptor(HTMLElement.prototype, name);
    Object.defineProperty(proto, name, {
      ...handler,
      set(value) {
        gate(this);
        handler.set.call(this, value);
      },
    });
  }
  const source = Object.getOwnPropertyDescriptor(proto, 'src');
  Object.defineProperty(proto, 'src', {
    ...source,
    set(value) {
      load(this, value);
      source.set.call(this, value);
    },
  });
  const setAttribute = proto.setAttribute;
  proto.setAttribute = function (name, value) {
    if (String(name).toLowerCase() === 'src') load(this, value);
    return setAttribute.call(this, name, value);
  };
  const begun = new WeakSet(); // a script runs once, however often it is moved
  const asks = (node) => {
    const scripts = node instanceof HTMLScriptElement && node.src;
    const styles = node instanceof HTMLLinkElement && node.href && node.rel === 'stylesheet';
    if (!(scripts || styles) || node.isConnected || begun.has(node)) return false;
    begun.add(node);
    return true;
  };
  const watchAdding = (object, ...names) => {
    for (const name of names) {
      const real = object[name];
      object[name] = function (...nodes) {
        if (this.isConnected) {
          for (const node of nodes) if (asks(node)) until(node, ['load', 'error']);
        }
        return Reflect.apply(real, this, nodes);
      };
    }
  };
  watchAdding(Node.prototype, 'appendChild', 'insertBefore');
  watchAdding(Element.prototype, 'append', 'prepend', 'before', 'after');
}
