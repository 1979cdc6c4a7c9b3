// Fits of several measurements side by side: loops on the same axes, figures and parameters in columns.
import { Deed, faultOf, fileLink, fill, getJson, h, number, quantity, table, word } from "./page.js";
import { LoopPlot } from "./plots.js";

const MOST = 6;

/** Fill an element with the comparison of fits; returns the button's deed. */
export function comparison(main, names, studio) {
  const chosen = new Set(names.slice(0, MOST)), cache = {}, shown = () => names.filter((name) => chosen.has(name));
  const loopsAt = h("div", { class: "specimens" }), tablesAt = h("div");
  const boxes = h("div", { class: "row", role: "group", "aria-label": "Measurements to compare" }, names.map((name) =>
    h("label", { class: "field" }, h("input", { type: "checkbox", checked: chosen.has(name), onchange: (event) => {
      if (event.target.checked) chosen.add(name);
      else chosen.delete(name);
      draw();
    } }), name)));
  const write = new Deed(studio, "compare", "Write the page that compares them", {
    options: () => ({ names: shown(), value: shown().join("\n") }),
    answer: (job) => h("p", {}, fileLink(`comparison/${job.result.file.split(/[\\/]/).at(-1)}`, "The comparison (opens in a new tab)")),
  });
  fill(main, h("div", { class: "head" }, h("div", {}, h("h1", {}, "Comparison"), h("p", { class: "soft" }, "Fits of several measurements of this folder, side by side."))),
    h("section", { class: "card", "aria-labelledby": "compare-title" }, h("h2", { id: "compare-title" }, "Measurements"), boxes, loopsAt,
      h("ul", { class: "key" }, h("li", { class: "k-under" }, "measured"), h("li", { class: "k-model" }, "model")), tablesAt, write.element));
  const draw = async () => {
    write.update();
    try {
      for (const name of shown()) {
        if (cache[name]) continue;
        const summary = await getJson("api/summary", { name });
        cache[name] = { name, summary, curves: await getJson("api/curves", { name, value: summary.folder === "." ? "" : summary.folder }) };
      }
    } catch (error) {
      fill(tablesAt, faultOf(error));
      return;
    }
    if (!tablesAt.isConnected) return;
    const all = shown().filter((name) => cache[name]).map((name) => cache[name]);
    const curvesOf = ({ curves: { records } }) => records.flatMap(({ u, y, model, gap }) => [["measured", y, "--under", 4], ["model", model, "--model", 1.4]].map(([name, values, colour, width]) => ({ name, x: u, y: values, gap: gap.map(Boolean), colour, width })));
    // One scale for those that have the same axes: what is larger looks larger.
    const axesOf = ({ curves: { axes } }) => `${axes.u} ${axes.y}`;
    fill(loopsAt, all.map(({ name, summary }) => h("figure", {}, h("figcaption", {}, h("strong", {}, name), " ", word(summary.level), summary.stale && " of other choices"), h("div", { role: "img", "aria-label": `Loops of ${name} and of its model` }))));
    all.forEach((one, k) => {
      const { axes } = one.curves, plot = new LoopPlot(loopsAt.children[k].lastElementChild, { height: 240 });
      plot.show(curvesOf(one), axes.u, axes.y, all.filter((other) => axesOf(other) === axesOf(one)).flatMap(curvesOf));
    });
    const figures = (of) => [...new Set(all.flatMap(({ summary }) => of(summary).map((one) => one.name)))].map((name) => ({ cells: [name, ...all.map(({ summary }) => {
      const one = of(summary).find((other) => other.name === name), error = one?.error ?? one?.stderr ?? null;
      return !one || one.value === null ? "–" : `${quantity(one.value, one.unit, 4)}${error === null ? "" : ` ± ${number(error, 2)}`}`;
    })] }));
    const judged = ({ metrics }) => metrics.test ?? metrics.train;
    const line = (name, of) => ({ cells: [name, ...all.map(({ summary }) => of(summary))] });
    const head = ["Figure", ...all.map(({ name }) => name)], models = new Set(all.map(({ summary }) => summary.model));
    const listed = models.size === 1 ? figures((summary) => summary.parameters) : [];
    fill(tablesAt, all.length > 0 && [table("The fits; errors on held-out rows, or on the training rows where none were", head, [
      line("verdict", (one) => word(one.level)), line("model", (one) => one.model), line("error of the range", (one) => `${number(judged(one).nrmse_percent)} %`),
      line("error, rms", (one) => quantity(judged(one).rmse, one.data.output.unit))]),
    table("The specimens, by their models over the fitted rows", head, figures((summary) => summary.characteristics)),
    listed.length > 0 && table(`Parameters of ${[...models][0]}, with standard errors`, head, listed)]);
  };
  draw();
  return write;
}
