// From one camera to another, around the scene: both see its centre where they see it, and what lies between is between.

const FLIGHT = 700; // milliseconds

// t: 0 to 1; both cameras have one size
function between(a, b, t, centre) {
  const [Ra, Rb] = [a, b].map(rotationOf), [pa, pb] = [a, b].map((camera) => inCamera(camera, centre));
  const R = matrixOf(slerp(quaternionOf(Ra), quaternionOf(Rb), t));
  const seen = pa.map((value, c) => value + t * (pb[c] - value));
  const [ka, kb] = [a.K.flat(), b.K.flat()], K = ka.map((value, c) => value + t * (kb[c] - value));
  for (const focal of [0, 4]) K[focal] = ka[focal] ** (1 - t) * kb[focal] ** t;
  return {
    K: [K.slice(0, 3), K.slice(3, 6), K.slice(6, 9)],
    cam_from_world: R.map((row, r) => [...row, seen[r] - dot(row, centre)]),
    width: b.width, height: b.height,
  };
}

const rotationOf = ({ cam_from_world }) => cam_from_world.map((row) => row.slice(0, 3));
const inCamera = ({ cam_from_world }, place) => cam_from_world.map((row) => dot(row, place) + row[3]);

// Unit quaternion (w, x, y, z) of a rotation: its largest part is found first.
function quaternionOf([[a, b, c], [d, e, f], [g, h, i]]) {
  const squares = [1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i], largest = squares.indexOf(Math.max(...squares));
  const rows = [
    [squares[0], h - f, c - g, d - b], [h - f, squares[1], d + b, c + g],
    [c - g, d + b, squares[2], h + f], [d - b, c + g, h + f, squares[3]],
  ];
  return unit(rows[largest]);
}

function matrixOf([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}

// Along the shorter arc (shoemake1985).
function slerp(a, b, t) {
  const cosine = a.reduce((sum, value, n) => sum + value * b[n], 0), sign = cosine < 0 ? -1 : 1;
  const angle = Math.acos(Math.min(1, Math.abs(cosine)));
  if (angle < 1e-6) return a;
  return a.map((value, n) => (Math.sin((1 - t) * angle) * value + sign * Math.sin(t * angle) * b[n]) / Math.sin(angle));
}

// A photo's camera in a window, whole and in the middle, and where the picture lies there: left, top, scale.
function fitted(photo, { left, top, width, height }, window_) {
  const scale = Math.min(width / photo.width, height / photo.height), k = photo.K.flat();
  const x = left + (width - scale * photo.width) / 2, y = top + (height - scale * photo.height) / 2;
  const K = [[scale * k[0], scale * k[1], scale * k[2] + x], [0, scale * k[4], scale * k[5] + y], [0, 0, 1]];
  return { camera: { K, cam_from_world: photo.cam_from_world, ...window_ }, place: { left: x, top: y, scale } };
}
