// One call in the console: it can be answered, its large picture asked for, and it can be saved.

import { element, showText } from "./elements.js";
import { AnswerCard } from "./answer_card.js";
import { duration } from "./wording.js";

export class ConsoleCard extends AnswerCard {
  // chosen: called when it was put into the report, or taken out.
  constructor(system, send, say, staged, chosen) {
    super(system, send, say, staged, "h3");
    this.more = element("button", { type: "button", className: "plain", onclick: () => this.post("fetch", { rover: system, what: "large", call: this.data.id }) });
    this.save = element("a", { className: "save", download: "" });
    this.chosen = element("input", { type: "checkbox", onchange: () => chosen() });
    this.choice = element("label", { className: "choice" }, this.chosen, "in the report");
    this.under.append(this.more);
    this.ask.append(element("div", { className: "keep" }, this.save, this.choice));
  }

  show(data, rover, time) {
    super.show(data, rover, time);
    const large = data.large;
    this.more.hidden = Boolean(data.pictures.large) || large.waits || !data.pictures.small;
    showText(this.more, `Show how it judged that${large.seconds === null ? "" : ` (about ${duration(large.seconds)} on this link)`}${large.problem ? `. It did not come: ${large.problem}` : ""}`);
    this.save.href = `/export/${this.system}/${data.id}.zip`;
    showText(this.save, `Save ${data.kind} ${data.name}`);
  }
}
