// A fit: its verdict, candidates, loops, residuals, parameters, posterior, compensator, files.
import { Deed, faultBox, faultOf, fileLink, fill, getJson, h, number, post, quantity, sameLines, sentence, table, word } from "./page.js";
import { LoopPlot } from "./plots.js";

const TARGETS = { arduino: "Arduino and PlatformIO", ros2: "ROS 2", mujoco: "MuJoCo", sklearn: "scikit-learn", onnx: "ONNX", fmu: "FMU, FMI 2.0", fmu3: "FMU, FMI 3.0" };
const OTHERS = ["--held", "--moved", "--input", "--measured"];
const gapped = (record, y, more) => ({ x: record.u, y, gap: record.gap.map(Boolean), ...more });

export class ResultPanel {
  constructor(studio, targets) {
    Object.assign(this, { studio, name: studio.name, targets, element: h("div"), deeds: [], tried: null, target: null });
  }

  /** Show a fit; of one that is shown already, only what was made of it since. Resolves when its loops are drawn. */
  async show(look) {
    this.look = look;
    const found = look.result, serial = this.serial = (this.serial ?? 0) + 1;
    const shown = JSON.stringify({ ...found, exports: 0, report: 0, posterior: 0, seen: look.seen });
    if (found && this.shown === shown) {
      this.filled(found);
      return;
    }
    this.shown = null;
    this.deeds = [];
    if (!found) {
      fill(this.element, look.result_fault && faultBox(look.result_fault));
      return;
    }
    this.folder = found.folder === "." ? "" : found.folder;
    const place = h("div"), all = [this.verdict(found), place];
    fill(this.element, found.stale ? h("details", { class: "card" }, h("summary", {}, "A fit of other choices"),
      h("p", {}, "It was made from other columns, rows or options than those chosen now, or from another file. Fit to judge the present ones."), all) : all);
    try {
      const curves = await getJson("api/curves", { name: this.name, value: this.folder });
      if (serial !== this.serial) return;
      this.curves = curves;
      place.replaceWith(this.models(found), this.parameters(found), this.compensator(found), this.files(found));
      this.filled(found);
      this.draw(found);
      this.shown = shown;
    } catch (error) {
      if (serial === this.serial) fill(place, faultOf(error));
    }
  }

  /** What is made of a fit: posterior, exports, report. */
  filled(found) {
    fill(this.posteriorAt, found.posterior && this.posterior(found.posterior));
    if (found.posterior) this.drawPosterior();
    const link = (path) => fileLink(path, path.includes(".") ? path.split("/").at(-1) : `${path.split("/").at(-1)} (ZIP)`, { download: true });
    fill(this.made, (found.exports.length > 0 || found.report) && h("ul", {}, found.exports.map((path) => h("li", {}, link(path))),
      found.report && h("li", {}, fileLink(found.report, "Report (opens in a new tab)"))));
    this.update();
  }

  update() {
    for (const deed of this.deeds) deed.update();
  }

  deed(kind, label, more = {}) {
    const { made } = this.look.result, value = this.folder;
    const one = new Deed(this.studio, kind, label, { ...more, options: () => ({ value, made, ...more.options?.() }) });
    this.deeds.push(one);
    return one;
  }

  verdict(found) {
    const judged = found.metrics.test ?? found.metrics.train, unit = found.data.output.unit;
    const words = found.metrics.test ? "held-out" : "training";
    const fact = (name, value) => h("div", {}, h("dt", {}, name), h("dd", {}, value));
    this.loopAt = h("div", { class: "loop" });
    return h("section", { class: `card verdict ${found.level}`, "aria-labelledby": "verdict-title", id: "verdict" },
      h("h2", { id: "verdict-title" }, word(found.level), found.headline),
      found.values.length > 0 && h("label", { class: "field" }, `${found.values.length} fits, one for each value: `,
        h("select", { id: "each-value", onchange: (event) => this.pick(event.target.value) }, found.values.map((value) => h("option", { value, selected: value === found.value }, value)))),
      h("figure", {}, h("figcaption", {}, "Loops: the thin line of the model should lie inside the broad measured one."), this.loopAt, this.key = h("ul", { class: "key" }),
        h("p", { class: "soft" }, "Drag over a plot to zoom in, click twice to see it whole; a name hides its curve."), this.slidersAt = h("div")),
      h("div", { class: "reasons" }, h("ul", {}, found.reasons.map((reason) => h("li", {}, sentence(reason)))),
        h("dl", { class: "facts" }, fact(`${words} error, rms`, quantity(judged.rmse, unit)),
          fact("of the range", quantity(judged.nrmse_percent, "%")), fact("largest", quantity(judged.max_abs, unit)), fact("purpose", found.purpose), fact("model", found.model)),
        found.characteristics.length > 0 && [h("h3", {}, "The specimen"), h("dl", { class: "facts" }, found.characteristics.map((one) => fact(one.name,
          [one.value === null ? "not known" : `${number(one.value)} ± ${quantity(one.error, one.unit, 2)}`, h("small", {}, one.reason || one.basis)]))),
        h("p", { class: "soft" }, "By the model, over the fitted rows. ± is how far the readings of the same cycles or holds are from that.")]));
  }

