// Photos that the asset keeps: the nearest by angle that see a place, as renderers/view_dependence/photos.py blends them.
// Which do is told by the depth of the surface in each, drawn once.

const FAR = 1e30; // depth where a photo meets nothing
const RAW_DEPTH = 5; // the mode that draws depths as numbers
const CANDIDATES = 24; // photos that a frame asks at most: those nearest by angle, as seen from the object's middle

const KEPT_SHADER = `
uniform sampler2D keptRows; // a row a photo: pixel from world (3); centre, focal length; width, height
uniform sampler2DArray keptColors, keptDepths, keptMasks;
uniform int keptCount, keptBlended, keptOrder[${CANDIDATES}];
uniform float keptFalloff, keptSharpness;
uniform float keptTop; // display code of 1
uniform bool asksPhotos;

vec4 taps(float f) {
  vec4 t = abs(vec4(-1.0, 0.0, 1.0, 2.0) - f);
  float a = -keptSharpness;
  return mix(a * (((t - 5.0) * t + 8.0) * t - 4.0), ((a + 2.0) * t - (a + 3.0)) * t * t + 1.0, lessThan(t, vec4(1.0)));
}

// By cubic convolution, where all pixels around show the object.
vec3 sharper(int photo, ivec2 base, vec2 f, ivec2 size, vec3 code) {
  if (any(lessThan(base, ivec2(1))) || any(greaterThanEqual(base + 2, size))) return code;
  vec4 across = taps(f.x), down = taps(f.y);
  vec3 sum = vec3(0.0);
  for (int n = 0; n < 16; n++) {
    ivec3 texel = ivec3(base + ivec2((n & 3) - 1, (n >> 2) - 1), photo);
    if (texelFetch(keptMasks, texel, 0).r < 0.5) return code;
    sum += across[n & 3] * down[n >> 2] * texelFetch(keptColors, texel, 0).rgb;
  }
  return sum;
}

float weightOf(float near, float last, bool full) {
  if (keptFalloff <= 0.0) return max(near - last, 0.0);
  float angle = acos(clamp(near, -1.0, 1.0)), bar = acos(clamp(last, -1.0, 1.0));
  if (!full) bar = 1.2 * bar + 1e-6;
  return bar > 0.0 ? max(1.0 - angle / bar, 0.0) / pow(angle + 0.003, keptFalloff) : 0.0;
}

bool seeIn(int photo, vec3 position, vec3 n, out vec3 code) {
  vec4 x = texelFetch(keptRows, ivec2(0, photo), 0), y = texelFetch(keptRows, ivec2(1, photo), 0);
  vec4 place = vec4(position, 1.0), from = texelFetch(keptRows, ivec2(3, photo), 0);
  vec2 size = texelFetch(keptRows, ivec2(4, photo), 0).xy;
  float z = dot(texelFetch(keptRows, ivec2(2, photo), 0), place), cosine = dot(n, normalize(from.xyz - position));
  vec2 at = vec2(dot(x, place), dot(y, place)) / z - 0.5;
  if (z <= 0.0 || cosine < 0.05 || any(lessThan(at, vec2(0.0))) || any(greaterThan(at, size - 1.0))) return false;
  float slack = 2.0 * z / from.w / cosine, total = 0.0;
  ivec2 base = max(min(ivec2(at), ivec2(size) - 2), 0);
  vec2 f = at - vec2(base);
  code = vec3(0.0);
  for (int c = 0; c < 4; c++) {
    ivec2 step_ = ivec2(c & 1, c >> 1);
    ivec3 texel = ivec3(min(base + step_, ivec2(size) - 1), photo);
    if (abs(texelFetch(keptDepths, texel, 0).r - z) > slack || texelFetch(keptMasks, texel, 0).r < 0.5) continue;
    float part = (step_.x == 1 ? f.x : 1.0 - f.x) * (step_.y == 1 ? f.y : 1.0 - f.y);
    code += part * texelFetch(keptColors, texel, 0).rgb;
    total += part;
  }
  code /= max(total, 1e-6);
  if (keptSharpness > 0.0 && total > 0.9999) code = sharper(photo, base, f, ivec2(size), code);
  return total >= 0.25;
}

vec3 fromPhotos(vec3 light, vec3 position, vec3 n) {
  if (!asksPhotos) return light;
  vec3 toward = normalize(eye - position), codes[8];
  float near[8], below = 2.0;
  n = n == vec3(0.0) ? toward : dot(n, toward) < 0.0 ? -n : n;
  int found = 0;
  for (int round_ = 0; round_ < keptCount && found < keptBlended; round_++) {
    int best = -1;
    float most = -2.0;
    for (int k = 0; k < keptCount; k++) {
      int photo = keptOrder[k];
      float angle = dot(toward, normalize(texelFetch(keptRows, ivec2(3, photo), 0).xyz - position));
      if (angle < below && angle > most) { most = angle; best = photo; }
    }
    if (best < 0) break;
    below = most;
    vec3 code;
    if (!seeIn(best, position, n, code)) continue;
    codes[found] = code;
    near[found++] = most;
  }
  if (found == 0) return light;
  float low = near[found - 1], total = 0.0;
  bool full = found == keptBlended;
  if (!full && keptFalloff <= 0.0) low -= 0.5 * (near[0] - low) + 1e-6;
  vec3 sum = vec3(0.0), plain = vec3(0.0);
  for (int k = 0; k < found; k++) {
    float weight = weightOf(near[k], low, full);
    sum += weight * codes[k];
    plain += codes[k];
    total += weight;
  }
  return decode(keptTop * (total > 0.0 ? sum / total : plain / float(found)));
}
`;

