// Shows refusals and short notices above the footer, each with its number, cause and remedy.
//
// Invariant: a notice covers no button of the footer, and goes away by itself.

import { button, element, setChildren } from './element.js';
import { sign } from './signs.js';

const SHOWN_MS = 9000;
const OFFERED_MS = 120_000;
const MAX_NOTICES = 3;

/** Notices, the newest last. */
export class Notices {
  constructor(place, messageLine) {
    this.place = place;
    this.messageLine = messageLine;
  }

  /** Shows an error with `number`, `cause` and `remedy`. */
  refuse({ number, cause, remedy }) {
    const notice = element(
      'div',
      { class: 'notice' },
      sign('attention'),
      element(
        'p',
        {},
        number ? element('b', { text: `${number} ` }) : null,
        cause ?? 'The order was refused.',
        remedy ? element('small', { text: remedy }) : null,
      ),
    );
    notice.append(button(sign('close'), () => notice.remove(), { class: 'icon', 'aria-label': 'Close' }));
    this.add(notice, SHOWN_MS);
  }

  /** Offers to do something, for two minutes or until it is done. `mayRun` is asked at the tap. */
  offer({ text, label, mayRun, run }) {
    const notice = element('div', { class: 'notice' }, element('p', { text }));
    const accept = button(label, () => {
      if (!mayRun()) return;
      notice.remove();
      run();
    });
    notice.append(
      accept,
      button(sign('close'), () => notice.remove(), { class: 'icon', 'aria-label': 'Close' }),
    );
    this.add(notice, OFFERED_MS);
  }

  add(notice, shownMs) {
    this.place.append(notice);
    while (this.place.children.length > MAX_NOTICES) this.place.firstChild.remove();
    setTimeout(() => notice.remove(), shownMs);
  }

  /** Shows a line of text in the message line. */
  inform(text) {
    setChildren(this.messageLine, text);
  }

  clear() {
    this.place.replaceChildren();
  }
}
