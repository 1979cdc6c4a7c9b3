// The page: the measurements of the folder, the one that is open, its fit, and what runs.
import { DataPanel } from "./data.js";
import { duration, faultBox, fill, getJson, h, post, sameLines, say, table, upload, word } from "./page.js";
import { ResultPanel } from "./result.js";
import { comparison } from "./compare.js";

const main = document.getElementById("main");
const page = { state: null, name: null, version: -1, ended: new Set(), compared: new Set() };

// Light and dark

const themeButton = document.getElementById("theme");
const systemDark = matchMedia("(prefers-color-scheme: dark)");
function theme(wanted) {
  if (wanted) document.documentElement.dataset.theme = wanted;
  const dark = (wanted ?? (systemDark.matches ? "dark" : "light")) === "dark";
  themeButton.textContent = dark ? "Light" : "Dark";
  themeButton.setAttribute("aria-label", dark ? "Use light colours" : "Use dark colours");
  requestAnimationFrame(() => {
    page.data?.time?.redraw();
    page.data?.loops?.redraw();
    page.result?.redraw();
  });
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
  for (const file of files) {
    say(`Reading ${file.name}.`);
    try {
      const { name } = await upload(file);
      first ??= name;
    } catch (error) {
      main.prepend(faultBox(error.fault ?? { message: String(error) }));
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
  const text = JSON.stringify([page.state.files, [...running], page.name]);
  if (list.dataset.shown === text) return;
  list.dataset.shown = text;
  const focused = list.contains(document.activeElement) ? document.activeElement.dataset.name : null;
  fill(list, ...page.state.files.map((file) => h("li", {}, h("button", {
    type: "button", "data-name": file.name, "aria-current": file.name === page.name ? "page" : null, onclick: () => open(file.name),
  }, h("span", { class: "name" }, file.name), running.has(file.name) ? h("span", { class: "soft" }, "…") : file.fit ? word(file.fit.level) : ""))));
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
  comparison(main, page.state.files.filter((file) => file.fit).map((file) => file.name), () => page.state.jobs, poll);
}

// The open measurement

async function open(name) {
  if (page.name !== name) {
    Object.assign(page, { name, seenOf: null, titleShown: null, fitShown: null, look: null });
    location.hash = encodeURIComponent(name);
    document.title = `${name} · hysid studio`;
    page.data = new DataPanel(name, (look) => show(look));
    page.result = new ResultPanel(name, start);
    page.title = h("div", { class: "head" });
    page.fit = h("section", { class: "card", "aria-labelledby": "fit-title" });
    page.fault = h("div");
    fill(main, page.title, page.fault, page.data.element, page.fit, page.result.element);
    fill(page.title, h("div", {}, h("h1", {}, name), h("p", { class: "soft" }, "Reading …")));
    listFiles();
  }
  try {
    const look = await post("api/look", { name });
    if (page.name === name) show(look);
  } catch (error) {
    if (page.name === name) fill(main, faultBox(error.fault ?? { message: String(error) }));
  }
}

function show(look) {
  const seen = JSON.stringify({ ...look, equivalents: null });
  page.look = look;
  heading();
  fitSection();
  if (page.seen === seen && page.seenOf === page.name) return;
  const first = page.seenOf !== page.name, before = page.seenOf === page.name ? page.seenLook : null;
  Object.assign(page, { seen, seenOf: page.name, seenLook: look });
  const same = (key) => before && JSON.stringify(before[key]) === JSON.stringify(look[key]);
  if (!before || !["selection", "fault", "columns", "findings"].every(same)) page.data.show(look);
  if (!before || !["result", "result_fault"].every(same)) page.result.show(look, page.state.files, page.state.targets);
  if (first) page.exportWanted = false;
}

const jobHere = () => page.state.jobs.findLast((job) => job.subject === page.name && job.state === "running");

function heading() {
  const { look } = page, job = jobHere(), { selection } = look;
  const sides = selection?.output && selection?.input ? `${[selection.input].flat().join(" + ")} → ${selection.output}` : "";
  const facts = [look.rows && `${look.rows.toLocaleString("en")} rows`, sides].filter(Boolean).join(" · ");
  const text = JSON.stringify([page.name, facts, job?.number, Boolean(look.result), Boolean(selection?.output)]);
  if (page.titleShown === text) return;
  page.titleShown = text;
  fill(page.title, h("div", {}, h("h1", {}, page.name), h("p", { class: "soft" }, facts)),
    h("button", { type: "button", class: "deed", disabled: Boolean(job) || !selection?.output, onclick: () => start("fit") }, job?.kind === "fit" ? "Fitting …" : look.result ? "Fit again" : "Fit"));
}

const PURPOSES = { predict: "to predict", compensate: "to compensate", constants: "for its constants" };

function fitSection() {
  const { look } = page, fit = look.fit ?? {}, job = jobHere();
  const last = page.state.jobs.findLast((one) => one.subject === page.name && one.state !== "done");
  const chosen = [fit.model ?? "auto"].flat().join(",").split(",").map((one) => one.trim().toLowerCase());
  const text = JSON.stringify([page.name, fit, look.selection, job?.number, last?.number, last?.state]);
  page.fit.hidden = !look.selection?.output && !job;
  if (page.fitShown !== text) {
    page.fitShown = text;
    page.progress = null;
    const auto = chosen.includes("auto");
    const set = (changes) => page.data.set({ fit: changes });
    const models = page.state.models.map((name) => h("label", { class: "field" }, h("input", { type: "checkbox", checked: !auto && chosen.includes(name.toLowerCase()), onchange: () => {
      const names = [...page.fit.querySelectorAll("[data-model]:checked")].map((box) => box.dataset.model);
      set({ model: names.length ? names.join(",") : "auto" });
    }, "data-model": name }), name));
    const idle = [h("div", { class: "row", role: "group", "aria-label": "Models" }, h("label", { class: "field" },
      h("input", { type: "checkbox", checked: auto, onchange: () => set({ model: "auto" }) }), "Choose for me"), h("span", { class: "soft" }, "or"), models),
    h("div", { class: "row" }, h("label", { class: "field" }, "The model is meant ", h("select", { onchange: (event) => set({ purpose: event.target.value === "predict" ? null : event.target.value }) },
      Object.entries(PURPOSES).map(([value, said]) => h("option", { value, selected: (fit.purpose ?? "predict") === value }, said)))))];
    fill(page.fit, h("h2", { id: "fit-title" }, "Fit"), ...(job ? [running(job)] : idle),
      !job && last?.state === "failed" ? faultBox({ message: last.error?.message, cause: last.error?.cause, fix: last.error?.fix, where: last.error?.where }) : "",
      !job && last?.state === "cancelled" ? h("p", { class: "soft" }, `The last command (${last.kind}) was cancelled. What was there before is unchanged.`) : "",
      sameLines(look.equivalents.fit));
  }
  if (job && page.progress) advance(job);
}

const DEEDS = { fit: "Fitting", sample: "Sampling the posterior", qualify: "Judging the compensator", predict: "Running the compensator", export: "Exporting", report: "Writing the report", compare: "Comparing" };

function running(job) {
  const bar = h("progress", { max: "1", "aria-label": DEEDS[job.kind] }), left = h("span", { class: "said" }), said = h("pre", { tabIndex: 0, role: "region", "aria-label": "Log" });
  page.progress = { bar, left, said };
  return h("div", {}, h("div", { class: "bar" }, h("strong", {}, DEEDS[job.kind]), left,
    h("button", { type: "button", class: "small", onclick: () => post("api/cancel", { number: job.number }).then(poll) }, "Cancel")), bar, said);
}

function advance(job) {
  const { bar, left, said } = page.progress;
  if (job.total) bar.value = job.done / job.total;
  const passed = `${duration(job.seconds)} so far`;
  left.textContent = job.left !== null ? `${passed}, about ${duration(job.left)} left` : passed;
  const text = job.said.join("\n") || "Starting …";
  if (said.textContent !== text) said.textContent = text;
}

async function start(kind, options = {}) {
  page.fault?.replaceChildren();
  try {
    await page.data.pending;
    await post("api/start", { kind, name: page.name, ...options });
    if (kind === "export") page.exportWanted = true;
    say(`${DEEDS[kind]} has begun.`);
    await poll();
    if (kind === "fit") page.fit.scrollIntoView({ block: "nearest" });
  } catch (error) {
    fill(page.fault, faultBox(error.fault ?? { message: String(error) }));
  }
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
      const files = JSON.stringify(page.state.files.find((file) => file.name === page.name));
      const changed = page.state.version !== page.version || files !== page.filesSeen;
      page.filesSeen = files;
      page.version = page.state.version;
      if (page.look) {
        heading();
        fitSection();
      }
      const done = page.state.jobs.filter((job) => job.subject === page.name && job.state !== "running" && !page.ended.has(job.number));
      if (page.look && changed) await open(page.name);
      for (const job of done) {
        page.ended.add(job.number);
        if (job.state === "done" && page.begun) finished(job);
      }
    }
    page.begun = true;
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

function finished(job) {
  say(job.kind === "fit" && page.look.result ? `Verdict: ${page.look.result.level}.` : `${DEEDS[job.kind]}: done.`);
  page.result.ended(job);
  if (job.kind === "fit") document.getElementById("verdict")?.scrollIntoView({ block: "start", behavior: "auto" });
}

addEventListener("hashchange", () => {
  const name = decodeURIComponent(location.hash.slice(1));
  if (name && name !== page.name) open(name);
});

await poll();
const asked = decodeURIComponent(location.hash.slice(1));
if (page.state?.files.some((file) => file.name === asked)) open(asked);
else welcome();
