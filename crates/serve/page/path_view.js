// Shows the path: what is cut, retraced and planned, the tool, the furthest place, and the limits of the machine.
//
// Invariant: pictures are made from the newest state only, at most one a frame, and only after a change.

import { button, element, setText, svgElement } from './element.js';
import { PathCamera, VIEWS } from './path_camera.js';
import { PathChunks } from './path_chunks.js';
import { PathRenderer } from './path_renderer.js';
import { followGestures } from './path_gestures.js';
import { FrameLine } from './frame_line.js';
import { PathPlacement } from './path_placement.js';
import { nearestCut } from './path_hit.js';
import { formatPosition } from './units.js';
import { onSettingChange } from './settings.js';
import { pathColours } from './path_colours.js';
import { sign } from './signs.js';

const MAX_VERTICES_SOFTWARE = 70_000;
const MAX_VERTICES = 1_000_000;
const LOCATE_MS = 120;
/** Interval of pictures of the moving tool where the path is drawn on the CPU, which has the rest of the page to draw too. */
const LIVE_MS_SOFTWARE = 32;
const FIT_MARGIN_MM = 1;
/** Room for the legend above and the tools below, in pixels. */
const FIT_TOP = 30,
  FIT_BOTTOM = 56;
/** A contour is selected by a tap within so many pixels of it. */
const FINGER_PIXELS = 24;
/** Most skipped contours that are drawn as such. */
const MAX_SKIPPED = 200;
const SKIPPED_DASH_PIXELS = 14;
/** Ink of a range that is drawn in the colours of its state. */
const STATE_COLOURS = [0, 0, 0, 0];

/** The path view. `orders` asks which line made a record, `contours` is the table of contours. */
export class PathView {
  constructor(place, store, { connection, orders, actions, contours }) {
    Object.assign(this, { store, connection, orders, contours, drawnAt: 0 });
    this.camera = new PathCamera();
    this.colours = pathColours();
    this.canvas = element('canvas', { id: 'path-canvas', role: 'img', 'aria-label': 'Tool path' });
    this.tool = mark('tool', 'M12 2v20M2 12h20M12 5a7 7 0 1 0 0 14a7 7 0 1 0 0-14z');
    this.furthest = mark('furthest', 'M12 3l9 9-9 9-9-9z');
    this.ghost = mark('ghost', 'M12 4a8 8 0 1 0 0 16a8 8 0 1 0 0-16z');
    this.frameLine = new FrameLine(store);
    this.note = element('p', { class: 'path-note', hidden: true });
    this.chosenText = element('p', { class: 'chosen-text', 'aria-live': 'polite' });
    // Where the list has no room beside the drawing.
    this.listButton = button('Contour …', () => actions.perform('contours'), { class: 'contour-open', hidden: true });
    this.place = element(
      'div',
      { id: 'path-view' },
      this.canvas,
      this.frameLine.node,
      this.furthest,
      this.ghost,
      this.tool,
      this.legend(),
      this.toolbar(),
      this.chosenText,
      this.listButton,
      this.note,
    );
    place.append(this.place);
    this.blockRange = this.shownPath = null;
    this.ghostRecord = null;
    this.follows = 'program';
    this.begin();
    followGestures(this.canvas, {
      pan: (dx, dy) => {
        this.setFollowsTool(false);
        this.moved(() => this.camera.pan(dx, dy));
      },
      zoom: (x, y, factor) => this.moved(() => this.camera.zoomAt(x, y, factor)),
      turn: (dx, dy) =>
        this.moved(() => (this.camera.view === '3-D' ? this.camera.turn(dx, dy) : this.camera.pan(dx, dy))),
      tap: (x, y) => this.pick(x, y),
      doubleTap: () => this.fit('program'),
    });
    new ResizeObserver(() => this.resize()).observe(this.place);
    store.on('path', path => this.setPath(path));
    store.on('state', state => {
      this.locateBlock();
      this.setPlacement(state.sheet?.placement ?? null);
      if (state.program.path === null && state.program.check !== 'checking') this.clearPath();
    });
    store.on('chosen', () => this.showChosen());
    store.on('framed', () => this.requestFrame());
    contours.on(() => this.showContours());
    onSettingChange(() => {
      this.colours = pathColours();
      this.requestFrame();
    });
    actions.register({
      view: () => this.nextView(),
      'zoom-in': () => this.zoomBy(1.4),
      'zoom-out': () => this.zoomBy(1 / 1.4),
      fit: () => this.fit(this.follows === 'program' ? 'table' : 'program'),
    });
  }

