// The connection: events from the device into one store, requests to it, the key.
import {Registers} from "./decode.js";
import {text} from "./text.js";
import {h, toast} from "./dom.js";

export const device = {
  link: "connecting",  // or "up", "lost", "crowded"
  frame: null, registers: null, about: null, error: "", blockError: "", refusal: "",
  picture: {number: -1, edge: 0, mean: 0, white: 0, at: -Infinity},
  hiddenSince: [0, 0, 0], foundAt: -Infinity, log: [], lastFrameAt: 0,
};
const listeners = new Set();
/** Called with "frame", "registers", "state" or "about"; the return value ends it. */
export function listen(callback) {
  listeners.add(callback);
  return () => listeners.delete(callback);
}
const tell = (what) => { for (const callback of [...listeners]) callback(what); };

async function answerOf(response) {
  const type = response.headers.get("Content-Type") || "";
  const body = type.startsWith("application/json") ? await response.json() : null;
  if (!response.ok) throw Object.assign(new Error(body?.error || text.answered(response.status)), {status: response.status});
  return body;
}
/** fetch(), which throws in the page's words where there is no answer. */
async function ask(path, options = {}) {
  try {
    return await fetch(path, options);
  } catch {
    throw new Error(text.no_answer);
  }
}
/** For an answer within some seconds: a request over a pulled cable would otherwise wait for minutes. */
export const askSoon = (path, seconds = 5) => ask(path, {signal: AbortSignal.timeout(1000 * seconds)});
export const get = async (path) => answerOf(await askSoon(path, 30));

let token = "", until = 0;
export const unlockedFor = () => Math.max(0, Math.ceil((until - Date.now()) / 1000));
async function send(path, body) {
  // What a device takes that hangs now, it would do when it goes on again: when something else may touch the finger.
  if (device.link === "lost") throw new Error(text.no_answer);
  const answer = await answerOf(await ask(path, {
    signal: AbortSignal.timeout(30000), method: "POST", headers: {"Content-Type": "application/json", "X-Finsight-Token": token}, body: JSON.stringify(body)}));
  until = Date.now() + 30000;
  return answer;
}
/** A change. Asks for the key first where that is needed. Throws what the device says against it, or null if people cancel. */
export async function post(path, body) {
  if (!token || unlockedFor() === 0) await askForKey();
  try {
    return await send(path, body);
  } catch (error) {
    if (error.status !== 401) throw error;
    token = "";
    await askForKey();
    return send(path, body);
  }
}
/** Sends a file, which may be long. `progress` is called with the share that is sent. */
export async function upload(path, file, progress) {
  if (!token || unlockedFor() === 0) await askForKey();
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();  // fetch() tells nothing of what is sent
    request.open("POST", path);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.setRequestHeader("X-Finsight-Token", token);
    request.upload.onprogress = (event) => progress(event.loaded / event.total);
    request.onerror = () => reject(new Error(text.updates.broken));
    request.onload = () => {
      let answer = null;
      try { answer = JSON.parse(request.responseText); } catch { /* told by its status */ }
      if (request.status === 200) resolve(answer);
      else reject(new Error(answer?.error || text.answered(request.status)));
    };
    request.send(file);
  });
}
/** post(), told in a toast; true if it was done. The device may have something to add. */
export async function change(path, body, done) {
  try {
    const words = (await post(path, body))?.note || done;
    if (words) toast(words);
    return true;
  } catch (error) {
    if (error) toast(error.message, "bad");
    return false;
  }
}

export function askForKey() {
  return new Promise((resolve, reject) => {
    const key = h("input", {type: "number", id: "key", min: 1, max: 65535, required: true, autocomplete: "off"});
    const problem = h("p", {class: "soft", role: "alert"});
    const dialog = h("dialog", {"aria-labelledby": "key-title"}, h("form", {
      onsubmit: async (event) => {
        event.preventDefault();
        try {
          token = (await send("/api/unlock", {key: Number(key.value)})).token;
          toast(text.lock.done);
          dialog.close();
          resolve();
          tell("state");
        } catch (error) {
          problem.textContent = error.message;
          key.select();
        }
      }}, h("h2", {id: "key-title"}, text.lock.title), h("p", {class: "soft"}, text.lock.explain),
      h("div", {class: "row"}, h("label", {htmlFor: "key"}, text.lock.key), key), problem,
      h("div", {class: "row end"}, h("button", {type: "button", onclick: () => dialog.close()}, text.cancel),
        h("button", {class: "main"}, text.lock.ok))));
    dialog.addEventListener("close", () => { dialog.remove(); reject(null); });
    document.body.append(dialog);
    dialog.showModal();
  });
}
export async function lock() {
  await send("/api/lock", {}).catch(() => {});
  token = "";
  until = 0;
  tell("state");
}

/** A command, and its result once it is in the history. True if it was done. */
export async function order(command) {
  const name = text.commands.names[command] || command;
  try {
    const {sequence} = await post("/api/command", {command});
    for (let i = 0; i < 40; ++i) {
      await new Promise((r) => setTimeout(r, 250));
      for (let n = 1; n <= 8; ++n) {
        if (device.registers.value(`history_${n}_sequence`) !== sequence) continue;
        const result = device.registers.value(`history_${n}_result`);
        if (result === "running") break;
        if (result === "done") toast(text.commands.done(name));
        else toast(text.commands.failed(name, text.commands.own_results[command]?.[result] || text.commands.results[result] || result), "bad");
        return result === "done";
      }
    }
    toast(text.commands.failed(name, text.commands.no_result), "bad");
  } catch (error) {
    if (error) toast(error.message, "bad");
  }
  return false;
}

