// One call as everybody may see it: its pictures, why, what was answered, and what became of that.

import { titled } from "./calls.js";
import { changed, element, showText } from "./elements.js";
import { Picture } from "./picture.js";
import { clock, duration } from "./wording.js";

let numbered = 0;

export class CallView {
  // picked: called with the box at which an operator points; null where nobody may answer.
  // heading: its tag, as deep as the card is in the page.
  constructor(picked = null, heading = "h2") {
    this.id = `call${++numbered}`;
    this.own = null;
    this.data = null;
    this.title = element(heading, { id: this.id, tabIndex: -1 });
    this.reason = element("p", { className: "reason" });
    this.stands = element("p", { className: "stands" });
    this.figures = element("p", { className: "faint" });
    this.raw = new Picture("small", "What it saw", picked);
    this.judged = new Picture("large", "How it judged that", picked);
    this.near = element("div", { className: "near" });
    this.becoming = element("ol", { className: "becoming" });
    this.under = element("div", { className: "under" }, legend("what it asks about", Boolean(picked)));
    this.ask = element("div", { className: "ask" }, this.figures, this.near, this.becoming);
    this.part = element("section", { className: "call", "aria-labelledby": this.id },
      element("header", {}, this.title, this.stands, this.reason),
      element("div", { className: "shots" }, this.raw.part, this.judged.part), this.under, this.ask);
  }

  // rover: what an `AnswerCard` needs besides.
  show(data, rover, time) {
    this.data = data;
    this.part.dataset.stage = data.open ? data.stage : "closed";
    const since = data.since === undefined ? "" : `, open for ${duration(time - data.since)}`;
    showText(this.title, `${titled(data)}${data.open ? since : `: ${data.outcome || "closed"}`}`);
    for (const name of ["reason", "figures", "stands"]) showText(this[name], data[name] ?? "");
    this.stands.dataset.held = String(Boolean(data.holding));
    this.showPictures(data);
    this.showNearest(data);
    changed(this.becoming, [data.answers, data.said, data.undone, data.given], (list) => {
      const given = (data.given ?? []).map((text) => element("li", {}, text));
      const answers = data.answers.map((one) => ({ at: one.at, part: element("li", { tone: one.tone }, element("b", {}, `From here: ${one.said}`), ` ${one.text}`) }));
      const said = data.said.map((one) => ({ at: one.at, part: element("li", {}, one.text) }));
      const rows = [...answers, ...said].sort((a, b) => a.at - b.at);
      rows.forEach((row) => row.part.prepend(element("time", {}, clock(row.at)), " "));
      const undone = data.undone ? [element("li", {}, element("b", {}, "From here: undo"), ` ${data.undone}`)] : [];
      list.replaceChildren(...given, ...rows.map((row) => row.part), ...undone);
    });
  }

  showPictures({ name, roi, box, open, test, size, pictures, large, small_note: coming }) {
    const marks = { roi, box, own: this.own, open: open && !test, size };
    const progress = large.progress ? `${Math.round(large.progress[0] / 1000)}${large.progress[1] ? ` of ${Math.round(large.progress[1] / 1000)}` : ""} kB` : "";
    this.raw.show({ ...marks, url: pictures.raw ?? pictures.small ?? "", plain: Boolean(pictures.raw), note: coming || "No picture of it is here.", alt: `What the rover saw at ${name}${box ? ", with the place meant in yellow" : ""}` });
    this.judged.show({ ...marks, url: pictures.large ?? "", under: pictures.large && pictures.raw, alt: `The same with the judgement: drivable, not drivable and unknown ground`,
      note: large.waits ? `On its way${progress ? `: ${progress}` : "."}` : large.problem ? `It did not come: ${large.problem}.` : "" });
    this.judged.part.hidden = !pictures.large && !large.waits;
  }

  // What was answered in the scene most like this one.
  showNearest(data) {
    const { nearest } = data;
    this.near.hidden = !nearest;
    const same = nearest && this.sayTheSame(data);
    changed(this.near, [nearest, Boolean(same)], (part) => nearest && part.replaceChildren(
      nearest.picture ? element("img", { src: nearest.picture, alt: nearest.call ? `What it saw at C${nearest.call}` : "That place" }) : "",
      element("div", {}, element("p", {}, nearest.text), same || "")));
  }

  // A button that answers as in the nearest scene, or nothing.
  sayTheSame() {
    return null;
  }

  look() {
    this.part.scrollIntoView({ block: "nearest" });
    this.title.focus({ preventScroll: true });
  }
}

// tile: what the yellow frame is. own: whether an operator may draw a frame.
export function legend(tile, own = false) {
  const row = (kind, text) => element("li", {}, element("span", { className: `swatch ${kind}` }), text);
  return element("ul", { className: "legend" }, row("drivable", "drivable"), row("blocked", "not drivable"), row("unknown", "unknown"),
    row("roi", "region of interest"), row("tile", tile), own ? row("own", "your frame") : "");
}
