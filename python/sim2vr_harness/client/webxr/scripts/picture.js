// What an eye sees: XRWebGLLayer, an opaque framebuffer of the observation's size with a depth
// texture. Colour and linear depth are read back together, one byte each, top row first.
{
  const layers = new WeakMap(); // context -> its XRWebGLLayer
  const bound = new WeakMap(); // context -> framebuffer that is drawn to
  const proto = WebGL2RenderingContext.prototype;
  const realBind = proto.bindFramebuffer;

  const VERTEX = `#version 300 es
    void main() {
      gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    precision highp int;
    uniform highp sampler2D color;
    uniform highp sampler2D depth;
    uniform vec2 planes; // near; 1 - near / far
    uniform float farthest;
    uniform int top;
    out vec4 seen;
    void main() {
      ivec2 at = ivec2(gl_FragCoord.x, float(top) - gl_FragCoord.y);
      float z = planes.x / max(1.0 - texelFetch(depth, at, 0).r * planes.y, 1e-9);
      seen = vec4(texelFetch(color, at, 0).rgb, min(z / farthest, 1.0));
    }`;

  // Runs work between looking up and setting back what the page may rely on.
  const undisturbed = (gl, work) => {
    const texture = map([0, 1], (unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      return [gl.getParameter(gl.TEXTURE_BINDING_2D), gl.getParameter(gl.SAMPLER_BINDING)];
    });
    work();
    forEach(texture, ({ 0: bound2d, 1: sampler }, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, bound2d);
      gl.bindSampler(unit, sampler);
    });
  };
  const SWITCHES = [
    'BLEND', 'CULL_FACE', 'DEPTH_TEST', 'DITHER', 'POLYGON_OFFSET_FILL', 'RASTERIZER_DISCARD',
    'SAMPLE_ALPHA_TO_COVERAGE', 'SAMPLE_COVERAGE', 'SCISSOR_TEST', 'STENCIL_TEST',
  ];
  // What the browser would have to ask another process for is noted as the page sets it.
  const PACKING = {
    [proto.PACK_ALIGNMENT]: 4, [proto.PACK_ROW_LENGTH]: 0, [proto.PACK_SKIP_PIXELS]: 0,
    [proto.PACK_SKIP_ROWS]: 0,
  };
  const settings = new WeakMap(); // context -> {color, depth, packing}
  const settingsOf = (gl) => {
    if (!settings.has(gl)) {
      settings.set(gl, { color: [true, true, true, true], depth: true, packing: { ...PACKING } });
    }
    return settings.get(gl);
  };
  const { colorMask, depthMask, pixelStorei } = proto;
  proto.colorMask = function (...mask) {
    settingsOf(this).color = mask;
    Reflect.apply(colorMask, this, mask);
  };
  proto.depthMask = function (on) {
    settingsOf(this).depth = on;
    depthMask.call(this, on);
  };
  proto.pixelStorei = function (name, value) {
    if (name in PACKING) settingsOf(this).packing[name] = value;
    pixelStorei.call(this, name, value);
  };
  const keepingState = (gl, work) => {
    const active = gl.getParameter(gl.ACTIVE_TEXTURE);
    const draw = gl.getParameter(gl.DRAW_FRAMEBUFFER_BINDING);
    const read = gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
    const program = gl.getParameter(gl.CURRENT_PROGRAM);
    const vertices = gl.getParameter(gl.VERTEX_ARRAY_BINDING);
    const pack = gl.getParameter(gl.PIXEL_PACK_BUFFER_BINDING);
    const viewport = gl.getParameter(gl.VIEWPORT);
    const { color, depth, packing } = settingsOf(gl);
    const on = map(SWITCHES, (name) => gl.isEnabled(gl[name]));
    const packed = filter(Object.keys(PACKING), (name) => packing[name] !== PACKING[name]);
    forEach(SWITCHES, (name, k) => on[k] && gl.disable(gl[name]));
    forEach(packed, (name) => Reflect.apply(pixelStorei, gl, [Number(name), PACKING[name]]));
    colorMask.call(gl, true, true, true, true);
    depthMask.call(gl, true);
    undisturbed(gl, work);
    forEach(SWITCHES, (name, k) => on[k] && gl.enable(gl[name]));
    forEach(packed, (name) => Reflect.apply(pixelStorei, gl, [Number(name), packing[name]]));
    Reflect.apply(colorMask, gl, color);
    depthMask.call(gl, depth);
    Reflect.apply(gl.viewport, gl, viewport);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, pack);
    gl.bindVertexArray(vertices);
    gl.useProgram(program);
    realBind.call(gl, gl.DRAW_FRAMEBUFFER, draw);
    realBind.call(gl, gl.READ_FRAMEBUFFER, read);
    gl.activeTexture(active);
  };

  const textureOf = (gl, format, width, height) => {
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    for (const name of ['TEXTURE_MIN_FILTER', 'TEXTURE_MAG_FILTER']) {
      gl.texParameteri(gl.TEXTURE_2D, gl[name], gl.NEAREST);
    }
    return texture;
  };
  const compiled = (gl) => {
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    return program;
  };

  class XRWebGLLayer extends EventTarget {
    constructor(session, gl) {
      super();
      this.antialias = false;
      this.ignoreDepthValues = false;
      this.fixedFoveation = 0;
      this._gl = gl;
      if (!session._immersive) { // a preview: the canvas itself
        this.framebuffer = null;
        return;
      }
      if (!(gl instanceof WebGL2RenderingContext)) {
        sim.fail('webgl1', 'the page draws with WebGL 1, expected WebGL 2');
        throw new DOMException('sim2vr needs a WebGL 2 context', 'NotSupportedError');
      }
      if (session._ended) throw new DOMException('the session is over', 'InvalidStateError');
      this._make(gl);
      layers.set(gl, this);
      gl.canvas.addEventListener('webglcontextlost', () => sim.fail('lost', 'lost its WebGL context'));
    }
    static getNativeFramebufferScaleFactor() { return 1; }
    get framebufferWidth() {
      return this.framebuffer === null ? this._gl.drawingBufferWidth : sim.settings.width * sim.settings.eyes;
    }
    get framebufferHeight() {
      return this.framebuffer === null ? this._gl.drawingBufferHeight : sim.settings.height;
    }
    getViewport(view) {
      const preview = this.framebuffer === null;
      const width = preview ? this.framebufferWidth : sim.settings.width;
      const height = this.framebufferHeight;
      return { x: view._index * width, y: 0, width, height };
    }

    _make(gl) {
      const w = this.framebufferWidth;
      const h = this.framebufferHeight;
      keepingState(gl, () => {
        this._program = compiled(gl);
        this._empty = gl.createVertexArray();
        this._color = textureOf(gl, gl.RGBA8, w, h);
        this._depth = textureOf(gl, gl.DEPTH24_STENCIL8, w, h);
        this._out = textureOf(gl, gl.RGBA8, w, h);
        const framebuffer = (color, depth) => {
          const made = gl.createFramebuffer();
          const attach = (point, texture) =>
            gl.framebufferTexture2D(gl.FRAMEBUFFER, point, gl.TEXTURE_2D, texture, 0);
          realBind.call(gl, gl.FRAMEBUFFER, made);
          attach(gl.COLOR_ATTACHMENT0, color);
          if (depth) attach(gl.DEPTH_STENCIL_ATTACHMENT, depth);
          return made;
        };
        this.framebuffer = framebuffer(this._color, this._depth);
        this._seen = framebuffer(this._out, null);
      });
      this._pixels = new Uint8Array(w * h * 4);
    }

    // (height, eyes * width, 4) bytes: red, green, blue, depth in units of the farthest. Leaves
    // the framebuffer clear, as WebXR has it when a frame begins.
    _read(near, far) {
      const gl = this._gl;
      const w = this.framebufferWidth;
      const h = this.framebufferHeight;
      if (gl.isContextLost()) {
        sim.fail('lost', 'lost its WebGL context');
        return this._pixels;
      }
      keepingState(gl, () => {
        realBind.call(gl, gl.FRAMEBUFFER, this._seen);
        gl.useProgram(this._program);
        gl.bindVertexArray(this._empty);
        forEach([this._color, this._depth], (texture, unit) => {
          gl.activeTexture(gl.TEXTURE0 + unit);
          gl.bindTexture(gl.TEXTURE_2D, texture);
          gl.bindSampler(unit, null);
        });
        this._uniforms ??= Object.fromEntries(map(['color', 'depth', 'planes', 'farthest', 'top'],
          (name) => [name, gl.getUniformLocation(this._program, name)]));
        gl.uniform1i(this._uniforms.color, 0);
        gl.uniform1i(this._uniforms.depth, 1);
        gl.uniform2f(this._uniforms.planes, near, Number.isFinite(far) ? 1 - near / far : 1);
        gl.uniform1f(this._uniforms.farthest, sim.settings.farthest_m);
        gl.uniform1i(this._uniforms.top, h);
        gl.viewport(0, 0, w, h);
        real.drawArrays.call(gl, gl.TRIANGLES, 0, 3);
        gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
        gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, this._pixels);
        realBind.call(gl, gl.DRAW_FRAMEBUFFER, this.framebuffer);
        real.clearBufferfv.call(gl, gl.COLOR, 0, [0, 0, 0, 0]);
        real.clearBufferfi.call(gl, gl.DEPTH_STENCIL, 0, 1, 0);
      });
      return this._pixels;
    }
  }

  // Frames that nobody looks at are not drawn, nor is the page's own canvas during a session.
  const real = {};
  const unseen = (gl) => {
    if (!sim.session || sim.session._ended) return false;
    const target = bound.get(gl) ?? null;
    if (target === null) return layers.has(gl);
    return !sim.drawing && layers.get(gl)?.framebuffer === target;
  };
  proto.bindFramebuffer = function (target, framebuffer) {
    if (target !== this.READ_FRAMEBUFFER) bound.set(this, framebuffer);
    return realBind.call(this, target, framebuffer);
  };
  for (const name of [
    'drawArrays', 'drawElements', 'drawRangeElements', 'drawArraysInstanced',
    'drawElementsInstanced', 'clear', 'clearBufferfv', 'clearBufferiv', 'clearBufferuiv',
    'clearBufferfi', 'blitFramebuffer',
  ]) {
    const original = real[name] = proto[name];
    proto[name] = function (...args) { if (!unseen(this)) Reflect.apply(original, this, args); };
  }
  // A page that draws elsewhere, with more samples, and copies its picture copies the depth, too.
  const copied = new WeakMap(); // context -> whether the depths are of a kind
  const copy = proto.blitFramebuffer;
  proto.blitFramebuffer = function (...args) {
    copy.apply(this, args);
    const mask = args[8];
    const target = bound.get(this) ?? null;
    if (!sim.drawing || target === null || layers.get(this)?.framebuffer !== target) return;
    if (!(mask & this.COLOR_BUFFER_BIT) || mask & this.DEPTH_BUFFER_BIT) return;
    if (copied.get(this) === false) return;
    real.blitFramebuffer.call(this, ...args.slice(0, 8), this.DEPTH_BUFFER_BIT, this.NEAREST);
    if (!copied.has(this)) copied.set(this, this.getError() === this.NO_ERROR);
  };
  // An opaque framebuffer's depth is ours to read, whatever the page invalidates.
  for (const name of ['invalidateFramebuffer', 'invalidateSubFramebuffer']) {
    const original = proto[name];
    proto[name] = function (...args) {
      const target = bound.get(this) ?? null;
      if (target === null || layers.get(this)?.framebuffer !== target) original.apply(this, args);
    };
  }
  proto.makeXRCompatible = () => Promise.resolve();
  if (window.WebGLRenderingContext) {
    WebGLRenderingContext.prototype.makeXRCompatible = () => Promise.resolve();
  }
  const attributes = proto.getContextAttributes;
  proto.getContextAttributes = function () {
    const found = attributes.call(this);
    return found && { ...found, xrCompatible: true };
  };
  // With another clip space the depth would mean something else.
  const extension = proto.getExtension;
  proto.getExtension = function (name) {
    return /^EXT_clip_control$/i.test(name) ? null : extension.call(this, name);
  };
  const supported = proto.getSupportedExtensions;
  proto.getSupportedExtensions = function () {
    return supported.call(this)?.filter((name) => name !== 'EXT_clip_control') ?? null;
  };
  Object.assign(sim.classes, { XRWebGLLayer });
}
