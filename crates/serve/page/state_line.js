// Shows what the machine does, why, and what to do next; and who is in control.
//
// Invariant: what it shows is the server's, or NO LINK: never a guess of the page.

import { button, element, setChildren, setText } from './element.js';
import { colourOfWord, sign, signOfWord } from './signs.js';

const NO_LINK_TEXTS = {
  opening: 'connecting to the machine',
  silent: 'nothing heard for half a second; the figures are old',
  lost: 'the link is gone; trying again. Nothing is sent again',
  'signed-out': 'not signed in',
};
/** Actions that have a fixed place elsewhere. */
const PLACED = new Set([
  'hold',
  'quit',
  'jog',
  'turn',
  'slower',
  'faster',
  'whole',
  'reverse',
  'wheel',
  'forward',
  'cycle-start',
  'view',
  'leave',
  'back-by',
  'step',
]);
const MAX_SUGGESTIONS = 2;

/**
 * The line at the top. `openAlarm` shows the alarm or question again, `openActions` all that is possible,
 * `openControl` the choices of control.
 */
export class StateLine {
  constructor(place, store, actions, { openAlarm, openActions, openControl }) {
    Object.assign(this, { place, store, actions });
    this.word = element('span');
    this.sign = element('span', { class: 'state-sign' });
    this.chip = button(this.sign, openAlarm, { id: 'state-word' }, this.word);
    this.chip.replaceChildren(this.sign, this.word);
    this.why = element('p', { id: 'state-why', role: 'status', 'aria-live': 'polite' });
    this.next = element('div', { id: 'state-next' });
    this.more = element(
      'button',
      { type: 'button', class: 'icon', 'aria-label': 'All that is possible now', on: { click: openActions } },
      sign('more'),
    );
    this.control = button('', openControl, { id: 'control-button' });
    this.tag = element('span', { id: 'state-tag', title: 'The machine is simulated', text: 'DEMO', hidden: true });
    place.append(this.chip, this.why, this.tag, this.next, this.more, this.control);
    store.on('hello', hello => {
      this.tag.hidden = !hello.is_demo;
    });
    store.on('state link hello', () => this.show());
    store.on('control link hello', () => this.showControl());
    this.show();
    this.showControl();
  }

  show() {
    const { state, isLive, link } = this.store;
    const word = isLive && state ? state.word : isLive ? 'CONNECTED' : 'NO LINK';
    const level = isLive ? (state?.level ?? 'normal') : 'alarm';
    const why = isLive ? (state?.why ?? '') : NO_LINK_TEXTS[link];
    if (word !== this.word.textContent || level !== this.level) {
      this.level = level;
      setText(this.word, word);
      setChildren(this.sign, sign(signOfWord(word, level)));
      this.chip.dataset.colour = colourOfWord(word, level);
    }
    this.chip.classList.toggle('long', word.length > 9);
    this.chip.classList.toggle('longest', word.length > 12);
    setText(this.why, why);
    this.showSuggestions(isLive ? (state?.suggested ?? []) : []);
  }

  showSuggestions(suggested) {
    const { actions, store } = this;
    const ids = suggested.filter(id => !PLACED.has(id) && actions.isPossible(id)).slice(0, MAX_SUGGESTIONS);
    const key = `${ids.join()} ${store.isHolder}`;
    if (key === this.shownSuggestions) return;
    this.shownSuggestions = key;
    setChildren(
      this.next,
      ...ids.map(id => {
        const node = button(actions.label(id), () => actions.perform(id), {
          class: id === suggested[0] && id === 'recover' ? 'suggestion main' : 'suggestion',
          title: actions.row(id)?.help,
        });
        // The words beside them name the keys.
        node.append(element('small', { text: actions.keyText(id) }));
        return node;
      }),
    );
  }

  showControl() {
    const { control, hello, isHolder, isLive } = this.store;
    const onlyWatches = isLive && hello && hello.rights !== 'operate';
    const text = !isLive
      ? '–'
      : onlyWatches
        ? 'watching'
        : isHolder
          ? 'in control'
          : control?.holder
            ? `${control.holder.name} has control`
            : 'take control';
    setText(this.control, text);
    this.control.dataset.control = !isLive ? 'none' : isHolder ? 'mine' : control?.holder ? 'other' : 'free';
    this.control.setAttribute('aria-disabled', !isLive || onlyWatches ? 'true' : 'false');
    this.showSuggestions(isLive ? (this.store.state?.suggested ?? []) : []);
  }
}