async function unpackKept(bytes, meta) {
  const photos = await Promise.all(meta.photos.map(async (photo) => ({
    ...photo,
    bitmap: await createImageBitmap(new Blob([unpackArray(bytes, photo.picture)], { type: "image/avif" }),
      { colorSpaceConversion: "none" }),
    shown: photo.mask && unpackArray(bytes, photo.mask),
  })));
  const largest = (name) => Math.max(...photos.map((photo) => photo[name]));
  return { ...meta, photos, width: largest("width"), height: largest("height"), rows: keptRows(photos) };
}

// Five texels a photo, as the shader reads them.
function keptRows(photos) {
  return Float32Array.from(photos.flatMap((photo) => {
    const toPixel = multiply(homogeneous(photo.K), [...photo.cam_from_world.flat(), 0, 0, 0, 1]);
    return [...toPixel.slice(0, 12), ...cameraCenter(photo), photo.K[0][0], photo.width, photo.height, 0, 0];
  }));
}

const homogeneous = (K) => [...K.flatMap((row) => [...row, 0]), 0, 0, 0, 1];

// Numbers of the photos that a frame from `eye` may ask.
function nearestKept({ photos }, centre, eye) {
  const toward = unit(subtract(eye, centre));
  const near = photos.map((photo, number) => [dot(toward, unit(subtract(cameraCenter(photo), centre))), number]);
  return near.sort((one, other) => other[0] - one[0]).slice(0, CANDIDATES).map(([, number]) => number);
}

// Bytes (H * W) of a photo's mask, 255 = shows the object.
function keptMask({ width, height, shown }) {
  return Uint8Array.from({ length: width * height }, (_, n) =>
    !shown || (shown[n >> 3] >> (7 - (n & 7))) & 1 ? 255 : 0);
}

function uploadKept(renderer, { photos, width, height, rows }) {
  const { gl } = renderer, layered = gl.TEXTURE_2D_ARRAY, flat = gl.TEXTURE_2D;
  renderer.texture("keptColors", layered, () => {
    gl.texStorage3D(layered, 1, gl.RGBA8, width, height, photos.length);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    photos.forEach(({ bitmap }, n) => gl.texSubImage3D(layered, 0, 0, 0, n, bitmap.width, bitmap.height, 1,
      gl.RGBA, gl.UNSIGNED_BYTE, bitmap));
  });
  renderer.texture("keptMasks", layered, () => {
    gl.texStorage3D(layered, 1, gl.R8, width, height, photos.length);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    photos.forEach((photo, n) => gl.texSubImage3D(layered, 0, 0, 0, n, photo.width, photo.height, 1,
      gl.RED, gl.UNSIGNED_BYTE, keptMask(photo)));
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  });
  renderer.texture("keptRows", flat, () =>
    gl.texImage2D(flat, 0, gl.RGBA32F, 5, photos.length, 0, gl.RGBA, gl.FLOAT, rows));
}

// Draw the surface's depth in every photo, by a program that asks no photos: it could not read what it draws into.
function drawKeptDepths(renderer, { photos, width, height }) {
  const { gl } = renderer, layered = gl.TEXTURE_2D_ARRAY;
  let depths;
  renderer.texture("keptDepths", layered, () => {
    gl.texStorage3D(layered, 1, gl.R32F, width, height, photos.length);
    depths = gl.getParameter(gl.TEXTURE_BINDING_2D_ARRAY);
  });
  const frame = gl.createFramebuffer(), buffer = gl.createRenderbuffer(), plain = buildShader(gl, { kinds: [] });
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
  gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT32F, width, height);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, buffer);
  photos.forEach((photo, n) => {
    gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, depths, 0, n);
    gl.viewport(0, 0, photo.width, photo.height);
    gl.clearBufferfv(gl.COLOR, 0, [FAR, 0, 0, 0]);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    renderer.drawDepths(photo, plain);
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.deleteFramebuffer(frame);
  gl.deleteRenderbuffer(buffer);
  gl.deleteProgram(plain.program);
}
