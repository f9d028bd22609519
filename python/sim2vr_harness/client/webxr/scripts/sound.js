// Sound in virtual time: the clocks of audio contexts, and when their sources end. Nobody hears it.
if (window.AudioContext) {
  const clocks = new WeakMap(); // context -> {at: ms when it ran last, before: seconds until then}
  const base = BaseAudioContext.prototype;
  const real = Object.getOwnPropertyDescriptor(base, 'currentTime');
  const clockOf = (context) => {
    if (!clocks.has(context)) clocks.set(context, { at: sim.now(), before: 0, runs: true });
    return clocks.get(context);
  };
  const timeOf = (context) => {
    const { at, before, runs } = clockOf(context);
    return before + (runs ? (sim.now() - at) / 1000 : 0);
  };
  const run = (context, runs) => clocks.set(context, { before: timeOf(context), at: sim.now(), runs });
  for (const name of ['AudioContext', 'webkitAudioContext']) {
    if (!window[name]) continue;
    const made = new Proxy(window[name], {
      construct: (...call) => {
        const context = Reflect.construct(...call);
        clockOf(context);
        return context;
      },
    });
    define(window, name, made);
  }
  Object.defineProperty(base, 'currentTime', {
    ...real,
    get() { return this instanceof AudioContext ? timeOf(this) : real.get.call(this); },
  });
  const proto = AudioContext.prototype;
  for (const [name, runs] of [['resume', true], ['suspend', false], ['close', false]]) {
    const original = proto[name];
    proto[name] = function () {
      run(this, runs);
      return original.call(this);
    };
  }
  proto.getOutputTimestamp = function () { return { contextTime: timeOf(this), performanceTime: sim.now() }; };

  // Sources: their own `ended` comes by the wall clock and is not passed on.
  const sources = new WeakMap(); // source -> {from, until: seconds of its context}
  const ends = (source) => {
    const state = sources.get(source);
    const wait = (state.until - timeOf(source.context)) * 1000;
    if (!Number.isFinite(wait)) return;
    const { until } = state;
    sim.later(() => {
      if (state.over || state.until !== until) return;
      state.over = true;
      sim.call(() => dispatch(source, new Event('ended')));
    }, Math.max(0, wait));
  };
  const wrap = (kind, lasting) => {
    const { start, stop } = kind.prototype;
    kind.prototype.start = function (...args) {
      Reflect.apply(start, this, args);
      if (!(this.context instanceof AudioContext) || sources.has(this)) return;
      const from = Math.max(timeOf(this.context), Number(args[0]) || 0);
      sources.set(this, { until: from + lasting(this, args), over: false });
      ends(this);
    };
    kind.prototype.stop = function (...args) {
      Reflect.apply(stop, this, args);
      const state = sources.get(this);
      if (!state) return;
      state.until = Math.min(state.until, Math.max(timeOf(this.context), Number(args[0]) || 0));
      ends(this);
    };
  };
  wrap(AudioBufferSourceNode, (source, args) => {
    if (source.loop || !source.buffer) return source.buffer ? Infinity : 0;
    const whole = source.buffer.duration - (Number(args[1]) || 0);
    return Math.min(whole, args[2] === undefined ? whole : Number(args[2])) / (source.playbackRate.value || 1);
  });
  wrap(OscillatorNode, () => Infinity);
  wrap(ConstantSourceNode, () => Infinity);
  const made = (original) => function (...args) {
    const source = Reflect.apply(original, this, args);
    listen(source, 'ended', (event) => {
      if (event.isTrusted && sources.has(source)) event.stopImmediatePropagation();
    });
    return source;
  };
  for (const name of ['createBufferSource', 'createOscillator', 'createConstantSource']) base[name] = made(base[name]);
}
