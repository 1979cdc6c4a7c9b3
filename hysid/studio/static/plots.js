// Linked plots over time and of curves, by uPlot: the page, notebooks and reports draw with the same functions.

const USED = 0, EXCLUDED = 1, HELD_OUT = 2, GAP = 8;

/** An element with attributes and children; text is always text, whatever a file may hold. */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** A colour, or the one that a custom property has now, as canvas understands it. */
function colour(element, name) {
  const probe = colour.probe ??= document.createElement("span");
  probe.style.display = "none";
  if (probe.parentNode !== element) element.append(probe);
  probe.style.color = name.startsWith("--") ? `var(${name})` : name;
  return getComputedStyle(probe).color;
}

/** Labels of an axis: uPlot's own have three decimals. */
const marks = (plot, at) => at.map((x) => {
  if (x === null) return "";
  const near = Number(x.toPrecision(12));
  return near && (Math.abs(near) < 1e-4 || Math.abs(near) >= 1e7) ? near.toExponential() : near.toLocaleString("en", { maximumFractionDigits: 6 });
});

/** A logarithmic axis: uPlot's own marks are every digit of every decade, however many there are. */
const decades = {
  filter: (plot, at) => at,
  splits: (plot, axis, low, high) => {
    const from = Math.floor(Math.log10(low)), to = Math.log10(high), step = Math.ceil((to - from) / 8);
    const powers = Array.from({ length: Math.floor((to - from) / step) + 1 }, (_, k) => from + k * step);
    const digits = to - from > 3 ? [1] : [1, 2, 5];
    return powers.flatMap((power) => digits.map((digit) => Number(`${digit}e${power}`))).filter((x) => low <= x && x <= high);
  },
};

function axis(element, label, more = {}) {
  return {
    label, values: marks, labelSize: 22, size: 50, gap: 4, font: "12px system-ui", labelFont: "13px system-ui", labelGap: 0,
    stroke: () => colour(element, "--soft"),
    grid: { stroke: () => colour(element, "--line"), width: 1 }, ticks: { stroke: () => colour(element, "--line"), width: 1, size: 4 },
    ...more,
  };
}

const padded = (low, high, logarithmic = false) => {
  if (!(low <= high)) return logarithmic ? [1, 10] : [0, 1];
  if (logarithmic) return padded(Math.log10(low), Math.log10(high)).map((x) => 10 ** x);
  const room = 0.04 * (high - low) || Math.abs(low) * 0.1 || 1;
  return [low - room, high + room];
};

function extent(values) {
  let low = Infinity, high = -Infinity;
  for (const x of values) {
    if (x < low) low = x;
    if (x > high) high = x;
  }
  return [low, high];
}

/** Rows as five columns, from what the studio sends. */
export function columnsOf(buffer, shapes) {
  const all = new Float64Array(buffer);
  let at = 0;
  return shapes.map((n) => {
    const found = {};
    for (const name of ["x", "u", "y", "line", "state"]) {
      found[name] = all.subarray(at, at + n);
      at += n;
    }
    return found;
  });
}

/** A plot keeps the width of its element, and its colours follow the page's. */
class Base {
  constructor(element, height) {
    this.element = element;
    this.height = height;
    element.plot = this;
    element.classList.add("plot");
    this.watch = new ResizeObserver(() => {
      const width = element.clientWidth;
      if (this.u && width && width !== this.u.width) this.u.setSize({ width, height: this.height });
    });
    this.watch.observe(element);
  }

  make(options, data) {
    this.u?.destroy();
    const shared = { width: this.element.clientWidth || 400, height: this.height, legend: { show: false } };
    this.u = new uPlot({ ...shared, ...options }, data, this.element);
    this.u.root.querySelector("canvas").setAttribute("aria-hidden", "true");
  }

  redraw() {
    this.u?.redraw(false, true);
  }

  clear() {
    this.u?.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }
}

