// Elements, requests and numbers, as every part of the page needs them.
import { h } from "./plots.js";

export { h };

/** Put children into an element in place of what was there; what is not there is left out. The focus stays, and
    what was unfolded. */
export function fill(element, ...children) {
  const focused = element.contains(document.activeElement) ? document.activeElement.id : "";
  const folded = [...element.querySelectorAll("details[id]")].map(({ id, open }) => [id, open]);
  element.replaceChildren(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false && child !== ""));
  for (const [id, open] of folded) if (document.getElementById(id)) document.getElementById(id).open ||= open;
  if (focused) document.getElementById(focused)?.focus({ preventScroll: true });
}

export class Refused extends Error {
  constructor(fault) {
    super(fault.message);
    this.fault = fault;
  }
}

async function answered(request) {
  const answer = await request;
  if (answer.ok) return answer;
  let fault = { code: "http", message: `The studio answered with status ${answer.status}.` };
  try {
    fault = (await answer.json()).error ?? fault;
  } catch { /* the server is too busy for words of its own */ }
  throw new Refused(fault);
}

/** Exchange the token of the address, which is good once, for a session; a browser that has one keeps it. */
async function enter() {
  const token = new URLSearchParams(location.search).get("token");
  if (!token) return;
  history.replaceState(null, "", location.pathname + location.hash);
  const answer = await fetch("api/enter", { method: "POST", body: JSON.stringify({ token }) });
  if (answer.ok) localStorage.setItem("session", (await answer.json()).session);
}

const entered = enter().catch(() => {}); // the first request tells what is wrong

/** What shows that a request is this page's; unlike a cookie, no other port of this machine gets it. */
async function own() {
  await entered;
  return { "X-Hysid": localStorage.getItem("session") ?? "" };
}

/** A link to a file of the folder, by an address with a key that is good for this file alone. */
export function fileLink(path, text, { download = false } = {}) {
  const link = h("a", download ? { download: "" } : { target: "_blank", rel: "noopener" }, text);
  getJson("api/link", { name: path }).then(({ address }) => { link.href = download ? `${address}&download=1` : address; }, () => {});
  return link;
}

export async function get(path, query = {}, signal = undefined) {
  const given = Object.fromEntries(Object.entries(query).filter(([, value]) => value !== null && value !== undefined));
  return answered(fetch(`${path}?${new URLSearchParams(given)}`, { headers: await own(), signal }));
}

export async function getJson(path, query, signal) {
  return (await get(path, query, signal)).json();
}

export async function post(path, body) {
  const headers = { "Content-Type": "application/json", ...await own() };
  return (await answered(fetch(path, { method: "POST", headers, body: JSON.stringify(body) }))).json();
}

export async function upload(file) {
  const path = `api/upload?${new URLSearchParams({ name: file.name })}`;
  return (await answered(fetch(path, { method: "POST", headers: await own(), body: file }))).json();
}

export function number(x, digits = 3) {
  if (x === null || x === undefined || !Number.isFinite(x)) return "–";
  const size = Math.abs(x);
  if (size !== 0 && (size < 1e-4 || size >= 1e6)) return x.toExponential(digits - 1).replace("-", "−");
  return Number(x.toPrecision(digits)).toLocaleString("en", { maximumFractionDigits: 12 }).replace("-", "−");
}

const written = (unit) => (unit === "percent" ? "%" : unit.replaceAll(" * ", "·").replaceAll(" / ", "/"));
export const quantity = (x, unit, digits) => `${number(x, digits)}${unit && unit !== "1" ? `\u00a0${written(unit)}` : ""}`;

