// Holds the contours of the program for the list and the drawing, and which of them is selected.
//
// Invariant: the contours are the server's. Selecting one moves and switches nothing.

const PAUSE_MS = 500;
/** Number of contours up to which they are fetched as soon as one of them changes. */
const MAX_FOLLOWED = 5000;

/** Contours of the program. */
export class ContourTable {
  constructor(store, connection) {
    Object.assign(this, { store, connection });
    this.contours = [];
    /** Number of the path to which the records of the contours belong. */
    this.path = null;
    this.number = null;
    this.listeners = new Set();
    this.fetchedAt = -Infinity;
    store.on('state path', () => this.follow());
  }

  /** Calls the listener after each change, with where the contour was selected, if that is what has changed. */
  on(listener) {
    this.listeners.add(listener);
  }

  emit(from) {
    for (const listener of this.listeners) listener(from);
  }

  /** Fetches the contours where the program, its path, or the state of one of them has changed. */
  follow() {
    const { state, path } = this.store;
    if (!state) return;
    const program = `${state.program.name} ${state.program.lines}`;
    if (program !== this.program) {
      this.program = program;
      this.select(null, 'program');
    }
    const changes = [state.program.check, path?.path, state.skipped_contours, state.stage];
    if (this.contours.length <= MAX_FOLLOWED) changes.push(state.cutter?.contour, state.cutter?.state);
    const key = `${program} ${JSON.stringify(changes)}`;
    if (key === this.key) return;
    this.key = key;
    this.refreshSoon();
  }

  /** Fetches the contours now, or a moment after they were fetched last. */
  refreshSoon() {
    if (this.later) return;
    this.later = setTimeout(
      () => {
        this.later = null;
        this.refresh();
      },
      Math.max(this.fetchedAt + PAUSE_MS - performance.now(), 0),
    );
  }

  /** Fetches the contours. */
  async refresh() {
    if (!this.store.isLive) return;
    this.fetchedAt = performance.now();
    try {
      const { contours, path } = await this.connection.request('GET', '/api/v1/program/contours');
      const isSelected = contours.some(({ number }) => number === this.number);
      Object.assign(this, { contours, path, number: isSelected ? this.number : null });
      this.emit();
    } catch {
      /* the next change fetches them again */
    }
  }

  /** The selected contour, if any. */
  get selected() {
    return this.contours[this.indexOf(this.number)];
  }

  /** Index of the contour with this number, -1 where there is none. */
  indexOf(number) {
    return number === null ? -1 : this.contours.findIndex(contour => contour.number === number);
  }

  /** Selects the contour with this number, or none. `from` is where: `list`, `path`, or `program`. */
  select(number, from) {
    const found = this.indexOf(number) < 0 ? null : number;
    if (found === null && this.number === null) return;
    this.number = found;
    this.emit(from);
  }

  /** Records of a contour on this path, `[first, end]`, or null. */
  recordsOn(path, contour) {
    return contour?.records && path === this.path ? contour.records : null;
  }

  /** The contour that is cut at this place of a path, in records, or null. */
  contourAt(path, record) {
    if (path !== this.path) return null;
    return this.contours.find(({ records }) => records && records[0] < record && record <= records[1]) ?? null;
  }

  /** Whether a contour is passed without being cut, or will be. */
  isSkipped(contour) {
    return contour.state === 'skipped' || (contour.state === 'not_cut' && !(contour.cut_mm > 0));
  }
}
