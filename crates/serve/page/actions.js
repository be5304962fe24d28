// Carries out the actions of the key table: by an order to the machine, or by a part of the page.
//
// Invariant: an action that moves or switches something is carried out only if the server offers it now.

import { closeDialog, confirm, openDialog, openDialogKey, prompt } from './dialog.js';
import { element } from './element.js';
import { formatLength, formatPosition, lengthUnit, orderNumber, parseLength } from './units.js';

const RETRACE_PERCENTS = [100, 50, 25, 10];
const RAPID_PERCENTS = [100, 50, 25, 0];
const NEW_PERCENT_MS = 1500;
const MIN_OVERRIDE = 0;

const ORDERS = {
  'cycle-start': 'cycle start',
  'reverse-rapid': 'reverse 800%',
  'forward-rapid': 'forward 800%',
  wheel: 'wheel',
  leave: 'leave',
  'leave-ask': 'leave ask',
  'back-block': 'back to block',
  'back-jet': 'back to pierce',
  'back-to-cut-end': 'back to cut end',
  whole: 'override 100%',
  single: 'single',
  pause: 'pause',
  park: 'park',
  pointer: 'pointer',
  'change-done': 'change done',
  'cutter-off': 'cutter off',
  'cutter-on': 'cutter on',
  recover: 'recover',
  'height-up': 'height up',
  'height-down': 'height down',
  'height-reset': 'height reset',
  online: 'online',
  'clear-alarm': 'reset',
  home: 'home',
};

/** Actions of the page: they move nothing, and watchers have them too. */
const PAGE_ACTIONS = new Set([
  'hold',
  'view',
  'zoom-in',
  'zoom-out',
  'pan',
  'fit',
  'messages',
  'help',
  'tools',
  'shop-jobs',
  'contours',
  'open-program',
  'mdi',
  'probe',
  'work-zero',
  'step',
  'next-axis',
  'jog',
]);

/** Name of the method of an action: `performBackBy` for `back-by`. */
function methodName(id) {
  return `perform${id.replace(/(^|-)([a-z])/g, (_, dash, letter) => letter.toUpperCase())}`;
}

/** Actions of the keyboard, of the suggestions and of the dialogs. */
export class ActionTable {
  constructor(store, orders) {
    Object.assign(this, { store, orders });
    this.page = {};
    this.retracePercent = { mode: '', percent: 100 };
    this.wantedOverride = { percent: 100, at: -Infinity };
    this.wantedSpeed = { percent: 100, at: -Infinity };
    // What is accepted is what the dialog shows.
    store.on('state', () => {
      if (openDialogKey() === 'sheet' && JSON.stringify(store.state.sheet) !== this.shownSheet) closeDialog('sheet');
    });
  }

  /** Registers what the page does for some actions. */
  register(handlers) {
    Object.assign(this.page, handlers);
  }

  /** Row of the key table. */
  row(id) {
    return this.store.hello?.actions.find(action => action.id === id);
  }

  label(id) {
    return this.row(id)?.label ?? id.replaceAll('-', ' ');
  }

  /** Key of an action as it is written on a button. */
  keyText(id) {
    const key = this.row(id)?.keys?.[0];
    return key === ' ' ? 'Space' : (key ?? '');
  }

  /** Whether the action can be carried out now by this page. */
  isPossible(id) {
    if (id === 'hold') return true;
    if (PAGE_ACTIONS.has(id)) return this.page[id] !== undefined;
    if (id === 'quit') return this.store.isHolder && !this.store.isSetup;
    return this.store.allows(id);
  }

  /** Carries out an action. Returns whether it could. */
  perform(id) {
    if (id === 'hold') {
      this.orders.hold();
      return true;
    }
    if (!this.isPossible(id)) return false;
    if (this.page[id]) this.page[id]();
    else if (ORDERS[id]) this.orders.send(ORDERS[id]);
    else this[methodName(id)]?.();
    return true;
  }

  /** Next percentage of a repeated reverse or forward run. */
  retrace(mode) {
    const state = this.store.state,
      last = this.retracePercent;
    const again = last.mode === mode && state.mode === mode && !state.word.includes('HOLD');
    const index = again ? (RETRACE_PERCENTS.indexOf(last.percent) + 1) % RETRACE_PERCENTS.length : 0;
    this.retracePercent = { mode, percent: RETRACE_PERCENTS[index] };
    this.orders.send(`${mode} ${RETRACE_PERCENTS[index]}%`);
  }

