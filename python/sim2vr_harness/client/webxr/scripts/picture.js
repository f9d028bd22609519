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
    uniform vec3 area; // of the textures: left edge, width and height, shares
    uniform vec2 spread; // from the middle of a pixel to the middles of those that it is made of
    uniform float farthest; // 0: the depth alone, mm in two bytes, 65535 where nothing is
    vec3 colored(vec2 at) { return texture2D(color, at).rgb; }
    void main() {
      vec2 at = vec2(area.x, 0.0) + vec2(gl_FragCoord.x, size.y - gl_FragCoord.y) / size * area.yz;
      vec2 other = vec2(spread.x, -spread.y);
      vec3 mean = (colored(at - spread) + colored(at + spread) + colored(at - other) + colored(at + other)) / 4.0;
      at -= spread;
      float part = texture2D(depth, at).r;
      float z = planes.x / max(1.0 - part * planes.y, 1e-9);
      float mm = part < 1.0 ? min(floor(z * 1000.0 + 0.5), 65535.0) : 65535.0;
      float high = floor(mm / 256.0);
      gl_FragColor = farthest > 0.0 ? vec4(mean, min(z / farthest, 1.0))
        : vec4(high / 255.0, (mm - high * 256.0) / 255.0, 0.0, 1.0);
    }`;

  const FINER = 2; // observers' views are drawn so much larger: smooth edges without antialiasing
  const { toDataURL } = HTMLCanvasElement.prototype;
  const paper = Reflect.apply(HTMLCanvasElement.prototype.getContext, document.createElement('canvas'), ['2d']);
  const pngOf = (pixels, width) => {
    const image = new ImageData(new Uint8ClampedArray(pixels.buffer), width);
    paper.canvas.width = width;
    paper.canvas.height = image.height;
    paper.putImageData(image, 0, 0);
    return Reflect.apply(toDataURL, paper.canvas, []);
  };

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
      const { frame, index, area } = taken(view, sim.classes.XRView, 'view');
      if (frame.behind !== session) throw new DOMException('a view of another session', 'InvalidStateError');
      if (!frame.active) throw new DOMException('the frame is over', 'InvalidStateError');
      const { x, y, width, height } = layer.framebuffer === null
        ? { x: 0, y: 0, width: layer.framebufferWidth, height: layer.framebufferHeight } : area;
      const last = viewports[index] && own(viewports[index], XRViewport);
      if (last?.x !== x || last.width !== width || last.height !== height) {
        viewports[index] = make(XRViewport, { x, y, width, height });
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
      gl: context, areas: layer.areas, makeRoom: (observers) => layer._makeRoom(observers),
      read: (near, far, observers) => layer._read(near, far, observers),
    });
  };
  sim.layer = (object) => own(object, XRWebGLLayer);

  // What is behind an XRWebGLLayer.
  class Layer {
    constructor(session, gl) {
      this._gl = gl;
      this.areas = []; // of observers, beside the eyes
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
        const { 0: outer, 1: seen, 2: solid } = map([0, 1, 2], () => gl.createFramebuffer());
        this.framebuffer = outer;
        this._seen = seen;
        this._solid = solid;
        this._resize(gl, w, h);
      });
      this._pixels = new Uint8Array(w * h * 4);
    }
    // Puts empty textures of a size behind the framebuffers, which stay the objects that the page has.
    _resize(gl, width, height) {
      this.width = width;
      this.height = height;
      forEach([this._color, this._depth, this._out, this._solidDepth], (old) => old && gl.deleteTexture(old));
      const attached = (framebuffer, ...points) => {
        call(gl, 'bindFramebuffer', gl.FRAMEBUFFER, framebuffer);
        return map(points, (point) => {
          const texture = textureOf(gl, point !== gl.COLOR_ATTACHMENT0, width, height);
          gl.framebufferTexture2D(gl.FRAMEBUFFER, point, gl.TEXTURE_2D, texture, 0);
          return texture;
        });
      };
      ({ 0: this._color, 1: this._depth } = attached(
        this.framebuffer, gl.COLOR_ATTACHMENT0, gl.DEPTH_STENCIL_ATTACHMENT));
      ({ 0: this._out } = attached(this._seen, gl.COLOR_ATTACHMENT0));
      ({ 0: this._solidDepth } = attached(this._solid, gl.DEPTH_STENCIL_ATTACHMENT));
    }
    // Observers have their areas to the right of the eyes'.
    _makeRoom(observers) {
      let x = this.framebufferWidth;
      let height = this.framebufferHeight;
      forEach(observers, (each, k) => {
        const area = { x, y: 0, width: each.width * FINER, height: each.height * FINER };
        this.areas[k] = area;
        x += area.width;
        height = Math.max(height, area.height);
      });
      if (x > this.width || height > this.height) {
        keepingState(this._gl, () => {
          this._resize(this._gl, Math.max(x, this.width), Math.max(height, this.height));
          call(this._gl, 'bindFramebuffer', this._gl.FRAMEBUFFER, this.framebuffer);
          clear(this._gl);
        });
      }
    }

    // Of the eyes, (height, eyes * width, 4) bytes: red, green, blue, depth in units of the farthest. Of
    // each observer a PNG; below the colours of those with depth are its millimetres, the high byte in
    // red and the low one in green. Leaves the framebuffer clear, as WebXR has it when a frame begins.
    _read(near, far, observers) {
      const gl = this._gl;
      const found = { eyes: this._pixels, observed: [] };
      if (gl.isContextLost()) {
        sim.fail('lost', 'lost its WebGL context');
        return found;
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
        this._uniforms ??= Object.fromEntries(map(['color', 'depth', 'planes', 'farthest', 'size', 'area', 'spread'],
          (name) => [name, gl.getUniformLocation(this._program, name)]));
        gl.uniform1i(this._uniforms.color, 0);
        gl.uniform1i(this._uniforms.depth, 1);
        gl.uniform2f(this._uniforms.planes, near, Number.isFinite(far) ? 1 - near / far : 1);
        if (isTwo(gl)) gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
        const copy = (x, w, h, scale, farthest, pixels) => {
          const apart = (scale - 1) / 2;
          gl.uniform1f(this._uniforms.farthest, farthest);
          gl.uniform2f(this._uniforms.size, w, h);
          gl.uniform3f(this._uniforms.area, x / this.width, w * scale / this.width, h * scale / this.height);
          gl.uniform2f(this._uniforms.spread, apart / this.width, apart / this.height);
          gl.viewport(0, 0, w, h);
          call(gl, 'drawArrays', gl.TRIANGLES, 0, 3);
          gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        };
        copy(0, this.framebufferWidth, this.framebufferHeight, 1, sim.settings.farthest_m, found.eyes);
        forEach(observers, ({ width, height, deep }, k) => {
          const size = width * height * 4;
          const pixels = new Uint8Array(deep ? 2 * size : size);
          copy(this.areas[k].x, width, height, FINER, 1e9, subarray(pixels, 0, size));
          for (let byte = 3; byte < size; byte += 4) pixels[byte] = 255;
          if (deep) copy(this.areas[k].x, width, height, FINER, 0, subarray(pixels, size));
          push(found.observed, pngOf(pixels, width));
        });
        call(gl, 'bindFramebuffer', gl.FRAMEBUFFER, this.framebuffer);
        clear(gl);
      });
      this._split = false; // whether the solid depth is one of its own, see solid.js
      return found;
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
    // Babylon.js clears the depth before each view: that of the views before it is still to be read.
    const within = name === 'clear' && sim.session?._observers.length && inLayer(this)
      && !this.isEnabled(this.SCISSOR_TEST) && !(args[0] & this.COLOR_BUFFER_BIT);
    const draw = () => {
      if (!within) {
        Reflect.apply(original, this, args);
        return;
      }
      const box = this.getParameter(this.SCISSOR_BOX);
      const area = this.getParameter(this.VIEWPORT);
      this.enable(this.SCISSOR_TEST);
      this.scissor(area[0], area[1], area[2], area[3]);
      Reflect.apply(original, this, args);
      this.disable(this.SCISSOR_TEST);
      this.scissor(box[0], box[1], box[2], box[3]);
    };
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
