// Impostors of ibrpipe in three.js: a quad that faces the viewer, on which the four nearest pictures of an octahedral
// map are met by their depth and blended. See docs/scenes.md.
//
//   const impostor = await loadImpostor("oak/");        // folder of impostors.json
//   scene.add(impostor.copies([new Matrix4(), ...]));   // an InstancedMesh; matrices may move, turn and scale alike
//
// Axes are the part's own: turn what you add if its z is up and yours is y.

import {
  GLSL3, InstancedMesh, LinearFilter, NearestFilter, PlaneGeometry, ShaderMaterial, Sphere, TextureLoader, Vector3,
} from "three";

const VERTEX = `
uniform vec3 centre;
uniform float radius;
out vec3 place;
flat out vec3 eye;
void main() {
  mat4 model = modelMatrix * instanceMatrix;
  eye = (inverse(model) * vec4(cameraPosition, 1.0)).xyz - centre;
  float away = length(eye);
  vec3 toward = eye / away, right = normalize(cross(abs(toward.z) < 0.999 ? vec3(0, 0, 1) : vec3(0, 1, 0), toward));
  // as large as the ball around the part looks from here
  float size = radius * away / sqrt(max(away * away - radius * radius, 1e-4 * radius * radius));
  place = size * (2.0 * position.x * right + 2.0 * position.y * cross(toward, right));
  gl_Position = projectionMatrix * viewMatrix * model * vec4(place + centre, 1.0);
}`;

const FRAGMENT = `
precision highp float;
const float STEPS = 24.0; // through the ball
uniform sampler2D albedo, normals, depths;
uniform float radius, grid, texels;
uniform vec3 light; // toward it, the part's axes
in vec3 place;
flat in vec3 eye;
out vec4 result;

vec2 signs(vec2 v) { return mix(vec2(-1.0), vec2(1.0), greaterThanEqual(v, vec2(0.0))); }

vec3 directionOf(vec2 cell) {
  vec2 e = 2.0 * cell / (grid - 1.0) - 1.0;
  vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  n.xy -= max(-n.z, 0.0) * signs(e);
  return normalize(n);
}

vec2 cellOf(vec3 direction) {
  vec3 n = direction / (abs(direction.x) + abs(direction.y) + abs(direction.z));
  vec2 e = n.z < 0.0 ? (1.0 - abs(n.yx)) * signs(n.xy) : n.xy;
  return (0.5 * e + 0.5) * (grid - 1.0);
}

// Place in the atlas of a place in a cell, half a texel away from its neighbours; rows of pictures run downward.
vec2 inAtlas(vec2 cell, vec2 uv, vec2 size) {
  vec2 inner = clamp(vec2(uv.x, 1.0 - uv.y), 0.5 / texels, 1.0 - 0.5 / texels);
  return (cell + inner) * texels / size;
}

// Height of the surface over the middle plane of a picture; -2 radii where there is none.
float heightAt(vec2 at) {
  vec3 code = texture(depths, at).rgb; // high byte, low byte, covered
  return code.b > 0.5 ? radius * (1.0 - 2.0 * (code.r * 65280.0 + code.g * 255.0) / 65535.0) : -2.0 * radius;
}

// Add what one picture shows of the ray: it goes down through the ball in steps until it is below the surface, but by
// less than a step (or it has passed behind a rim), then the step is halved five times.
void addPicture(vec2 cell, float weight, vec3 along, inout vec4 color, inout vec3 normal) {
  vec3 toward = directionOf(cell), right = normalize(cross(abs(toward.z) < 0.999 ? vec3(0, 0, 1) : vec3(0, 1, 0), toward));
  mat2x3 axes = mat2x3(right, cross(toward, right));
  vec2 size = vec2(textureSize(albedo, 0));
  // the ray's place in the cell, 0 to 1, at a height: start + height * slope
  vec3 perHeight = along / dot(along, toward);
  vec2 start = 0.5 + 0.5 * (eye - perHeight * dot(eye, toward)) * axes / radius, slope = 0.5 * perHeight * axes / radius;
  float step_ = 2.0 * radius / STEPS, height = radius, surface = 0.0;
  bool met = false;
  for (int n = 0; n < int(STEPS) && !met; n++) {
    height -= step_;
    vec2 uv = start + height * slope;
    if (any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) continue;
    surface = heightAt(inAtlas(cell, uv, size));
    met = surface >= height && surface < height + 1.5 * step_;
  }
  if (!met) return;
  for (int n = 0; n < 5; n++) {
    step_ *= 0.5;
    surface = heightAt(inAtlas(cell, start + height * slope, size));
    height += surface >= height ? step_ : -step_;
  }
  vec2 at = inAtlas(cell, start + height * slope, size);
  vec4 found = texture(albedo, at);
  color += weight * vec4(pow(found.rgb / max(found.a, 1e-3), vec3(2.2)) * found.a, found.a);
  normal += weight * found.a * (2.0 * texture(normals, at).rgb - 1.0);
}

void main() {
  vec3 along = normalize(place - eye);
  vec2 at = cellOf(normalize(eye)), first = min(floor(at), vec2(grid - 2.0)), f = at - first;
  vec4 color = vec4(0.0);
  vec3 normal = vec3(0.0);
  addPicture(first, (1.0 - f.x) * (1.0 - f.y), along, color, normal);
  addPicture(first + vec2(1, 0), f.x * (1.0 - f.y), along, color, normal);
  addPicture(first + vec2(0, 1), (1.0 - f.x) * f.y, along, color, normal);
  addPicture(first + vec2(1, 1), f.x * f.y, along, color, normal);
  if (color.a < 0.5) discard;
  vec3 lit = color.rgb / color.a * (0.45 + 0.75 * max(dot(normalize(normal), light), 0.0));
  result = vec4(pow(lit, vec3(1.0 / 2.2)), 1.0);
}`;

export async function loadImpostor(folder) {
  const facts = await (await fetch(`${folder}impostors.json`)).json();
  const [albedo, normals, depths] = await Promise.all([
    loadPicture(folder + facts.albedo, LinearFilter, true), loadPicture(folder + facts.normal_png, LinearFilter),
    loadPicture(folder + facts.depth_png, NearestFilter),
  ]);
  const uniforms = {
    albedo: { value: albedo }, normals: { value: normals }, depths: { value: depths },
    centre: { value: new Vector3(...facts.center) }, radius: { value: facts.radius },
    grid: { value: facts.grid }, texels: { value: facts.texels }, light: { value: new Vector3(0.4, -0.5, 0.77) },
  };
  const material = new ShaderMaterial({ uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, glslVersion: GLSL3 });
  return {
    facts,
    material,
    copies(matrices) {
      const mesh = new InstancedMesh(new PlaneGeometry(1, 1), material, matrices.length);
      mesh.geometry.boundingSphere = new Sphere(uniforms.centre.value.clone(), facts.radius);
      matrices.forEach((matrix, n) => mesh.setMatrixAt(n, matrix));
      return mesh;
    },
  };
}

// premultiplied: colours of empty texels count for nothing between texels
async function loadPicture(address, filter, premultiplied = false) {
  const texture = await new TextureLoader().loadAsync(address);
  texture.flipY = false;
  texture.premultiplyAlpha = premultiplied;
  texture.generateMipmaps = false;
  texture.minFilter = texture.magFilter = filter;
  return texture;
}
