// The measurement: its columns and their roles, plots that are brushed, held-out rows, warnings.
import { faultBox, faultOf, fill, get, getJson, h, number, post, sameLines, say, settingFields } from "./page.js";
import { columnsOf, LoopPlot, loopCurves, TimePlot } from "./plots.js";

export class DataPanel {
  constructor(name, { roles, settings }, changed) {
    Object.assign(this, { name, changed, settings, roles: [["", "not used"], ...Object.entries(roles)] });
    this.element = h("section", { class: "card", "aria-labelledby": "data-title" });
    this.query = { serial: 0 };
  }

  /** Show what the studio found out about the measurement: its rows, or the question which columns they are. */
  show(look) {
    this.look = look;
    const plots = this.plots ??= this.makePlots(), open = look.asks || Boolean(look.fault);
    plots.hidden = open && !this.time.u;
    this.refusal ??= h("div");
    fill(this.refusal);
    const columns = this.columns(open || !this.element.childElementCount);
    fill(this.element,
      h("h2", { id: "data-title" }, "Measurement"),
      look.asks ? this.question() : look.fault && faultBox(look.fault), open && [this.refusal, columns],
      plots,
      this.warnings ??= h("div"),
      !open && [this.heldOut(), this.refusal, columns],
      sameLines(look.equivalents.data),
    );
    // The plots first: what is wrong with the rows is told when all of them are read.
    const drawn = plots.hidden ? Promise.resolve() : this.fetch();
    if (!open) drawn.then(() => this.attempt(() => this.judge()));
    else fill(this.warnings);
  }

  question() {
    const { fault, no_roles: why } = this.look;
    return h("div", { class: "fault question", role: "status" }, h("p", {}, h("strong", {}, "Which column drives, and which one answers?")),
      h("p", {}, fault ? fault.message : why ? `${why[0].toUpperCase()}${why.slice(1)}.` : "hysid could not tell."), fault?.cause && h("p", {}, `Likely cause: ${fault.cause}`),
      h("p", {}, "Give one column the role “input” and one the role “output”, and hysid looks for the rest."), fault?.fix && h("p", { class: "soft" }, fault.fix));
  }

  /** Do what the studio may refuse, and tell it then. */
  async attempt(does, at = this.refusal) {
    try {
      await does();
    } catch (error) {
      if (error.name === "AbortError") return;
      this.both?.setAttribute("aria-busy", "false");
      fill(at, faultOf(error));
    }
  }

  makePlots() {
    const timeAt = h("div"), loopAt = h("div");
    this.time = new TimePlot(timeAt, {
      ask: () => this.fetch(),
      brushed: (low, high) => this.choose({ low, high, box: null }),
      hovered: (at) => this.loops.point(at),
    });
    this.loops = new LoopPlot(loopAt, { brushed: (box) => this.choose({ ...this.range(), box }) });
    this.timeCaption = h("figcaption");
    this.loopCaption = h("figcaption");
    this.bar = h("div");
    this.notice = h("div");
    const step = (label, text, does) => h("button", { type: "button", class: "small", "aria-label": label, onclick: does }, text);
    return h("div", {},
      this.both = h("div", { class: "plots", "aria-busy": "true" },
        h("figure", {}, this.timeCaption, timeAt,
          h("div", { class: "row" }, step("Zoom in", "+", () => this.time.zoom(0.5)), step("Zoom out", "−", () => this.time.zoom(2)),
            step("Earlier", "←", () => this.time.pan(-0.4)), step("Later", "→", () => this.time.pan(0.4)),
            step("Show all rows", "All", () => { this.loops.box = null; this.time.all(); }),
            step("Choose rows by their times", "Choose rows …", () => this.choose({ ...this.range(true), box: null }, true)))),
        h("figure", {}, this.loopCaption, loopAt)),
      h("ul", { class: "key" }, h("li", { class: "k-measured" }, "fitted"), h("li", { class: "k-held" }, "held out"),
        h("li", { class: "k-excluded" }, "excluded"), h("li", { class: "k-input" }, "input")),
      this.bar, this.notice);
  }

  range(always = false) {
    const view = this.time.view ?? (always ? this.time.full : [null, null]);
    return { low: view[0], high: view[1] };
  }

  fetch() {
    return this.attempt(() => this.read(), this.notice);
  }

