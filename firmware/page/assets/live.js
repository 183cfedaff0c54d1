// What the device sees and measures now.
import {device, isLive} from "./device.js";
import {text} from "./text.js";
import {card, h, setText, tile} from "./dom.js";
import {CameraView} from "./camera.js";
import {FingerView} from "./finger3d.js";
import {Charts} from "./charts.js";
import {GripperCard} from "./gripper.js";
import {WhyList} from "./why.js";

export function livePage() {
  const t = text.live;
  const why = new WhyList(), charts = new Charts(), finger = new FingerView(), gripper = new GripperCard();
  const note = h("span"), size = h("span");
  const camera = new CameraView({onpicture: () => {
    setText(note, t.picture_note(device.picture.edge.toFixed(1), device.picture.mean.toFixed(0)));
    setText(size, t.resolution(camera.bitmap.width, camera.bitmap.height));
  }});
  const tiles = {force: tile(t.force, "N"), touch: tile(t.touch, "mm", "wide"), level: tile(t.level, "‰"), latency: tile(t.latency, "ms"),
                 frames: tile(t.frames, t.per_second)};
  const markers = h("input", {type: "checkbox", id: "markers", checked: true, onchange: () => (camera.markers = markers.checked)});
  const pause = h("button", {onclick: () => { charts.pause(!charts.paused); setText(pause, charts.paused ? t.resume : t.pause); }},
                  charts.paused ? t.resume : t.pause);

  const axes = ["x", "y", "z"];
  const fixed = (name, digits) => device.registers.value(name)?.toFixed(digits) ?? null;
  function showTiles() {
    const uncertainty = fixed("force_uncertainty", 2), radius = fixed("touch_uncertainty", 1);
    tiles.force.show(fixed("force", 2), uncertainty === null ? "" : t.uncertainty(uncertainty, "N"));
    const point = axes.map((axis) => fixed(`touch_${axis}`, 1));
    tiles.touch.show(point.includes(null) ? null : axes.map((axis, k) => `${axis} ${point[k].replace("-", "−")}`).join("  "),
                     radius === null ? "" : t.within(radius));
    tiles.level.show(fixed("deformation_level", 0), t.of_rated);
    tiles.latency.show(fixed("latency", 1), t.exposure_to);
    const wanted = device.about?.frames_per_second;
    const dropped = device.registers.value("dropped_frames") ?? 0;
    tiles.frames.show(fixed("frame_rate", 1), [wanted ? t.wanted(Number(wanted.toFixed(1))) : "", dropped ? t.dropped(dropped) : ""].filter(Boolean).join(" · "));
  }
  const element = h("div", {}, h("h1", {}, t.title), why.element,
    h("div", {class: "tiles"}, Object.values(tiles).map((x) => x.element)), gripper.element,
    h("div", {class: "two"},
      card(t.camera, h("label", {class: "row", htmlFor: "markers"}, markers, t.show_markers), camera.element, h("footer", {}, size, note)),
      card(t.finger, h("button", {onclick: () => finger.reset()}, t.reset_view), finger.element)),
    card(t.history, [pause, h("button", {onclick: () => charts.savePng()}, t.png), h("button", {onclick: () => charts.saveCsv()}, t.csv)], charts.element));
  return {
    element,
    update(what) {
      if (!device.registers) return;
      why.update();
      if (what !== "frame") gripper.update();
      if (what === "frame" || !isLive()) { showTiles(); if (!charts.paused) charts.draw(); }
    },
    leave() { camera.stop(); finger.stop(); },
  };
}
