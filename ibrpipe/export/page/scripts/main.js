// Builds the page: scene, controls, drawing when something has changed, and window.ibrpipe for programs.

const byId = (id) => document.getElementById(id);
const MODE_NAMES = {
  color: "Colour", depth: "Depth", normals: "Normals", resolution: "Resolution", confidence: "Confidence",
};

async function start() {
  const meta = JSON.parse(byId("meta").textContent);
  const canvas = byId("view");
  // no antialiasing by the browser: a patch decides by one ray whether a pixel is its own, and would share the rest with
  // the background; at rest there are four rays a pixel
  const gl = canvas.getContext("webgl2", { antialias: false, alpha: true, premultipliedAlpha: true });
  if (!gl || typeof DecompressionStream === "undefined") {
    showFailure("This browser cannot draw the object: it lacks WebGL2 or decompression. The picture shows one view of it.");
    throw new Error("WebGL2 is missing");
  }
  canvas.addEventListener("webglcontextlost", () => showFailure("The graphics driver stopped. Load the page again."));
  const scene = await unpackScene(meta, byId("data").textContent);
  byId("data").remove();
  const renderer = new Renderer(gl, scene);
  new Viewer(canvas, renderer, meta).run();
  return renderer;
}

function showFailure(text) {
  byId("message").textContent = text;
  document.body.className = "failed";
}

class Viewer {
  constructor(canvas, renderer, meta) {
    const { scene } = renderer, capture = !scene.surfaces.length;
    Object.assign(this, { canvas, renderer, meta, scene });
    this.state = { mode: "color", dependent: true, turning: false, wanted: true, moved: 0, coarse: 1 };
    this.show = { mesh: true, points: true, photos: capture };
    this.orbit = new Orbit(scene, meta.start, capture ? scene.reach : scene.radius);
    this.tour = new Tour(scene, this.orbit, (width, height) => this.roomOf(width, height));
    renderer.stage = new Stage(renderer.gl, scene, meta.start.up, () => this.changed());
    const render = (camera) => renderer.render(camera, { dependent: this.state.dependent });
    this.comparison = new Comparison(byId, this.tour, { render, changed: () => this.changed() });
    this.follow = placeNotes(byId("marks"), meta.notes, this.orbit, (view) => this.go(view));
    this.listen();
    if (meta.start.turning && !matchMedia("(prefers-reduced-motion: reduce)").matches) this.setTurning(true);
    if (scene.photos.length) renderer.stage.loadThumbnails(renderer.units.size);
  }

  changed() {
    this.state.wanted = true;
    this.state.moved = performance.now();
  }

  go({ eye, target }) {
    this.setTurning(false);
    this.choosePhoto(-1);
    this.orbit.go(eye, target);
    this.changed();
  }

  setTurning(on) {
    this.state.turning = on;
    byId("turn").setAttribute("aria-pressed", on);
    this.changed();
  }

  setDependent(on) {
    this.state.dependent = on;
    byId("dependent").setAttribute("aria-pressed", on);
    if (this.tour.photo) this.comparison.show(this.comparison.shown);
    this.changed();
  }

  setMode(mode) {
    this.state.mode = mode;
    byId("mode").value = mode;
    this.changed();
  }

  toggleLayer(name) {
    this.show[name] = !this.show[name];
    byId(`show-${name}`).setAttribute("aria-pressed", this.show[name]);
    this.changed();
  }

  choosePhoto(n) {
    if (n === this.tour.chosen) return;
    this.setTurning(false);
    this.tour.choose(n);
    this.renderer.stage.choose(n);
    byId("compare-photos").setAttribute("aria-pressed", n >= 0);
    this.comparison.open();
    this.changed();
  }

  stepPhoto(step) {
    const count = this.scene.photos.length, { chosen } = this.tour;
    if (count) this.choosePhoto(chosen < 0 ? (step > 0 ? 0 : count - 1) : (chosen + step + count) % count);
  }

  // The part of the window that the bars at top and bottom leave to a photo.
  roomOf(width, height) {
    const ratio = height / this.canvas.clientHeight, below = byId("bars").offsetHeight * ratio;
    return { left: 0, top: 0, width, height: Math.max(height - below, 0.3 * height) };
  }

  photoAt(x, y) {
    const { stage } = this.renderer, ratio = this.canvas.width / this.canvas.clientWidth;
    return this.show.photos && stage.frusta && this.tour.last ? this.tour.at(x * ratio, y * ratio, stage.frusta) : -1;
  }

  // The name of the photo under the pointer beside it.
  point(x, y) {
    const found = x < 0 ? -1 : this.photoAt(x, y), label = byId("label");
    label.hidden = found < 0;
    this.canvas.classList.toggle("touching", found >= 0);
    if (found < 0) return;
    label.textContent = this.scene.photos[found].name;
    label.style.left = `${Math.min(x + 14, this.canvas.clientWidth - label.offsetWidth - 8)}px`;
    label.style.top = `${Math.max(y - 34, 4)}px`;
  }