  begin() {
    try {
      this.renderer = new PathRenderer(this.canvas, {
        onLost: () => this.chunks.clear(),
        onRestored: () => this.store.path && this.setPath(this.store.path),
      });
    } catch (error) {
      this.renderer = null;
      this.note.hidden = false;
      this.note.textContent = `The path is not drawn: ${error.message}. Everything else works.`;
    }
    this.chunks = new PathChunks(this.renderer ?? { make: () => ({}), update() {}, free() {} });
  }

  legend() {
    const entry = (name, text) => element('li', { class: name, text });
    return element(
      'ul',
      { class: 'legend', 'aria-label': 'Legend' },
      entry('cut', 'cut'),
      entry('retraced', 'retraced'),
      entry('planned', 'planned'),
      entry('rapid', 'rapid'),
      entry('old', 'before the history'),
      entry('block', 'block'),
      (this.skippedEntry = entry('skipped', 'skipped')),
      (this.placedEntry = entry('placed', 'as it would lie')),
    );
  }

  toolbar() {
    this.viewButtons = VIEWS.map(view =>
      button(view, () => this.setView(view), { 'aria-pressed': String(view === 'top') }),
    );
    const tool = (name, label, run, className = 'icon') =>
      element(
        'button',
        { type: 'button', class: className, 'aria-label': label, title: label, on: { click: run } },
        sign(name),
      );
    this.tableButton = button('table', () => this.fit('table'), { title: 'Fit to the limits of the machine' });
    return element(
      'div',
      { class: 'path-tools', role: 'toolbar', 'aria-label': 'View of the path' },
      ...this.viewButtons,
      element('span', { class: 'gap' }),
      this.tableButton,
      tool('fit', 'Fit to the program', () => this.fit('program')),
      (this.followButton = tool('aim', 'Keep the tool in the picture', () => this.setFollowsTool(!this.followsTool))),
      tool('minus', 'Zoom out', () => this.zoomBy(1 / 1.4), 'icon zoom'),
      tool('plus', 'Zoom in', () => this.zoomBy(1.4), 'icon zoom'),
    );
  }

  setPath(path) {
    const isNew = this.shownPath !== path.path;
    // The path of a job that grows while it is executed takes the place of what is shown once it can be drawn.
    if (isNew && this.shownPath !== null && this.renderer && this.store.state?.stage === 'job') {
      this.coming?.clear();
      this.coming = new PathChunks(this.renderer);
      this.coming.setPath(path);
      this.askForComing();
      return;
    }
    this.coming?.clear();
    this.coming = null;
    this.chunks.setPath(path);
    this.shownPath = path.path;
    if (isNew) {
      this.blockRange = null;
      this.blockLine = null;
      this.store.choose(null);
      this.fit('program');
    }
    this.locateBlock();
    this.requestFrame();
  }

  askForComing() {
    const [level] = this.coming.levels;
    for (const want of this.coming.missing(level, level.chunks, performance.now())) this.connection.send(want);
    return level.chunks.every(chunk => chunk.mesh);
  }

  /** Shows the path that has come, from where one looked before. */
  showComing() {
    const before = this.origin();
    this.chunks.clear();
    [this.chunks, this.coming] = [this.coming, null];
    this.shownPath = this.chunks.path.path;
    const after = this.origin();
    this.camera.center = this.camera.center.map((value, axis) => value + before[axis] - after[axis]);
    this.blockRange = this.blockLine = null;
    if (this.follows) this.fit(this.follows);
    this.locateBlock();
    this.requestFrame();
  }

  /** Shows no path: the program has none. */
  clearPath() {
    if (this.shownPath === null) return;
    this.chunks.clear();
    this.coming?.clear();
    this.coming = this.store.path = null;
    this.shownPath = this.blockRange = this.blockLine = null;
    this.requestFrame();
  }

