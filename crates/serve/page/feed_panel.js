// Shows feed, rate and times; sets the overrides; shows the cutter and its height; switches the outputs.
//
// Invariant: an output of a cutter is switched on only after a question.

import { button, element, setChildren, setOff, setText, isOff } from './element.js';
import { HeightLine } from './height_line.js';
import { confirm, openDialog } from './dialog.js';
import { feedUnit, formatDuration, formatFeed, formatPercent } from './units.js';
import { sign } from './signs.js';

const SHOWN_OUTPUTS = 4;
/** Stages in which a job runs, or has run. */
const RUN_STAGES = ['job', 'ended'];
const CUTTER_WORDS = {
  off: 'off',
  sensing: 'sensing the sheet',
  igniting: 'igniting',
  piercing: 'piercing',
  cutting: 'CUTTING',
  ending: 'ending',
  lost: 'OFF',
  dry: 'off: dry run',
  test: 'TEST PULSE',
};

const OFF_REASONS = {
  at_rest: 'at rest too long',
  reverse: 'reverse run',
  dry_run: 'dry run',
  host_silent: 'the host was silent',
  lost: 'lost in the cut',
  not_started: 'it did not start',
  no_sheet: 'no sheet found',
  sheet_contact: 'touched the sheet',
  height_limit: 'height control at the end of its range',
  operator: 'by the operator',
  program_end: 'end of the program',
  job_stopped: 'the job was stopped',
  kerf: 'the kerf is passed',
};

/** Feed, overrides, cutter and outputs. */
export class FeedPanel {
  constructor(place, store, orders, actions) {
    Object.assign(this, { place, store, orders, actions });
    const figure = name => {
      const value = element('b');
      return { value, node: element('span', { class: 'figure' }, `${name} `, value) };
    };
    this.feed = figure('F');
    this.unit = element('small');
    this.feed.node.append(' ', this.unit);
    this.rate = figure('rate');
    this.left = figure('left');
    this.run = figure('run');
    this.spindle = figure('spindle');
    this.spindle.node.hidden = true;
    this.cutter = element('p', { class: 'cutter-line' });
    this.height = new HeightLine(store, actions);
    this.feedOverride = this.overrideKeys('feed', 'slower');
    this.rapidOverride = this.overrideKeys('rapid', 'rapid-override');
    this.speedOverride = this.overrideKeys('speed', 'spindle-faster');
    this.outputs = element('div', { class: 'outputs', role: 'group', 'aria-label': 'Outputs' });
    this.outputButtons = [];
    place.append(
      element('div', { class: 'figures' }, this.feed.node, this.rate.node, this.left.node, this.run.node, this.spindle.node),
      element('div', { class: 'overrides' }, this.feedOverride.node, this.rapidOverride.node, this.speedOverride.node),
      this.cutter,
      this.height.node,
      this.outputs,
    );
    store.on('hello', hello => this.build(hello));
    store.on('state control link', () => this.showState());
    actions.register({ outputs: () => this.openOutputs() });
  }

  overrideKeys(name, id) {
    const { orders, actions } = this;
    const change = {
      feed: up => actions.changeOverride(up ? 10 : -10),
      rapid: up => actions.changeRapidOverride(!up),
      speed: up => actions.changeSpeedOverride(up ? 10 : -10),
    }[name];
    const run = perform => event => {
      if (!isOff(event.currentTarget)) perform();
    };
    const less = element(
      'button',
      {
        type: 'button',
        'aria-label': `${name} override down`,
        on: { click: run(() => change(false)) },
      },
      sign('minus'),
    );
    const more = element(
      'button',
      {
        type: 'button',
        'aria-label': `${name} override up`,
        on: { click: run(() => change(true)) },
      },
      sign('plus'),
    );
    const value = element('b', { text: '100 %' });
    const whole = element(
      'button',
      {
        type: 'button',
        class: 'whole',
        title: 'Set to 100 %',
        on: { click: run(() => orders.send(name === 'feed' ? 'override 100%' : `${name} override 100%`)) },
      },
      element('small', { text: name }),
      value,
    );
    const node = element(
      'div',
      { class: 'override', role: 'group', 'aria-label': `${name} override` },
      less,
      whole,
      more,
    );
    return { node, value, whole, buttons: [less, whole, more], id };
  }

  build(hello) {
    const { outputs, has_spindle: hasSpindle } = hello.machine;
    this.speedOverride.node.hidden = !hasSpindle;
    const sorted = [...outputs].sort((a, b) => Number(b.is_cutter) - Number(a.is_cutter));
    const isMore = sorted.length > SHOWN_OUTPUTS;
    const shown = sorted.slice(0, isMore ? SHOWN_OUTPUTS - 1 : SHOWN_OUTPUTS);
    this.outputButtons = shown.map(output => this.outputButton(output));
    const more = isMore ? button(`all ${outputs.length}`, () => this.openOutputs()) : null;
    setChildren(this.outputs, ...this.outputButtons.map(entry => entry.node), more);
    this.outputs.dataset.count = String(shown.length + (isMore ? 1 : 0));
    this.showState();
  }

