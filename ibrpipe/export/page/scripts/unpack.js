// Arrays as ibrpipe/export/page/packing.py packs them: byte planes, deflated; some foretold from their neighbours.

const ARRAY_TYPES = { u1: Uint8Array, u2: Uint16Array, i4: Int32Array, f4: Float32Array };

async function inflate(text) {
  const packed = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// -> typed array of an entry; bytes of one weight lie together
function unpackArray(bytes, entry) {
  const values = new ARRAY_TYPES[entry.type](entry.length);
  const size = values.BYTES_PER_ELEMENT;
  const out = new Uint8Array(values.buffer);
  for (let weight = 0; weight < size; weight++) {
    const begin = entry.offset + weight * entry.length;
    for (let n = 0; n < entry.length; n++) out[n * size + weight] = bytes[begin + n];
  }
  return values;
}

// Texels' first samples (H * W + 1) from their counts.
function offsetsOf(counts) {
  const offsets = new Int32Array(counts.length + 1);
  for (let n = 0; n < counts.length; n++) offsets[n + 1] = offsets[n] + counts[n];
  return offsets;
}

// Samples to the left of, above, and above left of every sample; -1 = none.
function neighboursOf(offsets, columns) {
  const total = offsets[offsets.length - 1];
  const [left, above, corner] = [0, 1, 2].map(() => new Int32Array(total).fill(-1));
  const at = (texel, rank) => {
    const count = offsets[texel + 1] - offsets[texel];
    return count > 0 ? offsets[texel] + Math.min(rank, count - 1) : -1;
  };
  for (let texel = 0; texel + 1 < offsets.length; texel++) {
    const inColumn = texel % columns > 0, inRow = texel >= columns;
    for (let s = offsets[texel]; s < offsets[texel + 1]; s++) {
      const rank = s - offsets[texel];
      if (inColumn) left[s] = at(texel - 1, rank);
      if (inRow) above[s] = at(texel - columns, rank);
      if (inColumn && inRow) corner[s] = at(texel - columns - 1, rank);
    }
  }
  return { left, above, corner };
}

// Undo the prediction by the median of left, above and their parallelogram.
function unpackPredicted(bytes, entry, { left, above, corner }) {
  const values = unpackArray(bytes, entry);
  for (let s = 0; s < values.length; s++) {
    const a = left[s], b = above[s];
    let guess;
    if (a >= 0 && b >= 0) {
      const low = Math.min(values[a], values[b]), high = Math.max(values[a], values[b]);
      const c = corner[s] >= 0 ? values[corner[s]] : values[a];
      guess = c >= high ? low : c <= low ? high : low + high - c;
    } else guess = a >= 0 ? values[a] : b >= 0 ? values[b] : s > 0 ? values[s - 1] : 0;
    const folded = values[s];
    values[s] = guess + (folded & 1 ? -(folded + 1) / 2 : folded / 2); // wraps to the type's size
  }
  return values;
}
