// Turning the view of a replay by mouse, finger, wheel and keys.

/** Listen on a replay's canvas until the signal aborts. */
export function canvasInput(replay, signal) {
  const { canvas } = replay, held = new Map();  // pointers that are down, and where
  const on = (name, act, more = {}) => canvas.addEventListener(name, act, { signal, ...more });
  const apart = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  on("pointerdown", (e) => {
    held.set(e.pointerId, [e.clientX, e.clientY]);
    canvas.setPointerCapture(e.pointerId);
  });
  for (const name of ["pointerup", "pointercancel"]) on(name, (e) => held.delete(e.pointerId));
  on("pointermove", (e) => {
    const before = held.get(e.pointerId);
    if (!before) return;
    const was = held.size === 2 ? apart() : 0;
    held.set(e.pointerId, [e.clientX, e.clientY]);
    if (was) replay.zoom(was / Math.max(apart(), 1));
    else if (e.shiftKey) replay.pan(e.clientX - before[0], e.clientY - before[1]);
    else replay.orbit((before[0] - e.clientX) / 150, (before[1] - e.clientY) / 200);
  });
  on("wheel", (e) => { e.preventDefault(); replay.zoom(Math.exp(e.deltaY / 800)); }, { passive: false });
  on("keydown", (e) => {
    const act = {
      ArrowLeft: () => replay.orbit(-0.1, 0), ArrowRight: () => replay.orbit(0.1, 0),
      ArrowUp: () => replay.orbit(0, -0.1), ArrowDown: () => replay.orbit(0, 0.1),
      "+": () => replay.zoom(0.9), "=": () => replay.zoom(0.9), "-": () => replay.zoom(1.1), 0: () => replay.look("front"),
    }[e.key];
    if (act && !e.ctrlKey && !e.metaKey && !e.altKey) { act(); e.preventDefault(); e.stopPropagation(); }
  });
  on("webglcontextlost", (e) => e.preventDefault());
  on("webglcontextrestored", () => replay.draw());
}
