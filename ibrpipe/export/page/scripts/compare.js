// The panel of a photo: the photo over the view, the page's own picture, the difference of both and what it amounts to.

const FULL_ERROR = 48; // 8-bit codes that are drawn as the brightest

class Comparison {
  // element: function from an id to the page's element; render: function from a camera to the page's picture
  constructor(element, tour, { render, changed }) {
    Object.assign(this, { element, tour, render, changed, shown: "photo", pixels: null });
    this.overlay = element("overlay");
    element("opacity").addEventListener("input", () => this.show(this.shown === "difference" ? "photo" : this.shown));
    for (const button of element("compare").querySelectorAll("button"))
      button.addEventListener("click", () => {
        if (button.dataset.show !== "difference") element("opacity").value = button.dataset.show === "photo" ? 100 : 0;
        this.show(button.dataset.show);
      });
    element("compare").hidden = !tour.scene.surfaces.length;
  }

  // Open the panel for the photo of the tour, or close it.
  async open() {
    const { photo, scene, chosen } = this.tour, { element } = this;
    element("photo").hidden = !photo;
    this.overlay.hidden = true;
    this.pixels = null;
    if (!photo) return;
    element("photo-name").textContent = photo.name;
    element("photo-number").textContent = `${chosen + 1} of ${scene.photos.length}${photo.heldOut ? ", held out" : ""}`;
    element("error").textContent = "";
    const picture = await createImageBitmap(photo.blob);
    if (this.tour.photo !== photo) return;
    Object.assign(this.overlay, { width: photo.width, height: photo.height });
    const context = this.overlay.getContext("2d", { willReadFrequently: true });
    context.drawImage(picture, 0, 0);
    this.pixels = context.getImageData(0, 0, photo.width, photo.height);
    this.show(this.shown);
  }

  show(what) {
    const { element, overlay, pixels } = this, { photo } = this.tour;
    this.shown = what;
    for (const button of element("compare").querySelectorAll("button"))
      button.setAttribute("aria-pressed", button.dataset.show === what);
    if (!pixels || !photo) return;
    const compared = this.tour.scene.surfaces.length ? differenceOf(photo, pixels.data, renderLike(photo, this.render)) : null;
    if (compared) element("error").textContent = toldError(photo, compared.psnr);
    const context = overlay.getContext("2d");
    context.putImageData(what === "difference" ? new ImageData(compared.picture, photo.width, photo.height) : pixels, 0, 0);
    overlay.style.opacity = what === "difference" ? 1 : element("opacity").value / 100;
    this.changed();
  }

  // Lay the photo where the view shows it; place null: it does not.
  place(place, ratio) {
    const { overlay } = this, { photo } = this.tour;
    overlay.hidden = !place || !this.pixels;
    if (overlay.hidden) return;
    const { left, top, scale } = place;
    Object.assign(overlay.style, {
      left: `${left / ratio}px`, top: `${top / ratio}px`,
      width: `${(scale * photo.width) / ratio}px`, height: `${(scale * photo.height) / ratio}px`,
    });
  }
}

// The page's picture from where a photo was taken, as reports measure: the mean of those of four rays that hit, linear light.
function renderLike(photo, render) {
  const { rgba } = render(resized(photo, 2 * photo.width, 2 * photo.height)), wide = 8 * photo.width;
  const light = Float32Array.from({ length: 256 }, (_, code) => {
    const v = code / 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  });
  const out = new Uint8ClampedArray(4 * photo.width * photo.height);
  for (let n = 0; n < out.length; n += 4) {
    const first = 2 * wide * Math.floor(n / 4 / photo.width) + 8 * ((n / 4) % photo.width);
    const rays = [first, first + 4, first + wide, first + wide + 4].filter((at) => rgba[at + 3]);
    for (let c = 0; c < 3; c++) {
      const v = rays.reduce((sum, at) => sum + light[rgba[at + c]], 0) / Math.max(rays.length, 1);
      out[n + c] = 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
    }
  }
  return out;
}

// Picture of the error of every pixel that counts, and PSNR over them; what the page leaves empty counts as black.
function differenceOf({ mask }, photo, rendered) {
  const picture = new Uint8ClampedArray(photo.length);
  let sum = 0, count = 0;
  for (let n = 0; n < photo.length; n += 4) {
    const inside = !mask || mask[n >> 2];
    let error = 0;
    for (let c = 0; c < 3; c++) {
      const off = photo[n + c] - rendered[n + c];
      error = Math.max(error, Math.abs(off));
      if (inside) sum += off * off;
    }
    count += inside ? 3 : 0;
    picture.set(inside ? [...glow(error / FULL_ERROR), 255] : [0, 0, 0, 255], n);
  }
  return { picture, psnr: count ? 10 * Math.log10((255 * 255 * count) / Math.max(sum, 1e-9)) : null };
}

// From black over red and yellow to white.
const glow = (t) => [0, 1, 2].map((c) => 255 * Math.max(0, Math.min(1, 3 * t - c)));

function toldError(photo, psnr) {
  const here = psnr === null ? "" : `${psnr.toFixed(1)} dB here, ${photo.width} × ${photo.height} pixels`;
  return [photo.psnr === null ? "" : `${photo.psnr.toFixed(1)} dB in the report`, here].filter(Boolean).join("; ");
}
