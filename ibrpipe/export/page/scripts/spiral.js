// Residual images along a spiral of directions: those of the four nearest, as renderers/view_dependence/spiral.py.

const SPIRAL_SHADER = `
uniform sampler2D spirals; // a row a texture: axes and 1 / edges; origin, k; limit, closing, first image, images; zero
uniform sampler2D images; // a column an image, two rows: shift u, v, width, height; column, row, picture, alpha
uniform sampler2DArray residuals;
uniform int spiralCount;
const float TURN = 6.283185307179586;

vec4 image(int n, int row) { return texelFetch(images, ivec2(n & 1023, 2 * (n >> 10) + row), 0); }
float alphaOf(int n) { return image(n, 1).w; }

void addImage(int n, vec3 at, float share, float zero, inout vec4 total) {
  // at: place in the rectangle, 0 to 1, and depth below it
  vec4 shape = image(n, 0), where_ = image(n, 1);
  vec2 xy = (at.xy + at.z * shape.xy) * shape.zw - 0.5;
  if (share <= 0.0 || any(lessThanEqual(xy, vec2(-1.0))) || any(greaterThanEqual(xy, shape.zw))) return;
  ivec2 base = ivec2(floor(xy));
  vec2 f = xy - floor(xy);
  for (int c = 0; c < 4; c++) {
    ivec2 step_ = ivec2(c & 1, c >> 1), texel = base + step_;
    if (any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, ivec2(shape.zw)))) continue;
    vec4 code = texelFetch(residuals, ivec3(ivec2(where_.xy) + texel, int(where_.z)), 0);
    if (code.a < 0.5) continue;
    float part = share * (step_.x == 1 ? f.x : 1.0 - f.x) * (step_.y == 1 ? f.y : 1.0 - f.y);
    total += part * vec4(255.0 * code.rgb - zero, 1.0);
  }
}

void addAlong(float alpha, int first, int count, int closing, vec3 at, float share, float zero, inout vec4 total) {
  // the two images round alpha of one turn; the closing turn is a circle
  int circle = first + count - closing;
  if (closing > 0 && alpha >= alphaOf(circle)) {
    float start = alphaOf(circle);
    alpha = start + mod(alpha - start, TURN);
  }
  int low = first, high = first + count;
  while (high - low > 1) {
    int middle = (low + high) / 2;
    if (alphaOf(middle) <= alpha) low = middle; else high = middle;
  }
  int next = low + 1 < first + count ? low + 1 : closing > 0 ? circle : low;
  float below = alphaOf(low), beyond = low + 1 < first + count ? alphaOf(next) : alphaOf(circle) + TURN;
  float along = next == low ? 0.0 : (alpha - below) / (beyond - below);
  addImage(low, at, share * (1.0 - along), zero, total);
  addImage(next, at, share * along, zero, total);
}

void askTexture(int t, vec3 position, vec3 toward, inout vec4 total) {
  vec4 a = texelFetch(spirals, ivec2(0, t), 0), b = texelFetch(spirals, ivec2(1, t), 0);
  vec4 c = texelFetch(spirals, ivec2(2, t), 0), o = texelFetch(spirals, ivec2(3, t), 0);
  vec4 turns = texelFetch(spirals, ivec2(4, t), 0);
  vec3 local = position - o.xyz;
  vec3 at = vec3(dot(a.xyz, local) * a.w, dot(b.xyz, local) * b.w, -dot(c.xyz, local));
  vec3 view = vec3(dot(a.xyz, toward), dot(b.xyz, toward), dot(c.xyz, toward));
  float k = o.w, limit = turns.x, zero = c.w;
  int closing = int(turns.y), first = int(turns.z), count = int(turns.w);
  float pitch = atan(length(view.xy), view.z), yaw = atan(view.y, view.x);
  yaw = yaw < 0.0 ? yaw + TURN : yaw;
  yaw = yaw >= TURN ? 0.0 : yaw;
  float here = TURN * floor((pitch - k * yaw) / (TURN * k)) + yaw, above = here + TURN;
  here = max(here, 0.0); // the pole stands in for the round before the first
  float low = k * here, high = closing > 0 ? min(k * above, limit) : k * above;
  float share = high > low ? clamp((pitch - low) / (high - low), 0.0, 1.0) : 1.0;
  if (closing > 0 && low >= limit) share = 0.0;
  addAlong(here, first, count, closing, at, 1.0 - share, zero, total);
  addAlong(above, first, count, closing, at, share, zero, total);
}

float preference(int t, vec3 position, vec3 toward) {
  vec4 a = texelFetch(spirals, ivec2(0, t), 0), b = texelFetch(spirals, ivec2(1, t), 0);
  vec3 axis = texelFetch(spirals, ivec2(2, t), 0).xyz, local = position - texelFetch(spirals, ivec2(3, t), 0).xyz;
  float z = dot(axis, toward);
  if (z <= 0.02) return -1.0;
  vec3 foot = local - toward * (dot(axis, local) / z);
  vec2 uv = vec2(dot(a.xyz, foot) * a.w, dot(b.xyz, foot) * b.w);
  float outside = max(max(-uv.x, uv.x - 1.0), max(-uv.y, uv.y - 1.0));
  return outside <= 0.0 ? 1.0 + z : z / (1.0 + outside) - 0.5;
}

vec3 addResiduals(vec3 light, vec3 position) {
  vec3 toward = normalize(eye - position);
  vec4 total = vec4(0.0);
  uint asked = 0u;
  for (int round_ = 0; round_ < spiralCount && total.w <= 0.98; round_++) {
    int best = -1;
    float most = -1.0;
    for (int t = 0; t < spiralCount; t++) {
      float worth = (asked & (1u << t)) == 0u ? preference(t, position, toward) : -1.0;
      if (worth > most) { most = worth; best = t; }
    }
    if (best < 0) break;
    asked |= 1u << best;
    askTexture(best, position, toward, total);
  }
  if (total.w < 1e-3) return light;
  return decode(max(encode(light) + total.rgb / (255.0 * total.w), 0.0));
}
`;

// Rows of the texture \`spirals\`: 5 x 4 numbers each.
function spiralRows(meta) {
  let first = 0;
  return Float32Array.from(
    meta.textures.flatMap(({ rotation: [a, b, c], origin, scale, k, limit, closing, images, zero }) => {
      const row = [...a, scale[0], ...b, scale[1], ...c, zero, ...origin, k, limit, closing, first, images];
      first += images;
      return row;
    }),
  );
}

// Pictures of residual images as bitmaps whose bytes nothing has touched.
function residualPictures(bytes, meta) {
  return Promise.all(
    meta.pages.map((entry) =>
      createImageBitmap(new Blob([unpackArray(bytes, entry)], { type: "image/webp" }), {
        premultiplyAlpha: "none",
        colorSpaceConversion: "none",
      }),
    ),
  );
}
