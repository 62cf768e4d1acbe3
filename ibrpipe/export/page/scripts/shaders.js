// The programs: every pixel in the box of a patch meets the patch itself, by the renderer's rules (docs/renderers/ldi.md);
// colour is bilinear between samples, then comes what changes with the view.

const VERTEX_SHADER = `#version 300 es
uniform mat4 clipFromField;
uniform vec4 weightOfField; // of homogeneous world coordinates
uniform float facing; // sign of the screen area of fronts
uniform vec2 pixel; // width and height of a pixel
layout(location = 0) in vec2 cell;
layout(location = 1) in vec4 depths;
layout(location = 2) in ivec4 corners;
flat out float cameraDepth;
flat out vec2 origin;
flat out vec4 heights;
flat out ivec4 sampleOf;

float area(vec2 a, vec2 b, vec2 c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); }

void main() {
  // the box of the patch on the screen: it lies in the hull of its corners
  vec2 at[4];
  float depth = 0.0, nearest = 1.0;
  for (int c = 0; c < 4; c++) {
    vec4 field = vec4(cell + vec2(c & 1, c >> 1), depths[c], 1.0), clip = clipFromField * field;
    at[c] = clip.xy / clip.w;
    nearest = min(nearest, clip.w);
    depth += 0.25 * clip.w / dot(weightOfField, field);
  }
  vec2 low = min(min(at[0], at[1]), min(at[2], at[3])) - 0.25 * pixel;
  vec2 high = max(max(at[0], at[1]), max(at[2], at[3])) + 0.25 * pixel;
  vec4 fronts = facing * vec4(area(at[0], at[1], at[2]), area(at[1], at[3], at[0]), area(at[3], at[2], at[1]),
    area(at[2], at[0], at[3]));
  bool shown = nearest > 0.0 && any(greaterThan(fronts, vec4(0.0)));
  gl_Position = shown ? vec4(gl_VertexID % 2 == 0 ? low.x : high.x, gl_VertexID < 2 ? low.y : high.y, 0.0, 1.0)
    : vec4(2.0, 2.0, 2.0, 1.0);
  cameraDepth = depth;
  origin = cell;
  heights = depths;
  sampleOf = corners;
}`;

const FRAGMENT_HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp sampler3D;
flat in float cameraDepth;
flat in vec2 origin;
flat in vec4 heights;
flat in ivec4 sampleOf;
out vec4 result;
uniform sampler2D colors, traits; // of samples: sRGB and share filled; octahedral normal, weights of tables
uniform vec3 eye;
uniform int mode; // 0 colour, 1 depth, 2 normals, 3 resolution, 5 depth along z as a number
uniform bool dependent;
uniform vec2 depthRange;
uniform mat4 clipFromField, worldFromField, fieldFromPixel;
uniform vec4 eyeInField; // homogeneous

// hits so far beside a cell count: roundings must not leave cracks
const float EDGE = 1e-3;

vec3 decode(vec3 code) {
  return mix(code / 12.92, pow((code + 0.055) / 1.055, vec3(2.4)), greaterThan(code, vec3(0.04045)));
}
vec3 encode(vec3 light) {
  light = max(light, 0.0);
  return mix(light * 12.92, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, greaterThan(light, vec3(0.0031308)));
}
vec4 sampleData(sampler2D data, int n) { return texelFetch(data, ivec2(n & 2047, n >> 11), 0); }
vec3 octahedral(vec2 e) {
  vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * mix(vec2(-1.0), vec2(1.0), greaterThanEqual(n.xy, vec2(0.0)));
  return normalize(n);
}
`;

const FRAGMENT_MAIN = `
vec3 heat(float t) {
  return clamp(vec3(1.5 * t, 1.0 - abs(2.0 * t - 1.0) * 0.8, 1.5 - 1.5 * t), 0.0, 1.0);
}

