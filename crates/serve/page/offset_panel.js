// Shows the offsets of all coordinate systems and of G92, and changes them.
//
// Invariant: a value is changed by one request that names the version it was read in; nothing is shown as changed
// before the server has it.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { formatPosition, lengthUnit } from './units.js';
import { changeTable, enterValue } from './table_change.js';
import { onSettingChange } from './settings.js';

/** Offsets. */
const READ_AGAIN_MS = 1000;

export class OffsetPanel {
  constructor(store, connection, orders) {
    Object.assign(this, { store, connection, orders });
    this.cells = [];
    this.readAt = -Infinity;
    this.title = element('p', { class: 'list-title' });
    this.table = element('div', { class: 'list', tabindex: '0', role: 'region', 'aria-label': 'Offsets' });
    this.node = element('div', { class: 'column' }, element('div', { class: 'list-head' }, this.title), this.table);
    store.on('state control link', () => this.showState());
    store.on('state', () => this.readAgain());
    onSettingChange(() => this.showTable());
  }

  /** Reads the offsets again while they are shown: a block, an edge of a sheet or another page may have changed them. */
  readAgain() {
    if (!this.offsets || this.node.offsetParent === null || this.later) return;
    this.later = setTimeout(
      () => {
        this.later = null;
        if (this.node.offsetParent !== null) this.onShow();
      },
      Math.max(this.readAt + READ_AGAIN_MS - performance.now(), 100),
    );
  }

  async onShow() {
    this.readAt = performance.now();
    try {
      const { value, version } = await this.connection.read('/api/v1/offsets');
      Object.assign(this, { offsets: value, version });
    } catch (error) {
      this.orders.notices.refuse(error);
    }
    this.showTable();
  }

  get system() {
    return /\bG5[4-9](\.[1-3])?\b/.exec(this.store.state?.modal ?? '')?.[0];
  }

  axis(index) {
    const letter = this.offsets.axes[index];
    return { name: letter.toUpperCase(), isLinear: this.store.axis(index)?.is_linear !== false };
  }

  showTable() {
    const { offsets } = this;
    if (!offsets) return;
    setText(this.title, `Machine position of each work zero, ${lengthUnit()} · tap a figure to change it`);
    this.cells = [];
    this.shownSystem = this.system;
    const axes = offsets.axes.map((_, index) => this.axis(index));
    const head = ['', ...axes.map(axis => axis.name), 'rotation'];
    const rows = offsets.systems.map(row => {
      const figures = row.mm.map((mm, index) =>
        this.cell(`${row.name} ${axes[index].name}`, mm, axes[index].isLinear, value =>
          this.changeSystem(row, index, value),
        ),
      );
      const rotation = this.cell(`${row.name} rotation`, row.rotation_deg, false, value =>
        this.change({ systems: [{ ...row, rotation_deg: value }] }),
      );
      return this.row(row.name, row.name === this.shownSystem, [...figures, rotation]);
    });
    const g92 = offsets.g92.mm.map((mm, index) =>
      this.cell(`G92 ${axes[index].name}`, mm, axes[index].isLinear, value => this.changeG92(index, value)),
    );
    rows.push(this.row('G92', offsets.g92.is_active, [...g92, this.clearButton()]));
    setChildren(
      this.table,
      element(
        'table',
        { class: 'wide values offsets' },
        element(
          'thead',
          {},
          element('tr', {}, ...head.map(text => (text ? element('th', { scope: 'col', text }) : element('td')))),
        ),
        element('tbody', {}, ...rows),
      ),
    );
    this.showState();
  }

  row(name, isNow, nodes) {
    const head = element('th', { scope: 'row', text: `${isNow ? '▸ ' : ''}${name}` });
    return element('tr', { class: isNow ? 'now' : null }, head, ...nodes.map(node => element('td', {}, node)));
  }

  cell(name, value, isLinear, run) {
    const node = button(
      formatPosition(value, isLinear),
      () => {
        if (!isOff(node)) enterValue({ title: name, value, isLinear, run });
      },
      { class: 'value', 'aria-label': `${name}: ${formatPosition(value, isLinear)}` },
    );
    this.cells.push(node);
    return node;
  }

  clearButton() {
    const { g92 } = this.offsets;
    const node = button('Clear', () => {
      if (!isOff(node)) this.change({ g92: { mm: g92.mm.map(() => 0), is_active: false } });
    });
    node.setAttribute('aria-label', 'Clear G92');
    this.cells.push(node);
    return node;
  }

  changeSystem(row, index, value) {
    this.change({ systems: [{ ...row, mm: row.mm.map((mm, each) => (each === index ? value : mm)) }] });
  }

  changeG92(index, value) {
    const mm = this.offsets.g92.mm.map((old, each) => (each === index ? value : old));
    this.change({ g92: { mm, is_active: mm.some(each => each !== 0) } });
  }

  async change(body) {
    await changeTable(this, '/api/v1/offsets', body);
    this.onShow();
  }

  showState() {
    for (const node of this.cells) setOff(node, !this.store.allows('work-zero'));
    if (this.offsets && this.system !== this.shownSystem) this.showTable();
  }
}
