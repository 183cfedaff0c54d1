// Known weights: readings against them, recordings for a fit, and what fit and certificate say.
import {change, device, get, isKnown, listen, order} from "./device.js";
import {text} from "./text.js";
import {busy, card, fileButton, h, saveCsv, setText, table, toast} from "./dom.js";

const kNewtonPerGram = 9.80665e-3, kReading_ms = 2000;
const day = (d) => new Date(Date.UTC(2000, 0, 1) + d * 864e5).toISOString().slice(0, 10);
const mean = (numbers) => numbers.reduce((sum, x) => sum + x, 0) / numbers.length;

/** What the device says in the next two seconds, or null where it is not touched all the time. */
function reading() {
  const names = ["force", "force_uncertainty", "touch_x", "touch_y", "touch_z", "touch_uncertainty"], seen = [];
  return new Promise((resolve) => {
    const end = listen((what) => { if (what === "frame") seen.push(names.map((name) => device.registers.value(name))); });
    setTimeout(() => {
      end();
      const whole = seen.length > 0 && seen.every((row) => row.every((x) => x !== null));
      resolve(whole ? Object.fromEntries(names.map((name, k) => [name, mean(seen.map((row) => row[k]))])) : null);
    }, kReading_ms);
  });
}

const readings = [], recorded = [];  // kept while people go from step to step

export function weightsStep() {
  const t = text.setup.weights;
  const hole = h("input", {type: "number", id: "hole", min: 1, max: 9, value: 5, required: true});
  const mass = h("input", {type: "number", id: "mass", min: 1, max: 5000, value: 200, required: true});
  const now = h("p", {role: "status"}), shown = h("div"), listed = h("div"), facts = h("dl", {class: "facts"});
  const isValid = () => hole.reportValidity() && mass.reportValidity();

  const take = h("button", {class: "main", onclick: async () => {
    if (!isValid()) return;
    const seen = await busy(take, reading);
    if (!seen) { toast(t.no_touch, "bad"); return; }
    readings.push({hole: hole.value, mass: mass.value, ...seen});
    show();
  }}, t.take);

  function show() {
    const off = (r) => r.force - kNewtonPerGram * r.mass, inside = (r) => Math.abs(off(r)) <= r.force_uncertainty;
    const rows = readings.map((r) => [r.hole, r.mass, (kNewtonPerGram * r.mass).toFixed(2), `${r.force.toFixed(2)} ± ${r.force_uncertainty.toFixed(2)}`,
      `${(100 * off(r) / (kNewtonPerGram * r.mass)).toFixed(1)} %`, inside(r) ? "✓" : "✗"]);
    const csv = () => saveCsv("readings.csv", ["hole,mass_g,force_n,force_sigma_n,x_mm,y_mm,z_mm,radius_mm", ...readings.map((r) =>
      [r.hole, r.mass, r.force.toFixed(3), r.force_uncertainty.toFixed(3), r.touch_x.toFixed(2), r.touch_y.toFixed(2), r.touch_z.toFixed(2), r.touch_uncertainty.toFixed(2)].join(","))]);
    shown.replaceChildren(...(!readings.length ? [] : [table(t.title, t.columns, rows),
      h("footer", {}, t.summary(mean(readings.map((r) => Math.abs(off(r)))).toFixed(2), readings.filter(inside).length, readings.length),
        h("button", {onclick: csv}, text.live.csv), h("button", {onclick: () => { readings.length = 0; show(); }}, t.clear))]));
    const weights = () => saveCsv("weights.csv", ["session,hole,mass_g", ...recorded.map((r) => [r.session, r.hole, r.mass].join(","))]);
    listed.replaceChildren(...(!recorded.length ? [] : [table(t.record_title, [t.session, t.hole, t.mass], recorded.map((r) => [r.session, r.hole, r.mass])),
      h("footer", {}, h("code", {}, `hostgen fit ${recorded.map((r) => r.session).join(" ")} --weights weights.csv --spec SPEC --pack PACK -o fit.toml`),
        h("button", {onclick: weights}, "weights.csv"), h("button", {onclick: () => { recorded.length = 0; show(); }}, t.clear))]));
  }

  const start = h("button", {class: "main", onclick: () => { if (isValid()) order("record"); }}, text.recordings.start);
  const stop = h("button", {onclick: async () => {
    if (!await order("stop")) return;
    try {
      const {sessions} = await get("/api/recordings");
      const newest = sessions.reduce((best, s) => (!best || s.changed_s >= best.changed_s ? s : best), null);
      if (newest) recorded.push({session: newest.name, hole: hole.value, mass: mass.value});
      show();
    } catch (error) { toast(error.message, "bad"); }
  }}, text.recordings.stop);

  const useFit = (toml) => change("/api/fit/use", {toml}, t.fit_used);
  function useCertificate(content) {
    let settings = null;
    try { settings = JSON.parse(content).settings; } catch { /* told below */ }
    if (settings) change("/api/settings", settings, t.certificate_used);
    else toast(t.not_such, "bad");
  }

  function update() {
    const r = device.registers, weight = kNewtonPerGram * mass.value, force = r.value("force");
    setText(now, !isKnown() ? text.unknown : force === null ? t.not_touched : t.now(force.toFixed(2), r.value("force_uncertainty")?.toFixed(2) ?? "–", weight.toFixed(2)));
    const isRecording = r.value("recording") === "recording";
    start.disabled = isRecording || !isKnown();
    stop.disabled = !isRecording;
    const fitted = r.value("fitted_on"), verified = r.value("verified_on");
    const dayOf = (d) => (d ? day(d) : d === 0 ? t.never : text.invalid);
    const rows = [[t.fitted, dayOf(fitted)], [t.scale, `${r.value("force_scale")?.toFixed(3) ?? "–"} ± ${r.value("force_scale_uncertainty")?.toFixed(3) ?? "–"}`],
      [t.verified, verified ? `${day(verified)}: ${r.value("verdict")}` : dayOf(verified)],
      [t.expanded, verified ? `${r.value("force_expanded_uncertainty")?.toFixed(2)} N, ${r.value("touch_expanded_uncertainty")?.toFixed(2)} mm` : "–"]];
    const words = rows.flat().join("|");
    if (facts.dataset.shown === words) return;
    facts.dataset.shown = words;
    facts.replaceChildren(...rows.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
  }
  show();
  update();
  const inputs = h("div", {class: "row"}, h("label", {htmlFor: "hole"}, t.hole), hole, h("label", {htmlFor: "mass"}, t.mass), mass);
  return {element: h("div", {}, h("div", {class: "two"},
            card(t.title, take, h("div", {class: "body"}, h("p", {}, t.text), inputs, now), shown),
            h("div", {}, card(t.record_title, [start, stop], h("div", {class: "body"}, h("p", {}, t.record_text)), listed),
              card(t.fit_title, null, h("div", {class: "body"}, facts, h("p", {class: "soft"}, t.fit_text),
                h("div", {class: "row"}, fileButton(t.use_fit, ".toml", t.not_such, useFit), h("button", {onclick: () => change("/api/fit/restore", {}, t.restored)}, t.restore),
                  fileButton(t.use_certificate, ".json,application/json", t.not_such, useCertificate))))))),
          update};
}
