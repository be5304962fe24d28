// The footer: HOLD, reverse, forward, handwheel, cycle start, STOP.
//
// Invariant: HOLD acts on pointer down, for every page, with or without control, and nothing covers it. STOP acts
// after it was held for half a second. Neither is an emergency stop.

import { element, isOff, setOff, setText, svgElement } from './element.js';
import { prefersLittleMotion } from './settings.js';
import { sign } from './signs.js';

const STOP_HELD_MS = 500;
const KEYS = [
  { id: 'reverse', label: 'REVERSE' },
  { id: 'forward', label: 'FORWARD' },
  { id: 'wheel', label: 'WHEEL' },
  { id: 'cycle-start', label: 'CYCLE START', sign: 'run', class: 'start' },
];

/** Keys of motion, always in the same place. */
export class MotionKeys {
  constructor(place, store, actions, orders) {
    Object.assign(this, { store, actions, orders });
    this.keys = KEYS.map(key => {
      const hint = element('small');
      const node = element(
        'button',
        {
          type: 'button',
          class: `motion ${key.class ?? key.id}`,
          on: {
            click: () => {
              if (!isOff(node)) actions.perform(key.id);
            },
          },
        },
        sign(key.sign ?? key.id),
        element('span', { text: key.label }),
        hint,
      );
      return { ...key, node, hint };
    });
    place.append(this.makeHold(), ...this.keys.map(key => key.node), this.makeStop());
    store.on('state control link hello', () => this.show());
    this.show();
  }

  makeHold() {
    const hint = element('small', { text: 'Space' });
    const node = element(
      'button',
      { type: 'button', class: 'motion hold', title: 'Feed hold' },
      sign('hold'),
      element('span', { text: 'HOLD' }),
      hint,
    );
    node.addEventListener('pointerdown', event => {
      event.preventDefault();
      this.orders.hold();
    });
    // A click without a pointer comes from the keyboard or from an assistive device.
    node.addEventListener('click', event => {
      if (event.detail === 0) this.orders.hold();
    });
    node.addEventListener('contextmenu', event => event.preventDefault());
    return node;
  }

  makeStop() {
    const ring = svgElement('circle', { class: 'ring', cx: 12, cy: 12, r: 10, pathLength: 100 });
    const node = (this.stop = element(
      'button',
      { type: 'button', class: 'motion stop', title: 'Ends the job; hold for half a second' },
      svgElement(
        'svg',
        { class: 'sign', viewBox: '0 0 24 24', 'aria-hidden': 'true' },
        svgElement('path', { d: 'M7 7h10v10H7z' }),
        ring,
      ),
      element('span', { text: 'STOP' }),
      element('small', { text: 'hold ½ s' }),
    ));
    let timer = null;
    const end = () => {
      clearTimeout(timer);
      timer = null;
      node.classList.remove('held');
    };
    const begin = () => {
      if (isOff(node) || timer) return;
      node.classList.toggle('still', prefersLittleMotion());
      node.classList.add('held');
      timer = setTimeout(() => {
        end();
        if (!isOff(node)) this.orders.send('stop');
      }, STOP_HELD_MS);
    };
    node.addEventListener('pointerdown', event => {
      node.setPointerCapture(event.pointerId);
      begin();
    });
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture', 'blur']) node.addEventListener(name, end);
    node.addEventListener('pointermove', event => {
      const box = node.getBoundingClientRect();
      const isInside =
        event.clientX >= box.left &&
        event.clientX <= box.right &&
        event.clientY >= box.top &&
        event.clientY <= box.bottom;
      if (!isInside) end();
    });
    node.addEventListener('keydown', event => {
      if (event.key === 'Enter' && !event.repeat) begin();
    });
    node.addEventListener('keyup', event => {
      if (event.key === 'Enter') end();
    });
    node.addEventListener('contextmenu', event => event.preventDefault());
    addEventListener('blur', end);
    return node;
  }

  show() {
    const { state } = this.store;
    for (const { id, node, hint } of this.keys) {
      setOff(node, !this.actions.isPossible(id));
      node.classList.toggle('active', state?.mode === id && this.store.isLive);
      // Where a cut is interrupted, cycle start is not the way on: it would light the cutter where the machine stands.
      const isNear = id === 'cycle-start' && state?.suggested?.[0] !== 'recover';
      const first = state?.suggested?.slice(0, isNear ? 3 : 1) ?? [];
      node.classList.toggle('suggested', first.includes(id) && this.actions.isPossible(id));
      setText(hint, this.actions.keyText(id));
    }
    setOff(this.stop, !this.actions.isPossible('quit'));
    // At the end of the program there is nothing left to stop: it only releases the job.
    this.stop.classList.toggle('calm', state?.hold_reason === 'end of program');
  }
}
