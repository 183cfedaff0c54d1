// Why there is no valid value, in words, and what to do about it. The most serious first.
import {device, hasPicture, isLive, order} from "./device.js";
import {text} from "./text.js";
import {h, notice} from "./dom.js";

const centre = (corners) => corners.reduce(([x, y], c) => [x + c[0] / 4, y + c[1] / 4], [0, 0]);
const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

// Markers may move this many of their own sides between the drawing and the device before they count as misplaced.
const farSides = 0.7;
const pictureFault = /^(image_|markers_lost|camera_(lost|frozen))/;  // of the registers' faults
const shown = 1;  // seconds that a marker must be hidden before it is worth a word

function markerProblems(frame) {
  const markers = device.about?.markers;
  if (!markers || !frame.has_image) return [];
  const found = [];
  const rest = markers.map((m) => centre(m.rest_px));
  const side = markers.map((m) => distance(m.rest_px[0], m.rest_px[1]));
  const {width_px: width, height_px: height} = device.about.lens;
  const at = frame.corners.map((corners) => corners && centre(corners));
  const swapped = new Set();
  for (const [a, b] of [[0, 1], [0, 2], [1, 2]]) {
    if (!at[a] || !at[b]) continue;
    const now = distance(at[a], rest[a]) + distance(at[b], rest[b]), other = distance(at[a], rest[b]) + distance(at[b], rest[a]);
    if (other < now / 2 && now > side[a]) {
      found.push({level: "bad", say: text.why.swapped(text.plates[a], text.plates[b])});
      swapped.add(a).add(b);
    }
  }
  for (let p = 0; p < 3; ++p) {
    if (frame.seen[p] || swapped.has(p)) continue;
    const seconds = (performance.now() - device.hiddenSince[p]) / 1000;
    if (!device.hiddenSince[p] || seconds < shown) continue;
    const [x, y] = [rest[p][0] / width, rest[p][1] / height];
    if (at[p]) found.push({level: "bad", say: text.why.misplaced(text.plates[p])});
    else if (x < 0 || y < 0 || x > 1 || y > 1) found.push({level: "bad", say: text.why.hidden_outside(text.plates[p])});
    else found.push({level: "warn", hidden: true, say: text.why.hidden(text.plates[p], text.seconds(seconds), x, y)});
  }
  return found;
}

/**
 * Wider edges than this are not sharp. Sharp ones are 2 to 3 pixels wide; those of the blur that is a fault of the device's own (a standard
 * deviation of 1/280 of the picture's width) 2.5 times that.
 */
export const softEdge = () => Math.max(3.5, (device.about?.lens?.width_px ?? 0) / 220);

/** Why nothing at all is known, if so. */
export function nothingKnown() {
  if (device.link === "connecting") return [{level: "info", say: text.why.connecting}];
  if (device.link === "crowded") return [{level: "bad", say: text.why.crowded(device.refusal)}];
  if (device.link === "lost") return [{level: "bad", say: text.why.no_page}];
  if (!device.error) return [];
  const act = location.hash === "#diagnostics" ? null : [text.pages.diagnostics, () => (location.hash = "#diagnostics")];
  return [{level: "bad", say: text.why.no_device(device.error), act}];
}

export function reasons() {
  const nothing = nothingKnown();
  if (nothing.length) return nothing;
  const registers = device.registers;
  const found = [];
  const fault = registers.value("fault");
  if (fault && fault !== "none") {
    // Of another finger, a calibration board, or of this one where the camera looks elsewhere: the light is on, and nothing covers them.
    const areElsewhere = fault === "markers_lost" && isLive() && performance.now() - device.foundAt < 1000 * shown;
    const say = areElsewhere ? text.why.markers_elsewhere : text.why.faults[fault] || [fault.replaceAll("_", " "), ""];
    found.push({level: "bad", picture: fault in text.why.faults && pictureFault.test(fault), say});
  }
  const has = (bit) => registers.has("status", bit);
  if (isLive()) {
    const edge = device.picture.edge;
    const soft = hasPicture() && edge > softEdge();
    // A picture in which nothing can be found hides markers, too: nothing covers them.
    const blind = soft || pictureFault.test(fault ?? "");
    // A camera that repeats itself says nothing of the markers now.
    const markers = /^camera_/.test(fault ?? "") ? [] : markerProblems(device.frame);
    found.push(...markers.filter((f) => !(blind && f.hidden)).map((f) => ({...f, picture: true})));
    if (soft && fault !== "image_out_of_focus") found.push({level: "warn", picture: true, say: text.why.unsharp(edge.toFixed(1))});
  } else if (device.blockError && !(fault && fault !== "none")) {
    found.push({level: "warn", picture: true, say: text.why.no_block(device.blockError)});
  }
  if (has("over_range")) found.push({level: "warn", say: text.why.over_range});
  if (has("unexplained")) found.push({level: "warn", say: text.why.unexplained});
  if (has("overload")) found.push({level: "warn", say: text.why.overload});
  if (has("held")) found.push({level: "warn", say: text.why.held});
  if (has("solver_fallback")) found.push({level: "warn", say: text.why.fallback});
  if (!has("zeroed") && has("ready")) found.push({level: "warn", say: text.why.not_zeroed, act: [text.why.zero, () => order("zero")]});
  if (has("settings_unsaved")) found.push({level: "info", say: text.why.unsaved, act: [text.why.save, () => order("save")]});
  if (!found.some((f) => f.level !== "info")) {
    if (has("touch_valid")) found.unshift({level: "good", say: [text.why.all_good_touch, ""]});
    else if (!has("shape_valid")) found.unshift({level: "warn", say: text.why.no_shape});
    else if (registers.value("largest_displacement") > 3) found.unshift({level: "warn", say: text.why.not_located});
    else found.unshift({level: "good", say: text.why.rest});
  }
  return found;
}

/** Of reasons(): what can be seen in the picture, for the step that aims the camera. */
export const pictureReasons = () => [...nothingKnown(), ...reasons().filter((r) => r.picture)];

/** One word for the header; it is green only where there is nothing else to say. */
export function summary() {
  if (device.link === "connecting") return ["warn", text.status.waiting];
  if (device.link !== "up") return ["bad", text.status.lost];
  if (device.error) return ["bad", text.status.no_answer];
  const all = reasons();
  if (all.some((r) => r.level === "bad")) return ["bad", text.status.fault];
  if (all.some((r) => r.level === "warn")) return ["warn", text.status.warning];
  if (all.some((r) => r.level === "info")) return ["info", text.status.note];
  return ["good", device.registers.has("status", "touch_valid") ? text.status.touch : text.status.measuring];
}

/** The reasons as notices, kept up to date with as little change as possible. */
export class WhyList {
  constructor(which = reasons) {
    this.which = which;
    this.element = h("div", {class: "why", role: "status", "aria-live": "polite"});
    this.key = "";
  }
  update() {
    const all = this.which();
    const key = JSON.stringify(all.map((r) => [r.level, r.say]));
    if (key === this.key) return;
    this.key = key;
    this.element.replaceChildren(...all.map((r) =>
      notice(r.level, r.say[0], r.say[1], r.act && h("button", {onclick: r.act[1]}, r.act[0]))));
  }
}
