// Strip charts of the last minute. The history is kept for all of them, also while no chart is on show.
import {device, isLive, listen} from "./device.js";
import {text} from "./text.js";
import {h, save, saveCsv} from "./dom.js";

export const span_s = 60;
export const series = [
  {key: "force", name: "force", digits: 2, least: 0.5}, {key: "level", name: "deformation_level", digits: 0, least: 50},
  {key: "touch", name: "touch_y", digits: 1, least: 20}, {key: "latency", name: "latency", digits: 1, least: 5},
];
const history = [];  // {t (s), values}
let frozen = null;   // what is on show while it is paused

listen((what) => {
  if (what !== "frame") return;
  const t = device.frame.t_ms / 1000;
  if (history.length && (t < history.at(-1).t || t > history.at(-1).t + span_s)) history.length = 0;
  history.push({t, values: series.map((s) => device.registers.value(s.name))});
  while (history.length && history[0].t < t - span_s) history.shift();
});

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Round limits around what is shown, and where to draw lines. */
function limits(values, least) {
  let low = Math.min(...values), high = Math.max(...values);
  if (!values.length) [low, high] = [0, least];
  if (low >= 0 && low < high / 2) low = 0;
  if (high - low < least) high = low + least;
  const rough = (high - low) / 3, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough);
  return {low: Math.floor(low / step) * step, high: Math.ceil(high / step) * step, step};
}

export class Charts {
  constructor() {
    this.charts = series.map((s) => {
      const value = h("span");
      const canvas = h("canvas", {role: "img", "aria-label": text.live.charts[s.key]});
      return {...s, value, canvas, element: h("div", {class: "chart"}, h("h3", {}, text.live.charts[s.key], value), canvas)};
    });
    this.element = h("div", {class: "charts"}, this.charts.map((c) => c.element));
  }
  get paused() { return frozen !== null; }
  pause(on) { frozen = on ? [...history] : null; this.draw(); }
  shown() { return frozen || history; }

  draw() {
    const points = this.shown();
    const end = points.length ? points.at(-1).t : 0;
    this.charts.forEach((chart, i) => {
      const last = points.length && (isLive() || this.paused) ? points.at(-1).values[i] : null;
      const shown = last === null ? text.invalid : last.toFixed(chart.digits);
      if (chart.value.textContent !== shown) chart.value.textContent = shown;
      this.drawOne(chart, points.map((p) => [p.t - end + span_s, p.values[i]]));
    });
  }
  drawOne({canvas, least}, points) {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const c = canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    const {low, high, step} = limits(points.map((p) => p[1]).filter((v) => v !== null), least);
    const left = 38, bottom = 16, x = (t) => left + (t / span_s) * (width - left - 4), y = (v) => 5 + (1 - (v - low) / (high - low)) * (height - bottom - 8);
    c.font = "11px system-ui, sans-serif";
    c.fillStyle = colour("--soft");
    c.strokeStyle = colour("--line");
    c.lineWidth = 1;
    c.textAlign = "right";
    c.beginPath();
    for (let v = low; v <= high + step / 2; v += step) {
      const row = Math.round(y(v)) + 0.5;
      c.moveTo(left, row);
      c.lineTo(width - 4, row);
      c.fillText(String(Number(v.toFixed(3))), left - 6, row + 4);
    }
    c.stroke();
    c.textAlign = "center";
    for (let t = 0; t <= span_s; t += 15) c.fillText(t === span_s ? "0 s" : `−${span_s - t}`, Math.min(x(t), width - 12), height - 3);
    c.strokeStyle = colour("--accent");
    c.lineWidth = 1.7;
    c.lineJoin = "round";
    c.beginPath();
    let drawing = false;
    for (const [t, v] of points) {
      if (v === null) drawing = false;
      else if (drawing) c.lineTo(x(t), y(v));
      else { c.moveTo(x(t), y(v)); drawing = true; }
    }
    c.stroke();
  }

  savePng() {
    const ratio = window.devicePixelRatio || 1, gap = 26 * ratio;
    const width = this.charts[0].canvas.width, height = this.charts.reduce((sum, ch) => sum + ch.canvas.height + gap, gap);
    const all = h("canvas", {width: width + 2 * gap, height});
    const c = all.getContext("2d");
    c.fillStyle = colour("--card");
    c.fillRect(0, 0, all.width, all.height);
    let y = gap;
    for (const chart of this.charts) {
      c.fillStyle = colour("--text");
      c.font = `600 ${13 * ratio}px system-ui, sans-serif`;
      c.fillText(text.live.charts[chart.key], gap, y - 7 * ratio);
      c.drawImage(chart.canvas, gap, y);
      y += chart.canvas.height + gap;
    }
    all.toBlob((blob) => save("finsight-charts.png", blob));
  }
  saveCsv() {
    const points = this.shown(), first = points[0]?.t || 0;
    const lines = [["time_s", ...series.map((s) => s.name)].join(",")];
    for (const p of points) lines.push([(p.t - first).toFixed(3), ...p.values.map((v, i) => (v === null ? "" : v.toFixed(series[i].digits + 1)))].join(","));
    saveCsv("finsight-history.csv", lines);
  }
}
