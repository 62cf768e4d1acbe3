// All that is drawn, unpacked from the page.

async function unpackScene(meta, text) {
  const bytes = await inflate(text);
  const surfaces = [];
  let samples = 0;
  for (const part of meta.surfaces) {
    surfaces.push(unpackSurface(bytes, part, samples));
    samples += surfaces[surfaces.length - 1].depth.length;
  }
  const places = surfaces.map(samplePlaces);
  const weights = unpackWeights(bytes, meta.components.reflection, surfaces);
  const scene = {
    surfaces,
    samples,
    kinds: Object.keys(meta.components),
    weightsOf: (number, s) => [0, 1].map((table) => weights[number]?.[table]?.[s] ?? 1),
    mirrors: (number) => weights[number] !== null && weights[number] !== undefined,
    ...(meta.bounds ?? boundSphere(places)),
    mesh: meta.mesh ? unpackMesh(bytes, meta.mesh) : null,
    points: meta.points ? unpackPoints(bytes, meta.points) : null,
    photos: (meta.photos ?? []).map((photo) => unpackPhoto(bytes, photo)),
  };
  scene.floor = meta.floor ?? lowestAlong(places, meta.start.up);
  scene.reach = meta.reach ??
    Math.max(scene.radius, ...scene.photos.map((photo) => Math.hypot(...subtract(cameraCenter(photo), scene.centre))));
  scene.modes = modesOf(scene);
  if (meta.components.reflection) {
    const reflection = meta.components.reflection;
    scene.reflection = {
      ...reflection,
      tables: unpackTables(bytes, reflection),
      mirror: buildMirror(surfaces, scene, median(surfaces.map((surface) => surface.texel))),
    };
  }
  if (meta.components.spiral) {
    const spiral = meta.components.spiral;
    scene.spiral = {
      atlas: spiral.atlas,
      pictures: await residualPictures(bytes, spiral),
      rows: spiralRows(spiral),
      images: unpackArray(bytes, spiral.images),
      count: spiral.textures.length,
    };
  }
  if (meta.components.photos) scene.kept = await unpackKept(bytes, meta.components.photos);
  return scene;
}

// What may be shown of a scene, in the order of the list.
function modesOf({ surfaces, mesh }) {
  if (surfaces.length) return ["color", "depth", "normals", "resolution"];
  if (!mesh) return ["color"];
  return ["color", ...(mesh.sure ? ["confidence"] : []), "depth", "normals"];
}

// The picture stays coded until it is wanted; mask: a byte a pixel, 1 = shows the object, or null.
function unpackPhoto(bytes, photo) {
  const blob = new Blob([unpackArray(bytes, photo.picture)], { type: "image/webp" });
  if (!photo.mask) return { ...photo, blob, mask: null };
  const packed = unpackArray(bytes, photo.mask);
  const mask = Uint8Array.from({ length: photo.width * photo.height }, (_, n) => (packed[n >> 3] >> (7 - (n & 7))) & 1);
  return { ...photo, blob, mask };
}

function lowestAlong(places, up) {
  let lowest = Infinity;
  for (const part of places)
    for (let n = 0; n < part.length; n += 3)
      lowest = Math.min(lowest, part[n] * up[0] + part[n + 1] * up[1] + part[n + 2] * up[2]);
  return lowest;
}

// Per texture and table the weights of its samples; [] = all 1, null = no reflection.
function unpackWeights(bytes, reflection, surfaces) {
  return surfaces.map((surface, number) => {
    const own = reflection?.textures[number];
    if (!own) return null;
    return own.planes.map((entry, table) =>
      Float32Array.from(unpackPredicted(bytes, entry, surface.around), (code) => (code * own.tops[table]) / 255));
  });
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b), half = sorted.length / 2;
  return (sorted[Math.ceil(half) - 1] + sorted[Math.floor(half)]) / 2;
}

function boundSphere(places) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const part of places)
    for (let n = 0; n < part.length; n++) {
      low[n % 3] = Math.min(low[n % 3], part[n]);
      high[n % 3] = Math.max(high[n % 3], part[n]);
    }
  const centre = low.map((value, c) => (value + high[c]) / 2);
  let radius = 0;
  for (const part of places)
    for (let n = 0; n < part.length; n += 3)
      radius = Math.max(radius, Math.hypot(part[n] - centre[0], part[n + 1] - centre[1], part[n + 2] - centre[2]));
  return { centre, radius: radius || 1, low, high };
}
