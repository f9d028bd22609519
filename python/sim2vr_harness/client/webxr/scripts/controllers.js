// Controllers: an XRInputSource for each hand, its gamepad and what vibrates it.
{
  const { compose } = sim.spaces;
  const { XRSpace } = sim.classes;
  const { complete, illegal, make, own } = sim.idl;
  const PRESSED = 0.5;
  // A Touch controller's ray leaves it 60 degrees below its grip's axis, as in the C++ runtime.
  const GRIP_TO_RAY = { p: [0, 0, 0], q: [-0.5, 0, 0, Math.sqrt(0.75)] };
  const PROFILES = {
    'oculus-touch': ['oculus-touch-v2', 'oculus-touch', 'generic-trigger-squeeze-thumbstick'],
    'generic-trigger': ['generic-trigger'],
  };
  // Columns of a row of inputs, as client/devices.py has them.
  const COLUMN = {
    trigger: 0, squeeze: 1, stickX: 2, stickY: 3, stickClick: 4, lower: 5, upper: 6,
    triggerTouch: 8, stickTouch: 9, lowerTouch: 10, upperTouch: 11, restTouch: 12,
  };

  const BUTTONS = ['trigger', 'squeeze', 'touchpad', 'thumbstick click', 'A or X', 'B or Y', 'thumb rest'];
  sim.parts = new Set(); // buttons and axes that the page reads

  // The browser's own classes, with members that read what the harness sets: there are no others.
  const covered = (name, members, attributes) => {
    const Class = window[name];
    Object.defineProperties(Class.prototype, Object.getOwnPropertyDescriptors(members(Class)));
    complete(Class, attributes);
    delete sim.classes[name]; // is there as it is
    return Class;
  };
  const noted = (Class, button) => {
    const behind = own(button, Class);
    sim.parts.add(behind.name);
    return behind.state;
  };
  const GamepadButton = covered('GamepadButton', (Class) => ({
    get value() { return noted(Class, this).value; },
    get pressed() { return noted(Class, this).pressed; },
    get touched() { return noted(Class, this).touched; },
  }));
  const stateOf = (value, touch) => ({ value, pressed: value >= PRESSED, touched: value > 0 || touch > 0 });

  const pulse = (hand, value, duration) => {
    const amplitude = Math.min(1, Math.max(0, Number(value) || 0));
    const wished_ms = Number(duration);
    const lasting_ms = Number.isFinite(wished_ms) ? Math.max(0, wished_ms) : 0;
    push(sim.haptics, [hand, amplitude, lasting_ms / 1e3]);
  };
  const GamepadHapticActuator = covered('GamepadHapticActuator', (Class) => ({
    async pulse(value, duration) {
      pulse(own(this, Class).hand, value, duration);
      return true;
    },
    async playEffect(_type, { duration = 0, strongMagnitude = 0, weakMagnitude = 0 } = {}) {
      pulse(own(this, Class).hand, Math.max(strongMagnitude, weakMagnitude), duration);
      return 'complete';
    },
    async reset() {
      pulse(own(this, Class).hand, 0, 0);
      return 'complete';
    },
  }), ['type', 'effects']);

  const Gamepad = covered('Gamepad', (Class) => ({
    get axes() {
      sim.parts.add('thumbstick');
      return own(this, Class).axes;
    },
    get timestamp() {
      own(this, Class);
      return sim.now();
    },
  }), ['id', 'index', 'connected', 'mapping', 'buttons', 'vibrationActuator', 'hapticActuators']);
  const gamepadOf = (hand, buttons, axes) => {
    const vibrationActuator = make(GamepadHapticActuator, {
      hand, type: 'vibration', effects: Object.freeze(['dual-rumble']),
    });
    return make(Gamepad, {
      id: '',
      index: -1,
      connected: true,
      mapping: 'xr-standard',
      axes: Object.freeze(Array.from({ length: axes }, () => 0)),
      buttons: Object.freeze(Array.from({ length: buttons },
        (_, k) => make(GamepadButton, { name: BUTTONS[k], state: stateOf(0, 0) }))),
      vibrationActuator,
      hapticActuators: Object.freeze([vibrationActuator]),
    });
  };

  class XRInputSource { constructor() { illegal(); } }
  complete(XRInputSource, [
    'handedness', 'targetRayMode', 'targetRaySpace', 'gripSpace', 'gamepad', 'profiles', 'skipRendering',
  ]);
  sim.inputSource = (session, hand) => {
    const touch = sim.settings.profile === 'oculus-touch';
    return make(XRInputSource, {
      handedness: hand,
      targetRayMode: 'tracked-pointer',
      profiles: Object.freeze([...PROFILES[sim.settings.profile]]),
      skipRendering: false,
      gripSpace: make(XRSpace, { session, where: (state) => state[hand] }),
      targetRaySpace: make(XRSpace, {
        session, where: (state) => state[hand] && compose(state[hand], GRIP_TO_RAY),
      }),
      gamepad: gamepadOf(hand, touch ? 7 : 1, touch ? 4 : 0),
    });
  };

  // Takes a row of inputs; returns the names of the events that it means.
  sim.takeInputs = (source, row) => {
    const pad = own(own(source, XRInputSource).gamepad, Gamepad);
    const buttons = map(pad.buttons, (button) => own(button, GamepadButton));
    const pressed = (k) => buttons[k]?.state.pressed ?? false;
    const before = [pressed(0), pressed(1)];
    const at = (name) => (row ? row[COLUMN[name]] : 0);
    buttons[0].state = stateOf(at('trigger'), at('triggerTouch'));
    if (buttons.length > 1) {
      buttons[1].state = stateOf(at('squeeze'), 0);
      buttons[3].state = stateOf(at('stickClick'), at('stickTouch'));
      buttons[4].state = stateOf(at('lower'), at('lowerTouch'));
      buttons[5].state = stateOf(at('upper'), at('upperTouch'));
      buttons[6].state = stateOf(0, at('restTouch'));
      const axes = [0, 0, at('stickX'), 0 - at('stickY')]; // WebXR: down is positive
      if (!every(axes, (value, k) => value === pad.axes[k])) pad.axes = Object.freeze(axes);
    }
    const events = [];
    forEach(['select', 'squeeze'], (name, k) => {
      const is = pressed(k);
      if (is && !before[k]) push(events, `${name}start`);
      if (!is && before[k]) push(events, name, `${name}end`);
    });
    return events;
  };
}
