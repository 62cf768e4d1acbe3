// The sample page: every part's impostor, alone or in a field of copies.

import { Color, Group, Matrix4, PerspectiveCamera, Scene, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { loadImpostor } from "./impostors.three.js";

const parts = JSON.parse(document.getElementById("parts").textContent);
const select = document.getElementById("part"), count = document.getElementById("count");
const renderer = new WebGLRenderer({ antialias: true });
const camera = new PerspectiveCamera(35, 1, 0.01, 1000), controls = new OrbitControls(camera, renderer.domElement);
const scene = new Scene(), upright = new Group();
upright.rotation.x = -Math.PI / 2; // parts have z up
scene.add(upright);
document.querySelector("main").append(renderer.domElement);
for (const { name, folder } of parts) select.append(new Option(name, folder));

async function show() {
  const impostor = await loadImpostor(`./${select.value}/`), { center, radius } = impostor.facts, wide = Number(count.value);
  const matrices = [];
  for (let y = 0; y < wide; y++)
    for (let x = 0; x < wide; x++) {
      const step = 1.6 * radius, at = [(x - (wide - 1) / 2) * step, (y - (wide - 1) / 2) * step];
      matrices.push(new Matrix4().makeTranslation(at[0] - center[0], at[1] - center[1], -center[2]));
    }
  upright.clear();
  const mesh = impostor.copies(matrices);
  mesh.frustumCulled = false;
  upright.add(mesh);
  const away = (2.6 + 1.7 * (wide - 1)) * radius;
  camera.near = 0.05 * radius;
  camera.far = 20 * away;
  camera.position.set(0.9 * away, 0.6 * away, 1.2 * away);
  controls.target.set(0, 0, 0);
  resize();
}

function resize() {
  const { clientWidth: width, clientHeight: height } = document.querySelector("main");
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  renderer.setSize(width, height);
}

const dark = matchMedia("(prefers-color-scheme: dark)");
const paint = () => { scene.background = new Color(dark.matches ? "#17181a" : "#f4f3f0"); };
dark.addEventListener("change", paint);
paint();
select.addEventListener("change", show);
count.addEventListener("change", show);
window.addEventListener("resize", resize);
await show();
renderer.setAnimationLoop(() => { controls.update(); renderer.render(scene, camera); });
window.impostors = { ready: true };
