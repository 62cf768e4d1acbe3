// Annotations beside the surface, saved views, and the scale bar.

function placeNotes(layer, notes, orbit, go) {
  const panel = document.getElementById("note");
  const marks = notes.map((note, n) => {
    const mark = document.createElement("button");
    mark.className = "mark";
    mark.textContent = String(n + 1);
    mark.setAttribute("aria-label", note.title || note.text);
    mark.addEventListener("click", () => {
      panel.querySelector("h2").textContent = note.title || `Note ${n + 1}`;
      panel.querySelector("p").textContent = note.text;
      panel.hidden = false;
      document.getElementById("keys").hidden = true;
      if (note.eye) go({ eye: note.eye, target: note.at });
    });
    layer.append(mark);
    return mark;
  });
  panel.querySelector("button").addEventListener("click", () => { panel.hidden = true; });
  // Put every mark where its point is seen; ratio: device pixels per CSS pixel.
  return function follow(camera, ratio, hidden) {
    const k = camera.K.flat(), m = camera.cam_from_world.flat();
    notes.forEach((note, n) => {
      const [x, y, z] = [0, 1, 2].map((r) => dot(m.slice(4 * r, 4 * r + 3), note.at) + m[4 * r + 3]);
      marks[n].hidden = z <= 0;
      marks[n].style.left = `${((k[0] * x) / z + k[2]) / ratio}px`;
      marks[n].style.top = `${((k[4] * y) / z + k[5]) / ratio}px`;
      if (hidden) marks[n].classList.toggle("behind", hidden[n]);
    });
  };
}

// Which notes lie behind the surface: a picture of one pixel in the depth mode tells.
function hiddenNotes(renderer, notes, camera) {
  const m = camera.cam_from_world.flat(), k = camera.K.flat(), eye = cameraCenter(camera), { scene } = renderer;
  const [near, far] = depthRange(Math.hypot(...subtract(eye, scene.centre)), 1.01 * scene.radius);
  return notes.map((note) => {
    const [x, y, z] = [0, 1, 2].map((r) => dot(m.slice(4 * r, 4 * r + 3), note.at) + m[4 * r + 3]);
    const aim = { ...camera, K: [[k[0], 0, 0.5 - (k[0] * x) / z], [0, k[4], 0.5 - (k[4] * y) / z], [0, 0, 1]], width: 1, height: 1 };
    const [shade, , , alpha] = renderer.render(aim, { mode: "depth" }).rgba;
    const found = near + ((1 - shade / 255) / 0.85) * (far - near);
    return alpha > 0 && Math.hypot(...subtract(note.at, eye)) > found + 0.04 * (far - near);
  });
}

// Length of the scale bar: the longest of 1, 2, 5 x 10^n units within 140 CSS pixels.
function scaleBar(perUnit, units) {
  const most = 140 / perUnit, power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((n) => n * power).find((value) => value <= most);
  return { width: length * perUnit, text: `${Number(length.toPrecision(2))} ${units}` };
}
