"use strict";
// Orthographic and drawn back to front on a 2D canvas: an ellipsoid's outline is then exactly an ellipse.
const R = JSON.parse(document.getElementById("record").textContent);
const $ = (id) => document.getElementById(id);
const N = R.time.length;
const BLUE = "#0072b2", RED = "#d55e00", GREY = "#8c8c8c";
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = (a) => Math.hypot(...a);
const unit = (a) => { const n = size(a) || 1; return a.map((x) => x / n); };

// The shell: outward normals, and the edges at which it bends or ends.
const low = [0, 1, 2].map((i) => Math.min(...R.vertices.map((v) => v[i])));
const high = [0, 1, 2].map((i) => Math.max(...R.vertices.map((v) => v[i])));
const middle = low.map((x, i) => (x + high[i]) / 2);
const span = size(add(high, low, -1));
const normals = R.triangles.map(([a, b, c]) => {
  const [p, q, r] = [a, b, c].map((k) => R.vertices[k]);
  return unit(cross(add(q, p, -1), add(r, p, -1)));
});
const edges = (() => {
  const seen = new Map();
  R.triangles.forEach((t, k) => [[0, 1], [1, 2], [2, 0]].forEach(([i, j]) => {
    const pair = [Math.min(t[i], t[j]), Math.max(t[i], t[j])], name = pair.join();
    if (!seen.has(name)) seen.set(name, { pair, faces: [] });
    seen.get(name).faces.push(k);
  }));
  return [...seen.values()].filter(({ faces }) =>
    faces.length !== 2 || dot(normals[faces[0]], normals[faces[1]]) < 0.9);
})();

// Touches: runs of rows with a contact; the strongest row of each stands for it.
const strength = R.force.map((F) => F ? size(F) : 0);
const strongest = Math.max(...strength) || 1;
const touches = [];
for (let k = 0, run = null; k < N; k++) {
  if (!R.point[k]) { run = null; continue; }
  if (!run) touches.push(run = { peak: k });
  if (strength[k] > strength[run.peak]) run.peak = k;
}

let row = touches.length ? touches[0].peak : 0, playing = false, clock = R.time[row], last = 0;
const camera = { yaw: -55, pitch: 25, zoom: 1 };

function fitted(canvas) {
  const dpr = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  const w = Math.round(box.width * dpr), h = Math.round(box.height * dpr);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const c = canvas.getContext("2d");
  c.setTransform(dpr, 0, 0, dpr, 0, 0);
  c.clearRect(0, 0, box.width, box.height);
  return [c, box.width, box.height];
}

function scene() {
  const [c, w, h] = fitted($("scene"));
  const [yaw, pitch] = [camera.yaw, camera.pitch].map((d) => d * Math.PI / 180);
  const right = [-Math.sin(yaw), Math.cos(yaw), 0];
  const out = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
  const up = cross(out, right);
  const scale = camera.zoom * 0.78 * Math.min(w / (span * 0.95), h / (span * 0.9));
  const at = (p) => {
    const d = add(p, middle, -1);
    return [w / 2 + scale * dot(d, right), h / 2 - scale * dot(d, up)];
  };
  const path = (points, close) => {
    c.beginPath();
    points.forEach((p, i) => i ? c.lineTo(...p) : c.moveTo(...p));
    if (close) c.closePath();
  };
  const corners = R.vertices.map(at);
  const depth = R.triangles.map((t) => t.reduce((s, k) => s + dot(R.vertices[k], out), 0));
  const order = [...depth.keys()].sort((a, b) => depth[a] - depth[b]);
  const light = unit(add(add(out, up, 0.8), right, -0.5));
  const faces = (front) => order.filter((k) => (dot(normals[k], out) > 0) === front).forEach((k) => {
    const shade = Math.abs(dot(normals[k], light));
    c.fillStyle = front ? `hsla(205, 30%, ${62 + 28 * shade}%, .5)` : `hsl(40, 12%, ${84 + 8 * shade}%)`;
    path(R.triangles[k].map((i) => corners[i]), true);
    c.fill();
  });
  const lines = (front) => {
    c.strokeStyle = front ? "#6d7a83" : "#c3c3bd";
    c.lineWidth = front ? 1.4 : 1;
    edges.filter(({ faces: f }) => f.some((k) => dot(normals[k], out) > 0) === front).forEach(({ pair }) => {
      path(pair.map((i) => corners[i]));
      c.stroke();
    });
  };
  const ball = (p, r, colour) => { c.fillStyle = colour; c.beginPath(); c.arc(...at(p), r, 0, 7); c.fill(); };
  const P = R.point[row], F = R.force[row], along = F && unit(F);
  const ray = (from, to) => {
    c.strokeStyle = RED; c.lineWidth = 1.2; c.setLineDash([5, 5]);
    path([at(add(P, along, from * span)), at(add(P, along, to * span))]); c.stroke();
    c.setLineDash([]);
  };
  const contact = () => {
    ray(-1.2, 0);
    if (R.axes && R.axes[row]) {
      ellipsoid(c, at(P), R.axes[row].map((a) => [scale * dot(a, right), -scale * dot(a, up)]));
    }
    arrow(c, at(add(P, along, -0.28 * span * strength[row] / strongest)), at(P));
    ball(P, 6, "#fff"); ball(P, 4.5, BLUE);
  };

  // What lies behind the faces turned to us is drawn before them: a contact that is pushed towards us.
  const behind = P && F && dot(along, out) > 0;
  faces(false); lines(false);
  axes(c, at, path);
  if (P && F) ray(0, 1.2);
  if (behind) contact();
  faces(true); lines(true);
  touches.filter(({ peak }) => peak < row).forEach(({ peak }) => {
    ball(R.point[peak], 2.5, dot(R.force[peak], out) < 0 ? "#5f5f5fcc" : "#5f5f5f44");
  });
  if (P && F && !behind) contact();
}

