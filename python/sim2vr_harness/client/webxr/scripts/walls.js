// What a page under test has no business with: the network beyond its files, other windows, files
// to write. The browser is started without a way out; here it is said to the scripts of the page
// and of the frames within it.
{
  const refuse = (name) => function () {
    throw new DOMException(`${name} is not there under sim2vr`, 'NotSupportedError');
  };
  for (const name of [
    'WebSocket', 'WebSocketStream', 'WebTransport', 'RTCPeerConnection', 'webkitRTCPeerConnection',
    'SharedWorker', 'showSaveFilePicker', 'showOpenFilePicker', 'showDirectoryPicker',
  ]) {
    if (name in window) {
      Object.defineProperty(window, name, { value: refuse(name), configurable: true, writable: true });
    }
  }
  if (navigator.serviceWorker) {
    Object.defineProperty(ServiceWorkerContainer.prototype, 'register', {
      value: async () => refuse('serviceWorker')(),
    });
  }
  if (window.StorageManager) {
    StorageManager.prototype.getDirectory = async () => refuse('getDirectory')();
  }
  // A round begins without what another has kept; the harness clears what takes time to open.
  if (window === window.top && location.protocol !== 'about:') {
    localStorage.clear();
    sessionStorage.clear();
    window.name = '';
  }
  // What the machine has would make rounds differ.
  navigator.getGamepads = () => [null, null, null, null];
  for (const [name, value] of [['hardwareConcurrency', 4], ['deviceMemory', 4]]) {
    if (name in navigator) Object.defineProperty(Navigator.prototype, name, { get: () => value });
  }
  window.open = () => null;
  window.alert = () => {};
  window.confirm = () => true;
  window.prompt = () => null;
  navigator.sendBeacon = () => false;
}