/** Input and output over time. `ask(low, high)` gets the rows of a stretch; `brushed(low, high)` what was chosen. */
export class TimePlot extends Base {
  constructor(element, { ask, brushed, hovered, height = 280 }) {
    super(element, height);
    Object.assign(this, { ask, brushed, hovered, view: null });
    element.tabIndex = 0;
    element.setAttribute("role", "group");
    element.addEventListener("keydown", (event) => {
      const moves = { ArrowLeft: () => this.pan(-0.2), ArrowRight: () => this.pan(0.2), "+": () => this.zoom(0.5), "=": () => this.zoom(0.5),
        "-": () => this.zoom(2), 0: () => this.all(), Home: () => this.all() };
      if (moves[event.key] && !event.ctrlKey && !event.metaKey && !event.altKey) {
        moves[event.key]();
        event.preventDefault();
      }
    });
  }

  show(rows, names, whole) {
    if (!this.full || whole) this.full = extent(rows.x);
    const { x, u, y, state } = rows, n = x.length;
    const xs = [], us = [], lines = { [USED]: [], [EXCLUDED]: [], [HELD_OUT]: [] };
    this.points = []; // beside each of xs
    for (let k = 0; k < n; k += 1) {
      if (k && state[k] >= GAP) {
        xs.push(x[k]);
        us.push(null);
        for (const line of Object.values(lines)) line.push(null);
        this.points.push({ u: u[k], y: y[k] });
      }
      xs.push(x[k]);
      this.points.push({ u: u[k], y: y[k] });
      us.push(Number.isFinite(u[k]) ? u[k] : null);
      const now = state[k] % GAP, before = k ? state[k - 1] % GAP : now;
      for (const word of [USED, EXCLUDED, HELD_OUT]) {
        const here = word === now || (word === before && state[k] < GAP);
        lines[word].push(here && Number.isFinite(y[k]) ? y[k] : null);
      }
    }
    const data = [xs, us, lines[EXCLUDED], lines[USED], lines[HELD_OUT]];
    const label = `${names.x} ${names.u} ${names.y}`;
    if (this.u && this.label === label) {
      this.u.setData(data, false);
      this.u.setScale("x", { min: this.low, max: this.high });
      return;
    }
    this.label = label;
    const e = this.element;
    const line = (name, scale, width = 1.5) => ({ scale, stroke: () => colour(e, name), width, points: { show: n < 60, size: 4 }, spanGaps: false });
    this.make({
      scales: {
        x: { time: false, range: () => [this.low, this.high] },
        u: { range: (_, low, high) => padded(low, high) }, y: { range: (_, low, high) => padded(low, high) },
      },
      axes: [axis(e, names.x, { size: 34 }), axis(e, names.y, { scale: "y" }),
        axis(e, names.u, { scale: "u", side: 1, grid: { show: false }, stroke: () => colour(e, "--input") })],
      series: [{}, line("--input", "u", 1), line("--excluded", "y"), line("--measured", "y"), line("--held", "y")],
      cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false }, y: false },
      hooks: {
        setSelect: [(plot) => {
          if (plot.select.width < 3) return;
          this.brushed?.(plot.posToVal(plot.select.left, "x"), plot.posToVal(plot.select.left + plot.select.width, "x"));
        }],
        setCursor: [(plot) => this.hovered?.(this.points[plot.cursor.idx])],
        ready: [(plot) => {
          plot.over.addEventListener("wheel", (event) => {
            event.preventDefault();
            const at = plot.posToVal(event.offsetX, "x");
            if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.pan((event.deltaX || event.deltaY) / 600);
            else this.zoom(event.deltaY > 0 ? 1.25 : 0.8, at);
          }, { passive: false });
          plot.over.addEventListener("dblclick", () => this.all());
        }],
      },
    }, data);
  }

  get low() { return this.view ? this.view[0] : this.full[0]; }
  get high() { return this.view ? this.view[1] : this.full[1] > this.full[0] ? this.full[1] : this.full[0] + 1; }

  zoom(factor, at = (this.low + this.high) / 2) {
    this.to(at - (at - this.low) * factor, at + (this.high - at) * factor);
  }

  pan(share) {
    const step = share * (this.high - this.low);
    this.to(this.low + step, this.high + step);
  }

  all() {
    this.to(this.full[0], this.full[1]);
  }

  to(low, high) {
    const span = high - low, [first, last] = this.full;
    if (low < first) { low = first; high = Math.min(first + span, last); }
    if (high > last) { high = last; low = Math.max(last - span, first); }
    if (!(high > low)) return;
    this.view = low <= first && high >= last ? null : [low, high];
    this.clear();
    this.u?.setScale("x", { min: this.low, max: this.high });
    this.ask(this.view);
  }

  mark(low, high) {
    const left = this.u.valToPos(low, "x"), right = this.u.valToPos(high, "x");
    this.u.setSelect({ left, top: 0, width: Math.max(right - left, 2), height: this.u.over.clientHeight }, false);
  }
}

