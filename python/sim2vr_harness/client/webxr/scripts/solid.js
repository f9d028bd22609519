// The depth of what is solid. Lines, and what is seen through, hide nothing from the depth picture:
// from the first one in a frame on, everything else is drawn into a second depth as well.
{
  const { call, isTwo, replace } = sim.gl;
  const LEAST_OPACITY = 0.5;
  const OPACITIES = ['opacity', 'material_opacity']; // three.js, A-Frame; PlayCanvas
  const opacityOf = new WeakMap(); // place of such a uniform -> its program
  const opacity = new WeakMap(); // program -> its value
  const additive = new WeakMap(); // context -> whether colours are added up
  replace(['getUniformLocation'], (original) => function (program, name) {
    const place = original.call(this, program, name);
    if (place && OPACITIES.includes(name)) opacityOf.set(place, program);
    return place;
  });
  replace(['uniform1f'], (original) => function (place, value) {
    if (place && opacityOf.has(place)) opacity.set(opacityOf.get(place), value);
    original.call(this, place, value);
  });
  replace(['blendFunc', 'blendFuncSeparate'], (original) => function (...factors) {
    additive.set(this, factors[1] === this.ONE);
    Reflect.apply(original, this, factors);
  });

  const isLine = (gl, mode) => mode === gl.LINES || mode === gl.LINE_LOOP || mode === gl.LINE_STRIP;
  const seenThrough = (gl) => gl.isEnabled(gl.BLEND)
    && (additive.get(gl) || opacity.get(gl.getParameter(gl.CURRENT_PROGRAM)) < LEAST_OPACITY);
  const writes = (gl) => gl.isEnabled(gl.DEPTH_TEST) && gl.getParameter(gl.DEPTH_WRITEMASK);

  const intoSolid = (gl, { framebuffer, _solid }, work) => {
    call(gl, 'bindFramebuffer', gl.DRAW_FRAMEBUFFER, _solid);
    work();
    call(gl, 'bindFramebuffer', gl.DRAW_FRAMEBUFFER, framebuffer);
  };
  const split = (gl, layer) => {
    const read = gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
    const cut = gl.isEnabled(gl.SCISSOR_TEST);
    if (cut) gl.disable(gl.SCISSOR_TEST);
    call(gl, 'bindFramebuffer', gl.READ_FRAMEBUFFER, layer.framebuffer);
    const whole = [0, 0, layer.width, layer.height];
    const kept = gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT;
    intoSolid(gl, layer, () => call(gl, 'blitFramebuffer', ...whole, ...whole, kept, gl.NEAREST));
    call(gl, 'bindFramebuffer', gl.READ_FRAMEBUFFER, read);
    if (cut) gl.enable(gl.SCISSOR_TEST);
    layer._split = true;
  };
  // Runs a drawing call of the page's on its layer.
  sim.drawSolid = (gl, layer, name, args, work) => {
    const draws = name.startsWith('draw');
    const hidesNothing = draws && isTwo(gl) && (isLine(gl, args[0]) || seenThrough(gl)) && writes(gl);
    if (hidesNothing && !layer._split) split(gl, layer);
    work();
    if (!layer._split || hidesNothing || name === 'blitFramebuffer') return;
    if (!draws || writes(gl)) intoSolid(gl, layer, work);
  };
}
