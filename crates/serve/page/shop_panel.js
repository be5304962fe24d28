// The jobs of the shop: list, details, start of the next piece.
//
// Invariant: a piece is started by two steps, the second one at a dialog with what is started. What may be started is
// decided by the machine.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { closeDialog, openDialog, openDialogKey } from './dialog.js';

/** How often the list is read while it is shown. */
const REFRESH_MS = 1000;
const DIALOG = 'shop-start';
const COLUMNS = ['', 'state', 'program', 'pieces', 'check', 'order', 'from', 'material', 'note'];

/** Jobs of the shop. */
export class ShopPanel {
  constructor(store, connection, orders) {
    Object.assign(this, { store, connection, orders, list: null, shown: '', chosen: null });
    this.title = element('p', { class: 'list-title' });
    this.start = button('Start …', () => this.askToStart(), { class: 'main' });
    this.table = element('div', { class: 'list', role: 'region', tabindex: '0', 'aria-label': 'Jobs of the shop' });
    this.details = element('div', {
      class: 'list job-details',
      role: 'region',
      tabindex: '0',
      'aria-label': 'Details of the job of the shop',
    });
    this.node = element(
      'div',
      { class: 'column' },
      element('div', { class: 'list-head' }, this.title, this.start),
      element('div', { class: 'shop-lists' }, this.table, this.details),
    );
    store.on('state control link', () => this.showState());
  }

  onShow() {
    this.refresh();
    this.timer ??= setInterval(() => this.refresh(), REFRESH_MS);
  }

  onHide() {
    clearInterval(this.timer);
    this.timer = undefined;
  }

  async refresh() {
    if (!this.store.isLive || this.isReading) return;
    this.isReading = true;
    try {
      this.list = await this.connection.request('GET', '/api/v1/shop/jobs');
      this.readError = '';
    } catch (error) {
      this.readError = error.cause ?? String(error);
    }
    this.isReading = false;
    this.showList();
  }

  get job() {
    return this.list?.jobs.find(job => job.id === this.chosen) ?? null;
  }

  showList() {
    const { jobs, machine, hidden, error } = this.list ?? { jobs: [], machine: '', hidden: 0, error: '' };
    const count = `${jobs.length} ${jobs.length === 1 ? 'job' : 'jobs'} of ${machine}`;
    const more = hidden > 0 ? `, ${hidden} more with \u201cretrace shop jobs --all\u201d` : '';
    const failed = this.readError || error;
    const none = machine ? `machine ${machine} has no jobs of the shop` : 'no jobs of a shop';
    setText(this.title, failed || (jobs.length > 0 ? `${count}${more}` : none));
    // The first one that can be started is what is looked for.
    if (!this.job) this.chosen = (jobs.find(job => job.is_ready) ?? jobs.at(-1))?.id ?? null;
    const text = JSON.stringify([jobs, this.chosen]);
    if (text !== this.shown) {
      this.shown = text;
      this.showRows(jobs);
      this.showDetails();
    }
    this.showState();
  }

  showRows(jobs) {
    // a shop without order numbers needs no column for them
    const columns = COLUMNS.filter(name => name !== 'order' || jobs.some(job => job.order_number));
    const hadFocus = this.table.contains(document.activeElement) && document.activeElement !== this.table;
    setChildren(
      this.table,
      jobs.length === 0
        ? null
        : element(
            'table',
            { class: 'wide shop-jobs' },
            element(
              'thead',
              {},
              element(
                'tr',
                {},
                ...columns.map(name => (name ? element('th', { scope: 'col', class: name, text: name }) : element('td'))),
              ),
            ),
            element('tbody', {}, ...jobs.map(job => this.row(job, columns))),
          ),
    );
    if (hadFocus) this.table.querySelector('[aria-pressed=true]')?.focus({ preventScroll: true });
  }

  row(job, columns) {
    const isChosen = job.id === this.chosen;
    const cell = (name, text) => element('td', { class: name, text });
    const name = button(
      job.program || 'not taken yet',
      event => {
        event.stopPropagation();
        this.choose(job.id);
      },
      { 'aria-pressed': String(isChosen) },
    );
    return element(
      'tr',
      { class: isChosen ? 'now' : null, on: { click: () => this.choose(job.id) } },
      element('td', { text: String(job.order) }),
      cell('state', job.is_ready ? `▸ ${job.state}` : job.state),
      element('td', { class: 'program' }, name),
      cell('pieces', `${job.good}/${job.quantity}`),
      cell('check', job.check),
      columns.includes('order') ? cell('order', job.order_number) : null,
      cell('from', job.submitter),
      cell('material', job.material),
      cell('note', job.note),
    );
  }

  choose(id) {
    this.chosen = id;
    this.showList();
  }

  showDetails() {
    const { job } = this;
    if (!job) return setChildren(this.details);
    const rows = [
      ['job', job.id],
      ['state', job.state],
      ...job.details,
      ...job.warnings.map(text => ['warning', text]),
    ];
    setChildren(this.details, element('h2', { text: job.program || 'not taken yet' }), factTable(rows));
  }

  /** Whether the chosen job could be started by this page now. */
  get mayStart() {
    return this.job?.is_ready === true && this.store.allows('open-program') && !this.store.state?.dry_run;
  }

  askToStart() {
    if (isOff(this.start) || !this.mayStart) return;
    const { job } = this;
    const pieces = pieceChoice(job.most_pieces);
    openDialog({
      key: DIALOG,
      level: 'waiting',
      title: job.most_pieces > 1 ? 'Start pieces of this job?' : 'Start a piece of this job?',
      content: [factTable(job.start), pieces?.node, element('p', { class: 'cause', text: 'The machine moves.' })].filter(
        Boolean,
      ),
      choices: [
        { label: 'Cancel' },
        { label: 'Start', main: true, run: () => this.orders.send(`start job ${job.id}${pieces?.words() ?? ''}`) },
      ],
    });
  }

  showState() {
    setOff(this.start, !this.mayStart);
    if (openDialogKey() === DIALOG && !this.mayStart) closeDialog(DIALOG);
  }
}

/** The number of pieces that one start runs, from 1; none where the job permits no series. */
function pieceChoice(most) {
  if (!(most > 1)) return null;
  let count = 1;
  const shown = element('output', { 'aria-live': 'polite' });
  const fewer = button('−', () => change(-1), { 'aria-label': 'fewer pieces' });
  const more = button('+', () => change(1), { 'aria-label': 'more pieces' });
  const change = by => {
    count = Math.min(Math.max(count + by, 1), most);
    setText(shown, count === 1 ? 'one piece' : `${count} of ${most} pieces, one after the other without a question`);
    setOff(fewer, count === 1);
    setOff(more, count === most);
  };
  change(0);
  return {
    node: element('div', { class: 'piece-choice', role: 'group', 'aria-label': 'number of pieces' }, fewer, more, shown),
    words: () => (count > 1 ? ` ${count}` : ''),
  };
}

function factTable(rows) {
  const cells = rows.map(([name, text]) =>
    element(
      'tr',
      { class: name.toLowerCase() === 'warning' ? 'error' : null },
      element('th', { scope: 'row', text: name }),
      element('td', { text }),
    ),
  );
  return element('table', { class: 'details' }, element('tbody', {}, ...cells));
}
