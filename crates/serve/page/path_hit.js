// Finds the place of what is cut that is nearest to a point of the picture.
//
// Invariant: rapids and moves with the cutter off are never found.

import { KIND_SHIFT, RECORD_MASK } from './path_decoder.js';

const CUTTING = 2;

/**
 * Place in records of the cut that is nearest to a pixel, and its distance in pixels; null where none of these chunks
 * has a cut within `reach` pixels of it. Of several that are as near, the first on the path is found.
 */
export function nearestCut(chunks, camera, x, y, reach) {
  const { right, up, scale } = camera;
  const across = ([px, py, pz]) => right[0] * px + right[1] * py + right[2] * pz;
  const upwards = ([px, py, pz]) => up[0] * px + up[1] * py + up[2] * pz;
  const tapX = across(camera.center) + (x - camera.width / 2) / scale,
    tapY = upwards(camera.center) - (y - camera.height / 2) / scale;
  let nearest = (reach / scale) ** 2,
    record = null;
  for (const chunk of chunks) {
    if (!chunk.floats) continue;
    const [left, bottom, end, top] = camera.extentOf(chunk.box);
    const outside = [Math.max(left - tapX, tapX - end, 0), Math.max(bottom - tapY, tapY - top, 0)];
    if (outside[0] ** 2 + outside[1] ** 2 > nearest) continue;
    const { floats, words, count } = chunk;
    const first = chunk.hasJoint ? 0 : 1;
    let ax = NaN,
      ay = NaN;
    for (let index = first; index <= count; index++) {
      const at = index * 4,
        point = [floats[at], floats[at + 1], floats[at + 2]];
      const bx = across(point),
        by = upwards(point);
      if (index > first && words[at + 3] >>> KIND_SHIFT === CUTTING) {
        const dx = bx - ax,
          dy = by - ay,
          squared = dx * dx + dy * dy;
        const along = squared > 0 ? ((tapX - ax) * dx + (tapY - ay) * dy) / squared : 0;
        const share = Math.min(Math.max(along, 0), 1);
        const distance = (ax + dx * share - tapX) ** 2 + (ay + dy * share - tapY) ** 2;
        if (distance < nearest) {
          const before = words[at - 1] & RECORD_MASK,
            after = words[at + 3] & RECORD_MASK;
          nearest = distance;
          // The place where a segment begins belongs to what is before it.
          record = before + (after - before) * Math.max(share, 1e-3);
        }
      }
      ax = bx;
      ay = by;
    }
  }
  return record === null ? null : { record, distance: Math.sqrt(nearest) * scale };
}
