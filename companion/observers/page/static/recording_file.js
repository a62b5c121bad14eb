// What becomes of a recording's file: it is saved, packed to send, or deleted, which a second click confirms.

import { element, showText } from "./elements.js";
import { Incident } from "./incident.js";
import { named } from "./recorded.js";
import { size } from "./wording.js";

const WISHES = { incident: "pack", answer: "cancel" }; // what is posted of a call -> of a recording

export class RecordingFile {
  constructor(send, say) {
    const wish = (what) => send("recording", { number: this.row.number, wish: what });
    this.save = element("a", { className: "save", download: "" });
    this.pack = new Incident((kind) => wish(WISHES[kind]), say);
    const button = (text, className, onclick) => element("button", { type: "button", className, onclick }, text);
    this.ask = button("", "plain", () => this.confirm(true));
    this.question = element("p");
    this.keep = button("Keep it", "", () => this.confirm(false));
    this.delete = button("Delete it for good", "turn", async () => {
      this.confirm(false);
      showText(this.told, await wish("delete"));
    });
    this.sure = element("div", { className: "turning", role: "group", "aria-label": "Delete the recording?", hidden: true }, this.question,
      element("div", { className: "motions" }, this.keep, this.delete));
    this.told = element("p", { className: "faint", role: "status" });
    this.part = element("div", { className: "incident" }, this.save, this.pack.part, this.ask, this.sure, this.told);
  }

  show(row) {
    if (this.row?.number !== row.number) this.sure.hidden = true, (this.ask.hidden = false), showText(this.told, "");
    this.row = row;
    this.save.href = `/recordings/${row.number}.mcap`;
    showText(this.save, `Save ${row.name} (${size(row.bytes)})`);
    this.pack.show(named(row), {}, row.begin ? row.incident : null);
    showText(this.ask, row.writing ? `Delete ${named(row)}, once the next one has begun` : `Delete ${named(row)}`);
    this.ask.disabled = row.writing;
    showText(this.question, `Delete ${row.name}, ${size(row.bytes)}? It cannot be brought back.`);
    if (row.deletion) showText(this.told, row.deletion);
  }

  confirm(asked) {
    const held = this.sure.contains(document.activeElement) || this.ask === document.activeElement;
    this.sure.hidden = !asked;
    this.ask.hidden = asked;
    if (held) (asked ? this.keep : this.ask).focus();
  }
}
