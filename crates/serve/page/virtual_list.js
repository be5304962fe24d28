// A list of any length that has only the rows in view as elements.
//
// Invariant: as many row elements as fit the view, whatever the number of rows. Above MAX_HEIGHT the scroll bar is
// scaled, because browsers limit the height of an element.

import { element } from './element.js';

const MAX_HEIGHT = 8_000_000;

/** List. `makeRow()` makes an empty row; `fillRow(row, index)` fills it; `onMark(index)` is called after a key marked it. */
export class VirtualList {
  constructor({ label, rowHeight, makeRow, fillRow, onFreeScroll, onTap, onDoubleTap, onMark, className = '' }) {
    Object.assign(this, { rowHeight, makeRow, fillRow, onTap, onDoubleTap, onMark });
    this.count = 0;
    this.rows = [];
    this.spacer = element('div', { class: 'list-spacer', 'aria-hidden': 'true' });
    this.window = element('div', { class: 'list-window' });
    this.node = element(
      'div',
      { class: `list ${className}`, tabindex: '0', role: 'listbox', 'aria-label': label },
      this.spacer,
      this.window,
    );
    this.marked = -1;
    this.node.addEventListener('scroll', () => this.render());
    for (const name of ['wheel', 'touchmove', 'pointerdown']) {
      this.node.addEventListener(
        name,
        event => {
          if (name !== 'pointerdown' || event.offsetX > this.node.clientWidth) onFreeScroll?.();
        },
        { passive: true },
      );
    }
    this.node.addEventListener('keydown', event => this.onKeyDown(event, onFreeScroll));
    let last = { index: -1, at: -Infinity };
    this.window.addEventListener('click', event => {
      const row = event.target.closest('[data-index]');
      if (!row) return;
      const index = Number(row.dataset.index),
        now = performance.now();
      const isDouble = last.index === index && now - last.at < 500;
      last = { index, at: isDouble ? -Infinity : now };
      if (isDouble) this.onDoubleTap?.(index);
      else this.onTap?.(index);
    });
    new ResizeObserver(() => this.render(true)).observe(this.node);
  }

  onKeyDown(event, onFreeScroll) {
    const step = {
      ArrowUp: -1,
      ArrowDown: 1,
      PageUp: -this.visible(),
      PageDown: this.visible(),
      Home: -this.count,
      End: this.count,
    }[event.key];
    if (step !== undefined && !event.shiftKey && !event.ctrlKey) {
      event.preventDefault();
      event.stopPropagation();
      onFreeScroll?.();
      const from = this.marked >= 0 ? this.marked : this.firstRow();
      const index = Math.min(Math.max(from + step, 0), this.count - 1);
      this.mark(index);
      this.reveal(index);
      this.onMark?.(index);
    } else if (event.key === 'Enter' && this.marked >= 0) {
      event.preventDefault();
      event.stopPropagation();
      this.onTap?.(this.marked);
    }
  }

  visible() {
    return Math.max(Math.floor(this.node.clientHeight / this.rowHeight), 1);
  }

  height() {
    return Math.min(this.count * this.rowHeight, MAX_HEIGHT);
  }

  /** Rows a pixel of the scroll bar, above those of a list that is not scaled. */
  scale() {
    const room = this.height() - this.node.clientHeight;
    return room > 0 ? (this.count * this.rowHeight - this.node.clientHeight) / room : 1;
  }

  firstRow() {
    return Math.floor((this.node.scrollTop * this.scale()) / this.rowHeight);
  }

  setCount(count) {
    if (count === this.count) {
      this.render(true);
      return;
    }
    this.count = count;
    this.spacer.style.height = `${this.height()}px`;
    this.render(true);
  }

  mark(index) {
    this.marked = index;
    this.render(true);
  }

  /** Scrolls so that a row is in view, a third from the top. */
  reveal(index, always = false) {
    const first = this.firstRow(),
      visible = this.visible();
    if (!always && index >= first && index < first + visible - 1) return;
    const top = (Math.max(index - Math.floor(visible / 3), 0) * this.rowHeight) / this.scale();
    if (Math.abs(this.node.scrollTop - top) >= 1) this.node.scrollTop = top;
    this.render();
  }

  /** Fills the rows in view. */
  render(always = false) {
    const height = this.node.clientHeight;
    if (height === 0) return;
    const wanted = Math.min(Math.ceil(height / this.rowHeight) + 1, this.count);
    while (this.rows.length < wanted) {
      const row = this.makeRow();
      row.setAttribute('role', 'option');
      row.classList.add('list-row');
      this.rows.push(row);
      this.window.append(row);
    }
    while (this.rows.length > wanted) this.rows.pop().remove();
    const offset = this.node.scrollTop * this.scale(),
      first = Math.min(Math.floor(offset / this.rowHeight), Math.max(this.count - wanted, 0));
    const shift = this.node.scrollTop - (offset - first * this.rowHeight);
    this.window.style.transform = `translateY(${shift.toFixed(1)}px)`;
    if (!always && first === this.shownFirst) return;
    this.shownFirst = first;
    this.rows.forEach((row, place) => {
      const index = first + place;
      row.dataset.index = String(index);
      row.setAttribute('aria-selected', String(index === this.marked));
      row.setAttribute('aria-posinset', String(index + 1));
      row.setAttribute('aria-setsize', String(this.count));
      this.fillRow(row, index);
    });
  }
}
