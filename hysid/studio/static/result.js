// A fit: its verdict, candidates, loops, residuals, parameters, posterior, compensator, files.
import { faultBox, fileLink, fill, getJson, h, number, post, quantity, sameLines, sentence, table, word } from "./page.js";
import { LoopPlot } from "./plots.js";

const TARGETS = { arduino: "Arduino and PlatformIO", ros2: "ROS 2", mujoco: "MuJoCo", sklearn: "scikit-learn", onnx: "ONNX", fmu: "FMU, FMI 2.0", fmu3: "FMU, FMI 3.0" };
const OTHERS = ["--held", "--moved", "--input", "--measured"];
const gapped = (record, y, more) => ({ x: record.u, y, gap: record.gap.map(Boolean), ...more });

export class ResultPanel {
  constructor(name, start) {
    this.name = name;
    this.start = start;
    this.element = h("div");
    this.value = "";
    this.written = {};
  }

  async show(look, files, targets) {
    this.look = look;
    this.targets = targets;
    const found = look.result;
    if (!found) {
      fill(this.element, look.result_fault ? faultBox(look.result_fault) : "");
      return;
    }
    this.value = found.value;
    const place = h("div");
    fill(this.element, this.verdict(found), place);
    const serial = this.serial = (this.serial ?? 0) + 1;
    try {
      const curves = await getJson("api/curves", { name: this.name, value: found.folder === "." ? "" : found.folder });
      if (serial !== this.serial) return;
      this.folder = found.folder === "." ? "" : found.folder;
      place.replaceWith(this.loops(found, curves), this.parameters(found, curves), this.compensator(found, files), this.files(found));
      this.draw(curves);
      if (found.posterior) this.drawPosterior(found);
    } catch (error) {
      if (serial === this.serial) fill(place, faultBox(error.fault ?? { message: String(error) }));
    }
  }

  verdict(found) {
    const judged = found.metrics.test ?? found.metrics.train, unit = found.data.output.unit;
    const words = found.metrics.test ? "held-out" : "training";
    const fact = (name, value) => h("div", {}, h("dt", {}, name), h("dd", {}, value));
    return h("section", { class: `card verdict ${found.level}`, "aria-labelledby": "verdict-title", id: "verdict" },
      h("h2", { id: "verdict-title" }, word(found.level), found.headline),
      found.stale && h("p", {}, h("strong", {}, "The configuration was changed since this fit. "), "Fit again to judge the present one."),
      found.values.length > 0 && h("label", { class: "field" }, `${found.values.length} fits, one for each value: `,
        h("select", { onchange: (event) => this.pick(event.target.value) }, found.values.map((value) => h("option", { value, selected: value === found.value }, value)))),
      found.characteristics.length > 0 && [h("dl", { class: "facts" }, found.characteristics.map((one) => fact(one.name,
        [one.value === null ? "not told" : `${number(one.value)} ± ${quantity(one.error, one.unit === "percent" ? "%" : one.unit, 2)}`, h("small", {}, one.reason || one.basis)]))),
      h("p", { class: "soft" }, "The specimen, by the model over the fitted rows. ± is how far the readings of the same cycles or holds are from that.")],
      h("ul", {}, found.reasons.map((reason) => h("li", {}, sentence(reason)))),
      h("dl", { class: "facts" }, fact(`${words} error, rms`, quantity(judged.rmse, unit)),
        fact("of the range", quantity(judged.nrmse_percent, "%")), fact("largest", quantity(judged.max_abs, unit)), fact("purpose", found.purpose)));
  }

  async pick(value) {
    try {
      const result = await getJson("api/summary", { name: this.name, value });
      this.show({ ...this.look, result }, this.filesThere, this.targets);
    } catch (error) {
      this.element.prepend(faultBox(error.fault ?? { message: String(error) }));
    }
  }

