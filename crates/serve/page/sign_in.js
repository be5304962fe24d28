// Asks for the token where this browser has no session.
//
// Invariant: the token goes to the server once, and is kept nowhere on the page.

import { closeDialog, openDialog, openDialogKey } from './dialog.js';
import { element } from './element.js';

/** Opens the sign-in while the link is `signed-out`. */
export function followSignIn(store, connection) {
  store.on('link', link => {
    if (link === 'signed-out') open(connection);
    else if (openDialogKey() === 'sign-in') closeDialog('sign-in');
  });
}

function open(connection) {
  const input = element('input', {
    type: 'password',
    'aria-label': 'Token',
    autocomplete: 'off',
    placeholder: 'token',
  });
  const error = element('p', { class: 'error', role: 'alert' });
  const signIn = async () => {
    const token = /t=([^&\s]+)/.exec(input.value)?.[1] ?? input.value.trim();
    if (!token) return;
    try {
      await connection.signIn(token);
      input.value = '';
      closeDialog('sign-in');
    } catch (failure) {
      error.textContent = [failure.number, failure.cause, failure.remedy].filter(Boolean).join(' ');
    }
  };
  input.addEventListener('keydown', event => {
    if (event.key === 'Enter') signIn();
  });
  openDialog({
    key: 'sign-in',
    title: 'Sign in',
    focus: input,
    content: [
      element('p', { text: 'Open the address that `retrace serve` printed, or enter the token at its end.' }),
      input,
      error,
    ],
    choices: [{ label: 'Sign in', main: true, keepsOpen: true, run: signIn }],
  });
}