  acceptChunk(message) {
    const now = performance.now();
    if (this.coming?.accept(message, now)) {
      if (this.askForComing()) this.showComing();
    } else if (this.chunks.accept(message, now)) this.requestFrame();
  }

  origin() {
    return this.chunks.path?.origin_mm ?? [0, 0, 0];
  }

  toPath(mm) {
    const origin = this.origin();
    return [0, 1, 2].map(axis => (mm?.[axis] ?? 0) - origin[axis]);
  }

  /** Box of the program, and of where it would lie. */
  programBox() {
    const bounds = this.chunks.path?.bounds_mm;
    if (!bounds) return null;
    const box = [...this.toPath(bounds[0]), ...this.toPath(bounds[1])],
      placed = this.pathPlacement()?.boxOf(box) ?? box;
    return box.map((value, index) => (index < 3 ? Math.min : Math.max)(value, placed[index]));
  }

  /** Shows where the job would lie, by the `placement` of the server, until it is set or forgotten (`null`). */
  setPlacement(placement) {
    const key = JSON.stringify(placement);
    this.placedEntry.hidden = placement === null;
    if (key === (this.placementKey ?? 'null')) return;
    Object.assign(this, { placement, placementKey: key });
    if (this.follows === 'program') this.fit('program');
    this.requestFrame();
  }

  /** Where the job would lie, in mm of the path that is shown, or null. */
  pathPlacement() {
    return this.placement && this.chunks.path ? new PathPlacement(this.placement, this.origin()) : null;
  }

  tableBox() {
    const axes = ['x', 'y', 'z'].map(letter => this.store.hello?.machine.axes.find(axis => axis.letter === letter));
    if (!axes[0]?.travel_mm || !axes[1]?.travel_mm) return null;
    const end = side => this.toPath(axes.map(axis => axis?.travel_mm?.[side] ?? 0));
    return [...end(0), ...end(1)];
  }

  fit(what) {
    this.setFollowsTool(false);
    const box = (what === 'program' ? this.programBox() : null) ?? this.tableBox() ?? [-1, -1, 0, 1, 1, 0];
    const wide = box.map((value, index) => value + (index < 3 ? -FIT_MARGIN_MM : FIT_MARGIN_MM));
    this.follows = what;
    const hasRoom = this.camera.height > 240;
    this.camera.fit(wide, hasRoom ? FIT_TOP : 0, hasRoom ? FIT_BOTTOM : 0);
    this.requestFrame();
  }

  setView(view) {
    this.camera.setView(view);
    VIEWS.forEach((name, index) => this.viewButtons[index].setAttribute('aria-pressed', String(name === view)));
    this.fit(this.follows ?? 'program');
  }

  /** Keeps the tool in the picture, or lets it go. */
  setFollowsTool(follows) {
    this.followsTool = follows;
    this.followButton.setAttribute('aria-pressed', String(follows));
    if (follows) this.follows = null;
    this.requestFrame();
  }

  nextView() {
    this.setView(VIEWS[(VIEWS.indexOf(this.camera.view) + 1) % VIEWS.length]);
  }

  zoomBy(factor) {
    this.moved(() => this.camera.zoomAt(this.camera.width / 2, this.camera.height / 2, factor));
  }

  /** Pans by some pixels, for the keyboard. */
  panBy(dx, dy) {
    this.moved(() => this.camera.pan(dx, dy));
  }

  moved(change) {
    change();
    this.follows = null;
    this.requestFrame();
  }

  resize() {
    const { width, height } = this.place.getBoundingClientRect();
    if (width === 0) return;
    const ratio = Math.min(devicePixelRatio, this.renderer?.isSoftware ? 1 : 2),
      old = this.camera.width;
    this.camera.resize(width, height);
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.ratio = ratio;
    if (this.follows || old <= 1) this.fit(this.follows ?? 'program');
    this.requestFrame();
  }

  /** Where the finger on the scrubber is, as a record, or null. */
  setGhost(record) {
    this.ghostRecord = record;
    this.requestFrame();
  }

