// The tour of the photos: which of them the viewer stands at, the flights between, and which the pointer touches.

class Tour {
  // room: function from a window's size to the part of it in which a photo is shown, and ratio of its pixels to CSS's
  constructor(scene, orbit, room) {
    Object.assign(this, { scene, orbit, room, chosen: -1, flight: null, last: null });
  }

  get photo() {
    return this.scene.photos[this.chosen] ?? null;
  }

  get flying() {
    return this.flight !== null && performance.now() - this.flight.begin < this.flight.lasts;
  }

  // Fly to photo n; -1: back to the orbit, which goes on from where the photo was taken.
  choose(n) {
    if (n === this.chosen) return;
    this.chosen = n;
    const photo = this.photo, still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.flight = this.last && { from: this.last, begin: performance.now(), lasts: still ? 0 : FLIGHT };
    if (!photo) return;
    const eye = cameraCenter(photo), forward = photo.cam_from_world[2].slice(0, 3);
    const along = Math.max(dot(subtract(this.scene.centre, eye), forward), 0.2 * this.scene.radius);
    this.orbit.go(eye, add(eye, forward, along));
  }

  // The camera of a frame, and where the photo lies in it; place null: not there yet.
  frame(width, height) {
    const window_ = { width, height };
    const { camera, place } = this.photo
      ? fitted(this.photo, this.room(width, height), window_)
      : { camera: this.orbit.camera(width, height), place: null };
    if (!this.flying) {
      this.flight = null;
      this.last = camera;
      return { camera, place };
    }
    const t = (performance.now() - this.flight.begin) / this.flight.lasts;
    this.last = between(resized(this.flight.from, width, height), camera, t * t * (3 - 2 * t), this.scene.centre);
    return { camera: this.last, place: null };
  }

  // The nearest photo whose image plane lies under a place of the window of the last frame; -1 = none.
  at(x, y, frusta) {
    let best = -1, nearest = Infinity;
    frusta.forEach(({ corners }, n) => {
      const seen = corners.map((corner) => inCamera(this.last, corner));
      const depth = Math.min(...seen.map((place) => place[2]));
      if (n === this.chosen || depth <= 0 || depth >= nearest) return;
      const k = this.last.K.flat();
      const points = seen.map(([px, py, pz]) => [(k[0] * px + k[1] * py) / pz + k[2], (k[4] * py) / pz + k[5]]);
      const sides = points.map((a, c) => {
        const b = points[(c + 1) % 4];
        return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0;
      });
      if (sides.every((side) => side === sides[0])) [best, nearest] = [n, depth];
    });
    return best;
  }
}

// A camera in a window of another size, its height filled alike.
function resized(camera, width, height) {
  const scale = height / camera.height, k = camera.K.flat();
  const K = [[scale * k[0], scale * k[1], scale * (k[2] - camera.width / 2) + width / 2], [0, scale * k[4], scale * k[5]], [0, 0, 1]];
  return { ...camera, K, width, height };
}