  performReverse() {
    this.retrace('reverse');
  }
  performForward() {
    this.retrace('forward');
  }

  /** Changes the feed override by some percent. Presses in quick succession add up. */
  changeOverride(difference) {
    const now = performance.now(),
      { state } = this.store;
    const shown = Math.round(state.override * 100);
    const from =
      now - this.wantedOverride.at < NEW_PERCENT_MS ? this.wantedOverride.percent : Math.round(shown / 10) * 10;
    const most = Math.round((state.override_max ?? 1) * 100);
    const percent = Math.min(Math.max(from + difference, MIN_OVERRIDE), most);
    this.wantedOverride = { percent, at: now };
    this.orders.send(`override ${percent}%`);
  }

  performFaster() {
    this.changeOverride(10);
  }
  performSlower() {
    this.changeOverride(-10);
  }

  changeRapidOverride(down) {
    const shown = Math.round(this.store.state.rapid_override * 100);
    const next = down
      ? (RAPID_PERCENTS.find(percent => percent < shown) ?? 0)
      : (RAPID_PERCENTS.findLast(percent => percent > shown) ?? 100);
    this.orders.send(`rapid override ${next}%`);
  }

  /** Changes the override of the spindle speed by some percent. Presses in quick succession add up. */
  changeSpeedOverride(difference) {
    const now = performance.now();
    const shown = Math.round(this.store.state.speed_override * 10) * 10;
    const from = now - this.wantedSpeed.at < NEW_PERCENT_MS ? this.wantedSpeed.percent : shown;
    const percent = Math.min(Math.max(from + difference, 10), 200);
    this.wantedSpeed = { percent, at: now };
    this.orders.send(`speed override ${percent}%`);
  }

  performSpindleFaster() {
    this.changeSpeedOverride(10);
  }
  performSpindleSlower() {
    this.changeSpeedOverride(-10);
  }

  performRapidOverride() {
    const shown = Math.round(this.store.state.rapid_override * 100);
    this.orders.send(`rapid override ${RAPID_PERCENTS.find(percent => percent < shown) ?? 100}%`);
  }

  performAgree() {
    this.orders.send(this.store.state.question ? 'yes' : 'agree');
  }
  performDecline() {
    this.orders.send('no');
  }
  performSpindle() {
    this.orders.send(this.store.state.pause?.stopped ? 'spindle start' : 'spindle stop');
  }

  /** Takes a point of the edge of the sheet, after saying what it is for; with both points, asks whether to set it. */
  performSheetEdge() {
    const sheet = this.store.state.sheet,
      points = sheet?.points ?? 0;
    if (points < 2) {
      const where = points === 0 ? 'at the zero of the job' : 'further along it, 50 mm or more';
      openDialog({
        key: 'sheet-point',
        title: 'Align the job to the edge of the sheet',
        content: [
          element('p', {
            text:
              'Two points on the edge set the work zero and the direction of the job. ' +
              `Jog the tool to the edge, ${where}.`,
          }),
        ],
        choices: [
          { label: 'Cancel' },
          points === 1 ? { label: 'Forget the first point', run: () => this.orders.send('sheet forget') } : null,
          {
            label: `Take the ${points === 0 ? 'first' : 'second'} point here`,
            main: true,
            run: () => this.orders.send('sheet point'),
          },
        ].filter(Boolean),
      });
      return;
    }
    this.shownSheet = JSON.stringify(sheet);
    openDialog({
      key: 'sheet',
      title: 'The edge of the sheet',
      // The drawing beside it shows where the job would lie.
      isModal: false,
      isAside: true,
      content: [
        element('p', { text: sheet.text }),
        sheet.travel_text ? element('p', { class: 'cause', text: sheet.travel_text }) : null,
      ].filter(Boolean),
      choices: [
        { label: 'Cancel' },
        { label: 'Forget both points', run: () => this.orders.send('sheet forget') },
        { label: 'Set zero and direction', main: true, run: () => this.orders.send('sheet align') },
      ],
    });
  }

  performFrame() {
    const what = 'the rectangle around what is cut, along X and Y of the machine';
    this.askFrame({ words: 'frame', title: 'Frame: the rectangle', what });
  }

  performOutline() {
    this.askFrame({ words: 'frame outline', title: 'Frame: the outline', what: 'the outline of what is cut' });
  }

