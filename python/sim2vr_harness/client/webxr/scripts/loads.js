// Loads that a page or worker began and that have not come yet: no frame runs before they have.
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
  // Resolves when nothing is under way any more; what came may begin further loads.
  sim.loaded = async () => {
    do {
      while (pending > 0) {
        await new Promise((resolve) => push(waiting, resolve));
        await sim.turn();
        await sim.turn();
      }
    } while (await sim.workersDone?.());
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
  wrap(WebAssembly, 'compile', 'instantiate', 'compileStreaming', 'instantiateStreaming');
  wrap(window.FontFace?.prototype, 'load');
  wrap(Object.getPrototypeOf((window.document ?? window).fonts), 'load');
  wrap(window.BaseAudioContext?.prototype, 'decodeAudioData');
  wrap(window.OfflineAudioContext?.prototype, 'startRendering');
  wrap(window.SubtleCrypto?.prototype, 'digest', 'encrypt', 'decrypt', 'importKey');
  wrap(window.OffscreenCanvas?.prototype, 'convertToBlob');
  // What the browser's other processes answer.
  wrap(window.CacheStorage?.prototype, 'open', 'match', 'has', 'keys', 'delete');
  wrap(window.Cache?.prototype, 'match', 'matchAll', 'add', 'addAll', 'put', 'delete', 'keys');
  wrap(window.StorageManager?.prototype, 'estimate', 'persist', 'persisted');
  wrap(window.Permissions?.prototype, 'query');
  wrap(window.BaseAudioContext && AudioContext.prototype, 'resume', 'suspend', 'close');
  wrap(window.MediaDevices?.prototype, 'enumerateDevices', 'getUserMedia');
  wrap(window.GPU?.prototype, 'requestAdapter');
  wrap(window.Navigator?.prototype, 'getBattery');

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
  Object.assign(sim, { track, until, begin, end });
}
