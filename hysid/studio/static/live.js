// The pictures of a report, drawn again by plots.js from their curves, which the page holds.
import { h, LoopPlot } from "./plots.js";

document.querySelectorAll("figure > script[type='application/json']").forEach((data, k) => {
  const { x, y, curves, limits, logarithmic } = JSON.parse(data.textContent);
  const figure = data.parentNode, key = h("ul", { class: "key" });
  const at = h("div", { role: "img", "aria-label": figure.querySelector("img").alt });
  figure.prepend(key, at);
  figure.classList.add("live");
  if (!k) figure.parentNode.before(h("p", { class: "note" }, "Drag over a plot to zoom in, click twice to see it whole; a name hides its curve."));
  new LoopPlot(at, { height: 300, key }).show(curves, x, y, [limits], logarithmic);
});
