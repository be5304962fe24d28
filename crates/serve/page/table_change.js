// Changes a table of the machine: asks for a value, and sends it for the version that was read.
//
// Invariant: a change names the turn of control and the version of the table; it is sent once.

import { formatPosition, lengthUnit, parseLength } from './units.js';
import { prompt } from './dialog.js';

/** Asks for a length in the chosen unit, or an angle; `run` receives mm or degrees. */
export function enterValue({ title, value, isLinear = true, least = -Infinity, run }) {
  const parse = text => {
    if (isLinear) return parseLength(text);
    const number = Number(text.trim().replace(',', '.'));
    return text.trim() !== '' && Number.isFinite(number) ? number : null;
  };
  prompt({
    title,
    text: isLinear ? `In ${lengthUnit()}` : 'In degrees',
    label: 'Set',
    value: formatPosition(value, isLinear).replace('\u2212', '-'),
    inputMode: 'decimal',
    check: text => {
      const number = parse(text);
      if (number === null) return 'Enter a number.';
      return number < least ? `Enter at least ${least}.` : null;
    },
    run: text => run(parse(text)),
  });
}

/** Sends a change of a table. Resolves with whether the machine has it. */
export async function changeTable({ connection, store, orders, version }, path, body) {
  const { client } = store.hello ?? {};
  try {
    const order = { client, turn: store.control?.turn ?? 0, ...body };
    await connection.request('PUT', path, order, { 'If-Match': version });
    return true;
  } catch (error) {
    orders.notices.refuse(error);
    return false;
  }
}
