// Register words -> values, by the table that the device sends. Words are those that go over the wire.
export class Registers {
  constructor(table) {
    this.rows = table;
    this.byName = new Map(table.map((row) => [row.name, row]));
    this.first = {};
    for (const row of table) this.first[row.block] ??= row.address;
    this.words = {};  // by block
  }
  set(block, words) { this.words[block] = words; }
  lowWordFirst() {
    const row = this.byName.get("word_order");
    return this.words.control?.[row.address - this.first.control] === 1;
  }
  raw(row) {
    const words = this.words[row.block];
    if (!words) return undefined;
    const at = row.address - this.first[row.block];
    const count = row.type === "text" ? 16 : row.type === "uint32" || row.type === "float32" ? 2 : 1;
    return at + count <= words.length ? words.slice(at, at + count) : undefined;
  }
  /** A number, a text, an array of names of set bits, or null where it is not valid or not known. */
  value(name) {
    const row = typeof name === "string" ? this.byName.get(name) : name;
    const words = row && this.raw(row);
    if (!words) return null;
    if (row.kind === "text") {
      return words.flatMap((w) => [w >> 8, w & 255]).filter((c) => c >= 32 && c < 127).map((c) => String.fromCharCode(c)).join("");
    }
    const long = this.lowWordFirst() ? words[1] * 65536 + words[0] : words[0] * 65536 + words[1];
    if (row.kind === "client") {
      return long === 0 ? "" : long === 1 ? "serial line" : [24, 16, 8, 0].map((s) => (long >>> s) & 255).join(".");
    }
    if (row.kind === "bits") return row.values.filter((v) => (words[0] >> v.value) & 1).map((v) => v.name);
    if (row.kind === "code") return row.values.find((v) => v.value === words[0])?.name ?? words[0];
    if (row.type === "uint16") return row.invalid && words[0] === 65535 ? null : words[0] * row.scale;
    if (row.type === "int16") {
      const signed = (words[0] << 16) >> 16;
      return row.invalid && signed === -32768 ? null : signed * row.scale;
    }
    if (row.type === "uint32") return long * row.scale;
    const view = new DataView(new ArrayBuffer(4));
    view.setUint32(0, long);
    return Number.isFinite(view.getFloat32(0)) ? view.getFloat32(0) : null;
  }
  has(name, bit) { return (this.value(name) || []).includes(bit); }
  /** The same, or null where it is not known. */
  known(name, bit) { return this.value(name)?.includes(bit) ?? null; }
  /** As people read it, with its unit. */
  shown(row) {
    const value = this.value(row);
    if (value === null) return this.raw(row) ? row.invalid || "–" : "–";
    if (Array.isArray(value)) return value.length ? value.map(words).join(", ") : "none";
    if (row.kind === "code" && typeof value === "string") return words(value);
    if (typeof value !== "number") return value || "–";
    if (row.name.endsWith("checksum")) return value.toString(16).padStart(8, "0");
    return `${value.toFixed(digits(row))}${unitOf(row) ? " " + unitOf(row) : ""}`;
  }
}

export const words = (name) => name.replaceAll("_", " ");
export const unitOf = (row) => ({permille: "‰", degC: "°C", deg: "°", bits: "", code: "", ipv4: ""})[row.unit] ?? row.unit;
export const digits = (row) => (row.type === "float32" ? 3 : row.scale >= 1 ? 0 : Math.round(-Math.log10(row.scale)));
