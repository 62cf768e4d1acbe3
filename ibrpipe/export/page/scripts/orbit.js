// A camera that circles a point: what fingers, mouse and keys move.

const FIELD_OF_VIEW = (35 * Math.PI) / 180;
const STEEPEST = 1.54;

class Orbit {
  // around: radius of what the first view holds
  constructor(scene, { up, from }, around) {
    this.radius = scene.radius;
    this.up = unit(up);
    const aside = Math.abs(this.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
    this.east = unit(cross(aside, this.up));
    this.north = cross(this.up, this.east);
    this.home = { target: scene.centre, ...this.anglesOf(from), distance: (1.08 * around) / Math.sin(FIELD_OF_VIEW / 2) };
    this.reset();
  }

  reset() {
    Object.assign(this, this.home);
  }

  anglesOf(direction) {
    const d = unit(direction);
    return {
      yaw: Math.atan2(dot(d, this.north), dot(d, this.east)),
      pitch: Math.max(-STEEPEST, Math.min(STEEPEST, Math.asin(Math.max(-1, Math.min(1, dot(d, this.up)))))),
    };
  }

  // Go where a saved view is: eye and target in the world.
  go(eye, target) {
    const away = subtract(eye, target);
    Object.assign(this, { target, ...this.anglesOf(away), distance: Math.hypot(...away) });
  }

  get toEye() {
    const flat = add(this.east.map((v) => v * Math.cos(this.yaw)), this.north, Math.sin(this.yaw));
    return add(flat.map((v) => v * Math.cos(this.pitch)), this.up, Math.sin(this.pitch));
  }

  camera(width, height) {
    // the whole object stays in view where the window is narrower than high
    const narrow = Math.min(1, width / height);
    const fovY = 2 * Math.atan(Math.tan(FIELD_OF_VIEW / 2) / narrow);
    return lookAt(add(this.target, this.toEye, this.distance), this.target, this.up, fovY, width, height);
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-STEEPEST, Math.min(STEEPEST, this.pitch + pitch));
  }

  // Move the target by parts of the window's height.
  pan(x, y) {
    const step = 2 * this.distance * Math.tan(FIELD_OF_VIEW / 2);
    const right = unit(cross(this.up, this.toEye)), high = cross(this.toEye, right);
    this.target = add(add(this.target, right, -x * step), high, y * step);
  }

  zoom(factor) {
    this.distance = Math.max(0.05 * this.radius, Math.min(40 * this.radius, this.distance * factor));
  }
}
