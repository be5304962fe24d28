// Shows the tool table and changes lengths and diameters; the tool in the spindle is marked.
//
// Invariant: a value is changed by one request that names the version it was read in; nothing is shown as changed
// before the server has it.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { formatPosition, lengthUnit } from './units.js';
import { changeTable, enterValue } from './table_change.js';
import { onSettingChange } from './settings.js';
import { prompt } from './dialog.js';

/** Tools. */
export class ToolPanel {
  constructor(store, connection, orders, actions) {
    Object.assign(this, { store, connection, orders });
    this.tools = [];
    this.cells = [];
    this.title = element('p', { class: 'list-title' });
    this.length = button('Length of a new tool …', () => {
      if (!isOff(this.length)) actions.perform('tool-length');
    });
    this.add = button('Add …', () => {
      if (!isOff(this.add)) this.addTool();
    });
    this.add.setAttribute('aria-label', 'Add a tool');
    this.table = element('div', { class: 'list', tabindex: '0', role: 'region', 'aria-label': 'Tools' });
    this.node = element(
      'div',
      { class: 'column' },
      element('div', { class: 'list-head' }, this.title, this.add, this.length),
      this.table,
    );
    store.on('state control link', () => this.showState());
    onSettingChange(() => this.showTable());
  }

  async onShow() {
    try {
      const { value, version } = await this.connection.read('/api/v1/tools');
      Object.assign(this, { tools: value.tools, inUse: value.in_use, version });
    } catch (error) {
      this.orders.notices.refuse(error);
    }
    this.showTable();
  }

  showTable() {
    const current = (this.shownTool = this.store.state?.tool);
    const head = ['', 'tool', 'name', `diameter, ${lengthUnit()}`, `length, ${lengthUnit()}`];
    this.cells = [];
    setText(this.title, this.tools.length > 0 ? `${this.tools.length} tools · tap a figure to change it` : 'no tools');
    setChildren(
      this.table,
      this.tools.length === 0
        ? null
        : element(
            'table',
            { class: 'wide values' },
            element(
              'thead',
              {},
              element('tr', {}, ...head.map(text => (text ? element('th', { scope: 'col', text }) : element('td')))),
            ),
            element('tbody', {}, ...this.tools.map(tool => this.row(tool, tool.number === current))),
          ),
    );
    this.showState();
  }

  row(tool, isNow) {
    return element(
      'tr',
      { class: isNow ? 'now' : null },
      element('td', { text: isNow ? '▸' : '' }),
      element('th', { scope: 'row', text: `T${tool.number}` }),
      element('td', { text: tool.name ?? '' }),
      element('td', {}, this.cell(tool, 'diameter', 'diameter_mm', 0)),
      element('td', {}, this.cell(tool, 'length', 'length_mm', -Infinity)),
    );
  }

  cell(tool, name, field, least) {
    const title = `T${tool.number} ${name}`,
      text = formatPosition(tool[field]);
    const node = button(
      text,
      () => {
        if (isOff(node)) return;
        enterValue({
          title,
          value: tool[field],
          least,
          run: value => this.change({ ...tool, [field]: value }),
        });
      },
      { class: 'value', 'aria-label': `${title}: ${text}` },
    );
    this.cells.push(node);
    return node;
  }

  addTool() {
    const known = new Set(this.tools.map(tool => tool.number));
    prompt({
      title: 'Number of the new tool',
      label: 'Add',
      inputMode: 'numeric',
      check: text => {
        if (!/^[1-9]\d{0,4}$/.test(text.trim())) return 'Enter a number from 1 to 99999.';
        return known.has(Number(text)) ? 'There is a tool of this number.' : null;
      },
      run: text => this.change({ number: Number(text), diameter_mm: 0, length_mm: 0 }),
    });
  }

  async change({ number, diameter_mm, length_mm }) {
    await changeTable(this, '/api/v1/tools', { tools: [{ number, diameter_mm, length_mm }] });
    this.onShow();
  }

  showState() {
    setOff(this.length, !this.store.allows('tool-length'));
    for (const node of [this.add, ...this.cells]) setOff(node, !this.store.allows('work-zero'));
    if (this.store.state?.tool !== this.shownTool) this.showTable();
  }
}
