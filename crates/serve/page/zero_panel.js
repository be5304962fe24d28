// Sets the work zero and selects the coordinate system.
//
// Invariant: every button here is one order; the offsets that are shown follow from the positions of the server.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { formatPosition, lengthUnit, orderNumber, parseLength } from './units.js';
import { onSettingChange } from './settings.js';
import { confirm, prompt } from './dialog.js';

const SYSTEMS = ['G54', 'G55', 'G56', 'G57', 'G58', 'G59', 'G59.1', 'G59.2', 'G59.3'];
const MM_PER_INCH = 25.4;

/** Work zero and offsets. */
export class ZeroPanel {
  constructor(store, orders, actions) {
    Object.assign(this, { store, orders, actions });
    this.body = element('div', { class: 'zero-rows' });
    this.all = button('Zero all here', () => this.zeroAll(), { class: 'main' });
    this.systems = element(
      'select',
      { 'aria-label': 'Coordinate system', on: { change: () => this.selectSystem() } },
      ...SYSTEMS.map(name => element('option', { value: name, text: name })),
    );
    this.sheet = button('Sheet edge …', () => this.takeSheetPoint());
    this.node = element(
      'div',
      { class: 'column' },
      this.body,
      element('div', { class: 'row' }, this.systems, this.sheet, this.all),
    );
    store.on('hello', hello => this.build(hello));
    store.on('state control link', () => this.showState());
    onSettingChange(() => {
      if (store.hello) this.build(store.hello);
    });
  }

  onShow() {
    this.show();
  }

  build(hello) {
    this.rows = hello.machine.axes.map((axis, index) => {
      const name = axis.letter.toUpperCase(),
        offset = element('span', { class: 'zero-offset' });
      const zero = button(`Zero ${name}`, () => {
        if (!isOff(zero)) this.orders.send(`zero ${axis.letter}`);
      });
      const set = button(
        'Set …',
        () => {
          if (!isOff(set)) this.setTo(axis);
        },
        { 'aria-label': `Set ${name} to a value` },
      );
      const home = button(
        'Home',
        () => {
          if (!isOff(home)) this.orders.send(`home ${axis.letter}`);
        },
        { 'aria-label': `Home ${name}` },
      );
      return {
        axis,
        index,
        offset,
        buttons: { zero, set, home },
        node: element('div', { class: 'zero-row' }, element('b', { text: name }), offset, zero, set, home),
      };
    });
    setChildren(this.body, ...this.rows.map(row => row.node));
    this.showState();
    this.show();
  }

  zeroAll() {
    if (isOff(this.all)) return;
    confirm({
      title: 'Set the work zero of all axes here?',
      label: 'Zero all',
      danger: false,
      run: () => this.orders.send('zero'),
    });
  }

  takeSheetPoint() {
    if (!isOff(this.sheet)) this.actions.perform('sheet-edge');
  }

  setTo(axis) {
    const name = axis.letter.toUpperCase();
    prompt({
      title: `Work position of ${name} here`,
      text: axis.is_linear ? `In ${lengthUnit()}` : 'In degrees',
      label: 'Set',
      value: '0',
      inputMode: 'decimal',
      check: text => (parseLength(text) === null ? 'Enter a number.' : null),
      run: text => {
        const isInchProgram = /\bG20\b/.test(this.store.state.modal);
        const value = axis.is_linear
          ? parseLength(text) / (isInchProgram ? MM_PER_INCH : 1)
          : Number(text.replace(',', '.'));
        this.orders.send(`mdi G10 L20 P0 ${name}${orderNumber(value)}`);
      },
    });
  }

  selectSystem() {
    if (this.store.allows('mdi')) this.orders.send(`mdi ${this.systems.value}`);
    this.showState();
  }

  showState() {
    const system = /\bG5[4-9](\.[1-3])?\b/.exec(this.store.state?.modal ?? '')?.[0];
    if (system) this.systems.value = system;
    this.systems.disabled = !this.store.allows('mdi');
    const mayZero = this.store.allows('work-zero');
    setOff(this.all, !mayZero);
    setOff(this.sheet, !this.store.allows('sheet-edge'));
    for (const { buttons } of this.rows ?? []) {
      setOff(buttons.zero, !mayZero);
      setOff(buttons.set, !this.store.allows('mdi'));
      setOff(buttons.home, !this.store.allows('home'));
    }
  }

  /** Shows the newest live figures; called once a frame while it is in view. */
  show() {
    const { live } = this.store;
    for (const { axis, index, offset } of this.rows ?? []) {
      if (live) setText(offset, formatPosition(live.mm[index] - live.work[index], axis.is_linear));
    }
  }
}
