// Makes the outline of a box, such as the limits of the machine, as the data of an SVG path.
//
// Invariant: lines end at the edge of the picture. A browser dashes a line of a million pixels for a second.

const MARGIN = 10;

/** Outline of a box `[x0, y0, z0, x1, y1, z1]` in the picture: 12 edges, or four where it is seen along an axis. */
export function boxOutline(box, camera) {
  const corner = number => camera.project([0, 1, 2].map(axis => box[axis + ((number >> axis) & 1) * 3]));
  const edges = new Set();
  for (let from = 0; from < 8; from++) {
    for (const axis of [1, 2, 4]) {
      if (from & axis) continue;
      const line = clipLine(corner(from), corner(from | axis), camera.width, camera.height);
      if (!line) continue;
      const [a, b] = line.map(point => point.map(value => value.toFixed(1)).join(' '));
      if (a !== b) edges.add(`M${a}L${b}`);
    }
  }
  return [...edges].join('');
}

/** Part of a line that lies in the picture, or null (Liang and Barsky). */
function clipLine(a, b, width, height) {
  const d = [b[0] - a[0], b[1] - a[1]],
    low = [-MARGIN, -MARGIN],
    high = [width + MARGIN, height + MARGIN];
  let from = 0,
    to = 1;
  for (const axis of [0, 1]) {
    if (Math.abs(d[axis]) < 1e-9) {
      if (a[axis] < low[axis] || a[axis] > high[axis]) return null;
      continue;
    }
    const shares = [(low[axis] - a[axis]) / d[axis], (high[axis] - a[axis]) / d[axis]];
    from = Math.max(from, Math.min(...shares));
    to = Math.min(to, Math.max(...shares));
  }
  if (from > to) return null;
  const at = share => [a[0] + d[0] * share, a[1] + d[1] * share];
  return [at(from), at(to)];
}
