// Signed updates: sent to the device, installed by it, and what came of the last one.
import {device, get, upload} from "./device.js";
import {text} from "./text.js";
import {card, h, notice, setText, toast} from "./dom.js";

const levels = {running: "good", went_back: "bad", refused: "bad", installing: "info", restarting: "info", receiving: "info"};

export function updatesPage() {
  const t = text.updates, version = h("b"), pack = h("span"), outcome = h("div", {role: "status", "aria-live": "polite"});
  const bar = h("progress", {max: 1, value: 0, hidden: true, "aria-label": t.sending}), said = h("span");
  const chooser = h("input", {type: "file", id: "update-file", accept: ".update", "aria-label": t.choose});
  const send = h("button", {class: "main", onclick: sendFile}, t.send);
  const network = h("div", {class: "body"});
  const stick = card(t.how, null, h("div", {class: "body"}, h("ol", {}, t.text.map((line) => h("li", {}, line)))));
  stick.hidden = true;
  let stopped = false, sending = false, shown = "";

  async function sendFile() {
    const file = chooser.files[0];
    if (!file) { toast(t.choose_first, "bad"); return; }
    sending = send.disabled = true;
    bar.hidden = false;
    try {
      await upload("/api/update/file", file, (share) => { bar.value = share; setText(said, t.sent(Math.round(100 * share))); });
      setText(said, t.all_sent);
      chooser.value = "";
    } catch (error) {
      if (error) { toast(error.message, "bad"); setText(said, error.message); }
    }
    bar.hidden = true;
    sending = false;
    refresh();
  }
  function show(state) {
    setText(version, `Finsight ${state.version || device.registers.value("firmware_version") || ""}`);
    send.disabled = sending || ["receiving", "installing", "restarting"].includes(state.state);
    const key = JSON.stringify(state);
    if (key === shown) return;
    shown = key;
    stick.hidden = !state.available;
    network.replaceChildren(...(state.available
      ? [h("p", {}, t.network), h("p", {class: "soft"}, t.room(text.bytes(state.room_bytes))), h("div", {class: "row"}, chooser, send, bar, said)]
      : [notice("info", t.none)]));
    const words = t.states[state.state];
    outcome.replaceChildren(...(words ? [notice(levels[state.state], words(state.to, state.version)[0], words(state.to, state.version)[1])] : []),
      ...(words && state.text ? [h("pre", {tabIndex: 0}, state.text)] : []));
  }
  async function refresh() {
    try {
      const state = await get("/api/update");
      if (!stopped) show(state);
    } catch { /* the device restarts */ }
  }
  async function watch() {
    while (!stopped) {
      if (!document.hidden) await refresh();
      await new Promise((r) => setTimeout(r, 2000));
    }
  }
  const update = () => setText(pack, device.registers.value("model_name") || "");
  update();
  watch();
  return {element: h("div", {}, h("h1", {}, t.title), outcome, card(t.now, null, h("div", {class: "body"}, version, h("div", {class: "soft"}, pack))),
    card(t.over_network, null, network), stick), update, leave() { stopped = true; }};
}
