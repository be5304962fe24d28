// Opens dialogs above the footer.
//
// Invariant: a dialog covers neither the state line nor HOLD, and never takes the keys of HOLD. One dialog is open at
// a time; an urgent one (alarm, question) replaces the others.

import { button, element } from './element.js';

let place = null;
let current = null;

/** Sets the element in which dialogs open. */
export function setDialogPlace(node) {
  place = node;
}

/** Whether a dialog is open. */
export function dialogIsOpen() {
  return current !== null;
}

/** Whether a dialog is open that leaves nothing else free. */
export function dialogIsModal() {
  return current !== null && current.isModal;
}

/** Key of the open dialog, or null. */
export function openDialogKey() {
  return current?.key ?? null;
}

/** Closes the dialog: the one with this key, or any. */
export function closeDialog(key) {
  if (!current || (key && current.key !== key)) return;
  const { node, returnFocus, onClose } = current;
  current = null;
  node.remove();
  place.classList.remove('open');
  if (returnFocus?.isConnected) returnFocus.focus();
  onClose?.();
}

/**
 * Opens a dialog. `key` names it; `content` is a list of nodes; `choices` are `{label, help, run, main, danger, off}`.
 * One that is not modal leaves the parts of the page around it free; `isAside`, it leaves the drawing free.
 * The first choice that is neither main nor dangerous gets the focus, so that Enter changes nothing by accident.
 */
export function openDialog({ key, title, content = [], choices, level = 'plain', isModal = true, isAside, onClose, focus }) {
  const returnFocus = current?.returnFocus ?? document.activeElement;
  closeDialog();
  const buttons = choices.map(choice => {
    const node = button(
      choice.label,
      () => {
        if (choice.off) return;
        if (!choice.keepsOpen) closeDialog(key);
        choice.run?.();
      },
      { class: choice.danger ? 'danger' : choice.main ? 'main' : null, 'aria-disabled': choice.off ? 'true' : null },
    );
    if (choice.help) node.append(element('small', { text: choice.help }));
    return node;
  });
  const heading = element('h2', { id: 'dialog-title', text: title });
  const node = element(
    'div',
    {
      class: `dialog ${level}`,
      role: level === 'plain' ? 'dialog' : 'alertdialog',
      'aria-labelledby': 'dialog-title',
    },
    heading,
    element('div', { class: 'dialog-content', id: 'dialog-content' }, ...content),
    element('div', { class: 'dialog-choices' }, ...buttons),
  );
  if (content.length > 0) node.setAttribute('aria-describedby', 'dialog-content');
  node.addEventListener('keydown', event => {
    if (event.key === 'Escape') {
      event.stopPropagation();
      closeDialog(key);
    }
  });
  place.append(node);
  place.classList.add('open');
  place.classList.toggle('free', !isModal);
  place.classList.toggle('aside', isAside === true);
  current = { key, node, isModal, returnFocus, onClose };
  const safe =
    buttons.find((_, index) => choices[index].isSafe) ??
    buttons.find((_, index) => !choices[index].main && !choices[index].danger) ??
    buttons[0];
  (focus ?? safe)?.focus({ preventScroll: true });
  return node;
}

/** Asks a question and runs `run` if the answer is the label. */
export function confirm({ title, text, label, danger = true, run }) {
  openDialog({
    key: 'confirm',
    title,
    content: text ? [element('p', { text })] : [],
    choices: [{ label: 'Cancel' }, { label, danger, main: !danger, run }],
  });
}

/** Asks for a text. `check` returns an error text or null. */
export function prompt({ title, text, label, value = '', inputMode = 'text', check, run }) {
  const input = element('input', {
    type: 'text',
    value,
    inputmode: inputMode,
    'aria-label': title,
    autocomplete: 'off',
    spellcheck: 'false',
  });
  const error = element('p', { class: 'error', role: 'alert' });
  const accept = () => {
    const wrong = check?.(input.value) ?? null;
    if (wrong) {
      error.textContent = wrong;
      input.focus();
      return;
    }
    const entered = input.value;
    closeDialog('prompt');
    run(entered);
  };
  input.addEventListener('keydown', event => {
    if (event.key === 'Enter') {
      event.preventDefault();
      accept();
    }
  });
  openDialog({
    key: 'prompt',
    title,
    content: [text ? element('p', { text }) : null, input, error].filter(Boolean),
    focus: input,
    choices: [{ label: 'Cancel' }, { label, main: true, keepsOpen: true, run: accept }],
  });
}