function note(line) {
  device.log.unshift({at: new Date(), line});
  device.log.length = Math.min(device.log.length, 200);
}

const recent = [];  // the last frames: a picture may be older than the newest of them
/** The frame of this number, or the one that was nearest to it. */
export const frameOf = (n) => recent.reduce((best, f) => (Math.abs(f.n - n) < Math.abs(best.n - n) ? f : best), device.frame);

let lastFault = null, number = 0;
function take(frame) {
  device.frame = frame;
  recent.push(frame);
  if (recent.length > 40) recent.shift();
  device.lastFrameAt = performance.now();
  device.registers.set("measurements", frame.words);
  const process = device.registers.words.process;
  if (process) device.registers.set("process", [...process.slice(0, 10), ...frame.process]);
  for (let p = 0; p < 3; ++p) {
    if (frame.seen[p]) device.hiddenSince[p] = 0;
    else device.hiddenSince[p] ||= performance.now();
  }
  if (frame.corners.some(Boolean)) device.foundAt = performance.now();
  noteFault();
  if (frame.n < number || !device.about) loadAbout();  // the program was started again
  number = frame.n;
}

function noteFault() {
  const fault = device.registers.value("fault");
  if (fault === lastFault) return;
  if (lastFault !== null || fault !== "none") note(fault === "none" ? "fault over" : `fault: ${fault.replaceAll("_", " ")}`);
  lastFault = fault;
}

let loading = false;
async function loadAbout() {
  if (loading) return;
  loading = true;
  try {
    device.about = await get("/api/about");
    tell("about");
  } catch {
    device.about = null;
  } finally {
    setTimeout(() => (loading = false), 1000);
  }
}

/** Whether the frame on show is from this moment. */
export const isLive = () => device.link === "up" && device.frame && performance.now() - device.lastFrameAt < 1500;
/** Whether the picture's sharpness and brightness are from this moment. */
export const hasPicture = () => device.link === "up" && performance.now() - device.picture.at < 3000;
/**
 * Whether the registers are from this moment. Otherwise none of them has a value, but for the measurements: they come with every
 * frame, before the first registers and for a moment after the program that wrote them has stopped.
 */
export const isKnown = () => Boolean(device.registers?.words.diagnostics);

// The device says something twice a second, and every 1.5 s where the measuring program hangs. Silence is counted in looks
// that this page has taken, not in time: a browser that was busy for two seconds has events waiting for it.
const lookEvery_ms = 500, quietLooks = 5, looksBetweenTries = 10;
let source = null, quiet = 0;

function setLink(link) {
  if (device.link === link) return;
  const was = device.link;
  device.link = link;
  if (link === "up") { note("connected"); loadAbout(); }
  else {
    if (was === "up") note("connection lost");
    device.registers.words = {};
    device.picture.at = -Infinity;
  }
  tell("state");
}
function look() {
  if (document.hidden) return;
  ++quiet;
  if (quiet === quietLooks && device.link !== "crowded") setLink("lost");
  if (quiet === looksBetweenTries) connect();  // a stream over a dead link never ends by itself
}

/** The device has said something. */
function hear(what) {
  quiet = 0;
  setLink("up");
  tell(what);
}
function takeRegisters(words) {
  device.error = words.error;
  device.blockError = words.block_error;
  const measurements = isLive() ? device.registers.words.measurements : words.measurements;
  if (words.error) {
    device.registers.words = isLive() ? {measurements} : {};
  } else {
    for (const block of ["control", "process", "history", "gathered", "diagnostics"]) device.registers.set(block, words[block]);
    device.registers.set("measurements", measurements);
    noteFault();
  }
}

function connect() {
  quiet = 0;
  source?.close();
  const stream = source = new EventSource("/api/events");
  stream.addEventListener("frame", (event) => { take(JSON.parse(event.data)); hear("frame"); });
  stream.addEventListener("registers", (event) => { takeRegisters(JSON.parse(event.data)); hear("registers"); });
  stream.onerror = async () => {
    // One that is not closed tries again by itself.
    const link = stream.readyState === EventSource.CLOSED ? await whyRefused() : device.link === "crowded" ? "lost" : device.link;
    if (stream === source) setLink(link);
  };
}
/** An EventSource does not tell why it was refused; a request of one's own does. */
async function whyRefused() {
  const request = new AbortController();
  try {
    const response = await fetch("/api/events", {signal: request.signal});
    if (response.status !== 503) return "lost";
    device.refusal = (await response.json()).error;
    return "crowded";
  } catch {
    return "lost";
  } finally {
    request.abort();
  }
}

export async function begin() {
  for (;;) {
    try {
      device.registers = new Registers(await get("/api/registers"));
      break;
    } catch {
      await new Promise((r) => setTimeout(r, 2000));
    }
  }
  connect();
  setInterval(look, lookEvery_ms);
  // A page that nobody sees asks for nothing.
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) { source?.close(); setLink("connecting"); }
    else connect();
  });
}
