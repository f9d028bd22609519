// What a page under test has no business with: the network beyond its files, other windows, files
// to write. The browser is started without a way out; here it is said to the scripts of the page
// and of the frames within it.
{
  // Each wall is built by itself: a sandboxed frame throws at some, and still gets the others.
  const wall = (build) => {
    try {
      build();
    } catch {
      // The window has no such thing, or does not let its own scripts have it.
    }
  };
  const refuse = (name) => function () {
    throw new DOMException(`${name} is not there under sim2vr`, 'NotSupportedError');
  };
  for (const name of [
    'WebSocket', 'WebSocketStream', 'WebTransport', 'RTCPeerConnection', 'webkitRTCPeerConnection',
    'SharedWorker', 'showSaveFilePicker', 'showOpenFilePicker', 'showDirectoryPicker',
  ]) {
    wall(() => {
      if (!(name in window)) return;
      Object.defineProperty(window, name, { value: refuse(name), configurable: true, writable: true });
    });
  }
  wall(() => {
    Object.defineProperty(ServiceWorkerContainer.prototype, 'register', {
      value: async () => refuse('serviceWorker')(),
    });
  });
  wall(() => { StorageManager.prototype.getDirectory = async () => refuse('getDirectory')(); });
  // A round begins without what another has kept; the harness clears what takes time to open.
  if (window === window.top && location.protocol !== 'about:') {
    wall(() => localStorage.clear());
    wall(() => sessionStorage.clear());
    wall(() => { window.name = ''; });
  }
  // What the machine has would make rounds differ.
  wall(() => { navigator.getGamepads = () => [null, null, null, null]; });
  for (const [name, value] of [['hardwareConcurrency', 4], ['deviceMemory', 4]]) {
    wall(() => {
      if (name in navigator) Object.defineProperty(Navigator.prototype, name, { get: () => value });
    });
  }
  // The harness's mouse has nothing to lock; the browser would wait for it.
  wall(() => { Element.prototype.requestPointerLock = async () => {}; });
  wall(() => { window.open = () => null; });
  wall(() => { window.alert = () => {}; });
  wall(() => { window.confirm = () => true; });
  wall(() => { window.prompt = () => null; });
  wall(() => { navigator.sendBeacon = () => false; });
}
