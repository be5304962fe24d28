// The jobs of the journal: list, details, resume.
//
// Invariant: a job is resumed only from its details, and the machine asks once more before it moves.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { baseName, jobTable } from './job_summary.js';
import { confirm } from './dialog.js';

/** Jobs. */
export class JobPanel {
  constructor(store, connection, orders) {
    Object.assign(this, { store, connection, orders });
    this.list = element('div', { class: 'list jobs', role: 'list', 'aria-label': 'Jobs', tabindex: '0' });
    this.details = element('div', {
      class: 'list job-details',
      'aria-label': 'Details of the job',
      role: 'region',
      tabindex: '0',
    });
    this.title = element('p', { class: 'list-title' });
    this.resume = button('Resume …', () => this.askToResume(), { class: 'main' });
    this.node = element(
      'div',
      { class: 'column' },
      element(
        'div',
        { class: 'list-head' },
        this.title,
        button('Refresh', () => this.refresh()),
        this.resume,
      ),
      element('div', { class: 'two-lists' }, this.list, this.details),
    );
    store.on('state control link', () => this.showState());
  }

  onShow() {
    this.refresh();
  }

  async refresh() {
    try {
      const answer = await this.connection.request('GET', '/api/v1/jobs');
      this.jobs = Array.isArray(answer) ? answer : (answer.jobs ?? []);
    } catch (error) {
      this.orders.notices.refuse(error);
      this.jobs ??= [];
    }
    setText(
      this.title,
      this.jobs.length > 0
        ? `${this.jobs.length} ${this.jobs.length === 1 ? 'job' : 'jobs'}`
        : 'no jobs in the journal',
    );
    this.rows = new Map();
    setChildren(
      this.list,
      ...this.jobs.map(job => {
        const line = job.line ? `line ${job.line}${job.lines ? ` of ${job.lines}` : ''}` : '';
        const row = button(
          '',
          () => this.open(job),
          { class: 'job-row' },
          element('b', { text: baseName(job.program) || job.id }),
          element('span', { text: [job.resumable ? '↻' : null, job.state, line].filter(Boolean).join(' · ') }),
          element('small', { text: job.id }),
        );
        this.rows.set(job.id, row);
        return element('div', { role: 'listitem' }, row);
      }),
    );
    if (this.opened) this.markRow();
    this.showState();
  }

  markRow() {
    for (const [id, row] of this.rows) row.setAttribute('aria-pressed', String(id === this.opened.id));
  }

  async open(job) {
    this.opened = job;
    this.markRow();
    this.showState();
    setChildren(this.details, element('p', { text: 'loading …' }));
    try {
      const record = await this.connection.request('GET', `/api/v1/jobs/${encodeURIComponent(job.id)}`);
      setChildren(this.details, element('h2', { text: baseName(job.program) || job.id }), jobTable(job, record));
    } catch (error) {
      setChildren(
        this.details,
        element('p', { class: 'error', text: `${error.number} ${error.cause}` }),
        element('p', { text: error.remedy }),
      );
    }
  }

  askToResume() {
    if (isOff(this.resume) || !this.opened) return;
    const { id, program } = this.opened;
    confirm({
      title: `Resume ${baseName(program) || id}?`,
      text:
        'The program is planned up to the breakpoint. Before anything moves, ' +
        'the machine shows what it will do and asks.',
      label: 'Resume',
      danger: false,
      run: () => this.orders.send(`resume job ${id}`),
    });
  }

  showState() {
    setOff(this.resume, !this.opened?.resumable || !this.store.isHolder || !this.store.isSetup);
  }
}
