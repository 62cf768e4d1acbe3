// Draws the surface of all textures with WebGL2 as the camera sees it.

const SAMPLES_WIDE = 2048;
const MODES = ["color", "depth", "normals", "resolution", "confidence"];
const SHOWN = { mesh: true, points: true, photos: false };

class Renderer {
  constructor(gl, scene) {
    this.gl = gl;
    this.scene = scene;
    gl.getExtension("EXT_color_buffer_float");
    this.shader = buildShader(gl, scene);
    this.units = new Map();
    this.uploadSamples();
    if (scene.reflection) this.uploadReflection(scene.reflection);
    if (scene.spiral) this.uploadSpiral(scene.spiral);
    if (scene.kept) uploadKept(this, scene.kept);
    this.meshes = scene.surfaces.map((surface) => ({
      surface,
      fieldFromWorld: invert(surface.world),
      array: this.patchArray(surface.patchData),
    }));
    if (scene.kept) drawKeptDepths(this, scene.kept);
  }

  // Bind a new texture to a unit of its own; its uniform is set when drawing.
  texture(name, target, allocate) {
    const { gl } = this, unit = this.units.size;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, gl.createTexture());
    for (const which of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, which, gl.NEAREST);
    for (const which of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, which, gl.CLAMP_TO_EDGE);
    allocate();
    this.units.set(name, unit);
  }

  uploadSamples() {
    const { gl, scene } = this;
    const height = Math.max(1, Math.ceil(scene.samples / SAMPLES_WIDE));
    const colors = new Uint8Array(4 * SAMPLES_WIDE * height), traits = new Float32Array(4 * SAMPLES_WIDE * height);
    for (const [number, surface] of scene.surfaces.entries())
      for (let s = 0; s < surface.depth.length; s++) {
        const at = 4 * (surface.firstSample + s), known = surface.normal[0][s] !== UNKNOWN_NORMAL;
        for (let c = 0; c < 3; c++) colors[at + c] = surface.color[c][s];
        colors[at + 3] = surface.filled[s];
        const scale = 2 / (UNKNOWN_NORMAL - 1), weights = scene.weightsOf(number, s);
        traits[at] = known ? surface.normal[0][s] * scale - 1 : 3; // 3: unknown
        traits[at + 1] = known ? surface.normal[1][s] * scale - 1 : 0;
        traits[at + 2] = weights[0];
        traits[at + 3] = weights[1];
      }
    const flat = gl.TEXTURE_2D;
    this.texture("colors", flat, () =>
      gl.texImage2D(flat, 0, gl.RGBA8, SAMPLES_WIDE, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, colors));
    this.texture("traits", flat, () =>
      gl.texImage2D(flat, 0, gl.RGBA32F, SAMPLES_WIDE, height, 0, gl.RGBA, gl.FLOAT, traits));
  }

  uploadReflection({ tables, mirror }) {
    const { gl } = this, layered = gl.TEXTURE_2D_ARRAY, solid = gl.TEXTURE_3D, flat = gl.TEXTURE_2D;
    this.texture("lightTables", layered, () => gl.texImage3D(layered, 0, gl.RGBA32F, tables.width, tables.width,
      tables.count, 0, gl.RGBA, gl.FLOAT, tables.data));
    this.texture("voxels", solid, () =>
      gl.texImage3D(solid, 0, gl.RG32UI, ...mirror.size, 0, gl.RG_INTEGER, gl.UNSIGNED_INT, mirror.voxels));
    for (const [name, inside, outside, type, data, wide] of [
      ["lists", gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT, mirror.lists, WIDE],
      ["patchSamples", gl.RGBA32I, gl.RGBA_INTEGER, gl.INT, mirror.samples, WIDE],
      ["patchHeights", gl.RGBA32F, gl.RGBA, gl.FLOAT, mirror.heights, WIDE],
      ["patchCells", gl.RGBA32F, gl.RGBA, gl.FLOAT, mirror.cells, WIDE],
      ["surfaceRows", gl.RGBA32F, gl.RGBA, gl.FLOAT, mirror.matrices, 4],
    ]) {
      const high = data.length / wide / (inside === gl.R32UI ? 1 : 4);
      this.texture(name, flat, () => gl.texImage2D(flat, 0, inside, wide, high, 0, outside, type, data));
    }
  }

  uploadSpiral({ atlas, pictures, rows, images, count }) {
    const { gl } = this, flat = gl.TEXTURE_2D, layered = gl.TEXTURE_2D_ARRAY;
    this.texture("residuals", layered, () => {
      gl.texStorage3D(layered, 1, gl.RGBA8, atlas, atlas, pictures.length);
      gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
      gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
      pictures.forEach((picture, n) => gl.texSubImage3D(layered, 0, 0, 0, n, picture.width, picture.height, 1,
        gl.RGBA, gl.UNSIGNED_BYTE, picture));
    });
    this.texture("spirals", flat, () =>
      gl.texImage2D(flat, 0, gl.RGBA32F, 5, count, 0, gl.RGBA, gl.FLOAT, rows));
    const wide = 1024, high = 2 * Math.ceil(images.length / 8 / wide), table = new Float32Array(4 * wide * high);
    for (let n = 0; n < images.length / 8; n++)
      for (let half = 0; half < 2; half++)
        table.set(images.subarray(8 * n + 4 * half, 8 * n + 4 * half + 4), 4 * ((2 * (n >> 10) + half) * wide + (n & 1023)));
    this.texture("images", flat, () => gl.texImage2D(flat, 0, gl.RGBA32F, wide, high, 0, gl.RGBA, gl.FLOAT, table));
  }

  // Vertex array of patches: one instance a patch.
  patchArray(data) {
    const { gl } = this, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    const [cell, depths, corners] = [0, 1, 2]; // as the vertex shader places them
    gl.vertexAttribPointer(cell, 2, gl.UNSIGNED_SHORT, false, PATCH_BYTES, 0);
    gl.vertexAttribPointer(depths, 4, gl.FLOAT, false, PATCH_BYTES, 4);
    gl.vertexAttribIPointer(corners, 4, gl.INT, PATCH_BYTES, 20);
    for (const location of [cell, depths, corners]) {
      gl.enableVertexAttribArray(location);
      gl.vertexAttribDivisor(location, 1);
    }
    gl.bindVertexArray(null);
    return array;
  }

  // Draw into the bound framebuffer; turned: row 0 of the picture comes first in memory.
  draw(camera, { turned = false, mode = "color", dependent = true, show = SHOWN, ratio = 1 } = {}) {
    const { gl, scene } = this;
    const eye = cameraCenter(camera), toCentre = Math.hypot(...subtract(eye, scene.centre));
    const range = depthRange(toCentre, 1.01 * scene.radius);
    const clip = clipFromWorld(camera, ...(show.photos ? depthRange(toCentre, 1.6 * scene.reach, 1e-2) : range), turned);
    gl.viewport(0, 0, camera.width, camera.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    this.drawSurfaces(camera, clip, eye, range, { turned, mode, dependent });
    this.stage?.draw(camera, clip, eye, range, { mode, show, ratio });
  }

  // Draw depths along the camera's z, row 0 first, into the bound framebuffer, which is clear.
  drawDepths(camera, shader) {
    const { gl, scene } = this, eye = cameraCenter(camera);
    const range = depthRange(Math.hypot(...subtract(eye, scene.centre)), 1.01 * scene.radius);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    const clip = clipFromWorld(camera, ...range, true);
    this.drawSurfaces(camera, clip, eye, range, { turned: true, mode: RAW_DEPTH, dependent: false }, shader);
  }

  drawSurfaces(camera, clip, eye, range, { turned, mode, dependent }, { program, uniforms } = this.shader) {
    const { gl, scene } = this, toPixel = worldFromPixel(camera, turned);
    if (!this.meshes.length) return;
    gl.useProgram(program);
    for (const [name, unit] of this.units) gl.uniform1i(uniforms[name], unit);
    gl.uniform3f(uniforms.eye, ...eye);
    gl.uniform2f(uniforms.pixel, 2 / camera.width, 2 / camera.height);
    gl.uniform1i(uniforms.mode, mode === RAW_DEPTH ? mode : MODES.indexOf(mode));
    gl.uniform1i(uniforms.dependent, dependent);
    gl.uniform2f(uniforms.depthRange, ...range);
    this.setComponents(uniforms, eye);
    for (const [number, mesh] of this.meshes.entries()) {
      const matrix = multiply(clip, mesh.surface.world);
      gl.uniformMatrix4fv(uniforms.clipFromField, true, matrix);
      gl.uniformMatrix4fv(uniforms.worldFromField, true, mesh.surface.world);
      gl.uniform4f(uniforms.eyeInField, ...transform(mesh.fieldFromWorld, [...eye, 1]));
      gl.uniform4f(uniforms.weightOfField, ...mesh.surface.world.slice(12));
      gl.uniformMatrix4fv(uniforms.fieldFromPixel, true, multiply(mesh.fieldFromWorld, toPixel));
      gl.uniform1i(uniforms.mirrors, scene.mirrors(number));
      gl.uniform1i(uniforms.asksPhotos, scene.kept?.textures[number] ?? false);
      // which way round fronts are drawn depends on the handedness of the mapping
      gl.uniform1f(uniforms.facing, Math.sign(determinant(matrix)));
      gl.bindVertexArray(mesh.array);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, mesh.surface.patches);
    }
    gl.bindVertexArray(null);
  }

  setComponents(uniforms, eye) {
    const { gl, scene: { reflection, spiral, kept, centre } } = this;
    if (reflection) {
      gl.uniform1i(uniforms.tableCount, reflection.tables.count);
      gl.uniform2f(uniforms.reflectance, reflection.reflectance[0], reflection.reflectance[1] ?? 0);
      gl.uniform1f(uniforms.damping, reflection.damping);
      gl.uniform4f(uniforms.grid, ...reflection.mirror.grid);
      gl.uniform1f(uniforms.texel, reflection.mirror.texel);
    }
    if (spiral) gl.uniform1i(uniforms.spiralCount, spiral.count);
    if (kept) {
      const order = nearestKept(kept, centre, eye);
      gl.uniform1iv(uniforms["keptOrder[0]"], order);
      gl.uniform1i(uniforms.keptCount, order.length);
      gl.uniform1i(uniforms.keptBlended, kept.blended);
      gl.uniform1f(uniforms.keptTop, kept.top);
      gl.uniform1f(uniforms.keptFalloff, kept.falloff);
      gl.uniform1f(uniforms.keptSharpness, kept.sharpness);
    }
  }

  // Picture of a camera with one ray a pixel: {width, height, rgba}, rows from the top.
  render(camera, options = {}) {
    const { gl } = this, { width, height } = camera;
    const frame = gl.createFramebuffer(), color = gl.createRenderbuffer(), depth = gl.createRenderbuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    for (const [buffer, format, place] of [
      [color, gl.RGBA8, gl.COLOR_ATTACHMENT0], [depth, gl.DEPTH_COMPONENT32F, gl.DEPTH_ATTACHMENT],
    ]) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
    }
    this.draw(camera, { ...options, turned: true });
    const rgba = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
    gl.deleteRenderbuffer(color);
    gl.deleteRenderbuffer(depth);
    return { width, height, rgba };
  }
}