  /** Asks which records the current block has. */
  async locateBlock() {
    const line = this.store.live?.line ?? this.store.state?.line,
      path = this.store.path?.path;
    if ((line === this.blockLine && path === this.blockPath) || !line || (!path && path !== 0)) return;
    const now = performance.now();
    if (now - (this.locatedAt ?? -Infinity) < LOCATE_MS) return;
    Object.assign(this, { locatedAt: now, blockLine: line, blockPath: path });
    const answer = await this.orders.locate({ line });
    if (this.blockLine !== line) return;
    this.blockRange = answer?.records ?? null;
    this.requestFrame();
  }

  async pick(x, y) {
    if (!this.renderer || !this.chosenChunks) return;
    const record =
      this.pickContour(x, y) ??
      this.renderer.pick(this.camera, this.state(), this.chosenChunks, x * this.ratio, y * this.ratio);
    if (record === null) {
      this.store.choose(null);
      return;
    }
    const answer = await this.orders.locate({ record });
    this.store.choose(answer ? { line: answer.line, records: answer.records, from: 'path' } : null);
  }

  /** Selects the contour at a pixel, or none. Returns the number of a record there, or null. */
  pickContour(x, y) {
    const hit = nearestCut(this.chosenChunks, this.camera, x, y, FINGER_PIXELS);
    const contour = hit && this.contours.contourAt(this.shownPath, hit.record);
    this.contours.select(contour?.number ?? null, 'path');
    return contour ? Math.max(Math.ceil(hit.record), 1) : null;
  }

  /** Shows which contour is selected and which are skipped. */
  showContours() {
    const { contours } = this;
    this.skipped = contours.contours.filter(contour => contours.isSkipped(contour));
    this.skippedEntry.hidden = this.skipped.length === 0;
    this.showChosenText();
    this.requestFrame();
  }

  showChosenText() {
    const { chosen } = this.store,
      { number } = this.contours;
    const parts = [number === null ? null : `contour ${number}`, chosen ? `line ${chosen.line}` : null].filter(Boolean);
    setText(this.chosenText, parts.length > 0 ? `${parts.join(' · ')} chosen` : '');
    this.listButton.hidden = number === null;
    if (number !== null) setText(this.listButton, `Contour ${number} …`);
  }

  showChosen() {
    const { chosen } = this.store;
    this.showChosenText();
    if (chosen && chosen.from !== 'path') {
      const point = this.chunks.positionOf(chosen.records[0]);
      if (point) {
        this.camera.reveal(point);
        this.follows = null;
      }
    }
    this.requestFrame();
  }

