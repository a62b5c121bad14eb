// Shows what the rover knows of the ground round it, from above, when an operator asks for it.

import { element, showText } from "./elements.js";

export class Ground {
  // ask: asks the rover for the picture.
  constructor(ask) {
    this.button = element("button", { type: "button", className: "plain", onclick: ask }, "Show the ground from above");
    this.image = element("img", { className: "ground", hidden: true, alt: "The ground from above, the rover's nose up, a line each metre" });
    this.text = element("p", { className: "faint" });
    this.part = element("div", { className: "from-above" }, this.button, this.image, this.text);
  }

  show({ picture, coming, problem }) {
    this.button.disabled = coming;
    this.image.hidden = !picture;
    if (picture && this.image.getAttribute("src") !== picture) this.image.src = picture;
    showText(this.text, coming ? "Coming" : problem ? `It did not come: ${problem}` : picture ? "As it was when it was asked for: green is drivable, red is not, violet has no word" : "");
  }
}
