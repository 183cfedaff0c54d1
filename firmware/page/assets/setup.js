// From the box to a sensor that measures, step by step.
import {device, hasPicture, isKnown, isLive, order} from "./device.js";
import {text} from "./text.js";
import {busy, card, h, icon, keepFocus, setText} from "./dom.js";
import {CameraView} from "./camera.js";
import {ZeroAllButton} from "./gripper.js";
import {WhyList, nothingKnown, pictureReasons, softEdge} from "./why.js";
import {lensStep} from "./setup_lens.js";
import {mountStep} from "./setup_mount.js";
import {weightsStep} from "./setup_weights.js";

/** A list of things that hold, do not, or (null) are not known now. */
export function checks(count) {
  const items = Array.from({length: count}, () => {
    const mark = h("span", {class: "mark"}), words = h("span");
    return {mark, words, element: h("li", {}, mark, words)};
  });
  return {element: h("ul", {class: "checks"}, items.map((i) => i.element)), show(states) {
    states.forEach(([good, words], i) => {
      items[i].element.className = good === null ? "" : good ? "ok" : "no";
      setText(items[i].mark, good === null ? "?" : good ? "✓" : "✗");
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
  const t = text.setup.network, serial = h("dd"), modbus = h("dd"), unit = h("dd"), why = new WhyList(nothingKnown);
  const facts = [[t.page, h("dd", {}, location.origin)], [text.diagnostics.names.serial_number, serial], [t.modbus, modbus], [t.unit, unit],
                 [t.registers, h("dd", {}, t.registers_text)]];
  return {element: card(t.title, null, h("div", {class: "body"}, why.element, h("p", {}, t.text),
                          h("dl", {class: "facts"}, facts.flatMap(([name, dd]) => [h("dt", {}, name), dd])), h("p"), h("p", {class: "soft"}, t.change))),
          update() {
            why.update();
            setText(serial, device.registers.value("serial_number") || text.invalid);
            const place = device.about?.modbus;
            setText(unit, place ? String(place.unit) : text.invalid);
            setText(modbus, !place ? text.invalid : place.address.startsWith("127.") ? t.only_here(place.address, place.port)
              : t.at(place.address === "0.0.0.0" ? location.hostname : place.address, place.port));
          }};
}

function cameraStep() {
  const t = text.setup.camera;
  const sharp = meter(t.sharp), bright = meter(t.bright), list = checks(6), why = new WhyList(pictureReasons);
  const camera = new CameraView({places: true, onpicture: update});
  function update() {
    const p = device.picture, soft = softEdge(), isSeen = hasPicture();
    why.update();
    const edge = isSeen && p.edge > 0 ? p.edge : null;  // 0: there are too few edges to tell
    const sharpEnough = edge === null ? null : edge <= soft;
    sharp.show(edge ? 1.6 / edge : 0, sharpEnough ? "" : edge > 2 * soft ? "bad" : "warn", edge ? t.edge(edge.toFixed(1)) : text.invalid);
    const dark = p.mean < 25, white = p.white > 0.1;
    bright.show(isSeen ? p.mean / 255 : 0, dark || white ? "warn" : "", isSeen ? t.level(p.mean.toFixed(0)) : text.invalid);
    const frame = isLive() && device.frame.has_image ? device.frame : null, markers = device.about?.markers;
    if (!frame || !markers) { list.show([...text.plates.map((plate) => [null, t.marker(plate)]), [null, t.place], [null, t.focus], [null, t.light]]); return; }
    const mean = (corners, k) => corners.reduce((s, c) => s + c[k], 0) / 4;
    const placed = frame.corners.every((corners, i) => corners &&
      Math.hypot(mean(corners, 0) - mean(markers[i].rest_px, 0), mean(corners, 1) - mean(markers[i].rest_px, 1)) <
      Math.hypot(markers[i].rest_px[0][0] - markers[i].rest_px[1][0], markers[i].rest_px[0][1] - markers[i].rest_px[1][1]));
    list.show([...[0, 1, 2].map((i) => [Boolean(frame.corners[i]), (frame.corners[i] ? t.seen : t.not_seen)(text.plates[i])]),
      [placed, placed ? t.placed : t.not_placed], [sharpEnough, sharpEnough === null ? t.focus : sharpEnough ? t.focus_ok : t.focus_bad],
      isSeen ? [!dark && !white, dark ? t.dark : white ? t.white : t.light_ok] : [null, t.light]]);
  }
  update();
  return {element: h("div", {class: "two"}, card(t.title, null, camera.element, h("footer", {}, t.text)),
                     card(t.checks, null, h("div", {class: "body"}, sharp.element, bright.element, h("p"), list.element, h("p"), why.element))),
          update, leave: () => camera.stop()};
}

function zeroStep() {
  const t = text.setup.zero, list = checks(2), why = new WhyList();
  const go = h("button", {class: "main", onclick: () => busy(go, () => order("zero"))}, t.go);
  const all = new ZeroAllButton(), explain = h("p", {hidden: true}, t.all);
  const camera = new CameraView();
  return {element: h("div", {class: "two"}, card(t.title, [all.element, go], h("div", {class: "body"}, h("p", {}, t.text), explain, list.element, h("p"), why.element)),
                     card(text.live.camera, null, camera.element)),
          leave: () => camera.stop(),
          update() {
            why.update();
            all.update();
            explain.hidden = all.element.hidden;
            const zeroed = device.registers.known("status", "zeroed"), rms = device.registers.value("rms_displacement");
            list.show([[zeroed, zeroed === null ? text.unknown : zeroed ? t.done : t.not_done],
              [rms === null ? null : rms < 0.5, `${t.values}: ${rms === null ? text.invalid : rms.toFixed(2)} mm`]]);
          }};
}

function checkStep() {
  const t = text.setup.check, list = checks(5), why = new WhyList();
  return {element: card(t.title, h("button", {class: "main", onclick: () => order("save")}, t.save),
                        h("div", {class: "body"}, h("p", {}, t.text), list.element, h("p"), why.element)),
          update() {
            why.update();
            const r = device.registers, has = (bit) => r.has("status", bit), wanted = device.about?.frames_per_second, rate = r.value("frame_rate");
            const states = [[["top", "middle", "low"].every((p) => has(`${p}_plate_seen`)), t.markers], [has("zeroed"), t.zeroed],
              [r.value("fault") === "none", t.fault], [!has("settings_unsaved"), t.saved],
              [rate === null || !wanted ? null : rate > 0.95 * wanted, `${t.rate}: ${rate?.toFixed(1) ?? text.invalid} / ${wanted?.toFixed(1) ?? text.invalid}`]];
            list.show(isKnown() ? states : states.map(([, words]) => [null, words]));
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
    keepFocus(next.hidden ? back : next);
  }
  go(Math.max(0, names.indexOf(location.hash.split("/")[1])));
  return {element: h("div", {}, h("h1", {}, t.title), h("ol", {class: "steps"}, buttons.map((b) => h("li", {}, b))), body,
                     h("div", {class: "row spread"}, back, next)),
          update: (what) => step.update?.(what), leave: () => step.leave?.(),
          goTo(name) {
            if (names.includes(name)) go(names.indexOf(name));
            else history.replaceState(null, "", `#setup/${names[at]}`);
          }};
}