  get commands() {
    return {
      touched: () => this.setTurning(false),
      moved: () => this.choosePhoto(-1),
      clicked: (x, y) => { const n = this.photoAt(x, y); if (n >= 0) this.choosePhoto(n); this.point(-1, -1); },
      hovered: (x, y) => this.point(x, y),
      home: () => { this.choosePhoto(-1); this.orbit.reset(); this.changed(); },
      toggleTurn: () => { this.choosePhoto(-1); this.setTurning(!this.state.turning); },
      toggleDependent: () => this.setDependent(!this.state.dependent),
      togglePhotos: () => { if (this.scene.photos.length) this.toggleLayer("photos"); },
      leavePhoto: () => this.choosePhoto(-1),
      stepPhoto: (step) => this.stepPhoto(step),
      nextMode: () => {
        const { modes } = this.scene;
        this.setMode(modes[(modes.indexOf(this.state.mode) + 1) % modes.length]);
      },
    };
  }

  listen() {
    const { scene, meta, commands } = this, onClick = (id, act) => byId(id).addEventListener("click", act);
    listen(this.canvas, this.orbit, () => this.changed(), commands);
    fillSelect(byId("mode"), scene.modes.map((mode) => [mode, MODE_NAMES[mode]]), (mode) => this.setMode(mode));
    byId("mode").hidden = scene.modes.length < 2;
    fillSelect(byId("views"), [["", "Views"], ...meta.views.map((view, n) => [n, view.name])], (n) => {
      if (n !== "") this.go(meta.views[n]);
      byId("views").value = "";
    });
    byId("views").hidden = meta.views.length === 0;
    byId("dependent").hidden = scene.kinds.length === 0;
    for (const [name, there] of [["mesh", scene.mesh && scene.points], ["points", scene.points], ["photos", scene.photos.length]]) {
      byId(`show-${name}`).hidden = !there;
      byId(`show-${name}`).setAttribute("aria-pressed", this.show[name]);
      onClick(`show-${name}`, () => this.toggleLayer(name));
    }
    byId("compare-photos").hidden = !scene.photos.length;
    onClick("compare-photos", () => this.choosePhoto(this.tour.photo ? -1 : 0));
    onClick("previous", () => this.stepPhoto(-1));
    onClick("next", () => this.stepPhoto(1));
    onClick("leave", () => this.choosePhoto(-1));
    onClick("dependent", commands.toggleDependent);
    onClick("turn", commands.toggleTurn);
    onClick("home", commands.home);
    onClick("help", () => { byId("keys").hidden = !byId("keys").hidden; byId("note").hidden = true; });
    onClick("full", () =>
      document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen());
    byId("full").hidden = !document.fullscreenEnabled;
    new ResizeObserver(() => this.changed()).observe(this.canvas);
  }

  run() {
    const { state } = this;
    document.body.className = "ready";
    let last = performance.now(), settled = false, slow = 0;
    const frame = (now) => {
      // without a graphics card it would turn in jerks, and leave the machine no time for anything else
      slow = state.turning && now - last > 700 ? slow + 1 : 0;
      if (slow > 3) this.setTurning(false);
      if (state.turning) { this.orbit.turn(0.0004 * Math.min(now - last, 100), 0); this.changed(); }
      if (this.tour.flight) this.changed();
      const moving = now - state.moved < 200;
      // while it moves, a slow machine draws fewer pixels; at rest all of them
      if (state.wanted && moving && now - last > 90) state.coarse = Math.min(4, state.coarse * 1.3);
      if (state.wanted && moving && now - last < 25) state.coarse = Math.max(1, state.coarse / 1.1);
      last = now;
      if (state.wanted || (!moving && !settled)) {
        state.wanted = false;
        this.draw(moving);
        settled = !moving;
      }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  draw(moving) {
    const { canvas, renderer, meta, state } = this;
    // at rest four rays a pixel, which the browser averages: edges are smooth
    const ratio = Math.min(window.devicePixelRatio || 1, 2) * (moving ? 1 / state.coarse : 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const { camera, place } = this.tour.frame(width, height);
    const hidden = !moving && meta.notes.length ? hiddenNotes(renderer, meta.notes, camera) : null;
    // who stands where a photo was taken sees no frusta, which would lie across it
    const show = { ...this.show, photos: this.show.photos && !place };
    renderer.draw(camera, { ...state, show, ratio });
    this.follow(camera, ratio, hidden);
    this.comparison.place(place, ratio);
    this.drawScale(camera, ratio);
  }

  drawScale(camera, ratio) {
    const { units } = this.meta, shown = units && !this.tour.photo;
    byId("scale").hidden = !shown;
    if (!shown) return;
    const { width, text } = scaleBar(camera.K[0][0] / this.orbit.distance / ratio, units);
    byId("scale").style.width = `${width}px`;
    byId("scale").textContent = text;
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
