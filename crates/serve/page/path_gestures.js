// Turns pointers and the mouse wheel over the path into pan, zoom, turn and tap.
//
// Invariant: gestures change the picture only; nothing here moves the machine.

const TAP_PIXELS = 8;
const TAP_MS = 600;
const DOUBLE_TAP_MS = 350;

/** Gestures of the path view. `handlers` has `pan`, `zoom`, `turn`, `tap` and `doubleTap`. */
export function followGestures(node, handlers) {
  const pointers = new Map();
  let pressed = null,
    lastTap = -Infinity;
  const place = event => {
    const box = node.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  const middle = () => {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
  };

  node.addEventListener('pointerdown', event => {
    node.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    pressed =
      pointers.size === 1
        ? { ...place(event), at: event.timeStamp, turns: event.button === 2 || event.altKey }
        : null;
  });
  node.addEventListener('pointermove', event => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = place(event);
    if (pointers.size === 1) {
      if (pressed && Math.hypot(now.x - pressed.x, now.y - pressed.y) < TAP_PIXELS && !pressed.moved) return;
      if (pressed) pressed.moved = true;
      (pressed?.turns ? handlers.turn : handlers.pan)(now.x - before.x, now.y - before.y);
      pointers.set(event.pointerId, now);
    } else if (pointers.size === 2) {
      const from = middle();
      pointers.set(event.pointerId, now);
      const to = middle();
      handlers.pan(to.x - from.x, to.y - from.y);
      if (from.apart > 0) handlers.zoom(to.x, to.y, to.apart / from.apart);
    }
  });
  const end = event => {
    const isTap =
      event.type === 'pointerup' &&
      pointers.size === 1 &&
      pressed &&
      !pressed.moved &&
      event.timeStamp - pressed.at < TAP_MS &&
      event.button === 0;
    pointers.delete(event.pointerId);
    if (isTap) {
      const now = event.timeStamp,
        { x, y } = pressed;
      if (now - lastTap < DOUBLE_TAP_MS) {
        lastTap = -Infinity;
        handlers.doubleTap(x, y);
      } else {
        lastTap = now;
        handlers.tap(x, y);
      }
    }
    pressed = null;
  };
  for (const name of ['pointerup', 'pointercancel']) node.addEventListener(name, end);
  node.addEventListener('contextmenu', event => event.preventDefault());
  node.addEventListener(
    'wheel',
    event => {
      event.preventDefault();
      const { x, y } = place(event);
      handlers.zoom(x, y, Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.05 : 0.0015)));
    },
    { passive: false },
  );
}
