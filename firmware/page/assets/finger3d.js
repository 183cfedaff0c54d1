// The finger in 3-D, in plain WebGL: its surface coloured by displacement, the touch with its 68 % region on the face, and
// the contact force as an arrow. Finger frame: x across, y up from the base, z into the finger from its face; mm.
import {askSoon, device, isLive} from "./device.js";
import {text} from "./text.js";
import {h, poll} from "./dom.js";

const vertexSource = `
attribute vec3 at, rest, normal; attribute float moved, front;
uniform mat4 view; uniform mat3 turn;
varying vec3 vNormal, vRest; varying float vMoved, vFront;
void main() { gl_Position = view * vec4(at, 1.0); vNormal = turn * normal; vRest = rest; vMoved = moved; vFront = front; }`;
const fragmentSource = `
precision mediump float;
varying vec3 vNormal, vRest; varying float vMoved, vFront;
uniform vec4 touch; uniform float fullScale; uniform vec4 plain;
vec3 scale(float t) {
  vec3 a = vec3(.56, .64, .69), b = vec3(.30, .67, .97), c = vec3(.22, .85, .66), d = vec3(1., .83, .23), e = vec3(1., .42, .21);
  return t < .25 ? mix(a, b, t * 4.) : t < .5 ? mix(b, c, t * 4. - 1.) : t < .75 ? mix(c, d, t * 4. - 2.) : mix(d, e, t * 4. - 3.);
}
void main() {
  vec3 n = normalize(vNormal);
  if (!gl_FrontFacing) n = -n;
  float light = .46 + .44 * max(dot(n, normalize(vec3(.35, .55, .9))), 0.) + .16 * max(dot(n, normalize(vec3(-.8, -.1, .4))), 0.);
  vec3 colour = plain.a > .5 ? plain.rgb : scale(clamp(vMoved / fullScale, 0., 1.));
  if (plain.a < .5 && touch.w > 0. && vFront > .5) {
    float d = distance(vRest, touch.xyz);
    if (d < touch.w) colour = mix(colour, vec3(.91, .12, .39), .45);
    if (abs(d - touch.w) < .55) colour = vec3(.85, .05, .33);
    if (d < .9) colour = vec3(1.);
  }
  gl_FragColor = vec4(colour * light, 1.);
}`;

function program(gl) {
  const made = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertexSource], [gl.FRAGMENT_SHADER, fragmentSource]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  return made;
}

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => a.map((v) => v / (length(a) || 1));

