// Settings with what they do and how far they may go; all of them as one file.
import {device, change, order, get} from "./device.js";
import {digits, unitOf, words} from "./decode.js";
import {text} from "./text.js";
import {card, fileButton, h, save, setText, toast} from "./dom.js";

const groupOf = (row) => (row.address < 1016 ? "thresholds" : row.address >= 1100 ? "helpers" : "behaviour");

export function settingsPage() {
  const t = text.settings;
  const rows = device.registers.rows.filter((row) => row.factory !== undefined && row.kind !== "reserved");
  const count = h("span", {class: "soft"});
  const apply = h("button", {class: "main", onclick: applyAll}, t.apply), discard = h("button", {onclick: () => fields.forEach((f) => f.reset())}, t.discard);

  const inUnits = (row, raw) => (raw * row.scale).toFixed(digits(row));
  const fields = rows.map((row) => {
    const id = `s-${row.name}`, isCode = Boolean(row.values);
    const input = isCode
      ? h("select", {id, onchange: mark}, row.values.map((v) => h("option", {value: v.name}, words(v.name))))
      : h("input", {id, type: "number", min: inUnits(row, row.lowest), max: inUnits(row, row.highest), step: row.scale, oninput: mark, "aria-describedby": `${id}-h`});
    const factory = isCode ? words(row.values.find((v) => v.value === row.factory)?.name ?? "") : `${inUnits(row, row.factory)} ${unitOf(row)}`;
    const range = isCode ? "" : t.range(inUnits(row, row.lowest), inUnits(row, row.highest), unitOf(row));
    const name = words(row.name);
    const element = h("div", {class: "setting"}, h("label", {htmlFor: id}, name[0].toUpperCase() + name.slice(1)),
      h("div", {class: "help", id: `${id}-h`}, [row.description, range, t.factory(factory)].filter(Boolean).join(" · ")),
      h("div", {class: "field"}, input, h("span", {class: "unit"}, unitOf(row))));
    let known = null, dirty = false;
    function mark() { dirty = input.value !== known; element.classList.toggle("dirty", dirty); showCount(); }
    const now = () => { const v = device.registers.value(row); return v === null ? null : isCode ? String(v) : v.toFixed(digits(row)); };
    return {
      row, element, input,
      get dirty() { return dirty; },
      get value() { return isCode ? input.value : Number(input.value); },
      reset() { dirty = false; known = null; element.classList.remove("dirty"); this.update(); showCount(); },
      update() {
        const value = now();
        if (value === null || value === known || dirty) return;
        known = input.value = value;
      },
    };
  });
  function showCount() {
    const n = fields.filter((f) => f.dirty).length;
    setText(count, n ? t.changed(n) : t.none);
    apply.disabled = discard.disabled = n === 0;
  }
  async function applyAll() {
    const dirty = fields.filter((f) => f.dirty);
    const bad = dirty.find((f) => !f.input.reportValidity());
    if (bad) return;
    if (await change("/api/settings", Object.fromEntries(dirty.map((f) => [f.row.name, f.value])), t.saved)) dirty.forEach((f) => f.reset());
  }
  async function exportFile() {
    try {
      const file = await get("/api/export");
      save(`finsight-${file.serial_number || "device"}.json`, new Blob([JSON.stringify(file, null, 2) + "\n"], {type: "application/json"}));
    } catch (error) { toast(error.message, "bad"); }
  }
  async function importText(written) {
    let content;
    try { content = JSON.parse(written); } catch { toast(t.not_json, "bad"); return; }
    if (!confirm(t.import_ask)) return;
    if (await change("/api/import", content, t.imported)) fields.forEach((f) => f.reset());
  }
  const groups = Object.entries(t.groups).map(([key, name]) => card(name, null, fields.filter((f) => groupOf(f.row) === key).map((f) => f.element)));
  const element = h("div", {}, h("h1", {}, t.title), groups,
    card(t.file, [h("button", {onclick: exportFile}, t.export), ...fileButton(t.import, ".json,application/json", t.not_json, importText),
                  h("button", {class: "danger", onclick: async () => { if (confirm(t.factory_ask) && await order("factory")) fields.forEach((f) => f.reset()); }}, t.factory_all)],
         h("div", {class: "body soft"}, t.file_note)),
    h("div", {class: "bar-bottom"}, count, h("span", {class: "gap"}), discard, apply, h("button", {onclick: () => order("save")}, t.save)));
  showCount();
  const update = () => fields.forEach((f) => f.update());
  update();
  return {element, update};
}