  async read() {
    this.query.abort?.abort();
    const abort = this.query.abort = new AbortController();
    this.both.setAttribute("aria-busy", "true");
    const { low, high } = this.range();
    const answer = await get("api/series", { name: this.name, low, high, box: this.loops.box?.join(",") }, abort.signal);
    const about = JSON.parse(answer.headers.get("x-about"));
    const [time, loops] = columnsOf(await answer.arrayBuffer(), about.shapes);
    if (abort.signal.aborted) return;
    this.about = about;
    const x = about.clock ? about.names.x : "line of the file";
    this.time.show(time, { ...about.names, x }, about.whole);
    this.loops.show(loopCurves(loops, about.joined), about.names.u, about.names.y);
    this.both.setAttribute("aria-busy", "false");
    this.timeCaption.textContent = `Over time${about.whole ? "" : `: an excerpt, while the file is read`}. Drag to choose rows; scroll to zoom.`;
    this.loopCaption.textContent = `Loops of the ${low === null ? "whole measurement" : "stretch on the left"}.`;
    const said = `${about.rows.toLocaleString("en")} rows of ${about.names.u} and ${about.names.y}`;
    this.time.element.setAttribute("aria-label", `${said} over ${x}. Arrow keys move the view, plus and minus zoom, 0 shows all.`);
    this.loops.element.setAttribute("role", "img");
    this.loops.element.setAttribute("aria-label", `Loops: ${about.names.y} against ${about.names.u}.`);
    if (!about.whole) setTimeout(() => this.element.isConnected && this.fetch(), 700);
  }

  choose(part, ask = false) {
    const clear = () => { this.time.clear(); this.loops.clear(); fill(this.bar); };
    if (part.box === null) this.loops.clear();
    const act = (action) => this.attempt(async () => {
      clear();
      this.changed(await post("api/brush", { name: this.name, action, ...part }));
      say("The configuration was changed.");
    }, this.notice);
    const button = (text, does) => h("button", { type: "button", class: "small", onclick: does }, text);
    const edge = (which, text) => h("label", { class: "field" }, text, h("input", { type: "number", step: "any", value: String(Number(part[which].toPrecision(7))),
      onchange: (event) => { part[which] = Number(event.target.value); this.time.mark(part.low, part.high); } }));
    const range = part.low === null ? "all times" : `${number(part.low, 5)} to ${number(part.high, 5)}`;
    const said = part.box ? `${this.about.names.u} ${number(part.box[0])} to ${number(part.box[1])}, ${this.about.names.y} ${number(part.box[2])} to ${number(part.box[3])}, at ${range}` : `Rows at ${range}`;
    fill(this.notice);
    fill(this.bar, h("div", { class: "bar", role: "group", "aria-label": "Chosen rows" },
      ask ? h("span", { class: "said" }, edge("low", "From"), " ", edge("high", "to")) : h("span", { class: "said" }, said),
      button("Exclude", () => act("exclude")), button("Hold out", () => act("hold-out")), button("Include", () => act("include")),
      button("Zoom", () => {
        if (part.box) { this.loops.box = part.box; clear(); this.fetch(); }
        else this.time.to(part.low, part.high);
        fill(this.bar);
      }),
      button("Cancel", clear)));
    if (ask) this.bar.querySelector("input").select();
  }

  async judge() {
    const serial = this.query.serial += 1, found = await getJson("api/judged", { name: this.name });
    if (serial !== this.query.serial) return;
    const items = found.warnings.map((warning) => h("li", {}, warning.text,
      warning.lines.length > 0 && h("button", { type: "button", class: "quiet small", onclick: () => this.attempt(() => this.showLines(warning.lines), this.notice) }, "Show these rows")));
    fill(this.warnings, found.fault && !this.look.fault ? faultBox(found.fault) : "",
      items.length ? h("ul", { class: "warnings", "aria-label": "Warnings" }, items) : "",
      found.records.length ? h("details", { class: "same" }, h("summary", {}, "The record in words"),
        found.records.slice(0, 20).map((record) => h("pre", { tabIndex: 0, role: "region", "aria-label": "The record in words" }, record.text))) : "");
  }

  async showLines(lines) {
    const ends = lines.flatMap((range) => range.split("-").map(Number));
    const found = await getJson("api/lines", { name: this.name, first: Math.min(...ends), last: Math.max(...ends) });
    const room = 0.1 * (found.high - found.low) || 1;
    this.time.to(found.low - room, found.high + room);
    this.time.mark(found.low, found.high);
    this.time.element.focus();
  }

  heldOut() {
    const { selection } = this.look, set = (changes) => this.set({ selection: { test_cycles: null, test_tail: null, test_where: null, test_lines: null, ...changes } });
    if (!selection) return "";
    const kind = ["test_cycles", "test_tail", "test_where", "test_lines"].find((key) => selection[key] !== undefined) ?? "nothing";
    const names = { nothing: "nothing", test_cycles: "the last cycles", test_tail: "the last fraction of the rows", test_lines: "rows chosen in the plot", test_where: "rows by their values" };
    const start = { nothing: {}, test_cycles: { test_cycles: 1 }, test_tail: { test_tail: 0.2 } };
    const choice = h("select", { onchange: (event) => start[event.target.value] && set(start[event.target.value]) },
      Object.entries(names).filter(([key]) => key in start || key === kind).map(([key, text]) => h("option", { value: key, selected: key === kind }, text)));
    const value = selection[kind];
    const more = kind === "test_cycles" ? h("input", { type: "number", min: "1", value: String(value), "aria-label": "Number of cycles held out", onchange: (event) => set({ test_cycles: Math.max(1, Math.round(Number(event.target.value))) }) })
      : kind === "test_tail" ? h("input", { type: "number", min: "0.01", max: "0.9", step: "0.05", value: String(value), "aria-label": "Fraction held out", onchange: (event) => set({ test_tail: Number(event.target.value) }) })
        : value === undefined ? "" : h("span", { class: "soft" }, [value].flat().join(", ").slice(0, 80));
    const left = selection.exclude_lines;
    return h("div", { class: "row" }, h("label", { class: "field" }, "Held out for testing: ", choice), more,
      left && h("span", { class: "soft" }, `Excluded lines: ${[left].flat().join(", ").slice(0, 80)} `,
        h("button", { type: "button", class: "quiet small", onclick: () => this.set({ selection: { exclude_lines: null } }) }, "Include all")));
  }

