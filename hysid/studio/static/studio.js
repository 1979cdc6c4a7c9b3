// The page: the measurements of the folder, the one that is open, its fit, and what runs.
import { DataPanel } from "./data.js";
import { Deed, faultBox, faultOf, fill, getJson, h, post, sameLines, say, settingFields, upload, word } from "./page.js";
import { ResultPanel } from "./result.js";
import { comparison } from "./compare.js";

const main = document.getElementById("main");
const page = { state: null, name: null, version: -1 };
/** What a button needs of the page: the measurement it acts on, the jobs, changes on their way, a fresh look. */
const studio = (name) => ({ name, state: () => page.state, pending: () => page.data?.pending, poll: () => poll() });

// Light and dark

const themeButton = document.getElementById("theme");
const systemDark = matchMedia("(prefers-color-scheme: dark)");
function theme(wanted) {
  if (wanted) document.documentElement.dataset.theme = wanted;
  const dark = (wanted ?? (systemDark.matches ? "dark" : "light")) === "dark";
  themeButton.textContent = dark ? "Light" : "Dark";
  themeButton.setAttribute("aria-label", dark ? "Use light colours" : "Use dark colours");
  requestAnimationFrame(() => document.querySelectorAll(".plot").forEach(({ plot }) => plot.redraw()));
  return dark;
}
themeButton.addEventListener("click", () => {
  const wanted = theme(document.documentElement.dataset.theme) ? "light" : "dark";
  localStorage.setItem("theme", wanted);
  theme(wanted);
});
systemDark.addEventListener("change", () => theme(localStorage.getItem("theme")));
theme(localStorage.getItem("theme"));

// Files

async function take(files) {
  let first = null;
  fill(document.getElementById("dropped"));
  for (const file of files) {
    say(`Reading ${file.name}.`);
    try {
      const { name } = await upload(file);
      first ??= name;
    } catch (error) {
      fill(document.getElementById("dropped"), faultOf(error));
    }
  }
  if (first) {
    await poll();
    open(first);
  }
}

document.getElementById("upload").addEventListener("change", (event) => take([...event.target.files]));
for (const kind of ["dragover", "dragleave", "drop"]) {
  addEventListener(kind, (event) => {
    event.preventDefault();
    document.getElementById("drop").classList.toggle("over", kind === "dragover");
    if (kind === "drop" && event.dataTransfer.files.length) take([...event.dataTransfer.files]);
  });
}

function listFiles() {
  const list = document.getElementById("files");
  const running = new Set(page.state.jobs.filter((job) => job.state === "running").map((job) => job.subject));
  const stale = (file) => file.name === page.name && page.look?.result?.stale;
  const text = JSON.stringify([page.state.files, [...running], page.name, Boolean(page.look?.result?.stale)]);
  if (list.dataset.shown === text) return;
  list.dataset.shown = text;
  const focused = list.contains(document.activeElement) ? document.activeElement.dataset.name : null;
  fill(list, ...page.state.files.map((file) => h("li", {}, h("button", {
    type: "button", "data-name": file.name, "aria-current": file.name === page.name ? "page" : null, onclick: () => open(file.name),
  }, h("span", { class: "name" }, file.name), running.has(file.name) ? h("span", { class: "soft" }, "…") : stale(file) ? h("span", { class: "soft" }, "changed") : file.fit ? word(file.fit.level) : ""))));
  const fitted = page.state.files.filter((file) => file.fit).length;
  fill(document.getElementById("compare"), fitted > 1 && h("button", { type: "button", class: "quiet", onclick: compare }, `Compare ${fitted} fits`));
  if (focused) [...list.querySelectorAll("button")].find((button) => button.dataset.name === focused)?.focus();
}

function welcome() {
  page.name = null;
  document.title = "hysid studio";
  fill(main, h("section", { class: "card welcome" }, h("h1", {}, "From a measurement to a verdict"),
    h("p", {}, "Drop a file of your rig, look at what hysid made of it, and press Fit. Everything stays in this folder, in the same files as the command line writes."),
    h("label", { class: "drop", for: "upload" }, h("strong", {}, "Drop a file anywhere on this page"), h("span", {}, "CSV, spreadsheets, TDMS, MAT, HDF5, Parquet, ROS bags and what testing machines write"))));
}

function compare() {
  page.name = null;
  page.look = null;
  location.hash = "";
  document.title = "Comparison · hysid studio";
  listFiles();
  page.comparison = comparison(main, page.state.files.filter((file) => file.fit).map((file) => file.name), studio("comparison"));
}

// The open measurement

async function open(name) {
  if (page.name !== name) {
    Object.assign(page, { name, seen: null, look: null, titleShown: null, fitShown: null, comparison: null });
    location.hash = encodeURIComponent(name);
    document.title = `${name} · hysid studio`;
    page.data = new DataPanel(name, page.state, (look) => show(look));
    page.result = new ResultPanel(studio(name), page.state.targets);
    page.title = h("div", {}, h("h1", {}, name), h("p", { class: "soft" }, "Reading …"));
    page.deed = new Deed(studio(name), "fit", () => (page.look?.result ? "Fit again" : "Fit"), { more: "deed", ended: fitted, options: () => {
      const file = page.state.files.find((one) => one.name === name);
      return { stamp: `${file?.stamp} ${file?.edited}` };
    } });
    page.fit = h("section", { class: "card", "aria-labelledby": "fit-title" });
    fill(main, h("div", { class: "head" }, page.title, page.deed.element), page.data.element, page.fit, page.result.element);
    listFiles();
  }
  const before = page.look;
  try {
    const look = await post("api/look", { name });
    if (page.name !== name) return;
    if (page.look === before && !page.data.waiting) show(look);
    else page.version = -1; // something was changed meanwhile: look again
  } catch (error) {
    if (page.name === name) fill(main, faultOf(error));
  }
}

