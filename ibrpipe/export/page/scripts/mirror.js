// What the object mirrors of itself: the reflected ray walks a grid of voxels and meets the patches listed in each,
// exactly as renderers/view_dependence/mirror.py does. Voxels with none say how far the next with some may be.

const VOXELS = 96; // along the longest edge
const WIDE = 2048; // of textures that hold lists

const MIRROR_SHADER = `
uniform highp usampler3D voxels; // first entry of its list and entries; or steps to the next list and 0
uniform highp usampler2D lists; // numbers of patches
uniform highp isampler2D patchSamples;
uniform sampler2D patchHeights, patchCells, surfaceRows; // cell and surface of a patch; rows of field from world
uniform vec4 grid; // least corner, width of a voxel
uniform float texel;
vec3 seenAt(int number, vec2 place, vec3 toward);

ivec2 listed(int n) { return ivec2(n & 2047, n >> 11); }

// Way along the ray to the front of a patch, and the place in its cell; far = nowhere.
vec3 meetOther(int number, vec3 start, vec3 r, float near) {
  const vec3 nowhere = vec3(1e30, 0.0, 0.0);
  vec4 h = texelFetch(patchHeights, listed(number), 0);
  vec3 cell = texelFetch(patchCells, listed(number), 0).xyz;
  mat4 rows = mat4(texelFetch(surfaceRows, ivec2(0, cell.z), 0), texelFetch(surfaceRows, ivec2(1, cell.z), 0),
    texelFetch(surfaceRows, ivec2(2, cell.z), 0), texelFetch(surfaceRows, ivec2(3, cell.z), 0));
  vec4 through = vec4(r, 0.0) * rows, from = vec4(start + near * r, 1.0) * rows;
  if (from.w <= 0.0) return nowhere;
  vec3 at = from.xyz / from.w, ray = (through.xyz - through.w * at) / from.w;
  at.xy -= cell.xy;
  float a = h.y - h.x, b = h.z - h.x, twist = h.w - h.y - b;
  float off = at.z - h.x - a * at.x - b * at.y - twist * at.x * at.y;
  float slope = ray.z - a * ray.x - b * ray.y - twist * (at.x * ray.y + at.y * ray.x), bend = -twist * ray.x * ray.y;
  float square = slope * slope - 4.0 * bend * off;
  if (square < 0.0) return nowhere;
  float root = sqrt(square), s = slope > 0.0 ? -2.0 * off / (slope + root) : (root - slope) / (2.0 * bend);
  vec2 p = at.xy + s * ray.xy;
  if (any(lessThan(p, vec2(-EDGE))) || any(greaterThan(p, vec2(1.0 + EDGE)))) return nowhere;
  if (texelFetch(patchSamples, listed(number), 0)[(p.x > 0.5 ? 1 : 0) + (p.y > 0.5 ? 2 : 0)] < 0) return nowhere;
  float t = near + s * from.w / (from.w - s * through.w);
  return t > 0.0 ? vec3(t, p) : nowhere;
}

vec4 mirrored(vec3 position, vec3 n, vec3 r) {
  vec3 start = position + texel * (0.3 * n + 2.0 * r), at = (start - grid.xyz) / grid.w;
  ivec3 size = textureSize(voxels, 0);
  vec3 best = vec3(1e30, 0.0, 0.0), along = mix(r, vec3(1e-9), lessThan(abs(r), vec3(1e-9)));
  int patch_ = -1;
  float t = 0.0;
  for (int step_ = 0; step_ < 400; step_++) {
    ivec3 cell = ivec3(floor(at + t * r));
    if (any(lessThan(cell, ivec3(0))) || any(greaterThanEqual(cell, size))) break;
    vec3 ends = (vec3(cell) + step(0.0, along) - at) / along;
    float leave = max(min(ends.x, min(ends.y, ends.z)), t) + 1e-3;
    uvec2 list = texelFetch(voxels, cell, 0).xy;
    for (uint k = 0u; k < list.y; k++) {
      int number = int(texelFetch(lists, listed(int(list.x + k)), 0).x);
      vec3 met = meetOther(number, start, r, t * grid.w);
      if (met.x < best.x) { best = met; patch_ = number; }
    }
    if (best.x <= leave * grid.w) break;
    t = list.y > 0u ? leave : max(leave, t + (float(list.x) - 1.0) / 1.7321);
  }
  return patch_ < 0 ? vec4(0.0) : vec4(seenAt(patch_, best.yz, position - start - best.x * r), 1.0);
}
`;