export function duration(seconds) {
  if (seconds < 60) return `${Math.max(1, Math.round(seconds))} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
  return `${Math.floor(seconds / 3600)} h ${Math.round((seconds % 3600) / 60)} min`;
}

/** What the command line says behind a colon, as a sentence of its own. */
export const sentence = (text) => text && text[0].toUpperCase() + text.slice(1).replaceAll(" +- ", " ± ");

export function faultBox(fault) {
  return h("div", { class: "fault", role: "alert" }, h("p", {}, h("strong", {}, sentence(fault.message))),
    fault.where && h("p", { class: "soft" }, fault.where),
    fault.cause && h("p", {}, `Likely cause: ${fault.cause}`), fault.fix && h("p", {}, sentence(fault.fix)));
}

/** What went wrong, as a box: the studio's words, or the browser's. */
export const faultOf = (error) => faultBox(error.fault ?? { message: error.message ?? String(error) });

export function say(text) {
  document.getElementById("live").textContent = text;
}

/** "The same as a command, and in Python", each with a button that copies it. */
export function sameLines(lines, said = "The same as a command, and in Python") {
  const part = (title, text) => text && [
    h("div", { class: "code" }, h("span", {}, title), h("button", {
      type: "button", class: "quiet small", onclick: async (event) => {
        const button = event.currentTarget;
        await navigator.clipboard.writeText(text);
        button.textContent = "Copied";
        say("Copied.");
        setTimeout(() => { button.textContent = "Copy"; }, 1500);
      },
    }, "Copy", h("span", { class: "unseen" }, ` ${title}`))),
    h("pre", { tabIndex: 0, role: "region", "aria-label": title }, text),
  ];
  return h("details", { class: "same" }, h("summary", {}, said),
    part("Command", lines.command), part("Python", lines.python));
}

export function table(caption, columns, rows) {
  return h("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": caption },
    h("table", { class: "tight" }, h("caption", {}, caption),
      h("thead", {}, h("tr", {}, columns.map((name, k) => h("th", { scope: "col", class: k ? "figure" : "" }, name)))),
      h("tbody", {}, rows.map(({ cells, ...attributes }) => h("tr", attributes, cells.map((cell, k) =>
        k ? h("td", { class: "figure" }, cell) : h("th", { scope: "row" }, cell)))))));
}

export const word = (level) => h("span", { class: `word ${level}` }, level);

/** The settings of a table of the configuration; what is emptied goes back to its default. */
export function settingFields(settings, of, now, set, open = false) {
  const field = ({ name, label, help, choices, kind, default: usual }) => {
    const value = now[name] ?? usual, id = `${of}-${name}`, about = h("small", { id: `${id}-help` }, help);
    const given = (input) => kind === "check" ? input.checked || null : input.value.trim() === "" || input.value === String(usual) ? null
      : kind === "number" ? Number(input.value) : kind === "list" ? input.value.split(";").map((one) => one.trim()) : input.value;
    const more = { id, "aria-describedby": about.id, onchange: (event) => set({ [name]: given(event.target) }) };
    return h("div", {}, h("label", { for: id }, label), choices.length
      ? h("select", more, [...usual === null ? [""] : [], ...choices].map((one) => h("option", { value: one, selected: one === (value ?? "") }, one || "–")))
      : h("input", { ...more, type: kind === "check" ? "checkbox" : kind === "number" ? "number" : "text", step: "any", checked: value === true,
        value: value === null || value === undefined ? "" : [value].flat().join("; ") }), about);
  };
  return h("details", { class: "same", id: `${of}-settings`, open }, h("summary", {}, "More settings"), h("div", { class: "settings" }, settings.filter((one) => one.of === of).map(field)));
}

const DEEDS = { fit: "Fitting", sample: "Sampling the posterior", qualify: "Judging the compensator", predict: "Running the compensator", export: "Exporting", report: "Writing the report", compare: "Comparing" };

/** A command behind a button. Its progress, its answer and its errors stand beside the button, and only while they are
    those of what is chosen: `options()` says what that is, `answer(job)` makes the elements of the answer. */
export class Deed {
  constructor(studio, kind, label, { options = () => ({}), beside = "", answer = () => "", ended = () => {}, more = "" } = {}) {
    Object.assign(this, { studio, kind, label, options, answer, ended, blocked: false });
    this.button = h("button", { type: "button", class: more, onclick: () => this.start() });
    this.running = h("div", { class: "running", hidden: true });
    this.said = h("div");
    this.element = h("div", { class: "task" }, h("div", { class: "row" }, beside, this.button, this.running), this.said);
    this.update();
  }

  async start() {
    this.button.disabled = true;
    fill(this.said);
    try {
      await this.studio.pending();
      await this.studio.poll(); // what was chosen may have been written only now
      const { number: mine } = await post(this.kind === "compare" ? "api/compare" : "api/start", { kind: this.kind, name: this.studio.name, ...this.options() });
      this.seen = mine;
      say(`${DEEDS[this.kind]} has begun.`);
      await this.studio.poll();
    } catch (error) {
      fill(this.said, faultOf(error));
    }
    this.update();
  }

  update() {
    const { jobs } = this.studio.state(), asked = Object.entries(this.options());
    const own = jobs.filter((job) => job.subject === this.studio.name);
    const same = own.filter((one) => one.kind === this.kind), is = (one) => asked.every(([key, value]) => Array.isArray(value) || one.options[key] === value);
    const job = same.find((one) => one.state === "running") ?? same.findLast(is), busy = job?.state === "running", shown = JSON.stringify([asked, job?.number, job?.state]);
    this.button.disabled = this.blocked || own.some((one) => one.state === "running");
    this.button.textContent = busy ? `${DEEDS[this.kind]} …` : typeof this.label === "string" ? this.label : this.label();
    if (this.shown !== shown) {
      this.shown = shown;
      this.running.hidden = !busy;
      if (busy) {
        this.bar = h("progress", { max: "1", "aria-label": DEEDS[this.kind] });
        this.left = h("span", { class: "soft" });
        fill(this.running, this.bar, this.left, h("button", { type: "button", class: "small", onclick: () => post("api/cancel", { number: job.number }).then(this.studio.poll) }, "Cancel"));
      }
      fill(this.said, job?.state === "failed" && faultBox(job.error), job?.state === "done" && this.answer(job),
        job?.state === "cancelled" && h("p", { class: "soft" }, "Cancelled. What was there before is unchanged."));
      if (job?.state === "done" && this.seen === job.number) this.ended(job);
      if (job?.state === "failed" && this.seen === job.number) this.element.scrollIntoView({ block: "nearest" });
      this.seen = busy ? job.number : null;
    }
    if (!busy) return;
    if (job.total) this.bar.value = job.done / job.total;
    this.left.textContent = [`${duration(job.seconds)} so far`, job.left !== null && `about ${duration(job.left)} left`, job.said.at(-1)].filter(Boolean).join(" · ");
  }
}
