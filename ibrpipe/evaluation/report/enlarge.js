// A click on a picture opens it large, with a slider between it and its view's photo; wheel, pinch and drag zoom.
(() => {
  const dialog = document.querySelector("dialog.large");
  const [slider, stage, name] = ["input", ".stage", ".name"].map((each) => dialog.querySelector(each));
  const over = dialog.querySelector(".over"), under = dialog.querySelector(".under");
  const fingers = new Map();
  let zoom = 1, x = 0, y = 0;

  const place = () => {
    x = Math.min(0, Math.max(x, stage.clientWidth * (1 - zoom)));
    y = Math.min(0, Math.max(y, stage.clientHeight * (1 - zoom)));
    for (const img of [over, under]) img.style.transform = `translate(${x}px, ${y}px) scale(${zoom})`;
    const cut = (stage.clientWidth * slider.value / 100 - x) / zoom;  // in the picture's own pixels
    under.style.clipPath = `inset(0 0 0 ${Math.max(0, cut)}px)`;
  };
  const zoomAt = (factor, left, top) => {
    const next = Math.min(16, Math.max(1, zoom * factor));
    x = left - (left - x) * next / zoom;
    y = top - (top - y) * next / zoom;
    zoom = next;
    place();
  };
  const open = (picture) => {
    const grid = picture.closest(".grid"), photo = grid && grid.querySelector("img");
    const alone = !photo || photo === picture;
    under.src = picture.src;
    over.src = photo ? photo.src : picture.src;
    name.textContent = alone ? picture.alt : `${photo.alt} | ${picture.alt}`;
    slider.style.visibility = alone ? "hidden" : "visible";
    slider.value = alone ? 0 : 50;
    zoom = 1; x = 0; y = 0;
    dialog.showModal();
    place();
  };

  for (const img of document.querySelectorAll("figure img")) {
    img.tabIndex = 0;
    img.addEventListener("click", () => open(img));
    img.addEventListener("keydown", (event) => { if (event.key === "Enter") open(img); });
  }
  slider.addEventListener("input", place);
  dialog.querySelector("button").addEventListener("click", () => dialog.close());
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = stage.getBoundingClientRect();
    zoomAt(Math.exp(-event.deltaY / 400), event.clientX - box.left, event.clientY - box.top);
  }, { passive: false });
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  stage.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const other = [...fingers.values()].find((each) => each.pointerId !== event.pointerId);
    if (other) {
      const box = stage.getBoundingClientRect();
      const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
      zoomAt(apart(event) / Math.max(apart(before), 1), other.clientX - box.left, other.clientY - box.top);
    } else {
      x += event.clientX - before.clientX;
      y += event.clientY - before.clientY;
      place();
    }
    fingers.set(event.pointerId, event);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    stage.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
})();
