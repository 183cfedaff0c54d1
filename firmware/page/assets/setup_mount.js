// The finger at rest -> where camera and markers really are, computed on the device.
import {device, change, get} from "./device.js";
import {text} from "./text.js";
import {busy, card, h, setText, table, toast} from "./dom.js";
import {CameraView} from "./camera.js";
import {WhyList, pictureReasons} from "./why.js";

export function mountStep() {
  const t = text.setup.mount, result = h("div"), why = new WhyList(pictureReasons);
  const camera = new CameraView({places: true});
  let now = {};
  const measure = h("button", {class: "main", onclick: () => busy(measure, async () => {
    now = {};  // the last result says nothing about this one
    show();
    setText(measure, t.measuring);
    await change("/api/mount/measure", {});
    while (!stopped) {
      await refresh();
      if (!now.is_running) break;
      await new Promise((r) => setTimeout(r, 400));
    }
    if (now.error) toast(now.error, "bad");
    setText(measure, t.measure);
  })}, t.measure);
  let stopped = false;
  const use = async (path, done) => { await change(path, {}, done); refresh(); };

  function show() {
    if (!now.result || now.is_running) { result.replaceChildren(); return; }
    const {parts, rms_px: rms, pictures} = now.result;
    const vector = (v, s) => h("td", {class: "number"}, v.map((x, k) => h("div", {}, `${"xyz"[k]} ${x.toFixed(2)} ± ${s[k].toFixed(2)}`)));
    result.replaceChildren(card(t.result, [h("a", {class: "button", href: "/api/mount/file", download: "mount.toml"}, t.download),
        now.can_store && h("button", {class: "main", onclick: () => use("/api/mount/use", t.used)}, t.use)],
      table(t.result, [t.part, t.shift, t.turn], parts.map((p) => [h("td", {}, t.parts[p.name]), vector(p.shift_mm, p.shift_sigma_mm),
                                                                   vector(p.turn_deg, p.turn_sigma_deg)])),
      h("footer", {}, h("span", {}, t.axes), t.fits(rms.toFixed(2), pictures), now.can_store ? null : h("span", {}, t.cannot_store))));
  }
  async function refresh() {
    try {
      now = await get("/api/mount");
    } catch (error) {
      now = {};
      toast(error.message, "bad");
    }
    if (!stopped) show();
  }
  refresh();
  return {element: h("div", {}, h("div", {class: "two"}, card(t.title, [h("button", {onclick: () => use("/api/mount/restore", t.restored)}, t.restore), measure], camera.element, h("footer", {}, t.text)),
                                  h("div", {}, why.element, result))),
          update: () => why.update(), leave() { stopped = true; camera.stop(); }};
}
