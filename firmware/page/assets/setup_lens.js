// Pictures of a ChArUco board -> the lens, computed on the device.
import {device, change, get} from "./device.js";
import {text} from "./text.js";
import {card, h, keepFocus, notice, setText, toast} from "./dom.js";
import {CameraView} from "./camera.js";
import {WhyList, nothingKnown} from "./why.js";

const enough = 3;  // pictures in each ninth, and for each tilt
const names = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];

export function lensStep() {
  const t = text.setup.lens;
  const camera = new CameraView();
  camera.markers = false;
  const ninths = Array.from({length: 9}, () => h("div", {}, "0"));
  const tilts = t.tilts.map(() => h("span", {class: "pill plain"}));
  const views = h("tbody"), result = h("div"), advice = h("ul", {class: "soft"});
  const still = h("input", {type: "checkbox", id: "still"});
  let now = {views: [], coverage: [], tilted: []}, stopped = false, busy = false;

  async function act(path, body = {}, done = "") {
    busy = true;
    capture.disabled = true;
    const good = await change(path, body, done);
    do {
      await refresh();
      if (now.is_busy) await new Promise((r) => setTimeout(r, 250));
    } while (now.is_busy && !stopped);
    busy = false;
    if (good && now.error && !body.only_still) toast(now.error, "bad");
    if (!stopped) show();
    if (!body.only_still) keepFocus(capture);
    return good;
  }
  const capture = h("button", {class: "main", onclick: () => act("/api/lens/capture")}, t.capture);
  const need = h("small"), how = h("footer"), why = new WhyList(nothingKnown);

  function show() {
    now.coverage.forEach((n, i) => { setText(ninths[i], String(n)); ninths[i].className = n >= enough ? "enough" : n ? "some" : ""; });
    now.tilted.forEach((n, i) => { setText(tilts[i], `${t.tilts[i]} ${n}`); tilts[i].className = `pill plain ${n >= enough ? "good" : n ? "warn" : ""}`; });
    views.replaceChildren(...(now.views.length ? now.views.map((v) => h("tr", {}, h("td", {}, String(v.id)), h("td", {class: "number"}, t.corners(v.corners)),
      h("td", {class: v.rejected ? "soft" : "number"}, v.rejected || (v.rms_px ? t.error(v.rms_px.toFixed(2)) : "")),
      h("td", {class: "number"}, h("button", {"aria-label": `${t.remove} ${v.id}`, onclick: () => act("/api/lens/remove", {id: v.id})}, t.remove))))
      : [h("tr", {}, h("td", {class: "soft"}, t.none_yet))]));
    const used = now.views.filter((v) => !v.rejected).length;
    capture.disabled = busy;
    setText(how, now.least_views ? t.text(now.least_views) : "");
    setText(need, used < now.least_views ? t.need(now.least_views - used) : now.error || "");
    const lines = now.result && !now.advice.length ? [t.enough] : now.advice || [];
    advice.replaceChildren(...lines.map((line) => h("li", {}, line)));
    showResult();
  }
  function showResult() {
    if (!now.result) { result.replaceChildren(); return; }
    const {lens, sigma, rms_px: rms} = now.result;
    result.replaceChildren(card(t.result, [h("a", {class: "button", href: "/api/lens/file", download: "lens.toml"}, t.download),
        now.can_store && h("button", {class: "main", onclick: () => act("/api/lens/use", {}, t.used)}, t.use)],
      h("div", {class: "body"}, h("p", {}, t.rms(rms.toFixed(3))),
        h("dl", {class: "facts"}, names.flatMap((n, i) => [h("dt", {}, n), h("dd", {}, `${lens[i].toPrecision(6)} ± ${sigma[i].toPrecision(2)}`)])),
        now.can_store ? null : h("p", {class: "soft"}, t.cannot_store))));
  }
  async function refresh() {
    try {
      now = await get("/api/lens");
      if (!stopped) show();
    } catch (error) {
      now.is_busy = false;
      toast(error.message, "bad");
    }
  }
  // The device keeps a picture only if the board is held still and shows something new.
  async function watch() {
    while (!stopped) {
      await new Promise((r) => setTimeout(r, 700));
      if (still.checked && !busy && !stopped && !(await act("/api/lens/capture", {only_still: true}))) still.checked = false;
    }
  }
  refresh();
  watch();
  const inUse = h("div", {class: "body"});
  const update = () => {
    why.update();
    const lens = device.about?.lens;
    setText(inUse, lens ? names.slice(0, 4).map((n) => `${n} ${lens[n].toFixed(1)}`).join(" · ") : t.none);
  };
  return {element: h("div", {}, h("div", {class: "two"},
      card(t.title, [h("label", {class: "row", htmlFor: "still"}, still, t.auto), capture], camera.element, how),
      h("div", {}, why.element, card(t.now, [h("button", {onclick: () => act("/api/lens/restore", {}, t.restored)}, t.restore)], inUse),
        card(t.covered, [h("a", {class: "button", href: "/api/lens/board.svg", download: "board.svg"}, t.board)],
          h("div", {class: "body row"}, h("div", {class: "cover", role: "img", "aria-label": t.covered}, ninths), h("div", {}, h("h3", {}, t.tilt), h("div", {class: "row"}, tilts))),
          h("div", {class: "body"}, advice)))),
    card(t.views, [need, h("button", {onclick: () => act("/api/lens/clear")}, t.clear)], h("table", {}, views)), result),
    update, leave() { stopped = true; camera.stop(); }};
}
