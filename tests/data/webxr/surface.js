import { Boxes, button } from './boxes.js';
const boxes = new Boxes();
const { gl } = boxes;
const errorOf = async (text, run) => {
  try { await run(); return null; } catch (error) { return error.name; }
};
const context = (options) => document.createElement('canvas').getContext('webgl2', options);
const [plain, lost] = [context(), context({ xrCompatible: true })];
lost.getExtension('WEBGL_lose_context').loseContext();
const turn = new XRRigidTransform({ x: 1 }, { z: Math.SQRT1_2, w: Math.SQRT1_2 });
let [late, lateView, selecting, change, floor, session, space] = [];
let [cancelled, selects, frames, ended] = [0, '', 0, 'early'];
const app = window.app = { found: null };
const asked = async (frame, gone, other, foreign) => {
  const layer = session.renderState.baseLayer;
  const pose = frame.getViewerPose(space);
  const source = session.inputSources[1];
  const event = new XRSessionEvent('visibilitychange', { session });
  const found = { errors: [], rules: [] };
  const all = [];
  // All that is called here begins within the frame.
  ERRORS.forEach((text) => all.push(errorOf(text, () => eval(text)).then((name) => found.errors.push([text, name]))));
  found.rules = RULES.map((text) => [text, (() => { try { return eval(text); } catch (error) { return `${error}`; } })()]);
  await Promise.all(all);
  app.found = found;
};
button('Enter VR', async () => {
  const old = await navigator.xr.requestSession('inline');
  old.onend = () => { ended = 'later'; };
  const over = old.end();
  if (ended !== 'early') throw new Error('ended at once');
  await over;
  const other = await navigator.xr.requestSession('inline');
  const foreign = await other.requestReferenceSpace('viewer');
  await boxes.enter(async (time, frame) => {
    frames += 1;
    if (frames === 1) {
      session.requestAnimationFrame(() => session.cancelAnimationFrame(second));
      const second = session.requestAnimationFrame(() => { cancelled += 1; });
    }
    if (frames === 5) [late, lateView] = [frame, frame.getViewerPose(space).views[0]];
    if (frames === 6) asked(frame, old, other, foreign);
  }, ['local-floor', 'bounded-floor']);
  session = boxes.session;
  session.oninputsourceschange = (given) => { change ??= given; };
  for (const type of ['select', 'selectstart', 'selectend']) {
    session.addEventListener(type, ({ frame }) => { selects = `${selects} ${type}`.trim(); selecting = frame; });
  }
  space = boxes.space;
  floor = await session.requestReferenceSpace('bounded-floor');
});
