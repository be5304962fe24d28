// The profile of the loaded program: velocity, acceleration and jerk over time. The chart is loaded on first use.
//
// Invariant: it shows what is planned, with a mark at the place under the tool; it moves nothing.

import { button, element, setText } from './element.js';
import { formatDuration } from './units.js';

const MARK_MS = 250;

/** Profile. */
export class ProfilePanel {
  constructor(store, connection, notices) {
    Object.assign(this, { store, connection, notices });
    this.title = element('p', { class: 'list-title', text: 'profile' });
    this.place = element('div', { class: 'profile' });
    const act = (label, name, run) => button(label, () => this.chart && run(this.chart), { 'aria-label': name });
    this.node = element(
      'div',
      { class: 'column' },
      element(
        'div',
        { class: 'list-head' },
        this.title,
        act('−', 'Zoom out', chart => chart.zoom(0.5, 0.5)),
        act('+', 'Zoom in', chart => chart.zoom(0.5, 2)),
        act('All', 'All of the program', chart => chart.showAll()),
        button('Refresh', () => this.refresh()),
      ),
      this.place,
    );
    store.on('live', live => this.showTool(live));
    store.on('state', state => {
      if (state.program.path !== this.shownPath && this.node.offsetParent) this.refresh();
    });
  }

  /** Marks the place under the tool, four times a second. */
  showTool(live) {
    const now = performance.now();
    if (!this.chart || now - (this.markedAt ?? -Infinity) < MARK_MS || this.node.offsetParent === null) return;
    this.markedAt = now;
    this.chart.setToolTime(live.record * this.store.hello.machine.period_s);
  }

  onShow() {
    if (this.store.state?.program.path !== this.shownPath || !this.chart) this.refresh();
    else this.chart.draw();
  }

  async refresh() {
    setText(this.title, 'loading …');
    this.shownPath = this.store.state?.program.path;
    try {
      const { ProfileChart } = await import('./profile_chart.js');
      const data = await this.connection.request('GET', '/api/v1/profile');
      this.chart ??= new ProfileChart(this.place, text => setText(this.title, text));
      this.chart.setData(data);
      const last = data.t_s.at(-1);
      setText(this.title, last === undefined ? 'no profile: load a program' : `profile of ${formatDuration(last)}`);
    } catch (error) {
      setText(this.title, error.cause ?? 'the profile is not available');
    }
  }
}
