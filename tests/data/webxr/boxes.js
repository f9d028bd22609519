// Boxes in WebXR without an engine: enough of a page to test everything a device does.
const VERTEX = `#version 300 es
  in vec3 corner;
  uniform mat4 projection, view;
  uniform vec3 centre, half_size;
  out vec3 place;
  void main() {
    place = corner;
    gl_Position = projection * view * vec4(centre + corner * half_size, 1.0);
  }`;
const FRAGMENT = `#version 300 es
  precision highp float;
  in vec3 place;
  uniform vec3 colour;
  out vec4 seen;
  void main() { seen = vec4(colour * (0.75 + 0.25 * step(0.0, place.x * place.y)), 1.0); }`;
const FACES = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 5], [0, 5, 1],
  [3, 2, 6], [3, 6, 7], [0, 3, 7], [0, 7, 4], [1, 5, 6], [1, 6, 2]];
const CORNERS = [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
  [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]];

// The same in the language of WebGL 1.
const olderShader = (text) => text.replace('#version 300 es', '').replace('in vec3 corner', 'attribute vec3 corner')
  .replace(/^  (in|out) vec3 place/m, '  varying vec3 place').replace('out vec4 seen;', '').replace('seen =', 'gl_FragColor =');

export class Boxes {
  constructor(kind = 'webgl2') {
    this.canvas = document.body.appendChild(document.createElement('canvas'));
    this.gl = this.canvas.getContext(kind, { xrCompatible: true });
    this.list = []; // {centre: [x, y, z], half: [x, y, z], colour: [r, g, b]}
    this.#prepare(kind === 'webgl2' ? (text) => text : olderShader);
  }

  #prepare(translated) {
    const { gl } = this;
    const program = this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, translated(text));
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    this.at = Object.fromEntries(['projection', 'view', 'centre', 'half_size', 'colour'].map(
      (name) => [name, gl.getUniformLocation(program, name)]));
    this.vertices = gl.createVertexArray?.();
    gl.bindVertexArray?.(this.vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    const points = FACES.flat().flatMap((k) => CORNERS[k]);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  }

  async enter(onFrame, features = ['local-floor']) {
    const session = this.session = await navigator.xr.requestSession('immersive-vr', { requiredFeatures: features });
    this.layer = new XRWebGLLayer(session, this.gl);
    session.updateRenderState({ baseLayer: this.layer, depthNear: 0.05, depthFar: 100 });
    this.space = await session.requestReferenceSpace(features[0] ?? 'local');
    const loop = (time, frame) => {
      session.requestAnimationFrame(loop);
      onFrame(time, frame);
      this.draw(frame);
    };
    session.requestAnimationFrame(loop);
  }

  draw(frame) {
    const { gl, at, layer } = this;
    const pose = frame.getViewerPose(this.space);
    if (!pose) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    gl.clearColor(0.1, 0.2, 0.3, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.bindVertexArray?.(this.vertices);
    for (const view of pose.views) {
      const { x, y, width, height } = layer.getViewport(view);
      gl.viewport(x, y, width, height);
      gl.uniformMatrix4fv(at.projection, false, view.projectionMatrix);
      gl.uniformMatrix4fv(at.view, false, view.transform.inverse.matrix);
      for (const { centre, half, colour } of this.list) {
        gl.uniform3fv(at.centre, centre);
        gl.uniform3fv(at.half_size, half);
        gl.uniform3fv(at.colour, colour);
        gl.drawArrays(gl.TRIANGLES, 0, 36);
      }
    }
  }
}

export function button(text, onClick) {
  const made = document.body.appendChild(document.createElement('button'));
  made.textContent = text;
  made.onclick = onClick;
}

const vector = (value) => ({ x: value, y: value, z: value, clone: () => vector(value) });

// Names boxes as three.js names objects to its developer tools: {name: box}.
export function nameBoxes(named) {
  const object = (name) => named[name] && {
    name,
    isMesh: true,
    position: vector(0),
    quaternion: vector(0),
    scale: vector(1),
    geometry: {
      attributes: { position: { count: 36 } },
      computeBoundingBox() {},
      get boundingBox() {
        const [x, y, z] = named[name].half;
        return { min: { x: -x, y: -y, z: -z }, max: { x, y, z } };
      },
    },
    get material() {
      const hex = named[name].colour.reduce((sum, part) => sum * 256 + Math.round(part * 255), 0);
      return { visible: true, color: { getHex: () => hex } };
    },
    updateWorldMatrix() {},
    matrixWorld: {
      get elements() { return [...Array(12).fill(0), ...named[name].centre, 1]; },
      decompose(place, turn) { Object.assign(turn, { x: 0, y: 0, z: 0, w: 1 }); },
    },
  };
  const scene = {
    isScene: true,
    getObjectByName: object,
    traverse(visit) { for (const name of Object.keys(named)) visit(object(name)); },
    traverseVisible(visit) { this.traverse(visit); },
  };
  nameBoxes.scene = scene; // the tools hold it weakly
  window.__THREE_DEVTOOLS__?.dispatchEvent(new CustomEvent('observe', { detail: scene }));
}
