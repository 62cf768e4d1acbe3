// What the object mirrors of itself, approximated: a grid of voxels with mean colour, normal and weights of the samples
// in it, through which the reflected ray walks. docs/viewer.md says how far that is from the renderer's exact second ray.

const VOXELS = 96; // along the longest edge

const VOXEL_SHADER = `
uniform sampler3D voxelColors; // sRGB; voxels to the nearest occupied one
uniform sampler3D voxelTraits; // octahedral normal, weights over voxelTops
uniform vec4 voxelFrame; // least corner, width
uniform vec2 voxelTops;
vec3 glossy(vec3 diffuse, vec3 n, vec3 v, vec2 weights, vec4 own);

vec4 mirrored(vec3 position, vec3 n, vec3 r) {
  ivec3 size = textureSize(voxelColors, 0);
  if (size.x < 2) return vec4(0.0);
  vec3 at = (position + 1.2 * voxelFrame.w * (n + r) - voxelFrame.xyz) / voxelFrame.w;
  float t = 0.0;
  for (int n_ = 0; n_ < 160; n_++) {
    vec3 here = at + t * r;
    ivec3 cell = ivec3(floor(here));
    if (any(lessThan(cell, ivec3(0))) || any(greaterThanEqual(cell, size))) return vec4(0.0);
    vec4 color = texelFetch(voxelColors, cell, 0);
    float far = 255.0 * color.a;
    if (far < 0.5) {
      vec4 trait = texelFetch(voxelTraits, cell, 0);
      vec3 normal = octahedral(trait.xy * 2.0 - 1.0);
      if (dot(normal, r) < -0.05) {
        return vec4(min(glossy(decode(color.rgb), normal, -r, trait.zw * voxelTops, vec4(0.0)), 1.5), 1.0);
      }
    }
    t += max((far - 1.0) / 1.7321, 0.6); // steps are counted along the axes
  }
  return vec4(0.0);
}
`;

function buildVoxels(surfaces, places, weightsOf, tops) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const part of places)
    for (let n = 0; n < part.length; n++) {
      low[n % 3] = Math.min(low[n % 3], part[n]);
      high[n % 3] = Math.max(high[n % 3], part[n]);
    }
  const width = Math.max(...low.map((value, c) => high[c] - value)) / (VOXELS - 3) || 1;
  const size = low.map((value, c) => Math.ceil((high[c] - value) / width) + 3);
  const corner = low.map((value) => value - 1.5 * width);
  const sums = new Float32Array(9 * size[0] * size[1] * size[2]); // colour, normal, weights, count
  surfaces.forEach((surface, number) => {
    for (let s = 0; s < surface.depth.length; s++) {
      const normal = surface.filled[s] > 0 ? sampleNormal(surface, s) : null;
      if (!normal) continue;
      const [x, y, z] = [0, 1, 2].map((c) => Math.floor((places[number][3 * s + c] - corner[c]) / width));
      const at = 9 * ((z * size[1] + y) * size[0] + x);
      const weights = weightsOf(number, s);
      for (let c = 0; c < 3; c++) {
        sums[at + c] += surface.color[c][s];
        sums[at + 3 + c] += normal[c];
      }
      sums[at + 6] += weights[0];
      sums[at + 7] += weights[1];
      sums[at + 8] += 1;
    }
  });
  return { size, frame: [...corner, width], tops, ...voxelTexels(sums, size, tops) };
}

function voxelTexels(sums, size, tops) {
  const count = sums.length / 9, colors = new Uint8Array(4 * count), traits = new Uint8Array(4 * count);
  for (let n = 0; n < count; n++) {
    const total = sums[9 * n + 8];
    colors[4 * n + 3] = total > 0 ? 0 : 255;
    if (!total) continue;
    const [x, y, z] = sums.subarray(9 * n + 3, 9 * n + 6);
    const length = Math.abs(x) + Math.abs(y) + Math.abs(z) || 1;
    let u = x / length, v = y / length;
    if (z < 0) [u, v] = [(1 - Math.abs(v)) * (u < 0 ? -1 : 1), (1 - Math.abs(u)) * (v < 0 ? -1 : 1)];
    for (let c = 0; c < 3; c++) colors[4 * n + c] = Math.round(sums[9 * n + c] / total);
    traits.set([127.5 * (u + 1), 127.5 * (v + 1)].map(Math.round), 4 * n);
    for (let c = 0; c < 2; c++) traits[4 * n + 2 + c] = Math.round((255 * sums[9 * n + 6 + c]) / total / tops[c]);
  }
  measureDistances(colors, size);
  return { colors, traits };
}

// Fourth byte of every voxel: how many steps along the axes away the nearest occupied one is.
function measureDistances(colors, [nx, ny, nz]) {
  const strides = [1, nx, nx * ny], sizes = [nx, ny, nz];
  for (let axis = 0; axis < 3; axis++) {
    for (const sign of [1, -1])
      for (let m = 0; m < nx * ny * nz; m++) {
        const n = sign > 0 ? m : nx * ny * nz - 1 - m;
        const at = Math.floor(n / strides[axis]) % sizes[axis];
        if (sign > 0 ? at === 0 : at === sizes[axis] - 1) continue;
        const beside = colors[4 * (n - sign * strides[axis]) + 3];
        if (beside + 1 < colors[4 * n + 3]) colors[4 * n + 3] = beside + 1;
      }
  }
}
