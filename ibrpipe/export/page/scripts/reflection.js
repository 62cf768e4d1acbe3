// Shared reflection: C = (1 - damping s) D + sum of k (f + (1 - f) s) E(r), s = (1 - n.v)^5; see docs/reflection.md.

const REFLECTION_SHADER = `
uniform sampler2DArray lightTables; // linear light, padded by a cell on every side
uniform int tableCount;
uniform vec2 reflectance;
uniform float damping;
uniform bool mirrors;

vec3 tableLight(vec3 r, int table) {
  float size = float(textureSize(lightTables, 0).x - 2);
  r /= abs(r.x) + abs(r.y) + abs(r.z);
  vec2 e = r.xy;
  if (r.z < 0.0) e = (1.0 - abs(r.yx)) * mix(vec2(-1.0), vec2(1.0), greaterThanEqual(r.xy, vec2(0.0)));
  e = (e + 1.0) * 0.5 * size + 0.5;
  ivec2 cell = min(ivec2(e), ivec2(int(size)));
  vec2 f = e - vec2(cell);
  vec3 upper = mix(texelFetch(lightTables, ivec3(cell, table), 0).rgb,
    texelFetch(lightTables, ivec3(cell + ivec2(1, 0), table), 0).rgb, f.x);
  vec3 lower = mix(texelFetch(lightTables, ivec3(cell + ivec2(0, 1), table), 0).rgb,
    texelFetch(lightTables, ivec3(cell + ivec2(1, 1), table), 0).rgb, f.x);
  return mix(upper, lower, f.y);
}

vec3 glossy(vec3 diffuse, vec3 n, vec3 v, vec2 weights, vec4 own) {
  // own: light of the object that the mirror shows, and how much of the tables it hides
  float cosine = clamp(dot(n, v), 0.0, 1.0), s = pow(1.0 - cosine, 5.0);
  vec3 r = 2.0 * cosine * n - v, light = (1.0 - damping * s) * diffuse;
  for (int t = 0; t < tableCount; t++) {
    vec3 shown = mix(tableLight(r, t), own.rgb, own.a);
    light += weights[t] * (reflectance[t] + (1.0 - reflectance[t]) * s) * shown;
  }
  return light;
}

${MIRROR_SHADER}${SEEN_SHADER}
vec3 addReflection(vec3 light, vec3 position, vec3 n, vec2 weights) {
  if (!mirrors || n == vec3(0.0)) return light;
  vec3 v = normalize(eye - position);
  float cosine = clamp(dot(n, v), 0.0, 1.0);
  return glossy(light, n, v, weights, mirrored(position, n, 2.0 * cosine * n - v));
}
`;

// Padded tables as (layers, (n + 2) x (n + 2) x 4) f32 of linear light.
function unpackTables(bytes, meta) {
  const size = meta.size, width = size + 2, count = meta.tables.length;
  const offsets = Int32Array.from({ length: size * size + 1 }, (_, n) => n);
  const around = neighboursOf(offsets, size);
  const out = new Float32Array(count * width * width * 4);
  meta.tables.forEach((planes, table) => {
    const codes = planes.map((entry) => unpackPredicted(bytes, entry, around));
    for (let j = 0; j < width; j++)
      for (let i = 0; i < width; i++) {
        const cell = paddedCell(i - 1, j - 1, size);
        for (let c = 0; c < 3; c++)
          out[4 * ((table * width + j) * width + i) + c] = meta.top * (codes[c][cell] / meta.levels) ** 4;
      }
  });
  return { data: out, width, count };
}

// The cell that lies on the sphere where cell (i, j) would lie beyond the table's edge.
function paddedCell(i, j, size) {
  const outsideI = i < 0 || i >= size, outsideJ = j < 0 || j >= size;
  const clampedI = Math.min(Math.max(i, 0), size - 1), clampedJ = Math.min(Math.max(j, 0), size - 1);
  const column = outsideJ ? size - 1 - clampedI : clampedI, row = outsideI ? size - 1 - clampedJ : clampedJ;
  return row * size + column;
}
