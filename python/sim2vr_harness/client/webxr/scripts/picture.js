// What an eye sees: XRWebGLLayer, an opaque framebuffer of the observation's size with a depth
// texture. Colour and linear depth are read back together, one byte each, top row first.
{
  const layers = new WeakMap(); // context -> its XRWebGLLayer
  const bound = new WeakMap(); // context -> framebuffer that is drawn to
  const { bindArray, call, clear, compiled, isTwo, keepingState, kinds, replace, textureOf, triangle } = sim.gl;

  const VERTEX = `attribute vec2 corner;
    void main() { gl_Position = vec4(corner, 0.0, 1.0); }`;
  const FRAGMENT = `precision highp float;
    uniform sampler2D color;
    uniform sampler2D depth;
    uniform vec2 planes; // near; 1 - near / far
    uniform vec2 size;
    uniform float farthest;
    void main() {
      vec2 at = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y) / size;
      float z = planes.x / max(1.0 - texture2D(depth, at).r * planes.y, 1e-9);
      gl_FragColor = vec4(texture2D(color, at).rgb, min(z / farthest, 1.0));
    }`;

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
      const lacking = isTwo(gl) ? null
        : ['WEBGL_depth_texture', 'OES_vertex_array_object'].find((name) => !gl.getExtension(name));
      if (lacking) {
        sim.fail('webgl1', `draws with WebGL 1, where this browser has no ${lacking}, expected WebGL 2`);
        throw new DOMException(`no ${lacking}`, 'NotSupportedError');
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
        this._program = compiled(gl, VERTEX, FRAGMENT);
        this._triangle = triangle(gl);
        this._color = textureOf(gl, false, w, h);
        this._depth = textureOf(gl, true, w, h);
        this._out = textureOf(gl, false, w, h);
        const framebuffer = (color, depth) => {
          const made = gl.createFramebuffer();
          const attach = (point, texture) =>
            gl.framebufferTexture2D(gl.FRAMEBUFFER, point, gl.TEXTURE_2D, texture, 0);
          call(gl, 'bindFramebuffer', gl.FRAMEBUFFER, made);
          attach(gl.COLOR_ATTACHMENT0, color);
          if (depth) attach(gl.DEPTH_STENCIL_ATTACHMENT, depth);
          return made;
        };
        this.framebuffer = framebuffer(this._color, this._depth);
        this._seen = framebuffer(this._out, null);
        this._solidDepth = textureOf(gl, true, w, h);
        this._solid = framebuffer(null, this._solidDepth);
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
        call(gl, 'bindFramebuffer', gl.FRAMEBUFFER, this._seen);
        gl.useProgram(this._program);
        bindArray(gl, this._triangle);
        forEach([this._color, this._split ? this._solidDepth : this._depth], (texture, unit) => {
          gl.activeTexture(gl.TEXTURE0 + unit);
          gl.bindTexture(gl.TEXTURE_2D, texture);
          if (isTwo(gl)) gl.bindSampler(unit, null);
        });
        this._uniforms ??= Object.fromEntries(map(['color', 'depth', 'planes', 'farthest', 'size'],
          (name) => [name, gl.getUniformLocation(this._program, name)]));
        gl.uniform1i(this._uniforms.color, 0);
        gl.uniform1i(this._uniforms.depth, 1);
        gl.uniform2f(this._uniforms.planes, near, Number.isFinite(far) ? 1 - near / far : 1);
        gl.uniform1f(this._uniforms.farthest, sim.settings.farthest_m);
        gl.uniform2f(this._uniforms.size, w, h);
        gl.viewport(0, 0, w, h);
        call(gl, 'drawArrays', gl.TRIANGLES, 0, 3);
        if (isTwo(gl)) gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
        gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, this._pixels);
        call(gl, 'bindFramebuffer', gl.FRAMEBUFFER, this.framebuffer);
        clear(gl);
      });
      this._split = false; // whether the solid depth is one of its own, see solid.js
      return this._pixels;
    }
  }

  // Frames that nobody looks at are not drawn, nor is the page's own canvas during a session.
  const unseen = (gl) => {
    if (!sim.session || sim.session._ended) return false;
    const target = bound.get(gl) ?? null;
    if (target === null) return layers.has(gl);
    return !sim.drawing && layers.get(gl)?.framebuffer === target;
  };
  const inLayer = (gl) => {
    const target = bound.get(gl) ?? null;
    return target !== null && layers.get(gl)?.framebuffer === target;
  };
  replace(['bindFramebuffer'], (original) => function (target, framebuffer) {
    if (target !== WebGL2RenderingContext.READ_FRAMEBUFFER) bound.set(this, framebuffer);
    return original.call(this, target, framebuffer);
  });
  replace([
    'drawArrays', 'drawElements', 'drawRangeElements', 'drawArraysInstanced',
    'drawElementsInstanced', 'clear', 'clearBufferfv', 'clearBufferiv', 'clearBufferuiv',
    'clearBufferfi', 'blitFramebuffer',
  ], (original, name) => function (...args) {
    if (unseen(this)) return;
    const draw = () => Reflect.apply(original, this, args);
    if (sim.drawing && inLayer(this)) sim.drawSolid(this, layers.get(this), name, args, draw);
    else draw();
  });
  // A page that draws elsewhere, with more samples, and copies its picture copies the depth, too.
  const copied = new WeakMap(); // context -> whether the depths are of a kind
  replace(['blitFramebuffer'], (copy) => function (...args) {
    copy.apply(this, args);
    const mask = args[8];
    if (!sim.drawing || !inLayer(this) || copied.get(this) === false) return;
    if (!(mask & this.COLOR_BUFFER_BIT) || mask & this.DEPTH_BUFFER_BIT) return;
    call(this, 'blitFramebuffer', ...args.slice(0, 8), this.DEPTH_BUFFER_BIT, this.NEAREST);
    if (!copied.has(this)) copied.set(this, this.getError() === this.NO_ERROR);
  });
  // An opaque framebuffer's depth is ours to read, whatever the page invalidates.
  replace(['invalidateFramebuffer', 'invalidateSubFramebuffer'], (original) => function (...args) {
    if (!inLayer(this)) original.apply(this, args);
  });
  for (const { prototype } of kinds) prototype.makeXRCompatible = () => Promise.resolve();
  replace(['getContextAttributes'], (original) => function () {
    const found = original.call(this);
    return found && { ...found, xrCompatible: true };
  });
  // With another clip space the depth would mean something else.
  replace(['getExtension'], (original) => function (name) {
    return /^EXT_clip_control$/i.test(name) ? null : original.call(this, name);
  });
  replace(['getSupportedExtensions'], (original) => function () {
    return original.call(this)?.filter((name) => name !== 'EXT_clip_control') ?? null;
  });
  Object.assign(sim.classes, { XRWebGLLayer });
}
