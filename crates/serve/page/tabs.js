// Tab strips: one beside the other areas (side), one over the path (stage).
//
// Invariant: one panel of each strip is shown. On a narrow screen only the strip that was used last shows its panel.

import { element } from './element.js';

/** Tab strip with its panels. */
export class Tabs {
  constructor(strip, place, name, onSelect) {
    Object.assign(this, { strip, place, name, onSelect });
    this.tabs = new Map();
    strip.addEventListener('keydown', event => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      const ids = [...this.tabs.keys()];
      this.select(ids[(ids.indexOf(this.selected) + step + ids.length) % ids.length], true);
    });
  }

  /** Adds a tab. `panel` is `{node, onShow, onHide}`. */
  add(id, label, panel, className = '') {
    const tab = element(
      'button',
      {
        type: 'button',
        role: 'tab',
        id: `tab-${id}`,
        'aria-controls': `panel-${id}`,
        class: className || null,
        on: { click: () => this.select(id) },
      },
      label,
    );
    const node = element(
      'section',
      { role: 'tabpanel', id: `panel-${id}`, 'aria-labelledby': `tab-${id}`, hidden: true, class: 'panel' },
      panel.node,
    );
    this.tabs.set(id, { tab, node, panel });
    this.strip.append(tab);
    this.place.append(node);
    if (this.tabs.size === 1) this.select(id, false, true);
    else this.mark(id, false);
  }

  mark(id, isSelected) {
    const { tab, node } = this.tabs.get(id);
    tab.setAttribute('aria-selected', String(isSelected));
    tab.tabIndex = isSelected ? 0 : -1;
    node.hidden = !isSelected;
  }

  /** Shows a panel. */
  select(id, takesFocus = false, isFirst = false) {
    if (!this.tabs.has(id)) return;
    if (!isFirst) document.body.dataset.shown = this.name;
    if (this.selected !== id) {
      if (this.selected) {
        this.mark(this.selected, false);
        this.tabs.get(this.selected).panel.onHide?.();
      }
      this.selected = id;
      this.mark(id, true);
    }
    const entry = this.tabs.get(id);
    entry.tab.scrollIntoView?.({ block: 'nearest', inline: 'nearest' });
    if (takesFocus) entry.tab.focus();
    entry.panel.onShow?.();
    this.onSelect?.(id);
  }

  /** Whether a panel can be seen. */
  isShown(id) {
    return this.selected === id && this.tabs.get(id).node.offsetParent !== null;
  }
}