  pick(value) {
    getJson("api/summary", { name: this.name, value }).then((result) => this.show({ ...this.look, result }))
      .catch((error) => fill(this.slidersAt, faultOf(error)));
  }

  models(found) {
    const { curves } = this, unit = found.data.output.unit;
    const row = (one, name, extra) => {
      const judged = one.metrics.test ?? one.metrics.train;
      return { ...extra, cells: [name, number(one.score_percent), number(judged?.nrmse_percent), number(judged?.rmse), one.verdict ? word(one.verdict.level) : ""] };
    };
    this.overlaid = new Set();
    const drawn = (name, loop) => loop ? h("label", { class: "field" }, h("input", { type: "checkbox", onchange: (event) => {
      if (event.target.checked) this.overlaid.add(loop);
      else this.overlaid.delete(loop);
      this.drawLoops();
    } }), h("span", { class: "unseen" }, "Draw the loop of "), name) : name;
    const rows = [
      ...found.candidates.map((one, k) => row(one, drawn(one.model, k && curves.candidates[k - 1]), { class: k ? "" : "strong" })),
      ...found.baselines.map((one, k) => row(one, drawn(one.name, curves.baselines[k]), { class: "baseline" })),
    ];
    const skipped = Object.entries(found.skipped);
    this.residualAt = h("div");
    this.residualInput = h("div");
    const chart = (caption, at) => h("figure", {}, h("figcaption", {}, caption), at);
    return h("section", { class: "card", "aria-labelledby": "models-title" },
      h("h2", { id: "models-title" }, "Models and baselines"),
      curves.candidates.length + curves.baselines.length > 0 && h("p", { class: "soft" }, "Tick a model or a baseline to draw its loop over the training rows above. Folds are training rows that were held out to choose among the models."),
      h("div", { class: "folds" }, table(`Errors${found.metrics.test ? " on held-out rows" : ""}; the best model first, baselines in italics`, ["Model", "folds, %", "of range, %", `rms${unit === "1" ? "" : `, ${unit}`}`, "verdict"], rows)),
      skipped.length > 0 && h("details", { class: "same" }, h("summary", {}, `${skipped.length} skipped`), h("ul", {}, skipped.map(([name, why]) => h("li", {}, `${name}: ${why}`)))),
      h("div", { class: "folds" }, table("What it was asked on rows that it was not fitted to; of an average its members, too", ["Question or member", "asked by", `rms${unit === "1" ? "" : `, ${unit}`}`], curves.asked.map((one) => ({ cells: [one.what, one.share, one.error === null ? "not known" : number(one.error)] })))),
      h("h3", {}, "Residuals"),
      h("div", { class: "plots even" }, chart(`Over ${curves.axes.x}: a pattern shows what the model misses.`, this.residualAt), chart("Over the input.", this.residualInput)),
      sameLines(this.look.equivalents.fit));
  }

  draw(found) {
    const { axes, records, shapes, sliders } = this.curves, [train, test] = records;
    this.loopPlot = new LoopPlot(this.loopAt, { height: 340, key: this.key });
    this.loopAt.setAttribute("role", "img");
    this.loopAt.setAttribute("aria-label", `Measured loops and the model: ${axes.y} against ${axes.u}.`);
    fill(this.slidersAt, shapes.length + sliders.length > 0 && h("details", { class: "same" }, h("summary", {}, "What if … ?"), this.sliders([...shapes.map((one) => ({ ...one, shape: true })), ...sliders])));
    this.drawLoops();
    const y = `residual (${axes.y_unit})`;
    const dots = (record, x, tone) => ({ name: record.word, x: record[x], y: record.residual, colour: tone, width: 2.6, dots: true });
    for (const [at, x, label] of [[this.residualAt, "x", axes.x], [this.residualInput, "u", axes.u]]) {
      at.setAttribute("role", "img");
      at.setAttribute("aria-label", `Residuals over ${label}; rms ${records.map((one) => `${number(one.rms)} ${axes.y_unit} (${one.word})`).join(", ")}.`);
      new LoopPlot(at, { height: 220 }).show([dots(train, x, "--measured"), ...(test ? [dots(test, x, "--held")] : [])], label, y);
    }
  }