  /** Says what the tool goes round, and shows it in the drawing, before anything moves. */
  askFrame({ words, title, what }) {
    const { store } = this,
      extents = store.state.cut_extents_mm;
    // It is refused then, which says why.
    if (store.state.sheet) return this.orders.send(words);
    const range = (letter, [low, high]) => `${letter} ${formatPosition(low)} to ${formatPosition(high)}`;
    const [x, y] = extents ?? [];
    let isSent = false;
    store.showFrame(extents);
    const send = async () => {
      isSent = true;
      if (!(await this.orders.send(words))) store.showFrame(null);
    };
    openDialog({
      key: 'frame',
      title,
      isModal: false,
      isAside: true,
      content: [
        element('p', { text: `The tool goes round ${what}, with the cutters off. HOLD stops it.` }),
        extents
          ? element('p', { class: 'cause', text: `${range('X', x)}, ${range('Y', y)} ${lengthUnit()} of the machine` })
          : null,
        this.frameHeight(),
      ].filter(Boolean),
      choices: [{ label: 'Cancel' }, { label: 'Go round', main: true, run: send }],
      // The choice runs behind this.
      onClose: () => setTimeout(() => isSent || store.showFrame(null)),
    });
  }

  /** At which height the tool goes round, as a paragraph, or null. */
  frameHeight() {
    const { state, live } = this.store;
    if (!state.frame_height || !live) return null;
    const [axis, safe] = state.frame_height,
      letter = this.store.axis(axis)?.letter.toUpperCase() ?? '',
      place = mm => `${letter} ${formatPosition(mm)} ${lengthUnit()} of the machine`,
      now = live.mm[axis];
    if (safe === null) return element('p', { class: 'frame-height', text: `Stays at ${place(now)}: no safe height is set.` });
    const text = safe > now ? `First up to ${place(safe)} (safe height).` : `Stays at ${place(now)}, above the safe height.`;
    return element('p', { class: 'frame-height', text });
  }

  performHeightControl() {
    this.orders.send(`height control ${this.store.live?.height?.is_on ? 'off' : 'on'}`);
  }

  performFollowSpindle() {
    this.orders.send(this.store.live?.gear === 'by_hand' ? 'follow off' : 'follow spindle');
  }

  performOptionalStop() {
    this.orders.send(`optional stop ${this.store.state.optional_stop ? 'off' : 'on'}`);
  }

  performDryRun() {
    this.orders.send(`dry run ${this.store.state.dry_run ? 'off' : 'on'}`);
  }

  performSetUp() {
    confirm({
      title: 'Release the job and set up?',
      text: 'Reverse run over this job ends with it.',
      label: 'Set up',
      run: () => this.orders.send('set up'),
    });
  }

  performTestPulse() {
    confirm({
      title: 'Fire a test pulse?',
      text: 'The cutter comes on at this place, at rest.',
      label: 'Fire',
      run: () => this.orders.send('test pulse'),
    });
  }

  performSenseTest() {
    confirm({
      title: 'Sense the sheet here?',
      text: 'The tool goes down to the sheet with the cutter off, and back up. HOLD stops it.',
      label: 'Sense',
      run: () => this.orders.send('sense test'),
    });
  }

  performConsumablesChanged() {
    confirm({
      title: 'New consumables?',
      text: 'Starts, time and length are counted from 0 again.',
      label: 'They are new',
      run: () => this.orders.send('consumables changed'),
    });
  }

  performSkipContour() {
    confirm({
      title: 'Skip the rest of this contour?',
      text: 'It is passed with the cutter off.',
      label: 'Skip',
      run: () => this.orders.send('skip contour'),
    });
  }

  performQuit() {
    confirm({
      title: 'Stop the job?',
      text: 'The machine brakes on the path. The job can be resumed later.',
      label: 'STOP',
      run: () => this.orders.send('stop'),
    });
  }

  performCutFromHere() {
    const choice = (label, words, extra = {}) => ({ label, run: () => this.orders.send(words), ...extra });
    openDialog({
      key: 'cut',
      title: 'Cut from here',
      content: [
        element('p', {
          text:
            'The program is executed again from the ' +
            'place where the machine stands. Contours that are cut already are passed with the cutter off.',
        }),
      ],
      choices: [
        { label: 'Cancel' },
        choice('Cut', 'cut', { main: true }),
        choice('Pierce first', 'cut pierce'),
        choice('Start moving', 'cut moving'),
        choice('Cut all again', 'cut all'),
      ],
    });
  }

