// What stands around the object or in its place: mesh, points, photos on frusta, a grid on the floor, the world's axes.

const THUMBNAIL = 128, ATLAS_SIDE = 2048;
const THUMBNAILS_A_PAGE = (ATLAS_SIDE / THUMBNAIL) ** 2;
const TRAIN = [64, 125, 214], HELD_OUT = [222, 120, 31], CHOSEN = [230, 60, 90];
const AXES = [[214, 60, 60], [70, 160, 70], [70, 110, 230]];

class Stage {
  constructor(gl, scene, up, changed) {
    Object.assign(this, { gl, scene, up: unit(up), changed, chosen: -1, loaded: 0, programs: {} });
    if (scene.mesh) this.mesh = this.meshArray(scene.mesh);
    if (scene.points) this.points = this.pointArray(scene.points);
    if (!scene.photos.length) return;
    this.frusta = frustaOf(scene);
    this.planes = this.planeArray(this.frusta);
    this.frame = this.lineArray(() => [...this.gridLines(), ...this.axisLines(), ...this.frustumLines()]);
  }

  program(name, vertex, fragment) {
    if (!this.programs[name]) {
      const program = buildProgram(this.gl, vertex, fragment);
      this.programs[name] = { program, uniforms: listUniforms(this.gl, program) };
    }
    return this.programs[name];
  }

  // A vertex array of interleaved attributes: [name, numbers, type, normalized, values] each, in buffers of their own.
  array(program, attributes, divisor = 0) {
    const { gl } = this, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = attributes.map(([name, size, type, normalized, values]) => {
      const at = gl.getAttribLocation(program, name), buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      if (at < 0) return buffer;
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, type, normalized, 0, 0);
      gl.vertexAttribDivisor(at, divisor);
      return buffer;
    });
    return { array, buffers };
  }

  meshArray({ places, normals, colors, faces }) {
    const { gl } = this, { program } = this.program("mesh", MESH_VERTEX, MESH_FRAGMENT);
    const { array } = this.array(program, [
      ["place", 3, gl.FLOAT, false, places], ["normal", 3, gl.FLOAT, false, normals],
      ["color", 4, gl.UNSIGNED_BYTE, true, colors],
    ]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { array, count: faces.length };
  }

  pointArray({ places, colors }) {
    const { gl } = this, { program } = this.program("points", POINT_VERTEX, POINT_FRAGMENT);
    const { array } = this.array(program, [
      ["place", 3, gl.FLOAT, false, places], ["color", 4, gl.UNSIGNED_BYTE, true, colors],
    ]);
    return { array, count: places.length / 3 };
  }

  // lines: function that gives [first, last, colour of four bytes] each; asked again when colours change
  lineArray(lines) {
    const { gl } = this, { program } = this.program("lines", LINE_VERTEX, LINE_FRAGMENT), all = lines();
    const part = (n) => Float32Array.from(all.flatMap((line) => line[n]));
    const colors = () => Uint8Array.from(lines().flatMap((line) => line[2]));
    const { array, buffers } = this.array(program, [
      ["first", 3, gl.FLOAT, false, part(0)], ["last", 3, gl.FLOAT, false, part(1)],
      ["color", 4, gl.UNSIGNED_BYTE, true, colors()],
    ], 1);
    const paint = () => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[2]);
      gl.bufferData(gl.ARRAY_BUFFER, colors(), gl.STATIC_DRAW);
    };
    return { array, count: all.length, paint };
  }

  planeArray(frusta) {
    const { gl } = this, { program } = this.program("planes", PLANE_VERTEX, PLANE_FRAGMENT);
    const values = (of) => Float32Array.from(frusta.flatMap(of));
    const cells = this.scene.photos.map((_, n) => thumbnailCell(n));
    const numbers = (of) => Float32Array.from(cells.flatMap(of));
    const { array } = this.array(program, [
      ["corner", 3, gl.FLOAT, false, values(({ corners }) => corners[0])],
      ["across", 3, gl.FLOAT, false, values(({ corners: [a, b] }) => subtract(b, a))],
      ["down", 3, gl.FLOAT, false, values(({ corners: [a, , , d] }) => subtract(d, a))],
      ["cell", 4, gl.FLOAT, false, numbers(({ x, y }) => [x, y, THUMBNAIL, THUMBNAIL].map((v) => v / ATLAS_SIDE))],
      ["page", 1, gl.FLOAT, false, numbers(({ page }) => page)],
    ], 1);
    return { array };
  }

  // Small pictures on the image planes; they appear as they are decoded.
  async loadThumbnails(unit) {
    const { gl, scene: { photos } } = this, layered = gl.TEXTURE_2D_ARRAY;
    this.unit = unit;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(layered, gl.createTexture());
    gl.texStorage3D(layered, 1, gl.RGBA8, ATLAS_SIDE, ATLAS_SIDE, Math.ceil(photos.length / THUMBNAILS_A_PAGE));
    gl.texParameteri(layered, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    for (const [n, photo] of photos.entries()) {
      const size = { resizeWidth: THUMBNAIL, resizeHeight: THUMBNAIL, resizeQuality: "medium" };
      const picture = await createImageBitmap(photo.blob, size), { x, y, page } = thumbnailCell(n);
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.texSubImage3D(layered, 0, x, y, page, THUMBNAIL, THUMBNAIL, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture);
      this.loaded = n + 1;
      if (n % 16 === 15 || n + 1 === photos.length) this.changed();
    }
  }

  choose(n) {
    this.chosen = n;
    this.frame.paint();
  }

  *frustumLines() {
    for (const [n, { eye, corners }] of this.frusta.entries()) {
      const color = [...(n === this.chosen ? CHOSEN : this.scene.photos[n].heldOut ? HELD_OUT : TRAIN), 255];
      for (let c = 0; c < 4; c++) {
        yield [eye, corners[c], color];
        yield [corners[c], corners[(c + 1) % 4], color];
      }
    }
  }

  *gridLines() {
    const { scene: { centre, floor }, up } = this, reach = 1.25 * this.scene.reach, step = niceStep(reach / 6);
    const east = unit(cross(Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0], up)), north = cross(up, east);
    const foot = add(centre, up, floor - dot(centre, up)), lines = Math.floor(reach / step);
    for (let n = -lines; n <= lines; n++) {
      const half = Math.sqrt(Math.max(0, (lines * step) ** 2 - (n * step) ** 2)), color = [128, 128, 128, n ? 70 : 130];
      for (const [one, other] of [[east, north], [north, east]]) {
        const middle = add(foot, one, n * step);
        yield [add(middle, other, -half), add(middle, other, half), color];
      }
    }
  }

  *axisLines() {
    const { scene: { centre, floor, radius }, up } = this, foot = add(centre, up, floor - dot(centre, up));
    for (let axis = 0; axis < 3; axis++)
      yield [foot, foot.map((value, c) => value + (c === axis ? 0.5 * radius : 0)), [...AXES[axis], 255]];
  }

  // camera: as the renderer draws; show: which of mesh, points and photos are wanted; ratio: pixels per CSS pixel
  draw(camera, clip, eye, range, { mode, show, ratio = 1 }) {
    const { gl, scene } = this;
    const use = (name) => {
      const { program, uniforms } = this.programs[name];
      gl.useProgram(program);
      gl.uniformMatrix4fv(uniforms.clipFromWorld, true, clip);
      return uniforms;
    };
    if (this.mesh && show.mesh) {
      const uniforms = use("mesh");
      gl.uniform3f(uniforms.eye, ...eye);
      gl.uniform1i(uniforms.mode, MODES.indexOf(mode));
      gl.uniform2f(uniforms.depthRange, ...range);
      gl.uniform1i(uniforms.painted, scene.mesh.painted);
      gl.bindVertexArray(this.mesh.array);
      gl.drawElements(gl.TRIANGLES, this.mesh.count, gl.UNSIGNED_INT, 0);
    }
    if (this.points && show.points) {
      gl.uniform1f(use("points").size, 2.5 * ratio);
      gl.bindVertexArray(this.points.array);
      gl.drawArrays(gl.POINTS, 0, this.points.count);
    }
    if (this.frusta && show.photos) this.drawPhotos(camera, eye, use, ratio);
    gl.bindVertexArray(null);
  }

  drawPhotos(camera, eye, use, ratio) {
    const { gl } = this;
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const uniforms = use("lines");
    gl.uniform2f(uniforms.pixel, 2 / camera.width, 2 / camera.height);
    gl.uniform1f(uniforms.width, 1.4 * ratio);
    gl.bindVertexArray(this.frame.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.frame.count);
    if (this.loaded) {
      const { thumbnails, eye: place } = use("planes");
      gl.uniform1i(thumbnails, this.unit);
      gl.uniform3f(place, ...eye);
      gl.bindVertexArray(this.planes.array);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.loaded);
    }
    gl.disable(gl.BLEND);
  }
}