// Where the ray through the pixel's centre passes to the back of the bilinear patch: place in the cell, field depth, and
// 1, or 0 = nowhere. One root of a quadratic in the way along the ray.
vec4 meetPatch() {
  vec4 through = fieldFromPixel * vec4(gl_FragCoord.xy, 1.0, 0.0); // per unit of camera depth, homogeneous
  vec4 start = eyeInField + cameraDepth * through;
  vec3 at = start.xyz / start.w, ray = through.xyz - through.w * at;
  at.xy -= origin;
  ray /= max(max(abs(ray.x), abs(ray.y)), 1e-20);
  float a = heights.y - heights.x, b = heights.z - heights.x, twist = heights.w - heights.y - b;
  float off = at.z - heights.x - a * at.x - b * at.y - twist * at.x * at.y;
  float slope = ray.z - a * ray.x - b * ray.y - twist * (at.x * ray.y + at.y * ray.x), bend = -twist * ray.x * ray.y;
  float square = slope * slope - 4.0 * bend * off;
  if (square < 0.0) return vec4(0.0);
  float root = sqrt(square);
  at += (slope > 0.0 ? -2.0 * off / (slope + root) : (root - slope) / (2.0 * bend)) * ray;
  // a patch counts only in the quadrants of the corners that are samples
  bool inside = all(greaterThan(at.xy, vec2(-EDGE))) && all(lessThan(at.xy, vec2(1.0 + EDGE)));
  return vec4(at, inside && sampleOf[(at.x > 0.5 ? 1 : 0) + (at.y > 0.5 ? 2 : 0)] >= 0 ? 1.0 : 0.0);
}

void main() {
  vec4 met = meetPatch();
  if (met.w == 0.0) discard;
  vec2 p = clamp(met.xy, 0.0, 1.0);
  vec4 field = vec4(origin + met.xy, met.z, 1.0), clip = clipFromField * field;
  gl_FragDepth = 0.5 * clip.z / clip.w + 0.5;
  vec4 world = worldFromField * field;
  vec4 weight = vec4((1.0 - p.x) * (1.0 - p.y), p.x * (1.0 - p.y), (1.0 - p.x) * p.y, p.x * p.y);
  vec3 light = vec3(0.0), normal = vec3(0.0);
  vec4 mixed = vec4(0.0); // sum of weights of known samples; of their shares filled; of tables
  bool oriented = true;
  for (int c = 0; c < 4; c++) {
    if (sampleOf[c] < 0 || weight[c] <= 0.0) continue;
    vec4 color = sampleData(colors, sampleOf[c]), trait = sampleData(traits, sampleOf[c]);
    if (trait.x > 2.0) oriented = false;
    normal += weight[c] * octahedral(trait.xy);
    if (color.a <= 0.0) continue;
    light += weight[c] * color.a * decode(color.rgb);
    mixed += weight[c] * vec4(1.0, color.a, trait.zw);
  }
  vec3 position = world.xyz / world.w;
  result = mode == 5 ? vec4(clip.w / world.w, 0.0, 0.0, 1.0) : vec4(0.0);
  if (mixed.y <= 0.0) return; // no photo saw it: it hides what is behind, but has no colour
  if (mixed.y < 0.5 * mixed.x) discard; // rims: the surface ends where half of the texel is filled
  light /= mixed.y;
  if (mode == 5) return;
  if (mode == 1) {
    float t = clamp((length(position - eye) - depthRange.x) / (depthRange.y - depthRange.x), 0.0, 1.0);
    result = vec4(vec3(1.0 - 0.85 * t), 1.0);
  } else if (mode == 2) {
    result = vec4(oriented ? normalize(normal) * 0.5 + 0.5 : vec3(0.5), 1.0);
  } else if (mode == 3) {
    vec2 spread = fwidth(field.xy);
    result = vec4(heat(clamp(0.5 - 0.25 * log2(max(max(spread.x, spread.y), 1e-6)), 0.0, 1.0)), 1.0);
  } else {
    if (dependent) {
      light = changeWithView(light, position, oriented && normal != vec3(0.0) ? normalize(normal) : vec3(0.0),
        mixed.zw / mixed.x);
    }
    result = vec4(encode(light), 1.0);
  }
}`;
