// Loads that a page began and that have not come yet: no frame runs before they have.
// Otherwise what a frame shows would depend on how fast a file is read.
{
  let pending = 0;
  let waiting = [];
  const begin = () => { pending += 1; };
  const end = () => {
    pending -= 1;
    if (pending > 0) return;
    const woken = waiting;
    waiting = [];
    forEach(woken, (wake) => wake());
  };
  const track = (promise) => {
    if (!promise || typeof promise.then !== 'function') return promise;
    begin();
    promise.then(end, end);
    return promise;
  };
  sim.track = track;
  // Resolves when nothing is under way any more; what came may begin further loads.
  sim.loaded = async () => {
    while (pending > 0) {
      await new Promise((resolve) => push(waiting, resolve));
      await sim.turn();
      await sim.turn();
    }
  };

  const wrap = (object, ...names) => {
    for (const name of names) {
      const real = object?.[name];
      if (typeof real !== 'function') continue;
      object[name] = function (...args) { return track(Reflect.apply(real, this, args)); };
    }
  };
  wrap(window, 'fetch', 'createImageBitmap');
  wrap(Response.prototype, 'json', 'text', 'arrayBuffer', 'blob', 'bytes', 'formData');
  wrap(Blob.prototype, 'text', 'arrayBuffer', 'bytes');
  wrap(ReadableStreamDefaultReader.prototype, 'read');
  wrap(HTMLImageElement.prototype, 'decode');
  wrap(WebAssembly, 'compile', 'instantiate', 'compileStreaming', 'instantiateStreaming');
  wrap(window.FontFace?.prototype, 'load');
  wrap(Object.getPrototypeOf(document.fonts), 'load');
  wrap(window.BaseAudioContext?.prototype, 'decodeAudioData');
  wrap(window.OfflineAudioContext?.prototype, 'startRendering');
  wrap(window.SubtleCrypto?.prototype, 'digest', 'encrypt', 'decrypt', 'importKey');
  wrap(window.OffscreenCanvas?.prototype, 'convertToBlob');
  // What the browser's other processes answer.
  wrap(window.CacheStorage?.prototype, 'open', 'match', 'has', 'keys', 'delete');
  wrap(window.Cache?.prototype, 'match', 'matchAll', 'add', 'addAll', 'put', 'delete', 'keys');
  wrap(window.StorageManager?.prototype, 'estimate', 'persist', 'persisted');
  wrap(window.Permissions?.prototype, 'query');
  wrap(window.MediaDevices?.prototype, 'enumerateDevices', 'getUserMedia');
  wrap(window.GPU?.prototype, 'requestAdapter');
  wrap(Navigator.prototype, 'getBattery');

  // An element or request that says by events that it is done.
  const busy = new WeakSet();
  const until = (target, events) => {
    if (busy.has(target)) return;
    busy.add(target);
    begin();
    const done = () => {
      for (const name of events) target.removeEventListener(name, done);
      busy.delete(target);
      end();
    };
    for (const name of events) target.addEventListener(name, done);
  };
  const wrapTarget = (object, events, ...names) => {
    for (const name of names) {
      const real = object[name];
      object[name] = function (...args) {
        const target = Reflect.apply(real, this, args);
        until(target, events);
        return target;
      };
    }
  };
  wrapTarget(IDBFactory.prototype, ['success', 'error', 'blocked'], 'open', 'deleteDatabase');
  wrapTarget(IDBDatabase.prototype, ['complete', 'abort'], 'transaction'); // and all that is in it
  const toBlob = HTMLCanvasElement.prototype.toBlob;
  HTMLCanvasElement.prototype.toBlob = function (callback, ...args) {
    begin();
    return toBlob.call(this, (blob) => {
      sim.call(callback, blob);
      end();
    }, ...args);
  };
  const send = XMLHttpRequest.prototype.send;
  XMLHttpRequest.prototype.send = function (...args) {
    until(this, ['loadend']);
    return Reflect.apply(send, this, args);
  };
  for (const name of ['readAsArrayBuffer', 'readAsText', 'readAsDataURL', 'readAsBinaryString']) {
    const real = FileReader.prototype[name];
    FileReader.prototype[name] = function (...args) {
      until(this, ['loadend']);
      return Reflect.apply(real, this, args);
    };
  }
  const source = Object.getOwnPropertyDescriptor(HTMLImageElement.prototype, 'src');
  Object.defineProperty(HTMLImageElement.prototype, 'src', {
    ...source,
    set(value) {
      if (String(value)) until(this, ['load', 'error']);
      source.set.call(this, value);
    },
  });
  const setAttribute = HTMLImageElement.prototype.setAttribute;
  HTMLImageElement.prototype.setAttribute = function (name, value) {
    if (String(name).toLowerCase() === 'src' && String(value)) until(this, ['load', 'error']);
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
