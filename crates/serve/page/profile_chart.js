// Draws velocity, acceleration and jerk over time, one above the other, on a canvas.
//
// Invariant: no peak is lost by zooming out: see chart_axes.js.

import { BOTTOM, ChartCanvas, ColumnLine, LEFT, RIGHT, ValueAxis, shortNumber, tickStep } from './chart_axes.js';
import { lengthUnit, unitMm } from './units.js';
import { onSettingChange } from './settings.js';
import { followGestures } from './path_gestures.js';

const ROWS = [
  { name: 'velocity', field: 'velocity_mm_s', unit: '/s', colour: '--cut' },
  { name: 'acceleration', field: 'acceleration_mm_s2', unit: '/s²', colour: '--retraced' },
  { name: 'jerk', field: 'jerk_mm_s3', unit: '/s³', colour: '--go' },
];

/** Chart of three rows with one time axis. `describe` gets the values under the pointer. */
export class ProfileChart {
  constructor(place, describe) {
    this.describe = describe;
    this.canvas = new ChartCanvas(place, 'Velocity, acceleration and jerk over time');
    this.context = this.canvas.context;
    this.axes = ROWS.map(() => new ValueAxis());
    this.line = new ColumnLine();
    followGestures(this.canvas.node, {
      pan: dx => this.pan(dx),
      zoom: (x, y, factor) => this.zoom((x - LEFT) / this.canvas.plotWidth(), factor),
      turn: dx => this.pan(dx),
      tap: x => this.point(x),
      doubleTap: () => this.showAll(),
    });
    this.canvas.node.addEventListener('pointermove', event => {
      if (event.buttons === 0) this.point(event.offsetX);
    });
    new ResizeObserver(() => this.draw()).observe(place);
    onSettingChange(() => this.draw());
  }

  setData(data) {
    this.data = data;
    this.pointed = null;
    this.showAll();
  }

  /** Marks the time of the place under the tool. */
  setToolTime(time) {
    if (time === this.toolTime) return;
    this.toolTime = time;
    this.draw();
  }

  showAll() {
    const times = this.data?.t_s ?? [];
    this.range = [times[0] ?? 0, times.at(-1) || 1];
    this.draw();
  }

  pan(dx) {
    const shift = (-dx / this.canvas.plotWidth()) * (this.range[1] - this.range[0]);
    this.setRange(this.range[0] + shift, this.range[1] + shift);
  }

  zoom(share, factor) {
    const [from, to] = this.range,
      at = from + (to - from) * Math.min(Math.max(share, 0), 1);
    this.setRange(at - (at - from) / factor, at + (to - at) / factor);
  }

  setRange(from, to) {
    const first = this.data?.t_s[0] ?? 0,
      last = this.data?.t_s.at(-1) ?? 1;
    const span = Math.min(Math.max(to - from, 0.005), last - first || 1);
    const start = Math.min(Math.max(from, first), last - span);
    this.range = [start, start + span];
    this.draw();
  }

  point(x) {
    const times = this.data?.t_s ?? [];
    if (times.length === 0) return;
    const at = this.range[0] + ((x - LEFT) / this.canvas.plotWidth()) * (this.range[1] - this.range[0]);
    let index = times.findIndex(time => time >= at);
    if (index < 0) index = times.length - 1;
    this.pointed = times[index];
    const valueOf = row => shortNumber((this.data[row.field]?.[index] ?? 0) / unitMm());
    const values = ROWS.map(row => `${valueOf(row)} ${lengthUnit()}${row.unit}`);
    this.describe(`${times[index].toFixed(3)} s: ${values.join(' · ')}`);
    this.draw();
  }

  draw() {
    const { canvas } = this;
    if (!this.data || !canvas.begin()) return;
    const { width, height, colours } = canvas,
      rowHeight = (height - BOTTOM) / ROWS.length;
    ROWS.forEach((row, index) => this.drawRow(row, this.axes[index], index * rowHeight, rowHeight - 12));
    this.drawTimes(height, width, colours);
  }

  toX(time) {
    return LEFT + ((time - this.range[0]) / (this.range[1] - this.range[0])) * this.canvas.plotWidth();
  }

  drawRow(row, axis, top, height) {
    const { context, data, line } = this,
      { width, colours } = this.canvas,
      scale = unitMm();
    const times = data.t_s,
      values = data[row.field] ?? [];
    let low = 0,
      high = 0;
    for (const value of values) {
      low = Math.min(low, value / scale);
      high = Math.max(high, value / scale);
    }
    if (high - low < 1e-9) high = low + 1;
    context.fillStyle = colours['--ink'];
    context.textAlign = 'left';
    context.fillText(`${row.name}, ${lengthUnit()}${row.unit}`, LEFT, top + 12);
    axis.set(low, high, top + 18, height - 18, Math.max(Math.floor(height / 26), 3));
    axis.draw(context, width - RIGHT, colours);
    context.save();
    context.beginPath();
    context.rect(LEFT, top, this.canvas.plotWidth(), height + 12);
    context.clip();
    context.strokeStyle = colours[row.colour];
    context.lineWidth = 1.5;
    line.begin(context, axis);
    for (let index = 0; index < times.length; index++) {
      if (times[index + 1] < this.range[0] || times[index - 1] > this.range[1]) continue;
      line.add(this.toX(times[index]), values[index] / scale);
    }
    line.end();
    if (this.toolTime !== undefined) {
      context.strokeStyle = colours['--dim'];
      context.setLineDash([4, 3]);
      context.beginPath();
      context.moveTo(this.toX(this.toolTime), top + 16);
      context.lineTo(this.toX(this.toolTime), top + height);
      context.stroke();
      context.setLineDash([]);
    }
    if (this.pointed !== null) {
      context.strokeStyle = colours['--ink'];
      context.beginPath();
      context.moveTo(this.toX(this.pointed), top + 16);
      context.lineTo(this.toX(this.pointed), top + height);
      context.stroke();
    }
    context.restore();
  }

  drawTimes(height, width, colours) {
    const { context } = this,
      span = this.range[1] - this.range[0],
      step = tickStep(span, Math.floor(width / 110));
    context.fillStyle = colours['--dim'];
    context.textAlign = 'center';
    for (let time = Math.ceil(this.range[0] / step) * step; time <= this.range[1]; time += step) {
      context.fillText(`${Number(time.toFixed(3))} s`, Math.min(this.toX(time), width - 20), height - 6);
    }
  }
}
