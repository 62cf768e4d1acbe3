// The object turns by itself and lets the report scroll; a click takes hold of it, and Let go gives it back.
(() => {
  const table = document.querySelector(".turntable");
  if (!table) return;
  const hold = (held) => {
    table.classList.toggle("held", held);
    if (held) table.querySelector("iframe").focus();
  };
  table.querySelector(".take").addEventListener("click", () => hold(true));
  table.querySelector(".leave").addEventListener("click", () => hold(false));
})();
