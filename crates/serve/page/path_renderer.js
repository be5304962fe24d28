// Draws the path with WebGL 2.
//
// Invariant: thick lines are drawn for a few segments only (current block, chosen line, contours, a job that is not
// placed yet); everything else is thin, one call a chunk.

import { VERTEX_BYTES } from './path_decoder.js';
import { PathLayer } from './path_layer.js';
import { makePrograms } from './path_shaders.js';

const PICK_RADIUS = 12;
const MAX_THICK = 250_000;
const MAX_THICK_SOFTWARE = 20_000;
const SOFTWARE = /swiftshader|llvmpipe|softpipe|basic render|software/i;
/** Largest record that a vertex can have. */
const NEVER = 0x3fffffff;
const EVERYTHING = [-3e38, 3e38];

/** Whether this browser draws WebGL on the CPU. Decides about antialiasing, which then costs too much. */
function drawsInSoftware() {
  const gl = document.createElement('canvas').getContext('webgl2');
  if (!gl) return true;
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const renderer = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return SOFTWARE.test(String(renderer));
}

/** Edges of a box in one stroke, as vertices of rapids that are never reached: they are drawn dashed. */
function boxVertices(box) {
  const corners = '0132045764623751'.split('').map(Number);
  const data = new ArrayBuffer((corners.length + 1) * VERTEX_BYTES),
    floats = new Float32Array(data),
    words = new Uint32Array(data);
  corners.forEach((corner, index) => {
    const at = (index + 1) * 4;
    for (let axis = 0; axis < 3; axis++) floats[at + axis] = box[axis + (((corner >> axis) & 1) === 1 ? 3 : 0)];
    words[at + 3] = NEVER;
  });
  return { data, count: corners.length };
}

/** Renderer. Throws where there is no WebGL 2. */
export class PathRenderer {
  constructor(canvas, { onLost, onRestored }) {
    this.canvas = canvas;
    this.isSoftware = drawsInSoftware();
    this.gl = canvas.getContext('webgl2', {
      antialias: !this.isSoftware,
      alpha: false,
      powerPreference: 'low-power',
    });
    if (!this.gl) throw new Error('this browser has no WebGL 2');
    this.isLost = false;
    canvas.addEventListener('webglcontextlost', event => {
      event.preventDefault();
      this.isLost = true;
      onLost();
    });
    canvas.addEventListener('webglcontextrestored', () => {
      this.isLost = false;
      this.prepare();
      onRestored();
    });
    this.prepare();
  }

  prepare() {
    const { gl } = this;
    this.programs = makePrograms(gl);
    // An attribute that no array feeds still needs the shader's type, or nothing is drawn.
    gl.vertexAttribI4ui(1, 0, 0, 0, 0);
    gl.vertexAttribI4ui(3, 0, 0, 0, 0);
    this.pickTarget = this.box = null;
    // A graphics card draws everything anew as fast, and smoother.
    this.layer = this.isSoftware ? new PathLayer(gl) : null;
    this.drawnVertices = 0;
  }

  /** Makes a mesh of the graphics card from the vertices. */
  make(data) {
    const { gl } = this,
      buffer = gl.createBuffer();
    const mesh = { buffer, thin: gl.createVertexArray(), thick: gl.createVertexArray() };
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.bindVertexArray(mesh.thin);
    this.point(0, 0, 0);
    gl.bindVertexArray(null);
    return mesh;
  }

  /** Sets the limits of the machine, `[x0, y0, z0, x1, y1, z1]` in mm of the path, or null. */
  setBox(box) {
    const key = box?.join() ?? '';
    if (this.isLost || key === (this.box?.key ?? '')) return;
    if (this.box) this.free(this.box.mesh);
    const vertices = box && boxVertices(box);
    this.box = box ? { key, count: vertices.count, mesh: this.make(vertices.data) } : null;
  }

  /** The limits as a stretch of vertices: a list of one or none. */
  boxStretches() {
    return this.box ? [{ chunk: this.box, from: 1, count: this.box.count }] : [];
  }