function joinedBy(e, { colour: name, width = 1.5, dots, dash = [], filled }) {
  return (u, index) => {
    uPlot.orient(u, index, (series, xs, ys, scaleX, scaleY, posX, posY, left, top, wide, high) => {
      const [dx, dy, gap] = u.data[index], ctx = u.ctx;
      ctx.save();
      ctx.beginPath();
      ctx.rect(left, top, wide, high);
      ctx.clip();
      ctx.strokeStyle = ctx.fillStyle = colour(e, name);
      ctx.lineWidth = width * devicePixelRatio;
      ctx.lineJoin = ctx.lineCap = "round";
      ctx.setLineDash(dash.map((one) => one * devicePixelRatio));
      const size = Math.max(1.4, width) * devicePixelRatio;
      let open = false;
      ctx.beginPath();
      for (let k = 0; k < dx.length; k += 1) {
        if (!Number.isFinite(dx[k]) || !Number.isFinite(dy[k])) { open = false; continue; }
        const px = posX(dx[k], scaleX, wide, left), py = posY(dy[k], scaleY, high, top);
        if (dots) ctx.fillRect(px - size / 2, py - size / 2, size, size);
        else if (open && !gap?.[k]) ctx.lineTo(px, py);
        else ctx.moveTo(px, py);
        open = true;
      }
      if (filled) ctx.fill();
      else if (!dots) ctx.stroke();
      ctx.restore();
    });
    return null;
  };
}

const told = (x) => Number(x.toPrecision(5)).toString();

/**
 * Curves of one quantity over another: `[{name, x, y, gap, colour, width, dots, dash, filled}]`. A box that is drawn goes
 * to `brushed`, or the plot shows it alone until it is clicked twice. `key`, a list, gets a button for each curve with a
 * name, which hides it and shows it again.
 */
export class LoopPlot extends Base {
  constructor(element, { brushed = null, key = null, height = 280 } = {}) {
    super(element, height);
    Object.assign(this, { brushed, key, box: null, hidden: new Set() });
    this.dot = h("div", { class: "dot" });
    this.tip = h("div", { class: "tip" });
  }

