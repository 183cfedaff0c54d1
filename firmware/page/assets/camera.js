// The camera's picture with the markers drawn in. It asks for the next picture only when it has shown the last one, so a
// slow connection slows itself down.
import {askSoon, device, frameOf, isLive} from "./device.js";
import {text} from "./text.js";
import {h, poll} from "./dom.js";

const colours = ["#ff4d94", "#4dabf7", "#94d82d"];
const farFrames = 8;  // values of a frame this far from the picture's lie beside its markers
const every = 70;  // milliseconds; the device makes at most 15 pictures a second

export class CameraView {
  /** `places`: also show where each marker belongs, even while it is seen. `onpicture` is called after each one. */
  constructor({places = false, onpicture = null} = {}) {
    this.places = places;
    this.onpicture = onpicture;
    this.markers = true;
    this.canvas = h("canvas", {role: "img", "aria-label": text.live.picture_label, width: 640, height: 480});
    this.note = h("div", {class: "note"}, text.live.waiting_picture);
    this.element = h("div", {class: "view"}, this.canvas, this.note);
    this.bitmap = null;
    this.stopped = false;
    poll(this, every, 700);
  }
  stop() { this.stopped = true; }
  async next() {
    if (device.link !== "up" || document.hidden) throw new Error("not now");
    const response = await askSoon("/frame.jpg");
    if (!response.ok) {
      this.note.textContent = isLive() && !device.frame.has_image ? text.live.poses_only : text.live.waiting_picture;
      this.note.hidden = false;
      throw new Error("no picture");
    }
    const number = (name) => Number(response.headers.get(name));
    // The last picture stays there when no new ones come.
    if (number("X-Finsight-Frame") !== device.picture.number) {
      device.picture = {number: number("X-Finsight-Frame"), edge: number("X-Finsight-Edge-Px"), mean: number("X-Finsight-Mean"),
                        white: number("X-Finsight-White"), at: performance.now()};
    }
    const bitmap = await createImageBitmap(await response.blob());
    if (this.stopped) return;
    this.bitmap?.close?.();
    this.bitmap = bitmap;
    this.number = device.picture.number;
    this.note.hidden = true;
    this.draw();
    this.onpicture?.();
  }
  draw() {
    const {width, height} = this.bitmap;
    if (this.canvas.width !== width) [this.canvas.width, this.canvas.height] = [width, height];
    const context = this.canvas.getContext("2d");
    context.drawImage(this.bitmap, 0, 0);
    if (!this.markers || !isLive()) return;
    const scale = width / 640, frame = frameOf(this.number);
    if (Math.abs(frame.n - this.number) > farFrames) return;
    (device.about?.markers || []).forEach((marker, p) => {
      const corners = frame.corners[p];
      if (this.places || !corners) outline(context, marker.rest_px, colours[p], scale, [6 * scale, 5 * scale]);
      if (!corners) return;
      outline(context, corners, colours[p], scale, []);
      for (const [x, y] of corners) dot(context, x, y, 3 * scale, colours[p]);
      // The top plate's marker lies between the others: its label goes below, theirs above.
      const left = Math.min(...corners.map((c) => c[0]));
      const top = p === 0 ? Math.max(...corners.map((c) => c[1])) + 26 * scale : Math.min(...corners.map((c) => c[1]));
      const residual = frame.reprojection_px[p];
      label(context, `${text.live.marker(text.plates[p], marker.id)}${frame.seen[p] ? ` · ${text.live.reprojection(residual.toFixed(2))}` : ""}`,
            left, top - 7 * scale, scale, colours[p], width);
    });
  }
}

function outline(context, corners, colour, scale, dashes) {
  context.beginPath();
  corners.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
  context.setLineDash(dashes);
  context.lineWidth = 2 * scale;
  context.strokeStyle = colour;
  context.stroke();
  context.setLineDash([]);
}
function dot(context, x, y, radius, colour) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.fill();
}
function label(context, string, x, y, scale, colour, width) {
  context.font = `600 ${Math.round(11.5 * scale)}px system-ui, "DejaVu Sans", sans-serif`;
  const wide = context.measureText(string).width + 10 * scale;
  const left = Math.max(2, Math.min(x, width - wide - 2)), top = Math.max(18 * scale, y);
  context.fillStyle = "#000a";
  context.beginPath();
  context.roundRect(left, top - 15 * scale, wide, 19 * scale, 4 * scale);
  context.fill();
  context.fillStyle = colour;
  context.fillText(string, left + 5 * scale, top - scale);
}
