// The jog pad: continuous jogs held to run at the jog speed or slowly, steps, home, pause.
//
// Invariant: a jog lives by beats from the main thread of this page, each 50 ms. Whatever ends the touch (finger up or
// lost, a second finger, focus lost, page hidden, link lost) ends the beats and sends the end of the jog. The axis that
// the keys [ and ] jog is changed by Tab alone, and shown beside its position.

import { button, element, isOff, setChildren, setOff } from './element.js';
import { confirm } from './dialog.js';
import { feedUnit, formatFeed, formatStep, jogSteps, orderNumber } from './units.js';
import { onSettingChange } from './settings.js';
import { sign } from './signs.js';

const BEAT_MS = 50;
/** Places of the axes beside X, Y and Z on the pad; further ones follow below. */
const OTHER_PLACES = ['first', 'second'];
const PAD = { x: ['left', 'right'], y: ['down', 'up'] };

/** Jog pad. */
export class JogPad {
  constructor(store, orders, actions) {
    Object.assign(this, { store, orders, actions });
    /** What a press does: one of `choices`, `{mm}` for a step or `{speed, share}` for a jog that is held to run. */
    this.choiceIndex = 0;
    this.axisIndex = 0;
    /** Is told the axis that [ and ] jog. */
    this.onKeyAxis = () => {};
    this.beatNumber = 0;
    this.held = null;
    this.pad = element('div', { class: 'jog-pad', role: 'group', 'aria-label': 'Jog' });
    this.steps = element('div', { class: 'jog-steps', role: 'radiogroup', 'aria-label': 'Jog step' });
    this.home = button('Home', () => this.askHome(), { class: 'jog-home' });
    this.zero = button('Zero …', () => actions.perform('work-zero'), { class: 'jog-zero' });
    this.node = element('div', { class: 'column jog' }, this.steps, this.pad);
    store.on('hello', hello => this.build(hello));
    store.on('state control link', () => this.showState());
    onSettingChange(() => {
      if (store.hello) this.build(store.hello);
    });
    for (const name of ['blur', 'pagehide']) addEventListener(name, () => this.end());
    document.addEventListener('visibilitychange', () => this.end());
    document.addEventListener(
      'pointerdown',
      event => {
        if (!event.isPrimary) this.end();
      },
      true,
    );
    store.on('link', () => {
      if (!store.isLive) this.end();
    });
    actions.register({ step: () => this.nextStep(), 'next-axis': () => this.nextAxis() });
  }

  build(hello) {
    const held = [
      { label: 'held', speed: 'full', share: 1 },
      { label: 'slow', speed: 'slow', share: hello.slow_jog_share },
    ];
    this.choices = [...held, ...jogSteps(hello.jog_steps_mm).map(mm => ({ mm, label: formatStep(mm) }))];
    this.stepButtons = this.choices.map(({ label }, index) =>
      element('button', { type: 'button', role: 'radio', on: { click: () => this.choose(index) } }, label),
    );
    setChildren(this.steps, ...this.stepButtons);
    this.keys = hello.machine.axes.flatMap((axis, index) => [false, true].map(up => this.jogKey(axis, index, up)));
    setChildren(this.pad, ...this.keys.map(key => key.node), this.zero, this.home);
    this.pad.dataset.axes = String(hello.machine.axes.length);
    if (this.choiceIndex >= this.choices.length) this.choiceIndex = 0;
    this.axisIndex = Math.min(this.axisIndex, hello.machine.axes.length - 1);
    this.onKeyAxis(this.axisIndex);
    this.setChoice(this.choiceIndex);
    this.showState();
  }

  /** Place of an axis on the pad. */
  placeOf({ letter }) {
    if ('xyz'.includes(letter)) return letter;
    const others = this.store.hello.machine.axes.filter(axis => !'xyz'.includes(axis.letter));
    return OTHER_PLACES[others.findIndex(axis => axis.letter === letter)] ?? 'further';
  }

