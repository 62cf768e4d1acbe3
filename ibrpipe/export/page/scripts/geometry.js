// Meshes and points, from what ibrpipe/export/page/geometry.py packed.

// A plane whose values are foretold by the ones before them.
function unpackRow(bytes, entry) {
  const none = new Int32Array(entry.length).fill(-1);
  const before = Int32Array.from(none, (_, n) => n - 1);
  return unpackPredicted(bytes, entry, { left: before, above: none, corner: none });
}

// World positions (N * 3), f32.
function unpackPlaces(bytes, { count, low, step, places }) {
  const out = new Float32Array(3 * count);
  places.forEach((entry, axis) => unpackRow(bytes, entry).forEach((code, n) => { out[3 * n + axis] = low[axis] + step * code; }));
  return out;
}

// Bytes (N * 4): sRGB, and a fourth value.
function unpackColors(bytes, count, planes, fourth) {
  const out = new Uint8Array(4 * count).fill(255);
  (planes ?? []).forEach((entry, c) => unpackRow(bytes, entry).forEach((value, n) => { out[4 * n + c] = value; }));
  if (fourth) unpackRow(bytes, fourth).forEach((value, n) => { out[4 * n + 3] = value; });
  return out;
}

function unpackMesh(bytes, meta) {
  const places = unpackPlaces(bytes, meta), faces = new Uint32Array(unpackRow(bytes, meta.faces));
  const colors = unpackColors(bytes, meta.count, meta.color, meta.confidence);
  return { places, faces, colors, normals: vertexNormals(places, faces), painted: meta.color !== null, sure: meta.confidence !== null };
}

function unpackPoints(bytes, meta) {
  return { places: unpackPlaces(bytes, meta), colors: unpackColors(bytes, meta.count, meta.color, null) };
}

// Means of the normals of the triangles around each vertex, weighed by area (N * 3).
function vertexNormals(places, faces) {
  const out = new Float32Array(places.length);
  const at = (v) => [places[3 * v], places[3 * v + 1], places[3 * v + 2]];
  for (let n = 0; n < faces.length; n += 3) {
    const [a, b, c] = [at(faces[n]), at(faces[n + 1]), at(faces[n + 2])];
    const normal = cross(subtract(b, a), subtract(c, a));
    for (let k = 0; k < 3; k++) for (let axis = 0; axis < 3; axis++) out[3 * faces[n + k] + axis] += normal[axis];
  }
  return out;
}
