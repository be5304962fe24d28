// Keeps the drawn path in a picture of its own, for browsers that draw on the CPU.
//
// While the machine moves, only the colours of a short stretch change: from the place of the tool before to the one
// now, and the same at the ends of the history. That stretch is drawn over the picture that is kept, and the picture is
// copied to the screen. Everything is drawn again where the view, the chunks or the colours have changed, and from time
// to time, because what is drawn later lies above what it crosses.
//
// Invariant: the picture that is kept has thin lines only; what is thick is drawn over the copy.

import { segmentsBetween } from './path_chunks.js';

const REDRAWN_AFTER_MS = 20_000;
/** Longest stretch, as a share of all vertices, that is drawn over the picture. */
const MAX_SHARE = 0.25;

/** Layer of a WebGL 2 context. */
export class PathLayer {
  constructor(gl) {
    this.gl = gl;
    this.frame = gl.createFramebuffer();
    this.store = gl.createRenderbuffer();
    this.size = '';
  }

  /** What must be the same for the kept picture to be right, apart from the state of the path. */
  key(camera, state, chunks, boxKey) {
    const { right, up, offset } = camera.uniforms();
    const { width, height } = this.gl.canvas;
    const meshes = chunks.map(({ path, level, first, count, hasJoint }) => [path, level, first, count, hasJoint]);
    return JSON.stringify([
      boxKey,
      [...right],
      [...up],
      [...offset],
      width,
      height,
      [...state.inks],
      [...state.paper],
      meshes,
    ]);
  }

  /** Draws what has changed into the layer, by `clear` and `drawThin` of the renderer, and copies it to the canvas. */
  draw(camera, state, chunks, { clear, drawThin, boxKey }) {
    const { gl } = this,
      { width, height } = gl.canvas,
      now = performance.now();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    if (this.size !== `${width} ${height}`) {
      this.size = `${width} ${height}`;
      gl.bindRenderbuffer(gl.RENDERBUFFER, this.store);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, this.store);
    }
    const key = this.key(camera, state, chunks, boxKey),
      changed = key === this.shownKey ? changes(this.shown, state) : null;
    const stretches = changed?.flatMap(([first, last]) => segmentsBetween(chunks, first, last));
    const total = chunks.reduce((sum, chunk) => sum + chunk.count, 0);
    const drawn = stretches?.reduce((sum, stretch) => sum + stretch.count, 0) ?? Infinity;
    if (drawn > total * MAX_SHARE || now - this.drawnAt > REDRAWN_AFTER_MS) {
      clear();
      drawThin(
        chunks.map(chunk => ({
          chunk,
          from: chunk.hasJoint ? 0 : 1,
          count: chunk.count + (chunk.hasJoint ? 1 : 0),
        })),
      );
      this.drawnAt = now;
    } else if (stretches.length > 0) {
      drawThin(stretches);
    }
    Object.assign(this, { shownKey: key, shown: state });
    // A browser empties the canvas at the first call that draws on it, once it has shown it. Chromium does not count the
    // copy as one: without this, what is drawn over the copy would empty it again, wherever nothing of the layer was new.
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.frame);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
}

/** Stretches of records whose colour differs between two states. */
function changes(before, now) {
  const stretch = (a, b) => (a === b ? [] : [[Math.min(a, b), Math.max(a, b)]]);
  return ['record', 'oldest', 'reached'].flatMap(name => stretch(before[name], now[name]));
}