/** A cylinder with a cone on it from `from` to `to`, as triangles; the radius is the cylinder's. */
function arrowMesh(from, to, radius) {
  const along = minus(to, from), size = length(along), way = unit(along);
  const side = unit(cross(way, Math.abs(way[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0])), up = cross(way, side);
  const ring = (t, r, i) => {
    const a = (i / 16) * 2 * Math.PI;
    return [0, 1, 2].map((k) => from[k] + way[k] * t + r * (Math.cos(a) * side[k] + Math.sin(a) * up[k]));
  };
  const head = Math.min(size * 0.45, radius * 5), at = [], normal = [];
  const push = (...points) => {
    const n = unit(cross(minus(points[1], points[0]), minus(points[2], points[0])));
    for (const p of points) { at.push(...p); normal.push(...n); }
  };
  for (let i = 0; i < 16; ++i) {
    const a = ring(0, radius, i), b = ring(0, radius, i + 1), c = ring(size - head, radius, i), d = ring(size - head, radius, i + 1);
    push(a, b, c);
    push(b, d, c);
    push(ring(size - head, radius * 2.4, i), ring(size - head, radius * 2.4, i + 1), to);
    push(ring(size - head, radius * 2.4, i + 1), ring(size - head, radius * 2.4, i), ring(size - head, 0, 0));
  }
  return {at: new Float32Array(at), normal: new Float32Array(normal)};
}

export class FingerView {
  constructor() {
    this.canvas = h("canvas", {tabIndex: 0, role: "img", "aria-label": text.live.finger_label});
    this.note = h("div", {class: "note"}, text.live.no_shape);
    this.scaleText = h("span");
    const legend = h("div", {class: "legend"}, h("div", {}, text.live.displacement), h("div", {class: "bar"}),
                     h("div", {class: "ends"}, h("span", {}, "0"), this.scaleText));
    this.element = h("div", {class: "view finger"}, this.canvas, this.note, legend);
    this.gl = this.canvas.getContext("webgl", {antialias: true, alpha: true, preserveDrawingBuffer: true});
    if (!this.gl) {
      this.note.textContent = text.live.no_webgl;
      this.stopped = true;
      return;
    }
    this.program = program(this.gl);
    this.place = {};
    for (const name of ["at", "rest", "normal", "moved", "front"]) this.place[name] = this.gl.getAttribLocation(this.program, name);
    for (const name of ["view", "turn", "touch", "fullScale", "plain"]) this.place[name] = this.gl.getUniformLocation(this.program, name);
    this.fullScale = 4;
    this.reset();
    this.steer();
    this.watchSize = new ResizeObserver(() => this.draw());
    this.watchSize.observe(this.canvas);
    poll(this, 70, 500, () => { this.note.hidden = Boolean(this.at); });
  }
  stop() {
    this.stopped = true;
    this.watchSize?.disconnect();
    this.gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }
  reset() { [this.yaw, this.pitch, this.zoom] = [2.5, 0.22, 1]; this.draw(); }

  steer() {
    let from = null;
    const turn = (dx, dy) => {
      this.yaw += dx;
      this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + dy));
      this.draw();
    };
    const zoom = (factor) => { this.zoom = Math.max(0.5, Math.min(5, this.zoom * factor)); this.draw(); };
    this.canvas.addEventListener("pointerdown", (e) => { from = [e.clientX, e.clientY]; this.canvas.setPointerCapture(e.pointerId); });
    this.canvas.addEventListener("pointermove", (e) => {
      if (!from) return;
      turn((e.clientX - from[0]) * 0.01, (e.clientY - from[1]) * 0.01);
      from = [e.clientX, e.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) this.canvas.addEventListener(name, () => (from = null));
    this.canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(-e.deltaY * 0.001)); }, {passive: false});
    this.canvas.addEventListener("keydown", (e) => {
      const keys = {ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, -0.1), ArrowDown: () => turn(0, 0.1),
                    "+": () => zoom(1.15), "-": () => zoom(1 / 1.15), 0: () => this.reset()};
      if (!keys[e.key]) return;
      e.preventDefault();
      keys[e.key]();
    });
  }

  async next() {
    if (device.link !== "up" || document.hidden) throw new Error("not now");
    if (this.about !== device.about) this.takeMesh();
    const response = await askSoon("/shape.bin");
    if (!response.ok) throw new Error("no shape");
    const moved = new DataView(await response.arrayBuffer());
    if (!this.rest || moved.byteLength !== 2 * this.rest.length || this.stopped) return;
    for (let i = 0; i < this.rest.length; ++i) this.at[i] = this.rest[i] + moved.getInt16(2 * i, true) / 100;
    this.note.hidden = true;
    this.shade();
    this.draw();
  }
  takeMesh() {
    const surface = device.about?.surface;
    if (!surface) return;
    this.about = device.about;
    this.rest = new Float32Array(surface.rest_mm);
    this.at = new Float32Array(surface.rest_mm);
    this.triangles = new Uint16Array(surface.triangles);
    this.front = new Float32Array(surface.front);
    this.normal = new Float32Array(this.rest.length);
    this.moved = new Float32Array(this.rest.length / 3);
    const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
    this.rest.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
    this.middle = low.map((v, k) => (v + high[k]) / 2);
    this.size = length(minus(high, low));
    const {gl} = this;
    this.buffers ??= Object.fromEntries(["at", "rest", "normal", "moved", "front", "index"].map((name) => [name, gl.createBuffer()]));
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.index);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, this.triangles, gl.STATIC_DRAW);
    this.shade();
  }
  // Normals of the bent surface, and how far each point has moved.
  shade() {
    const {at, normal, triangles, rest, moved} = this;
    normal.fill(0);
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
      const ux = at[b] - at[a], uy = at[b + 1] - at[a + 1], uz = at[b + 2] - at[a + 2];
      const vx = at[c] - at[a], vy = at[c + 1] - at[a + 1], vz = at[c + 2] - at[a + 2];
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      for (const i of [a, b, c]) { normal[i] += nx; normal[i + 1] += ny; normal[i + 2] += nz; }
    }
    let largest = 0;
    for (let i = 0; i < moved.length; ++i) {
      moved[i] = Math.hypot(at[3 * i] - rest[3 * i], at[3 * i + 1] - rest[3 * i + 1], at[3 * i + 2] - rest[3 * i + 2]);
      largest = Math.max(largest, moved[i]);
    }
    this.fullScale = Math.max(4, this.fullScale * 0.995, largest);
    this.scaleText.textContent = `${this.fullScale.toFixed(1)} mm`;
  }

  // Projection, distance and turn as one matrix, column by column as WebGL wants it.
  matrices() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const turn = [[cy, 0, sy], [sp * sy, cp, -sp * cy], [-cp * sy, sp, cp * cy]];
    const aspect = this.canvas.width / this.canvas.height, f = 3.2 / Math.max(1, 0.62 / aspect);
    const far = this.size * 1.72 / this.zoom, near = 1, end = this.size * 8;
    const moved = turn.map((row) => -(row[0] * this.middle[0] + row[1] * this.middle[1] + row[2] * this.middle[2]));
    moved[2] -= far;
    const rows = [
      [...turn[0].map((v) => (v * f) / aspect), (moved[0] * f) / aspect],
      [...turn[1].map((v) => v * f), moved[1] * f],
      [...turn[2].map((v) => (v * (end + near)) / (near - end)), (moved[2] * (end + near)) / (near - end) + (2 * end * near) / (near - end)],
      [...turn[2].map((v) => -v), -moved[2]],
    ];
    const view = [];
    for (let c = 0; c < 4; ++c) for (let r = 0; r < 4; ++r) view.push(rows[r][c]);
    return {view, turn: [0, 1, 2].flatMap((c) => [0, 1, 2].map((r) => turn[r][c]))};
  }
  attribute(name, data, size, use) {
    const {gl} = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    gl.bufferData(gl.ARRAY_BUFFER, data, use);
    gl.enableVertexAttribArray(this.place[name]);
    gl.vertexAttribPointer(this.place[name], size, gl.FLOAT, false, 0, 0);
  }
  draw() {
    const {gl} = this;
    if (!gl || !this.at || this.stopped) return;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [Math.round(this.canvas.clientWidth * ratio), Math.round(this.canvas.clientHeight * ratio)];
    if (!width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    const {view, turn} = this.matrices();
    gl.uniformMatrix4fv(this.place.view, false, view);
    gl.uniformMatrix3fv(this.place.turn, false, turn);
    gl.uniform1f(this.place.fullScale, this.fullScale);
    const r = device.registers;
    const touched = isLive() && r.has("status", "touch_valid");
    const touch = ["touch_x", "touch_y", "touch_z", "touch_uncertainty"].map((name) => r.value(name));
    gl.uniform4fv(this.place.touch, touched && touch.every((v) => v !== null) ? touch : [0, 0, 0, 0]);
    gl.uniform4f(this.place.plain, 0, 0, 0, 0);
    this.attribute("at", this.at, 3, gl.DYNAMIC_DRAW);
    this.attribute("rest", this.rest, 3, gl.DYNAMIC_DRAW);
    this.attribute("normal", this.normal, 3, gl.DYNAMIC_DRAW);
    this.attribute("moved", this.moved, 1, gl.DYNAMIC_DRAW);
    this.attribute("front", this.front, 1, gl.DYNAMIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.index);
    gl.drawElements(gl.TRIANGLES, this.triangles.length, gl.UNSIGNED_SHORT, 0);
    if (touched) this.drawForce(r);
  }
  // Its tip is where the finger is touched; 10 mm and 6 mm more per newton.
  drawForce(r) {
    const force = ["wrench_force_x", "wrench_force_y", "wrench_force_z"].map((name) => r.value(name));
    const tip = ["contact_x", "contact_y", "contact_z"].map((name) => r.value(name));
    if ([...force, ...tip].includes(null) || length(force) < 0.02) return;
    const {gl} = this, way = unit(force), size = 10 + 6 * length(force);
    const mesh = arrowMesh(tip.map((v, k) => v - way[k] * size), tip, 1.1);
    gl.uniform4f(this.place.plain, 0.91, 0.12, 0.39, 1);
    const count = mesh.at.length / 3, none = new Float32Array(count);
    this.attribute("at", mesh.at, 3, gl.DYNAMIC_DRAW);
    this.attribute("rest", mesh.at, 3, gl.DYNAMIC_DRAW);
    this.attribute("normal", mesh.normal, 3, gl.DYNAMIC_DRAW);
    this.attribute("moved", none, 1, gl.DYNAMIC_DRAW);
    this.attribute("front", none, 1, gl.DYNAMIC_DRAW);
    gl.drawArrays(gl.TRIANGLES, 0, count);
  }
}
