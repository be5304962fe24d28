// Lists the contours of the program: what is cut of each; starts at one, goes back to one, or skips it.
//
// Invariant: the list is the server's, fetched while it is in view.

import { button, element, isOff, setOff, setText } from './element.js';
import { VirtualList } from './virtual_list.js';
import { confirm } from './dialog.js';
import { formatLength } from './units.js';

const REFRESH_MS = 2000;
const ROW_HEIGHT = 44;
const MAX_LINES = 4;
const SIGNS = { cut: '■', begun: '◧', not_begun: '□', skipped: '–', passed: '–' };

/** Contours. */
export class ContourList {
  constructor(store, connection, orders) {
    Object.assign(this, { store, connection, orders });
    this.contours = [];
    this.list = new VirtualList({
      label: 'Contours',
      rowHeight: ROW_HEIGHT,
      className: 'contours',
      onTap: index => this.choose(index),
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
    this.node = element(
      'div',
      { class: 'column' },
      element('div', { class: 'list-head' }, this.title, this.skip, this.act),
      this.list.node,
    );
    store.on('state control link', () => this.showState());
  }

  onShow() {
    this.refresh();
    clearInterval(this.timer);
    this.timer = setInterval(() => {
      if (this.node.offsetParent !== null) this.refresh();
    }, REFRESH_MS);
  }

  onHide() {
    clearInterval(this.timer);
  }

  async refresh() {
    try {
      this.contours = (await this.connection.request('GET', '/api/v1/program/contours')).contours;
      this.list.setCount(this.contours.length);
    } catch {
      /* the next refresh tries again */
    }
    this.showState();
  }

  fillRow(row, index) {
    const contour = this.contours[index],
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

  async choose(index) {
    this.list.mark(index);
    this.showState();
    // The line that lights the cutter makes no motion; the next one that does shows where the contour is.
    const { line } = this.contours[index];
    for (let next = line; next < line + MAX_LINES; next++) {
      const answer = await this.orders.locate({ line: next });
      if (!answer) continue;
      this.store.choose({ line: next, records: answer.records, from: 'contour' });
      break;
    }
  }

  perform() {
    const contour = this.contours[this.list.marked];
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

  performSkip() {
    const contour = this.contours[this.list.marked];
    if (!contour || isOff(this.skip)) return;
    this.orders.send(`skip contour ${contour.number}${contour.state === 'skipped' ? ' off' : ''}`);
    this.refresh();
  }

  showState() {
    const { store } = this,
      contour = this.contours[this.list.marked];
    const isAhead = ['not_begun', 'skipped'].includes(contour?.state);
    setText(this.skip, contour?.state === 'skipped' ? 'Cut it' : 'Skip it');
    setOff(this.skip, !contour || !store.isHolder || !(store.isSetup || isAhead));
    setText(this.act, store.isSetup ? 'Start here' : 'Back to it');
    setOff(this.act, !contour || !(store.isSetup ? store.allows('cycle-start') : store.allows('back-by')));
    setText(
      this.title,
      this.contours.length > 0
        ? `${this.contours.length} ${this.contours.length === 1 ? 'contour' : 'contours'}`
        : 'no contours',
    );
    if (this.node.offsetParent !== null) this.list.render(true);
  }
}
