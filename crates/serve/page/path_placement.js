// Where a job would lie that is turned around Z and moved, in mm of the path.
//
// Invariant: heights stay.

/** Placement by `{from_mm, to_mm, turn_deg}` of the server. */
export class PathPlacement {
  constructor({ from_mm: from, to_mm: to, turn_deg: degrees }, origin) {
    const inPath = mm => [mm[0] - origin[0], mm[1] - origin[1], 0];
    Object.assign(this, { from: inPath(from), to: inPath(to), radians: (degrees * Math.PI) / 180 });
  }

  /** A direction that is turned with the job, or, with `sense` -1, turned back. */
  turnVector([x, y, z], sense = 1) {
    const cos = Math.cos(this.radians),
      sin = Math.sin(this.radians) * sense;
    return [x * cos - y * sin, x * sin + y * cos, z];
  }

  /** Where a point of the job would be. */
  place(point) {
    const { from, to } = this;
    return this.turnVector(point.map((value, axis) => value - from[axis])).map((value, axis) => value + to[axis]);
  }

  /** Box around a placed box `[x0, y0, z0, x1, y1, z1]`. */
  boxOf(box) {
    const corners = [0, 1, 2, 3].map(corner => this.place([box[corner & 1 ? 3 : 0], box[corner & 2 ? 4 : 1], box[2]]));
    const side = (axis, pick) => pick(...corners.map(corner => corner[axis]));
    return [side(0, Math.min), side(1, Math.min), box[2], side(0, Math.max), side(1, Math.max), box[5]];
  }
}
