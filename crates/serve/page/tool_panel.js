// Shows the tool table; the tool in the spindle is marked.
//
// Invariant: it changes nothing but the length of a tool that is changed in a pause, by an order.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { formatPosition, lengthUnit } from './units.js';
import { onSettingChange } from './settings.js';

/** Tools. */
export class ToolPanel {
  constructor(store, connection, orders, actions) {
    Object.assign(this, { store, connection, orders });
    this.tools = [];
    this.title = element('p', { class: 'list-title' });
    this.length = button('Length of a new tool …', () => {
      if (!isOff(this.length)) actions.perform('tool-length');
    });
    this.table = element('div', { class: 'list', tabindex: '0', role: 'region', 'aria-label': 'Tools' });
    this.node = element(
      'div',
      { class: 'column' },
      element('div', { class: 'list-head' }, this.title, this.length),
      this.table,
    );
    store.on('state control link', () => this.showState());
    onSettingChange(() => this.showTable());
  }

  async onShow() {
    try {
      this.tools = (await this.connection.request('GET', '/api/v1/tools')).tools;
    } catch (error) {
      this.orders.notices.refuse(error);
    }
    this.showTable();
  }

  showTable() {
    const current = (this.shownTool = this.store.state?.tool);
    const head = ['', 'tool', 'name', `diameter, ${lengthUnit()}`, `length, ${lengthUnit()}`];
    setText(this.title, this.tools.length > 0 ? `${this.tools.length} tools` : 'no tool table');
    setChildren(
      this.table,
      this.tools.length === 0
        ? null
        : element(
            'table',
            { class: 'wide' },
            element(
              'thead',
              {},
              element('tr', {}, ...head.map(text => (text ? element('th', { scope: 'col', text }) : element('td')))),
            ),
            element(
              'tbody',
              {},
              ...this.tools.map(tool =>
                element(
                  'tr',
                  { class: tool.number === current ? 'now' : null },
                  element('td', { text: tool.number === current ? '▸' : '' }),
                  element('th', { scope: 'row', text: `T${tool.number}` }),
                  element('td', { text: tool.name ?? '' }),
                  element('td', { class: 'figure-cell', text: formatPosition(tool.diameter_mm) }),
                  element('td', { class: 'figure-cell', text: formatPosition(tool.length_mm) }),
                ),
              ),
            ),
          ),
    );
  }

  showState() {
    setOff(this.length, !this.store.allows('tool-length'));
    if (this.store.state?.tool !== this.shownTool) this.showTable();
  }
}