  loops(found, curves) {
    const row = (one, extra) => ({
      ...extra, cells: [one.drawn ?? one.model, number(one.score_percent), number((one.test ?? one.train)?.nrmse_percent), number((one.test ?? one.train)?.rmse),
        one.level ? word(one.level) : ""],
    });
    this.overlaid = new Set();
    const drawn = (one, loop) => loop ? h("label", { class: "field" }, h("input", { type: "checkbox", onchange: (event) => {
      if (event.target.checked) this.overlaid.add(loop);
      else this.overlaid.delete(loop);
      this.drawLoops();
    } }), h("span", { class: "unseen" }, "Draw the loop of "), one.model) : one.model;
    const rows = [
      ...found.candidates.map((one, k) => row({ ...one, drawn: drawn(one, k && curves.candidates[k - 1]) }, { class: k ? "" : "strong" })),
      ...found.baselines.map((one, k) => row({ ...one, drawn: drawn(one, curves.baselines[k]) }, { class: "baseline" })),
    ];
    const skipped = Object.entries(found.skipped);
    this.loopAt = h("div");
    this.residualAt = h("div");
    this.residualInput = h("div");
    const chart = (caption, at) => h("figure", {}, h("figcaption", {}, caption), at);
    return h("section", { class: "card", "aria-labelledby": "models-title" },
      h("h2", { id: "models-title" }, "Models and baselines"),
      h("div", { class: "plots models" },
        h("figure", {}, h("figcaption", {}, "Loops: the thin line of the model should lie inside the broad measured one."), this.loopAt,
          h("ul", { class: "key" }, h("li", { class: "k-under" }, "measured"), curves.records.length > 1 && h("li", { class: "k-held-under" }, "measured, held out"),
            h("li", { class: "k-model" }, `${found.model}`),
            curves.excluded && h("li", { class: "k-excluded" }, "excluded from the fit"), curves.sliders.length > 0 && h("li", { class: "k-moved" }, "with the sliders")), this.otherKey = h("ul", { class: "key" })),
        h("div", {}, curves.candidates.length + curves.baselines.length > 0 && h("p", { class: "soft" }, "Tick a model or a baseline to draw its loop over the training rows. Folds are training rows that were held out to choose among the models."), table(`Errors${found.metrics.test ? " on held-out rows" : ""}; the best model first, baselines in italics`, ["Model", "folds, %", "of range, %", `rms${found.data.output.unit === "1" ? "" : `, ${found.data.output.unit}`}`, "verdict"], rows),
          skipped.length > 0 && h("details", { class: "same" }, h("summary", {}, `${skipped.length} skipped`), h("ul", {}, skipped.map(([name, why]) => h("li", {}, `${name}: ${why}`)))))),
      h("h3", {}, "Residuals"),
      h("div", { class: "plots even" }, chart(`Over ${curves.axes.x}: a pattern shows what the model misses.`, this.residualAt), chart("Over the input.", this.residualInput)),
      sameLines(this.look.equivalents.fit));
  }

  draw(curves) {
    this.curves = curves;
    const { axes, records } = curves, [train, test] = records;
    this.loopPlot = new LoopPlot(this.loopAt, { height: 340 });
    this.loopAt.setAttribute("role", "img");
    this.loopAt.setAttribute("aria-label", `Measured loops and the model: ${axes.y} against ${axes.u}.`);
    this.drawLoops();
    const y = `residual (${axes.y_unit})`;
    const dots = (record, x, name) => ({ x: record[x], y: record.residual, colour: name, width: 2.6, dots: true });
    for (const [at, x, label] of [[this.residualAt, "x", axes.x], [this.residualInput, "u", axes.u]]) {
      at.setAttribute("role", "img");
      at.setAttribute("aria-label", `Residuals over ${label}; rms ${records.map((one) => `${number(one.rms)} ${axes.y_unit} (${one.word})`).join(", ")}.`);
      const plot = new LoopPlot(at, { height: 220 });
      plot.show([dots(train, x, "--measured"), ...(test ? [dots(test, x, "--held")] : [])], label, y);
      (this.others ??= []).push(plot);
    }
  }

  drawLoops(moved = null) {
    const { axes, records: [train, test] } = this.curves, judged = test ?? train;
    const curves = [];
    if (this.curves.excluded) curves.push(gapped(this.curves.excluded, this.curves.excluded.y, { colour: "--excluded", width: 2 }));
    curves.push(gapped(train, train.y, { colour: "--under", width: 5 }));
    if (test) curves.push(gapped(test, test.y, { colour: "--held-under", width: 5 }));
    curves.push(gapped(judged, judged.model, { colour: "--model", width: 1.4 }));
    const others = [...this.overlaid].map((loop, place) => ({ ...loop, colour: OTHERS[place % OTHERS.length] }));
    for (const one of others) curves.push(gapped(one, one.model, { colour: one.colour, width: 1.6 }));
    fill(this.otherKey, others.map((one) => h("li", { class: `k${one.colour.slice(1)}` }, `${one.word}, on the training rows`)));
    if (moved) curves.push(gapped(moved, moved.model, { colour: "--moved", width: 1.6 }));
    this.loopPlot.show(curves, axes.u, axes.y);
  }

