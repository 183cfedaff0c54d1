// Sessions recorded on the device.
import {device, change, get, order} from "./device.js";
import {text} from "./text.js";
import {card, h, setText} from "./dom.js";

export function recordingsPage() {
  const t = text.recordings;
  const state = h("span", {class: "pill"}), left = h("small");
  const start = h("button", {class: "main", onclick: () => order("record").then(list)}, t.start);
  const stop = h("button", {onclick: () => order("stop").then(list)}, t.stop);
  const body = h("div");
  let was;

  async function list() {
    let answer;
    try { answer = await get("/api/recordings"); } catch (error) { body.replaceChildren(h("div", {class: "body"}, error.message)); return; }
    if (!answer.configured) { body.replaceChildren(h("div", {class: "body"}, t.not_configured)); return; }
    if (!answer.sessions.length) { body.replaceChildren(h("div", {class: "body soft"}, t.none)); return; }
    const rows = answer.sessions.map((s) => h("tr", {}, h("td", {class: "mono"}, s.name), h("td", {class: "number"}, text.bytes(s.bytes)),
      h("td", {}, new Date(s.changed_s * 1000).toLocaleString()), h("td", {}, s.complete ? t.yes : t.cut),
      h("td", {}, h("div", {class: "row end"}, h("a", {class: "button", href: `/api/recordings/${s.name}.tar`, download: `${s.name}.tar`}, t.download),
        h("button", {class: "danger", "aria-label": `${t.remove} ${s.name}`, onclick: async () => {
          if (confirm(t.ask(s.name)) && await change("/api/recordings/delete", {name: s.name}, t.removed(s.name))) {
            await list();
            document.getElementById("main").focus();
          }
        }}, t.remove)))));
    body.replaceChildren(h("div", {class: "scroll", tabIndex: 0, role: "region", "aria-label": t.title}, h("table", {}, h("thead", {}, h("tr", {}, h("th", {scope: "col"}, t.name), h("th", {scope: "col", class: "number"}, t.size),
      h("th", {scope: "col"}, t.when), h("th", {scope: "col"}, t.complete), h("th", {scope: "col"}, h("span", {hidden: true}, t.download)))), h("tbody", {}, rows))));
  }
  function update() {
    const now = device.registers.value("recording");
    state.className = `pill ${now === "recording" ? "bad" : now === "failed" ? "warn" : ""}`;
    setText(state, now === "recording" ? `${t.state.recording} · ${device.registers.value("recording_s")} s` : t.state[now] ?? now ?? text.unknown);
    const mb = device.registers.value("recording_mb_left");
    setText(left, mb === null ? "" : mb === 0 ? t.no_room : t.left(mb));
    start.disabled = now === null || now === "recording" || mb === 0;
    stop.disabled = now !== "recording";
    if (now !== was) { was = now; list(); }
  }
  const element = h("div", {}, h("h1", {}, t.title), card(t.title, [left, state, start, stop], body, h("footer", {}, t.note)));
  list();
  update();
  return {element, update};
}
