// Projects the path to the picture: view, zoom and pan. The projection is orthographic.
//
// Invariant: the centre of the picture is a point in mm relative to the path's origin; resizing keeps centre and scale.

const ISOMETRIC = { yaw: Math.PI / 4, pitch: Math.asin(Math.tan(Math.PI / 6)) };
const BASES = {
  top: { right: [1, 0, 0], up: [0, 1, 0] },
  front: { right: [1, 0, 0], up: [0, 0, 1] },
  side: { right: [0, 1, 0], up: [0, 0, 1] },
};
const MAX_SCALE = 4000;
const MARGIN = 0.92;

/** Names of the views, in the order of the view key. */
export const VIEWS = ['top', 'front', 'side', '3-D'];

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Camera. Lengths on the screen are CSS pixels. */
export class PathCamera {
  constructor() {
    this.view = 'top';
    this.center = [0, 0, 0];
    this.scale = 1;
    this.width = this.height = 1;
    Object.assign(this, ISOMETRIC);
    this.setBasis();
  }

  resize(width, height) {
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
  }

  setView(view) {
    this.view = view;
    Object.assign(this, ISOMETRIC);
    this.setBasis();
  }

  setBasis() {
    const { yaw, pitch } = this;
    Object.assign(
      this,
      BASES[this.view] ?? {
        right: [Math.cos(yaw), Math.sin(yaw), 0],
        up: [-Math.sin(yaw) * Math.sin(pitch), Math.cos(yaw) * Math.sin(pitch), Math.cos(pitch)],
      },
    );
  }

  /** Turns the 3-D view by a drag in pixels. */
  turn(dx, dy) {
    this.yaw -= dx * 0.008;
    this.pitch = Math.min(Math.max(this.pitch + dy * 0.008, 0.02), Math.PI / 2);
    this.setBasis();
  }

  /** Pixel of a point. */
  project(point) {
    const { right, up, center, scale } = this;
    return [
      this.width / 2 + (dot(right, point) - dot(right, center)) * scale,
      this.height / 2 - (dot(up, point) - dot(up, center)) * scale,
    ];
  }

  pan(dx, dy) {
    const { right, up, scale } = this;
    this.center = this.center.map((value, axis) => value - (right[axis] * dx - up[axis] * dy) / scale);
  }

  zoomAt(x, y, factor) {
    const scale = Math.min(Math.max(this.scale * factor, this.minScale ?? 1e-4), MAX_SCALE);
    const dx = x - this.width / 2,
      dy = y - this.height / 2;
    this.pan(-dx, -dy);
    this.scale = scale;
    this.pan(dx, dy);
  }

  /** Shows a box `[x0, y0, z0, x1, y1, z1]` whole, with room of some pixels above and below. */
  fit(box, top = 0, bottom = 0) {
    const extent = this.extentOf(box);
    this.center = [0, 1, 2].map(axis => (box[axis] + box[axis + 3]) / 2);
    const wide = Math.max(extent[2] - extent[0], 1e-3),
      high = Math.max(extent[3] - extent[1], 1e-3);
    this.scale = Math.min(
      MARGIN * Math.min(this.width / wide, Math.max(this.height - top - bottom, 40) / high),
      MAX_SCALE,
    );
    this.minScale = this.scale / 50;
    this.pan(0, (top - bottom) / 2);
  }

  /** Moves the centre so that a point lies in the picture, if it does not. */
  reveal(point) {
    const [x, y] = this.project(point);
    const edge = Math.min(this.width, this.height) / 8;
    if (x < edge || y < edge || x > this.width - edge || y > this.height - edge) this.center = [...point];
  }

  extentOf(box) {
    const extent = [Infinity, Infinity, -Infinity, -Infinity];
    for (let corner = 0; corner < 8; corner++) {
      const point = [0, 1, 2].map(axis => box[axis + ((corner >> axis) & 1) * 3]);
      const x = dot(this.right, point),
        y = dot(this.up, point);
      extent[0] = Math.min(extent[0], x);
      extent[1] = Math.min(extent[1], y);
      extent[2] = Math.max(extent[2], x);
      extent[3] = Math.max(extent[3], y);
    }
    return extent;
  }

  /** Whether a box reaches into the picture. */
  sees(box) {
    const [x0, y0, x1, y1] = this.extentOf(box);
    const x = dot(this.right, this.center),
      y = dot(this.up, this.center);
    const wide = this.width / 2 / this.scale,
      high = this.height / 2 / this.scale;
    return x1 >= x - wide && x0 <= x + wide && y1 >= y - high && y0 <= y + high;
  }

  /** The same camera, as seen by a path that is placed otherwise: turned around Z and moved. See `PathPlacement`. */
  placed(placement) {
    const { from, to } = placement,
      turnBack = vector => placement.turnVector(vector, -1);
    const center = turnBack(this.center.map((value, axis) => value - to[axis])).map((value, axis) => value + from[axis]);
    return Object.assign(new PathCamera(), this, { right: turnBack(this.right), up: turnBack(this.up), center });
  }

  /** Rows of the matrix from mm to clip space, and the offset. */
  uniforms() {
    const sx = (2 * this.scale) / this.width,
      sy = (2 * this.scale) / this.height;
    return {
      right: this.right.map(value => value * sx),
      up: this.up.map(value => value * sy),
      offset: [-dot(this.right, this.center) * sx, -dot(this.up, this.center) * sy],
    };
  }
}
