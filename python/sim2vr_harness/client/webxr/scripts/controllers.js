// Controllers: an XRInputSource for each hand, its gamepad and what vibrates it.
{
  const { compose } = sim.spaces;
  const { XRSpace } = sim.classes;
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

  class GamepadButton {
    constructor(name) {
      this._name = name;
      this._set(0, 0);
    }
    _set(value, touch) { this._state = { value, pressed: value >= PRESSED, touched: value > 0 || touch > 0 }; }
    get _now() {
      sim.parts.add(this._name);
      return this._state;
    }
    get value() { return this._now.value; }
    get pressed() { return this._now.pressed; }
    get touched() { return this._now.touched; }
  }

  class GamepadHapticActuator {
    constructor(hand) {
      this._hand = hand;
      this.type = 'vibration';
      this.effects = ['dual-rumble'];
    }
    pulse(value, duration) {
      const amplitude = Math.min(1, Math.max(0, Number(value) || 0));
      const wished_ms = Number(duration);
      const lasting_ms = Number.isFinite(wished_ms) ? Math.max(0, wished_ms) : 0;
      push(sim.haptics, [this._hand, amplitude, lasting_ms / 1e3]);
      return Promise.resolve(true);
    }
    playEffect(_type, { duration = 0, strongMagnitude = 0, weakMagnitude = 0 } = {}) {
      return this.pulse(Math.max(strongMagnitude, weakMagnitude), duration).then(() => 'complete');
    }
    reset() { return this.pulse(0, 0).then(() => 'complete'); }
  }

  class Gamepad {
    constructor(hand, buttons, axes) {
      this.id = '';
      this.index = -1;
      this.connected = true;
      this.mapping = 'xr-standard';
      this._axes = Array.from({ length: axes }, () => 0);
      this.buttons = Array.from({ length: buttons }, (_, k) => new GamepadButton(BUTTONS[k]));
      this.vibrationActuator = new GamepadHapticActuator(hand);
      this.hapticActuators = [this.vibrationActuator];
    }
    get axes() {
      sim.parts.add('thumbstick');
      return this._axes;
    }
    get timestamp() { return sim.now(); }
  }

  class XRInputSource {
    constructor(hand) {
      const touch = sim.settings.profile === 'oculus-touch';
      this.handedness = hand;
      this.targetRayMode = 'tracked-pointer';
      this.profiles = PROFILES[sim.settings.profile];
      this.skipRendering = false;
      this.gripSpace = new XRSpace((state) => state[hand]);
      this.targetRaySpace = new XRSpace((state) => state[hand] && compose(state[hand], GRIP_TO_RAY));
      this.gamepad = new Gamepad(hand, touch ? 7 : 1, touch ? 4 : 0);
    }

    // Takes a row of inputs; returns the names of the events that it means.
    _take(row) {
      const { buttons, _axes: axes } = this.gamepad;
      const pressed = (k) => buttons[k]?._state.pressed ?? false;
      const before = [pressed(0), pressed(1)];
      const at = (name) => (row ? row[COLUMN[name]] : 0);
      buttons[0]._set(at('trigger'), at('triggerTouch'));
      if (buttons.length > 1) {
        buttons[1]._set(at('squeeze'), 0);
        buttons[3]._set(at('stickClick'), at('stickTouch'));
        buttons[4]._set(at('lower'), at('lowerTouch'));
        buttons[5]._set(at('upper'), at('upperTouch'));
        buttons[6]._set(0, at('restTouch'));
        axes[2] = at('stickX');
        axes[3] = 0 - at('stickY'); // WebXR: down is positive
      }
      const events = [];
      forEach(['select', 'squeeze'], (name, k) => {
        const is = pressed(k);
        if (is && !before[k]) push(events, `${name}start`);
        if (!is && before[k]) push(events, name, `${name}end`);
      });
      return events;
    }
  }
  Object.assign(sim.classes, { XRInputSource });
}
