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
    ...boundSphere(places),
  };
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
  return scene;
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
