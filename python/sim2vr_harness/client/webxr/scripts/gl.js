// Drawing in a page's own context, WebGL 1 or 2, without a trace in its state.
{
  const Two = window.WebGL2RenderingContext;
  const One = window.WebGLRenderingContext;
  const kinds = filter([Two, One], Boolean);
  const isTwo = (gl) => gl instanceof Two;
  // The methods that a kind had before any script changed them; `replace` puts another in place.
  const originals = new Map(); // prototype -> {name: method}
  const realOf = (gl) => originals.get(isTwo(gl) ? Two.prototype : One.prototype);
  const replace = (names, replacement) => forEach(kinds, ({ prototype }) => forEach(names, (name) => {
    const original = prototype[name];
    if (typeof original !== 'function') return;
    if (!originals.has(prototype)) originals.set(prototype, {});
    originals.get(prototype)[name] ??= original;
    prototype[name] = replacement(original, name);
  }));
  const call = (gl, name, ...args) => Reflect.apply(realOf(gl)[name], gl, args);

  const SWITCHES = [
    'BLEND', 'CULL_FACE', 'DEPTH_TEST', 'DITHER', 'POLYGON_OFFSET_FILL', 'RASTERIZER_DISCARD',
    'SAMPLE_ALPHA_TO_COVERAGE', 'SAMPLE_COVERAGE', 'SCISSOR_TEST', 'STENCIL_TEST',
  ];
  // What the browser would have to ask another process for is noted as the page sets it.
  const PACKING = {
    [Two.PACK_ALIGNMENT]: 4, [Two.PACK_ROW_LENGTH]: 0, [Two.PACK_SKIP_PIXELS]: 0,
    [Two.PACK_SKIP_ROWS]: 0,
  };
  const settings = new WeakMap(); // context -> {color, depth, packing}
  const settingsOf = (gl) => {
    if (!settings.has(gl)) {
      settings.set(gl, { color: [true, true, true, true], depth: true, packing: { ...PACKING } });
    }
    return settings.get(gl);
  };
  replace(['colorMask'], (original) => function (...mask) {
    settingsOf(this).color = mask;
    Reflect.apply(original, this, mask);
  });
  replace(['depthMask'], (original) => function (on) {
    settingsOf(this).depth = on;
    original.call(this, on);
  });
  replace(['pixelStorei'], (original) => function (name, value) {
    if (name in PACKING) settingsOf(this).packing[name] = value;
    original.call(this, name, value);
  });

  // Vertex arrays are an extension of WebGL 1.
  const arrays = (gl) => {
    if (isTwo(gl)) return { make: () => gl.createVertexArray(), bind: (one) => gl.bindVertexArray(one) };
    const extension = gl.getExtension('OES_vertex_array_object');
    return { make: () => extension.createVertexArrayOES(), bind: (one) => extension.bindVertexArrayOES(one) };
  };
  // Runs work between looking up and setting back the textures that the page may rely on.
  const undisturbed = (gl, work) => {
    const found = map([0, 1], (unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      return [gl.getParameter(gl.TEXTURE_BINDING_2D), isTwo(gl) && gl.getParameter(gl.SAMPLER_BINDING)];
    });
    work();
    forEach(found, ({ 0: texture, 1: sampler }, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      if (isTwo(gl)) gl.bindSampler(unit, sampler);
    });
  };
  const keepingState = (gl, work) => {
    const two = isTwo(gl);
    const bind = arrays(gl).bind;
    const active = gl.getParameter(gl.ACTIVE_TEXTURE);
    const draw = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    const read = two && gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
    const program = gl.getParameter(gl.CURRENT_PROGRAM);
    const vertices = gl.getParameter(Two.VERTEX_ARRAY_BINDING);
    const buffer = gl.getParameter(gl.ARRAY_BUFFER_BINDING);
    const pack = two && gl.getParameter(gl.PIXEL_PACK_BUFFER_BINDING);
    const viewport = gl.getParameter(gl.VIEWPORT);
    const { color, depth, packing } = settingsOf(gl);
    const on = filter(SWITCHES, (name) => name in gl && gl.isEnabled(gl[name]));
    const packed = filter(Object.keys(PACKING), (name) => packing[name] !== PACKING[name]);
    forEach(on, (name) => gl.disable(gl[name]));
    forEach(packed, (name) => call(gl, 'pixelStorei', Number(name), PACKING[name]));
    call(gl, 'colorMask', true, true, true, true);
    call(gl, 'depthMask', true);
    undisturbed(gl, work);
    forEach(on, (name) => gl.enable(gl[name]));
    forEach(packed, (name) => call(gl, 'pixelStorei', Number(name), packing[name]));
    call(gl, 'colorMask', ...color);
    call(gl, 'depthMask', depth);
    Reflect.apply(gl.viewport, gl, viewport);
    if (two) gl.bindBuffer(gl.PIXEL_PACK_BUFFER, pack);
    bind(vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.useProgram(program);
    call(gl, 'bindFramebuffer', gl.FRAMEBUFFER, draw);
    if (two) call(gl, 'bindFramebuffer', gl.READ_FRAMEBUFFER, read);
    gl.activeTexture(active);
  };

  // An empty texture, of colours or of depths.
  const textureOf = (gl, depth, width, height) => {
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    if (isTwo(gl)) {
      gl.texStorage2D(gl.TEXTURE_2D, 1, depth ? gl.DEPTH24_STENCIL8 : gl.RGBA8, width, height);
    } else {
      const format = depth ? gl.DEPTH_STENCIL : gl.RGBA;
      const type = depth ? Two.UNSIGNED_INT_24_8 : gl.UNSIGNED_BYTE;
      gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, format, type, null);
    }
    for (const [name, value] of [
      ['MIN_FILTER', 'NEAREST'], ['MAG_FILTER', 'NEAREST'], ['WRAP_S', 'CLAMP_TO_EDGE'], ['WRAP_T', 'CLAMP_TO_EDGE'],
    ]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl[value]);
    return texture;
  };
  // A program, and the vertices of a triangle that covers the viewport as its attribute 0.
  const compiled = (gl, vertex, fragment) => {
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, 'corner');
    gl.linkProgram(program);
    return program;
  };
  const triangle = (gl) => {
    const { make, bind } = arrays(gl);
    const made = make();
    bind(made);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 3, -1, -1, 3]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    return made;
  };
  // Clears the framebuffer in use, as WebXR has it when a frame begins.
  const clear = (gl) => {
    if (isTwo(gl)) {
      call(gl, 'clearBufferfv', gl.COLOR, 0, [0, 0, 0, 0]);
      call(gl, 'clearBufferfi', gl.DEPTH_STENCIL, 0, 1, 0);
      return;
    }
    const color = gl.getParameter(gl.COLOR_CLEAR_VALUE);
    const depth = gl.getParameter(gl.DEPTH_CLEAR_VALUE);
    gl.clearColor(0, 0, 0, 0);
    gl.clearDepth(1);
    call(gl, 'clear', gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.clearColor(color[0], color[1], color[2], color[3]);
    gl.clearDepth(depth);
  };
  const bindArray = (gl, one) => arrays(gl).bind(one);
  sim.gl = { bindArray, call, clear, compiled, isTwo, keepingState, kinds, replace, textureOf, triangle };
}
