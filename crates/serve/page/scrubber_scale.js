// Converts between records and millimetres of path for the scale of the scrubber.
//
// Invariant: both directions grow; where the path is not loaded, lengths follow the history's mean.

import { unitMm } from './units.js';

/** Steps of the scale, in the chosen unit. */
const STEPS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000];

function search(values, value) {
  let low = 0,
    high = values.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

function interpolate(from, to, value) {
  const index = search(from, value);
  if (index === 0) return to[0];
  const a = from[index - 1],
    b = from[index];
  const share = b > a ? Math.min((value - a) / (b - a), 1) : 1;
  return to[index - 1] + (to[index] - to[index - 1]) * share;
}

/** Length of path in mm between two records. `table` is that of `PathChunks.lengthTable`, or null. */
export function lengthBetween(table, live, from, to) {
  if (table) return interpolate(table.records, table.lengths, to) - interpolate(table.records, table.lengths, from);
  const records = live.record - live.oldest;
  return records > 0 ? ((to - from) * live.history_mm) / records : 0;
}

/** Marks of the scale: `{record, mm}`, mm back from the furthest place, between `oldest` and `reached`. */
export function scaleMarks(table, live, maxMarks) {
  const total = lengthBetween(table, live, live.oldest, live.reached);
  if (!(total > 0)) return [];
  const steps = STEPS.map(length => length * unitMm());
  const step = steps.find(mm => total / mm <= maxMarks) ?? total / maxMarks;
  const marks = [];
  const end = table ? interpolate(table.records, table.lengths, live.reached) : 0;
  for (let mm = step; mm <= total; mm += step) {
    const record = table
      ? interpolate(table.lengths, table.records, end - mm)
      : live.reached - ((live.reached - live.oldest) * mm) / total;
    marks.push({ record, mm });
  }
  return marks;
}
