// Runs scripts of pages in Node, with as much of a window as they need, and prints what a case says.
//   node page_scripts.mjs FOLDER NAME,NAME,... CASE ARGUMENTS
import { readFileSync } from 'node:fs';
import path from 'node:path';

// Each runs in the scope of the scripts; see test_page_scripts.py.
/* global DOMPointReadOnly, errors, push, sim, window */
const cases = {
  timers: async () => {
    const log = [];
    const note = (name) => log.push([name, performance.now(), window.Date.now() - Date.UTC(2024, 0, 1)]);
    window.setTimeout(note, 30, 'late');
    window.setTimeout(note, 10, 'a');
    window.setTimeout(() => { note('b'); window.setTimeout(note, 0, 'within'); }, 10);
    const every = window.setInterval(() => { note('every'); if (log.length > 5) window.clearInterval(every); }, 12);
    window.clearTimeout(window.setTimeout(note, 5, 'never'));
    window.setTimeout(() => { throw new Error('odd'); }, 20);
    window.requestAnimationFrame((now) => log.push(['frame', now]));
    await sim.runTimers(45);
    sim.runFrames();
    sim.runFrames();
    const from = performance.now();
    for (let k = 0; k < 100100; k++) performance.now();
    return { log, errors, now: sim.now(), moved: performance.now() - from };
  },

  spaces: (...rows) => {
    const { compose, inverse, fromApp, transformOf } = sim.spaces;
    const [a, b] = rows.map(fromApp);
    return {
      both: [...transformOf(compose(a, b)).matrix],
      back: [...transformOf(inverse(a)).matrix],
    };
  },

  steps: async () => {
    const calls = [];
    let now = 0;
    sim.now = () => now;
    sim.runTimers = async (time) => { now = time; };
    sim.session = { _ended: false, _callbacks: { size: 1 }, _frame: ({ drawn }) => { calls.push(drawn); return null; } };
    const values = { number: 2.5, truth: true, nothing: null, list: [1, 2, 3], vector: { x: 1, y: 2, z: 3 }, wrong: NaN, text: 'x' };
    for (const [name, value] of Object.entries(values)) sim.values.set(name, () => value);
    sim.begin();
    const frame = (time, drawn) => [time, [0, 0, 0, 0, 0, 0, 1], [null, null], [], drawn];
    sim.locate = (name) => {
      if (name !== 'ball') throw new Error('no object');
      return [1, 2, 3];
    };
    const first = await sim.step([frame(0, false), frame(50, true)], true, ['ball', 'bell']);
    sim.session._callbacks.size = 0;
    const later = await sim.step([frame(1900, false), frame(2100, false)], false, []);
    return { first, later, calls, now };
  },

  three: () => {
    const at = (x, y, z) => [0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, x, y, z, 1];
    const node = (more) => ({
      name: '', children: [], position: { x: 9, y: 9, z: 9 }, matrixWorld: { elements: at(0, 0, 0) },
      updateWorldMatrix() {},
      traverse(visit) {
        visit(this);
        for (const one of this.children) one.traverse(visit);
      },
      getObjectByName(name) {
        return this.name === name ? this : this.children.map((one) => one.getObjectByName(name)).find(Boolean);
      },
      ...more,
    });
    const camera = node({ isCamera: true, position: { x: 0, y: 1.2, z: 0 } });
    const rig = node({ children: [camera], matrixWorld: { elements: at(3, 0, 1) } });
    camera.parent = rig;
    const ball = node({ name: 'ball', matrixWorld: { elements: at(5, 2, 1) } });
    const scene = node({ isScene: true, children: [rig, ball] });
    window.__THREE_DEVTOOLS__.dispatchEvent(Object.assign(new Event('observe'), { detail: scene }));
    sim.viewed = { base: sim.spaces.IDENTITY, head: { p: [0, 1.2, 0], q: [0, 0, 0, 1] } };
    const thrown = () => {
      try {
        return sim.locate('bell');
      } catch (error) {
        return error.message;
      }
    };
    return [sim.locate('ball'), thrown()];
  },
};

const [folder, names, name, values] = process.argv.slice(2);
const { stringify } = JSON;
const window = new EventTarget();
for (const key of Object.getOwnPropertyNames(globalThis)) {
  if (!(key in window)) Object.defineProperty(window, key, { value: globalThis[key], configurable: true, writable: true });
}
const errors = [];
window.window = window.top = window;
window.reportError = (error) => errors.push(String(error));
window.DOMPointReadOnly = class { constructor(x, y, z, w) { Object.assign(this, { x, y, z, w }); } };
for (const key of ['GamepadButton', 'Gamepad', 'GamepadHapticActuator', 'Element']) window[key] = class {};
window.document = { querySelectorAll: () => [], body: { textContent: '' } };

// What the scripts of a page that are left out would do.
const idle = async () => {};
const stand = {
  settings: { seed: 0, profile: 'oculus-touch' }, haptics: [],
  loaded: idle, runTimers: idle, turn: idle, now: () => 0,
  wakeWorkers() {}, animate() {}, runFrames() {}, observe() {}, seedFrame() {},
};
const source = names.split(',').map((one) => readFileSync(path.join(folder, `${one}.js`), 'utf8')).join('\n');
const given = ['window', 'sim', 'errors', 'DOMPointReadOnly', 'Element', 'document'];
const run = new Function(...given, `return (async () => {\n${source}\nreturn (${cases[name]})(...${values});\n})();`);
const found = await run(window, stand, errors, window.DOMPointReadOnly, window.Element, window.document);
process.stdout.write(stringify(found), () => process.exit(0));
