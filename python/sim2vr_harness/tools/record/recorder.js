// Records what the devices of a WebXR session report, in lines of a session file
// (docs/reference/sessions.md): sent to the recording server, or downloaded at the end.
{
  const { settings } = sim;
  const BATCH_MS = 1000;
  const RETRY_MS = 500;
  const ANSWER_MS = 30000;
  const KEPT_ALIVE_BYTES = 60000; // that a browser sends for a page that has gone
  const WATCH_MS = 100;
  const MOST_FLAT_FRAMES = 20000; // before VR, five minutes at 60 Hz
  const JOINTS = 25;
  const { fetch, setTimeout, setInterval, performance, console, AbortSignal } = window;
  const later = setTimeout.bind(window);
  const wrapped = new WeakSet();
  const set = (object, name, value) =>
    Object.defineProperty(object, name, { value, configurable: true, writable: true });
  const complain = (error) => console.error('sim2vr recorder:', error);

  // WebXR's frame in the app's: z forward, left-handed.
  const pose = ({ transform: { position: p, orientation: q } }) => [p.x, p.y, -p.z, -q.x, -q.y, q.z, q.w];
  const within = (low, value) => Math.min(1, Math.max(low, value || 0));

  // The columns of a row of inputs, as client/devices.py has them.
  const inputs = ({ gamepad }, pinched) => {
    const value = (k) => within(0, gamepad?.buttons[k]?.value);
    const touch = (k) => Number(gamepad?.buttons[k]?.touched || 0);
    return [
      gamepad ? value(0) : Number(pinched), value(1), within(-1, gamepad?.axes[2]), -within(-1, gamepad?.axes[3]),
      value(3), value(4), value(5), 0, touch(0), touch(3), touch(4), touch(5), touch(6),
    ];
  };
  const joints = (frame, { hand }, space) => {
    const rows = [];
    for (const joint of hand?.values() ?? []) {
      const found = frame.getJointPose?.(joint, space);
      if (!found) return null;
      rows.push(...pose(found), found.radius ?? 0);
    }
    return rows.length === 8 * JOINTS ? rows : null;
  };
  const headset = (session) => navigator.userAgent.match(/(Quest|Pico|Vive|VisionPro)[\w ]*/i)?.[0].trim()
    ?? [...session.inputSources][0]?.profiles[0] ?? '';

  // Sends lines in parts, in order, and keeps each until the server has acknowledged it.
  const sender = () => {
    const kept = [];
    let part = 0;
    let sending = false;
    const post = ({ url, body }, options) =>
      fetch(url, { method: 'POST', body, ...options }).catch(() => null);
    const drain = async () => {
      if (sending) return;
      sending = true;
      for (let failed = false; kept.length;) {
        const answer = await post(kept[0], { signal: AbortSignal.timeout(ANSWER_MS) });
        const again = !answer || answer.status >= 500 || [408, 429].includes(answer.status);
        if (again && !failed) complain(answer ? await answer.text() : 'the recording server does not answer');
        failed = again;
        if (again) {
          await new Promise((resolve) => later(resolve, RETRY_MS));
          continue;
        }
        if (!answer.ok) complain(await answer.text());
        kept.shift();
      }
      sending = false;
    };
    return (body, last) => {
      kept.push({ url: `${settings.url}&part=${part++}&last=${Number(last)}`, body });
      // The page may be going: what a browser still sends then goes at once, twice if it must.
      let room = last ? KEPT_ALIVE_BYTES : 0;
      for (const each of kept) if ((room -= each.body.length) >= 0) post(each, { keepalive: true });
      drain();
    };
  };
  // Keeps lines and downloads them with the last one.
  const keeper = () => {
    const kept = [];
    return (body, last) => {
      kept.push(body);
      if (!last) return;
      const link = document.createElement('a');
      link.href = URL.createObjectURL(new Blob(kept, { type: 'application/jsonl' }));
      link.download = 'session.jsonl';
      link.click();
    };
  };

  // While a frame runs, the page's clock stands at the frame's time, as in a replay.
  const now = performance.now.bind(performance);
  let running = null;
  let read = 0;
  const during = (time, run) => {
    running = time;
    try {
      run();
    } finally {
      running = null;
    }
  };
  // What the page does before VR, ms since its document began: a replay does it at the same times.
  const start = { frames_ms: [], requested_ms: 0, first_ms: 0 };
  if (!settings.late) {
    set(performance, 'now', () => (read = Math.max(read, running ?? now())));
    const animate = window.requestAnimationFrame;
    let seen = 0;
    set(window, 'requestAnimationFrame', (callback) => animate.call(window, (time) => {
      if (!start.first_ms && time > seen) start.frames_ms.push(seen = time);
      during(time, () => callback(time));
    }));
  }

  const record = async (session) => {
    const wished = (kind) => session.requestReferenceSpace(kind).catch(() => null);
    const space = (await wished('local-floor')) ?? (await wished('local'));
    const send = settings.url ? sender() : keeper();
    const pinched = new Set();
    const felt = new WeakSet(); // actuators that are wrapped
    let lines = [];
    let first = null;
    let latest = -1;
    let count = 0;
    let flushed = 0;
    const write = (line) => lines.push(`${JSON.stringify(line)}\n`);
    const time_ns = (time) => Math.max(0, Math.round((time - first) * 1e6));
    const header = () => write({
      format: 'sim2vr-session', version: 1,
      app: {
        kind: 'page', name: settings.page ?? location.pathname.split('/').pop().slice(0, 200),
        options: Object.fromEntries(new URLSearchParams(location.search)),
      },
      ...(settings.late ? {} : { seed: settings.seed, page_start: start }),
      headset: headset(session), source: 'recorder', ...(session.frameRate ? { rate_hz: session.frameRate } : {}),
    });
    const flush = (last = false) => {
      if (first !== null) send(lines.join(''), last);
      lines = [];
    };

    const feel = ({ gamepad, handedness: hand }) => {
      const pulse = (amplitude, duration_ms) => {
        const time = running ?? now();
        const data = { hand, amplitude: within(0, amplitude), frequency_hz: 0, duration_s: Math.max(0, duration_ms || 0) / 1e3 };
        if (first !== null) write({ t: time_ns(time), event: 'haptic', data });
      };
      for (const actuator of [...(gamepad?.hapticActuators ?? []), gamepad?.vibrationActuator]) {
        if (!actuator || felt.has(actuator)) continue;
        felt.add(actuator);
        const { pulse: real, playEffect: effect } = actuator;
        if (real) set(actuator, 'pulse', (...given) => (pulse(...given), real.apply(actuator, given)));
        if (effect) set(actuator, 'playEffect', (type, given = {}) => {
          pulse(Math.max(given.strongMagnitude ?? 0, given.weakMagnitude ?? 0), given.duration);
          return effect.call(actuator, type, given);
        });
      }
    };
    const controller = (frame, source) => {
      feel(source);
      const grip = source.gripSpace && frame.getPose(source.gripSpace, space);
      if (!grip) return null;
      const aim = frame.getPose(source.targetRaySpace, space);
      const hand = joints(frame, source, space);
      return {
        grip: pose(grip), ...(aim && { aim: pose(aim) }), inputs: inputs(source, pinched.has(source)),
        ...(hand && { joints: hand }),
      };
    };
    const take = (time, frame) => {
      const head = time > latest && frame.getViewerPose(space);
      if (!head) return;
      if (first === null) {
        first = flushed = time;
        start.first_ms = time;
        if (start.frames_ms.length > MOST_FLAT_FRAMES) start.frames_ms = [];
        header();
      }
      latest = time;
      sim.seedFrame?.(count++);
      const line = { t: time_ns(time), head: pose(head) };
      for (const source of session.inputSources) {
        const { handedness: side } = source;
        if (side !== 'none' && !line[side]) line[side] = controller(frame, source);
      }
      write(line);
      if (time - flushed < BATCH_MS) return;
      flushed = time;
      flush();
    };

    const request = session.requestAnimationFrame;
    set(session, 'requestAnimationFrame', (callback) => request.call(session, (time, frame) => {
      try {
        take(time, frame);
      } catch (error) {
        complain(error);
      }
      during(time, () => callback(time, frame));
    }));
    session.addEventListener('selectstart', ({ inputSource }) => pinched.add(inputSource));
    session.addEventListener('selectend', ({ inputSource }) => pinched.delete(inputSource));
    let over = false;
    const end = () => {
      if (!over) flush(true);
      over = true;
    };
    session.addEventListener('end', end);
    window.addEventListener('pagehide', end);
  };

  const wrap = (xr) => {
    if (!xr || wrapped.has(xr)) return;
    wrapped.add(xr);
    for (const name of ['requestSession', 'offerSession']) {
      const real = xr[name];
      if (real) set(xr, name, async (mode, wanted = {}) => {
        if (mode === 'inline') return real.call(xr, mode, wanted);
        start.requested_ms = now();
        const optionalFeatures = [...(wanted.optionalFeatures ?? []), 'local-floor'];
        const session = await real.call(xr, mode, { ...wanted, optionalFeatures });
        await record(session).catch(complain);
        return session;
      });
    }
  };
  // An emulator may put another object there, at any time before the session.
  const watch = () => wrap(navigator.xr);
  watch();
  setInterval.call(window, watch, WATCH_MS);
  for (const name of ['DOMContentLoaded', 'load', 'click']) window.addEventListener(name, watch, true);
}
