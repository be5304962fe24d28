// Keeps the chunks of the path that are on the graphics card, and lists those that are missing in the picture.
//
// Invariant: never more than MAX_VERTICES vertices. The coarsest level stays, of the others the chunks that were not
// drawn for longest go first.

import { KIND_SHIFT, RECORD_MASK, VERTEX_BYTES, decodeChunk } from './path_decoder.js';

const MAX_VERTICES = 2_000_000;
const ASK_AGAIN_MS = 4000;
const MAX_ASKED = 12;

/** Chunks of all levels of one path. `buffers` makes and frees buffers of the graphics card. */
export class PathChunks {
  constructor(buffers) {
    this.buffers = buffers;
    this.clear();
  }

  clear() {
    for (const level of this.levels ?? []) for (const chunk of level.chunks) this.unload(chunk);
    this.path = null;
    this.levels = [];
    this.vertices = 0;
    this.lengths = null;
  }

  /** Applies the description of a path. Chunks of the same path that are still right are kept. */
  setPath(message) {
    const kept = new Map();
    if (this.path?.path === message.path) {
      for (const level of this.levels) {
        for (const chunk of level.chunks) {
          if (chunk.mesh) kept.set(`${level.level} ${chunk.first} ${chunk.count} ${level.tolerance_mm}`, chunk);
        }
      }
    } else {
      this.clear();
    }
    this.path = message;
    this.levels = message.levels.map(level => ({
      ...level,
      chunks: level.chunks.map((chunk, index) => {
        const key = `${level.level} ${chunk.first} ${chunk.count} ${level.tolerance_mm}`,
          old = kept.get(key);
        kept.delete(key);
        return {
          ...chunk,
          path: message.path,
          level: level.level,
          index,
          mesh: old?.mesh ?? null,
          floats: old?.floats,
          words: old?.words,
          hasJoint: false,
          drawn: 0,
          asked: -Infinity,
        };
      }),
    }));
    for (const chunk of kept.values()) this.unload(chunk);
    this.lengths = null;
    for (const level of this.levels) for (const chunk of level.chunks) this.join(level, chunk);
  }

  /** Adds the chunk of a binary message. Returns whether it belongs to this path. */
  accept(message, now) {
    const decoded = decodeChunk(message);
    const level = decoded && decoded.path === this.path?.path ? this.levels[decoded.level] : null;
    const chunk = level?.chunks.find(each => each.first === decoded.first);
    if (!chunk || chunk.count !== decoded.count) return false;
    this.unload(chunk);
    chunk.floats = new Float32Array(decoded.data);
    chunk.words = new Uint32Array(decoded.data);
    chunk.mesh = this.buffers.make(decoded.data);
    chunk.drawn = now;
    chunk.hasJoint = false;
    this.vertices += chunk.count;
    this.join(level, chunk);
    if (level.chunks[chunk.index + 1]) this.join(level, level.chunks[chunk.index + 1]);
    if (level.level === 0) this.lengths = null;
    this.evict();
    return true;
  }

  /** Copies the last vertex of the chunk before to place 0, so that the line between the chunks is drawn. */
  join(level, chunk) {
    const before = level.chunks[chunk.index - 1];
    if (chunk.hasJoint || !chunk.mesh || !before?.mesh) return;
    const from = before.count * 4;
    chunk.words.set(before.words.subarray(from, from + 4), 0);
    this.buffers.update(chunk.mesh, chunk.words.subarray(0, 4));
    chunk.hasJoint = true;
  }

  unload(chunk) {
    if (!chunk.mesh) return;
    this.buffers.free(chunk.mesh);
    this.vertices -= chunk.count;
    chunk.mesh = chunk.floats = chunk.words = null;
    chunk.hasJoint = false;
  }

  evict() {
    if (this.vertices <= MAX_VERTICES) return;
    const loaded = this.levels.slice(1).flatMap(level => level.chunks.filter(chunk => chunk.mesh));
    loaded.sort((a, b) => a.drawn - b.drawn);
    for (const chunk of loaded) {
      if (this.vertices <= MAX_VERTICES * 0.9) break;
      this.unload(chunk);
    }
  }

  /** Chunks of a level that reach into the picture. */
  inView(level, camera) {
    return level.chunks.filter(chunk => camera.sees(chunk.box));
  }

  /**
   * Chooses what to draw: the coarsest level that is good to half a pixel and has no more than `maxVertices` in the
   * picture, or a coarser one as long as its chunks are missing. Returns the chunks to draw and the messages to send.
   */
  choose(camera, maxVertices, now) {
    if (this.levels.length === 0) return { chunks: [], wants: [] };
    const half = 0.5 / camera.scale;
    let best = this.levels.findIndex(level => level.tolerance_mm <= half);
    if (best < 0) best = this.levels.length - 1;
    let seen = this.inView(this.levels[best], camera);
    while (best > 0 && seen.reduce((sum, chunk) => sum + chunk.count, 0) > maxVertices) {
      best -= 1;
      seen = this.inView(this.levels[best], camera);
    }
    const wants = this.missing(this.levels[0], this.levels[0].chunks, now);
    if (wants.length === 0 && best > 0) {
      const before = seen.map(chunk => this.levels[best].chunks[chunk.index - 1]).filter(Boolean);
      wants.push(...this.missing(this.levels[best], [...seen, ...before], now));
    }
    while (best > 0 && seen.some(chunk => !chunk.mesh)) {
      best -= 1;
      seen = this.inView(this.levels[best], camera);
    }
    const chunks = seen.filter(chunk => chunk.mesh);
    for (const chunk of chunks) chunk.drawn = now;
    return { chunks, wants, level: best };
  }

