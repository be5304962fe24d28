// Colours of the path, after Okabe and Ito, for both themes.
//
// Invariant: states differ in brightness too, and rapids, the block, the chosen line, and contours that are selected or
// skipped in form.

import { shownTheme } from './settings.js';

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
};

/** Colours of the shown theme, as the shaders take them. */
export function pathColours() {
  const theme = shownTheme() === 'light' ? LIGHT : DARK;
  const inks = ['planned', 'cut', 'retraced', 'old', 'rapid', 'paper'].flatMap(name => rgba(theme[name]));
  const one = name => rgba(theme[name]);
  return {
    inks,
    paper: one('paper'),
    block: one('block'),
    chosen: one('chosen'),
    contour: one('contour'),
    skipped: one('skipped'),
  };
}
