// The whole register table with its present words.
import {device} from "./device.js";
import {digits, unitOf, words} from "./decode.js";
import {text} from "./text.js";
import {h, setText, toast} from "./dom.js";

const stays = 1500;  // milliseconds that a change stays marked

export function registersPage() {
  const t = text.registers;
  const table = device.registers.rows.filter((row) => row.kind !== "reserved");
  const shownRows = table.map((row) => {
    const value = h("td", {class: "number live"}), raw = h("td", {class: "mono live"});
    const lines = (row.values || []).map((v) => `${v.value} ${words(v.name)}`).join(", ");
    const element = h("tr", {}, h("td", {class: "number"}, String(row.address)), h("td", {class: "number"}, String(40001 + row.address)),
      h("td", {class: "mono"}, row.name), value, raw, h("td", {class: "wide"}, [row.description, lines].filter(Boolean).join(": ")));
    return {row, element, value, raw, changed: 0, find: `${row.address} ${40001 + row.address} ${row.name} ${words(row.name)} ${row.description}`.toLowerCase()};
  });
  const count = h("small");
  const search = h("input", {type: "search", placeholder: t.search, "aria-label": t.search, oninput: filter});
  const block = h("select", {"aria-label": t.all, onchange: filter}, h("option", {value: ""}, t.all),
                  Object.entries(t.blocks).map(([key, name]) => h("option", {value: key}, name)));
  const body = h("tbody", {}, shownRows.map((r) => r.element));

  function filter() {
    const wanted = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    let seen = 0;
    for (const r of shownRows) {
      const fits = (!block.value || r.row.block === block.value) && wanted.every((w) => r.find.includes(w));
      r.element.hidden = !fits;
      seen += fits;
    }
    setText(count, t.count(seen, shownRows.length));
  }
  function hex(row) {
    const raw = device.registers.raw(row);
    if (!raw) return "";
    return row.type === "text" ? "…" : raw.map((w) => w.toString(16).padStart(4, "0")).join(" ");
  }
  function show() {
    const now = performance.now();
    for (const r of shownRows) {
      const value = device.registers.shown(r.row);
      if (r.value.textContent !== value) {
        if (r.value.textContent && r.row.name !== "heartbeat") r.changed = now;
        setText(r.value, value);
      }
      setText(r.raw, hex(r.row));  // changes also where the rounded value does not
      const is = r.changed && now - r.changed < stays;
      if (r.element.classList.contains("changed") !== Boolean(is)) r.element.classList.toggle("changed", is);
    }
  }
  async function copy() {
    const quote = (s) => `"${String(s).replaceAll('"', '""')}"`;
    const lines = ["address,reference,name,value,unit,raw,description"];
    for (const {row, element} of shownRows) {
      if (element.hidden) continue;
      const value = device.registers.value(row);
      const plain = value === null ? "" : typeof value === "number" ? value.toFixed(digits(row)) : Array.isArray(value) ? value.join(" ") : value;
      lines.push([row.address, 40001 + row.address, row.name, quote(plain), quote(unitOf(row)), quote(hex(row)), quote(row.description)].join(","));
    }
    const csv = lines.join("\n") + "\n";
    try {
      await navigator.clipboard.writeText(csv);
    } catch {  // browsers allow that only on https and localhost
      const area = h("textarea", {value: csv});
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    toast(t.copied);
  }
  const head = Object.entries(t.columns).map(([key, name]) => h("th", {scope: "col", class: ["address", "reference", "value"].includes(key) ? "number" : ""}, name));
  const element = h("div", {}, h("h1", {}, t.title), h("section", {class: "card"},
    h("header", {}, search, block, count, h("span", {class: "gap"}), h("button", {onclick: copy}, t.csv)),
    h("div", {class: "scroll", tabIndex: 0, role: "region", "aria-label": t.title}, h("table", {class: "registers"}, h("thead", {}, h("tr", {}, head)), body)),
    h("footer", {}, t.note)));
  filter();
  show();
  return {element, update: show};
}
