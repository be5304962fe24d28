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

  /** Shows an error with `number`, `cause` and `remedy`, unless it is shown already: it may also come with the log. */
  refuse(error) {
    const { number, cause, remedy } = parts(error);
    const key = `${number ?? ''} ${cause}`;
    if ([...this.place.children].some(notice => notice.dataset.key === key)) return;
    const notice = element(
      'div',
      { class: 'notice', data: { key } },
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

/** Number, cause and remedy of an error; those of a line of the log, `E4304: cause · remedy`, where it is one. */
function parts({ number, cause, remedy }) {
  const line = number ? null : /^([EW]\d{4}): (.*?)(?: · (.*))?$/.exec(cause ?? '');
  return line ? { number: line[1], cause: line[2], remedy: line[3] ?? remedy } : { number, cause, remedy };
}