  outputButton(output) {
    const mark = element('span', { class: 'output-mark', 'aria-hidden': 'true' }),
      expected = element('small');
    const node = element(
      'button',
      { type: 'button', class: 'output', 'aria-pressed': 'false', on: { click: () => this.toggle(output, node) } },
      mark,
      element('span', { class: 'output-name', text: output.name }),
      expected,
    );
    return { output, node, mark, expected };
  }

  valueOf(output) {
    return this.store.state?.outputs.find(entry => entry.channel === output.channel);
  }

  toggle(output, node) {
    if (isOff(node)) return;
    const isOn = (this.valueOf(output)?.value ?? 0) !== 0;
    const send = () => this.orders.send(`output ${output.channel} ${isOn ? 'off' : 'on'}`);
    if (isOn && output.is_cutter) this.orders.send('cutter off');
    else if (!isOn && output.is_cutter) {
      confirm({
        title: `Switch ${output.name} on?`,
        text: 'It is a cutter: it fires where the machine stands.',
        label: `${output.name} on`,
        run: send,
      });
    } else send();
  }

  openOutputs() {
    const entries = (this.store.hello?.machine.outputs ?? []).map(output => this.outputButton(output));
    const list = element('div', { class: 'outputs in-dialog' }, ...entries.map(entry => entry.node));
    this.dialogButtons = entries;
    openDialog({
      key: 'outputs',
      title: 'Outputs',
      content: [list],
      choices: [{ label: 'Close' }],
      onClose: () => {
        this.dialogButtons = [];
      },
    });
    this.showOutputs();
  }

  showOutputs() {
    const mayCut = this.store.allows('cutter-on') || this.store.allows('output');
    for (const { output, node, mark, expected } of [...this.outputButtons, ...(this.dialogButtons ?? [])]) {
      const entry = this.valueOf(output),
        isOn = (entry?.value ?? 0) !== 0;
      const differs =
        entry && entry.expected !== null && entry.expected !== undefined && entry.expected !== entry.value;
      node.classList.toggle('on', isOn);
      node.classList.toggle('differs', Boolean(differs));
      node.setAttribute('aria-pressed', String(isOn));
      node.title = differs ? `${output.name}: the program expects ${entry.expected ? 'on' : 'off'}` : output.name;
      setText(mark, `${isOn ? '■' : '□'}${differs ? '≠' : ''}`);
      setText(expected, differs ? `is ${isOn ? 'on' : 'off'}, program: ${entry.expected ? 'on' : 'off'}` : '');
      setOff(
        node,
        output.is_cutter && !isOn ? !mayCut : !this.store.allows('output') && !this.store.allows('cutter-off'),
      );
    }
  }

  showState() {
    const { store } = this,
      { state } = store;
    if (!state) return;
    const isOff = state.override_is_off;
    for (const [keys, share] of [
      [this.feedOverride, state.override],
      [this.rapidOverride, state.rapid_override],
      [this.speedOverride, state.speed_override],
    ]) {
      setText(keys.value, formatPercent(share) + (isOff ? ' · off' : ''));
      keys.whole.title = isOff ? 'Switched off by the program: it runs at 100 %' : 'Set to 100 %';
      for (const node of keys.buttons) setOff(node, !store.allows(keys.id));
    }
    this.showOutputs();
    this.show();
  }

  /** Shows the measured speed of a spindle with an encoder, and whether the motion follows it. */
  showSpindle(live) {
    const rpm = live?.rpm;
    this.spindle.node.hidden = rpm === null || rpm === undefined;
    const gear = { waiting: ' · waits for its angle', engaged: ' · thread', by_hand: ' · by hand', freed: ' · tool free' }[live?.gear] ?? '';
    setText(this.spindle.value, `${rpm ?? 0}/min${gear}`);
  }

  /** Shows the newest live figures; called once a frame. */
  show() {
    const { live, state } = this.store;
    if (!state) return;
    setText(this.unit, feedUnit());
    setText(this.feed.value, formatFeed(live?.feed));
    setText(this.rate.value, formatPercent(live?.rate));
    setText(this.left.value, formatDuration(live?.left_s));
    // Before a job runs its time is that of the machine since it was switched on.
    setText(this.run.value, formatDuration(RUN_STAGES.includes(state.stage) ? live?.run_s : null));
    this.showSpindle(live);
    this.showCutter(state, live);
    this.height.show(live);
  }

  showCutter(state, live) {
    const { cutter } = state;
    this.cutter.hidden = !cutter;
    if (!cutter) return;
    const seconds = live?.seconds_lit ?? cutter.seconds_lit;
    // The reason stays in the state after the cutter was lit again.
    const why = ['off', 'lost'].includes(cutter.state) ? cutter.off_reason : null;
    const reason = why && (OFF_REASONS[why] ?? why.replaceAll('_', ' '));
    const word = CUTTER_WORDS[cutter.state] ?? cutter.state;
    const parts = [`${cutter.name}: ${word}${reason ? `, ${reason}` : ''}`];
    if (seconds !== null && seconds !== undefined) parts.push(`${seconds.toFixed(1)} s`);
    if (cutter.contour) parts.push(`contour ${cutter.contour}${cutter.contours ? ` of ${cutter.contours}` : ''}`);
    setText(this.cutter, parts.join(' · '));
    this.cutter.dataset.state = cutter.state;
  }
}
