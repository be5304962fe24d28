// Shows the messages of the machine, the newest last, and the newest one in the message line.
//
// Invariant: it shows the messages that the server retains, each with its number and remedy as the server wrote it.

import { button, element, setText } from './element.js';
import { VirtualList } from './virtual_list.js';
import { formatDuration } from './units.js';

const ROW_HEIGHT = 44;
const NUMBER = /^([EW]\d{4})[:\s]+/;
const REFUSAL = /^rejected: |^E\d{4}: /;

/** Log. */
export class LogPanel {
  constructor(store, connection, notices) {
    Object.assign(this, { store, connection, notices });
    this.messages = [];
    this.follows = true;
    this.list = new VirtualList({
      label: 'Messages',
      rowHeight: ROW_HEIGHT,
      className: 'log',
      onFreeScroll: () => {
        this.follows = false;
      },
      makeRow: () =>
        element('div', {}, ...['log-time', 'log-number', 'log-text'].map(name => element('span', { class: name }))),
      fillRow: (row, index) => this.fillRow(row, index),
      onTap: index => this.openMessage(index),
    });
    this.title = element('p', { class: 'list-title' });
    this.opened = element('p', { class: 'log-opened', hidden: true });
    this.node = element(
      'div',
      { class: 'column' },
      element(
        'div',
        { class: 'list-head' },
        this.title,
        button('All', () => this.fetchAll()),
        button('Newest', () => {
          this.follows = true;
          this.toEnd();
        }),
      ),
      this.list.node,
      this.opened,
    );
    store.on('log', log => this.applyLog(log));
  }

  onShow() {
    this.list.render(true);
    if (this.follows) this.toEnd();
  }

  toEnd() {
    this.list.reveal(Math.max(this.messages.length - 1, 0), true);
  }

  applyLog({ first = 0, messages }) {
    // Older messages that were fetched before stay in front of the retained ones.
    const older = this.first === undefined || this.first >= first ? [] : this.messages.slice(0, first - this.first);
    this.first = older.length > 0 ? this.first : first;
    this.messages = [...older, ...messages];
    setText(this.title, `${this.messages.length} messages`);
    this.list.setCount(this.messages.length);
    this.reportRefusals();
    const newest = this.messages.at(-1);
    if (newest) this.notices.inform(messageText(newest));
    if (this.follows) this.toEnd();
  }

  /** Shows refusals of the machine that came since the last log as notices. */
  reportRefusals() {
    const key = ({ time_s: time, text, times }) => `${time} ${times} ${text}`;
    const keys = new Set(this.messages.map(key));
    const fresh = this.seen ? this.messages.filter(message => !this.seen.has(key(message))) : [];
    this.seen = keys;
    // What the check of a program found is shown with the program.
    const findings = this.store.state?.program.findings ?? [];
    const refusals = fresh.filter(({ text }) => REFUSAL.test(text) && !findings.includes(text));
    for (const { text } of refusals.slice(-2)) {
      const number = NUMBER.exec(text),
        [cause, remedy] = text.slice(number?.[0].length ?? 0).split(' · ');
      this.notices.refuse({ number: number?.[1], cause, remedy });
    }
  }

  async fetchAll() {
    try {
      const log = await this.connection.request('GET', '/api/v1/log');
      this.first = log.first;
      this.messages = log.messages;
      setText(this.title, `${this.messages.length} messages`);
      this.list.setCount(this.messages.length);
    } catch (error) {
      this.notices.refuse(error);
    }
  }

  fillRow(row, index) {
    const message = this.messages[index],
      [time, number, text] = row.children;
    if (!message) return;
    const found = NUMBER.exec(message.text);
    setText(time, `${formatDuration(message.time_s)}${message.line ? ` · ${message.line}` : ''}`);
    setText(number, found?.[1] ?? '');
    setText(text, found ? messageText(message).slice(found[0].length) : messageText(message));
    row.classList.toggle('is-error', found !== null);
  }

  openMessage(index) {
    const message = this.messages[index];
    this.list.mark(index);
    this.opened.hidden = false;
    setText(this.opened, messageText(message));
  }
}

function messageText({ text, times }) {
  return times > 1 ? `${text} (×${times})` : text;
}
