// Pointers, wheel and keys on the canvas, as motions of the orbit.

function listen(canvas, orbit, changed, commands) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, length: Math.hypot(a.x - b.x, a.y - b.y) || 1 };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    commands.touched();
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last || pointers.size > 2) return;
    const before = pointers.size === 2 ? spread() : last;
    const high = canvas.clientHeight, moved = event.buttons & 2 || event.shiftKey || event.ctrlKey;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const now = pointers.size === 2 ? spread() : pointers.get(event.pointerId);
    const dx = (now.x - before.x) / high, dy = (now.y - before.y) / high;
    if (pointers.size === 2) {
      orbit.zoom(before.length / now.length);
      orbit.pan(dx, dy);
    } else if (moved) orbit.pan(dx, dy);
    else orbit.turn(-4 * dx, 4 * dy);
    changed();
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    orbit.zoom(Math.exp(Math.max(-0.5, Math.min(0.5, 0.0015 * lines * event.deltaY))));
    commands.touched();
    changed();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const steps = {
      ArrowLeft: () => (event.shiftKey ? orbit.pan(0.05, 0) : orbit.turn(-0.1, 0)),
      ArrowRight: () => (event.shiftKey ? orbit.pan(-0.05, 0) : orbit.turn(0.1, 0)),
      ArrowUp: () => (event.shiftKey ? orbit.pan(0, 0.05) : orbit.turn(0, 0.1)),
      ArrowDown: () => (event.shiftKey ? orbit.pan(0, -0.05) : orbit.turn(0, -0.1)),
      "+": () => orbit.zoom(0.9), "=": () => orbit.zoom(0.9), "-": () => orbit.zoom(1 / 0.9),
      Home: () => orbit.reset(), " ": () => commands.toggleTurn(), v: () => commands.toggleDependent(),
      m: () => commands.nextMode(),
    };
    const step = event.altKey || event.metaKey || event.ctrlKey ? null : steps[event.key];
    if (!step) return;
    event.preventDefault();
    step();
    changed();
  });
}
