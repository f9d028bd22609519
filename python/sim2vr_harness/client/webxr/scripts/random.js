// Seeds Math.random and, unless settings say realCrypto, crypto: in pages under virtual time and in
// recorded ones, which so draw the same numbers.
{
  // Mulberry32 (T. Ettinger, public domain): 32 bits of state, one number per step.
  let state = 0;
  const draw = () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return (t ^ (t >>> 14)) >>> 0;
  };
  let first = 0;
  sim.seed = (seed) => { state = first = seed | 0; };
  // What a frame of a recorded session draws does not depend on what was drawn before it.
  sim.seedFrame = (n) => { state = (first + Math.imul(n + 1, 0x9e3779b9)) | 0; };
  sim.seed(sim.settings.seed);
  const define = (object, name, value) =>
    Object.defineProperty(object, name, { value, configurable: true, writable: true });
  define(window.Math, 'random', () => (draw() * 2 ** 21 + (draw() >>> 11)) / 2 ** 53);
  if (!sim.settings.realCrypto) {
    define(Crypto.prototype, 'getRandomValues', (array) => {
      const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
      for (let k = 0; k < bytes.length; k++) bytes[k] = draw() & 255;
      return array;
    });
    define(Crypto.prototype, 'randomUUID', () => {
      const hex = Array.from({ length: 32 }, () => (draw() & 15).toString(16));
      hex[12] = '4';
      hex[16] = '89ab'[draw() & 3];
      const part = (from, to) => hex.slice(from, to).join('');
      return [part(0, 8), part(8, 12), part(12, 16), part(16, 20), part(20, 32)].join('-');
    });
  }
}