  performBackBy() {
    prompt({
      title: 'Back along the path',
      text: `Length in ${lengthUnit()}, or a contour: c3`,
      label: 'Back',
      value: '',
      check: text => (/^c\d+$/i.test(text.trim()) || parseLength(text) > 0 ? null : 'Enter a length above 0, or c3.'),
      run: text => {
        const contour = /^c(\d+)$/i.exec(text.trim());
        this.orders.send(contour ? `back to contour ${contour[1]}` : `back ${orderNumber(parseLength(text))} mm`);
      },
    });
  }

  performShift() {
    const choice = (label, words) => ({ label, run: () => this.orders.send(words) });
    openDialog({
      key: 'shift',
      title: 'Shift the start of the cut',
      content: [element('p', { text: 'The next start lies one width of the kerf further in this direction.' })],
      choices: [
        ...['NW', 'N', 'NE'].map(name => choice(name, `shift ${name.toLowerCase()}`)),
        choice('W', 'shift w'),
        choice('none', 'shift 0'),
        choice('E', 'shift e'),
        ...['SW', 'S', 'SE'].map(name => choice(name, `shift ${name.toLowerCase()}`)),
        { label: 'X, Y …', run: () => this.enterShift() },
        choice('Lead in by an arc', 'lead arc'),
        choice('Lead in straight', 'lead line'),
        { label: 'Cancel', isSafe: true },
      ],
    });
  }

  enterShift() {
    const parse = text =>
      text
        .trim()
        .split(/[\s;]+/)
        .map(parseLength);
    prompt({
      title: 'Shift the start of the cut',
      text: `X and Y in ${lengthUnit()}, separated by a space`,
      label: 'Shift',
      check: text => (parse(text).length === 2 && parse(text).every(mm => mm !== null) ? null : 'Enter two lengths.'),
      run: text => this.orders.send(`shift ${parse(text).map(orderNumber).join(' ')}`),
    });
  }

  performToolLength() {
    const choice = (label, run, extra = {}) => ({ label, run, ...extra });
    openDialog({
      key: 'tool-length',
      title: 'Length of the new tool',
      content: [
        element('p', {
          text:
            'Enter its length; or jog its tip down until it touches the work, and say at which Z of the work that is. ' +
            'Nothing moves by it: the way back and the path are shifted.',
        }),
      ],
      choices: [
        { label: 'Cancel' },
        choice('Enter the length \u2026', () => this.enterToolLength()),
        choice('Its tip touches Z \u2026', () => this.enterTouchedZ()),
      ],
    });
  }

  enterTouchedZ() {
    prompt({
      title: 'Z of the work that the tip touches',
      text: `In ${lengthUnit()}: 0 at the work zero`,
      label: 'Set',
      value: '0',
      check: text => (parseLength(text) === null ? 'Enter a length.' : null),
      run: text => this.orders.send(`tool length at ${orderNumber(parseLength(text))}`),
    });
  }

  enterToolLength() {
    prompt({
      title: 'Length of the new tool',
      text: `In ${lengthUnit()}: the length, or a difference with + or \u2212`,
      label: 'Set',
      check: text => (parseLength(text) === null ? 'Enter a length.' : null),
      run: text => {
        const mm = orderNumber(parseLength(text));
        this.orders.send(/^\s*[+\-\u2212]/.test(text) ? `tool length by ${mm}` : `tool length ${mm}`);
      },
    });
  }

  performOutput() {
    this.page.outputs?.();
  }

  /** Opens the choices of where to go back to. */
  openBackMenu() {
    const { live } = this.store;
    const choice = (id, label) => ({ label, run: () => this.perform(id), off: !this.isPossible(id) });
    openDialog({
      key: 'back',
      title: 'Back along the path to …',
      content: [element('p', { text: live ? `The history reaches ${formatLength(live.history_mm)} back.` : '' })],
      choices: [
        { label: 'Cancel' },
        choice('back-by', 'A distance or a contour …'),
        choice('back-block', 'Start of the block'),
        choice('back-jet', 'Last pierce'),
        choice('back-to-cut-end', 'End of the interrupted cut'),
        choice('reverse-rapid', 'Rapid reverse run'),
      ],
    });
  }
}