function show(look) {
  const before = page.seen;
  page.look = page.seen = look;
  const same = (...keys) => before && keys.every((key) => JSON.stringify(before[key]) === JSON.stringify(look[key]));
  if (!same("selection", "fault", "asks", "columns", "findings")) page.data.show(look);
  if (!same("result", "result_fault", "seen")) page.drawn = page.result.show(look);
  heading();
  fitSection();
  listFiles();
}

/** After a fit its verdict and its loops are what one sees. */
async function fitted() {
  say(page.look.result ? `Verdict: ${page.look.result.level}.` : "The fit has ended.");
  const see = () => document.getElementById("verdict")?.scrollIntoView({ block: "start" });
  see();
  await page.drawn; // the page was too short before
  see();
}

function heading() {
  const { look } = page, { selection = {} } = look;
  const sides = selection.output && selection.input ? `${[selection.input].flat().join(" + ")} → ${selection.output}` : "";
  const facts = [look.rows && `${look.rows.toLocaleString("en")} rows`, sides].filter(Boolean).join(" · ");
  page.deed.blocked = look.asks || Boolean(look.fault);
  page.deed.update();
  if (page.titleShown === facts) return;
  page.titleShown = facts;
  fill(page.title, h("h1", {}, page.name), h("p", { class: "soft" }, facts));
}

const PURPOSES = { predict: "to predict", compensate: "to compensate", constants: "for its constants" };

function fitSection() {
  const { look } = page, { fit } = look, { constants, models, settings } = page.state;
  const asked = [fit.model ?? "auto"].flat().join(",").split(",").map((one) => one.trim());
  const has = (name) => asked.some((one) => one.toLowerCase() === name.toLowerCase());
  const kind = page.own === page.name ? "own" : has("auto") ? "auto" : asked.length === constants.length && constants.every(has) ? "constants" : "own";
  const text = JSON.stringify([fit, look.asks, kind, look.equivalents.fit]);
  page.fit.hidden = look.asks;
  if (page.fitShown === text) return;
  page.fitShown = text;
  const set = (changes) => page.data.set({ fit: changes });
  const choose = (to) => {
    page.own = to === "own" ? page.name : null;
    if (to === "own") fitSection();
    else set({ model: to === "auto" ? "auto" : constants.join(",") });
  };
  const choice = (to, title, said) => h("div", { class: "choice" }, h("label", { for: `model-${to}` }, h("input", { type: "radio", name: "model", id: `model-${to}`, "aria-describedby": `model-${to}-help`, checked: kind === to, onchange: () => choose(to) }), title),
    h("small", { id: `model-${to}-help` }, said));
  const own = models.map((name) => h("label", { class: "field" }, h("input", { type: "checkbox", id: `own-${name}`, checked: has(name), "data-model": name, onchange: () => {
    const names = [...page.fit.querySelectorAll("[data-model]:checked")].map((box) => box.dataset.model);
    set({ model: names.join(",") || "auto" });
  } }), name));
  fill(page.fit, h("h2", { id: "fit-title" }, "Fit"),
    h("fieldset", {}, h("legend", {}, "Model"),
      choice("auto", "Let hysid choose", "It tries several kinds of models and keeps the one that predicts rows held out from the fit best."),
      choice("constants", "A model with named constants", `The best of ${constants.join(", ")}: a few constants with meanings, units and errors, such as a stiffness.`),
      choice("own", "My own choice", "Tick one or several of all models; the best of them is kept.")),
    kind === "own" && h("div", { class: "row", role: "group", "aria-label": "Models" }, own),
    h("div", { class: "row" }, h("label", { class: "field" }, "The model is meant ", h("select", { id: "purpose", onchange: (event) => set({ purpose: event.target.value === "predict" ? null : event.target.value }) },
      Object.entries(PURPOSES).map(([value, said]) => h("option", { value, selected: (fit.purpose ?? "predict") === value }, said))))),
    settingFields(settings, "fit", fit, set), sameLines(look.equivalents.fit));
}

// What runs, and what other pages and the command line have done

async function poll() {
  clearTimeout(page.timer);
  try {
    page.state = await getJson("api/state");
    document.getElementById("lost")?.remove();
    document.getElementById("folder").textContent = page.state.folder;
    listFiles();
    if (page.name) {
      const files = JSON.stringify(page.state.files);
      const changed = page.state.version !== page.version || files !== page.filesSeen;
      Object.assign(page, { filesSeen: files, version: page.state.version });
      if (page.look && changed) await open(page.name);
      page.deed.update();
      page.result.update();
    }
    page.comparison?.update();
  } catch (error) {
    if (!document.getElementById("lost")) {
      const lost = faultBox(error.fault ?? { message: "The studio does not answer.", fix: "It may have been closed. Start hysid studio again." });
      lost.id = "lost";
      main.prepend(lost);
    }
  }
  const busy = page.state?.jobs.some((job) => job.state === "running");
  page.timer = setTimeout(poll, busy ? 500 : 2000);
}

addEventListener("hashchange", () => {
  const name = decodeURIComponent(location.hash.slice(1));
  if (name && name !== page.name) open(name);
});

await poll();
const asked = decodeURIComponent(location.hash.slice(1));
if (page.state?.files.some((file) => file.name === asked)) open(asked);
else welcome();