  parameters(found, curves) {
    const rows = found.parameters.slice(0, 60).map((one) => ({ cells: [one.name, quantity(one.value, one.unit, 4), one.stderr === null ? one.status : `± ${number(one.stderr, 2)}`, one.status] }));
    const more = found.parameters.length - rows.length, hidden = found.undetermined;
    return h("section", { class: "card", "aria-labelledby": "parameters-title" },
      h("h2", { id: "parameters-title" }, "What the model is made of"),
      h("p", { class: "soft" }, found.model + (hidden > 0 ? `. ${hidden} of its sums are left out: the data do not determine them one by one.` : "")),
      rows.length > 0 && h("details", { class: "same", open: hidden === 0 }, h("summary", {}, "Its parameters"), table(more > 0 ? `The first ${rows.length} of ${found.parameters.length} parameters` : "Values with their standard errors", ["Parameter", "value", "standard error", "status"], rows)),
      curves.sliders.length > 0 && [h("h3", {}, "What each one does"), this.sliders(curves.sliders)],
      h("h3", {}, "Posterior"), this.posterior(found),
      sameLines(this.look.equivalents.posterior));
  }

  sliders(sliders) {
    const values = {}, said = h("p", { class: "soft", "aria-live": "polite" }, "Move a slider: the loop above is drawn again, and the fit stays as it is.");
    let waiting = null, inputs = [];
    const redraw = () => {
      clearTimeout(waiting);
      waiting = setTimeout(async () => {
        try {
          const moved = await post("api/redraw", { name: this.name, value: this.folder, values });
          this.drawLoops(moved);
          said.textContent = `With these values the rms error is ${quantity(moved.rms, this.curves.axes.y_unit)}.`;
        } catch (error) {
          said.textContent = error.message;
        }
      }, 60);
    };
    inputs = sliders.map((one) => {
      const to = one.logarithmic ? Math.exp : (x) => x, from = one.logarithmic ? Math.log : (x) => x;
      const shown = h("span", { class: "value" }, quantity(one.value, one.unit));
      const low = from(one.low), high = from(one.high);
      const input = h("input", { type: "range", min: String(low), max: String(high), step: String((high - low) / 500 || 1),
        oninput: (event) => { values[one.name] = to(Number(event.target.value)); shown.textContent = quantity(values[one.name], one.unit); redraw(); } });
      input.value = String(from(one.value));
      return h("label", {}, h("span", {}, one.name, shown), input);
    });
    return h("div", {}, h("div", { class: "sliders" }, inputs), h("div", { class: "row" }, said,
      h("button", { type: "button", class: "small", onclick: () => {
        for (const name of Object.keys(values)) delete values[name];
        sliders.forEach((one, k) => {
          inputs[k].querySelector("input").value = String(one.logarithmic ? Math.log(one.value) : one.value);
          inputs[k].querySelector(".value").textContent = quantity(one.value, one.unit);
        });
        said.textContent = "The values of the fit.";
        this.drawLoops();
      } }, "As fitted")));
  }

  posterior(found) {
    this.histograms = h("div", { class: "histograms" });
    const button = h("button", { type: "button", onclick: () => this.start("sample", { value: this.folder }) }, found.posterior ? "Sample again" : "Sample the posterior");
    if (!found.posterior) return h("div", { class: "row" }, button, h("span", { class: "soft" }, "It quantifies how uncertain the parameters are."));
    const rows = found.posterior.parameters.slice(0, 40).map((one) => ({ cells: [one.name, number(one.mean, 4), number(one.sd, 2), `${number(one.q05)} to ${number(one.q95)}`, number(one.rhat, 4), number(one.ess)] }));
    return h("div", {}, table(`${found.posterior.draws.toLocaleString("en")} draws${found.posterior.converged ? "" : ", not converged"}`, ["Parameter", "mean", "sd", "5 to 95 %", "R-hat", "effective"], rows),
      this.histograms, found.posterior.notes.map((note) => h("p", { class: "soft" }, note)), h("div", { class: "row" }, button));
  }

  async drawPosterior() {
    const found = await getJson("api/posterior", { name: this.name, value: this.folder });
    const svg = (name, attributes, ...children) => {
      const element = document.createElementNS("http://www.w3.org/2000/svg", name);
      for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
      element.append(...children);
      return element;
    };
    fill(this.histograms, ...found.map(({ name, count, edges, logarithmic }) => {
      const most = Math.max(...count), n = count.length;
      const bars = count.map((c, k) => svg("rect", { x: k, y: 1 - c / most, width: 0.92, height: c / most }));
      return h("figure", {}, svg("svg", { viewBox: `0 0 ${n} 1`, preserveAspectRatio: "none", role: "img", "aria-label": `Distribution of ${name} from ${number(edges[0])} to ${number(edges[n])}` }, ...bars),
        h("figcaption", {}, `${name}: ${number(edges[0])} to ${number(edges[n])}${logarithmic ? ", logarithmic" : ""}`));
    }));
  }

