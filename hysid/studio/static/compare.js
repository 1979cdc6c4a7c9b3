// Fits of several measurements side by side: loops overlaid, errors, parameters, and the page that compares them.
import { faultBox, fileLink, fill, getJson, h, number, post, quantity, say, table, word } from "./page.js";
import { LoopPlot } from "./plots.js";

const COLOURS = ["--measured", "--model", "--held", "--moved", "--input", "--excluded"];

export async function comparison(main, names, jobs, poll) {
  const chosen = new Set(names.slice(0, COLOURS.length)), cache = {};
  const loopsAt = h("div"), tableAt = h("div"), parametersAt = h("div"), written = h("div"), keyAt = h("ul", { class: "key" });
  const boxes = h("div", { class: "row", role: "group", "aria-label": "Measurements to compare" }, names.map((name) =>
    h("label", { class: "field" }, h("input", { type: "checkbox", checked: chosen.has(name), onchange: (event) => {
      if (event.target.checked) chosen.add(name);
      else chosen.delete(name);
      draw();
    } }), name)));
  const write = h("button", { type: "button", onclick: async () => {
    fill(written);
    try {
      const { number: mine } = await post("api/compare", { names: [...chosen] });
      write.disabled = true;
      let job = null;
      while (!job || job.state === "running") {
        await poll();
        job = jobs().find((one) => one.number === mine);
        await new Promise((resolve) => { setTimeout(resolve, 400); });
      }
      const place = job.result?.file;
      if (!place) throw Object.assign(new Error("failed"), { fault: job.error });
      fill(written, h("p", {}, fileLink(`comparison/${place.split(/[\\/]/).at(-1)}`, "The comparison (opens in a new tab)")));
      say("The comparison is written.");
    } catch (error) {
      fill(written, faultBox(error.fault ?? { message: String(error) }));
    }
    write.disabled = false;
  } }, "Write the page that compares them");
  fill(main, h("div", { class: "head" }, h("div", {}, h("h1", {}, "Comparison"), h("p", { class: "soft" }, "Fits of several measurements of this folder."))),
    h("section", { class: "card", "aria-labelledby": "compare-title" }, h("h2", { id: "compare-title" }, "Measurements"), boxes,
      h("div", { class: "plots even" }, h("figure", {}, h("figcaption", {}, "Measured loops."), loopsAt, keyAt), tableAt), parametersAt,
      h("div", { class: "row" }, write), written));
  const plot = new LoopPlot(loopsAt, { height: 340 });
  loopsAt.setAttribute("role", "img");
  const draw = async () => {
    const shown = names.filter((name) => chosen.has(name));
    try {
      for (const name of shown) {
        cache[name] ??= { summary: await getJson("api/summary", { name }) };
        const value = cache[name].summary.folder === "." ? "" : cache[name].summary.folder;
        cache[name].curves ??= await getJson("api/curves", { name, value });
      }
    } catch (error) {
      fill(tableAt, faultBox(error.fault ?? { message: String(error) }));
      return;
    }
    if (!tableAt.isConnected) return;
    const all = shown.map((name) => ({ name, ...cache[name] }));
    const rows = all.map(({ name, summary }) => {
      const judged = summary.metrics.test ?? summary.metrics.train;
      return { cells: [name, summary.model, `${number(judged.nrmse_percent)} %`, quantity(judged.rmse, summary.data.output.unit), word(summary.level)] };
    });
    fill(tableAt, table("Errors on held-out rows, or on the training rows where none were", ["Measurement", "model", "of range", "rms", "verdict"], rows));
    const colour = (k) => COLOURS[k % COLOURS.length];
    if (all.length) {
      const { axes } = all[0].curves;
      plot.show(all.flatMap(({ curves }, k) => curves.records.map((record) => ({ x: record.u, y: record.y, gap: record.gap.map(Boolean), colour: colour(k), width: 1.6 }))), axes.u, axes.y);
      loopsAt.setAttribute("aria-label", `Measured loops of ${shown.join(", ")}: ${axes.y} against ${axes.u}.`);
    }
    fill(keyAt, all.map(({ name }, k) => h("li", { class: `k${colour(k).slice(1)}` }, name)));
    const models = new Set(all.map(({ summary }) => summary.model));
    const listed = models.size === 1 ? all[0].summary.parameters.map((one) => one.name) : [];
    fill(parametersAt, listed.length > 0 && table(`Parameters of ${[...models][0]}, with standard errors`, ["Parameter", ...shown], listed.map((name) => ({
      cells: [name, ...all.map(({ summary }) => {
        const one = summary.parameters.find((p) => p.name === name);
        return one ? `${quantity(one.value, one.unit, 4)}${one.stderr === null ? "" : ` ± ${number(one.stderr, 2)}`}` : "–";
      })],
    }))));
  };
  await draw();
}