  /** `within`: the curves that the axes are to hold, where they are more; `logarithmic` names such axes: "x", "xy". */
  show(curves, x, y, within = curves, logarithmic = "") {
    const e = this.element, [logX, logY] = ["x", "y"].map((name) => logarithmic.includes(name));
    const shown = this.shown = curves.filter((curve) => curve.x.length && !this.hidden.has(curve.name));
    const ends = within.filter((curve) => curve.x.length).map((curve) => [...extent(curve.x), ...extent(curve.y)]);
    const over = (k, best) => ends.reduce((found, one) => best(found, one[k]), best === Math.min ? Infinity : -Infinity);
    this.across = padded(over(0, Math.min), over(1, Math.max), logX);
    this.along = padded(over(2, Math.min), over(3, Math.max), logY);
    const data = [null, ...shown.map((curve) => [curve.x, curve.y, curve.gap])];
    this.make({
      mode: 2,
      scales: {
        x: { time: false, auto: false, distr: logX ? 3 : 1, range: () => (this.box ? this.box.slice(0, 2) : this.across) },
        y: { auto: false, distr: logY ? 3 : 1, range: () => (this.box ? this.box.slice(2) : this.along) },
      },
      axes: [axis(e, x, { size: 34, ...(logX && decades) }), axis(e, y, logY ? decades : {})],
      series: [null, ...shown.map((curve) => ({
        facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }],
        paths: joinedBy(e, curve), points: { show: false }, stroke: "transparent",
      }))],
      cursor: { drag: { x: true, y: true, uni: 20, setScale: false }, points: { show: false }, dataIdx: () => null },
      hooks: {
        setSelect: [(u) => {
          const { left, top, width, height } = u.select;
          if (width < 3 || height < 3) return;
          const box = [u.posToVal(left, "x"), u.posToVal(left + width, "x"), u.posToVal(top + height, "y"), u.posToVal(top, "y")];
          if (this.brushed) this.brushed(box);
          else this.zoom(box);
        }],
        setCursor: [(u) => this.hover(u.cursor)],
        ready: [(u) => u.over.addEventListener("dblclick", () => this.brushed || this.zoom(null))],
      },
    }, data);
    this.u.over.append(this.dot, this.tip);
    this.key?.replaceChildren(...curves.filter((curve) => curve.name).map((curve) => this.button(curve, () => this.show(curves, x, y, within, logarithmic))));
  }

  button({ name, colour: tone }, again) {
    const item = h("li", {}, h("button", { type: "button", "aria-pressed": String(!this.hidden.has(name)), onclick: () => {
      if (!this.hidden.delete(name)) this.hidden.add(name);
      again();
      [...this.key.querySelectorAll("button")].find((one) => one.textContent === name).focus();
    } }, name));
    item.style.setProperty("--tone", tone.startsWith("--") ? `var(${tone})` : tone);
    return item;
  }

  zoom(box) {
    this.box = box;
    this.clear();
    const [left, right, bottom, top] = box ?? [...this.across, ...this.along];
    this.u.batch(() => {
      this.u.setScale("x", { min: left, max: right });
      this.u.setScale("y", { min: bottom, max: top });
    });
  }

  /** Tell the point of a curve that is nearest to the mouse, within 30 pixels. */
  hover({ left, top }) {
    let best = 30 ** 2, found = null;
    const { u } = this, pixels = ["x", "y"].map((name) => {
      const { min, max, distr } = u.scales[name], to = distr === 3 ? Math.log10 : (value) => value, low = to(min);
      const long = name === "x" ? u.over.clientWidth : u.over.clientHeight, scale = long / (to(max) - low);
      return name === "x" ? (value) => (to(value) - low) * scale : (value) => long - (to(value) - low) * scale;
    });
    for (const { name, x, y, filled } of left >= 0 && top >= 0 ? this.shown : []) {
      for (let k = 0; k < x.length && !filled; k += 1) {
        const far = (pixels[0](x[k]) - left) ** 2 + (pixels[1](y[k]) - top) ** 2;
        if (far < best && x[k] !== null && y[k] !== null) [best, found] = [far, { name, u: x[k], y: y[k] }];
      }
    }
    this.point(found);
    this.tip.style.display = found ? "block" : "none";
    if (!found) return;
    this.tip.textContent = `${found.name ? `${found.name}: ` : ""}${told(found.u)}, ${told(found.y)}`;
    this.tip.style.transform = `translate(${left > u.over.clientWidth / 2 ? "calc(-100% - 12px)" : "12px"}, -130%)`;
    this.tip.style.left = `${pixels[0](found.u)}px`;
    this.tip.style.top = `${Math.max(pixels[1](found.y), 24)}px`;
  }

  point(at) {
    const here = at && this.u && Number.isFinite(at.u) && Number.isFinite(at.y);
    this.dot.style.display = here ? "block" : "none";
    if (!here) return;
    this.dot.style.left = `${this.u.valToPos(at.u, "x")}px`;
    this.dot.style.top = `${this.u.valToPos(at.y, "y")}px`;
  }
}

/** The rows of loops as curves, one for each state. */
export function loopCurves(rows, joined) {
  const words = [[EXCLUDED, "--excluded"], [USED, "--measured"], [HELD_OUT, "--held"]];
  return words.map(([word, name]) => {
    const x = [], y = [], gap = [];
    let last = -2;
    for (let k = 0; k < rows.x.length; k += 1) {
      const here = rows.state[k] % GAP === word, follows = k && rows.state[k - 1] % GAP === word && rows.state[k] < GAP;
      if (!here && !(follows && joined)) continue;
      x.push(rows.u[k]);
      y.push(rows.y[k]);
      gap.push(rows.state[k] >= GAP || k !== last + 1);
      last = k;
    }
    return { x, y, gap, colour: name, width: joined ? 1.4 : 1.6, dots: !joined };
  });
}
