// Draws the last minute of arc voltage and height of the tool, with marks where the torch is on and the height is held.
//
// Invariant: it draws at most ten times a second, and only what can be seen; a picture makes no new objects. What it
// keeps has a fixed size. It keeps samples also while it is closed.

import { ChartCanvas, ColumnLine, LEFT, RIGHT, ValueAxis } from './chart_axes.js';
import { AT_REST, CUTTING, HEIGHT_HELD, HISTORY_MS, HeightHistory, TORCH_ON } from './height_history.js';
import { lengthUnit, unitMm } from './units.js';
import { onSettingChange, setting } from './settings.js';

const DRAW_MS = 100;
/** Without a new sample the picture moves on as often as this. */
const IDLE_MS = 500;
const BOTTOM = 18,
  TITLE = 16,
  GAP = 6,
  BAR = 5,
  TICK_PIXELS = 13;
/** Least ranges of the axes: V, and mm. */
const LEAST_VOLTS = 10,
  LEAST_MM = 3;
/** What is further from the mean than so many mean deviations is cut off at the edge. */
const DEVIATIONS = 6;
const CUTTER_STATES = ['piercing', 'cutting'];
const timeLabel = seconds => (seconds === 0 ? 'now' : `−${seconds} s`);
const TIMES = [60, 50, 40, 30, 20, 10, 0].map(seconds => ({ seconds, label: timeLabel(seconds) }));
const TARGET_DASH = [6, 4],
  NO_DASH = [];

/** The strip chart. It is open as the page's setting says, on a machine that senses the sheet. */
export class HeightChart {
  constructor(place, store) {
    Object.assign(this, { place, store });
    this.history = new HeightHistory();
    this.canvas = new ChartCanvas(place, 'Arc voltage and height of the tool, of the last minute');
    this.voltAxis = new ValueAxis();
    this.heightAxis = new ValueAxis();
    this.line = new ColumnLine();
    this.hasVolts = this.hasSample = false;
    this.drawnAt = -Infinity;
    this.names = { unit: '', axis: '', height: '' };
    this.keyWidths = {};
    this.timer = null;
    store.on('live', live => this.record(live));
    store.on('link', () => this.recordLink());
    onSettingChange(() => this.showOpen());
    new ResizeObserver(() => this.requestPicture()).observe(place);
  }

  record(live) {
    const { layer, height } = live;
    if (!layer) return;
    const marks =
      (live.seconds_lit === null ? 0 : TORCH_ON) |
      (height?.state === 'held' || height?.is_on === false ? HEIGHT_HELD : 0) |
      (CUTTER_STATES.includes(this.store.state?.cutter?.state) ? CUTTING : 0) |
      (live.at_rest ? AT_REST : 0);
    this.hasVolts ||= typeof height?.volts === 'number';
    const tool = layer.layer_mm === null ? NaN : live.work[layer.axis];
    this.history.add(performance.now(), height?.volts ?? NaN, height?.target_volts ?? NaN, tool, marks);
    this.hasSample = true;
    this.axisIndex = layer.axis;
    if (this.place.hidden) this.showOpen();
  }

  /** Without a link nothing is known. */
  recordLink() {
    if (!this.store.isLive && this.history.length > 0) this.history.add(performance.now(), NaN, NaN, NaN, AT_REST);
  }

  showOpen() {
    const isOpen = setting('heightChart') === 'open' && this.axisIndex !== undefined;
    this.place.hidden = !isOpen;
    document.body.dataset.heightChart = isOpen ? 'open' : 'closed';
    if (!isOpen) {
      clearInterval(this.timer);
      this.timer = null;
      return;
    }
    this.timer ??= setInterval(() => this.poll(), DRAW_MS);
    this.requestPicture();
  }

  requestPicture() {
    this.hasSample = true;
  }

  poll() {
    const now = performance.now();
    if (document.hidden || (!this.hasSample && now - this.drawnAt < IDLE_MS)) return;
    this.drawnAt = now;
    this.hasSample = false;
    this.draw(now);
  }

  draw(now) {
    const { canvas, history } = this;
    if (!canvas.begin()) return;
    history.trim(now);
    const { context, width, height, colours } = canvas,
      rows = this.hasVolts ? 2 : 1,
      rowHeight = (height - BOTTOM - BAR) / rows;
    this.now = now;
    this.plotWidth = canvas.plotWidth();
    this.nameHeight();
    this.drawMarks(HEIGHT_HELD, colours['--line'], TITLE, height - BOTTOM - BAR - TITLE);
    this.drawMarks(TORCH_ON, colours['--retraced'], height - BOTTOM - BAR, BAR);
    if (this.hasVolts) {
      this.setRange(this.voltAxis, history.volts, 1, LEAST_VOLTS, 0, rowHeight);
      this.drawTitle('arc voltage, V', 0);
      this.voltAxis.draw(context, width - RIGHT, colours);
      context.setLineDash(TARGET_DASH);
      this.drawLine(history.targets, this.voltAxis, 1, colours['--dim']);
      context.setLineDash(NO_DASH);
      this.drawLine(history.volts, this.voltAxis, 1, colours['--cut']);
    }
    const top = (rows - 1) * rowHeight;
    this.setRange(this.heightAxis, history.heights, 1 / unitMm(), LEAST_MM / unitMm(), top, rowHeight);
    this.drawTitle(this.names.height, top);
    this.heightAxis.draw(context, width - RIGHT, colours);
    this.drawLine(history.heights, this.heightAxis, 1 / unitMm(), colours['--go']);
    this.drawLegend(width, colours);
    this.drawTimes(height, colours);
  }

