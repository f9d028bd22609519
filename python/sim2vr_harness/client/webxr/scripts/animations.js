// CSS animations and transitions, and those of `element.animate`, in virtual time: each is paused
// and set to where it would be; its events are sent from here, and not when the browser draws.
{
  const begun = new Map(); // animation -> {at: ms of virtual time, started}
  const real = Document.prototype.getAnimations;
  const proto = window.Animation?.prototype;
  const { pause, finish } = proto;
  const moment = Object.getOwnPropertyDescriptor(proto, 'currentTime');
  const given = new WeakMap(); // animation -> ms that the page has set it to
  Object.defineProperty(proto, 'currentTime', {
    ...moment,
    set(value) {
      given.set(this, value);
      begun.delete(this);
      moment.set.call(this, value);
    },
  });
  for (const type of [
    'animationstart', 'animationend', 'animationiteration', 'animationcancel',
    'transitionrun', 'transitionstart', 'transitionend', 'transitioncancel',
  ]) {
    listen(window, type, (event) => {
      if (event.isTrusted) event.stopImmediatePropagation();
    }, true);
  }
  const send = (animation, what) => {
    const { target, pseudoElement } = animation.effect ?? {};
    if (!target) return;
    const elapsedTime = (animation.effect.getComputedTiming().activeDuration || 0) / 1000;
    const init = { bubbles: true, elapsedTime: what === 'end' ? elapsedTime : 0, pseudoElement: pseudoElement ?? '' };
    const event = animation instanceof CSSTransition
      ? new TransitionEvent(`transition${what}`, { ...init, propertyName: animation.transitionProperty })
      : animation instanceof CSSAnimation
        && new AnimationEvent(`animation${what}`, { ...init, animationName: animation.animationName });
    if (event) sim.call(() => dispatch(target, event));
  };
  // To ask for animations takes a fifth of a small page's frame: in play, only after a change.
  let changed = true;
  const observer = new MutationObserver(() => { changed = true; });
  const all = { attributes: true, childList: true, subtree: true };
  observer.observe(document, all);
  const { animate, attachShadow } = Element.prototype;
  Element.prototype.animate = function (...args) {
    changed = true;
    return Reflect.apply(animate, this, args);
  };
  Element.prototype.attachShadow = function (...args) {
    const root = Reflect.apply(attachShadow, this, args);
    observer.observe(root, all);
    return root;
  };
  // Moves all animations to the time of now.
  sim.animate = () => {
    if (sim.session?._ready && !changed && begun.size === 0) return;
    changed = false;
    const running = filter(real.call(document), ({ playState }) => playState === 'running');
    forEach(running, (animation) => {
      const timing = animation.effect?.getComputedTiming();
      if (!timing) return;
      begun.set(animation, { at: sim.now(), from: Number(given.get(animation)) || 0, started: false });
      pause.call(animation);
      if (animation instanceof CSSTransition) send(animation, 'run');
    });
    begun.forEach((state, animation) => {
      if (animation.playState !== 'paused' || !animation.effect) {
        begun.delete(animation); // the page has taken it over
        return;
      }
      const { endTime, delay } = animation.effect.getComputedTiming();
      const time = state.from + (sim.now() - state.at) * animation.playbackRate;
      if (!state.started && time >= delay) {
        state.started = true;
        send(animation, 'start');
      }
      const over = animation.playbackRate < 0 ? time <= 0 : time >= endTime;
      if (!over) {
        moment.set.call(animation, time);
        return;
      }
      begun.delete(animation);
      finish.call(animation);
      send(animation, 'end');
    });
  };
}
