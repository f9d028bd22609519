// The built-ins that the scripts use, as they were before any of the page's ran: a page that
// replaces Number or Array.prototype.push, or adds a toJSON, changes its own scripts, not these.
const {
  Array, Boolean, JSON, Map, Math, Number, Object, Promise, Reflect, Set, String, WeakMap, WeakSet,
  define, dispatch, every, filter, forEach, includes, listen, map, post, push, shift, slice, subarray, toBase64,
  unlisten,
} = ((real) => {
  const { Array, Boolean, Object, Promise, Reflect, String, Uint8Array } = real;
  const { apply, ownKeys } = Reflect;
  const copyTo = (to, from) => {
    for (const key of ownKeys(from)) {
      if (key === 'constructor' || key === 'prototype' || key === 'length' || key === 'name') continue;
      Object.defineProperty(to, key, Object.getOwnPropertyDescriptor(from, key));
    }
    return to;
  };
  const namespace = (name) => copyTo({}, real[name]);
  const converter = (name) => {
    const convert = real[name];
    return copyTo((value) => convert(value), convert);
  };
  const container = (name) => {
    const Own = class extends real[name] {};
    copyTo(Own.prototype, real[name].prototype);
    return Own;
  };
  // Methods as functions: push(list, item).
  const method = (prototype, name) => {
    const found = prototype[name];
    return found && ((self, ...args) => apply(found, self, args));
  };
  const lists = ['every', 'filter', 'forEach', 'includes', 'map', 'push', 'shift'];
  return {
    Boolean,
    Promise,
    ...Object.fromEntries(['Array', 'JSON', 'Math', 'Object', 'Reflect'].map((name) => [name, namespace(name)])),
    ...Object.fromEntries(['Number', 'String'].map((name) => [name, converter(name)])),
    ...Object.fromEntries(['Map', 'Set', 'WeakMap', 'WeakSet'].map((name) => [name, container(name)])),
    ...Object.fromEntries(lists.map((name) => [name, method(Array.prototype, name)])),
    define: (object, name, value) =>
      Object.defineProperty(object, name, { value, configurable: true, writable: true }),
    dispatch: method(EventTarget.prototype, 'dispatchEvent'),
    listen: method(EventTarget.prototype, 'addEventListener'),
    post: method(MessagePort.prototype, 'postMessage'),
    slice: method(String.prototype, 'slice'),
    subarray: method(Uint8Array.prototype, 'subarray'),
    toBase64: method(Uint8Array.prototype, 'toBase64'),
    unlisten: method(EventTarget.prototype, 'removeEventListener'),
  };
})(window);
