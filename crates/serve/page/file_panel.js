// The programs folder: load, upload, delete.
//
// Invariant: an upload never starts or loads a program, and replaces one only after a question.

import { button, element, isOff, setChildren, setOff, setText } from './element.js';
import { formatBytes, formatTime } from './units.js';
import { confirm } from './dialog.js';

/** Files. */
export class FilePanel {
  constructor(store, connection, orders) {
    Object.assign(this, { store, connection, orders });
    this.programs = [];
    this.picker = element('input', {
      type: 'file',
      hidden: true,
      multiple: true,
      'aria-label': 'Programs to upload',
      accept: '.nc,.ngc,.tap,.gcode,.txt,.cnc,.gc',
      on: { change: () => this.uploadAll(this.picker.files) },
    });
    this.list = element('div', { class: 'list files', role: 'list', 'aria-label': 'Programs', tabindex: '0' });
    this.title = element('p', { class: 'list-title' });
    this.search = element('input', {
      type: 'search',
      'aria-label': 'Search programs',
      placeholder: 'search',
      on: { input: () => this.showList() },
    });
    this.node = element(
      'div',
      { class: 'column drop' },
      element(
        'div',
        { class: 'list-head' },
        this.title,
        this.search,
        button('Upload …', () => this.picker.click(), { class: 'main' }),
        this.picker,
      ),
      this.list,
    );
    this.node.addEventListener('dragover', event => {
      event.preventDefault();
      this.node.classList.add('over');
    });
    this.node.addEventListener('dragleave', () => this.node.classList.remove('over'));
    this.node.addEventListener('drop', event => {
      event.preventDefault();
      this.node.classList.remove('over');
      this.uploadAll(event.dataTransfer.files);
    });
    store.on('control link', () => this.showState());
    store.on('state', () => this.showState());
  }

  onShow() {
    this.refresh();
  }

  async refresh() {
    try {
      const answer = await this.connection.request('GET', '/api/v1/programs');
      this.programs = answer.programs;
      this.hasFolder = answer.folder;
    } catch (error) {
      this.orders.notices.refuse(error);
    }
    this.showList();
  }

  showList() {
    setText(
      this.title,
      this.hasFolder === false
        ? 'The server has no programs folder (--programs)'
        : `${this.programs.length} programs · drop files here`,
    );
    const wanted = this.search.value.toLowerCase();
    const rows = this.programs.filter(program => program.name.toLowerCase().includes(wanted));
    this.buttons = [];
    setChildren(
      this.list,
      ...rows.map(program => {
        const load = button(
          'Load',
          () => {
            if (!isOff(load)) this.orders.send(`open ${program.name}`);
          },
          { 'aria-label': `Load ${program.name}` },
        );
        const remove = button(
          'Delete',
          () => {
            if (!isOff(remove)) this.remove(program.name);
          },
          { 'aria-label': `Delete ${program.name}` },
        );
        this.buttons.push({ load, remove });
        const note = [formatBytes(program.bytes), program.modified_s ? formatTime(program.modified_s) : null];
        return element(
          'div',
          { role: 'listitem', class: 'file-row' },
          element('span', { class: 'file-name', text: program.name, title: program.name }),
          element('small', { text: note.filter(Boolean).join(' · ') }),
          load,
          remove,
        );
      }),
    );
    this.showState();
  }

  showState() {
    for (const { load, remove } of this.buttons ?? []) {
      setOff(load, !this.store.allows('open-program'));
      setOff(remove, !this.store.isHolder);
    }
  }

  async uploadAll(files) {
    for (const file of files) await this.upload(file, false);
    this.picker.value = '';
    this.refresh();
  }

  async upload(file, replaces) {
    this.orders.notices.inform(`${file.name} is being uploaded …`);
    try {
      await this.connection.request(
        'PUT',
        `/api/v1/programs/${encodeURIComponent(file.name)}`,
        file,
        replaces ? {} : { 'If-None-Match': '*' },
      );
      this.orders.notices.inform(`${file.name} was uploaded.`);
    } catch (error) {
      if (error.status !== 412) {
        this.orders.notices.refuse(error);
        return;
      }
      confirm({
        title: `Replace ${file.name}?`,
        text: 'The programs folder has a program of this name.',
        label: 'Replace',
        run: async () => {
          await this.upload(file, true);
          this.refresh();
        },
      });
    }
  }

  remove(name) {
    confirm({
      title: `Delete ${name}?`,
      label: 'Delete',
      run: async () => {
        try {
          await this.connection.request('DELETE', `/api/v1/programs/${encodeURIComponent(name)}`);
        } catch (error) {
          this.orders.notices.refuse(error);
        }
        this.refresh();
      },
    });
  }
}
