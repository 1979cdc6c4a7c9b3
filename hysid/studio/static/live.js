// The pictures of a report, drawn again by plots.js from their curves, which the page holds.
import { LoopPlot } from "./plots.js";

document.querySelectorAll("figure > script[type='application/json']").forEach((data, k) => {
  const { x, y, curves, limits, logarithmic } = JSON.parse(data.textContent);
  const figure = data.parentNode, picture = figure.querySelector("img"), at = document.createElement("div");
  const key = document.createElement("ul");
  at.setAttribute("role", "img");
  at.setAttribute("aria-label", picture.alt);
  key.className = "key";
  figure.prepend(key, at);
  figure.classList.add("live");
  if (!k) {
    const hint = document.createElement("p");
    hint.className = "note";
    hint.textContent = "Drag over a plot to zoom in, click twice to see it whole; a name hides its curve.";
    figure.parentNode.before(hint);
  }
  new LoopPlot(at, { height: 300, key }).show(curves, x, y, [limits], logarithmic);
});