  drawLoops(moved = null) {
    const { axes, records: [train, test] } = this.curves, judged = test ?? train;
    const others = [...this.overlaid].map((loop, place) => ({ ...loop, colour: OTHERS[place % OTHERS.length] }));
    const curves = [
      this.curves.excluded && gapped(this.curves.excluded, this.curves.excluded.y, { name: "excluded from the fit", colour: "--excluded", width: 2 }),
      gapped(train, train.y, { name: "measured", colour: "--under", width: 5 }),
      test && gapped(test, test.y, { name: "measured, held out", colour: "--held-under", width: 5 }),
      gapped(judged, judged.model, { name: this.look.result.model, colour: "--model", width: 1.4 }),
      ...others.map((one) => gapped(one, one.model, { name: `${one.word}, on the training rows`, colour: one.colour, width: 1.6 })),
      moved && gapped(moved, moved.model, { name: "with the sliders", colour: "--moved", width: 1.6 }),
    ].filter(Boolean);
    this.loopPlot.show(curves, axes.u, axes.y);
  }

  parameters(found) {
    const rows = found.parameters.slice(0, 60).map((one) => ({ cells: [one.name, quantity(one.value, one.unit, 4), one.stderr === null ? one.status : `± ${number(one.stderr, 2)}`, one.status] }));
    const more = found.parameters.length - rows.length, hidden = found.undetermined;
    this.posteriorAt = h("div");
    return h("section", { class: "card", "aria-labelledby": "parameters-title" },
      h("h2", { id: "parameters-title" }, "What the model is made of"),
      h("p", { class: "soft" }, found.model + (hidden > 0 ? `. ${hidden} of its sums are left out: the data do not determine them one by one.` : "")),
      rows.length > 0 && h("details", { class: "same", open: hidden === 0 }, h("summary", {}, "Its parameters"), table(more > 0 ? `The first ${rows.length} of ${found.parameters.length} parameters` : "Values with their standard errors", ["Parameter", "value", "standard error", "status"], rows)),
      h("h3", {}, "Posterior"), h("p", { class: "soft" }, "It quantifies how uncertain the parameters are."),
      this.deed("sample", () => (this.look.result.posterior ? "Sample again" : "Sample the posterior")).element, this.posteriorAt,
      sameLines(this.look.equivalents.posterior));
  }

  /** Sliders of figures of the loop (`shape`), which are sent as factors, and of parameters that have a meaning. */
  sliders(sliders) {
    const begin = "Move a slider: the loop is drawn again, and the fit stays as it is.";
    const moves = { values: {}, factors: {} }, said = h("p", { class: "soft", "aria-live": "polite" }, begin);
    let waiting = null;
    const redraw = () => {
      clearTimeout(waiting);
      waiting = setTimeout(async () => {
        try {
          this.drawLoops(await post("api/redraw", { name: this.name, value: this.folder, ...moves }));
          said.textContent = begin;
        } catch (error) {
          said.textContent = error.message;
        }
      }, 60);
    };
    const inputs = sliders.map((one) => {
      const to = one.logarithmic ? Math.exp : (x) => x, from = one.logarithmic ? Math.log : (x) => x;
      const shown = h("span", { class: "value" }), low = from(one.low), high = from(one.high);
      const input = h("input", { type: "range", min: String(low), max: String(high), step: String((high - low) / 500 || 1), oninput: () => {
        const x = to(Number(input.value));
        if (one.shape) moves.factors[one.name] = x / one.value;
        else moves.values[one.name] = x;
        shown.textContent = quantity(x, one.unit);
        redraw();
      } });
      const element = h("label", {}, h("span", {}, one.shape ? one.meaning : one.meaning ? `${one.meaning} (${one.name})` : one.name, shown), input);
      const reset = () => {
        input.value = String(from(one.value));
        shown.textContent = quantity(one.value, one.unit);
      };
      reset();
      return { element, reset };
    });
    return h("div", {}, h("div", { class: "sliders" }, inputs.map((one) => one.element)), h("div", { class: "row" }, said,
      h("button", { type: "button", class: "small", onclick: () => {
        Object.assign(moves, { values: {}, factors: {} });
        clearTimeout(waiting);
        for (const one of inputs) one.reset();
        this.drawLoops();
      } }, "As fitted")));
  }

