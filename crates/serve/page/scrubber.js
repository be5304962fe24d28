// The scrubber: a handwheel along the path. A drag shows a ghost under the finger, and the machine follows it.
//
// Invariant: it sends counts of the handwheel, never a place. Nothing is sent once the finger is up, so that the
// machine stands still; the ghost stays between the oldest and the furthest place.

import { element, isOff, setOff, setText } from './element.js';
import { formatDuration, formatLength, formatStep } from './units.js';
import { lengthBetween, scaleMarks } from './scrubber_scale.js';
import { sign } from './signs.js';

const TICK_MS = 50;
const FOLLOW_S = 0.3;
const DRAG_PIXELS = 6;
const MAX_MARKS = 7;
const SCALE_MS = 250;
const MARK_PIXELS = 72;

/** Whether the machine follows the counts of the handwheel. */
function followsWheel(state) {
  return state?.mode === 'wheel' && state.hold_reason !== 'hold';
}

/** Scrubber. `pathView` has the lengths of the path and shows the ghost. */
export class Scrubber {
  constructor(place, store, orders, actions, pathView) {
    Object.assign(this, { store, orders, actions, pathView });
    const part = name => element('div', { class: `track-part ${name}` });
    this.cut = part('cut');
    this.retraced = part('retraced');
    this.planned = part('planned');
    this.thumb = element('div', { class: 'track-thumb' });
    this.ghost = element('div', { class: 'track-ghost', hidden: true });
    this.scale = element('div', { class: 'track-scale', 'aria-hidden': 'true' });
    this.marks = Array.from({ length: MAX_MARKS + 1 }, () => element('span', { hidden: true }));
    this.scale.append(...this.marks);
    this.placeText = element('span');
    this.historyText = element('span');
    this.timeText = element('span', { class: 'only-wide' });
    const text = element(
      'p',
      { class: 'track-text' },
      this.placeText,
      element('span', {}, this.historyText, this.timeText),
    );
    this.track = element(
      'div',
      { class: 'track', role: 'slider', tabindex: '0', 'aria-label': 'Place on the path' },
      element('div', { class: 'track-bar' }, this.cut, this.retraced, this.planned),
      this.scale,
      this.ghost,
      this.thumb,
    );
    this.back = this.key('back', 'back to', 'Back to a place on the path', () => actions.openBackMenu());
    this.leave = this.key('leave', 'resume', 'Resume: forward to the furthest place, then the program goes on', () =>
      actions.perform('leave'),
    );
    place.append(this.back, element('div', { class: 'track-box' }, text, this.track), this.leave);
    this.ghostRecord = null;
    this.fraction = 0;
    this.listen();
    store.on('state control link live', () => this.showKeys());
  }

  key(signName, label, title, run) {
    const node = element(
      'button',
      {
        type: 'button',
        class: 'track-key',
        title,
        on: {
          click: () => {
            if (!isOff(node)) run();
          },
        },
      },
      sign(signName),
      element('span', { text: label }),
    );
    return node;
  }

  listen() {
    const { track } = this;
    track.addEventListener('pointerdown', event => {
      if (!event.isPrimary || event.button !== 0) return;
      track.setPointerCapture(event.pointerId);
      this.pressed = { id: event.pointerId, x: event.clientX, isDrag: false };
    });
    track.addEventListener('pointermove', event => {
      if (this.pressed?.id !== event.pointerId) return;
      if (!this.pressed.isDrag && Math.abs(event.clientX - this.pressed.x) < DRAG_PIXELS) return;
      if (!this.pressed.isDrag && !this.beginDrag()) return;
      this.dragTo(event.clientX);
    });
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture'])
      track.addEventListener(name, () => this.letGo());
    for (const name of ['blur', 'pagehide']) addEventListener(name, () => this.letGo());
    document.addEventListener('visibilitychange', () => this.letGo());
    track.addEventListener(
      'wheel',
      event => {
        event.preventDefault();
        this.turn(Math.sign(event.deltaX || -event.deltaY));
      },
      { passive: false },
    );
    track.addEventListener('keydown', event => this.onKeyDown(event));
  }

