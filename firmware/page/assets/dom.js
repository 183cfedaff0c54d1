// Elements in one call, and the few shapes that every page has.
import {text as texts} from "./text.js";

/** h("button", {class: "main", onclick}, "text", child, [children]) */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && name !== "list" && name !== "form") element[name] = value;
    else element.setAttribute(name === "class" ? "class" : name, value === true ? "" : value);
  }
  element.append(...children.flat(2).filter((c) => c !== null && c !== undefined && c !== false));
  return element;
}

/** A button that is disabled or hidden loses the focus. This one gets it unless it has gone elsewhere. */
export function keepFocus(button) {
  if (document.activeElement === document.body) button.focus();
}

/** What a button began is under way. */
export async function busy(button, task) {
  button.disabled = true;
  try {
    return await task();
  } finally {
    button.disabled = false;
    keepFocus(button);
  }
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

const paths = {
  live: "M3 12h4l3 8 4-16 3 8h4",
  setup: "M12 3v4M12 17v4M3 12h4M17 12h4M8 12a4 4 0 1 0 8 0 4 4 0 0 0-8 0",
  registers: "M4 5h16M4 10h16M4 15h16M4 20h16M10 5v15",
  settings: "M4 7h10M18 7h2M4 17h2M10 17h10M16 5v4M8 15v4",
  recordings: "M12 5a7 7 0 1 0 0 14 7 7 0 0 0 0-14M12 9a3 3 0 1 0 0 6 3 3 0 0 0 0-6",
  diagnostics: "M5 4h14v16H5zM9 9h6M9 13h6M9 17h3",
  updates: "M12 4v11M8 8l4-4 4 4M5 19h14",
  lock: "M6 11h12v9H6zM9 11V8a3 3 0 0 1 6 0v3",
  unlock: "M6 11h12v9H6zM9 11V8a3 3 0 0 1 5.600-1.500",
  warn: "M12 4 2.500 20h19zM12 10v5M12 17.500v.5",
  bad: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18M9 9l6 6M15 9l-6 6",
  good: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18M8 12.500l3 3 5-6",
  info: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18M12 11v6M12 7.500v.5",
};

export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  for (const [key, value] of Object.entries({d: paths[name], fill: "none", stroke: "currentColor", "stroke-width": "2",
                                             "stroke-linecap": "round", "stroke-linejoin": "round"})) {
    path.setAttribute(key, value);
  }
  svg.append(path);
  return svg;
}

export const card = (title, actions, ...body) =>
  h("section", {class: "card"}, h("header", {}, h("h2", {}, title), h("span", {class: "gap"}), actions || []), body);

/** A value with its name above and a remark below it. */
export function tile(name, unit, kind = "") {
  const number = h("span"), more = h("div", {class: "more"});
  const element = h("div", {class: `tile ${kind}`}, h("div", {class: "name"}, name),
                    h("div", {class: "value"}, number, unit ? h("span", {class: "unit"}, unit) : null), more);
  return {element, show(value, below = "") {
    setText(number, value ?? texts.invalid);
    setText(more, below);
    element.classList.toggle("off", value === null || value === undefined);
  }};
}

export function notice(level, title, text, action) {
  return h("div", {class: `notice ${level}`}, icon(level === "info" ? "info" : level),
           h("div", {}, h("b", {}, title), text ? h("span", {}, text) : null), action ? h("div", {class: "act"}, action) : null);
}

/** Calls view.next() every `every` milliseconds, one after the other, until view.stopped. After one that failed it calls
 * `failed` and waits `pause` milliseconds more. */
export async function poll(view, every, pause, failed = () => {}) {
  const wait = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
  while (!view.stopped) {
    const began = performance.now();
    try {
      await view.next();
    } catch {
      failed();
      await wait(pause);
    }
    await wait(Math.max(5, every - (performance.now() - began)));
  }
}

export function toast(text, level = "") {
  const element = h("div", {class: `toast ${level}`}, text);
  document.getElementById("toasts").append(element);
  setTimeout(() => element.remove(), level === "bad" ? 9000 : 4500);
}

/** Rows of cells below the names of their columns; a cell is a text or a td of one's own. */
export const table = (label, columns, rows) =>
  h("div", {class: "scroll", tabIndex: 0, role: "region", "aria-label": label}, h("table", {},
    h("thead", {}, h("tr", {}, columns.map((name) => h("th", {scope: "col"}, name)))),
    h("tbody", {}, rows.map((cells) => h("tr", {}, cells.map((cell) => (cell instanceof Node ? cell : h("td", {class: "number"}, cell))))))));

/** A button that asks for a file and gives its text to `use`, or tells `refusal` where it is too long for one of ours. */
export function fileButton(name, accept, refusal, use) {
  const chooser = h("input", {type: "file", accept, hidden: true, "aria-label": name, onchange: async () => {
    const file = chooser.files[0];
    chooser.value = "";
    if (!file) return;
    if (file.size > 200000) toast(refusal, "bad");
    else use(await file.text());
  }});
  return [h("button", {onclick: () => chooser.click()}, name), chooser];
}

export const saveCsv = (name, lines) => save(name, new Blob([lines.join("\n") + "\n"], {type: "text/csv"}));

export function save(name, blob) {
  const link = h("a", {href: URL.createObjectURL(blob), download: name});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