// Light of a place of a patch, toward an eye: it mirrors the tables, but nothing further.
const SEEN_SHADER = `
vec3 seenAt(int number, vec2 place, vec3 toward) {
  ivec4 of = texelFetch(patchSamples, ivec2(number & 2047, number >> 11), 0);
  vec2 p = clamp(place, 0.0, 1.0);
  vec4 weight = vec4((1.0 - p.x) * (1.0 - p.y), p.x * (1.0 - p.y), (1.0 - p.x) * p.y, p.x * p.y);
  vec3 light = vec3(0.0), normal = vec3(0.0), mixed = vec3(0.0);
  for (int c = 0; c < 4; c++) {
    if (of[c] < 0 || weight[c] <= 0.0) continue;
    vec4 color = sampleData(colors, of[c]), trait = sampleData(traits, of[c]);
    normal += weight[c] * octahedral(trait.xy);
    if (color.a <= 0.0) continue;
    light += weight[c] * decode(color.rgb);
    mixed += weight[c] * vec3(1.0, trait.zw);
  }
  if (mixed.x <= 0.0) return vec3(0.0);
  return min(glossy(light / mixed.x, normalize(normal), normalize(toward), mixed.yz / mixed.x, vec4(0.0)), 1.5);
}
`;

// Grid, lists and patches as textures take them.
function buildMirror(surfaces, { low, high }, texel) {
  const width = Math.max(...low.map((value, c) => high[c] - value), texel) / (VOXELS - 4);
  const size = low.map((value, c) => Math.ceil((high[c] - value) / width) + 4);
  const corner = low.map((value) => value - 2 * width);
  const total = surfaces.reduce((sum, surface) => sum + surface.patches, 0), rows = Math.max(1, Math.ceil(total / WIDE));
  const heights = new Float32Array(4 * WIDE * rows), cells = new Float32Array(4 * WIDE * rows);
  const samples = new Int32Array(4 * WIDE * rows), reach = new Uint8Array(6 * total);
  let number = 0;
  surfaces.forEach((surface, which) => {
    const view = new DataView(surface.patchData.buffer);
    for (let n = 0; n < surface.patches; n++, number++) {
      const at = n * PATCH_BYTES, u = view.getUint16(at, true), v = view.getUint16(at + 2, true);
      const first = [255, 255, 255], last = [0, 0, 0];
      cells.set([u, v, which], 4 * number);
      for (let c = 0; c < 4; c++) {
        heights[4 * number + c] = view.getFloat32(at + 4 + 4 * c, true);
        samples[4 * number + c] = view.getInt32(at + 20 + 4 * c, true);
        const [x, y, z, w] = transform(surface.world, [u + (c & 1), v + (c >> 1), heights[4 * number + c], 1]);
        [x, y, z].forEach((value, axis) => {
          // a little more on every side: roundings
          const place = (value / w - corner[axis]) / width, slack = (0.1 * texel) / width;
          first[axis] = Math.min(first[axis], Math.max(0, Math.floor(place - slack)));
          last[axis] = Math.max(last[axis], Math.min(size[axis] - 1, Math.floor(place + slack)));
        });
      }
      reach.set([...first, ...last], 6 * number);
    }
  });
  const { voxels, lists } = listPatches(reach, size);
  const matrices = Float32Array.from(surfaces.flatMap((surface) => invert(surface.world)));
  return { size, grid: [...corner, width], texel, voxels, lists, heights, cells, samples, rows, matrices };
}

// Lists of the patches that reach into every voxel; reach: least and greatest voxel along three axes, per patch.
function listPatches(reach, [nx, ny, nz]) {
  const counts = new Uint32Array(nx * ny * nz + 1);
  const visit = (n, act) => {
    for (let z = reach[n + 2]; z <= reach[n + 5]; z++)
      for (let y = reach[n + 1]; y <= reach[n + 4]; y++)
        for (let x = reach[n]; x <= reach[n + 3]; x++) act((z * ny + y) * nx + x);
  };
  for (let n = 0; n < reach.length; n += 6) visit(n, (voxel) => { counts[voxel]++; });
  const voxels = new Uint32Array(2 * nx * ny * nz), ends = new Uint32Array(nx * ny * nz);
  let total = 0;
  for (let voxel = 0; voxel < ends.length; voxel++) {
    voxels.set([counts[voxel] ? total : 255, counts[voxel]], 2 * voxel);
    ends[voxel] = total;
    total += counts[voxel];
  }
  const lists = new Uint32Array(WIDE * Math.max(1, Math.ceil(total / WIDE)));
  for (let n = 0; n < reach.length; n += 6) visit(n, (voxel) => { lists[ends[voxel]++] = n / 6; });
  measureDistances(voxels, [nx, ny, nz]);
  return { voxels, lists };
}

// First number of every voxel without a list: how many steps along the axes away the nearest with one is.
function measureDistances(voxels, [nx, ny, nz]) {
  const strides = [1, nx, nx * ny], sizes = [nx, ny, nz], steps = (n) => (voxels[2 * n + 1] ? 0 : voxels[2 * n]);
  for (let axis = 0; axis < 3; axis++)
    for (const sign of [1, -1])
      for (let m = 0; m < nx * ny * nz; m++) {
        const n = sign > 0 ? m : nx * ny * nz - 1 - m, at = Math.floor(n / strides[axis]) % sizes[axis];
        if (at === (sign > 0 ? 0 : sizes[axis] - 1) || voxels[2 * n + 1]) continue;
        voxels[2 * n] = Math.min(voxels[2 * n], steps(n - sign * strides[axis]) + 1);
      }
}
