// Shows the height of the tool as path, layer and sum, and what height control does, with its keys.
//
// Invariant: a figure that is not known is a dash. What the machine does not have is not shown.

import { button, element, isOff, setAttribute, setOff, setText } from './element.js';
import { changeSetting, setting } from './settings.js';
import { formatPosition, lengthUnit } from './units.js';

/** What height control does: in a word, and in a sentence. */
const HEIGHT_WORDS = {
  off: ['off', 'Height control is off: nothing is cut'],
  waiting: ['waiting', 'Height control waits for its delay and the feed'],
  active: ['active', 'Height control moves the torch'],
  held: ['held', 'The height is held: a corner, a void, a kerf, or the program'],
  at_limit: ['AT LIMIT', 'The torch is at the end of its range'],
  external: ['external', 'The external controller moves the torch: its height is not known here'],
  stopped: ['OFF', 'The operator has switched height control off'],
};
const KEYS = [
  ['height-down', '−', 'Torch lower'],
  ['height-up', '+', 'Torch higher'],
  ['height-reset', '0', 'Voltage of the material'],
  ['height-control', 'THC', 'Height control on, off'],
];

/** Figures of the height, and the row of height control. A tap on the row opens and closes the chart. */
export class HeightLine {
  constructor(store, actions) {
    this.store = store;
    const figure = name => {
      const value = element('b');
      return { value, node: element('span', { class: 'figure' }, `${name} `, value) };
    };
    this.unit = element('small');
    this.path = figure('path');
    this.axis = element('span');
    this.path.node.prepend(this.axis, ' ');
    this.layer = figure('layer');
    this.sum = figure('sum');
    this.sum.node.append(' ', this.unit);
    this.overSheet = figure('over sheet');
    this.figures = element(
      'div',
      { class: 'figures tool-height' },
      this.path.node,
      this.layer.node,
      this.sum.node,
      this.overSheet.node,
    );
    this.text = element('span', { class: 'height-text' });
    this.sign = element('span', { 'aria-hidden': 'true' });
    this.opener = button(
      '',
      () => changeSetting('heightChart', setting('heightChart') === 'open' ? 'closed' : 'open'),
      { class: 'height-opener', 'aria-controls': 'height-chart', 'aria-expanded': 'false' },
      this.text,
      this.sign,
    );
    this.keys = KEYS.map(([id, label, title]) => {
      const press = event => !isOff(event.currentTarget) && actions.perform(id);
      return { id, node: button(label, press, { 'aria-label': title, title }) };
    });
    this.row = element(
      'div',
      { class: 'height-line', role: 'group', 'aria-label': 'Height control' },
      this.opener,
      ...this.keys.map(key => key.node),
    );
    this.node = element('div', { class: 'height-lines' }, this.figures, this.row);
    this.node.hidden = true;
  }

  /** Shows the newest live figures; called once a frame. */
  show(live) {
    const layer = live?.layer;
    this.node.hidden = !layer;
    if (!layer) return;
    const sum = layer.layer_mm === null ? null : live.work[layer.axis];
    setText(this.axis, this.store.axis(layer.axis)?.letter.toUpperCase() ?? '');
    setText(this.path.value, formatPosition(layer.path_mm));
    setText(this.layer.value, formatPosition(layer.layer_mm));
    setText(this.sum.value, formatPosition(sum));
    setText(this.overSheet.value, formatPosition(layer.over_sheet_mm));
    setText(this.unit, lengthUnit());
    const isOpen = setting('heightChart') === 'open';
    setAttribute(this.opener, 'aria-expanded', String(isOpen));
    setText(this.sign, isOpen ? '▾' : '▸');
    this.showControl(live.height);
  }

  showControl(height) {
    for (const { id, node } of this.keys) {
      node.hidden = !height;
      setOff(node, !this.store.allows(id));
    }
    if (!height) {
      setText(this.text, 'height over time');
      return;
    }
    const acting = height.is_external && height.state === 'active' ? 'external' : height.state,
      state = height.is_on ? acting : 'stopped',
      [word, sentence] = HEIGHT_WORDS[state];
    const parts = [word, height.volts === null ? '– V' : `${height.volts.toFixed(1)} V`];
    if (height.offset_volts !== 0) parts.push(`${height.offset_volts > 0 ? '+' : ''}${height.offset_volts} V`);
    setText(this.text, parts.join(' · '));
    setAttribute(this.opener, 'title', `${sentence}. A tap opens or closes the chart`);
    this.row.dataset.state = state;
    this.keys.at(-1).node.setAttribute('aria-pressed', String(height.is_on));
  }
}
