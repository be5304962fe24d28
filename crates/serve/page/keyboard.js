// Keys of the page: those of the server's key table, and HOLD.
//
// Invariant: Space is HOLD wherever the focus is; only in the MDI text it is a space, and Esc is HOLD there. A key that
// moves acts on its first press and ignores repetitions. In text fields no other key is an action.

import { closeDialog, dialogIsModal, dialogIsOpen } from './dialog.js';

const PAN_PIXELS = 60;
const REPEATABLE = new Set(['faster', 'slower', 'zoom-in', 'zoom-out']);
const JOG_KEYS = {
  ArrowLeft: ['x', false],
  ArrowRight: ['x', true],
  ArrowDown: ['y', false],
  ArrowUp: ['y', true],
  PageDown: ['z', false],
  PageUp: ['z', true],
  '[': [null, false],
  ']': [null, true],
};
const WHEEL_COUNTS = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1, PageDown: -10, PageUp: 10 };
const PAN_KEYS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const DIALOG_ACTIONS = new Set(['hold', 'agree', 'decline', 'cutter-off', 'clear-alarm']);

const isText = node =>
  node instanceof HTMLElement && (node.matches('input:not([type=file]), textarea') || node.isContentEditable);

/** Follows the keyboard. `jogPad`, `pathView` and `scrubber` are the parts that keys move. */
export class Keyboard {
  constructor(store, orders, actions, { jogPad, pathView }) {
    Object.assign(this, { store, orders, actions, jogPad, pathView });
    this.jogKey = null;
    addEventListener('keydown', event => this.keyDown(event), true);
    addEventListener('keyup', event => this.keyUp(event), true);
  }

  keyDown(event) {
    const isMdi = event.target instanceof HTMLElement && event.target.matches('.mdi-text');
    if ((event.key === ' ' && !isMdi) || (event.key === 'Escape' && isMdi)) {
      // A button that has the focus must not be clicked by the Space that holds.
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) this.orders.hold();
      return;
    }
    if (event.ctrlKey || event.altKey || event.metaKey || isText(event.target)) return;
    if (event.target instanceof HTMLElement && event.target.matches('select')) return;
    if (event.key === 'Escape') {
      this.escape(event);
      return;
    }
    if (this.moves(event)) {
      event.preventDefault();
      return;
    }
    const action = this.actionOf(event.key);
    if (!action || (dialogIsModal() && !DIALOG_ACTIONS.has(action.id))) return;
    event.preventDefault();
    if (event.repeat && !REPEATABLE.has(action.id)) return;
    if (action.id === 'agree' && dialogIsOpen()) closeDialog();
    if (!this.actions.perform(action.id))
      this.orders.notices.inform(`${action.label} (${event.key}) is not possible now.`);
  }

  escape(event) {
    if (!dialogIsOpen()) return;
    event.preventDefault();
    closeDialog();
  }

  keyUp(event) {
    const isMdi = event.target instanceof HTMLElement && event.target.matches('.mdi-text');
    if (event.key === ' ' && !isMdi) {
      event.preventDefault();
      event.stopPropagation();
    }
    if (this.jogKey === event.key) {
      this.jogKey = null;
      this.jogPad.end();
    }
  }

  /** Keys that turn the wheel, jog or pan, where no list, tab strip or slider has the focus. */
  moves(event) {
    const isArrow = event.key.startsWith('Arrow') || event.key.startsWith('Page');
    const takesArrows =
      event.target instanceof HTMLElement && event.target.closest('.list, [role=tablist], .track, .dialog');
    if (event.shiftKey && PAN_KEYS[event.key]) {
      const [x, y] = PAN_KEYS[event.key];
      this.pathView.panBy(x * PAN_PIXELS, y * PAN_PIXELS);
      return true;
    }
    if ((isArrow && takesArrows) || dialogIsModal()) return false;
    if (isArrow && this.store.state?.mode === 'wheel' && this.store.state.stage === 'job') {
      this.orders.turnWheel(WHEEL_COUNTS[event.key] ?? 0);
      return true;
    }
    const jog = JOG_KEYS[event.key];
    if (!jog || !this.store.allows('jog')) return false;
    if (!event.repeat && this.jogPad.beginByKey(...jog)) this.jogKey = event.key;
    return true;
  }

  /** Action of a key: one that is possible now, otherwise any with this key. */
  actionOf(key) {
    const rows = this.store.hello?.actions.filter(action => action.keys.includes(key)) ?? [];
    return rows.find(action => this.actions.isPossible(action.id)) ?? rows[0];
  }
}