  jogKey(axis, index, up) {
    const name = `${axis.letter.toUpperCase()}${up ? '+' : '\u2212'}`,
      place = PAD[axis.letter]?.[Number(up)];
    const node = element(
      'button',
      {
        type: 'button',
        class: `jog-key ${this.placeOf(axis)}-${up ? 'up' : 'down'}`,
        'aria-label': `Jog ${axis.letter.toUpperCase()} ${up ? 'positive' : 'negative'}`,
      },
      sign(place ?? (up ? 'up' : 'down')),
      element('span', { text: name }),
    );
    const key = { axis: axis.letter, index, up, node };
    node.addEventListener('pointerdown', event => {
      if (!event.isPrimary || event.button !== 0 || isOff(node)) return;
      if (this.chosen.speed) node.setPointerCapture(event.pointerId);
      this.begin(key);
    });
    for (const event of ['pointerup', 'pointercancel', 'lostpointercapture'])
      node.addEventListener(event, () => this.end());
    node.addEventListener('keydown', event => {
      if (event.key === 'Enter' && !event.repeat && !isOff(node)) {
        event.preventDefault();
        this.begin(key);
      }
    });
    node.addEventListener('keyup', event => {
      if (event.key === 'Enter') this.end();
    });
    node.addEventListener('blur', () => {
      if (this.held?.key === key) this.end();
    });
    node.addEventListener('contextmenu', event => event.preventDefault());
    return key;
  }

  askHome() {
    if (isOff(this.home)) return;
    confirm({ title: 'Home all axes?', label: 'Home', danger: false, run: () => this.actions.perform('home') });
  }

  /** Whether an axis may be jogged now. */
  isPossible() {
    return this.store.allows('jog');
  }

  /** Begins a jog of an axis: a step, or continuous until `end`. */
  begin(key) {
    if (!this.isPossible()) return;
    this.end();
    const { mm, speed } = this.chosen;
    if (speed === undefined) {
      this.orders.send(`jog ${key.axis} ${orderNumber(key.up ? mm : -mm)}`);
      return;
    }
    const number = ++this.beatNumber;
    const held = (this.held = { key, number });
    key.node.classList.add('held');
    this.orders.startJog(key.axis, key.up, speed, number).then(isStarted => {
      if (!isStarted && this.held === held) this.end();
    });
    held.timer = setInterval(() => this.orders.beat(number), BEAT_MS);
  }

  /** Ends the jog. */
  end() {
    if (!this.held) return;
    clearInterval(this.held.timer);
    this.held.key.node.classList.remove('held');
    this.held = null;
    this.orders.endJog();
  }

  /** Begins a jog by a key of the keyboard: an axis by its number or letter. */
  beginByKey(axis, up) {
    const index = axis ?? this.store.hello?.machine.axes[this.axisIndex]?.letter;
    const key = this.keys?.find(each => each.axis === index && each.up === up);
    if (key) this.begin(key);
    return key !== undefined;
  }

  get chosen() {
    return this.choices[this.choiceIndex];
  }

  setChoice(index) {
    this.choiceIndex = index;
    this.stepButtons.forEach((node, place) => node.setAttribute('aria-checked', String(place === index)));
  }

  /** Chooses a step or a speed, and says how far or how fast a jog goes then. */
  choose(index) {
    this.end();
    this.setChoice(index);
    const { label, share } = this.chosen;
    this.orders.notices.inform(
      share === undefined ? `Jog step: ${label}` : `Jog: held to run, ${this.heldSpeeds(share)}`,
    );
  }

  /** Speeds of a held jog, axes of the same speed together: `X Y 3000 mm/min, Z 900 mm/min`. */
  heldSpeeds(share) {
    const letters = new Map();
    for (const { letter, is_linear, jog_mm_s } of this.store.hello.machine.axes) {
      const perMinute = 60 * jog_mm_s * share;
      const [feed, unit] = is_linear ? [formatFeed(perMinute), feedUnit()] : [perMinute.toFixed(0), '°/min'];
      const speed = `${feed} ${unit}`;
      letters.set(speed, [...(letters.get(speed) ?? []), letter.toUpperCase()]);
    }
    return [...letters].map(([speed, axes]) => `${axes.join(' ')} ${speed}`).join(', ');
  }

  nextStep() {
    this.choose((this.choiceIndex + 1) % this.choices.length);
  }

  nextAxis() {
    const axes = this.store.hello.machine.axes;
    this.axisIndex = (this.axisIndex + 1) % axes.length;
    this.onKeyAxis(this.axisIndex);
    this.orders.notices.inform(`[ and ] jog axis ${axes[this.axisIndex].letter.toUpperCase()}`);
  }

  showState() {
    if (!this.keys) return;
    const isPossible = this.isPossible();
    if (!isPossible) this.endIfRefused();
    for (const { node } of this.keys) setOff(node, !isPossible && this.held === null);
    setOff(this.home, !this.actions.isPossible('home'));
  }

  /** Ends a jog whose right to move is gone; while it runs, the server may take `jog` from what is possible. */
  endIfRefused() {
    if (this.held && !this.store.isHolder) this.end();
  }
}
