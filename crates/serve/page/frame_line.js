// The rectangle that a frame goes round, over the drawing of the path.
//
// Invariant: it is shown from the question before a frame until the tool stands again, or the question is answered with
// no.

import { svgElement } from './element.js';

/** Rectangle over the path view. */
export class FrameLine {
  constructor(store) {
    this.store = store;
    this.outline = svgElement('polygon', { points: '' });
    this.node = svgElement('svg', { class: 'frame-line', 'aria-hidden': 'true' }, this.outline);
    this.isMoving = false;
    this.node.style.display = 'none';
    // The frame has ended where the machine is ready again.
    store.on('state', ({ word }) => {
      const isReady = word === 'READY';
      if (store.framed && isReady && this.isMoving) store.showFrame(null);
      this.isMoving = store.framed !== null && !isReady;
    });
    // The machine may refuse it after the order was taken, as beyond a soft limit.
    store.on('rejected', () => {
      if (store.framed && !this.isMoving) store.showFrame(null);
    });
  }

  /** Places it in a picture. `project` maps a position in machine coordinates to a pixel. */
  place(project) {
    const { framed } = this.store;
    this.node.style.display = framed ? '' : 'none';
    if (!framed) return;
    const [[left, right], [low, high]] = framed;
    const corners = [
      [left, low],
      [right, low],
      [right, high],
      [left, high],
    ];
    const points = corners.map(([x, y]) =>
      project([x, y, 0])
        .map(pixel => pixel.toFixed(1))
        .join(),
    );
    this.outline.setAttribute('points', points.join(' '));
  }
}
