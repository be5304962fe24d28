// Makes the table of what is known about a job, from what `retrace jobs --json` prints.
//
// Invariant: what the operator needs to decide comes first; a field that is missing leaves its row out.

import { element } from './element.js';
import { formatDuration, formatLength, formatPosition } from './units.js';

const STATE_TEXTS = {
  running: 'running',
  interrupted: 'interrupted by a failure of the computer or the process',
  stopped: 'stopped',
  alarm: 'stopped by an alarm',
  completed: 'completed',
};

const when = text => (text ? new Date(text).toLocaleString() : null);

/** Name of a file without its folder. */
export function baseName(path) {
  return path ? path.split(/[\\/]/).at(-1) : '';
}

function positionText(position) {
  if (!position) return null;
  const axes = Object.entries(position).filter(([, mm]) => typeof mm === 'number');
  return axes.map(([letter, mm]) => `${letter.toUpperCase()} ${formatPosition(mm)}`).join('  ') || null;
}

function contoursText(report) {
  if (report?.contours === undefined) return null;
  return `${report.contours} cut${report.contours_not_cut ? `, ${report.contours_not_cut} not cut through` : ''}`;
}

function overridesText(overrides) {
  if (!overrides || typeof overrides !== 'object') return null;
  const entries = Object.entries(overrides).filter(([, share]) => typeof share === 'number');
  return entries.map(([name, share]) => `${name.replaceAll('_', ' ')} ${Math.round(share * 100)} %`).join(', ') || null;
}

/** Rows `[name, text]` of a job: `job` is its entry in the list, `record` its details. */
export function jobRows(job, record) {
  const report = record.end?.report,
    line = record.breakpoint?.line ?? job.line;
  const share = job.lines ? `, ${Math.round((100 * line) / job.lines)} %` : '';
  const rows = [
    ['state', STATE_TEXTS[record.state] ?? record.state],
    ['can be resumed', record.resumable ? 'yes' : 'no'],
    ['error', job.error ? `${job.error.number} ${job.error.cause} ${job.error.remedy ?? ''}` : null],
    [
      'alarm',
      record.alarm ? `${record.alarm.number ?? ''} ${record.alarm.cause ?? JSON.stringify(record.alarm)}` : null,
    ],
    ['at line', line ? `${line}${job.lines ? ` of ${job.lines}${share}` : ''}` : null],
    ['mode', record.position?.mode],
    ['position', positionText(report?.position_mm)],
    ['contours', contoursText(report)],
    ['not cut', report?.not_cut_mm ? formatLength(report.not_cut_mm) : null],
    ['motion', report?.motion_s === undefined ? null : formatDuration(report.motion_s)],
    ['retraced', report?.retrace_s ? formatDuration(report.retrace_s) : null],
    ['overrides', overridesText(record.overrides)],
    ['began', when(job.began ?? record.job?.when)],
    ['ended', when(job.ended ?? record.end?.when)],
    ['resumed', record.resumed?.length ? `${record.resumed.length} times` : null],
    ['card', typeof record.job?.card === 'string' ? record.job.card : record.job?.card?.wired?.name],
    ['machine file', record.job?.machine?.path],
    ['program', job.program],
    ['retrace', record.job?.retrace_version],
    ['job', job.id],
  ];
  return rows.filter(([, text]) => text !== null && text !== undefined && text !== '');
}

/** Table of a job. */
export function jobTable(job, record) {
  const rows = jobRows(job, record).map(([name, text]) =>
    element('tr', {}, element('th', { scope: 'row', text: name }), element('td', { text: String(text) })),
  );
  return element('table', { class: 'details' }, element('tbody', {}, ...rows));
}
