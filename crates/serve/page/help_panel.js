// Help: what the page shows, and all actions with their keys; those that are possible now stand out.
//
// Invariant: keys and texts are those of the server's key table.

import { element, setChildren } from './element.js';
import { changeSetting, setting } from './settings.js';
import { openDialog } from './dialog.js';

const NO_STOP =
  'HOLD and STOP brake the machine on its path. Neither is an emergency stop: use the switch of the machine.';
const DEMO_TEXT = 'This machine is simulated: press CYCLE START and let it cut for some seconds.';
const FIRST_TEXTS = [
  'Drag the bar below the path to the left: the machine goes back along its path. Drag it to the right: it goes ' +
    'forward. Let go: it stands still.',
  'HOLD stops on the path, whatever else happens, from every page. Space is HOLD too.',
  'Press \u201cresume\u201d beside the bar: the machine returns to the furthest place and the program goes on.',
];

/** Help. */
export class HelpPanel {
  constructor(store, actions) {
    Object.assign(this, { store, actions });
    this.list = element('div', { class: 'help-rows' });
    this.node = element(
      'div',
      { class: 'list help', tabindex: '0', role: 'region', 'aria-label': 'Help' },
      element('p', { class: 'warning', text: NO_STOP }),
      ...FIRST_TEXTS.map(text => element('p', { text })),
      element('h2', { text: 'Actions and keys' }),
      this.list,
      element('p', {
        text:
          'In the path: drag to pan, pinch or turn the mouse wheel to zoom, tap a line for its block, tap ' +
          'twice to see all; in 3-D, drag with the right button to turn. Over the bar, arrows and the mouse wheel ' +
          'turn counts in handwheel mode. In text fields Space is HOLD, except in MDI, where Esc is.',
      }),
    );
    store.on('hello', () => this.build());
    store.on('state control link', () => this.showState());
  }

  onShow() {
    this.showState();
  }

  build() {
    this.rows = this.store.hello.actions.map(action => {
      const keys = action.keys.map(key => element('kbd', { text: key === ' ' ? 'Space' : key }));
      const node = element(
        'div',
        { class: 'help-row' },
        element('span', { class: 'keys' }, ...keys),
        element('b', { text: action.label }),
        element('span', { text: action.help }),
      );
      return { id: action.id, node };
    });
    setChildren(this.list, ...this.rows.map(row => row.node));
    this.showState();
  }

  /** Marks what is possible now. */
  showState() {
    if (this.node.offsetParent === null) return;
    for (const { id, node } of this.rows ?? []) node.classList.toggle('is-off', !this.actions.isPossible(id));
  }

  /** Shows once how to retrace, and what HOLD and STOP are not. */
  welcome() {
    if (setting('wasWelcomed')) return;
    const texts = this.store.hello.is_demo ? [DEMO_TEXT, ...FIRST_TEXTS] : FIRST_TEXTS;
    openDialog({
      key: 'welcome',
      title: 'retrace',
      content: [...texts.map(text => element('p', { text })), element('p', { class: 'warning', text: NO_STOP })],
      choices: [{ label: 'Understood', main: true, run: () => changeSetting('wasWelcomed', 'yes') }],
    });
  }
}
