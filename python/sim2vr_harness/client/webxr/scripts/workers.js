// Workers: each is asked to bring its clock to the page's, and what it has sent by then is delivered
// when it is idle. `worker.js` is its half, which the harness puts in before its script.
{
  const KEY = '__sim2vr';
  const RealWorker = window.Worker;
  const workers = new Map(); // worker -> {events: to deliver, busy, wake}
  const { postMessage, terminate } = RealWorker.prototype;
  const forget = (worker) => {
    const state = workers.get(worker);
    workers.delete(worker);
    state?.wake?.();
  };
  const copyOf = (event) => (event.type === 'error'
    ? new ErrorEvent('error', {
      message: event.message, filename: event.filename, lineno: event.lineno, colno: event.colno,
      error: event.error, cancelable: true,
    })
    : new MessageEvent(event.type, { data: event.data, ports: [...event.ports] }));
  const take = (worker, event) => {
    if (!event.isTrusted || !workers.has(worker)) return;
    const state = workers.get(worker);
    const word = event.type === 'message' ? event.data?.[KEY] : undefined;
    if (event.type === 'error' && !(event instanceof ErrorEvent)) { // has no script
      forget(worker);
      return;
    }
    event.stopImmediatePropagation();
    if (word === 'idle') state.wake?.();
    else if (word === 'closed') forget(worker);
    else push(state.events, copyOf(event));
  };
  const VirtualWorker = function Worker(...args) {
    if (!new.target) throw new TypeError("Failed to construct 'Worker': please use the 'new' operator");
    const made = Reflect.construct(RealWorker, args, new.target);
    workers.set(made, { events: [], busy: true, wake: null });
    for (const type of ['message', 'messageerror', 'error']) {
      listen(made, type, (event) => take(made, event));
    }
    return made;
  };
  VirtualWorker.prototype = RealWorker.prototype;
  define(RealWorker.prototype, 'constructor', VirtualWorker);
  define(window, 'Worker', VirtualWorker);
  RealWorker.prototype.postMessage = function (...args) {
    Reflect.apply(postMessage, this, args);
    const state = workers.get(this);
    if (state) state.busy = true;
  };
  RealWorker.prototype.terminate = function () {
    forget(this);
    terminate.call(this);
  };

  // The time has moved, or a message went to one of them.
  sim.wakeWorkers = () => workers.forEach((state) => { state.busy = true; });
  // Waits until all are idle and delivers what they sent; returns whether there was anything to wait for.
  sim.workersDone = async () => {
    const busy = filter([...workers], ({ 1: state }) => state.busy);
    if (busy.length === 0) return false;
    await Promise.all(map(busy, ({ 0: worker, 1: state }) => new Promise((resolve) => {
      state.busy = false;
      state.wake = resolve;
      Reflect.apply(postMessage, worker, [{ [KEY]: sim.now() }]);
    })));
    await sim.turn();
    for (const { 0: worker, 1: state } of busy) {
      const { events } = state;
      state.events = [];
      forEach(events, (event) => sim.call(() => dispatch(worker, event)));
    }
    await sim.turn();
    return true;
  };
}
