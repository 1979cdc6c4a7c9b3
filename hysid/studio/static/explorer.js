// A record in a notebook: the plots of plots.js, with rows from Python and the chosen ones sent back.
import { columnsOf, LoopPlot, loopCurves, TimePlot } from "./plots.js";

function render({ model, el }) {
  const make = (tag, words = "", text = "") => {
    const element = document.createElement(tag);
    element.className = words;
    element.textContent = text;
    return element;
  };
  const root = make("div", "hysid-explorer"), plots = make("div", "plots"), timeAt = make("div"), loopAt = make("div");
  const said = make("p", "said"), bar = make("div", "bar");
  const forget = make("button", "", "Choose none"), all = make("button", "", "Show all");
  plots.append(timeAt, loopAt);
  bar.append(said, all, forget);
  root.append(plots, bar);
  el.append(root);
  let box = null;
  const ask = () => model.send({ view: time.view, box });
  const choose = (chosen) => {
    model.set("chosen", chosen);
    model.save_changes();
  };
  const time = new TimePlot(timeAt, {
    ask, hovered: (at) => loops.point(at),
    brushed: (low, high) => { loops.clear(); choose([low, high, null]); },
  });
  const loops = new LoopPlot(loopAt, { brushed: (edges) => { time.clear(); choose([...(time.view ?? [null, null]), edges]); } });
  all.addEventListener("click", () => time.all());
  forget.addEventListener("click", () => { time.clear(); loops.clear(); choose([]); });
  const tell = () => { said.textContent = model.get("said"); };
  const show = (about, buffers) => {
    const view = buffers[0];
    const bytes = new Uint8Array(view.buffer ?? view, view.byteOffset ?? 0, view.byteLength).slice().buffer;
    const [rows, ofLoops] = columnsOf(bytes, about.shapes);
    time.show(rows, about.names, true);
    loops.show(loopCurves(ofLoops, about.joined), about.names.u, about.names.y);
    timeAt.setAttribute("aria-label", `${about.names.u} and ${about.names.y} over ${about.names.x}. Arrow keys move the view, plus and minus zoom, 0 shows all.`);
    loopAt.setAttribute("role", "img");
    loopAt.setAttribute("aria-label", `Loops: ${about.names.y} against ${about.names.u}.`);
  };
  model.on("change:said", tell);
  model.on("msg:custom", show);
  tell();
  ask();
  return () => {
    model.off("change:said", tell);
    model.off("msg:custom", show);
  };
}

export default { render };
