// Colours of the path, after Okabe and Ito, for both themes.
//
// Invariant: states differ in brightness too, and rapids, the block, the chosen line, and contours that are selected or
// skipped in form.

import { shownTheme } from './settings.js';

/** How much of a path that is about to be placed elsewhere is left of its colour. */
const DIMMED = 0.4;

const rgba = (hex, alpha = 1) => [...[1, 3, 5].map(place => parseInt(hex.slice(place, place + 2), 16) / 255), alpha];

const DARK = {
  paper: '#101418',
  planned: '#8d98a5',
  cut: '#56b4e9',
  retraced: '#e69f00',
  old: '#2f6485',
  rapid: '#6c7682',
  block: '#ffffff',
  chosen: '#f0e442',
  contour: '#1f8a6b',
  skipped: '#cc9ad6',
  placed: '#ff8fc7',
};
const LIGHT = {
  paper: '#fbfbf9',
  planned: '#6f7881',
  cut: '#0072b2',
  retraced: '#d55e00',
  old: '#85b3d0',
  rapid: '#9aa1a8',
  block: '#000000',
  chosen: '#a8327f',
  contour: '#5fcfae',
  skipped: '#8a4fa3',
  placed: '#c2187a',
};

/** Colours of the shown theme, as the shaders take them. */
export function pathColours() {
  const theme = shownTheme() === 'light' ? LIGHT : DARK;
  const one = name => rgba(theme[name]);
  const states = ['planned', 'cut', 'retraced', 'old', 'rapid'];
  const inks = [...states, 'paper'].flatMap(one);
  const paper = one('paper'),
    dimInks = inks.map((value, index) => paper[index % 4] + (value - paper[index % 4]) * DIMMED);
  return {
    inks,
    dimInks,
    // Without rapids: the first one begins where the machine is, which is not turned.
    placedInks: [...states.flatMap(name => rgba(theme.placed, name === 'rapid' ? 0 : 1)), ...paper],
    paper,
    block: one('block'),
    chosen: one('chosen'),
    contour: one('contour'),
    skipped: one('skipped'),
  };
}