  compensator(found, files) {
    this.filesThere = files;
    if (!found.invertible) return "";
    const choice = h("select", {}, files.map((file) => h("option", { value: file.name, selected: file.name === this.tried || undefined }, file.name)));
    this.tryAt = h("div");
    const run = () => {
      this.tried = choice.value;
      this.start("qualify", { value: this.folder, file: choice.value });
    };
    const section = h("section", { class: "card", "aria-labelledby": "compensator-title" },
      h("h2", { id: "compensator-title" }, "Compensator"),
      h("p", { class: "soft" }, `It estimates ${found.data.input.name} from ${found.data.output.name}. Try it on a file that the fit has not seen.`),
      h("div", { class: "row" }, h("label", { class: "field" }, "File: ", choice), h("button", { type: "button", onclick: run }, "Try the compensator")),
      this.tryAt, sameLines(this.look.equivalents.compensator));
    if (this.written.qualify) this.judged(this.written.qualify);
    if (this.written.predict) this.estimated(this.written.predict);
    return section;
  }

  /** A command about this fit has ended well. */
  ended(job) {
    if (job.kind === "qualify") {
      this.written = { qualify: job.result };
      this.judged(job.result);
      this.start("predict", { value: this.folder, file: this.tried });
    } else if (job.kind === "predict") {
      this.written.predict = job.result;
      this.estimated(job.result);
    } else if (job.kind === "export" || job.kind === "report") {
      this.done?.(job);
    }
  }

  judged(result) {
    if (!this.tryAt) return;
    const { verdict } = result;
    this.qualified = h("div", { class: `verdict ${verdict.level}`, role: "status" }, h("p", {}, word(verdict.level), h("strong", {}, `on ${this.tried ?? result.source ?? "this file"}`)),
      h("ul", {}, verdict.reasons.map((reason) => h("li", {}, sentence(reason.text ?? reason)))));
    fill(this.tryAt, this.qualified);
  }

  async estimated(result) {
    if (!this.tryAt || !result.file) return;
    try {
      const found = await getJson("api/written", { name: this.name, value: this.folder, file: this.tried });
      const at = h("div", { role: "img", "aria-label": `${found.name} and measured ${found.measured_name ?? "values"} over the lines of the file` });
      fill(this.tryAt, ...(this.qualified ? [this.qualified] : []), h("figure", {}, h("figcaption", {}, `${found.name}, over the lines of ${this.tried}. ${result.flagged} of ${result.rows} rows flagged.`), at,
        h("ul", { class: "key" }, found.measured && h("li", { class: "k-under" }, "measured"), h("li", { class: "k-model" }, "estimated"))));
      const plot = new LoopPlot(at, { height: 260 });
      plot.show([...(found.measured ? [{ x: found.line, y: found.measured, colour: "--under", width: 5 }] : []), { x: found.line, y: found.estimated, colour: "--model", width: 1.4 }], "line", found.measured_name ?? found.name);
      (this.others ??= []).push(plot);
    } catch (error) {
      this.tryAt.append(faultBox(error.fault ?? { message: String(error) }));
    }
  }

  files(found) {
    const link = (path, text) => fileLink(path, text.includes(".") ? text : `${text} (ZIP)`, { download: true });
    const list = h("ul", {}, found.exports.map((path) => h("li", {}, link(path, path.split("/").at(-1)))),
      found.report && h("li", {}, fileLink(found.report, "Report (opens in a new tab)")));
    const deed = (kind, text) => h("button", { type: "button", onclick: () => this.start(kind, { value: this.folder }) }, text);
    this.done = (job) => {
      if (job.kind !== "export") return;
      const made = job.result.notes ?? [];
      fill(this.exportNotes, ...made.map((note) => h("p", { class: "soft" }, note)));
    };
    this.exportNotes ??= h("div");
    const target = h("select", { "aria-label": "Another target" }, (this.targets ?? []).map((name) => h("option", { value: name, selected: name === this.target }, TARGETS[name] ?? name)));
    const other = h("button", { type: "button", onclick: () => { this.target = target.value; this.start("export", { value: this.folder, target: target.value }); } }, "Export for it");
    return h("section", { class: "card", "aria-labelledby": "files-title" }, h("h2", { id: "files-title" }, "Files"),
      h("div", { class: "row" }, found.invertible && [deed("export", "Export the compensator"), h("span", { class: "pair" }, target, other)], deed("report", "Write the report")),
      found.exports.length > 0 || found.report ? list : h("p", { class: "soft" }, "The export is a C99 header and a JSON file for compensate.runtime. Neither needs JAX."),
      this.exportNotes, sameLines(this.look.equivalents.export), sameLines(this.look.equivalents.report, "The report as a command, and in Python"));
  }

  redraw() {
    for (const plot of [this.loopPlot, ...(this.others ?? [])]) plot?.redraw();
  }
}
