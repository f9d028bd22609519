// Loads by elements of the document: images, scripts, style sheets, canvases that become files.
{
  const { begin, end, track, until } = sim;
  const decode = HTMLImageElement.prototype.decode;
  HTMLImageElement.prototype.decode = function () { return track(decode.call(this)); };
  const toBlob = HTMLCanvasElement.prototype.toBlob;
  HTMLCanvasElement.prototype.toBlob = function (callback, ...args) {
    begin();
    return toBlob.call(this, (blob) => {
      sim.call(callback, blob);
      end();
    }, ...args);
  };
  const source = Object.getOwnPropertyDescriptor(HTMLImageElement.prototype, 'src');
  Object.defineProperty(HTMLImageElement.prototype, 'src', {
    ...source,
    set(value) {
      if (String(value)) until(this, ['load', 'error']);
      source.set.call(this, value);
    },
  });
  const setAttribute = HTMLImageElement.prototype.setAttribute;
  HTMLImageElement.prototype.setAttribute = function (name, value) {
    if (String(name).toLowerCase() === 'src' && String(value)) until(this, ['load', 'error']);
    return setAttribute.call(this, name, value);
  };
  const begun = new WeakSet(); // a script runs once, however often it is moved
  const asks = (node) => {
    const scripts = node instanceof HTMLScriptElement && node.src;
    const styles = node instanceof HTMLLinkElement && node.href && node.rel === 'stylesheet';
    if (!(scripts || styles) || node.isConnected || begun.has(node)) return false;
    begun.add(node);
    return true;
  };
  const watchAdding = (object, ...names) => {
    for (const name of names) {
      const real = object[name];
      object[name] = function (...nodes) {
        if (this.isConnected) {
          for (const node of nodes) if (asks(node)) until(node, ['load', 'error']);
        }
        return Reflect.apply(real, this, nodes);
      };
    }
  };
  watchAdding(Node.prototype, 'appendChild', 'insertBefore');
  watchAdding(Element.prototype, 'append', 'prepend', 'before', 'after');
}