function axes(c, at, path) {
  c.font = "12px system-ui, sans-serif"; c.lineWidth = 1.5;
  ["x", "y", "z"].forEach((name, i) => {
    const end = [0, 0, 0]; end[i] = 0.13 * span;
    c.strokeStyle = c.fillStyle = GREY;
    path([at([0, 0, 0]), at(end)]); c.stroke();
    const [x, y] = at(end.map((v) => 1.18 * v));
    c.fillText(name, x - 3, y + 4);
  });
  c.beginPath(); c.arc(...at([0, 0, 0]), 3, 0, 7); c.fill();
}

function arrow(c, tail, tip) {
  const d = [tip[0] - tail[0], tip[1] - tail[1]], n = Math.hypot(...d);
  if (n < 2) return;
  const [x, y] = d.map((v) => v / n), head = Math.min(12, n), back = [tip[0] - head * x, tip[1] - head * y];
  c.strokeStyle = c.fillStyle = RED; c.lineWidth = 3;
  c.beginPath(); c.moveTo(...tail); c.lineTo(...back); c.stroke();
  c.beginPath(); c.moveTo(...tip); c.lineTo(back[0] - 5 * y, back[1] + 5 * x); c.lineTo(back[0] + 5 * y, back[1] - 5 * x); c.fill();
}

// Half axes a_i on the screen: the outline of {sum t_i a_i, |t| = 1} is the ellipse of S = sum a_i a_i'.
function ellipsoid(c, [x, y], half) {
  const [p, q, r] = [0, 1, 2].map((k) => half.reduce((s, a) => s + [a[0] * a[0], a[0] * a[1], a[1] * a[1]][k], 0));
  const mean = (p + r) / 2, off = Math.hypot((p - r) / 2, q);
  c.strokeStyle = BLUE; c.lineWidth = 1.4; c.fillStyle = "rgba(0, 114, 178, .2)";
  c.beginPath();
  c.ellipse(x, y, Math.sqrt(mean + off), Math.sqrt(Math.max(mean - off, 0)), Math.atan2(2 * q, p - r) / 2, 0, 7);
  c.fill(); c.stroke();
  c.lineWidth = 0.7;
  [[0, 1], [1, 2], [2, 0]].forEach(([i, j]) => {
    c.beginPath();
    for (let k = 0; k <= 48; k++) {
      const [s, t] = [Math.cos(k * Math.PI / 24), Math.sin(k * Math.PI / 24)];
      c.lineTo(x + s * half[i][0] + t * half[j][0], y + s * half[i][1] + t * half[j][1]);
    }
    c.stroke();
  });
}

const begin = R.time[0], length = (R.time[N - 1] - begin) || 1;
function strip() {
  const [c, w, h] = fitted($("strip")), foot = h - 16, pad = 8;
  const x = (k) => pad + (w - 2 * pad) * (R.time[k] - begin) / length;
  const y = (k) => foot - (foot - 8) * strength[k] / strongest;
  c.fillStyle = "#555"; c.font = "12px system-ui, sans-serif";
  c.fillText(`|F|, up to ${strongest.toFixed(1)} N`, pad, h - 2);
  c.textAlign = "right"; c.fillText(`${length.toFixed(1)} s`, w - pad, h - 2); c.textAlign = "left";
  const bar = Math.max(1, (w - 2 * pad) / N);
  for (let k = 0; k < N; k++) {
    c.fillStyle = R.status[k] === "OK" ? "#9cc9e3" : R.point[k] ? "#e69f00" : "#dcdcd8";
    c.fillRect(x(k) - bar / 2, y(k), bar, Math.max(foot - y(k), 1));
  }
  c.fillStyle = "#1c1c1c"; c.fillRect(x(row) - 1, 2, 2, foot - 2);
}

