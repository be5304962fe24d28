// Opens a dialog with everything that the machine can do now and that has no fixed place on the page.
//
// Invariant: the suggested actions come first, and only actions that are possible now are shown.

import { element } from './element.js';
import { openDialog } from './dialog.js';

/** Actions that have a fixed place elsewhere, or work by keys only. */
const PLACED = new Set(
  (
    'hold quit turn jog jog-down jog-up next-axis step view zoom-in zoom-out pan fit messages help tools shop-jobs contours ' +
    'open-program mdi probe work-zero faster slower whole rapid-override output reverse forward wheel cycle-start leave ' +
    'spindle-faster spindle-slower back-by single dry-run'
  ).split(' '),
);

/** Opens the dialog. */
export function openActionDialog(store, actions) {
  const { state } = store;
  if (!state) return;
  const ids = [...new Set([...state.suggested, ...state.can])].filter(
    id => !PLACED.has(id) && actions.isPossible(id) && (id !== 'clear-alarm' || state.alarm),
  );
  const choice = id => {
    const key = actions.keyText(id);
    const run = () => {
      if (!actions.perform(id)) actions.orders.notices.inform(`${actions.label(id)} is not possible any more.`);
    };
    return { label: `${actions.label(id)}${key ? ` · ${key}` : ''}`, help: actions.row(id)?.help, run };
  };
  const hint = store.isHolder ? null : element('p', { text: 'This page is not in control: it can watch and hold.' });
  openDialog({
    key: 'actions',
    title: state.word,
    content: [element('p', { text: state.why }), hint].filter(Boolean),
    choices: [...ids.map(choice), { label: 'Close', isSafe: true }],
  });
}