  /** Name of the row of the height; a new one only for another unit or axis. */
  nameHeight() {
    const axis = this.store.axis(this.axisIndex)?.letter,
      { names } = this;
    if (names.unit === lengthUnit() && names.axis === axis) return;
    names.unit = lengthUnit();
    names.axis = axis;
    names.height = `height ${axis?.toUpperCase() ?? ''}, ${names.unit}`;
  }

  toX(time) {
    return LEFT + (1 - (this.now - time) / HISTORY_MS) * this.plotWidth;
  }

  /** Sets the range of an axis by the samples of cuts, or by all where nothing was cut. */
  setRange(axis, values, scale, least, top, rowHeight) {
    if (!this.measure(values, scale, CUTTING) && !this.measure(values, scale, 0)) this.low = this.high = 0;
    const room = Math.max(this.high - this.low, least) * 0.05,
      middle = (this.low + this.high) / 2,
      half = Math.max(this.high - this.low, least) / 2 + room;
    const height = rowHeight - TITLE - GAP,
      ticks = height / TICK_PIXELS;
    // Whole parts of the least range, so that the scale is not another one in each picture.
    const part = least / 4;
    axis.set(
      Math.floor((middle - half) / part) * part,
      Math.ceil((middle + half) / part) * part,
      top + TITLE + GAP / 2,
      height,
      ticks,
    );
  }

  /** Finds the range of the samples with this mark, without single ones far away. Returns false if there are none. */
  measure(values, scale, mark) {
    const { history } = this;
    let count = 0,
      sum = 0,
      low = Infinity,
      high = -Infinity;
    for (let index = 0; index < history.length; index++) {
      const slot = history.slot(index),
        value = values[slot] * scale;
      if ((history.marks[slot] & mark) !== mark || Number.isNaN(value)) continue;
      count++;
      sum += value;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    if (count === 0) return false;
    const mean = sum / count;
    let deviation = 0;
    for (let index = 0; index < history.length; index++) {
      const slot = history.slot(index),
        value = values[slot] * scale;
      if ((history.marks[slot] & mark) === mark && !Number.isNaN(value)) deviation += Math.abs(value - mean) / count;
    }
    this.low = Math.max(low, mean - DEVIATIONS * deviation);
    this.high = Math.min(high, mean + DEVIATIONS * deviation);
    return true;
  }

  drawLine(values, axis, scale, colour) {
    const { history, line } = this,
      { context } = this.canvas;
    context.save();
    context.beginPath();
    context.rect(LEFT, axis.top - GAP / 2, this.plotWidth, axis.height + GAP);
    context.clip();
    context.strokeStyle = colour;
    context.lineWidth = 1.5;
    line.begin(context, axis);
    for (let index = 0; index < history.length; index++) {
      const slot = history.slot(index);
      if (Number.isNaN(values[slot])) line.break();
      else line.add(Math.max(this.toX(history.times[slot]), LEFT), values[slot] * scale);
    }
    // What is not reported anew has not changed.
    if (history.length > 0) {
      const value = values[history.slot(history.length - 1)];
      if (!Number.isNaN(value)) line.add(LEFT + this.plotWidth, value * scale);
    }
    line.end();
    context.restore();
  }

  /** Fills the times with this mark. */
  drawMarks(mark, colour, top, height) {
    const { history } = this,
      { context } = this.canvas;
    context.fillStyle = colour;
    let from = NaN;
    for (let index = 0; index <= history.length; index++) {
      const isEnd = index === history.length,
        slot = history.slot(index),
        isOn = !isEnd && (history.marks[slot] & mark) !== 0;
      if (isOn === !Number.isNaN(from)) continue;
      const x = Math.max(isEnd ? LEFT + this.plotWidth : this.toX(history.times[slot]), LEFT);
      if (isOn) from = x;
      else {
        context.fillRect(from, top, Math.max(x - from, 1), height);
        from = NaN;
      }
    }
  }

  drawTitle(title, top) {
    const { context, colours } = this.canvas;
    context.fillStyle = colours['--ink'];
    context.textAlign = 'left';
    context.fillText(title, LEFT, top + 12);
  }

  /** What dashes, bar and shade mean, from the right to the left. */
  drawLegend(width, colours) {
    const { context } = this.canvas;
    let right = width - RIGHT;
    right = this.drawKey('held', right, colours['--line'], 12);
    right = this.drawKey('torch on', right, colours['--retraced'], BAR);
    if (this.hasVolts) this.drawKey('target', right, colours['--dim'], 1.5);
    context.textAlign = 'left';
  }

  drawKey(name, right, colour, height) {
    const { context, colours } = this.canvas;
    context.textAlign = 'right';
    context.fillStyle = colours['--ink'];
    context.fillText(name, right, 12);
    const left = right - (this.keyWidths[name] ??= context.measureText(name).width) - 20;
    context.fillStyle = colour;
    context.fillRect(left, 8 - height / 2, 16, height);
    return left - 12;
  }

  drawTimes(height, colours) {
    const { context } = this.canvas;
    context.fillStyle = colours['--dim'];
    for (const { seconds, label } of TIMES) {
      if (this.plotWidth < 420 && seconds % 20 !== 0) continue;
      context.textAlign = seconds === 0 ? 'right' : seconds === 60 ? 'left' : 'center';
      context.fillText(label, this.toX(this.now - seconds * 1000), height - 5);
    }
  }
}
