// What the fingers of one device make together, and a zero of all of them. Nothing of it is there with one finger.
import {device, order} from "./device.js";
import {digits} from "./decode.js";
import {text} from "./text.js";
import {busy, card, h, tile} from "./dom.js";

const hasSeveral = () => device.registers.value("fingers") > 1;

/** Hidden until the device is known to have several fingers. */
export class ZeroAllButton {
  constructor() {
    this.element = h("button", {hidden: true, onclick: () => busy(this.element, () => order("zero_all"))}, text.gripper.zero_all);
  }
  update() {
    this.element.hidden = !hasSeveral();
  }
}

/** The gripper's own registers, 2001 to 2007; every finger's page shows the same ones. Empty until there are several fingers. */
export class GripperCard {
  constructor() {
    const t = text.gripper;
    this.element = h("div");
    this.zeroAll = new ZeroAllButton();
    this.tiles = {state: tile(t.state, "", "wide words"), sum: tile(t.sum, "N"), balance: tile(t.balance, "N"), centre: tile(t.centre, "mm", "wide"),
                  age: tile(t.age, "ms")};
    this.card = card(t.title, this.zeroAll.element, h("div", {class: "tiles"}, Object.values(this.tiles).map((x) => x.element)));
  }
  update() {
    const r = device.registers, t = text.gripper;
    if (hasSeveral() && !this.card.parentNode) this.element.append(this.card);  // and there it stays where nothing is known later
    this.zeroAll.update();
    const shown = (name) => r.value(name)?.toFixed(digits(r.byName.get(name))).replace("-", "−") ?? null;
    const sigma = shown("force_balance_uncertainty"), centre = ["x", "y"].map((axis) => shown(`touch_centre_${axis}`));
    const fingers = r.value("fingers");
    this.tiles.state.show(fingers && r.shown(r.byName.get("gripper_state")), fingers ? t.fingers(fingers) : "");
    this.tiles.sum.show(shown("force_sum"));
    this.tiles.balance.show(shown("force_balance"), sigma === null ? "" : text.live.uncertainty(sigma, "N"));
    this.tiles.centre.show(centre.includes(null) ? null : `x ${centre[0]}  y ${centre[1]}`);
    this.tiles.age.show(shown("oldest_age"));
  }
}
