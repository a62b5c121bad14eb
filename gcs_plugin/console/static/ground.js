// Shows what the rover knows of the ground round it, from above, when an operator asks for it.

import { element, showText } from "./elements.js";
import { clock } from "./wording.js";

export class Ground {
  // ask: asks the rover for the picture.
  constructor(ask) {
    this.came = "";
    this.button = element("button", { type: "button", className: "plain", onclick: ask }, "Show the ground from above");
    this.image = element("img", { className: "ground", hidden: true, alt: "The ground from above, the rover's nose up, a line each metre" });
    this.text = element("p", { className: "faint" });
    this.part = element("div", { className: "from-above" }, this.button, this.image, this.text);
  }

  // time: of the rover's clock, for when a picture came.
  show({ picture, coming, problem }, time) {
    this.button.disabled = coming;
    this.image.hidden = !picture;
    if (picture && this.image.getAttribute("src") !== picture) {
      this.image.src = picture;
      this.came = clock(time);
    }
    const shown = picture ? `It came at ${this.came}: green is drivable, red is not, violet has no word.` : "";
    showText(this.text, [coming ? "Coming." : problem ? `It did not come: ${problem}.` : "", shown].join(" ").trim());
  }
}
