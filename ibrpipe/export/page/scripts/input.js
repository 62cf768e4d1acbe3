// Pointers, wheel and keys on the canvas, as motions of the orbit; a touch that does not move is a click.

const STILL = 5; // CSS pixels that a click may move

function listen(canvas, orbit, changed, commands) {
  const pointers = new Map();
  let travelled = 0;
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, length: Math.hypot(a.x - b.x, a.y - b.y) || 1 };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    travelled = pointers.size > 1 ? Infinity : 0;
    commands.touched();
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) commands.hovered(event.offsetX, event.offsetY);
    if (!last || pointers.size > 2) return;
    const before = pointers.size === 2 ? spread() : last;
    const high = canvas.clientHeight, moved = event.buttons & 2 || event.shiftKey || event.ctrlKey;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const now = pointers.size === 2 ? spread() : pointers.get(event.pointerId);
    travelled += Math.hypot(event.clientX - last.x, event.clientY - last.y);
    if (travelled <= STILL) return;
    commands.moved();
    const dx = (now.x - before.x) / high, dy = (now.y - before.y) / high;
    if (pointers.size === 2) {
      orbit.zoom(before.length / now.length);
      orbit.pan(dx, dy);
    } else if (moved) orbit.pan(dx, dy);
    else orbit.turn(-4 * dx, 4 * dy);
    changed();
  });
  canvas.addEventListener("pointerup", (event) => {
    if (event.button === 0 && travelled <= STILL) commands.clicked(event.offsetX, event.offsetY);
  });
  canvas.addEventListener("pointerleave", () => commands.hovered(-1, -1));
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    commands.moved();
    const lines = event.deltaMode === 1 ? 30 : 1;
    orbit.zoom(Math.exp(Math.max(-0.5, Math.min(0.5, 0.0015 * lines * event.deltaY))));
    commands.touched();
    changed();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const moves = {
      ArrowLeft: () => (event.shiftKey ? orbit.pan(0.05, 0) : orbit.turn(-0.1, 0)),
      ArrowRight: () => (event.shiftKey ? orbit.pan(-0.05, 0) : orbit.turn(0.1, 0)),
      ArrowUp: () => (event.shiftKey ? orbit.pan(0, 0.05) : orbit.turn(0, 0.1)),
      ArrowDown: () => (event.shiftKey ? orbit.pan(0, -0.05) : orbit.turn(0, -0.1)),
      "+": () => orbit.zoom(0.9), "=": () => orbit.zoom(0.9), "-": () => orbit.zoom(1 / 0.9),
    };
    const acts = {
      Home: () => commands.home(), " ": () => commands.toggleTurn(), v: () => commands.toggleDependent(),
      m: () => commands.nextMode(), c: () => commands.togglePhotos(), Escape: () => commands.leavePhoto(),
      "[": () => commands.stepPhoto(-1), "]": () => commands.stepPhoto(1),
    };
    if (event.altKey || event.metaKey || event.ctrlKey) return;
    const act = acts[event.key] ?? moves[event.key];
    if (!act) return;
    event.preventDefault();
    if (moves[event.key]) commands.moved();
    act();
    changed();
  });
}