  onKeyDown(event) {
    const counts = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
    if (counts === undefined || event.ctrlKey || event.altKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    event.stopPropagation();
    this.turn(counts);
  }

  /** Turns single counts, in the mode of the handwheel. */
  turn(counts) {
    if (followsWheel(this.store.state)) this.orders.turnWheel(counts);
    else this.hint();
  }

  hint() {
    if (performance.now() - (this.hintedAt ?? -Infinity) < 3000) return;
    this.hintedAt = performance.now();
    this.orders.notices.inform(
      'Drag the bar, or press WHEEL first: then the mouse wheel and the arrow keys turn counts.',
    );
  }

  beginDrag() {
    const { store } = this,
      isWheel = followsWheel(store.state);
    if (!store.live || !store.isHolder || !(isWheel || store.allows('wheel'))) {
      this.pressed = null;
      if (store.isLive && !store.isHolder)
        this.orders.refuse('this page is not in control', 'Take control in the state line.');
      else if (store.isLive) this.orders.notices.inform('The path can be retraced while a job is on the machine.');
      return false;
    }
    this.pressed.isDrag = true;
    // The bar keeps its ends during a drag, so that the ghost stays under the finger.
    this.held = this.ends();
    this.fraction = 0;
    this.hadWheel = false;
    if (!isWheel)
      this.orders.send('wheel').then(isDone => {
        if (!isDone) this.letGo();
      });
    this.timer = setInterval(() => this.follow(), TICK_MS);
    this.track.classList.add('dragging');
    return true;
  }

  dragTo(clientX) {
    const box = this.track.getBoundingClientRect(),
      { live } = this.store;
    const [low, high] = this.ends();
    const wanted = low + ((high - low) * (clientX - box.left)) / box.width;
    this.ghostRecord = Math.min(Math.max(wanted, live.oldest), live.reached);
    this.pathView.setGhost(this.ghostRecord);
    this.show();
  }

  /** Sends the counts of one tick toward the ghost. */
  follow() {
    const { live, hello, state, isHolder } = this.store;
    const isWheel = followsWheel(state);
    // What holds the motion, or ends the mode of the handwheel, ends the drag: the finger has to take the bar again.
    if (!isHolder || (this.hadWheel && !isWheel)) {
      this.letGo();
      return;
    }
    this.hadWheel = isWheel;
    if (this.ghostRecord === null || !isWheel) return;
    const { seconds_per_count: secondsPerCount, max_counts_per_s: maxCounts } = hello.machine.wheel;
    const gap =
      (Math.min(Math.max(this.ghostRecord, live.oldest), live.reached) - live.record) * hello.machine.period_s;
    if (Math.abs(gap) < secondsPerCount / 2) {
      this.fraction = 0;
      return;
    }
    const rate = Math.min(Math.max(gap / FOLLOW_S, -1), 1) * maxCounts;
    const wanted = this.fraction + (rate * TICK_MS) / 1000;
    const nearest = gap / secondsPerCount;
    const counts = Math.trunc(Math.abs(wanted) > Math.abs(nearest) ? nearest : wanted);
    this.fraction = Math.abs(wanted) > Math.abs(nearest) ? 0 : wanted - counts;
    if (counts !== 0) this.orders.turnWheel(counts);
  }

  letGo() {
    clearInterval(this.timer);
    this.timer = null;
    this.pressed = null;
    this.held = null;
    if (this.ghostRecord === null) return;
    this.ghostRecord = null;
    this.track.classList.remove('dragging');
    this.pathView.setGhost(null);
    this.show();
  }

  /** Records at the two ends of the bar. The history fills nine tenths of it, or all there is to plan the rest. */
  ends() {
    if (this.held) return this.held;
    const { live } = this.store,
      history = Math.max(live.reached - live.oldest, 1);
    const ahead = Math.min(Math.max(live.planned - live.reached, 0), history / 6);
    return [live.oldest, live.reached + Math.max(ahead, 1)];
  }

  showKeys() {
    const { actions } = this,
      { live } = this.store;
    setOff(this.back, !['back-by', 'back-block', 'back-jet'].some(id => actions.isPossible(id)));
    setOff(this.leave, !actions.isPossible('leave'));
    const mayDrag = this.store.isHolder && live && (followsWheel(this.store.state) || this.store.allows('wheel'));
    this.track.setAttribute('aria-disabled', mayDrag ? 'false' : 'true');
  }

  /** Shows the newest live figures; called once a frame. */
  show() {
    const { live } = this.store;
    if (!live) return;
    const [low, high] = this.ends(),
      span = Math.max(high - low, 1);
    const share = record => Math.min(Math.max((record - low) / span, 0), 1);
    const stretch = (node, from, to) => {
      const left = (share(from) * 100).toFixed(3),
        scale = (share(to) - share(from)).toFixed(5);
      node.style.transform = `translateX(${left}%) scaleX(${scale})`;
    };
    stretch(this.cut, live.oldest, live.record);
    stretch(this.retraced, live.record, live.reached);
    stretch(this.planned, live.reached, live.planned);
    this.thumb.style.left = `${(share(live.record) * 100).toFixed(3)}%`;
    this.ghost.hidden = this.ghostRecord === null;
    if (this.ghostRecord !== null) this.ghost.style.left = `${(share(this.ghostRecord) * 100).toFixed(3)}%`;
    this.showText(live);
    const now = performance.now();
    if (now - (this.scaledAt ?? -Infinity) > SCALE_MS) {
      this.scaledAt = now;
      this.showScale(live, share);
    }
  }

  showText(live) {
    const isGhost = this.ghostRecord !== null;
    const back = isGhost
      ? lengthBetween(this.pathView.chunks.lengthTable(), live, this.ghostRecord, live.reached)
      : live.back_mm;
    const text = isGhost
      ? `to ${formatLength(back)} back`
      : live.back_mm > 0.05
        ? `${formatLength(back)} back`
        : 'furthest place';
    setText(this.placeText, text);
    setText(this.historyText, `history ${formatLength(live.history_mm, 0)}`);
    setText(this.timeText, `, ${formatDuration(live.history_s)}`);
    this.track.setAttribute('aria-valuemin', String(Math.round(live.oldest)));
    this.track.setAttribute('aria-valuemax', String(Math.round(live.reached)));
    this.track.setAttribute('aria-valuenow', String(Math.round(live.record)));
    this.track.setAttribute('aria-valuetext', text);
  }

  showScale(live, share) {
    const width = this.track.clientWidth,
      most = Math.min(Math.max(Math.floor(width / MARK_PIXELS), 1), MAX_MARKS);
    const marks = scaleMarks(this.pathView.chunks.lengthTable(), live, most);
    // The marks nearest to the furthest place come first. One whose text would be cut off or lie over another is
    // left out.
    let free = Infinity;
    this.marks.forEach((node, index) => {
      const entry = marks[index],
        x = entry ? share(entry.record) * width : 0;
      node.hidden = !entry || x < MARK_PIXELS / 3 || x > free - MARK_PIXELS;
      if (node.hidden) return;
      free = x;
      node.style.left = `${((x / width) * 100).toFixed(2)}%`;
      setText(node, formatStep(Number(entry.mm.toFixed(3))));
    });
  }
}
