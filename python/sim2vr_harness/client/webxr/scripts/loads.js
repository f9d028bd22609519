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
  // Loads are delivered in the order in which they began, whichever comes first. One that waits
  // for a later one (a stream that a page feeds) is passed by after a while.
  const PASSED_AFTER_MS = 1000;
  const queue = []; // {done, deliver}
  let delivering = false;
  const deliver = async () => {
    if (delivering) return;
    delivering = true;
    while (queue[0]?.done) {
      const { deliver: give } = shift(queue);
      give();
      await sim.turn();
      await sim.turn();
      end();
    }
    delivering = false;
  };
  const enqueue = () => {
    begin();
    const item = { done: false, deliver: null };
    push(queue, item);
    return item;
  };
  const finish = (item, give) => {
    Object.assign(item, { done: true, deliver: give });
    deliver();
    if (includes(queue, item)) {
      sim.inTruth(() => {
        const at = queue.indexOf(item);
        if (at > 0 && !queue[0].done) queue.unshift(...queue.splice(at, 1));
        deliver();
      }, PASSED_AFTER_MS);
    }
  };
  const track = (promise) => {
    if (!promise || typeof promise.then !== 'function') return promise;
    const item = enqueue();
    return new Promise((resolve, reject) => {
      promise.then((value) => finish(item, () => resolve(value)), (error) => finish(item, () => reject(error)));
    });
  };
  // Waits for something that has no result.
  const awaited = (promise) => {
    begin();
    promise.then(end, end);
  };
  const nothingPending = async () => {
    while (pending > 0) {
      await new Promise((resolve) => push(waiting, resolve));
      await sim.turn();
      await sim.turn();
    }
  };
  // Resolves when nothing is under way any more; what came may begin further loads. A page and a
  // worker that answer each other for ever get on by one answer.
  sim.loaded = async () => {
    await nothingPending();
    if (await sim.workersDone?.()) await nothingPending();
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
  // Parts of a stream are delivered as they come: the body that a page makes of them waits for them.
  const { read } = ReadableStreamDefaultReader.prototype;
  ReadableStreamDefaultReader.prototype.read = function () {
    const part = read.call(this);
    awaited(part);
    return part;
  };
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
  wrap(window.RTCPeerConnection?.prototype, 'createOffer', 'createAnswer', 'setLocalDescription', 'setRemoteDescription', 'addIceCandidate');
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
  // Requests: their events are held back until those of earlier loads have been sent.
  const requests = new WeakMap(); // request -> {item, events}
  const heard = ['readystatechange', 'progress', 'load', 'error', 'abort', 'timeout', 'loadend'];
  const hold = (request, event) => {
    const state = requests.get(request);
    if (!event.isTrusted || !state) return;
    event.stopImmediatePropagation();
    if (event.type !== 'readystatechange') {
      push(state.events, new ProgressEvent(event.type, event));
    } else if (request.readyState === 4) push(state.events, new Event('readystatechange'));
    if (event.type !== 'loadend') return;
    requests.delete(request);
    finish(state.item, () => forEach(state.events,
      (copy) => sim.call(() => dispatch(request, copy))));
  };
  define(window, 'XMLHttpRequest', new Proxy(XMLHttpRequest, {
    construct: (...call) => {
      const request = Reflect.construct(...call);
      for (const type of heard) listen(request, type, (event) => hold(request, event));
      return request;
    },
  }));
  const forget = (request) => { // it ends without an event
    const state = requests.get(request);
    if (state) finish(state.item, () => {});
    requests.delete(request);
  };
  const { open, send } = XMLHttpRequest.prototype;
  const waits = new WeakSet(); // requests that answer at once
  XMLHttpRequest.prototype.open = function (...args) {
    if (args.length > 2 && !args[2]) waits.add(this);
    else waits.delete(this);
    forget(this);
    return Reflect.apply(open, this, args);
  };
  XMLHttpRequest.prototype.send = function (...args) {
    if (!waits.has(this)) requests.set(this, { item: enqueue(), events: [] });
    try {
      return Reflect.apply(send, this, args);
    } catch (error) {
      forget(this);
      throw error;
    }
  };
  for (const name of ['readAsArrayBuffer', 'readAsText', 'readAsDataURL', 'readAsBinaryString']) {
    const real = FileReader.prototype[name];
    FileReader.prototype[name] = function (...args) {
      until(this, ['loadend']);
      return Reflect.apply(real, this, args);
    };
  }
  Object.assign(sim, { track, until, enqueue, finish, awaited });
}