  columns(open) {
    const { selection = {}, columns, findings } = this.look;
    const role = (name) => this.roles.map(([key]) => key).find((key) => key && [selection[key] ?? []].flat().includes(name)) ?? "";
    const why = Object.fromEntries(findings.map((one) => [one.what, one]));
    const rows = columns.map(({ name, unit }, k) => {
      const now = role(name), finding = why[now]?.value === name ? why[now] : null;
      return h("tr", {}, h("th", { scope: "row" }, name),
        h("td", {}, h("select", { id: `role-${k}`, "aria-label": `Role of ${name}`, onchange: (event) => this.give(name, now, event.target.value) },
          this.roles.map(([key, text]) => h("option", { value: key, selected: key === now }, text)))),
        h("td", {}, now === "input" || now === "output"
          ? h("input", { id: `unit-${k}`, type: "text", value: selection[`${now}_unit`] ?? unit, "aria-label": `Unit of ${name}`, onchange: (event) => this.set({ selection: { [`${now}_unit`]: event.target.value.trim() || null } }) })
          : h("span", { class: "soft" }, unit)),
        h("td", { class: "why" }, finding ? `${finding.sure}: ${finding.why}` : ""));
    });
    const others = findings.filter((one) => !this.roles.some(([key]) => key === one.what) && one.what !== "file" && one.why);
    return h("details", { id: "columns", open },
      h("summary", {}, "Columns, units and directions"),
      rows.length > 0 && h("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": "Columns" }, h("table", { class: "columns" },
        h("thead", {}, h("tr", {}, ["Column", "Role", "Unit", "Why"].map((text) => h("th", { scope: "col" }, text)))), h("tbody", {}, rows))),
      h("div", { class: "row" },
        typeof selection.input === "string" && selection.output && h("button", { type: "button", class: "small", onclick: () => this.swap() }, "Exchange input and output"),
        h("button", { type: "button", class: "small", onclick: () => this.attempt(() => this.again()) }, "Guess again")),
      others.length > 0 && h("ul", { class: "why" }, others.map((one) => h("li", {}, `${one.what}: ${one.value} (${one.sure}: ${one.why})`))),
      settingFields(this.settings, "selection", selection, (changes) => this.set({ selection: changes }), this.look.asks));
  }

  give(name, before, after) {
    const { selection = {} } = this.look, changes = {};
    const several = (key) => [selection[key] ?? []].flat();
    const many = ["input", "group", "condition"];
    if (before) {
      const rest = several(before).filter((one) => one !== name);
      changes[before] = rest.length ? (before === "input" && rest.length === 1 ? rest[0] : rest) : null;
      if (before === "input" || before === "output") changes[`${before}_unit`] = null;
    }
    if (after) {
      // A click makes this column the input; a second input is a channel beside the first only where there are several.
      const now = several(after);
      changes[after] = many.includes(after) && (after !== "input" || now.length > 1) ? [...now, name] : name;
      if (after === "input" || after === "output") changes[`${after}_unit`] = null;
      if (after === "time") changes.dt = null;
      if (after === "input") changes.step = null;
    }
    this.set({ selection: changes });
  }

  swap() {
    const { input, output, input_unit: one, output_unit: other } = this.look.selection;
    this.set({ selection: { input: output, output: input, input_unit: other ?? null, output_unit: one ?? null } });
  }

  /** Change the configuration, after the changes before it. A command waits for `pending`. */
  set(changes) {
    this.waiting = (this.waiting ?? 0) + 1;
    this.pending = (this.pending ?? Promise.resolve()).then(() => this.attempt(() => this.write(changes)));
    return this.pending;
  }

  async write(changes) {
    const look = await post("api/change", { name: this.name, ...changes }).finally(() => { this.waiting -= 1; });
    if (!this.waiting) this.changed(look); // what is chosen meanwhile stays
    say("The configuration was changed.");
  }

  async again() {
    this.changed(await post("api/again", { name: this.name }));
  }
}
