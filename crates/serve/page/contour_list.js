// Lists the contours of the program: what is cut of each; starts at one, goes back to one, or skips it.
//
// Invariant: the actions are those of the selected contour, whether it was selected here or in the drawing.

import { button, element, isOff, setAttribute, setOff, setText } from './element.js';
import { VirtualList } from './virtual_list.js';
import { confirm } from './dialog.js';
import { formatLength } from './units.js';

const REFRESH_MS = 2000;
const ROW_HEIGHT = 44;
const MAX_LINES = 4;
const SIGNS = { cut: '■', begun: '◧', not_begun: '□', skipped: '–', passed: '–' };

/** Contours. `table` holds them. */
export class ContourList {
  constructor(store, orders, table) {
    Object.assign(this, { store, orders, table });
    this.list = new VirtualList({
      label: 'Contours',
      rowHeight: ROW_HEIGHT,
      className: 'contours',
      onTap: index => this.choose(index),
      onMark: index => this.choose(index),
      makeRow: () =>
        element(
          'div',
          {},
          ...['contour-sign', 'contour-name', 'contour-cut'].map(name => element('span', { class: name })),
        ),
      fillRow: (row, index) => this.fillRow(row, index),
    });
    this.act = button('Start here', () => this.perform(), { class: 'main' });
    this.skip = button('Skip it', () => this.performSkip());
    this.title = element('p', { class: 'list-title' });
    this.number = element('input', {
      type: 'text',
      class: 'contour-number',
      inputmode: 'numeric',
      placeholder: 'No.',
      'aria-label': 'Number of the contour to select',
      autocomplete: 'off',
      on: { input: () => this.chooseNumber() },
    });
    this.node = element(
      'div',
      { class: 'column' },
      element('div', { class: 'list-head' }, this.title, this.number, this.skip, this.act),
      this.list.node,
    );
    store.on('state control link', () => this.showState());
    table.on(from => this.showTable(from));
  }

  onShow() {
    this.table.refresh();
    this.showTable('shown');
    clearInterval(this.timer);
    this.timer = setInterval(() => {
      if (this.node.offsetParent !== null) this.table.refresh();
    }, REFRESH_MS);
  }

  onHide() {
    clearInterval(this.timer);
  }

  /** Shows the contours, and scrolls to the selected one where it was not selected here. */
  showTable(from) {
    const { table, list } = this;
    list.setCount(table.contours.length);
    const index = table.indexOf(table.number);
    list.mark(index);
    if (from && from !== 'list' && index >= 0) list.reveal(index);
    if (from && from !== 'number' && from !== 'shown') {
      this.number.value = '';
      setAttribute(this.number, 'aria-invalid', null);
    }
    this.showState();
  }

  fillRow(row, index) {
    const contour = this.table.contours[index],
      [mark, name, cut] = row.children;
    if (!contour) return;
    const share = contour.length_mm > 0 && contour.cut_mm ? Math.min(contour.cut_mm / contour.length_mm, 1) : 0;
    setText(mark, SIGNS[contour.state] ?? (share >= 0.999 ? '■' : share > 0 ? '◧' : '□'));
    setText(name, `${contour.number} · line ${contour.line}${contour.cutter ? ` · ${contour.cutter}` : ''}`);
    const length = contour.length_mm === null || contour.length_mm === undefined ? '' : formatLength(contour.length_mm);
    const isPart = share > 0 && share < 0.999;
    const parts = [
      String(contour.state).replaceAll('_', ' '),
      isPart ? `${formatLength(contour.cut_mm)} of ${length}` : length,
    ];
    setText(cut, parts.filter(Boolean).join(' · '));
    row.classList.toggle('chosen', index === this.list.marked);
    row.classList.toggle('now', contour.number === this.store.state?.cutter?.contour);
  }

  /** Selects the contour whose number is typed. */
  chooseNumber() {
    const text = this.number.value.trim(),
      index = this.table.indexOf(text === '' ? null : Number(text));
    setAttribute(this.number, 'aria-invalid', text !== '' && index < 0 ? 'true' : null);
    if (index >= 0) {
      this.choose(index, 'number');
      return;
    }
    this.table.select(null, 'number');
    this.store.choose(null);
  }

  /** Selects a contour, and shows its first line. */
  async choose(index, from = 'list') {
    const contour = this.table.contours[index];
    if (!contour) return;
    this.table.select(contour.number, from);
    const found = await this.locate(contour);
    if (found && this.table.number === contour.number) this.store.choose({ ...found, from: 'contour' });
  }

  /** First line of a contour that makes a motion, and its records. */
  async locate({ line, records }) {
    if (records) {
      const answer = await this.orders.locate({ record: records[0] + 1 });
      return answer ? { line: answer.line, records: answer.records } : null;
    }
    // The line that lights the cutter makes no motion; the next one that does shows where the contour is.
    for (let next = line; next < line + MAX_LINES; next++) {
      const answer = await this.orders.locate({ line: next });
      if (answer) return { line: next, records: answer.records };
    }
    return null;
  }

  perform() {
    const contour = this.table.selected;
    if (!contour || isOff(this.act)) return;
    if (!this.store.isSetup) {
      this.orders.send(`back to contour ${contour.number}`);
      return;
    }
    confirm({
      title: `Start at contour ${contour.number}?`,
      text: 'The contours before it are not cut.',
      label: `Start at contour ${contour.number}`,
      run: () => this.orders.send(`start contour ${contour.number}`),
    });
  }

  async performSkip() {
    const contour = this.table.selected;
    if (!contour || isOff(this.skip)) return;
    await this.orders.send(`skip contour ${contour.number}${contour.state === 'skipped' ? ' off' : ''}`);
    this.table.refresh();
  }

  showState() {
    const { store } = this,
      contour = this.table.selected,
      count = this.table.contours.length;
    const isAhead = ['not_begun', 'skipped'].includes(contour?.state);
    setText(this.skip, contour?.state === 'skipped' ? 'Cut it' : 'Skip it');
    setOff(this.skip, !contour || !store.isHolder || !(store.isSetup || isAhead));
    setText(this.act, store.isSetup ? 'Start here' : 'Back to it');
    setOff(this.act, !contour || !(store.isSetup ? store.allows('cycle-start') : store.allows('back-by')));
    setText(this.title, count > 0 ? `${count} ${count === 1 ? 'contour' : 'contours'}` : 'no contours');
    if (this.node.offsetParent !== null) this.list.render(true);
  }
}