  posterior(found) {
    this.histograms = h("div", { class: "histograms" });
    const rows = found.parameters.slice(0, 40).map((one) => ({ cells: [one.name, number(one.mean, 4), number(one.sd, 2), `${number(one.q05)} to ${number(one.q95)}`, number(one.rhat, 4), number(one.ess)] }));
    return [table(`${found.draws.toLocaleString("en")} draws${found.converged ? "" : ", not converged"}`, ["Parameter", "mean", "sd", "5 to 95 %", "R-hat", "effective"], rows),
      this.histograms, found.notes.map((note) => h("p", { class: "soft" }, note))];
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

  compensator(found) {
    if (!found.invertible) return "";
    const { files } = this.studio.state(), seen = new Set(this.look.seen), isNew = (name) => files.some((file) => file.name === name && !seen.has(name));
    // One that the fit has not seen: first those whose columns are known, then the largest.
    const unseen = files.filter((file) => isNew(file.name) && file.size).sort((one, other) => other.configured - one.configured || other.size - one.size);
    if (!isNew(this.tried)) this.tried = unseen[0]?.name ?? this.name;
    const choice = h("select", { id: "tried", onchange: () => { this.tried = choice.value; this.update(); } }, files.map(({ name }) =>
      h("option", { value: name, selected: name === this.tried }, seen.has(name) ? `${name} (the fit has seen it)` : name)));
    // The file as it is now: a result of what it was before is none of it.
    const options = () => ({ file: choice.value, stamp: this.studio.state().files.find((file) => file.name === choice.value)?.stamp ?? "" });
    const run = this.deed("predict", "Run the compensator", { options, answer: () => this.estimated(choice.value) });
    run.button.hidden = true;
    const judge = this.deed("qualify", "Try the compensator", {
      options, beside: h("label", { class: "field" }, "File: ", choice), ended: () => run.start(),
      answer: ({ result: { verdict } }) => h("div", { class: `verdict ${verdict.level}`, role: "status" }, h("p", {}, word(verdict.level), h("strong", {}, `on ${choice.value}`)),
        h("ul", {}, verdict.reasons.map((reason) => h("li", {}, sentence(reason.text ?? reason))))),
    });
    return h("section", { class: "card", "aria-labelledby": "compensator-title" },
      h("h2", { id: "compensator-title" }, "Compensator"),
      h("p", { class: "soft" }, `It estimates ${found.data.input.name} from ${found.data.output.name}. Try it on a file that the fit has not seen${unseen.length ? "" : ": drop one on the page"}.`),
      judge.element, run.element, sameLines(this.look.equivalents.compensator));
  }

  /** The estimate that was written for a file, over its lines; drawn when it is read. */
  estimated(file) {
    const place = h("div");
    getJson("api/written", { name: this.name, value: this.folder, file }).then((found) => {
      const key = h("ul", { class: "key" }), at = h("div", { role: "img", "aria-label": `${found.name} and measured ${found.measured_name ?? "values"} over the lines of the file` });
      fill(place, h("figure", {}, h("figcaption", {}, `${found.name}, over the lines of ${file}. ${found.flagged_rows} of ${found.rows} rows flagged.`), at, key));
      new LoopPlot(at, { height: 260, key }).show([...(found.measured ? [{ name: "measured", x: found.line, y: found.measured, colour: "--under", width: 5 }] : []), { name: "estimated", x: found.line, y: found.estimated, colour: "--model", width: 1.4 }], "line", found.measured_name ?? found.name);
    }).catch((error) => fill(place, faultOf(error)));
    return place;
  }

  files(found) {
    this.made = h("div");
    const target = h("select", { id: "target", "aria-label": "Another target", onchange: () => { this.target = target.value; this.update(); } }, this.targets.map((name) => h("option", { value: name, selected: name === this.target }, TARGETS[name] ?? name)));
    const answer = (job) => [h("p", {}, "Written."), (job.result.notes ?? []).map((note) => h("p", { class: "soft" }, note))];
    return h("section", { class: "card", "aria-labelledby": "files-title" }, h("h2", { id: "files-title" }, "Files"),
      found.invertible && [h("p", { class: "soft" }, "The export is a C99 header and a JSON file for compensate.runtime. Neither needs JAX."),
        this.deed("export", "Export the compensator", { answer, options: () => ({ target: "" }) }).element,
        this.deed("export", "Export for it", { answer, beside: target, options: () => ({ target: target.value }) }).element],
      this.deed("report", "Write the report", { answer }).element, this.made,
      sameLines(this.look.equivalents.export), sameLines(this.look.equivalents.report, "The report as a command, and in Python"));
  }
}
