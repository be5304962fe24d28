// Draws velocity, acceleration and jerk over time, one above the other, on a canvas.
//
// Invariant: a column of pixels shows the least and the greatest value in it, so that no peak is lost by zooming out.

import { element } from './element.js';
import { lengthUnit } from './units.js';
import { onSettingChange } from './settings.js';
import { followGestures } from './path_gestures.js';

const MM_PER_INCH = 25.4;
const ROWS = [
  { name: 'velocity', field: 'velocity_mm_s', unit: '/s', colour: '--cut' },
  { name: 'acceleration', field: 'acceleration_mm_s2', unit: '/s²', colour: '--retraced' },
  { name: 'jerk', field: 'jerk_mm_s3', unit: '/s³', colour: '--go' },
];
const LEFT = 64,
  BOTTOM = 24;

const tickStep = (span, count) => {
  const rough = span / Math.max(count, 1),
    power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map(factor => factor * power).find(step => step >= rough) ?? rough;
};
const short = value =>
  Math.abs(value) >= 10_000 ? `${Number((value / 1000).toPrecision(3))}k` : String(Number(value.toPrecision(3)));

/** Chart of three rows with one time axis. `describe` gets the values under the pointer. */
export class ProfileChart {
  constructor(place, describe) {
    this.describe = describe;
    this.canvas = element('canvas', { role: 'img', 'aria-label': 'Velocity, acceleration and jerk over time' });
    this.place = place;
    place.append(this.canvas);
    this.context = this.canvas.getContext('2d');
    followGestures(this.canvas, {
      pan: dx => this.pan(dx),
      zoom: (x, y, factor) => this.zoom((x - LEFT) / this.plotWidth(), factor),
      turn: dx => this.pan(dx),
      tap: x => this.point(x),
      doubleTap: () => this.showAll(),
    });
    this.canvas.addEventListener('pointermove', event => {
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

  plotWidth() {
    return Math.max(this.place.clientWidth - LEFT - 8, 1);
  }

  showAll() {
    const times = this.data?.t_s ?? [];
    this.range = [times[0] ?? 0, times.at(-1) || 1];
    this.draw();
  }

  pan(dx) {
    const shift = (-dx / this.plotWidth()) * (this.range[1] - this.range[0]);
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
    const at = this.range[0] + ((x - LEFT) / this.plotWidth()) * (this.range[1] - this.range[0]);
    let index = times.findIndex(time => time >= at);
    if (index < 0) index = times.length - 1;
    this.pointed = times[index];
    const scale = lengthUnit() === 'in' ? MM_PER_INCH : 1;
    const values = ROWS.map(row => `${short((this.data[row.field]?.[index] ?? 0) / scale)} ${lengthUnit()}${row.unit}`);
    this.describe(`${times[index].toFixed(3)} s: ${values.join(' · ')}`);
    this.draw();
  }

  draw() {
    const { context, canvas, place } = this,
      ratio = Math.min(devicePixelRatio, 2);
    const width = place.clientWidth,
      height = place.clientHeight;
    if (width === 0 || height === 0 || !this.data) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const style = getComputedStyle(document.documentElement),
      colour = name => style.getPropertyValue(name).trim();
    context.font = '12px system-ui, sans-serif';
    const rowHeight = (height - BOTTOM) / ROWS.length;
    ROWS.forEach((row, index) => this.drawRow(row, index * rowHeight, rowHeight - 12, width, colour));
    this.drawTimes(height, width, colour);
  }

  toX(time) {
    return LEFT + ((time - this.range[0]) / (this.range[1] - this.range[0])) * this.plotWidth();
  }

  drawRow(row, top, height, width, colour) {
    const { context, data } = this,
      scale = lengthUnit() === 'in' ? MM_PER_INCH : 1;
    const times = data.t_s,
      values = data[row.field] ?? [];
    let low = 0,
      high = 0;
    for (const value of values) {
      low = Math.min(low, value / scale);
      high = Math.max(high, value / scale);
    }
    if (high - low < 1e-9) high = low + 1;
    const y = value => top + 18 + ((high - value) / (high - low)) * (height - 18);
    context.fillStyle = colour('--ink');
    context.textAlign = 'left';
    context.fillText(`${row.name}, ${lengthUnit()}${row.unit}`, LEFT, top + 12);
    context.strokeStyle = colour('--line');
    context.fillStyle = colour('--dim');
    context.textAlign = 'right';
    context.lineWidth = 1;
    const step = tickStep(high - low, Math.max(Math.floor(height / 26), 3));
    for (let value = Math.ceil(low / step) * step; value <= high + 1e-9; value += step) {
      context.beginPath();
      context.moveTo(LEFT, y(value));
      context.lineTo(width - 8, y(value));
      context.stroke();
      context.fillText(short(value), LEFT - 6, y(value) + 4);
    }
    context.save();
    context.beginPath();
    context.rect(LEFT, top, this.plotWidth(), height + 12);
    context.clip();
    context.strokeStyle = colour(row.colour);
    context.lineWidth = 1.5;
    context.beginPath();
    let column = null,
      least = 0,
      greatest = 0,
      last = 0;
    const flush = () => {
      if (column === null) return;
      context.lineTo(column, y(least));
      context.lineTo(column, y(greatest));
      context.lineTo(column, y(last));
    };
    for (let index = 0; index < times.length; index++) {
      if (times[index + 1] < this.range[0] || times[index - 1] > this.range[1]) continue;
      const x = Math.round(this.toX(times[index])),
        value = values[index] / scale;
      if (x === column) {
        least = Math.min(least, value);
        greatest = Math.max(greatest, value);
      } else {
        flush();
        column = x;
        least = greatest = value;
      }
      last = value;
    }
    flush();
    context.stroke();
    if (this.toolTime !== undefined) {
      context.strokeStyle = colour('--dim');
      context.setLineDash([4, 3]);
      context.beginPath();
      context.moveTo(this.toX(this.toolTime), top + 16);
      context.lineTo(this.toX(this.toolTime), top + height);
      context.stroke();
      context.setLineDash([]);
    }
    if (this.pointed !== null) {
      context.strokeStyle = colour('--ink');
      context.beginPath();
      context.moveTo(this.toX(this.pointed), top + 16);
      context.lineTo(this.toX(this.pointed), top + height);
      context.stroke();
    }
    context.restore();
  }

  drawTimes(height, width, colour) {
    const { context } = this,
      span = this.range[1] - this.range[0],
      step = tickStep(span, Math.floor(width / 110));
    context.fillStyle = colour('--dim');
    context.textAlign = 'center';
    for (let time = Math.ceil(this.range[0] / step) * step; time <= this.range[1]; time += step) {
      context.fillText(`${Number(time.toFixed(3))} s`, Math.min(this.toX(time), width - 20), height - 6);
    }
  }
}
