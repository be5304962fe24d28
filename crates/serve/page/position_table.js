// Shows the position: in work coordinates, in machine coordinates, and the distance to go.
//
// Invariant: figures keep their places; without a link they are the last ones, in grey.

import { element, setAttribute, setChildren, setText } from './element.js';
import { formatPosition, lengthUnit } from './units.js';
import { onSettingChange } from './settings.js';

const HOMING_TEXTS = { homed: 'homed', not_homed: 'not homed', not_needed: '' };
const HOMING_SIGNS = { homed: '✓', not_homed: '?', not_needed: '' };

/** Table with one row an axis. Tapping an axis opens its zero. */
export class PositionTable {
  constructor(place, store, { openZero }) {
    Object.assign(this, { place, store, openZero });
    this.rows = [];
    this.keyAxis = 0;
    store.on('hello', hello => this.build(hello));
    store.on('state', () => this.showHoming());
    onSettingChange(() => {
      if (store.hello) this.build(store.hello);
    });
  }

  build(hello) {
    this.rows = hello.machine.axes.map(axis => {
      const name = axis.letter.toUpperCase();
      const homing = element('small'),
        keys = element('small', { class: 'jog-keys', title: `The keys [ and ] jog ${name}`, text: '[ ]' });
      const letter = element(
        'button',
        {
          type: 'button',
          class: 'axis',
          'aria-label': `Zero of ${name}`,
          on: { click: () => this.openZero(axis.letter) },
        },
        name,
        homing,
        keys,
      );
      const work = element('td', { class: 'work' }),
        machine = element('td'),
        toGo = element('td');
      return {
        axis,
        homing,
        keys,
        work,
        machine,
        toGo,
        row: element('tr', {}, element('th', { scope: 'row' }, letter), work, machine, toGo),
      };
    });
    const head = element(
      'thead',
      {},
      element(
        'tr',
        {},
        element('th', { scope: 'col', text: lengthUnit() }),
        ...['work', 'machine', 'to go'].map(text => element('th', { scope: 'col', text })),
      ),
    );
    this.place.classList.toggle('many', this.rows.length > 3);
    setChildren(this.place, element('table', {}, head, element('tbody', {}, ...this.rows.map(row => row.row))));
    this.showHoming();
    this.showKeyAxis();
    this.show();
  }

  /** Sets the axis that the keys [ and ] jog. */
  setKeyAxis(index) {
    this.keyAxis = index;
    this.showKeyAxis();
  }

  showKeyAxis() {
    this.rows.forEach((row, index) => {
      row.keys.hidden = index !== this.keyAxis;
    });
  }

  showHoming() {
    const homing = this.store.state?.homing ?? [];
    this.rows.forEach((row, index) => {
      setText(row.homing, HOMING_SIGNS[homing[index]] ?? '');
      setAttribute(row.homing, 'title', HOMING_TEXTS[homing[index]] || null);
      setAttribute(row.homing, 'aria-label', HOMING_TEXTS[homing[index]] || null);
      if (row.homing.hasAttribute('aria-label')) row.homing.setAttribute('role', 'img');
    });
  }

  /** Shows the newest live figures; called once a frame. */
  show() {
    const { live } = this.store;
    if (!live) return;
    this.rows.forEach(({ axis, work, machine, toGo }, index) => {
      setText(work, formatPosition(live.work[index], axis.is_linear));
      setText(machine, formatPosition(live.mm[index], axis.is_linear));
      setText(toGo, formatPosition(live.to_go?.[index], axis.is_linear));
    });
  }
}
