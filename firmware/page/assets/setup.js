// From the box to a sensor that measures, step by step.
import {device, isLive, listen, order} from "./device.js";
import {text} from "./text.js";
import {card, h, icon, setText} from "./dom.js";
import {CameraView} from "./camera.js";
import {WhyList, pictureReasons, softEdge} from "./why.js";
import {lensStep} from "./setup_lens.js";
import {mountStep} from "./setup_mount.js";
import {weightsStep} from "./setup_weights.js";

/** A list of things that hold or do not. */
export function checks(count) {
  const items = Array.from({length: count}, () => {
    const mark = h("span", {class: "mark"}), words = h("span");
    return {mark, words, element: h("li", {}, mark, words)};
  });
  return {element: h("ul", {class: "checks"}, items.map((i) => i.element)), show(states) {
    states.forEach(([good, words], i) => {
      items[i].element.className = good ? "ok" : "no";
      setText(items[i].mark, good ? "✓" : "✗");
      setText(items[i].words, words);
    });
  }};
}

function meter(name) {
  const fill = h("div", {class: "fill"}), reading = h("div", {class: "reading"});
  return {element: h("div", {class: "meter"}, h("span", {}, name), h("div", {class: "track", role: "presentation"}, fill), reading),
          show(share, level, words) {
            fill.style.width = `${Math.round(100 * Math.max(0, Math.min(1, share)))}%`;
            fill.className = `fill ${level}`;
            setText(reading, words);
          }};
}

function networkStep() {
  const t = text.setup.network, rows = h("dl", {class: "facts"});
  const facts = [[t.page, location.origin], [text.diagnostics.names.serial_number, device.registers.value("serial_number") || "–"],
                 [t.modbus, location.hostname], [t.unit, t.unit_text]];
  rows.append(...facts.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
  return {element: card(t.title, null, h("div", {class: "body"}, h("p", {}, t.text), rows, h("p"), h("p", {class: "soft"}, t.change)))};
}

function cameraStep() {
  const t = text.setup.camera;
  const sharp = meter(t.sharp), bright = meter(t.bright), list = checks(6), why = new WhyList(pictureReasons);
  const camera = new CameraView({places: true, onpicture: update});
  function update() {
    const p = device.picture, soft = softEdge();
    why.update();
    if (performance.now() - p.at > 3000) return;
    const sharpEnough = p.edge > 0 && p.edge <= soft;
    sharp.show(p.edge > 0 ? 1.6 / p.edge : 0, sharpEnough ? "" : p.edge > 2 * soft ? "bad" : "warn", p.edge ? t.edge(p.edge.toFixed(1)) : "–");
    const dark = p.mean < 25, white = p.white > 0.1;
    bright.show(p.mean / 255, dark || white ? "warn" : "", t.level(p.mean.toFixed(0)));
    const frame = isLive() ? device.frame : null, markers = device.about?.markers;
    const mean = (corners, k) => corners.reduce((s, c) => s + c[k], 0) / 4;
    const placed = Boolean(frame && markers) && frame.corners.every((corners, i) => corners &&
      Math.hypot(mean(corners, 0) - mean(markers[i].rest_px, 0), mean(corners, 1) - mean(markers[i].rest_px, 1)) <
      Math.hypot(markers[i].rest_px[0][0] - markers[i].rest_px[1][0], markers[i].rest_px[0][1] - markers[i].rest_px[1][1]));
    list.show([...[0, 1, 2].map((i) => [Boolean(frame?.seen[i]), (frame?.seen[i] ? t.seen : t.not_seen)(text.plates[i])]),
      [placed, placed ? t.placed : t.not_placed], [sharpEnough, sharpEnough ? t.focus_ok : t.focus_bad],
      [!dark && !white, dark ? t.dark : white ? t.white : t.light_ok]]);
  }
  update();
  return {element: h("div", {class: "two"}, card(t.title, null, camera.element, h("footer", {}, t.text)),
                     card(t.checks, null, h("div", {class: "body"}, sharp.element, bright.element, h("p"), list.element, h("p"), why.element))),
          update, leave: () => camera.stop()};
}

function zeroStep() {
  const t = text.setup.zero, list = checks(2), why = new WhyList();
  const go = h("button", {class: "main", onclick: async () => { go.disabled = true; await order("zero"); go.disabled = false; }}, t.go);
  const camera = new CameraView();
  return {element: h("div", {class: "two"}, card(t.title, go, h("div", {class: "body"}, h("p", {}, t.text), list.element, h("p"), why.element)),
                     card(text.live.camera, null, camera.element)),
          leave: () => camera.stop(),
          update() {
            why.update();
            const zeroed = device.registers.has("status", "zeroed"), rms = device.registers.value("rms_displacement");
            list.show([[zeroed, zeroed ? t.done : t.not_done], [rms !== null && rms < 0.5, `${t.values}: ${rms === null ? "–" : rms.toFixed(2)} mm`]]);
          }};
}

function checkStep() {
  const t = text.setup.check, list = checks(5), why = new WhyList();
  return {element: card(t.title, h("button", {class: "main", onclick: () => order("save")}, t.save),
                        h("div", {class: "body"}, h("p", {}, t.text), list.element, h("p"), why.element)),
          update() {
            why.update();
            const r = device.registers, has = (bit) => r.has("status", bit), wanted = device.about?.frames_per_second;
            list.show([[["top", "middle", "low"].every((p) => has(`${p}_plate_seen`)), t.markers], [has("zeroed"), t.zeroed],
              [r.value("fault") === "none", t.fault], [!has("settings_unsaved"), t.saved],
              [!wanted || (r.value("frame_rate") ?? 0) > 0.95 * wanted, `${t.rate}: ${r.value("frame_rate")?.toFixed(1) ?? "–"} / ${wanted?.toFixed(1) ?? "–"}`]]);
          }};
}

const steps = {network: networkStep, camera: cameraStep, lens: lensStep, mount: mountStep, zero: zeroStep, weights: weightsStep, check: checkStep};

export function setupPage() {
  const names = Object.keys(steps), t = text.setup, body = h("div"), done = new Set();
  const buttons = names.map((name, i) => h("button", {onclick: () => go(i)}, h("span", {class: "dot"}, String(i + 1)), t.steps[name]));
  const back = h("button", {onclick: () => go(at - 1)}, t.back), next = h("button", {class: "main", onclick: () => go(at + 1)}, t.next);
  let at = 0, step = null;
  function go(to) {
    step?.leave?.();
    if (step) { done.add(at); buttons[at].classList.add("done"); }
    at = Math.max(0, Math.min(names.length - 1, to));
    history.replaceState(null, "", `#setup/${names[at]}`);
    buttons.forEach((b, i) => (i === at ? b.setAttribute("aria-current", "step") : b.removeAttribute("aria-current")));
    step = steps[names[at]]();
    body.replaceChildren(step.element);
    step.update?.();
    back.disabled = at === 0;
    next.hidden = at === names.length - 1;
  }
  go(Math.max(0, names.indexOf(location.hash.split("/")[1])));
  return {element: h("div", {}, h("h1", {}, t.title), h("ol", {class: "steps"}, buttons.map((b) => h("li", {}, b))), body,
                     h("div", {class: "row spread"}, back, next)),
          update: (what) => step.update?.(what), leave: () => step.leave?.()};
}
