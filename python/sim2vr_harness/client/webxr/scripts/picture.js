// What an eye sees: XRWebGLLayer, an opaque framebuffer of the observation's size with a depth
// texture. Colour and linear depth are read back together, one byte each, top row first.
{
  const layers = new WeakMap(); // context -> its XRWebGLLayer
  const bound = new WeakMap(); // context -> framebuffer that is drawn to
  const { complete, dictionary, illegal, make, needs, number, own, record, taken } = sim.idl;
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

  class XRViewport { constructor() { illegal(); } }
  complete(XRViewport, ['x', 'y', 'width', 'height']);
  class XRLayer extends EventTarget { constructor() { illegal(); } }
  complete(XRLayer);

  // Contexts that a page has made, or asked to be, fit for a headset.
  const fit = new WeakSet();
  const known = new WeakSet();
  for (const { prototype } of filter([window.HTMLCanvasElement, window.OffscreenCanvas], Boolean)) {
    const { getContext } = prototype;
    prototype.getContext = function (...args) {
      const found = Reflect.apply(getContext, this, args);
      if (found && !known.has(found)) {
        known.add(found);
        if (args[1]?.xrCompatible) fit.add(found);
      }
      return found;
    };
  }
  for (const { prototype } of kinds) {
    prototype.makeXRCompatible = async function makeXRCompatible() {
      if (this.isContextLost()) throw new DOMException('the context is lost', 'InvalidStateError');
      fit.add(this);
    };
  }
  replace(['getContextAttributes'], (original) => function () {
    const found = original.call(this);
    return found && { ...found, xrCompatible: fit.has(this) };
  });

  class XRWebGLLayer extends XRLayer {
    constructor(session, context, layerInit = {}) {
      needs(2, arguments, 'XRWebGLLayer');
      const behind = taken(session, sim.classes.XRSession, 'session');
      if (!kinds.some((kind) => context instanceof kind)) throw new TypeError('context is no WebGL context');
      const { framebufferScaleFactor: scale } = dictionary(layerInit, 'layerInit');
      if (scale !== undefined) number(scale, 'framebufferScaleFactor');
      const unless = (holds, why) => {
        if (!holds) throw new DOMException(why, 'InvalidStateError');
      };
      unless(!behind._ended, 'the session is over');
      unless(!context.isContextLost(), 'the context is lost');
      unless(!behind._immersive || fit.has(context), 'the context is not made xrCompatible');
      return made(new.target, behind, context);
    }
    static getNativeFramebufferScaleFactor(session) {
      needs(1, arguments, 'getNativeFramebufferScaleFactor');
      return taken(session, sim.classes.XRSession, 'session')._ended ? 0 : 1;
    }
    get framebufferWidth() { return own(this, XRWebGLLayer).layer.framebufferWidth; }
    get framebufferHeight() { return own(this, XRWebGLLayer).layer.framebufferHeight; }
    get framebuffer() { return own(this, XRWebGLLayer).layer.framebuffer; }
    get fixedFoveation() {
      own(this, XRWebGLLayer);
      return null; // there is none to set
    }
    set fixedFoveation(value) {
      own(this, XRWebGLLayer);
      if (value !== null && value !== undefined) number(value, 'fixedFoveation');
    }
    getViewport(view) {
      const { session, layer, viewports } = own(this, XRWebGLLayer);
      needs(1, arguments, 'getViewport');
      const { frame, index } = taken(view, sim.classes.XRView, 'view');
      if (frame.behind !== session) throw new DOMException('a view of another session', 'InvalidStateError');
      if (!frame.active) throw new DOMException('the frame is over', 'InvalidStateError');
      const preview = layer.framebuffer === null;
      const width = preview ? layer.framebufferWidth : sim.settings.width;
      const height = layer.framebufferHeight;
      const last = viewports[index] && own(viewports[index], XRViewport);
      if (last?.width !== width || last.height !== height) {
        viewports[index] = make(XRViewport, { x: index * width, y: 0, width, height });
      }
      return viewports[index];
    }
  }
  complete(XRWebGLLayer, ['antialias', 'ignoreDepthValues']);
  const made = (Class, session, context) => {
    const layer = new Layer(session, context);
    const target = Reflect.construct(EventTarget, [], Class);
    return record(target, XRWebGLLayer, {
      session, layer, viewports: [], antialias: false, ignoreDepthValues: false,
      gl: context, read: (near, far) => layer._read(near, far),
    });
  };
  sim.layer = (object) => own(object, XRWebGLLayer);

  // What is behind an XRWebGLLayer.
  class Layer {
    constructor(session, gl) {
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
      this._make(gl);
      layers.set(gl, this);
      gl.canvas.addEventListener('webglcontextlost', () => sim.fail('lost', 'lost its WebGL context'));
    }
    get framebufferWidth() {
      return this.framebuffer === null ? this._gl.drawingBufferWidth : sim.settings.width * sim.settings.eyes;
    }
    get framebufferHeight() {
      return this.framebuffer === null ? this._gl.drawingBufferHeight : sim.settings.height;
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
  // With another clip space the depth would mean something else.
  replace(['getExtension'], (original) => function (name) {
    return /^EXT_clip_control$/i.test(name) ? null : original.call(this, name);
  });
  replace(['getSupportedExtensions'], (original) => function () {
    return original.call(this)?.filter((name) => name !== 'EXT_clip_control') ?? null;
  });
}
