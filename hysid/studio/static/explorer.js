// A record in a notebook: the plots of plots.js, with rows from Python and the chosen ones sent back.
import { columnsOf, h, LoopPlot, loopCurves, TimePlot } from "./plots.js";

function render({ model, el }) {
  const timeAt = h("div"), loopAt = h("div", { role: "img" }), said = h("p", { class: "said" });
  const all = h("button", { onclick: () => time.all() }, "Show all");
  const forget = h("button", { onclick: () => { time.clear(); loops.clear(); choose([]); } }, "Choose none");
  el.append(h("div", { class: "hysid-explorer" }, h("div", { class: "plots" }, timeAt, loopAt), h("div", { class: "bar" }, said, all, forget)));
  const ask = () => model.send({ view: time.view });
  const choose = (chosen) => {
    model.set("chosen", chosen);
    model.save_changes();
  };
  const time = new TimePlot(timeAt, {
    ask, hovered: (at) => loops.point(at),
    brushed: (low, high) => { loops.clear(); choose([low, high, null]); },
  });
  const loops = new LoopPlot(loopAt, { brushed: (edges) => { time.clear(); choose([...(time.view ?? [null, null]), edges]); } });
  const tell = () => { said.textContent = model.get("said"); };
  const show = (about, buffers) => {
    const view = buffers[0];
    const bytes = new Uint8Array(view.buffer ?? view, view.byteOffset ?? 0, view.byteLength).slice().buffer;
    const [rows, ofLoops] = columnsOf(bytes, about.shapes);
    time.show(rows, about.names, true);
    loops.show(loopCurves(ofLoops, about.joined), about.names.u, about.names.y);
    timeAt.setAttribute("aria-label", `${about.names.u} and ${about.names.y} over ${about.names.x}. Arrow keys move the view, plus and minus zoom, 0 shows all.`);
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
