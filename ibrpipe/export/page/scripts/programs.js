// The programs for what is no layered image: meshes, points, lines of some width, and photos on their image planes.

const FROM_WORLD = `#version 300 es
uniform mat4 clipFromWorld;
`;

const MESH_VERTEX = `${FROM_WORLD}
in vec3 place, normal;
in vec4 color;
out vec3 position, across;
out vec4 paint;
void main() {
  position = place;
  across = normal;
  paint = color;
  gl_Position = clipFromWorld * vec4(place, 1.0);
}`;

const MESH_FRAGMENT = `#version 300 es
precision highp float;
in vec3 position, across;
in vec4 paint;
uniform vec3 eye;
uniform int mode; // as in MODES
uniform vec2 depthRange;
uniform bool painted;
out vec4 result;
vec3 sureness(float t) { // from red over yellow to blue-green, alike in brightness to most eyes
  return t < 0.5 ? mix(vec3(0.75, 0.2, 0.15), vec3(0.95, 0.8, 0.3), 2.0 * t)
    : mix(vec3(0.95, 0.8, 0.3), vec3(0.1, 0.5, 0.55), 2.0 * t - 1.0);
}
void main() {
  vec3 toward = normalize(eye - position);
  vec3 n = dot(across, across) > 0.0 ? normalize(across) : toward;
  float facing = abs(dot(n, toward));
  if (mode == 1) {
    float t = clamp((length(position - eye) - depthRange.x) / (depthRange.y - depthRange.x), 0.0, 1.0);
    result = vec4(vec3(1.0 - 0.85 * t), 1.0);
  } else if (mode == 2) result = vec4(n * 0.5 + 0.5, 1.0);
  else if (mode == 4) result = vec4(sureness(paint.a) * (0.55 + 0.45 * facing), 1.0);
  else result = vec4(painted ? paint.rgb * (0.6 + 0.4 * facing) : vec3(0.8, 0.79, 0.76) * (0.3 + 0.7 * facing), 1.0);
}`;

const POINT_VERTEX = `${FROM_WORLD}
in vec3 place;
in vec4 color;
uniform float size;
out vec4 paint;
void main() {
  paint = vec4(color.rgb, 1.0);
  gl_Position = clipFromWorld * vec4(place, 1.0);
  gl_PointSize = size;
}`;

const POINT_FRAGMENT = `#version 300 es
precision highp float;
in vec4 paint;
out vec4 result;
void main() {
  if (length(gl_PointCoord - 0.5) > 0.5) discard;
  result = paint;
}`;

const LINE_VERTEX = `${FROM_WORLD}
uniform vec2 pixel; // width and height of a pixel in clip coordinates
uniform float width; // pixels
in vec3 first, last;
in vec4 color;
out vec4 paint;
void main() {
  vec4 a = clipFromWorld * vec4(first, 1.0), b = clipFromWorld * vec4(last, 1.0);
  float near = 1e-4 * max(abs(a.w), abs(b.w)); // what lies behind the eye is cut off
  bool shown = max(a.w, b.w) > near;
  if (a.w < near) a = mix(a, b, (near - a.w) / (b.w - a.w));
  else if (b.w < near) b = mix(b, a, (near - b.w) / (a.w - b.w));
  vec2 along = (b.xy / b.w - a.xy / a.w) / pixel, side = normalize(vec2(-along.y, along.x) + vec2(1e-9, 0.0));
  vec4 at = gl_VertexID % 2 == 0 ? a : b;
  at.xy += (gl_VertexID < 2 ? -0.5 : 0.5) * width * side * pixel * at.w;
  gl_Position = shown ? at : vec4(2.0, 2.0, 2.0, 1.0);
  paint = color;
}`;

const LINE_FRAGMENT = `#version 300 es
precision highp float;
in vec4 paint;
out vec4 result;
void main() { result = vec4(paint.rgb * paint.a, paint.a); }`;

const PLANE_VERTEX = `${FROM_WORLD}
in vec3 corner, across, down; // first corner of the picture, and its edges
in vec4 cell; // in the atlas: left, top, width, height
in float page;
uniform vec3 eye;
out vec3 at;
void main() {
  vec2 part = vec2(gl_VertexID % 2, gl_VertexID / 2);
  gl_Position = clipFromWorld * vec4(corner + part.x * across + part.y * down, 1.0);
  // who stands where a photo was taken looks through it
  if (length(corner + 0.5 * (across + down) - eye) < 1.5 * length(across + down)) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  at = vec3(cell.xy + part * cell.zw, page);
}`;

const PLANE_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DArray;
in vec3 at;
uniform sampler2DArray thumbnails;
out vec4 result;
void main() { result = vec4(texture(thumbnails, at).rgb, 1.0) * 0.92; }`;