  requestFrame() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = null;
      this.draw();
    });
  }

  /** Shows the newest live figures; called once a frame. A picture that would be the same is not drawn again. */
  show() {
    this.locateBlock();
    if (this.liveKey() === this.shownLive) return;
    const wait = this.renderer?.isSoftware ? this.drawnAt + LIVE_MS_SOFTWARE - performance.now() : 0;
    if (wait <= 0) this.requestFrame();
    else {
      this.later ??= setTimeout(() => {
        this.later = null;
        this.show();
      }, wait);
    }
  }

  /** What of the live figures is in the picture. */
  liveKey() {
    const { live } = this.store;
    return [live?.record, live?.oldest, live?.reached, ...(live?.mm ?? [])].join();
  }

  state() {
    const live = this.store.live;
    return {
      record: live?.record ?? 0,
      oldest: live?.oldest ?? 0,
      reached: live?.reached ?? 0,
      inks: this.placement ? this.colours.dimInks : this.colours.inks,
      paper: this.colours.paper,
      dash: 12 * this.ratio,
      ratio: this.ratio,
      feedShare: (this.store.hello?.machine.cutters.length ?? 0) > 0 ? 0.45 : 0,
    };
  }

  draw() {
    if (this.place.offsetParent === null || !this.ratio) return;
    if (this.followsTool && this.store.live) this.camera.reveal(this.toPath(this.xyz(this.store.live.mm)));
    const now = performance.now();
    Object.assign(this, { drawnAt: now, shownLive: this.liveKey() });
    const most = this.renderer?.isSoftware ? MAX_VERTICES_SOFTWARE : MAX_VERTICES;
    const { chunks, wants } = this.chunks.choose(this.camera, most, now);
    for (const want of wants) this.connection.send(want);
    if (this.chunks.levels.length > 0) {
      clearTimeout(this.again);
      if (wants.length > 0) this.again = setTimeout(() => this.requestFrame(), 4100);
    }
    this.chosenChunks = chunks;
    this.renderer?.setBox(this.store.hello ? this.tableBox() : null);
    this.renderer?.draw(this.camera, this.state(), chunks, this.ranges(), this.placedPath(most, now));
    this.placeMarks();
  }

  /** The path as it would lie: camera, state and chunks, or null. */
  placedPath(most, now) {
    const placement = this.pathPlacement();
    if (!placement) return null;
    const camera = this.camera.placed(placement),
      { chunks, wants } = this.chunks.choose(camera, most, now);
    for (const want of wants) this.connection.send(want);
    return { camera, chunks, state: { ...this.state(), inks: this.colours.placedInks } };
  }

  ranges() {
    const { contours } = this;
    const range = (records, ink, width, more = {}) => ({
      ...more,
      records,
      ink,
      width: width * this.ratio,
      spans: this.chunks.spans(records),
    });
    const ranges = this.skippedRanges(range);
    const selected = contours.recordsOn(this.shownPath, contours.selected);
    if (selected) {
      // A wide band, with the path in the colours of its state on it.
      ranges.unshift(range(selected, this.colours.contour, 9));
      if (!contours.isSkipped(contours.selected)) ranges.push(range(selected, STATE_COLOURS, 3));
    }
    if (this.blockRange) ranges.push(range(this.blockRange, this.colours.block, 3, { isAhead: true }));
    if (this.store.chosen) ranges.push(range(this.store.chosen.records, this.colours.chosen, 5));
    return ranges;
  }

  /** Ranges of skipped contours in the picture: dashed. */
  skippedRanges(range) {
    const ranges = [];
    for (const contour of this.skipped ?? []) {
      const records = this.contours.recordsOn(this.shownPath, contour);
      if (!records || ranges.length >= MAX_SKIPPED) continue;
      const pixels = Math.max(contour.length_mm ?? 0, 1e-3) * this.camera.scale;
      const dash = ((records[1] - records[0]) * SKIPPED_DASH_PIXELS) / pixels;
      ranges.push(range(records, this.colours.skipped, 3, { dash }));
    }
    return ranges;
  }

  placeMarks() {
    const { live } = this.store,
      { chunks, camera } = this;
    const put = (node, point) => {
      const [x, y] = point ? camera.project(point) : [-1e3, -1e3];
      const isSeen = x > -30 && y > -30 && x < camera.width + 30 && y < camera.height + 30;
      node.style.display = isSeen ? '' : 'none';
      if (!isSeen) return;
      node.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    };
    this.frameLine.place(mm => camera.project(this.toPath(mm)));
    put(this.tool, live ? this.toPath(this.xyz(live.mm)) : null);
    const isBack = live && live.reached - live.record > 1;
    put(this.furthest, isBack ? chunks.positionOf(live.reached) : null);
    put(this.ghost, this.ghostRecord === null ? null : chunks.positionOf(this.ghostRecord));
    if (live) {
      this.canvas.setAttribute(
        'aria-label',
        `Tool path, tool at ${live.work
          .slice(0, 3)
          .map(mm => formatPosition(mm))
          .join(', ')}`,
      );
    }
  }

  /** X, Y and Z of a position of all axes. */
  xyz(mm) {
    const axes = this.store.hello?.machine.axes ?? [];
    return ['x', 'y', 'z'].map(letter => {
      const index = axes.findIndex(axis => axis.letter === letter);
      return index < 0 ? 0 : mm[index];
    });
  }
}

function mark(name, outline) {
  const node = svgElement(
    'svg',
    { class: `mark ${name}`, viewBox: '0 0 24 24', 'aria-hidden': 'true' },
    svgElement('path', { d: outline, class: 'halo' }),
    svgElement('path', { d: outline }),
  );
  node.style.display = 'none';
  return node;
}
