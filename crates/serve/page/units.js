// Formats lengths, feeds, times and percentages in the unit that the page's user has chosen.
//
// Invariant: the server speaks millimetres, degrees and seconds; inches exist on the page only.

import { setting } from './settings.js';

const MM_PER_INCH = 25.4;
const MINUS = '\u2212';

const isInch = () => setting('unit') === 'inch';
const digits = (value, places) => {
  const text = Math.abs(value).toFixed(places);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
};

/** Name of the unit of length. */
export function lengthUnit() {
  return isInch() ? 'in' : 'mm';
}

/** Formats a position in mm: three decimals, four in inches. */
export function formatPosition(mm, isLinear = true) {
  if (mm === null || mm === undefined) return '–';
  if (!isLinear) return digits(mm, 3);
  return isInch() ? digits(mm / MM_PER_INCH, 4) : digits(mm, 3);
}

/** Formats a length in mm with its unit. */
export function formatLength(mm, places = 1) {
  if (mm === null || mm === undefined) return '–';
  return isInch() ? `${digits(mm / MM_PER_INCH, places + 1)} in` : `${digits(mm, places)} mm`;
}

/** Formats a jog step in mm with its unit, without trailing zeros. */
export function formatStep(mm) {
  return isInch() ? `${Number((mm / MM_PER_INCH).toFixed(4))} in` : `${Number(mm.toFixed(4))} mm`;
}

/** Formats a feed in mm/min. */
export function formatFeed(mmPerMin) {
  if (mmPerMin === null || mmPerMin === undefined) return '–';
  return isInch() ? digits(mmPerMin / MM_PER_INCH, 1) : digits(mmPerMin, 0);
}

/** Length of the chosen unit in mm. */
export function unitMm() {
  return isInch() ? MM_PER_INCH : 1;
}

/** Name of the unit of feed. */
export function feedUnit() {
  return isInch() ? 'in/min' : 'mm/min';
}

/** Jog steps in mm: those of the machine, or round ones in inches. */
export function jogSteps(machineSteps) {
  return isInch() ? [0.001, 0.01, 0.1, 1].map(inches => inches * MM_PER_INCH) : machineSteps;
}

/** Converts what a user entered in the chosen unit to mm. Returns null for text that is not a number. */
export function parseLength(text) {
  const value = Number(text.trim().replace(',', '.').replace(MINUS, '-'));
  if (text.trim() === '' || !Number.isFinite(value)) return null;
  return isInch() ? value * MM_PER_INCH : value;
}

/** Formats a number of mm for an order: no exponent, at most six decimals. */
export function orderNumber(mm) {
  return String(Number(mm.toFixed(6)));
}

/** Formats a share as a percentage. */
export function formatPercent(share) {
  return share === null || share === undefined ? '–' : `${digits(share * 100, 0)} %`;
}

/** Formats a duration as h:mm:ss or m:ss. */
export function formatDuration(seconds) {
  if (seconds === null || seconds === undefined) return '–';
  const whole = Math.max(0, Math.round(seconds)),
    two = n => String(n).padStart(2, '0');
  const hours = Math.floor(whole / 3600),
    minutes = Math.floor(whole / 60) % 60;
  return hours > 0 ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}

/** Formats a number of bytes. */
export function formatBytes(bytes) {
  if (bytes < 1000) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Formats a time of day, or a day where it is not today, from seconds since 1970. */
export function formatTime(seconds) {
  const date = new Date(seconds * 1000),
    now = new Date();
  return date.toDateString() === now.toDateString() ? date.toLocaleTimeString() : date.toLocaleDateString();
}