// Nearest and farthest depth of a ball around the scene's centre; a depth buffer tells surfaces apart the worse, the less
// the nearest is of the farthest.
function depthRange(toCentre, radius, least = 1e-3) {
  const far = toCentre + radius;
  return [Math.max(toCentre - radius, far * least), far];
}

const CALLS = {
  reflection: "light = addReflection(light, position, n, weights);",
  spiral: "light = addResiduals(light, position);",
  photos: "light = fromPhotos(light, position, n);",
};

// A program for surfaces, and the places of its uniforms.
function buildShader(gl, scene) {
  const program = buildProgram(gl, VERTEX_SHADER, fragmentShader(scene));
  return { program, uniforms: listUniforms(gl, program) };
}

// The fragment shader with those components that the scene has, in its order.
function fragmentShader({ reflection, spiral, kept, kinds }) {
  const calls = kinds.map((kind) => CALLS[kind]);
  const change = `vec3 changeWithView(vec3 light, vec3 position, vec3 n, vec2 weights) { ${calls.join(" ")} return light; }`;
  const parts = [reflection ? REFLECTION_SHADER : "", spiral ? SPIRAL_SHADER : "", kept ? KEPT_SHADER : "", change];
  return FRAGMENT_HEAD + parts.join("") + FRAGMENT_MAIN;
}

function buildProgram(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

function listUniforms(gl, program) {
  const found = {};
  for (let n = 0; n < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); n++) {
    const { name } = gl.getActiveUniform(program, n);
    found[name] = gl.getUniformLocation(program, name);
  }
  return found;
}
