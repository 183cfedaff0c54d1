// The frame around the pages: header, navigation, and which page is on show.
import {begin, device, get, isLive, listen, lock, askForKey, unlockedFor} from "./device.js";
import {text} from "./text.js";
import {h, icon, setText} from "./dom.js";
import {summary} from "./why.js";
import {livePage} from "./live.js";
import {setupPage} from "./setup.js";
import {registersPage} from "./registers.js";
import {settingsPage} from "./settings.js";
import {recordingsPage} from "./recordings.js";
import {diagnosticsPage} from "./diagnostics.js";
import {updatesPage} from "./updates.js";

const pages = {live: livePage, setup: setupPage, registers: registersPage, settings: settingsPage, recordings: recordingsPage,
               diagnostics: diagnosticsPage, updates: updatesPage};
const main = document.getElementById("main"), nav = document.getElementById("nav"), top = document.getElementById("top");

const pill = h("span", {class: "pill", role: "status"}), who = h("div", {class: "who"});
const chooser = h("nav", {class: "fingers", "aria-label": text.fingers});
const lockText = h("span");
const lockButton = h("button", {onclick: () => (unlockedFor() ? lock() : askForKey().catch(() => {}))}, icon("lock"), lockText);
top.append(h("div", {class: "brand"}, h("img", {src: "/icon.svg", alt: ""}), h("span", {}, text.brand)), chooser, who, h("span", {class: "gap"}), pill, lockButton);
const links = Object.keys(pages).map((name) => h("a", {href: `#${name}`}, icon(name), text.pages[name]));
nav.append(...links);

let current = null, name = "";
function show() {
  const [wanted, part] = location.hash.slice(1).split("/");
  const next = pages[wanted] ? wanted : "live";
  if (next === name && current) {
    current.goTo?.(part);
    return;
  }
  current?.leave?.();
  name = next;
  links.forEach((a) => (a.getAttribute("href") === `#${name}` ? a.setAttribute("aria-current", "page") : a.removeAttribute("aria-current")));
  document.title = `${text.pages[name]} · ${text.brand}`;
  current = pages[name]();
  main.replaceChildren(current.element);
  window.scrollTo(0, 0);
  current.update("registers");
}

function showHeader() {
  const [level, word] = summary();
  pill.className = `pill ${level}`;
  setText(pill, word);
  document.body.classList.toggle("old", !isLive());
  const r = device.registers;
  setText(who, [device.about?.finger, text.serial(r.value("serial_number"))].filter(Boolean).join(" · "));
  const seconds = unlockedFor();
  setText(lockText, seconds ? text.lock.unlocked(seconds) : text.lock.locked);
}

// Each finger of a board has its page at a port of its own.
async function showFingers() {
  const {own, fingers} = await get("/api/fingers");
  if (fingers.length < 2) return;
  const link = (finger) => h("a", {href: `//${location.hostname}:${finger.port}/${location.hash}`,
                                   "aria-current": finger.name === own ? "page" : "false"}, finger.name);
  chooser.replaceChildren(...fingers.map(link));
}

document.getElementById("skip").addEventListener("click", (event) => { event.preventDefault(); main.focus(); });
await begin();
showFingers().catch(() => {});
window.addEventListener("hashchange", () => showFingers().catch(() => {}));
show();
window.addEventListener("hashchange", show);
listen((what) => {
  showHeader();
  current?.update(what);
});
setInterval(showHeader, 1000);
