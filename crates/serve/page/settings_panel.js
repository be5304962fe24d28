// Settings of this page: unit, theme, name; options of the next run; the session.
//
// Invariant: units and theme change the display of this page only; what concerns the machine is an order like any
// other.

import { button, element, isOff, setAttribute, setChildren, setOff, setText } from './element.js';
import { changeSetting, onSettingChange, setting } from './settings.js';

/** Settings. */
export class SettingsPanel {
  constructor(store, connection, actions) {
    Object.assign(this, { store, connection, actions });
    this.choices = [];
    this.name = element('input', {
      type: 'text',
      maxlength: '40',
      'aria-label': 'Name of this page',
      value: setting('pageName'),
      placeholder: 'tablet at the saw',
      on: { change: () => this.changeName() },
    });
    this.facts = element('dl', { class: 'facts' });
    this.inputs = element('div', { class: 'inputs' });
    this.switches = [
      ['single', 'Single block', state => state.single],
      ['optional-stop', 'Stop at M1', state => state.optional_stop],
      ['dry-run', 'Dry run: the cutter stays off', state => state.dry_run],
    ].map(([id, label, read]) => {
      const node = button(
        label,
        () => {
          if (!isOff(node)) actions.perform(id);
        },
        { class: 'toggle', 'aria-pressed': 'false' },
      );
      return { id, node, read };
    });
    this.node = element(
      'div',
      { class: 'list settings', tabindex: '0', role: 'region', 'aria-label': 'Settings' },
      group(
        'Unit of length',
        this.choice('unit', [
          ['mm', 'millimetres'],
          ['inch', 'inches'],
        ]),
      ),
      group(
        'Theme',
        this.choice('theme', [
          ['auto', 'as the device'],
          ['dark', 'dark'],
          ['light', 'light'],
        ]),
      ),
      group('Name of this page', this.name),
      group('Program', ...this.switches.map(each => each.node)),
      group(
        'Session',
        button('Sign out', () => connection.signOut()),
      ),
      group('Inputs', this.inputs),
      group('This machine', this.facts),
    );
    store.on('hello', hello => {
      this.showFacts(hello);
      this.showInputs();
    });
    store.on('state control link', () => this.showState());
    onSettingChange(() => this.showChoices());
  }

  choice(name, values) {
    const node = element('div', { class: 'segments', role: 'radiogroup' });
    for (const [value, label] of values) {
      const choice = button(label, () => changeSetting(name, value), { role: 'radio' });
      this.choices.push({ name, value, choice });
      node.append(choice);
    }
    this.showChoices();
    return node;
  }

  showChoices() {
    for (const { name, value, choice } of this.choices) {
      choice.setAttribute('aria-checked', String(setting(name) === value));
    }
  }

  changeName() {
    const name = this.name.value.trim();
    changeSetting('pageName', name);
    if (name) this.connection.send({ t: 'name', name });
  }

  showFacts(hello) {
    const axes = hello.machine.axes.map(axis => axis.letter.toUpperCase()).join(' ');
    const facts = [
      ['machine', hello.machine.name],
      ['axes', axes],
      ['control period', `${hello.machine.period_s * 1000} ms`],
      ['retrace', hello.version],
      ['rights', hello.rights],
      ['this page', hello.name],
    ];
    setChildren(
      this.facts,
      ...facts.flatMap(([name, value]) => [element('dt', { text: name }), element('dd', { text: value ?? '' })]),
    );
    if (!this.name.value) setAttribute(this.name, 'placeholder', hello.name);
  }

  showInputs() {
    const { state, hello } = this.store,
      named = hello?.machine.inputs ?? [];
    const words = named.map(({ number, name }) => {
      const isOn = ((state?.inputs ?? 0) >> number) % 2 === 1;
      return element('span', { class: isOn ? 'on' : null, text: `${isOn ? '■' : '□'} ${name}` });
    });
    setChildren(this.inputs, ...(words.length > 0 ? words : ['The machine file declares none.']));
  }

  showState() {
    if (this.shownInputs !== this.store.state?.inputs) {
      this.shownInputs = this.store.state?.inputs;
      this.showInputs();
    }
    for (const { id, node, read } of this.switches) {
      const isOn = Boolean(this.store.state && read(this.store.state));
      node.setAttribute('aria-pressed', String(isOn));
      setText(node.lastChild, `${isOn ? '■' : '□'} ${node.textContent.replace(/^[■□] /, '')}`);
      setOff(node, !this.actions.isPossible(id));
    }
  }
}

function group(title, ...nodes) {
  return element(
    'div',
    { class: 'setting', role: 'group', 'aria-label': title },
    element('h2', { text: title }),
    element('div', { class: 'setting-row' }, ...nodes),
  );
}
