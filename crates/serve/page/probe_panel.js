// Calls a probing cycle with its lengths.
//
// Invariant: a cycle is called only by its button, once each; lengths are sent in mm.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { lengthUnit, orderNumber, parseLength } from './units.js';
import { onSettingChange } from './settings.js';

const SIDES = ['x+', 'x-', 'y+', 'y-'];
const OFFSETS = ['G54', 'G55', 'G56', 'G57', 'G58', 'G59', 'G59.1', 'G59.2', 'G59.3'];
const direction = (words, name = 'Direction') => ({ name, words });
const length = (name, value = '') => ({ name, value });

/** Cycles with their arguments in the order of the server, and whether they set a work offset. */
const CYCLES = [
  { word: 'surface', name: 'Surface', fields: [direction(['z-', 'z+', ...SIDES]), length('Max. travel')], sets: true },
  { word: 'edge', name: 'Edge', fields: [direction(SIDES), length('Distance out'), length('Depth')], sets: true },
  {
    word: 'outside-corner',
    name: 'Outside corner',
    fields: [
      direction(['x+', 'x-'], 'Direction in X'),
      direction(['y+', 'y-'], 'Direction in Y'),
      length('Distance out'),
      length('Depth'),
    ],
    sets: true,
  },
  {
    word: 'inside-corner',
    name: 'Inside corner',
    fields: [
      direction(['x-', 'x+'], 'Direction in X'),
      direction(['y-', 'y+'], 'Direction in Y'),
      length('Max. travel'),
      length('Depth'),
    ],
    sets: true,
  },
  { word: 'bore', name: 'Bore', fields: [length('Diameter'), length('Depth')], sets: true },
  { word: 'boss', name: 'Boss', fields: [length('Diameter'), length('Distance out'), length('Depth')], sets: true },
  { word: 'slot', name: 'Slot', fields: [direction(['x', 'y'], 'Axis'), length('Width'), length('Depth')], sets: true },
  {
    word: 'web',
    name: 'Web',
    fields: [direction(['x', 'y'], 'Axis'), length('Width'), length('Distance out'), length('Depth')],
    sets: true,
  },
  {
    word: 'angle',
    name: 'Angle of an edge',
    fields: [direction(SIDES), length('Distance along'), length('Distance out'), length('Depth')],
    sets: true,
  },
  { word: 'tool-setter', name: 'Tool length, setter', fields: [length('Max. travel')], sets: false },
  {
    word: 'tool-at-work',
    name: 'Tool length, at the work',
    fields: [length('Max. travel'), length('Height', '0')],
    sets: false,
  },
  { word: 'calibrate', name: 'Calibrate the ball', fields: [length('Diameter'), length('Depth')], sets: false },
];

/** Probing cycles. */
export class ProbePanel {
  constructor(store, orders) {
    Object.assign(this, { store, orders });
    this.cycle = element(
      'select',
      { class: 'probe-cycle', 'aria-label': 'Probing cycle', on: { change: () => this.build() } },
      ...CYCLES.map(({ word, name }) => element('option', { value: word, text: name })),
    );
    this.rows = element('div', { class: 'zero-rows' });
    this.run = button('Probe', () => this.probe(), { class: 'main' });
    this.wrong = element('p', { class: 'modal-line', role: 'status' });
    this.node = element(
      'div',
      { class: 'column' },
      element('div', { class: 'row' }, this.cycle, this.run),
      this.rows,
      this.wrong,
    );
    store.on('state control link', () => this.showState());
    onSettingChange(() => this.build());
    this.build();
  }

  get chosen() {
    return CYCLES.find(({ word }) => word === this.cycle.value) ?? CYCLES[0];
  }

  build() {
    const field = ({ name, words, value }) => {
      const label = words ? name : `${name}, ${lengthUnit()}`;
      const node = words
        ? element(
            'select',
            { 'aria-label': label },
            ...words.map(word => element('option', { value: word, text: word.toUpperCase() })),
          )
        : element('input', { type: 'text', 'aria-label': label, inputmode: 'decimal', autocomplete: 'off', value });
      return { label, node, isLength: !words };
    };
    this.fields = this.chosen.fields.map(field);
    this.offset = element(
      'select',
      { 'aria-label': 'Work offset' },
      element('option', { value: '', text: 'none' }),
      ...OFFSETS.map(name => element('option', { value: name, text: name })),
    );
    const row = (label, node) => element('label', { class: 'probe-row' }, element('span', { text: label }), node);
    setChildren(
      this.rows,
      ...this.fields.map(({ label, node }) => row(label, node)),
      ...(this.chosen.sets ? [row('Becomes the zero of', this.offset)] : []),
    );
    setText(this.wrong, '');
    this.showState();
  }

  probe() {
    if (isOff(this.run)) return;
    const values = this.fields.map(({ node, isLength }) => (isLength ? parseLength(node.value) : node.value));
    const missing = this.fields.find((_, index) => values[index] === null);
    if (missing) {
      setText(this.wrong, `Enter a number: ${missing.label}`);
      missing.node.focus();
      return;
    }
    setText(this.wrong, '');
    const words = values.map(value => (typeof value === 'number' ? orderNumber(value) : value));
    const offset = this.chosen.sets && this.offset.value ? [this.offset.value] : [];
    this.orders.send(['probe', this.chosen.word, ...words, ...offset].join(' '));
  }

  showState() {
    setOff(this.run, !this.store.allows('probe'));
  }
}
