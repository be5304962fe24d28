// Executes single blocks (MDI) and keeps the last ones.
//
// Invariant: a block is sent only by Enter or the button, once each. Esc in the field is HOLD.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';

const MAX_HISTORY = 50;

function storedHistory() {
  try {
    const value = JSON.parse(localStorage.getItem('retrace.mdi') ?? '[]');
    return Array.isArray(value) ? value.filter(text => typeof text === 'string').slice(0, MAX_HISTORY) : [];
  } catch {
    return [];
  }
}

/** MDI. */
export class MdiPanel {
  constructor(store, orders) {
    Object.assign(this, { store, orders });
    this.history = storedHistory();
    this.place = -1;
    this.input = element('input', {
      type: 'text',
      class: 'mdi-text',
      'aria-label': 'MDI block',
      autocomplete: 'off',
      autocapitalize: 'characters',
      spellcheck: 'false',
      placeholder: 'G0 X10',
      maxlength: '250',
    });
    this.run = button('Execute', () => this.execute(), { class: 'main' });
    this.modal = element('p', { class: 'modal-line' });
    this.list = element('div', { class: 'mdi-history', role: 'list', 'aria-label': 'Last blocks', tabindex: '0' });
    this.node = element(
      'div',
      { class: 'column' },
      this.modal,
      element('div', { class: 'row' }, this.input, this.run),
      this.list,
    );
    this.input.addEventListener('keydown', event => {
      if (event.key === 'Enter' && !event.repeat) {
        event.preventDefault();
        this.execute();
      }
      if (event.key === 'ArrowUp' || event.key === 'ArrowDown') {
        event.preventDefault();
        this.recall(event.key === 'ArrowUp' ? 1 : -1);
      }
    });
    store.on('state control link', () => this.showState());
    this.showHistory();
  }

  onShow() {
    if (matchMedia('(pointer: fine)').matches) this.input.focus();
  }

  recall(step) {
    this.place = Math.min(Math.max(this.place + step, -1), this.history.length - 1);
    this.input.value = this.history[this.place] ?? '';
  }

  async execute() {
    const block = this.input.value.trim();
    if (!block || isOff(this.run)) return;
    this.history = [block, ...this.history.filter(text => text !== block)].slice(0, MAX_HISTORY);
    try {
      localStorage.setItem('retrace.mdi', JSON.stringify(this.history));
    } catch {
      /* kept for this page only */
    }
    this.place = -1;
    this.showHistory();
    if (await this.orders.send(`mdi ${block}`)) this.input.value = '';
  }

  showHistory() {
    setChildren(
      this.list,
      ...this.history.map(text =>
        element(
          'div',
          { role: 'listitem' },
          button(
            text,
            () => {
              this.input.value = text;
              this.input.focus();
            },
            { class: 'mdi-entry' },
          ),
        ),
      ),
    );
  }

  showState() {
    setText(this.modal, this.store.state?.modal ?? '');
    setOff(this.run, !this.store.allows('mdi'));
  }
}
