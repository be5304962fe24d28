// What was seen of a run: at the pins, and in the firmware's own measurements.

/** Words of the firmware's `DIAGNOSTICS` (crates/firmware/src/diagnostics.rs). */
const WORDS = 13;

export function findings(board, scope, began) {
  const { net, pulses, periods, wrong, late, worst } = scope;
  const [mark, maxPeriod, maxInterrupt, inInterrupts, computed, latePeriods, lostBytes, refused, ...rest] = board.words(
    'DIAGNOSTICS',
    WORDS,
  );
  const seconds = (performance.now() - began) / 1000;
  return {
    cycles: board.cycles, periods, pulses, net, wrong: wrong.length, wrong_first: wrong.slice(0, 3), late, worst,
    mark, max_period: maxPeriod, mean_period: Math.round((rest[4] * 1024) / Math.max(1, computed)),
    max_interrupt: maxInterrupt, in_interrupts: inInterrupts, computed,
    late_periods: latePeriods, lost_bytes: lostBytes, refused, counted: rest.slice(0, 4).map((count) => count | 0),
    stack: board.stackDepth(), slower: +((125e6 * seconds) / board.cycles).toFixed(1),
  };
}
