// Samples and patches of one layered image, from what ibrpipe/export/page/surface.py packed.

const UNKNOWN_NORMAL = 4095;
// bytes of a patch in a vertex buffer: cell 2 x u16, corner depths 4 x f32, samples 4 x i32
const PATCH_BYTES = 36;

function unpackSurface(bytes, meta, firstSample) {
  const counts = unpackArray(bytes, meta.counts);
  const offsets = offsetsOf(counts);
  const around = neighboursOf(offsets, meta.columns);
  const read = (entry) => unpackPredicted(bytes, entry, around);
  const levels = unpackArray(bytes, meta.levels);
  const depth = Float32Array.from(read(meta.depth), (code) => levels[code]);
  const filled = meta.filled ? unpackArray(bytes, meta.filled) : new Uint8Array(depth.length).fill(255);
  const samples = { offsets, around, depth, color: meta.color.map(read), filled, normal: meta.normal.map(read) };
  return { ...meta, ...samples, firstSample, patchData: unpackPatches(bytes, meta, samples, firstSample) };
}

// All patches as the vertex buffer holds them.
function unpackPatches(bytes, meta, { offsets, depth }, firstSample) {
  const cells = unpackArray(bytes, meta.cells);
  const ranks = meta.ranks.map((entry) => unpackArray(bytes, entry));
  const missing = unpackArray(bytes, meta.missing);
  const view = new DataView(new ArrayBuffer(meta.patches * PATCH_BYTES));
  let patch = 0, own = 0;
  for (let cell = 0; cell < cells.length; cell++) {
    const row = Math.floor(cell / (meta.columns + 1)), column = cell % (meta.columns + 1);
    for (let n = 0; n < cells[cell]; n++, patch++) {
      const at = patch * PATCH_BYTES;
      view.setUint16(at, column, true);
      view.setUint16(at + 2, row, true);
      for (let corner = 0; corner < 4; corner++) {
        const rank = ranks[corner][patch];
        const texel = (row - 1 + (corner >> 1)) * meta.columns + column - 1 + (corner & 1);
        const sample = rank > 0 ? offsets[texel] + rank - 1 : -1;
        view.setFloat32(at + 4 + 4 * corner, rank > 0 ? depth[sample] : missing[own++], true);
        view.setInt32(at + 20 + 4 * corner, rank > 0 ? firstSample + sample : -1, true);
      }
    }
  }
  return new Uint8Array(view.buffer);
}

// World positions (S * 3) of all samples, f32.
function samplePlaces(surface) {
  const { rows, columns, offsets, depth, world } = surface;
  const out = new Float32Array(3 * depth.length);
  for (let texel = 0; texel < rows * columns; texel++) {
    const u = (texel % columns) + 1, v = Math.floor(texel / columns) + 1; // cell (0, 0) begins half a texel outside
    for (let s = offsets[texel]; s < offsets[texel + 1]; s++) {
      const [x, y, z, w] = [0, 1, 2, 3].map(
        (r) => world[4 * r] * u + world[4 * r + 1] * v + world[4 * r + 2] * depth[s] + world[4 * r + 3],
      );
      out.set([x / w, y / w, z / w], 3 * s);
    }
  }
  return out;
}