  /** Feeds the attributes of one end of the segments, from this offset in bytes. */
  point(end, offset, divisor) {
    const { gl } = this;
    gl.enableVertexAttribArray(2 * end);
    gl.vertexAttribPointer(2 * end, 3, gl.FLOAT, false, VERTEX_BYTES, offset);
    gl.vertexAttribDivisor(2 * end, divisor);
    gl.enableVertexAttribArray(2 * end + 1);
    gl.vertexAttribIPointer(2 * end + 1, 1, gl.UNSIGNED_INT, VERTEX_BYTES, offset + 12);
    gl.vertexAttribDivisor(2 * end + 1, divisor);
  }

  /** Replaces the vertex in place 0. */
  update(mesh, words) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, words);
  }

  free(mesh) {
    const { gl } = this;
    gl.deleteBuffer(mesh.buffer);
    gl.deleteVertexArray(mesh.thin);
    gl.deleteVertexArray(mesh.thick);
  }

  use(name, camera, state, width) {
    const { gl, canvas } = this,
      { program, uniforms } = this.programs[name],
      matrix = camera.uniforms();
    const cursor = Math.floor(state.record);
    gl.useProgram(program);
    gl.uniform3fv(uniforms.right, matrix.right);
    gl.uniform3fv(uniforms.up, matrix.up);
    gl.uniform2fv(uniforms.offset, matrix.offset);
    gl.uniform2f(uniforms.picture, canvas.width, canvas.height);
    gl.uniform1f(uniforms.width, width);
    gl.uniform1i(uniforms.cursor, cursor);
    if (name === 'pick') return;
    // A tool that stands within the furthest record has gone back over nothing.
    const furthest = state.reached - state.record > 1 ? state.reached - cursor : 0;
    gl.uniform2f(uniforms.history, state.oldest - cursor, furthest);
    gl.uniform4fv(uniforms.ink, state.inks);
    gl.uniform1f(uniforms.dash, state.dash);
    gl.uniform1f(uniforms.feed_share, state.feedShare);
    gl.uniform2fv(uniforms.only, EVERYTHING);
    gl.uniform4f(uniforms.only_ink, 0, 0, 0, 0);
    gl.uniform1f(uniforms.only_dash, 0);
  }

  /** Draws the chunks, then the spans of `ranges` (`{records, ink, width, spans, isAhead, dash}`) over them:
   * in their ink, or, with `isAhead`, only what lies ahead of the tool, and the rest in the colours of its state. `dash`
   * is the length of a dash and its gap, in records. `placed` (`{camera, state, chunks}` or null) is the path as it would
   * lie elsewhere, over all that. */
  draw(camera, state, chunks, ranges, placed = null) {
    if (this.isLost) return;
    const { gl, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...state.paper);
    if (this.layer) {
      this.layer.draw(camera, state, chunks, {
        clear: () => {
          gl.clear(gl.COLOR_BUFFER_BIT);
          this.use('ink', camera, state, 0);
          this.drawStretches(this.boxStretches());
        },
        boxKey: this.box?.key,
        drawThin: stretches => {
          this.use('ink', camera, state, 0);
          this.drawStretches(stretches);
        },
      });
      this.drawRanges(camera, state, ranges);
      this.drawPlaced(placed);
      return;
    }
    gl.clear(gl.COLOR_BUFFER_BIT);
    this.use('ink', camera, state, 0);
    this.drawStretches(this.boxStretches());
    const vertices = chunks.reduce((sum, chunk) => sum + chunk.count, 0);
    // Lines are one device pixel wide. On fine displays that is too thin, and a graphics card draws quads as fast.
    const width = !this.isSoftware && state.ratio > 1 && vertices < MAX_THICK ? 0.8 * state.ratio : 0;
    this.use('ink', camera, state, width);
    if (width > 0) this.drawQuads(chunks);
    else this.drawThin(chunks);
    this.drawRanges(camera, state, ranges);
    this.drawPlaced(placed);
  }

  drawPlaced(placed) {
    if (!placed) return;
    const { camera, state, chunks } = placed;
    const vertices = chunks.reduce((sum, chunk) => sum + chunk.count, 0),
      isThick = vertices < (this.isSoftware ? MAX_THICK_SOFTWARE : MAX_THICK);
    this.use('ink', camera, state, isThick ? 2 * state.ratio : 0);
    if (isThick) this.drawQuads(chunks);
    else this.drawThin(chunks);
    this.gl.bindVertexArray(null);
  }

  drawRanges(camera, state, ranges) {
    for (const range of ranges) this.drawThick(camera, state, range);
    this.gl.bindVertexArray(null);
  }

  drawStretches(stretches) {
    const { gl } = this;
    this.drawnVertices = 0;
    for (const { chunk, from, count } of stretches) {
      gl.bindVertexArray(chunk.mesh.thin);
      gl.drawArrays(gl.LINE_STRIP, from, count);
      this.drawnVertices += count;
    }
  }

  drawThin(chunks) {
    const { gl } = this;
    this.drawnVertices = 0;
    for (const { mesh, count, hasJoint } of chunks) {
      gl.bindVertexArray(mesh.thin);
      gl.drawArrays(gl.LINE_STRIP, hasJoint ? 0 : 1, hasJoint ? count + 1 : count);
      this.drawnVertices += count;
    }
  }

  drawThick(camera, state, { records, ink, width, spans, isAhead, dash }) {
    if (spans.length === 0) return;
    const { gl } = this;
    const cursor = Math.floor(state.record),
      { uniforms } = this.programs.ink;
    this.use('ink', camera, state, width);
    gl.uniform2f(uniforms.only, records[0] - cursor, records[1] - cursor);
    gl.uniform4fv(uniforms.only_ink, ink);
    gl.uniform1f(uniforms.only_from, isAhead ? 0 : EVERYTHING[0]);
    gl.uniform1f(uniforms.only_dash, dash ?? 0);
    gl.uniform1f(uniforms.dash, 1e9);
    for (const { chunk, from, count } of spans) this.drawSegments(chunk.mesh, from, count);
  }

  drawQuads(chunks) {
    this.drawnVertices = 0;
    for (const { mesh, count, hasJoint } of chunks) {
      this.drawSegments(mesh, hasJoint ? 0 : 1, hasJoint ? count : count - 1);
      this.drawnVertices += count;
    }
  }

  /** Draws segments of a mesh as quads. */
  drawSegments(mesh, from, count) {
    if (count < 1) return;
    const { gl } = this;
    gl.bindVertexArray(mesh.thick);
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffer);
    this.point(0, from * VERTEX_BYTES, 1);
    this.point(1, (from + 1) * VERTEX_BYTES, 1);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
  }

  /** Record nearest to a pixel of the canvas, or null: records are drawn instead of colours, into a small square. */
  pick(camera, state, chunks, x, y) {
    if (this.isLost) return null;
    const { gl, canvas } = this,
      size = 2 * PICK_RADIUS + 1;
    if (!this.pickTarget) {
      this.pickTarget = { frame: gl.createFramebuffer(), store: gl.createRenderbuffer() };
      gl.bindRenderbuffer(gl.RENDERBUFFER, this.pickTarget.store);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA32UI, size, size);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.pickTarget.frame);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, this.pickTarget.store);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.pickTarget.frame);
    gl.viewport(
      PICK_RADIUS - Math.round(x),
      PICK_RADIUS + 1 + Math.round(y) - canvas.height,
      canvas.width,
      canvas.height,
    );
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
    this.use('pick', camera, state, 0);
    this.drawThin(chunks);
    const pixels = new Uint32Array(4 * size * size);
    gl.readPixels(0, 0, size, size, gl.RGBA_INTEGER, gl.UNSIGNED_INT, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.bindVertexArray(null);
    let best = null,
      nearest = Infinity;
    for (let index = 0; index < size * size; index++) {
      if (pixels[4 * index] === 0) continue;
      const distance = ((index % size) - PICK_RADIUS) ** 2 + (Math.floor(index / size) - PICK_RADIUS) ** 2;
      if (distance < nearest) {
        nearest = distance;
        best = pixels[4 * index] - 1;
      }
    }
    return best;
  }
}
