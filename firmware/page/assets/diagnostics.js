// What went wrong, and how the device is doing.
import {askSoon, device, get, isKnown, isLive, order} from "./device.js";
import {words} from "./decode.js";
import {text} from "./text.js";
import {card, h, setText} from "./dom.js";
import {WhyList} from "./why.js";

function facts(names, shownOf) {
  const values = Object.keys(names).map((key) => [key, h("dd")]);
  const element = h("dl", {class: "facts"}, values.map(([key, dd]) => [h("dt", {}, names[key]), dd]));
  return {element, update: () => values.forEach(([key, dd]) => setText(dd, shownOf(key)))};
}

export function diagnosticsPage() {
  const t = text.diagnostics, r = device.registers, why = new WhyList();
  const faults = h("tbody"), times = h("tbody"), log = h("div"), own = h("div"), pictures = h("div", {class: "pictures"});
  const identity = facts(t.names, (key) => {
    if (key === "source") return device.about?.source ?? "–";
    if (key === "mount") return device.about ? (device.about.mount_is_measured ? t.mount_measured : t.mount_nominal) : "–";
    if (!isKnown()) return text.invalid;
    if (key === "uptime") return text.seconds(r.value("uptime"));
    if (key === "calibration_date") {
      const d = String(r.value(key));
      return d === "0" ? "–" : `${d.slice(0, 4)}-${d.slice(4, 6)}-${d.slice(6)}`;
    }
    return r.shown(r.byName.get(key));
  });
  let faultKey = "", logKey = "";
  function update(what) {
    why.update();
    if (what === "frame") return;
    identity.update();
    const uptime = r.value("uptime") ?? 0;
    const list = [1, 2, 3, 4, 5, 6, 7, 8].map((n) => ["code", "began", "lasted"].map((f) => r.value(`fault_${n}_${f}`))).filter((f) => f[0] && f[0] !== "none");
    const key = JSON.stringify([isKnown(), list, Math.floor(uptime / 10)]);
    if (key !== faultKey) {
      faultKey = key;
      faults.replaceChildren(...(list.length ? list.map(([code, began, lasted]) => h("tr", {}, h("td", {}, (text.why.faults[code] || [words(String(code))])[0]),
        h("td", {class: "number"}, t.ago(text.seconds(uptime - began))), h("td", {class: "number"}, lasted === null ? t.stands : text.seconds(lasted))))
        : [h("tr", {}, h("td", {class: "soft", colSpan: 3}, isKnown() ? t.no_faults : text.unknown))]));
    }
    const stages = isLive() ? ["poses", "shape", "touch", "registers", "frame"] : [];
    times.replaceChildren(...stages.map((stage) => h("tr", {}, h("td", {}, stage),
      device.frame.times[stage].map((us) => h("td", {class: "number"}, `${(us / 1000).toFixed(2)} ms`)))));
    if (logKey !== String(device.log.length) + device.log[0]?.at) {
      logKey = String(device.log.length) + device.log[0]?.at;
      own.replaceChildren(device.log.length ? h("pre", {tabIndex: 0}, device.log.map((l) => `${l.at.toLocaleTimeString()}  ${l.line}`).join("\n")) : h("span", {class: "soft"}, t.log_none));
    }
  }
  const heads = (...names) => h("thead", {}, h("tr", {}, names.map((n, i) => h("th", {scope: "col", class: i ? "number" : ""}, n))));
  const element = h("div", {}, h("h1", {}, t.title), why.element, h("div", {class: "two"},
    h("div", {}, card(t.faults, h("button", {onclick: () => order("clear")}, t.clear), h("table", {}, heads(t.code, t.began, t.lasted), faults)),
      card(t.times, null, h("table", {}, heads(t.stage, t.p50, t.p99, t.worst), times))),
    h("div", {}, card(t.identity, [h("a", {class: "button", href: "/api/diagnostics.tar", download: "finsight-diagnostics.tar"}, t.download),
      h("button", {onclick: () => { if (confirm(t.restart_ask)) order("reset"); }}, t.restart)], h("div", {class: "body"}, identity.element)),
      card(t.page_log, null, h("div", {class: "body"}, own)))),
    card(t.pictures, null, h("div", {class: "body"}, pictures)), card(t.log, null, h("div", {class: "body"}, log), h("footer", {}, t.log_note)));
  // What the device keeps; looked at now and then.
  let stopped = false, shown = "", said = null;
  async function look() {
    const list = await get("/api/pictures"), ids = JSON.stringify(list.map((p) => p.id));
    if (ids !== shown || said === null) {
      shown = ids;
      pictures.replaceChildren(...(list.length ? list.map((p) => {
        const caption = t.picture_of(p.fault === "none" ? "" : (text.why.faults[p.fault] || [words(p.fault)])[0], p.hidden, text.seconds(p.ago_s));
        return h("figure", {}, h("img", {src: `/api/pictures/${p.id}.jpg`, alt: caption}), h("figcaption", {}, caption));
      }) : [h("span", {class: "soft"}, t.no_pictures)]));
    }
    const lines = await (await askSoon("/api/log")).text();
    if (lines === said) return;
    said = lines;
    log.replaceChildren(lines ? h("pre", {tabIndex: 0}, lines.trimEnd().split("\n").slice(-100).reverse().join("\n")) : h("span", {class: "soft"}, t.log_none));
  }
  async function watch() {
    while (!stopped) {
      if (!document.hidden) await look().catch(() => {});
      await new Promise((r) => setTimeout(r, 3000));
    }
  }
  update();
  watch();
  return {element, update, leave() { stopped = true; }};
}
