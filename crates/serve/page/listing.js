// The listing of the loaded program. It follows the block under the tool until the user scrolls.
//
// Invariant: only lines near the view are fetched and kept, however long the program is.

import { button, element, setText } from './element.js';
import { VirtualList } from './virtual_list.js';
import { confirm, openDialog } from './dialog.js';
import { formatDuration } from './units.js';

const PAGE_LINES = 200;
const MAX_PAGES = 40;
const ROW_HEIGHT = 26;
const CHECK_TEXTS = {
  not_loaded: 'no program',
  checking: 'being checked …',
  ready: '',
  failed: 'not ready',
  stream: 'stream',
};

/** Listing. */
export class Listing {
  constructor(store, connection, orders) {
    Object.assign(this, { store, connection, orders });
    this.pages = new Map();
    this.follows = true;
    this.list = new VirtualList({
      label: 'Program',
      rowHeight: ROW_HEIGHT,
      className: 'listing',
      makeRow: () => this.makeRow(),
      fillRow: (row, index) => this.fillRow(row, index),
      onFreeScroll: () => this.setFollows(false),
      onTap: index => this.tap(index),
      onDoubleTap: index => this.startHere(index),
    });
    this.title = element('p', { class: 'list-title' });
    this.followButton = button('follow', () => this.setFollows(true), { class: 'follow', 'aria-pressed': 'true' });
    this.findingsButton = button('findings', () => this.openFindings(), { hidden: true });
    this.node = element(
      'div',
      { class: 'column' },
      element('div', { class: 'list-head' }, this.title, this.findingsButton, this.followButton),
      this.list.node,
    );
    store.on('state', () => this.showProgram());
    store.on('chosen', () => this.showChosen());
  }

  onShow() {
    this.list.render(true);
    this.show();
  }

  makeRow() {
    return element('div', {}, element('span', { class: 'line-number' }), element('span', { class: 'line-text' }));
  }

  showProgram() {
    const program = this.store.state?.program;
    if (!program) return;
    // While a job runs its path may grow; the text stays.
    if (this.store.state.stage !== 'job') this.keyPath = program.path;
    const key = `${program.name} ${program.lines} ${this.keyPath}`;
    const notes = [
      program.lines ? `${program.lines} lines` : null,
      program.planned_s ? formatDuration(program.planned_s) : null,
      CHECK_TEXTS[program.check] || null,
      this.store.state.dry_run ? 'DRY RUN' : null,
    ].filter(Boolean);
    setText(this.title, program.name ? `${program.name} · ${notes.join(' · ')}` : 'no program: load one under Files');
    const findings = program.findings?.length ?? 0;
    this.findingsButton.hidden = findings === 0;
    setText(this.findingsButton, `${findings} ${findings === 1 ? 'finding' : 'findings'}`);
    if (key === this.shownProgram) return;
    this.shownProgram = key;
    this.pages.clear();
    this.list.setCount(program.lines ?? 0);
  }

  openFindings() {
    const { name, findings } = this.store.state.program;
    openDialog({
      key: 'findings',
      title: `Findings in ${name}`,
      content: [element('ul', { class: 'question-lines' }, ...findings.map(text => element('li', { text })))],
      choices: [{ label: 'Close' }],
    });
  }

  fillRow(row, index) {
    const line = index + 1,
      [number, text] = row.children;
    setText(number, String(line));
    setText(text, this.lineText(line) ?? '');
    row.classList.toggle('now', line === this.shownLine);
    row.classList.toggle('chosen', line === this.store.chosen?.line);
    if (line === this.shownLine) row.setAttribute('aria-current', 'true');
    else row.removeAttribute('aria-current');
  }

  lineText(line) {
    const number = Math.floor((line - 1) / PAGE_LINES),
      page = this.pages.get(number);
    if (!page) {
      this.fetchPage(number);
      return '…';
    }
    this.pages.delete(number);
    this.pages.set(number, page);
    return page.lines?.[(line - 1) % PAGE_LINES];
  }

  async fetchPage(number) {
    this.pages.set(number, { lines: null });
    const program = this.shownProgram;
    try {
      const answer = await this.connection.request(
        'GET',
        `/api/v1/program/lines?from=${number * PAGE_LINES + 1}&count=${PAGE_LINES}`,
      );
      if (program !== this.shownProgram) return;
      this.pages.set(number, { lines: answer.lines });
      while (this.pages.size > MAX_PAGES) this.pages.delete(this.pages.keys().next().value);
    } catch {
      setTimeout(() => {
        this.pages.delete(number);
        this.list.render(true);
      }, 2000);
      return;
    }
    this.list.render(true);
  }

  setFollows(follows) {
    this.follows = follows;
    this.followButton.setAttribute('aria-pressed', String(follows));
    if (follows) {
      this.shownLine = null;
      this.show();
    }
  }

  /** Shows the newest live figures; called once a frame. */
  show() {
    const line = this.store.live?.line ?? this.store.state?.line ?? null;
    if (line === this.shownLine) return;
    this.shownLine = line;
    if (this.follows && line) this.list.reveal(line - 1);
    this.list.render(true);
  }

  async tap(index) {
    const line = index + 1;
    this.list.mark(index);
    const answer = await this.orders.locate({ line });
    this.store.choose(answer ? { line, records: answer.records, from: 'listing' } : null);
    if (!answer) this.orders.notices.inform(`Line ${line} makes no motion.`);
  }

  startHere(index) {
    const line = index + 1;
    if (!this.store.isSetup || !this.store.isHolder) {
      this.orders.notices.inform('The program can start at a line while no job runs and this page is in control.');
      return;
    }
    confirm({
      title: `Start at line ${line}?`,
      text:
        'The program begins in the middle. Modes and outputs are those that ' +
        'it would have there; the machine moves to the start of that line.',
      label: `Start at line ${line}`,
      run: () => this.orders.send(`start line ${line}`),
    });
  }

  showChosen() {
    const { chosen } = this.store;
    this.list.marked = chosen ? chosen.line - 1 : -1;
    if (chosen?.from === 'path' || chosen?.from === 'contour') {
      this.setFollows(false);
      this.list.reveal(chosen.line - 1);
    }
    this.list.render(true);
  }
}
