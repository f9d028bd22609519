// In a worker: its clock moves when its page's does, and the page waits until it is idle.
{
  const KEY = '__sim2vr';
  const { postMessage, close } = window;
  delete window.WorkerNavigator.prototype.gpu; // not covered, see walls.js
  const answer = (content) => Reflect.apply(postMessage, window, [{ [KEY]: content }]);
  listen(window, 'message', async (event) => {
    const time = event.data?.[KEY];
    if (time === undefined) return;
    event.stopImmediatePropagation();
    await sim.turn();
    await sim.loaded();
    await sim.runTimers(time);
    sim.runFrames();
    await sim.turn();
    await sim.loaded();
    answer('idle');
  });
  window.close = () => {
    answer('closed');
    close.call(window);
  };
}
