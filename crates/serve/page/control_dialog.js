// Takes, gives and keeps control of the machine.
//
// Invariant: a reconnected page comes back as a watcher. Only the first connection of a page takes control by itself,
// and only where it is free; taking control moves nothing.

import { closeDialog, openDialog, openDialogKey } from './dialog.js';
import { element } from './element.js';
import { setting } from './settings.js';

/** Control of the machine by this page. */
export class ControlDialog {
  constructor(store, orders, connection) {
    Object.assign(this, { store, orders, connection });
    this.mayTake = true;
    store.on('control', control => this.follow(control));
    store.on('link', link => {
      if (link === 'lost') closeDialog('control');
    });
    store.on('hello', () => {
      const name = setting('pageName');
      if (name) connection.send({ t: 'name', name });
    });
  }

  follow(control) {
    if (this.mayTake && this.connection.sessions <= 1 && !control.holder && this.store.hello?.rights === 'operate') {
      this.orders.control('take');
    }
    this.mayTake = false;
    if (control.is_you && control.asks) this.askToGive(control.asks);
    else if (openDialogKey() === 'control-asked') closeDialog('control-asked');
  }

  askToGive(asks) {
    const text =
      `${asks.name} asks for control. Without an answer it passes in ${Math.ceil(asks.left_s)} s, if the ` +
      'machine is at rest.';
    if (openDialogKey() === 'control-asked') {
      this.askText.textContent = text;
      return;
    }
    this.askText = element('p', { text });
    openDialog({
      key: 'control-asked',
      title: 'Give control?',
      level: 'waiting',
      content: [this.askText],
      choices: [
        { label: 'Keep', run: () => this.orders.control('keep') },
        { label: `Give to ${asks.name}`, main: true, run: () => this.orders.control('give') },
      ],
    });
  }

  /** Opens the choices, or takes control where it is free. */
  open() {
    const { control, hello, isHolder, isLive } = this.store;
    if (!isLive || hello?.rights !== 'operate') return;
    if (isHolder) {
      openDialog({
        key: 'control',
        title: 'This page is in control',
        content: [
          element('p', {
            text: 'Released, any page can take ' + 'control. The machine goes on with what it does; a jog ends.',
          }),
        ],
        choices: [{ label: 'Keep' }, { label: 'Release', run: () => this.orders.control('release') }],
      });
    } else if (!control?.holder) {
      this.orders.control('take');
    } else {
      openDialog({
        key: 'control',
        title: `${control.holder.name} is in control`,
        content: [
          element('p', {
            text:
              'It is asked to ' + 'give control. Without an answer it passes after 10 s, if the machine is at rest.',
          }),
        ],
        choices: [
          { label: 'Cancel' },
          { label: 'Ask for control', main: true, run: () => this.orders.control('take') },
        ],
      });
    }
  }
}
