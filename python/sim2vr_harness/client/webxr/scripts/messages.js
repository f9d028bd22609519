// Messages that a page sends to itself, and tasks of its scheduler, in virtual time: each takes as
// long as the harness says, whatever the processor does besides.
{
  const MESSAGE_MS = 0.2;
  const MOST_TURNS = 50; // that an open port's message may take
  const opened = new WeakMap(); // port of a channel -> {open: whether it delivers, count: received}
  const peers = new WeakMap();
  const counting = (target, counts) => {
    const received = { open: false, count: 0 };
    listen(target, 'message', (event) => {
      if (counts(event)) received.count += 1;
    }, true);
    return received;
  };
  // Sends later, and lets no time pass before the message has been received.
  const sendLater = (send, received) => sim.later(() => {
    const before = received?.count;
    send();
    if (!received?.open) {
      sim.wakeWorkers(); // one of them may have the port
      return;
    }
    sim.awaited((async () => {
      for (let k = 0; k < MOST_TURNS && received.count === before; k++) await sim.turn();
    })());
  }, MESSAGE_MS);
  const listOf = (options) => (Array.isArray(options) ? options : options?.transfer) ?? [];

  const RealChannel = MessageChannel;
  const VirtualChannel = function () {
    if (!new.target) throw new TypeError('MessageChannel needs new');
    const made = new RealChannel();
    for (const [port, peer] of [[made.port1, made.port2], [made.port2, made.port1]]) {
      opened.set(port, counting(port, () => true));
      peers.set(port, peer);
    }
    return made;
  };
  VirtualChannel.prototype = RealChannel.prototype;
  RealChannel.prototype.constructor = VirtualChannel;
  define(window, 'MessageChannel', VirtualChannel);

  const ports = MessagePort.prototype;
  const { postMessage, start, close } = ports;
  const handler = Object.getOwnPropertyDescriptor(ports, 'onmessage');
  const openIf = (port, is) => {
    const received = opened.get(port);
    if (received) received.open = is;
  };
  ports.start = function () {
    openIf(this, true);
    start.call(this);
  };
  ports.close = function () {
    openIf(this, false);
    openIf(peers.get(this), false);
    close.call(this);
  };
  Object.defineProperty(ports, 'onmessage', {
    ...handler,
    set(value) {
      openIf(this, true);
      handler.set.call(this, value);
    },
  });
  ports.postMessage = function (message, options) {
    const peer = peers.get(this);
    if (!peer || listOf(options).length) {
      postMessage.call(this, message, options);
      return;
    }
    const data = structuredClone(message);
    sendLater(() => postMessage.call(this, data), opened.get(peer));
  };

  const toWindow = window.postMessage;
  const self = counting(window, ({ source }) => source === window);
  self.open = true;
  window.postMessage = function (message, ...rest) {
    // A frame within may be the sender; its messages keep their source.
    if (window.length || listOf(rest[1] ?? rest[0]).length) {
      toWindow.call(window, message, ...rest);
      return;
    }
    const data = structuredClone(message);
    sendLater(() => toWindow.call(window, data, ...rest), self);
  };

  if (window.Scheduler) {
    Scheduler.prototype.postTask = (callback, { delay = 0, signal } = {}) => new Promise((resolve, reject) => {
      signal?.throwIfAborted();
      signal?.addEventListener('abort', () => reject(signal.reason));
      sim.later(() => {
        if (!signal?.aborted) new Promise((done) => done(callback())).then(resolve, reject);
      }, Math.max(MESSAGE_MS, Number(delay) || 0));
    });
    Scheduler.prototype.yield = () => new Promise((resolve) => sim.later(resolve, MESSAGE_MS));
  }
}
