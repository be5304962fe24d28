// Opens a dialog for what the machine asks or reports: alarm, question, outputs that differ.
//
// Invariant: each is opened once, stays above the footer, can be hidden to look at the path, and comes back by a tap on
// the state word. It closes when its reason is gone.

import { closeDialog, openDialog, openDialogKey } from './dialog.js';
import { element } from './element.js';
import { openActionDialog } from './action_dialog.js';

const KEYS = ['alarm', 'question', 'outputs-differ'];

/** Dialogs of the machine. */
export class MachineDialogs {
  constructor(store, orders, actions) {
    Object.assign(this, { store, orders, actions });
    this.shown = '';
    store.on('state', () => this.follow());
    store.on('control link', () => {
      if (this.shown) this.follow(true);
    });
  }

  /** What is to be shown now: `{key, identity}` or null. */
  reason() {
    const { state, isLive } = this.store;
    if (!state || !isLive) return null;
    if (state.alarm) return { key: 'alarm', identity: `alarm ${state.alarm.number} ${state.alarm.cause}` };
    if (state.question)
      return { key: 'question', identity: `question ${state.question.title} ${state.question.lines.join()}` };
    if (state.differing_outputs?.length > 0 && this.actions.isPossible('agree')) {
      return { key: 'outputs-differ', identity: `outputs ${JSON.stringify(state.differing_outputs)}` };
    }
    return null;
  }

  follow(always = false) {
    const reason = this.reason();
    if (!reason) {
      this.shown = '';
      if (KEYS.includes(openDialogKey())) closeDialog();
      return;
    }
    const may = [this.store.isHolder, this.store.control?.holder === null, this.actions.isPossible('clear-alarm')];
    const identity = `${reason.identity} ${may.join(' ')}`;
    if (identity === this.shown || (always && !KEYS.includes(openDialogKey()))) return;
    const isOnlyButtons = this.shown.startsWith(reason.identity) && openDialogKey() !== reason.key;
    this.shown = identity;
    // During a drag of the scrubber nothing opens in front of it.
    const isDragging = reason.key === 'outputs-differ' && this.store.state.mode === 'wheel';
    if (!isOnlyButtons && !isDragging) this.open(reason.key);
  }

  /** Opens the dialog again, or, where there is none, all that the machine can do now. */
  reopen() {
    const reason = this.reason();
    if (reason) this.open(reason.key);
    else openActionDialog(this.store, this.actions);
  }

  open(key) {
    if (key === 'alarm') this.openAlarm();
    else if (key === 'question') this.openQuestion();
    else this.openOutputs();
  }

  choice(id, label, extra = {}) {
    return { label, run: () => this.actions.perform(id), off: !this.actions.isPossible(id), ...extra };
  }

  openAlarm() {
    const { alarm } = this.store.state,
      kind = alarm.is_refusal ? 'Not started' : 'Alarm';
    openDialog({
      key: 'alarm',
      level: 'alarm',
      title: /^[EW]\d/.test(alarm.number) ? `${kind} ${alarm.number}` : `${kind}: ${alarm.number}`,
      content: [element('p', { class: 'cause', text: alarm.cause }), element('p', { text: alarm.remedy })],
      choices: [
        { label: 'Hide' },
        ...this.takeChoices(),
        { label: 'Log', run: () => this.actions.perform('messages') },
        this.choice('clear-alarm', alarm.is_refusal ? 'Close' : 'Reset', { main: true }),
      ],
    });
  }

  /** Takes control from inside a dialog, where it is free: a list of one choice or none. */
  takeChoices() {
    const { isHolder, control, hello } = this.store;
    if (isHolder || !control || control.holder || hello?.rights !== 'operate') return [];
    return [{ label: 'Take control', main: true, keepsOpen: true, run: () => this.orders.control('take') }];
  }

  openQuestion() {
    const { question } = this.store.state;
    openDialog({
      key: 'question',
      level: 'waiting',
      title: question.title.charAt(0).toUpperCase() + question.title.slice(1),
      content: [questionContent(question.lines)],
      choices: [
        { label: 'Hide' },
        ...this.takeChoices(),
        { label: 'No', run: () => this.orders.send('no'), off: !this.store.isHolder },
        { label: 'Yes', main: true, run: () => this.orders.send('yes'), off: !this.store.isHolder },
      ],
    });
  }

  openOutputs() {
    const { state, hello } = this.store,
      mayRecover = this.actions.isPossible('recover') && state.cut_end_line !== null;
    const name = channel =>
      hello.machine.outputs.find(output => output.channel === channel)?.name ?? `output ${channel}`;
    const word = value => (value ? '■ on' : '□ off');
    const rows = state.differing_outputs.map(({ channel, value, expected, code, line }) =>
      element(
        'tr',
        {},
        element('th', { scope: 'row', text: name(channel) }),
        element('td', { text: word(value) }),
        element('td', { text: word(expected) + (code ? `, ${code} in line ${line}` : '') }),
      ),
    );
    openDialog({
      key: 'outputs-differ',
      level: 'waiting',
      isModal: false,
      title: 'Outputs differ from the program',
      content: [
        element(
          'table',
          { class: 'wide' },
          element(
            'thead',
            {},
            element(
              'tr',
              {},
              element('th', { scope: 'col', text: 'output' }),
              element('th', { scope: 'col', text: 'now' }),
              element('th', { scope: 'col', text: 'program' }),
            ),
          ),
          element('tbody', {}, ...rows),
        ),
        element('p', { text: 'They are restored in program order, the cutter last; then the program goes on.' }),
        element('p', { class: 'cause', text: state.cut_end_line === null ? '' : state.why }),
      ],
      choices: [
        { label: 'Hide' },
        ...(mayRecover ? [this.choice('recover', 'Recover the cut', { main: true })] : []),
        this.choice('agree', 'Restore and go on', { main: !mayRecover }),
      ],
    });
  }
}

/** Lines of a question: those that begin with a name and two spaces as a table, otherwise a list. */
function questionContent(lines) {
  const rows = lines.map(text => /^(\S+)\s{2,}(.*)$/.exec(text));
  if (!rows.every(Boolean)) {
    return element('ul', { class: 'question-lines' }, ...lines.map(text => element('li', { text })));
  }
  const cells = rows.map(([, name, text]) =>
    element('tr', {}, element('th', { scope: 'row', text: name }), element('td', { text })),
  );
  return element('table', { class: 'details' }, element('tbody', {}, ...cells));
}