function thumbnailCell(n) {
  const inPage = n % THUMBNAILS_A_PAGE, wide = ATLAS_SIDE / THUMBNAIL;
  return { page: Math.floor(n / THUMBNAILS_A_PAGE), x: THUMBNAIL * (inPage % wide), y: THUMBNAIL * Math.floor(inPage / wide) };
}

// The longest of 1, 2, 5 x 10^n that is not above a length.
function niceStep(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((n) => n * power).find((value) => value <= most * 1.0000001);
}

// Eye and four corners of the image plane of every photo, so large that neighbours hardly overlap.
function frustaOf({ photos, reach }) {
  const eyes = photos.map(cameraCenter);
  const nearest = eyes.map((eye, n) =>
    Math.min(...eyes.map((other, m) => (m === n ? Infinity : Math.hypot(...subtract(eye, other))))));
  const spaced = nearest.filter(Number.isFinite).sort((a, b) => a - b);
  const size = Math.min(0.2 * reach, Math.max(0.05 * reach, 0.7 * (spaced[spaced.length >> 1] ?? reach)));
  return photos.map((photo, n) => {
    const k = photo.K.flat(), m = photo.cam_from_world.flat(), { width, height } = photo;
    const depth = Math.min(1.1 * size, (size * k[0]) / Math.hypot(width, height));
    const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([x, y]) => {
      const v = (y - k[5]) / k[4], u = (x - k[2] - k[1] * v) / k[0];
      return [0, 1, 2].map((c) => eyes[n][c] + depth * (m[c] * u + m[4 + c] * v + m[8 + c]));
    });
    return { eye: eyes[n], corners };
  });
}
