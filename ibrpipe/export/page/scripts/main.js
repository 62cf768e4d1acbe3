// Builds the page: scene, controls, drawing when something has changed, and window.ibrpipe for programs.

const byId = (id) => document.getElementById(id);
const MODE_NAMES = { color: "Colour", depth: "Depth", normals: "Normals", resolution: "Resolution" };

async function start() {
  const meta = JSON.parse(byId("meta").textContent);
  const canvas = byId("view");
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
  if (!gl || typeof DecompressionStream === "undefined") {
    showFailure("This browser cannot draw the object: it lacks WebGL2 or decompression. The picture shows one view of it.");
    throw new Error("WebGL2 is missing");
  }
  canvas.addEventListener("webglcontextlost", () => showFailure("The graphics driver stopped. Load the page again."));
  const scene = await unpackScene(meta, byId("data").textContent);
  byId("data").remove();
  const renderer = new Renderer(gl, scene);
  buildViewer(canvas, renderer, meta);
  return renderer;
}

function showFailure(text) {
  byId("message").textContent = text;
  document.body.className = "failed";
}

function buildViewer(canvas, renderer, meta) {
  const state = { mode: "color", dependent: true, turning: false, wanted: true, moved: 0, coarse: 1 };
  const orbit = new Orbit(renderer.scene, meta.start);
  const changed = () => { state.wanted = true; state.moved = performance.now(); };
  const go = ({ eye, target }) => { setTurning(false); orbit.go(eye, target); changed(); };
  const follow = placeNotes(byId("marks"), meta.notes, orbit, go);
  const setTurning = (on) => { state.turning = on; byId("turn").setAttribute("aria-pressed", on); changed(); };
  const setDependent = (on) => { state.dependent = on; byId("dependent").setAttribute("aria-pressed", on); changed(); };
  const setMode = (mode) => { state.mode = mode; byId("mode").value = mode; changed(); };
  const commands = {
    touched: () => setTurning(false),
    toggleTurn: () => setTurning(!state.turning),
    toggleDependent: () => setDependent(!state.dependent),
    nextMode: () => setMode(MODES[(MODES.indexOf(state.mode) + 1) % MODES.length]),
  };
  listen(canvas, orbit, changed, commands);
  fillSelect(byId("mode"), Object.entries(MODE_NAMES), setMode);
  fillSelect(byId("views"), [["", "Views"], ...meta.views.map((view, n) => [n, view.name])], (n) => {
    if (n !== "") go(meta.views[n]);
    byId("views").value = "";
  });
  byId("views").hidden = meta.views.length === 0;
  byId("dependent").hidden = renderer.scene.kinds.length === 0;
  byId("dependent").addEventListener("click", commands.toggleDependent);
  byId("turn").addEventListener("click", commands.toggleTurn);
  byId("home").addEventListener("click", () => { orbit.reset(); changed(); });
  byId("help").addEventListener("click", () => {
    byId("keys").hidden = !byId("keys").hidden;
    byId("note").hidden = true;
  });
  byId("full").addEventListener("click", () =>
    document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen());
  byId("full").hidden = !document.fullscreenEnabled;
  new ResizeObserver(changed).observe(canvas);
  document.body.className = "ready";
  let last = performance.now(), settled = false;
  const frame = (now) => {
    if (state.turning) { orbit.turn(0.0004 * Math.min(now - last, 100), 0); changed(); }
    const moving = now - state.moved < 200;
    // while it moves, a slow machine draws fewer pixels; at rest all of them
    if (state.wanted && moving && now - last > 90) state.coarse = Math.min(4, state.coarse * 1.3);
    if (state.wanted && moving && now - last < 25) state.coarse = Math.max(1, state.coarse / 1.1);
    last = now;
    if (state.wanted || (!moving && !settled)) {
      drawPage(canvas, renderer, orbit, state, moving, follow, meta);
      settled = !moving;
      state.wanted = false;
    }
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

function drawPage(canvas, renderer, orbit, state, moving, follow, meta) {
  // at rest four rays a pixel, which the browser averages: edges are smooth
  const ratio = Math.min(window.devicePixelRatio || 1, 2) * (moving ? 1 / state.coarse : 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const camera = orbit.camera(width, height);
  const hidden = !moving && meta.notes.length ? hiddenNotes(renderer, meta.notes, camera) : null;
  renderer.draw(camera, state);
  follow(camera, ratio, hidden);
  if (meta.units) {
    const { width: long, text } = scaleBar(camera.K[0][0] / orbit.distance / ratio, meta.units);
    byId("scale").style.width = `${long}px`;
    byId("scale").textContent = text;
    byId("scale").hidden = false;
  }
}

function fillSelect(select, entries, chosen) {
  for (const [value, text] of entries) select.append(new Option(text, value));
  select.addEventListener("change", () => chosen(select.value));
}

const ready = start();
ready.catch((error) => {
  if (document.body.className !== "failed") showFailure(`The object cannot be shown: ${error.message}`);
});
window.ibrpipe = {
  ready: ready.then(() => undefined),
  render: async (camera, options) => (await ready).render(camera, options),
};
