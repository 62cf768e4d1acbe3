// Small matrices in double precision, row by row; cameras follow OpenCV: x right, y down, z forward.

function multiply(a, b) {
  const out = new Array(16);
  for (let r = 0; r < 4; r++)
    for (let c = 0; c < 4; c++)
      out[4 * r + c] = a[4 * r] * b[c] + a[4 * r + 1] * b[4 + c] + a[4 * r + 2] * b[8 + c] + a[4 * r + 3] * b[12 + c];
  return out;
}

function determinant(m) {
  const pair = (r, c, d) => m[4 * r + c] * m[4 * (r + 1) + d] - m[4 * r + d] * m[4 * (r + 1) + c];
  return (
    pair(0, 0, 1) * pair(2, 2, 3) - pair(0, 0, 2) * pair(2, 1, 3) + pair(0, 0, 3) * pair(2, 1, 2) +
    pair(0, 1, 2) * pair(2, 0, 3) - pair(0, 1, 3) * pair(2, 0, 2) + pair(0, 2, 3) * pair(2, 0, 1)
  );
}

// Inverse by the adjugate.
function invert(m) {
  const d = determinant(m), minor = (r, c) => {
    const v = m.filter((_, n) => Math.floor(n / 4) !== r && n % 4 !== c);
    return v[0] * (v[4] * v[8] - v[5] * v[7]) - v[1] * (v[3] * v[8] - v[5] * v[6]) + v[2] * (v[3] * v[7] - v[4] * v[6]);
  };
  return m.map((_, n) => (minor(n % 4, Math.floor(n / 4)) * ((n % 4 + Math.floor(n / 4)) % 2 ? -1 : 1)) / d);
}

const transform = (m, v) => [0, 1, 2, 3].map((r) => v.reduce((sum, value, c) => sum + m[4 * r + c] * value, 0));
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const add = (a, b, scale = 1) => [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / Math.hypot(...a));

// A camera {K, cam_from_world, width, height}: 3 x 3 and 3 x 4, as nested or flat lists.
function lookAt(eye, target, up, fovY, width, height) {
  const forward = unit(subtract(target, eye));
  const right = unit(cross(forward, up));
  const rotation = [right, cross(forward, right), forward];
  const focal = height / (2 * Math.tan(fovY / 2));
  return {
    K: [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]],
    cam_from_world: rotation.map((row) => [...row, -dot(row, eye)]),
    width,
    height,
  };
}

function cameraCenter({ cam_from_world }) {
  const m = cam_from_world.flat();
  return [0, 1, 2].map((c) => -(m[c] * m[3] + m[4 + c] * m[7] + m[8 + c] * m[11]));
}

// Clip coordinates from the world, between camera depths near and far; turned: row 0 of the picture is y = -1.
function clipFromWorld({ K, cam_from_world, width, height }, near, far, turned) {
  const k = K.flat(), y = turned ? -1 : 1;
  const fromCamera = [
    (2 * k[0]) / width, (2 * k[1]) / width, (2 * k[2]) / width - 1, 0,
    0, (-2 * y * k[4]) / height, y * (1 - (2 * k[5]) / height), 0,
    0, 0, (far + near) / (far - near), (-2 * far * near) / (far - near),
    0, 0, 1, 0,
  ];
  return multiply(fromCamera, [...cam_from_world.flat(), 0, 0, 0, 1]);
}

// World direction of the pixel (x, y, 1, 0) of the framebuffer, one unit of camera depth long, 4 x 4.
function worldFromPixel({ K, cam_from_world, height }, turned) {
  const k = K.flat(), m = cam_from_world.flat(), y = turned ? 1 : -1, first = turned ? 0 : height;
  const inverse = invert([k[0], k[1], k[2], 0, 0, k[4], k[5], 0, 0, 0, 1, 0, 0, 0, 0, 1]);
  const flip = [1, 0, 0, 0, 0, y, first, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  const turn = [m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0, 0, 0, 0, 1];
  return multiply(turn, multiply(inverse, flip));
}
