import {device} from "./device.js";
import {text} from "./text.js";
import {card, h, notice, setText} from "./dom.js";

export function updatesPage() {
  const t = text.updates, version = h("b"), pack = h("span");
  const update = () => {
    setText(version, `Finsight ${device.registers.value("firmware_version") || ""}`);
    setText(pack, device.registers.value("model_name") || "");
  };
  update();
  return {element: h("div", {}, h("h1", {}, t.title), card(t.now, null, h("div", {class: "body"}, version, h("div", {class: "soft"}, pack))),
    card(t.how, null, h("div", {class: "body"}, h("ol", {}, t.text.map((line) => h("li", {}, line))), notice("info", t.note)))), update};
}
