// Draws the signs of states and buttons as inline SVG, so that they do not depend on the fonts of the device.
//
// Invariant: every sign is filled or stroked with the colour of the text beside it.

import { svgElement } from './element.js';

// Outlines in a square of 24; a leading `-` means stroked instead of filled.
const OUTLINES = {
  hold: 'M5 4h5v16H5zM14 4h5v16h-5z',
  run: 'M6 3l14 9-14 9z',
  reverse: 'M20 3L6 12l14 9z',
  forward: '-M7 4l12 8-12 8z',
  wheel: '-M12 3a9 9 0 1 0 0 18a9 9 0 1 0 0-18zM12 9a3 3 0 1 0 0 6a3 3 0 1 0 0-6zM12 3v6M12 15v6M3 12h6M15 12h6',
  stop: 'M4 4h16v16H4z',
  ready: '-M12 3a9 9 0 1 0 0 18a9 9 0 1 0 0-18z',
  rest: '-M5 5h14v14H5z',
  differ: '-M4 9h16M4 15h16M16 4L8 20',
  alarm: '-M4 4l16 16M20 4L4 20',
  attention: 'M10 3h4l-1 12h-2zM10.500 17.500h3v3h-3z',
  link: 'M13 2L5 13h5l-1 9 9-12h-6z',
  resume: '-M19 12a7 7 0 1 1-2-5M19 3v5h-5',
  moving: '-M3 12h18M7 8l-4 4 4 4M17 8l4 4-4 4',
  waiting: 'M4 10h4v4H4zM10 10h4v4h-4zM16 10h4v4h-4z',
  leave: 'M3 4l8 8-8 8zM11 4l8 8-8 8zM19 4h2v16h-2z',
  back: 'M21 4l-8 8 8 8zM13 4l-8 8 8 8zM3 4h2v16H3z',
  more: 'M4 10h4v4H4zM10 10h4v4h-4zM16 10h4v4h-4z',
  plus: '-M12 4v16M4 12h16',
  minus: '-M4 12h16',
  fit: '-M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5',
  close: '-M5 5l14 14M19 5L5 19',
  aim: '-M12 2v6M12 16v6M2 12h6M16 12h6M12 8a4 4 0 1 0 0 8a4 4 0 1 0 0-8z',
  home: 'M12 3l10 9h-3v9h-5v-6h-4v6H5v-9H2z',
  left: '-M15 4l-8 8 8 8',
  right: '-M9 4l8 8-8 8',
  up: '-M4 15l8-8 8 8',
  down: '-M4 9l8 8 8-8',
};

/** Makes the sign of this name. */
export function sign(name) {
  const outline = OUTLINES[name] ?? OUTLINES.attention;
  const stroked = outline.startsWith('-');
  return svgElement(
    'svg',
    { class: stroked ? 'sign stroked' : 'sign', viewBox: '0 0 24 24', 'aria-hidden': 'true' },
    svgElement('path', { d: stroked ? outline.slice(1) : outline }),
  );
}

const SIGNS_OF_WORDS = {
  RUNNING: 'run',
  'FEED HOLD': 'hold',
  STOPPING: 'hold',
  'CUT INTERRUPTED': 'attention',
  REVERSE: 'reverse',
  FORWARD: 'forward',
  RETURNING: 'leave',
  HANDWHEEL: 'wheel',
  'AT REST': 'rest',
  'OUTPUTS DIFFER': 'differ',
  PAUSED: 'hold',
  APPROACHING: 'leave',
  ALARM: 'alarm',
  REFUSED: 'attention',
  ENDED: 'stop',
  READY: 'ready',
  'NOT READY': 'attention',
  'NO PROGRAM': 'attention',
  'NOT HOMED': 'home',
  MOVING: 'moving',
  BUSY: 'waiting',
  WAITING: 'waiting',
  RESUME: 'resume',
  RESUMING: 'resume',
  'PROGRAM STOP': 'hold',
  'TOOL CHANGE': 'hold',
  'SINGLE BLOCK': 'hold',
  'CUTTER ON': 'attention',
  'NO LINK': 'link',
};

const COLOURS_OF_WORDS = {
  'OUTPUTS DIFFER': 'retrace',
  'CUTTER ON': 'alarm',
  REFUSED: 'hold',
  RESUME: 'hold',
  RUNNING: 'run',
  MOVING: 'run',
  BUSY: 'run',
  REVERSE: 'retrace',
  FORWARD: 'retrace',
  RETURNING: 'retrace',
  HANDWHEEL: 'retrace',
  'AT REST': 'retrace',
  APPROACHING: 'retrace',
  'FEED HOLD': 'hold',
  STOPPING: 'hold',
  PAUSED: 'hold',
  'PROGRAM STOP': 'hold',
  'TOOL CHANGE': 'hold',
  'SINGLE BLOCK': 'hold',
  ALARM: 'alarm',
  'NO LINK': 'alarm',
  'CUT INTERRUPTED': 'alarm',
};

/** Name of the sign of a state word. */
export function signOfWord(word, level) {
  return SIGNS_OF_WORDS[word] ?? (level === 'alarm' ? 'alarm' : level === 'waiting' ? 'waiting' : 'run');
}

/** Colour class of a state word. */
export function colourOfWord(word, level) {
  return COLOURS_OF_WORDS[word] ?? (level === 'alarm' ? 'alarm' : 'plain');
}
