// Virtual time: nothing that the scripts of a page or worker read moves unless a step moves it.
// Covers performance.now, Date, timers, requestAnimationFrame, requestIdleCallback, the time stamps
// of events and the document's timeline. Not covered: video (docs/reference/webxr.md).
{
  const EPOCH_MS = Date.UTC(2024, 0, 1);
  const RealDate = Date;
  const channel = new MessageChannel();
  const waiting = [];
  channel.port1.onmessage = () => shift(waiting)();

  // A worker that has not begun has neither of these; its class has them as soon as it begins.
  const inherited = (name, own = window[name]) => (...given) =>
    Reflect.apply(own ?? window.WorkerGlobalScope.prototype[name], window, given);
  sim.inTruth = inherited('setTimeout');
  const report = inherited('reportError');

  let now = 0; // ms since the document began
  // A script that waits until a clock has moved on would never end: after many reads in one turn,
  // the clock moves on by a fixed step per read.
  const MOST_READS = 100000;
  const READ_STEP_MS = 0.01;
  let reads = 0; // of this turn
  const readClock = () => {
    if (++reads > MOST_READS) now += READ_STEP_MS;
    return now;
  };
  let lastId = 0;
  const timers = new Map(); // id -> {due, callback, args, every}
  let frames = new Map(); // id -> callback of requestAnimationFrame

  // Lets everything run that is due by now in truth: promises' reactions, events of loads.
  sim.turn = () => new Promise((resolve) => {
    reads = 0;
    push(waiting, resolve);
    post(channel.port2, 0);
  });
  sim.now = () => now;
  const call = (callback, args) => {
    reads = 0;
    try {
      Reflect.apply(callback, undefined, args);
    } catch (error) {
      report(error); // as the browser would: the page's own handlers, then the harness
    }
  };
  sim.call = (callback, ...args) => call(callback, args);

  // Runs a function after some virtual time, ms; less than a page's timers can wait.
  sim.later = (callback, wait) => {
    timers.set(++lastId, { due: now + wait, callback, args: [], every: 0 });
  };
  const addTimer = (callback, delay, args, repeats) => {
    const wait = Math.max(1, Number(delay) || 0);
    const run = typeof callback === 'function' ? callback : new Function(String(callback));
    const id = ++lastId;
    timers.set(id, { due: now + wait, callback: run, args, every: repeats ? wait : 0 });
    return id;
  };
  const next = (until) => {
    let found = 0;
    let due = until;
    timers.forEach((timer, id) => {
      if (timer.due < due || (timer.due === due && (found === 0 || id < found))) {
        found = id;
        due = timer.due;
      }
    });
    return found;
  };
  // Runs timers in the order in which they are due, up to a time, ms.
  sim.runTimers = async (until) => {
    for (let id = next(until); id !== 0; id = next(until)) {
      const timer = timers.get(id);
      now = Math.max(now, timer.due);
      if (timer.every) timer.due += timer.every;
      else timers.delete(id);
      call(timer.callback, timer.args);
      await sim.turn();
      await sim.loaded();
    }
    now = Math.max(now, until);
  };
  sim.runFrames = () => {
    const due = frames;
    frames = new Map();
    due.forEach((callback) => call(callback, [now]));
  };

  define(window, 'setTimeout', (callback, delay, ...args) => addTimer(callback, delay, args, false));
  define(window, 'setInterval', (callback, delay, ...args) => addTimer(callback, delay, args, true));
  define(window, 'clearTimeout', (id) => void timers.delete(id));
  define(window, 'clearInterval', (id) => void timers.delete(id));
  define(window, 'requestAnimationFrame', (callback) => {
    frames.set(++lastId, callback);
    return lastId;
  });
  define(window, 'cancelAnimationFrame', (id) => void frames.delete(id));
  if (window.requestIdleCallback) {
    define(window, 'requestIdleCallback', (callback) =>
      addTimer(() => callback({ didTimeout: false, timeRemaining: () => 10 }), 1, [], false));
    define(window, 'cancelIdleCallback', (id) => void timers.delete(id));
  }

  define(Performance.prototype, 'now', readClock);
  Object.defineProperty(Performance.prototype, 'timeOrigin', { get: () => EPOCH_MS });
  Object.defineProperty(Event.prototype, 'timeStamp', { get: readClock });
  if (window.AnimationTimeline) Object.defineProperty(AnimationTimeline.prototype, 'currentTime', { get: readClock });
  const VirtualDate = function (...args) {
    if (!new.target) return new RealDate(EPOCH_MS + readClock()).toString();
    return Reflect.construct(RealDate, args.length ? args : [EPOCH_MS + readClock()], new.target);
  };
  Object.setPrototypeOf(VirtualDate, RealDate);
  VirtualDate.prototype = RealDate.prototype;
  define(VirtualDate, 'now', () => Math.floor(EPOCH_MS + readClock()));
  define(RealDate.prototype, 'constructor', VirtualDate);
  define(window, 'Date', VirtualDate);
}