const fixed = (x, digits) => x.toFixed(digits).replace("-", "−");
const triple = (v, factor, digits) => v.map((x) => fixed(factor * x, digits)).join(", ");
function numbers() {
  const P = R.point[row], F = R.force[row], M = R.moment[row];
  const A = R.axes && R.axes[row], word = R.status[row];
  $("status").textContent = word.replaceAll("_", " ");
  $("status").className = `status ${word}`;
  $("meaning").textContent = R.meanings[word] || "";
  const none = "–", list = [
    ["time", `${fixed(R.time[row], 2)} s`],
    ["surface", R.surface[row] || none],
    ["|F|", F ? `${fixed(strength[row], 2)} N` : none],
    ["F", F ? `${triple(F, 1, 2)} N` : none],
    ["M", M ? `${triple(M, 1, 2)} N m` : none],
    ["contact", P ? `${triple(P, 1e3, 1)} mm` : none],
    ["pressed in", P ? `${fixed(1e3 * R.displacement[row], 1)} mm` : none],
    ["spin torque", R.spin[row] === null ? none : `${fixed(1e3 * R.spin[row], 0)} mN m`],
  ];
  if (R.axes) list.push(["90 % within", P && A ? `${A.map((a) => fixed(1e3 * size(a), 1)).join(", ")} mm` : none]);
  $("numbers").replaceChildren(...list.flatMap(([name, value]) => {
    const [dt, dd] = ["dt", "dd"].map((tag) => document.createElement(tag));
    dt.textContent = name; dd.textContent = value;
    return [dt, dd];
  }));
  $("slider").value = row;
  $("slider").setAttribute("aria-valuetext", `${fixed(R.time[row], 2)} s, ${word}`);
}

let asked = false;
function draw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; scene(); strip(); numbers(); });
}

// Turn to the side that is touched: at once, or by a part of the way.
function follow(part) {
  const F = R.point[row] && R.force[row];
  if (!F || !$("follow").checked) return;
  const [x, y, z] = unit(F), level = Math.hypot(x, y) > 0.5;
  const yaw = level ? Math.atan2(-y, -x) * 180 / Math.PI + 35 : camera.yaw;
  const pitch = level ? 22 : z < 0 ? 40 : -40;
  camera.yaw += part * (((yaw - camera.yaw + 180) % 360 + 360) % 360 - 180);
  camera.pitch += part * (pitch - camera.pitch);
}

function go(k) { row = Math.min(Math.max(k, 0), N - 1); clock = R.time[row]; follow(1); draw(); }
function play(on) {
  playing = on;
  $("play").textContent = on ? "Pause" : "Play";
  if (on) {
    if (row === N - 1) go(0);
    last = performance.now();
    requestAnimationFrame(tick);
  }
}
function tick(now) {
  if (!playing) return;
  const seconds = (now - last) / 1000;
  clock += Number($("speed").value) * seconds;
  last = now;
  while (row < N - 1 && R.time[row + 1] <= clock) row++;
  follow(1 - Math.exp(-seconds / 0.25));
  draw();
  if (row === N - 1) play(false); else requestAnimationFrame(tick);
}

$("follow").addEventListener("change", () => go(row));
$("slider").max = N - 1;
$("slider").addEventListener("input", (e) => go(Number(e.target.value)));
$("play").addEventListener("click", () => play(!playing));
document.querySelectorAll("[data-view]").forEach((b) => b.addEventListener("click", () => {
  [camera.yaw, camera.pitch] = b.dataset.view.split(" ").map(Number);
  camera.zoom = 1;
  $("follow").checked = false;
  draw();
}));
document.addEventListener("keydown", (e) => {
  if (e.key === " " && !["BUTTON", "SELECT"].includes(e.target.tagName) && e.target.id !== "follow") { e.preventDefault(); play(!playing); }
});
const turn = (x, y) => {
  $("follow").checked = false;
  camera.yaw -= x;
  camera.pitch = Math.min(89.9, Math.max(-89.9, camera.pitch + y));
  draw();
};
$("scene").addEventListener("pointerdown", (e) => $("scene").setPointerCapture(e.pointerId));
$("scene").addEventListener("pointermove", (e) => { if (e.buttons) turn(0.4 * e.movementX, 0.4 * e.movementY); });
$("scene").addEventListener("wheel", (e) => {
  e.preventDefault();
  camera.zoom = Math.min(20, Math.max(0.3, camera.zoom * Math.exp(-0.0012 * e.deltaY)));
  draw();
}, { passive: false });
$("scene").addEventListener("keydown", (e) => {
  const step = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] }[e.key];
  if (step) { e.preventDefault(); turn(...step); }
});
const seek = (e) => {
  const box = $("strip").getBoundingClientRect(), part = (e.clientX - box.left - 8) / (box.width - 16);
  const wanted = begin + part * length;
  go(R.time.findLastIndex((t) => t <= wanted));
};
$("strip").addEventListener("pointerdown", (e) => { $("strip").setPointerCapture(e.pointerId); seek(e); });
$("strip").addEventListener("pointermove", (e) => { if (e.buttons) seek(e); });
new ResizeObserver(draw).observe($("scene"));
const linked = /^#row=(\d+)$/.exec(location.hash);
go(linked ? Number(linked[1]) : row);
