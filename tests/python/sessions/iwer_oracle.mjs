// IWER plays a recording and records what it plays; or records made-up devices.
// node iwer_oracle.mjs FOLDER play IN OUT | record OUT FRAMES; FOLDER has node_modules/iwer.
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';
import path from 'node:path';

const [root, mode, ...rest] = process.argv.slice(2);
const lib = (file) => import(pathToFileURL(path.join(root, 'node_modules/iwer/lib', file)));
const { ActionPlayer } = await lib('action/ActionPlayer.js');
const { ActionRecorder } = await lib('action/ActionRecorder.js');
const { XRReferenceSpace, XRReferenceSpaceType } = await lib('spaces/XRReferenceSpace.js');
const { GlobalSpace } = await lib('spaces/XRSpace.js');
const { P_SPACE, P_JOINT_SPACE, P_GAMEPAD } = await lib('private.js');
const { mat4, vec3, quat } = await import(
  pathToFileURL(createRequire(path.join(root, 'x.js')).resolve('gl-matrix')).href.replace('cjs', 'esm'));

// A pose of a space that hangs on the reference space: position and rotation.
const poseOf = (space) => {
  const matrix = space[P_SPACE].offsetMatrix;
  return [...mat4.getTranslation(vec3.create(), matrix), ...mat4.getRotation(quat.create(), matrix)];
};

if (mode === 'play') {
  const recording = JSON.parse(readFileSync(rest[0], 'utf8'));
  const space = new XRReferenceSpace(XRReferenceSpaceType.Local, new GlobalSpace());
  const player = new ActionPlayer(space, recording, 0.063);
  player.play();
  const frames = [];
  const state = player[Object.getOwnPropertySymbols(player).find((s) => s.description.includes('action-player'))];
  for (let k = 0; k < recording.frames.length; k++) {
    if (k === 0) state.recordedFramePointer = -1; // stepFrames begins with the next one
    player.stepFrames(1);
    frames.push({
      time: state.playbackTime,
      head: poseOf(player.viewerSpace),
      inputs: player.inputSources.map((source) => ({
        hand: source.handedness,
        ray: poseOf(source.targetRaySpace),
        grip: source.gripSpace && poseOf(source.gripSpace),
        joints: source.hand && [...source.hand.values()].map((joint) => [...poseOf(joint), joint[P_JOINT_SPACE].radius]),
        buttons: source.gamepad.buttons.map((b) => [Number(b.pressed), Number(b.touched), b.value]),
        axes: [...Array(source.gamepad.axes.length).keys()].map((i) => source.gamepad[P_GAMEPAD].axesMap[i].x),
      })),
    });
  }
  writeFileSync(rest[1], JSON.stringify(frames));
} else {
  // The recorder asks the session's frame for poses; the gamepads are IWER's of a Quest 2.
  const { Gamepad } = await lib('gamepad/Gamepad.js');
  const { XRInputSource } = await lib('input/XRInputSource.js');
  const { XRSpace } = await lib('spaces/XRSpace.js');
  const { oculusTouchV2 } = await lib('device/configs/controller/meta.js');
  const sources = ['left', 'right'].map((hand) => new XRInputSource(
    hand, 'tracked-pointer', ['oculus-touch-v2'], new XRSpace(),
    new Gamepad(oculusTouchV2.layout[hand].gamepad), new XRSpace(), undefined));
  const poses = new Map();
  const matrixOf = (p, q) => ({ transform: { matrix: mat4.fromRotationTranslation(mat4.create(), q, p) } });
  const frame = {
    getViewerPose: () => poses.get('head'),
    getPose: (asked) => poses.get(asked),
  };
  const recorder = new ActionRecorder({ inputSources: sources }, {});
  const expected = [];
  const names = ['trigger', 'squeeze', 'thumbstick', 'lower', 'upper', 'thumbrest'];
  for (let k = 0; k < Number(rest[1]); k++) {
    const turn = 0.05 * k;
    const q = (t) => [0, Math.sin(t / 2), 0, Math.cos(t / 2)];
    poses.set('head', matrixOf([0.01 * k, 1.6, -0.2], q(turn)));
    sources.forEach((source, h) => {
      poses.set(source.gripSpace, matrixOf([h - 0.5, 1 + 0.01 * k, -0.3], q(-turn)));
      poses.set(source.targetRaySpace, matrixOf([h - 0.5, 1 + 0.01 * k, -0.4], q(turn + 0.3)));
      const { buttonsMap, axesMap } = source.gamepad[P_GAMEPAD];
      const id = { lower: h ? 'a-button' : 'x-button', upper: h ? 'b-button' : 'y-button' };
      const values = {};
      names.forEach((name, n) => {
        const analogue = n < 2;
        const bit = (k >> (n % 4)) & 1;
        values[name] = name === 'thumbrest' ? 0 : analogue ? ((k + n + h) % 5) / 4 : bit;
        const touch = name !== 'squeeze' && ((k + n) % 3 === 0);
        Object.assign(buttonsMap[id[name] ?? name][P_GAMEPAD], { value: values[name], touched: touch });
        values[`${name}_touch`] = Number(touch || values[name] > 0);
      });
      const stick = [((k % 9) - 4) / 4, (((k * 5) % 9) - 4) / 4];
      Object.assign(axesMap.thumbstick, { x: stick[0], y: stick[1] });
      expected.push({ hand: h, k, values, stick });
    });
    recorder.recordFrame(frame);
    await new Promise((resolve) => setTimeout(resolve, 1));
  }
  writeFileSync(rest[0], recorder.toJSON());
  writeFileSync(`${rest[0]}.expected`, JSON.stringify(expected));
}