  missing(level, chunks, now) {
    const asked = level.chunks.filter(chunk => !chunk.mesh && now - chunk.asked < ASK_AGAIN_MS).length;
    const firsts = [];
    for (const chunk of chunks) {
      if (asked + firsts.length >= MAX_ASKED) break;
      if (chunk.mesh || now - chunk.asked < ASK_AGAIN_MS || firsts.includes(chunk.first)) continue;
      chunk.asked = now;
      firsts.push(chunk.first);
    }
    return firsts.length > 0 ? [{ t: 'want', path: this.path.path, level: level.level, firsts }] : [];
  }

  /** Finest loaded chunk with this record, and the index of the first vertex at or behind it. */
  find(record) {
    for (const level of [...this.levels].reverse()) {
      const chunk = chunkWith(level.chunks, record);
      if (chunk) return { chunk, index: vertexAt(chunk, record) };
    }
    return null;
  }

  /** Position of a record in mm relative to the origin, or null where the path is not loaded. */
  positionOf(record) {
    const found = this.find(record);
    if (!found) return null;
    const {
        chunk: { floats, words },
        index,
      } = found,
      at = index * 4,
      before = at - 4;
    const b = words[at + 3] & RECORD_MASK,
      a = index > 1 || found.chunk.hasJoint ? words[before + 3] & RECORD_MASK : b;
    const share = b > a ? Math.min(Math.max((record - a) / (b - a), 0), 1) : 1;
    const from = b > a ? before : at;
    return [0, 1, 2].map(axis => floats[from + axis] + (floats[at + axis] - floats[from + axis]) * share);
  }

  /** Segments between two records in the finest loaded chunks: `{chunk, from, count}` with `from` as a vertex. */
  spans([first, last]) {
    for (const level of [...this.levels].reverse()) {
      if (!isWholeBetween(level.chunks, first, last)) continue;
      const spans = [];
      for (const chunk of level.chunks) {
        if (!chunk.mesh) continue;
        const [low, high] = recordsOf(chunk);
        if (high < first || low > last) continue;
        const start = Math.max(vertexAt(chunk, first) - 1, chunk.hasJoint ? 0 : 1);
        const end = Math.min(vertexAt(chunk, last), chunk.count);
        if (end > start) spans.push({ chunk, from: start, count: end - start });
      }
      if (spans.length > 0) return spans;
    }
    return [];
  }

  /** Length of the path from its beginning to each vertex of the coarsest level, or null while it is not loaded. */
  lengthTable() {
    const level = this.levels[0];
    if (this.lengths || !level || level.chunks.some(chunk => !chunk.mesh)) return this.lengths;
    const total = level.chunks.reduce((sum, chunk) => sum + chunk.count, 0);
    const records = new Float64Array(total),
      lengths = new Float64Array(total);
    let place = 0,
      length = 0,
      last = null;
    for (const { floats, words, count } of level.chunks) {
      for (let index = 1; index <= count; index++) {
        const at = index * 4;
        if (last) length += Math.hypot(floats[at] - last[0], floats[at + 1] - last[1], floats[at + 2] - last[2]);
        last = [floats[at], floats[at + 1], floats[at + 2]];
        records[place] = words[at + 3] & RECORD_MASK;
        lengths[place++] = length;
      }
    }
    this.lengths = { records, lengths };
    return this.lengths;
  }
}

/** Stretches `{chunk, from, count}` of vertices of these chunks whose lines have records between two. */
export function segmentsBetween(chunks, first, last) {
  const stretches = [];
  for (const chunk of chunks) {
    const [low, high] = recordsOf(chunk);
    const begin = chunk.hasJoint ? chunk.words[3] & RECORD_MASK : low;
    if (high < first || begin > last) continue;
    const from = Math.max(vertexAt(chunk, first) - 1, chunk.hasJoint ? 0 : 1);
    const end = Math.min(vertexAt(chunk, last), chunk.count);
    if (end > from) stretches.push({ chunk, from, count: end - from + 1 });
  }
  return stretches;
}

function recordsOf({ words, count }) {
  return [words[7] & RECORD_MASK, words[count * 4 + 3] & RECORD_MASK];
}

/** Whether all chunks with records of a range are loaded. Records grow from chunk to chunk. */
function isWholeBetween(chunks, first, last) {
  let high = Infinity;
  for (const chunk of [...chunks].reverse()) {
    if (!chunk.mesh) {
      // It lies before `high`; it has none of the range if a loaded chunk before it reaches the end of the range.
      if (high <= first) continue;
      const before = chunks.slice(0, chunk.index).findLast(each => each.mesh);
      if (!before || recordsOf(before)[1] < last) return false;
    } else {
      high = recordsOf(chunk)[0];
    }
  }
  return true;
}

function chunkWith(chunks, record) {
  return chunks.find(chunk => {
    if (!chunk.mesh) return false;
    const [low, high] = recordsOf(chunk);
    return record >= (chunk.index === 0 ? 0 : chunk.hasJoint ? chunk.words[3] & RECORD_MASK : low) && record <= high;
  });
}

/** Index of the first vertex of a chunk whose record is not before the given one. */
function vertexAt({ words, count }, record) {
  let low = 1,
    high = count;
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((words[middle * 4 + 3] & RECORD_MASK) < record) low = middle + 1;
    else high = middle;
  }
  return low;
}

export { KIND_SHIFT, VERTEX_BYTES };
