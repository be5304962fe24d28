// What the charts of the page share: a canvas as large as its place, the colours of the theme, an axis of values, and
// lines over columns of pixels.
//
// Invariant: a column of pixels shows the least and the greatest value in it, so that no peak is lost by zooming out.
// Drawing what has not changed in size, range and theme makes no new objects.

import { element } from './element.js';
import { onSettingChange } from './settings.js';

/** Width of the labels of the axis of values. */
export const LEFT = 64;
/** Distance of the plot from the right edge. */
export const RIGHT = 8;
/** Height of the labels of the axis of time. */
export const BOTTOM = 24;
const FONT = '12px system-ui, sans-serif';
const COLOURS = ['--ink', '--dim', '--line', '--row', '--cut', '--retraced', '--go'];

/** Step of about so many ticks over a span: 1, 2 or 5 times a power of ten. */
export const tickStep = (span, count) => {
  const rough = span / Math.max(count, 1),
    power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map(factor => factor * power).find(step => step >= rough) ?? rough;
};

/** A figure with three digits. */
export const shortNumber = value =>
  Math.abs(value) >= 10_000 ? `${Number((value / 1000).toPrecision(3))}k` : String(Number(value.toPrecision(3)));

const tickLabel = (value, step) =>
  Math.abs(value) >= 10_000
    ? shortNumber(value)
    : String(Number(value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9))))).replace('-', '\u2212');

/** Canvas that fills its place. */
export class ChartCanvas {
  constructor(place, name) {
    this.place = place;
    this.node = element('canvas', { role: 'img', 'aria-label': name });
    this.context = this.node.getContext('2d');
    this.colours = {};
    this.width = this.height = 0;
    place.append(this.node);
    onSettingChange(() => this.forgetColours());
  }

  forgetColours() {
    this.hasColours = false;
  }

  /** Clears the canvas for the next picture. Returns false where there is nothing to be seen. */
  begin() {
    const { context, node, place } = this,
      ratio = Math.min(devicePixelRatio, 2);
    this.width = place.clientWidth;
    this.height = place.clientHeight;
    if (this.width === 0 || this.height === 0) return false;
    const width = Math.round(this.width * ratio),
      height = Math.round(this.height * ratio);
    if (node.width !== width || node.height !== height) {
      node.width = width;
      node.height = height;
    }
    if (!this.hasColours) {
      const style = getComputedStyle(document.documentElement);
      for (const name of COLOURS) this.colours[name] = style.getPropertyValue(name).trim();
      this.hasColours = true;
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    context.font = FONT;
    return true;
  }

  plotWidth() {
    return Math.max(this.place.clientWidth - LEFT - RIGHT, 1);
  }
}

/** Axis of values, at the left of its row. */
export class ValueAxis {
  constructor() {
    this.low = 0;
    this.high = 1;
    this.top = this.height = this.tickCount = 0;
    this.ticks = [];
    this.labels = [];
  }

  /** Sets the range of values and its place on the canvas, with about so many ticks. */
  set(low, high, top, height, tickCount) {
    this.top = top;
    this.height = height;
    if (low === this.low && high === this.high && tickCount === this.tickCount) return;
    Object.assign(this, { low, high, tickCount });
    const step = tickStep(high - low, tickCount);
    this.ticks.length = this.labels.length = 0;
    for (let index = Math.ceil(low / step - 1e-9); index * step <= high + step * 1e-9; index++) {
      this.ticks.push(index * step);
      this.labels.push(tickLabel(index * step, step));
    }
  }

  toY(value) {
    return this.top + ((this.high - value) / (this.high - this.low)) * this.height;
  }

  /** Draws ticks and their labels. */
  draw(context, right, colours) {
    context.strokeStyle = colours['--line'];
    context.fillStyle = colours['--dim'];
    context.textAlign = 'right';
    context.lineWidth = 1;
    for (let index = 0; index < this.ticks.length; index++) {
      const y = this.toY(this.ticks[index]);
      context.beginPath();
      context.moveTo(LEFT, y);
      context.lineTo(right, y);
      context.stroke();
      context.fillText(this.labels[index], LEFT - 6, y + 4);
    }
  }
}

/** Line whose values come in the order of their places. */
export class ColumnLine {
  begin(context, axis) {
    this.context = context;
    this.axis = axis;
    this.column = NaN;
    this.isBroken = true;
    context.beginPath();
  }

  /** The next value, at this place in pixels. */
  add(x, value) {
    const column = Math.round(x);
    if (column === this.column) {
      this.least = Math.min(this.least, value);
      this.greatest = Math.max(this.greatest, value);
    } else {
      this.flush();
      this.column = column;
      this.least = this.greatest = value;
    }
    this.last = value;
  }

  /** Ends the line here; the next value begins another one. */
  break() {
    this.flush();
    this.column = NaN;
    this.isBroken = true;
  }

  end() {
    this.flush();
    this.context.stroke();
  }

  flush() {
    const { context, axis, column } = this;
    if (Number.isNaN(column)) return;
    if (this.isBroken) context.moveTo(column, axis.toY(this.least));
    else context.lineTo(column, axis.toY(this.least));
    context.lineTo(column, axis.toY(this.greatest));
    context.lineTo(column, axis.toY(this.last));
    this.isBroken = false;
  }
}
